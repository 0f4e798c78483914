"""The emulator's side of a USB serial port in the view: a pseudo terminal, and what the preload library tells of it."""

from __future__ import annotations

import mmap
import os
import struct
import termios
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from firmware_protocols import Connector, Serial
from tactemu.exec import page
from tactemu.transports.pty import CMSPAR, PtyTransport
from tactemu.transports.transport import Event, LinesChanged, Noted, Received, SerialSetting

_BYTESIZES = {termios.CS5: 5, termios.CS6: 6, termios.CS7: 7, termios.CS8: 8}
_MESSAGES = 512
"""So many are read at once: a driver that toggles its lines all the time keeps nobody waiting."""

Ask = Callable[..., tuple[dict[str, Any], list[int]]]
"""A request to the keeper: its answer, and the descriptors beside it."""


class Node:
    """A node in the view's ``/dev``, which is there while something is plugged in.

    Args:
        ask: of the keeper.
        usb: what the device says of itself, as :meth:`tactemu.exec.view.View.plug` takes it.
        number: of the node; ``None``: the lowest that is free.
        plug: number of the socket that the device is in.
    """

    def __init__(self, ask: Ask, usb: Mapping[str, Any], *, number: int | None, plug: int):
        self._ask, self._usb, self._plug = ask, dict(usb), plug
        self.number = number
        self.path = Path()
        self._maker = 0
        """Process that plugged it in; what a forked child closes stays plugged in."""
        self._page: mmap.mmap | None = None
        self._pipe = -1

    def point_to(self, pty: str) -> None:
        """Plug the device in, or give the node that is there another pseudo terminal.

        Raises:
            TransportError: the keeper cannot, or has gone.
        """
        if self._page is not None:
            _, shared = self._ask("replace", node=self.path.name, pty=pty)
            self._leave()
        else:
            answer, shared = self._ask("plug", usb=self._usb, pty=pty, number=self.number, plug=self._plug)
            self.path, self._maker = Path("/dev", answer["node"]), os.getpid()
        memory, self._pipe = shared
        self._page = mmap.mmap(memory, page.PAGE.size)
        os.close(memory)

    def remove(self) -> None:
        """Pull the device out. Safe to call twice."""
        if self._page is not None:
            self._leave()
            if self._maker == os.getpid():
                self._ask("unplug", node=self.path.name)

    def _leave(self) -> None:
        assert self._page is not None
        self._page.close()
        os.close(self._pipe)
        self._page, self._pipe = None, -1

    @property
    def pipe(self) -> int:
        """Readable when the preload library has told something; -1 while nothing is plugged in."""
        return self._pipe

    def told(self) -> list[tuple[int, int]]:
        """What the preload library has told since the last call."""
        try:
            data = os.read(self._pipe, _MESSAGES * page.TOLD.size) if self._pipe >= 0 else b""
        except BlockingIOError:
            return []
        return list(page.TOLD.iter_unpack(data))

    def raise_lines(self) -> None:
        """Nobody has the port open: the next to open it finds its lines raised."""
        if self._page is not None:
            struct.pack_into("=I", self._page, page.LINES_AT, page.DTR | page.RTS | page.AT_REST)


class UsbPort(PtyTransport):
    """A serial port of an emulated USB device.

    What the preload library tells comes before the bytes that are read in the same turn: what a driver set before it
    sent them holds for them.
    """

    scheme = "usb"

    def __init__(self, node: Node):
        super().__init__()
        self._node = self._link = node
        self._control = 0
        """The control flags that the driver has asked for, with those that a pseudo terminal does not keep."""
        self._breaks_heard = False

    @property
    def number(self) -> int | None:
        """Of the node, if it always has the same."""
        return self._node.number

    def set_connector(self, connector: Connector) -> None:
        """A break is a byte of zeros to a UART; USB has a request for it, which firmware ignores."""
        self._breaks_heard = isinstance(connector, Serial) and not connector.is_cdc

    def close(self) -> None:
        """Hang up, then pull the device out: the order in which the kernel does it."""
        self._link = None
        super().close()
        self._link = self._node
        self._control = 0
        self._node.remove()

    def filenos(self, reading: bool = True) -> list[int]:
        """Those of the pseudo terminal, and the pipe while somebody may write into it."""
        found = super().filenos(reading)
        return [*found, self._node.pipe] if self._has_driver and self._node.pipe >= 0 else found

    def _read_termios(self) -> bytes:
        for what, value in self._node.told():
            match what:
                case page.LINES:
                    self._side_events.append(LinesChanged(bool(value & page.DTR), bool(value & page.RTS)))
                case page.CONTROL:
                    self._control = value
                case page.BREAK:
                    self._side_events.append(Noted("break" if value else "break ends"))
                    if value and self._breaks_heard:
                        self._side_events.append(Received(b"\0"))
                case page.FLAGS:
                    self._side_events.append(Noted(f"low latency {'on' if value & page.LOW_LATENCY else 'off'}"))
        return super()._read_termios() + struct.pack("=I", self._control)

    def _setting_in(self, termios_bytes: bytes) -> SerialSetting:
        setting = super()._setting_in(termios_bytes)
        control = self._control
        if not control:
            return setting
        odd = bool(control & termios.PARODD)
        parity = ("SM" if control & CMSPAR else "EO")[odd] if control & termios.PARENB else "N"
        return replace(setting, bytesize=_BYTESIZES[control & termios.CSIZE], parity=parity)

    def _closed(self) -> list[Event]:
        self._node.raise_lines()
        return super()._closed()
