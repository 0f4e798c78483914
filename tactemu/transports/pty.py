"""``pty:PATH``: a pseudo terminal that behaves as a serial port, under a stable name.

A pseudo terminal differs from a serial port; this module compensates for it:

* A new one echoes and rewrites line ends: it is set raw before the name is published.
* It keeps unread bytes: nothing is written while no driver has it open, and what a driver leaves unread is discarded
  when it closes. An open one still takes 17 to 20 kB before it refuses; then complete frames are dropped.
* It has no speed: the driver's ``termios`` is read from our side, custom rates included. Of the other settings the
  kernel keeps stop bits and odd, mark and space parity; even parity looks like none, and every byte size like eight.
* It stays exclusive when the driver that made it so (``TIOCEXCL``) has closed it: then another takes its place.
* It does not report that it was opened: inotify does. The other side is not held open, so that ``fuser`` lists only the
  driver, and ``POLLHUP`` and ``EIO`` mean that the driver has closed.
* Its number ``/dev/pts/N`` is free again once it is unplugged and the driver has closed it: the kernel gives it to the
  next pseudo terminal of any process, and a driver that reopens the number may open another's terminal. Use a ``PATH``
  where a driver reopens the port: its link is missing while the port is unplugged. A driver that keeps an unplugged
  port open gets end of file, ``EIO`` and ``POLLHUP``, and keeps its number from being reused.
* It has no modem lines (``TIOCMGET`` fails): they follow open and close, as the kernel moves those of a port, and what
  a driver in this process sets by :meth:`PtyTransport.set_lines`. ``rfc2217:`` has them.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import struct
import termios
import tty
from collections import deque

from firmware_protocols import WireFrame
from tactemu.base.errors import TransportError, TransportUnavailable, reason_of
from tactemu.transports.byte_port import BytePort
from tactemu.transports.forks import close_in_children
from tactemu.transports.open_watch import OpenWatch
from tactemu.transports.symlink import StableLink
from tactemu.transports.transport import (
    DROPPED,
    MAX_CHUNK_BYTES,
    MAX_LEFTOVER_BYTES,
    RAISED,
    Closed,
    Event,
    LinesChanged,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
)

_TCGETS2 = 0x802C542A
_TERMIOS2 = struct.Struct("4I20s2I")
CMSPAR = 0o10000000000
"""A flag of ``termios``: mark parity with ``PARODD``, space parity without. Python has no name for it."""


class PtyTransport(BytePort):
    """A pseudo terminal. ``pty:PATH`` makes ``PATH`` a link to it; ``pty:`` keeps the kernel's ``/dev/pts/N``."""

    scheme = "pty"

    def __init__(self, location: str = ""):
        self._link = StableLink(location) if location else None
        self.address = location
        self._name = ""
        self._master = -1
        self._open_watch: OpenWatch | None = None
        self._poll = select.poll()
        self._has_driver = False
        """True while a driver has the port open."""
        self._leaving = False
        """True where the driver has closed the port and left bytes that are still being read."""
        self._raised = False
        """True while the modem lines are up; with ``stty -hupcl`` they stay up after closing, and no board restarts."""
        self._termios = b""
        """The driver's settings as the kernel last reported them."""
        self._setting: SerialSetting | None = None
        self._side_events: deque[Event] = deque()
        """Events that the kernel does not report, such as a driver's changes of its modem lines."""

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Make the pair, set it raw, then publish the name.

        Raises:
            TransportError: the path is taken or cannot be written, or there are no pseudo terminals left.
        """
        if self._master >= 0:
            return
        close_in_children(self)
        try:
            self._make_pair()
            if self._link:
                self._link.point_to(self._name)
        except BaseException:
            self.close()
            raise
        self.address = str(self._link.path) if self._link else self._name

    def _make_pair(self) -> None:
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise TransportUnavailable(f"cannot make a pseudo terminal: {reason_of(error)}; mount /dev/pts") from None
        tty.setraw(slave)
        settings = termios.tcgetattr(slave)
        settings[2] |= termios.HUPCL  # the default of a port: the lines drop when it is closed
        termios.tcsetattr(slave, termios.TCSANOW, settings)
        self._name = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll.register(self._master, select.POLLIN)
        self._termios = self._read_termios()
        self._setting = self._setting_in(self._termios)
        self._open_watch = OpenWatch(self._name)
        if self._open_watch.fileno >= 0:
            self._poll.register(self._open_watch.fileno, select.POLLIN)

    def close(self) -> None:
        """Remove the link, then the port: a driver that has it open gets an error, as when a cable is pulled."""
        if self._link:
            self._link.remove()
        if self._master >= 0:
            self._poll.unregister(self._master)
            os.close(self._master)
            self._master = -1
        if self._open_watch:  # last, because the kernel takes some milliseconds
            self._forget(self._open_watch)
            self._open_watch = None
        self._has_driver, self._leaving, self._raised, self._unsent = False, False, False, b""

    def rename(self, name: str) -> None:
        """Give the link another name in the same folder from the next :meth:`open` on, as after unplugging a port."""
        if self._link:
            self._link = StableLink(str(self._link.path.with_name(name)))

    # -- events ------------------------------------------------------------------------------------------------------

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the watch for openings, and the port while a driver has it open; a closed one is always readable."""
        watch = self._open_watch.fileno if self._open_watch else -1
        if watch < 0:
            return []  # no inotify: the port is polled
        return [watch, self._master] if self._has_driver and reading else [watch]

    def poll(self, reading: bool = True) -> list[Event]:
        """Return openings, changes of the setting, bytes and closings."""
        if self._master < 0:
            return []
        ready, seen = self._ready(), ""
        events: list[Event] = []
        if self._open_watch and self._open_watch.fileno in ready:
            seen = self._open_watch.read()
            if self._has_driver and ("co" in seen or (self._leaving and "o" in seen)):  # closed and opened again
                events += self._closed()
            ready = self._ready()  # the port's state must be the newer one
        state = ready.get(self._master, 0)
        gone = bool(state & select.POLLHUP)
        if not self._has_driver and (not gone or "o" in seen):
            self._has_driver = True
            events += [Opened()] if self._raised else [Opened(), RAISED]
            self._raised = True
        if self._has_driver:
            self._finish(self._master)
            room = MAX_CHUNK_BYTES if reading else MAX_LEFTOVER_BYTES if gone else 0
            chunks, all_read = self._read(room, to_the_end=gone) if state else ([], room > 0)
            events += self._changed_setting()  # read after the bytes: settings made before them apply to them
            while self._side_events:
                events.append(self._side_events.popleft())
            events += map(Received, chunks)
            self._leaving = gone
            if gone and (all_read or not reading):
                events += self._closed()
        return events

    def _ready(self) -> dict[int, int]:
        """Return the present state of the port and of the watch for openings, by file descriptor."""
        return dict(self._poll.poll(0))

    def _read(self, room: int, *, to_the_end: bool) -> tuple[list[bytes], bool]:
        """Return at most ``room`` bytes in chunks, and whether those are all. ``to_the_end``: until the kernel says
        that there are no more; else the next poll finds what a short read has left."""
        chunks, wanted, size = [], 0, 0
        try:
            while room > 0 and (to_the_end or size == wanted):
                wanted = min(room, MAX_CHUNK_BYTES)
                if not (size := len(chunk := os.read(self._master, wanted))):
                    break
                chunks.append(chunk)
                room -= size
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise TransportError(f"lost the port {self.address}: {reason_of(error)}") from None
        return chunks, room > 0

    def _closed(self) -> list[Event]:
        self._has_driver, self._leaving, self._unsent = False, False, b""
        self._side_events.clear()
        self._discard_unread()
        self._raised = not _TERMIOS2.unpack_from(self._termios)[2] & termios.HUPCL
        return [Closed()] if self._raised else [Closed(), DROPPED]

    def _discard_unread(self) -> None:
        """Discard bytes that the driver has not read, as a port does; only the other side can flush them."""
        try:
            slave = os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            if self._link and self._ready().get(self._master, 0) & select.POLLHUP:
                self._renew(self._link)
            return
        try:
            termios.tcflush(slave, termios.TCIFLUSH)
            _make_changeable(slave)
        finally:
            os.close(slave)
        if self._open_watch:
            self._open_watch.read()  # our own opening

    def _renew(self, link: StableLink) -> None:
        """Replace the pair by a new one under the same name, because the driver left the old one exclusive.

        A port loses ``TIOCEXCL`` when it is closed; a pseudo terminal does not, and only root can open it again.
        """
        master, open_watch = self._master, self._open_watch
        self._poll.unregister(master)
        self._make_pair()
        link.point_to(self._name)
        if open_watch:
            self._forget(open_watch)
        os.close(master)

    def _forget(self, open_watch: OpenWatch) -> None:
        if open_watch.fileno >= 0:
            self._poll.unregister(open_watch.fileno)
        open_watch.close()

    def set_lines(self, dtr: bool, rts: bool) -> None:
        """Set the modem lines of a driver in this process. Safe from any thread."""
        self._side_events.append(LinesChanged(dtr, rts))

    # -- bytes out ---------------------------------------------------------------------------------------------------

    def write(self, frame: WireFrame) -> bool:
        """Write one frame in one call, or not at all."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a serial port cannot carry the CAN frame {frame}")
        return self._has_driver and self._finish(self._master) and self._put(self._master, frame)

    # -- setting -----------------------------------------------------------------------------------------------------

    @property
    def has_reader(self) -> bool:
        """True if a driver had the port open at the last :meth:`poll`."""
        return self._has_driver

    @property
    def setting(self) -> SerialSetting | None:
        """The settings in the driver's ``termios``."""
        return self._setting

    def _changed_setting(self) -> list[Event]:
        termios_bytes = self._read_termios()
        if termios_bytes == self._termios:
            return []
        self._termios, setting = termios_bytes, self._setting_in(termios_bytes)
        if setting == self._setting or setting.baud is None:  # speed 0 means hang-up, which a pseudo terminal lacks
            return []
        self._setting = setting
        return [SettingChanged(setting)]

    def _read_termios(self) -> bytes:
        """Return the driver's settings, which the kernel gives on our side too; ``TCGETS2`` includes custom rates."""
        return fcntl.ioctl(self._master, _TCGETS2, bytes(_TERMIOS2.size))

    def _setting_in(self, termios_bytes: bytes) -> SerialSetting:
        _, _, control, *_, baud = _TERMIOS2.unpack_from(termios_bytes)
        odd = bool(control & termios.PARODD)
        parity = ("S", "M")[odd] if control & CMSPAR else (None, "O")[odd]
        return SerialSetting(baud=baud or None, parity=parity, stopbits=2 if control & termios.CSTOPB else 1)


def _make_changeable(slave: int) -> None:
    """Change settings that have no effect in raw mode.

    The kernel has no parity on a pseudo terminal; glibc reports that as an error, but only to a driver that changes
    nothing else. These settings make sure that a driver's second opening changes something.
    """
    settings = termios.tcgetattr(slave)
    settings[0] |= termios.IGNBRK  # every way to set a port raw clears one of these two; neither has an effect here
    settings[3] |= termios.ECHOK
    termios.tcsetattr(slave, termios.TCSANOW, settings)
