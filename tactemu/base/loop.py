"""The loop under emulator, replay and proxy: turns on one clock, a queue of actions by time, calls from other threads.

Actions of equal times keep the order in which they were put.
The loop's own actions are plain data, :class:`Action`, so that a run is saved together with its pending actions.
Callers may put any function; functions are not saved, and a caller puts them again after a restore.
"""

from __future__ import annotations

import contextlib
import heapq
import os
import queue
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from tactemu.base.clock import Clock
from tactemu.base.low_latency import low_latency


class Action(NamedTuple):
    """An action of the loop on one device."""

    name: str
    """A key of :data:`tactemu.emulator.emulator.ACTIONS`."""
    channel: str
    """Name of the device's channel."""
    args: tuple[Any, ...] = ()
    power_cycle: int | None = None
    """Power cycle of the device in which the action is valid; ``None``: in every one."""


ScheduledCallback = Callable[[], object]
"""A function that a caller schedules in the loop."""
Entry = TypeVar("Entry", Action, ScheduledCallback, Action | ScheduledCallback)


class Agenda(Generic[Entry]):
    """A queue of actions by time [ns].

    Args:
        is_valid: returns True for an action of a saved state that the loop can carry out.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()

    def __init__(self, is_valid: Callable[[Action], bool] = lambda action: False):
        self._is_valid = is_valid
        self._entries: list[tuple[int, int, Entry]] = []
        self._number = 0

    def put(self, t_ns: int, action: Entry) -> None:
        """Add ``action`` at ``t_ns``."""
        self._number += 1
        heapq.heappush(self._entries, (t_ns, self._number, action))

    def due(self, now_ns: int) -> Iterator[Entry]:
        """Remove and yield the actions that are due by now, including those put during the iteration."""
        while self._entries and self._entries[0][0] <= now_ns:
            yield heapq.heappop(self._entries)[2]

    def state(self) -> dict[str, Any]:
        """Return the loop's own actions, without the callers' functions."""
        return {"entries": [e for e in self._entries if isinstance(e[2], Action)], "number": self._number}

    def prepare_restore(self, state: dict[str, Any]) -> Callable[[], None]:
        """Return a callable that restores the loop's own actions; the callers' functions stay in the queue.

        Raises:
            ValueError: the state has an action that the loop cannot carry out.
        """
        for t_ns, number, action in state["entries"]:
            is_planned = type(t_ns) is int and type(number) is int and isinstance(action, Action)
            if not (is_planned and self._is_valid(action)):
                raise ValueError(f"cannot do {action!r:.60} at {t_ns!r:.20}")
        callbacks = [entry for entry in self._entries if not isinstance(entry[2], Action)]
        entries = [*state["entries"], *callbacks]
        heapq.heapify(entries)
        attributes = {"_entries": entries, "_number": max(self._number, int(state["number"]))}
        return lambda: vars(self).update(attributes)

    @property
    def next_ns(self) -> int | None:
        """The time of the next action; ``None`` when the queue is empty."""
        return self._entries[0][0] if self._entries else None


class Calls:
    """Callbacks from other threads, each with the earliest time [ns] at which the loop runs it.

    They are no part of the emulated state: a caller waits for a result, replays commands, or stops the loop.
    """

    def __init__(self):
        self._submitted: queue.SimpleQueue[tuple[int, ScheduledCallback]] = queue.SimpleQueue()
        self._later: Agenda[ScheduledCallback] = Agenda()
        self._is_signalled = False
        """True once the event is written, and False before it is read: no signal is lost, and none stays for ever."""
        self._event_fd: int | None = None
        self._lock = threading.RLock()  # a signal handler may interrupt the thread that holds it

    def open(self) -> None:
        """Make the event that wakes the loop."""
        self._event_fd = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)

    def close(self) -> None:
        """Close the event. Safe to call twice."""
        with self._lock:
            event_fd, self._event_fd = self._event_fd, None
        if event_fd is not None:
            os.close(event_fd)

    def put(self, action: ScheduledCallback, at_ns: int = 0) -> None:
        """Submit a callback, and wake the loop. Safe from any thread."""
        self._submitted.put((at_ns, action))
        with self._lock:
            if self._event_fd is not None:
                os.eventfd_write(self._event_fd, 1)
        self._is_signalled = True

    def run(self, now_ns: int) -> None:
        """Run the callbacks that are due, in the order of their times, equal times as they were submitted."""
        if self._is_signalled:
            self._is_signalled = False
            if self._event_fd is not None:
                with contextlib.suppress(BlockingIOError):
                    os.eventfd_read(self._event_fd)
            while not self._submitted.empty():
                self._later.put(*self._submitted.get())
        for action in self._later.due(now_ns):
            action()

    @property
    def next_ns(self) -> int | None:
        """The time of the next callback; ``None`` when there is none."""
        return self._later.next_ns

    @property
    def filenos(self) -> list[int]:
        """The file descriptors that wake a loop in ``select``."""
        return [] if self._event_fd is None else [self._event_fd]


class Readable(Protocol):
    """A port that wakes the loop, such as a wire."""

    def filenos(self) -> list[int]:
        """Return the file descriptors that are readable once data have arrived; none: the loop polls."""
        ...


class Loop(ABC):
    """A loop that runs one turn after the other; a subclass defines its :meth:`step`.

    Args:
        clock: real or virtual.
        ports: the ports whose data end a wait.
    """

    simulation: Any = None
    """The simulation, if there is one."""
    channels: Sequence[Any] = ()
    """The devices."""
    is_settled: bool = True
    """True if everything that is due in this turn has been done."""
    is_finished: bool = False
    """True if nothing is left to do, which ends :meth:`run`."""

    def __init__(self, clock: Clock, ports: Sequence[Readable]):
        self.clock = clock
        self.now_ns = 0
        """Time of the turn, at which everything in it happens."""
        self._ports = ports
        self._calls = Calls()
        self._stop_requested = False
        self._readable: Sequence[int] | None = None
        """The file descriptors that were readable when the last wait ended; ``None``: unknown."""

    @abstractmethod
    def step(self, end_ns: int | None = None) -> None:
        """Run one turn, and wait until the next one, at most until ``end_ns``."""

    def run(self, seconds: float | None = None) -> None:
        """Run for ``seconds`` of the clock's time, or until :meth:`stop`, also if that was called before."""
        end = None if seconds is None else self.clock.now_ns() + round(seconds * 1e9)
        with low_latency() if self.clock.follows_real_time else contextlib.nullcontext():
            self._run(end)

    def _run(self, end: int | None) -> None:
        try:
            while not (self._stop_requested or self.is_finished) and (end is None or self.clock.now_ns() < end):
                self.step(end)
        finally:
            self._stop_requested = False

    def stop(self) -> None:
        """Leave :meth:`run` after the current turn, or the next run at once. Safe from any thread and from a signal
        handler."""
        self._stop_requested = True
        self.call(lambda: None)

    def call(self, action: ScheduledCallback, at_ns: int = 0) -> None:
        """Have ``action`` run by the loop at the end of a turn, not before ``at_ns``. Safe from any thread."""
        self._calls.put(action, at_ns)

    def _wait(self, deadlines: Sequence[int | None]) -> None:
        """Wait until the earliest deadline, or until a port has data or a callback is due."""
        filenos, poll = self._calls.filenos, False
        for port in self._ports:
            own = port.filenos()
            filenos += own
            poll = poll or not own
        self._readable = self.clock.wait(earliest(*deadlines, self._calls.next_ns), filenos, poll=poll)


def earliest(*times_ns: int | None) -> int | None:
    """Return the earliest of these times; ``None`` if there is none."""
    return min([t_ns for t_ns in times_ns if t_ns is not None], default=None)
