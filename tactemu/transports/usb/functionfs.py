"""FunctionFS: the device's side of USB in user space, on a machine with a USB device controller.

The kernel's composite device has the identity (``tactemu gadget`` sets it); interfaces, endpoints, and the requests of
a class or the vendor are ours (Linux, ``include/uapi/linux/usb/functionfs.h``).
"""

from __future__ import annotations

import contextlib
import errno
import os
import struct
import threading
import time
from collections import deque
from dataclasses import replace
from pathlib import Path

from tactemu.transports.usb.chip import TO_HOST, Chip, Setup
from tactemu.transports.usb.link import Stream

_DESCRIPTORS, _STRINGS = 3, 2
"""The magic numbers of what is written at first: descriptors (second version) and strings."""
_FULL_SPEED, _ALL_REQUESTS = 1, 64
"""Flags: descriptors for full speed; requests to the device too, as those of an FT232R are."""
_ENABLE, _DISABLE, _SETUP = 2, 3, 4
_EVENT = struct.Struct("<BBHHHB3x")
_NOT_ENABLED_S = 0.01
_MAX_RECEIVED = 64
"""Maximum number of packets that wait for the device; further ones wait in the host."""


def function_descriptors(chip: Chip) -> bytes:
    """Return what is written first: interfaces and endpoints for full speed."""
    own = chip.descriptors()
    interfaces = [replace(each, string=min(each.string, 1)) for each in own.interfaces]
    body = b"".join(each.as_bytes(number) for number, each in enumerate(interfaces))
    count, at = 0, 0
    while at < len(body):
        count, at = count + 1, at + body[at]
    return struct.pack("<4I", _DESCRIPTORS, 16 + len(body), _FULL_SPEED | _ALL_REQUESTS, count) + body


def function_strings(chip: Chip) -> bytes:
    """Return what is written second: the string of the interfaces, which is the product's."""
    own = chip.descriptors()
    if not any(each.string for each in own.interfaces):
        return struct.pack("<4I", _STRINGS, 16, 0, 0)
    body = struct.pack("<H", 0x0409) + own.strings[1].encode() + b"\0"
    return struct.pack("<4I", _STRINGS, 16 + len(body), 1, 1) + body


