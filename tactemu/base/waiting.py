"""The one wait of every loop: until a deadline, exactly, or until a file descriptor is readable.

The deadline is that of a timerfd, in absolute time: a timeout of ``select`` or ``poll`` is late by the thread's timer
slack (50 µs by default) or by a thousandth of its length, whichever is more, and ``epoll`` rounds it to milliseconds.
"""

from __future__ import annotations

import errno
import os
import select
import threading
import time
from collections.abc import Sequence

from tactemu.base.timer_fd import DeadlineTimer


class Waiter:
    """A timer and the file descriptors of the latest wait; for one thread."""

    def __init__(self):
        self._timer = DeadlineTimer()
        self._filenos: list[int] = []
        self._poll = self._polling()

    def _polling(self) -> select.poll:
        poll = select.poll()
        for fileno in (self._timer.fileno, *self._filenos):
            poll.register(fileno, select.POLLIN)
        return poll

    def wait(self, until_ns: int, filenos: Sequence[int]) -> list[int]:
        """Sleep until a time of the machine's monotonic clock, or until a file descriptor is readable; return those
        that are.

        Raises:
            OSError: a file descriptor is closed.
        """
        if filenos != self._filenos:
            self._filenos = list(filenos)
            self._poll = self._polling()
        self._timer.set_ns(until_ns)
        timer = self._timer.fileno
        readable = []
        for fileno, event in self._poll.poll():
            if event & select.POLLNVAL:
                raise OSError(errno.EBADF, os.strerror(errno.EBADF))
            if fileno != timer:
                readable.append(fileno)
        return readable


_threads = threading.local()
"""The waiter of each thread: it is gone when the thread ends."""


def wait_until(until_ns: int, filenos: Sequence[int]) -> list[int] | None:
    """Sleep until a time of the machine's monotonic clock, or until a file descriptor is readable; return those that
    are. For a time that has passed, return None at once, without a look at the descriptors.

    Raises:
        OSError: a file descriptor is closed, or the kernel has no timer left.
    """
    if until_ns <= time.monotonic_ns():
        return None
    waiter = getattr(_threads, "waiter", None)
    if waiter is None:
        waiter = _threads.waiter = Waiter()
    return waiter.wait(until_ns, filenos)


def _forget() -> None:
    """Give a forked process a timer of its own: that of its parent would wake its parent."""
    _threads.__dict__.clear()


os.register_at_fork(after_in_child=_forget)
