"""What others have a loop do, from any thread: it wakes up for it, and does it between two turns."""

from __future__ import annotations

import contextlib
import os
import queue
import threading

from tactemu.base.agenda import Agenda, ScheduledCallback


class Calls:
    """Actions that were handed in, each with the time [ns] before which it is not done.

    They are no part of what is emulated: somebody waits for something, plays commands again, or stops the loop.
    """

    def __init__(self):
        self._handed_in: queue.SimpleQueue[tuple[int, ScheduledCallback]] = queue.SimpleQueue()
        self._later: Agenda[ScheduledCallback] = Agenda()
        self._rung = False
        """Set after the bell has rung, and taken back before it is silenced: so none is missed, nor rings for ever."""
        self._bell: int | None = None
        self._lock = threading.RLock()  # a signal's handler may come while we hold it

    def open(self) -> None:
        """From now on the loop can be woken."""
        self._bell = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)

    def close(self) -> None:
        """Safe to call twice."""
        with self._lock:
            bell, self._bell = self._bell, None
        if bell is not None:
            os.close(bell)

    def put(self, action: ScheduledCallback, at_ns: int = 0) -> None:
        """Hand an action in. Safe from any thread."""
        self._handed_in.put((at_ns, action))
        with self._lock:
            if self._bell is not None:
                os.eventfd_write(self._bell, 1)
        self._rung = True

    def run(self, now_ns: int) -> None:
        """Do what is due; in the order of the times, equal times as they were handed in."""
        if self._rung:
            self._rung = False
            if self._bell is not None:
                with contextlib.suppress(BlockingIOError):
                    os.eventfd_read(self._bell)
            while not self._handed_in.empty():
                self._later.put(*self._handed_in.get())
        for action in self._later.due(now_ns):
            action()

    @property
    def next_ns(self) -> int | None:
        """When the next one is due; ``None`` when none is known."""
        return self._later.next_ns

    @property
    def filenos(self) -> list[int]:
        """What wakes a loop that sleeps in ``select``."""
        return [] if self._bell is None else [self._bell]
