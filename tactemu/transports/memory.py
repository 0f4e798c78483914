"""``memory:``: a port inside this process, for tests and for runs without a driver. Has no file descriptor."""

from __future__ import annotations

from collections import deque

from firmware_protocols import Frame
from tactemu.transports.transport import BaudChanged, Closed, Event, LinesChanged, Opened, Received, Transport

UNREAD_LIMIT = 65_536
"""Frames that a driver may leave unread before they are dropped."""


class DriverEnd:
    """The driver's end of a :class:`MemoryTransport`."""

    def __init__(self):
        self.is_open = True
        self.baud: int | None = None
        self.sent: deque[Event] = deque()
        """Events for the device's end, oldest first."""
        self.unread: deque[Frame] = deque()
        """Frames from the device, oldest first."""

    def open(self) -> None:
        """Open the port."""
        self.is_open = True
        self.sent.append(Opened())

    def close(self) -> None:
        """Close the port; what was not read is lost."""
        self.is_open = False
        self.unread.clear()
        self.sent.append(Closed())

    def write(self, data: Frame) -> None:
        """Send bytes, or one CAN frame."""
        self.sent.append(Received(data))

    def read(self) -> list[Frame]:
        """Everything that the device has sent since the last call, frame by frame."""
        frames = list(self.unread)
        self.unread.clear()
        return frames

    def set_baud(self, baud: int) -> None:
        """Set the line speed [bit/s]."""
        self.baud = baud
        self.sent.append(BaudChanged(baud))

    def set_lines(self, *, dtr: bool, rts: bool) -> None:
        """Set the modem lines."""
        self.sent.append(LinesChanged(dtr, rts))


class MemoryTransport(Transport):
    """``memory:`` for whatever wire the device has; the driver's end is :attr:`driver`, open from the start."""

    scheme = "memory"
    kinds = ()

    def __init__(self, rest: str = ""):
        self.address = f"memory:{rest}"
        self.driver = DriverEnd()
        self._open = False

    def open(self) -> None:
        """Make the port; a driver whose end is open sees it at once."""
        if not self._open:
            self._open = True
            if self.driver.is_open:
                self.driver.sent.append(Opened())

    def close(self) -> None:
        """Remove the port."""
        self._open = False
        self.driver.sent.clear()

    def filenos(self) -> list[int]:
        """None."""
        return []

    def poll(self) -> list[Event]:
        """What the driver's end did."""
        events = list(self.driver.sent)
        self.driver.sent.clear()
        return events

    def write(self, frame: Frame) -> bool:
        """Hand the frame to the driver's end."""
        if not self.listening or len(self.driver.unread) >= UNREAD_LIMIT:
            return False
        self.driver.unread.append(frame)
        return True

    @property
    def listening(self) -> bool:
        """Whether both ends are open."""
        return self._open and self.driver.is_open

    @property
    def baud(self) -> int | None:
        """The speed that the driver's end set, if it did."""
        return self.driver.baud
