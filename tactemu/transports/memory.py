"""``memory:``: a port inside this process without a file descriptor, for tests and for runs without a driver."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

from firmware_protocols import WireFrame
from firmware_protocols.can_frames import CanFrames
from firmware_protocols.frames import payload
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
"""Maximum number of frames that a driver leaves unread; further ones are dropped."""
MAX_WAITING_CHUNKS = 2048
"""Maximum number of chunks and frames of a driver that wait for the device's end."""
_MAX_EVENTS_PER_POLL = 64
"""Maximum number of events that one poll takes."""


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
        """Close the port; unread frames are lost."""
        self.is_open = False
        self.unread.clear()
        self.sent += (Closed(), DROPPED)

    def write(self, data: WireFrame) -> bool:
        """Send bytes, or one CAN frame; ``False`` when too much waits for the device's end already."""
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
        """Return all that the device has sent since the last call, frame by frame."""
        frames = list(self.unread)
        self.unread.clear()
        return frames

    def set_serial(self, **entries: Any) -> None:
        """Set ``baud``, ``bytesize``, ``parity`` or ``stopbits`` of the driver's end."""
        self.setting = replace(self.setting, **entries)
        self.sent.append(SettingChanged(self.setting))

    def set_lines(self, *, dtr: bool, rts: bool) -> None:
        """Set the modem lines."""
        self.sent.append(LinesChanged(dtr, rts))


class MemoryTransport(Transport):
    """A port in memory, for any wire; the driver's end is :attr:`driver`, open from the start."""

    scheme = "memory"

    def __init__(self, location: str = ""):
        self.address = f"memory:{location}"
        self.driver = DriverEnd()
        self._open = False

    def open(self) -> None:
        """Make the port; a driver whose end is open is connected at once."""
        if not self._open:
            self._open = True
            if self.driver.is_open:
                self.driver.sent += (Opened(), RAISED)

    def close(self) -> None:
        """Remove the port."""
        self._open = False
        self.driver.sent.clear()

    def filenos(self, reading: bool = True) -> list[int]:
        """Return no file descriptors: the port lives in this process."""
        return []

    def poll(self, reading: bool = True) -> list[Event]:
        """Return what the driver's end did; data only if ``reading``."""
        events: list[Event] = []
        sent, room = self.driver.sent, MAX_CHUNK_BYTES if reading else 0
        while sent and len(events) < _MAX_EVENTS_PER_POLL:
            if isinstance(sent[0], Received):
                if room <= 0:
                    break
                room -= len(payload(sent[0].data))
            events.append(sent.popleft())
        return events

    def hang_up(self, code: int) -> None:
        """Close the driver's end."""
        if self.driver.is_open:
            self.driver.close()

    def write(self, frame: WireFrame) -> bool:
        """Pass the frame to the driver's end; ``False`` when that is closed or has too much unread."""
        driver = self.driver
        if not (self._open and driver.is_open) or len(driver.unread) >= MAX_UNREAD_FRAMES:
            return False
        driver.unread.append(frame)
        return True

    def write_all(self, frames: CanFrames) -> int:
        """Pass frames to the driver's end until it is closed or has too much unread, and return how many were."""
        room = MAX_UNREAD_FRAMES - len(self.driver.unread) if self.has_reader else 0
        self.driver.unread.extend(frames[:room])
        return min(room, len(frames))

    @property
    def has_reader(self) -> bool:
        """True while both ends are open."""
        return self._open and self.driver.is_open

    @property
    def setting(self) -> SerialSetting | None:
        """The settings that the driver's end has chosen; others are ``None``."""
        return self.driver.setting
