"""``memory:``: a port inside this process, for tests and for runs without a driver. Has no file descriptor."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

from firmware_protocols import WireFrame
from tactemu.transports.transport import (
    DROPPED,
    MAX_CHUNK_BYTES,
    RAISED,
    Closed,
    Event,
    LinesChanged,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
    Transport,
)

MAX_UNREAD_FRAMES = 65_536
"""Frames that a driver may leave unread before they are dropped."""
MAX_WAITING_CHUNKS = 2048
"""Chunks and frames of a driver that may wait for the device's end."""
_AT_ONCE = 64
"""Events that one look takes at most."""


class DriverEnd:
    """The driver's end of a :class:`MemoryTransport`."""

    def __init__(self):
        self.is_open = True
        self.setting = SerialSetting()
        self.sent: deque[Event] = deque()
        """Events for the device's end, oldest first."""
        self.unread: deque[WireFrame] = deque()
        """Frames from the device, oldest first."""

    def open(self) -> None:
        """Open the port."""
        self.is_open = True
        self.sent += (Opened(), RAISED)

    def close(self) -> None:
        """Close the port; what was not read is lost."""
        self.is_open = False
        self.unread.clear()
        self.sent += (Closed(), DROPPED)

    def write(self, data: WireFrame) -> bool:
        """Send bytes, or one CAN frame; ``False`` when the device's end does not take what was sent."""
        pieces = (
            [data[at : at + MAX_CHUNK_BYTES] for at in range(0, len(data), MAX_CHUNK_BYTES)]
            if isinstance(data, bytes)
            else [data]
        )
        if len(self.sent) + len(pieces) > MAX_WAITING_CHUNKS:
            return False
        self.sent.extend(map(Received, pieces))
        return True

    def read(self) -> list[WireFrame]:
        """Everything that the device has sent since the last call, frame by frame."""
        frames = list(self.unread)
        self.unread.clear()
        return frames

    def set_serial(self, **entries: Any) -> None:
        """Set the line: ``baud``, ``bytesize``, ``parity``, ``stopbits``."""
        self.setting = replace(self.setting, **entries)
        self.sent.append(SettingChanged(self.setting))

    def set_lines(self, *, dtr: bool, rts: bool) -> None:
        """Set the modem lines."""
        self.sent.append(LinesChanged(dtr, rts))


class MemoryTransport(Transport):
    """``memory:`` for whatever wire the device has; the driver's end is :attr:`driver`, open from the start."""

    scheme = "memory"

    def __init__(self, rest: str = ""):
        self.address = f"memory:{rest}"
        self.driver = DriverEnd()
        self._open = False

    def open(self) -> None:
        """Make the port; a driver whose end is open sees it at once."""
        if not self._open:
            self._open = True
            if self.driver.is_open:
                self.driver.sent += (Opened(), RAISED)

    def close(self) -> None:
        """Remove the port."""
        self._open = False
        self.driver.sent.clear()

    def filenos(self, reading: bool = True) -> list[int]:
        """None."""
        return []

    def poll(self, reading: bool = True) -> list[Event]:
        """What the driver's end did, as far as its data are taken."""
        events: list[Event] = []
        sent, room = self.driver.sent, MAX_CHUNK_BYTES if reading else 0
        while sent and len(events) < _AT_ONCE:
            if isinstance(sent[0], Received):
                if room <= 0:
                    break
                room -= _size(sent[0].data)
            events.append(sent.popleft())
        return events

    def hang_up(self, code: int) -> None:
        """The driver's end finds itself closed."""
        if self.driver.is_open:
            self.driver.close()

    def write(self, frame: WireFrame) -> bool:
        """Hand the frame to the driver's end."""
        if not self.has_reader or len(self.driver.unread) >= MAX_UNREAD_FRAMES:
            return False
        self.driver.unread.append(frame)
        return True

    @property
    def has_reader(self) -> bool:
        """Whether both ends are open."""
        return self._open and self.driver.is_open

    @property
    def setting(self) -> SerialSetting | None:
        """What the driver's end has set; the rest is open."""
        return self.driver.setting


def _size(data: WireFrame) -> int:
    return len(data) if isinstance(data, bytes) else len(data.data)
