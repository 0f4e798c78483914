"""The latest frames, faults and events of a run, for live views."""

from __future__ import annotations

from collections import deque

from tactemu.truth.entries import BodyPose, Entry, Sample


class Tap:
    """A bounded queue of the latest entries; the oldest are replaced when it is full, and counted.

    The loop puts entries, one other thread takes them.

    Args:
        most: the maximum number of entries.
        device: the device whose entries are kept; ``None``: all. Entries without a device (commands) always are.
    """

    def __init__(self, most: int, device: str | None = None):
        self.device = device
        self._entries: deque[Entry] = deque(maxlen=most)
        self._put = self._taken = 0

    def put(self, entry: Entry) -> None:
        """Add an entry, unless it is a sample, a pose, or of another device."""
        if isinstance(entry, Sample | BodyPose):
            return
        name = entry.device
        if self.device is None or not name or name == self.device or self.device in name.split("+"):
            self._entries.append(entry)
            self._put += 1

    def take(self) -> tuple[list[Entry], int]:
        """Return the entries since the last call, oldest first, and how many of them are missing."""
        found = []
        for _ in range(len(self._entries)):
            found.append(self._entries.popleft())
        put = self._put
        missing = max(0, put - self._taken - len(found) - len(self._entries))
        self._taken = put - len(self._entries)
        return found, missing
