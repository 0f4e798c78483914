"""The emulator's side of a USB serial port in the view: a pseudo terminal, and the changes from the preload library."""

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
from tactemu.exec import shared_page
from tactemu.transports.pty import CMSPAR, PtyTransport
from tactemu.transports.transport import Event, LinesChanged, Noted, Received, SerialSetting

_BYTESIZES = {termios.CS5: 5, termios.CS6: 6, termios.CS7: 7, termios.CS8: 8}
_MAX_CHANGES_PER_READ = 512
"""Maximum number of changes read at once, so that a driver that toggles its lines cannot block the loop."""

Ask = Callable[..., tuple[dict[str, Any], list[int]]]
"""A callable that sends a request to the keeper, and returns its answer and the descriptors beside it."""


class Node:
    """A node in the view's ``/dev``, which exists while its device is plugged in.

    Args:
        ask: sends a request to the keeper.
        usb: the device's description, an argument of :meth:`tactemu.exec.view.View.plug`.
        number: the number of the node; None: the lowest free one.
        hub_port: the number of the hub's port that the device is plugged into.
    """

    def __init__(self, ask: Ask, usb: Mapping[str, Any], *, number: int | None, hub_port: int):
        self._ask, self._usb, self._hub_port = ask, dict(usb), hub_port
        self.number = number
        self.path = Path()
        self._maker = 0
        """The process that plugged it in; a forked child does not unplug it."""
        self._page: mmap.mmap | None = None
        self._pipe = -1

    def point_to(self, pty: str) -> None:
        """Plug the device in; if it is plugged in, exchange the pseudo terminal behind its node.

        Raises:
            TactemuError: the keeper fails, or has ended.
        """
        if self._page is not None:
            _, shared = self._ask("replace", node=self.path.name, pty=pty)
            self._close_shared()
        else:
            answer, shared = self._ask("plug", usb=self._usb, pty=pty, number=self.number, hub_port=self._hub_port)
            self.path, self._maker = Path("/dev", answer["node"]), os.getpid()
        memory, self._pipe = shared
        self._page = mmap.mmap(memory, shared_page.PAGE.size)
        os.close(memory)

    def remove(self) -> None:
        """Unplug the device. Safe to call twice."""
        if self._page is not None:
            self._close_shared()
            if self._maker == os.getpid():
                self._ask("unplug", node=self.path.name)

    def _close_shared(self) -> None:
        assert self._page is not None
        self._page.close()
        os.close(self._pipe)
        self._page, self._pipe = None, -1

    @property
    def pipe(self) -> int:
        """The descriptor that is readable after a change; -1 while the device is unplugged."""
        return self._pipe

    def changes(self) -> list[tuple[int, int]]:
        """Return the changes that the preload library has reported since the last call."""
        try:
            data = os.read(self._pipe, _MAX_CHANGES_PER_READ * shared_page.CHANGE.size) if self._pipe >= 0 else b""
        except BlockingIOError:
            return []
        return list(shared_page.CHANGE.iter_unpack(data))

    def reset_lines(self) -> None:
        """Raise the lines after the last driver has closed the port, for the next one."""
        if self._page is not None:
            struct.pack_into(
                "=I", self._page, shared_page.LINES_OFFSET, shared_page.DTR | shared_page.RTS | shared_page.DEVICE_LINES
            )


class UsbPort(PtyTransport):
    """A serial port of an emulated USB device.

    Changes that the preload library reports come before the bytes that are read in the same turn, so that settings
    apply to the bytes that the driver sent after them.
    """

    scheme = "usb"

    def __init__(self, node: Node):
        super().__init__()
        self._node = self._link = node
        self._control = 0
        """The control flags set by the driver, including those that a pseudo terminal does not keep."""
        self._receives_breaks = False

    @property
    def number(self) -> int | None:
        """The number of the node if it is fixed, else None."""
        return self._node.number

    def set_connector(self, connector: Connector) -> None:
        """Set the connector, which decides the effect of a break: a UART receives a zero byte, CDC-ACM ignores it."""
        self._receives_breaks = isinstance(connector, Serial) and not connector.is_cdc

    def close(self) -> None:
        """Hang up, then unplug the device, in the order of the kernel."""
        self._link = None
        super().close()
        self._link = self._node
        self._control = 0
        self._node.remove()

    def filenos(self, reading: bool = True) -> list[int]:
        """Return those of the pseudo terminal, and the pipe while a driver has the port open."""
        found = super().filenos(reading)
        return [*found, self._node.pipe] if self._has_driver and self._node.pipe >= 0 else found

    def _read_termios(self) -> bytes:
        for what, value in self._node.changes():
            match what:
                case shared_page.LINES:
                    self._side_events.append(LinesChanged(bool(value & shared_page.DTR), bool(value & shared_page.RTS)))
                case shared_page.CONTROL:
                    self._control = value
                case shared_page.BREAK:
                    self._side_events.append(Noted("break" if value else "break ends"))
                    if value and self._receives_breaks:
                        self._side_events.append(Received(b"\0"))
                case shared_page.FLAGS:
                    self._side_events.append(Noted(f"low latency {'on' if value & shared_page.LOW_LATENCY else 'off'}"))
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
        self._node.reset_lines()
        return super()._closed()
