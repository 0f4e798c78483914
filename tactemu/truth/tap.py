"""The latest frames, faults and events of a run, for somebody who watches it as it goes on."""

from __future__ import annotations

from collections import deque

from tactemu.truth.entries import BodyPose, Entry, Sample


class Tap:
    """Keeps the latest entries until they are taken; what is not taken in time is replaced, and counted.

    The loop puts, one other thread takes.

    Args:
        most: how many are kept.
        device: whose; ``None``: everybody's. What befalls nobody in particular, such as commands, is always kept.
    """

    def __init__(self, most: int, device: str | None = None):
        self.device = device
        self._entries: deque[Entry] = deque(maxlen=most)
        self._put = self._taken = 0

    def put(self, entry: Entry) -> None:
        """One that happened."""
        if isinstance(entry, Sample | BodyPose):
            return
        name = entry.device
        if self.device is None or not name or name == self.device or self.device in name.split("+"):
            self._entries.append(entry)
            self._put += 1

    def take(self) -> tuple[list[Entry], int]:
        """Those since the last time, oldest first, and how many of them are missing."""
        found = []
        for _ in range(len(self._entries)):
            found.append(self._entries.popleft())
        put = self._put
        missing = max(0, put - self._taken - len(found) - len(self._entries))
        self._taken = put - len(self._entries)
        return found, missing
