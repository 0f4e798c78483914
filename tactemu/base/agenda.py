"""What is to be done when: in the order of the times, equal times in the order in which it was put.

What the loop plans for itself is plain data, an :class:`Action`, so that a run can be saved with what it has before it.
What its callers ask for is any function of theirs, and theirs to ask for again.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar


class Action(NamedTuple):
    """Something that the loop does with one device."""

    name: str
    """Of what the loop can do: :data:`tactemu.emulator.emulator.ACTIONS`."""
    channel: str
    """Name of the device's channel."""
    args: tuple[Any, ...] = ()
    life: int | None = None
    """Not to be done if the device has powered up since; ``None``: whatever became of it."""


ScheduledCallback = Callable[[], object]
"""What a caller has the loop do."""
Entry = TypeVar("Entry", Action, ScheduledCallback, Action | ScheduledCallback)


class Agenda(Generic[Entry]):
    """A queue of what is to be done by time [ns].

    Args:
        knows: whether an action of a saved state can be done.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(self, knows: Callable[[Action], bool] = lambda action: False):
        self._knows = knows
        self._entries: list[tuple[int, int, Entry]] = []
        self._number = 0

    def put(self, t_ns: int, action: Entry) -> None:
        """Have ``action`` done at ``t_ns``."""
        self._number += 1
        heapq.heappush(self._entries, (t_ns, self._number, action))

    def due(self, now_ns: int) -> Iterator[Entry]:
        """Take out what is due by now, those put meanwhile included."""
        while self._entries and self._entries[0][0] <= now_ns:
            yield heapq.heappop(self._entries)[2]

    def state(self) -> dict[str, Any]:
        """What the loop plans for itself; what callers have asked for is not saved with it."""
        return {"entries": [e for e in self._entries if isinstance(e[2], Action)], "number": self._number}

    def prepare_restore(self, state: dict[str, Any]) -> Callable[[], None]:
        """What callers have asked for here stays.

        Raises:
            ValueError: something that the loop cannot do.
        """
        for t_ns, number, action in state["entries"]:
            is_planned = type(t_ns) is int and type(number) is int and isinstance(action, Action)
            if not (is_planned and self._knows(action)):
                raise ValueError(f"cannot do {action!r:.60} at {t_ns!r:.20}")
        guests = [entry for entry in self._entries if not isinstance(entry[2], Action)]
        entries = [*state["entries"], *guests]
        heapq.heapify(entries)
        attributes = {"_entries": entries, "_number": max(self._number, int(state["number"]))}
        return lambda: vars(self).update(attributes)

    @property
    def next_ns(self) -> int | None:
        """The next time, ``None`` when nothing is to be done."""
        return self._entries[0][0] if self._entries else None
