"""What is to be done when: actions in the order of their times, equal times in the order in which they were put."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator

Action = Callable[[], None]


class Agenda:
    """A queue of actions by time [ns]."""

    def __init__(self):
        self._entries: list[tuple[int, int, Action]] = []
        self._number = 0

    def put(self, t_ns: int, action: Action) -> None:
        """Have ``action`` done at ``t_ns``."""
        self._number += 1
        heapq.heappush(self._entries, (t_ns, self._number, action))

    def due(self, now_ns: int) -> Iterator[Action]:
        """Take out what is due by now, those put meanwhile included."""
        while self._entries and self._entries[0][0] <= now_ns:
            yield heapq.heappop(self._entries)[2]

    @property
    def next_ns(self) -> int | None:
        """The next time, ``None`` when nothing is to be done."""
        return self._entries[0][0] if self._entries else None
