"""Calls into a loop from any thread: they wake the loop, which runs them between two turns."""

from __future__ import annotations

import contextlib
import os
import queue
import threading

from tactemu.base.agenda import Agenda, ScheduledCallback


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
