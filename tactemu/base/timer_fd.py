"""A timer with a file descriptor (Linux timerfd), to wake a loop that waits in ``select``."""

from __future__ import annotations

import contextlib
import ctypes
import os
import time


class _Interval(ctypes.Structure):
    """``struct itimerspec``: the period, and the time to the first expiry, each in s and ns."""

    _fields_ = tuple((name, ctypes.c_long) for name in ("every_s", "every_ns", "first_s", "first_ns"))


class PeriodicTimer:
    """A timer whose ``fileno`` is readable once each period, until :meth:`acknowledge`.

    Args:
        period_ns: the period [ns].

    Raises:
        OSError: the kernel has no timerfd, or no file descriptor is left.
    """

    def __init__(self, period_ns: int):
        libc = ctypes.CDLL(None, use_errno=True)
        self.fileno = libc.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        s, ns = divmod(period_ns, 1_000_000_000)
        if self.fileno < 0 or libc.timerfd_settime(self.fileno, 0, ctypes.byref(_Interval(s, ns, s, ns)), None):
            error = ctypes.get_errno()
            self.close()
            raise OSError(error, os.strerror(error))

    def acknowledge(self) -> bool:
        """Return True if the timer has expired since the last call. Never blocks."""
        with contextlib.suppress(BlockingIOError):
            return len(os.read(self.fileno, 8)) == 8
        return False

    def close(self) -> None:
        """Release the file descriptor; safe to call twice."""
        if self.fileno >= 0:
            os.close(self.fileno)
            self.fileno = -1