class FunctionFs:
    """An open function.

    Args:
        mount: the folder where it is mounted.
        chip: the device.
        channel: the part of it with our data.

    Raises:
        OSError: it cannot be opened, or is in use.
    """

    def __init__(self, mount: Path, chip: Chip, channel: Chip):
        self.chip, self._channel = chip, channel
        self.wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        """Readable while data have come."""
        self.is_enabled = False
        """True while a host has configured the device."""
        self._stream = Stream(channel)
        self._changed = threading.Condition()
        self._received: deque[bytes] = deque()
        self._is_closed = False
        self._files: list[int] = []
        try:
            self._control = self._opened(mount / "ep0")
            os.write(self._control, function_descriptors(chip))
            os.write(self._control, function_strings(chip))
            ends = [end for each in chip.descriptors().interfaces for end in each.endpoints]
            names = {end.address: f"ep{number}" for number, end in enumerate(ends, start=1)}
            self._packet_bytes = {end.address: end.packet_bytes for end in ends}
            work = ((channel.data_in, self._send), (channel.data_out, self._receive))
            self._threads = [
                threading.Thread(target=function, args=(self._opened(mount / names[address]),), daemon=True)
                for address, function in work
                if address in names
            ]
        except OSError:
            self.close()
            raise
        for each in self._threads:
            each.start()

    def _opened(self, path: Path) -> int:
        self._files.append(os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC))
        return self._files[-1]

    def close(self) -> None:
        """Close all files, after the device has been unbound from its controller; that ends what is under way."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        for each in getattr(self, "_threads", ()):
            if each.ident is not None:
                each.join(1.0)
        for fileno in (*self._files, self.wake):
            with contextlib.suppress(OSError):
                os.close(fileno)

    def filenos(self) -> list[int]:
        """Return the file descriptors to wait for."""
        return [self._control, self.wake]

    # -- control requests ----------------------------------------------------------------------------------------------

    def serve(self) -> None:
        """Carry out the control requests that have come. Never waits for one."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self.wake)
        with contextlib.suppress(BlockingIOError):
            while True:
                events = os.read(self._control, 4 * _EVENT.size)
                for *setup, kind in _EVENT.iter_unpack(events):
                    self._take(Setup(*setup), kind)

    def _take(self, setup: Setup, kind: int) -> None:
        if kind in (_ENABLE, _DISABLE):
            with self._changed:
                self.is_enabled = kind == _ENABLE
                self._stream.clear()
                self._changed.notify_all()
        elif kind == _SETUP:
            with contextlib.suppress(OSError):  # the host has given up, or is refused
                self._answer(setup)

    def _answer(self, setup: Setup) -> None:
        """Answer a request; one in the other direction than its own refuses it."""
        if setup.kind & TO_HOST:
            answer = self.chip.answer(setup, b"")
            if answer is None:
                os.read(self._control, 1)
            else:
                os.write(self._control, answer)
            return
        data = os.read(self._control, setup.length) if setup.length else b""
        if self.chip.takes(setup):
            with self._changed:
                self._received.append(data)
        elif self.chip.answer(setup, data) is None and not setup.length:
            os.write(self._control, b"")
            return
        if not setup.length:
            os.read(self._control, 0)

    # -- data ----------------------------------------------------------------------------------------------------------

    def take(self) -> bytes | None:
        """Return the next packet of the host, or None."""
        with self._changed:
            if not self._received:
                return None
            self._changed.notify_all()
            return self._channel.from_host(self._received.popleft())

    @property
    def waiting_bytes(self) -> int:
        """The number of bytes that wait for the host."""
        return len(self._stream.to_host)

    def put(self, data: bytes) -> None:
        """Hand data to the host."""
        with self._changed:
            self._stream.put(data)
            self._changed.notify_all()

    def clear(self) -> None:
        """Drop what waits for the host."""
        with self._changed:
            self._stream.clear()

    def _next(self, room: int) -> bytes | None:
        """Wait for data, and return a transfer; None at the end."""
        with self._changed:
            while not self._is_closed and not (self.is_enabled and self._stream.to_host):
                self._changed.wait()
            if self._is_closed:
                return None
            self._stream.waiting[0] = room
            found = self._stream.next()
            return found[1] if found else b""

    def _send(self, fileno: int) -> None:
        """Write transfers as the host asks for them; the work of a thread."""
        packet_bytes = self._packet_bytes[self._channel.data_in]
        room = 64 * packet_bytes if self._channel.is_framed else packet_bytes
        while (transfer := self._next(room)) is not None:
            while transfer is not None and not self._is_closed:
                try:
                    os.write(fileno, transfer)
                    if self._channel.is_framed and transfer and len(transfer) % packet_bytes == 0:
                        os.write(fileno, b"")  # an empty packet ends a transfer of whole packets
                    transfer = None
                except OSError as error:
                    if error.errno != errno.EAGAIN:
                        break  # unplugged: what was under way is lost
                    time.sleep(_NOT_ENABLED_S)

    def _receive(self, fileno: int) -> None:
        """Read packets while there is room for them; the work of a thread."""
        size = self._packet_bytes[self._channel.data_out]
        while not self._is_closed:
            try:
                data = os.read(fileno, size)
            except OSError:
                time.sleep(_NOT_ENABLED_S)
                continue
            with self._changed:
                while len(self._received) >= _MAX_RECEIVED and not self._is_closed:
                    self._changed.wait()
                self._received.append(data)
            with contextlib.suppress(OSError):
                os.eventfd_write(self.wake, 1)
