"""Timers with file descriptors (Linux timerfd): they wake a thread that waits for several descriptors at once."""

from __future__ import annotations

import contextlib
import ctypes
import os
import time

_ABSOLUTE = 1
"""``TFD_TIMER_ABSTIME``."""
_NS_PER_S = 1_000_000_000


class _TimerValue(ctypes.Structure):
    """``struct itimerspec``: the period, and the time of the first expiry, each in s and ns."""

    _fields_ = tuple((name, ctypes.c_long) for name in ("every_s", "every_ns", "first_s", "first_ns"))


def _libc() -> ctypes.PyDLL:
    """Return the C library, whose functions are called without giving up the interpreter: they take a microsecond, and
    getting the interpreter back from another thread takes a hundred."""
    libc = ctypes.PyDLL(None, use_errno=True)
    libc.timerfd_settime.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    return libc


class _Timer:
    """A timer of the machine's monotonic clock; its ``fileno`` is readable once it has expired.

    Raises:
        OSError: the kernel has no timerfd, or no file descriptor is left.
    """

    fileno = -1

    def __init__(self):
        libc = _libc()
        self._set_time = libc.timerfd_settime
        self._value = _TimerValue()
        self._address = ctypes.addressof(self._value)
        self.fileno = libc.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self.fileno < 0:
            self._fail()

    def _set(self, flags: int) -> None:
        """Start the timer with the present value, and forget an earlier expiry."""
        if self._set_time(self.fileno, flags, self._address, None):
            self._fail()

    def _fail(self) -> None:
        error = ctypes.get_errno()
        self.close()
        raise OSError(error, os.strerror(error))

    def close(self) -> None:
        """Release the file descriptor; safe to call twice."""
        if self.fileno >= 0:
            os.close(self.fileno)
            self.fileno = -1


class DeadlineTimer(_Timer):
    """A timer that expires at absolute times, exactly: the kernel adds no slack, as it does to a timeout."""

    def __del__(self):
        self.close()

    def set_ns(self, t_ns: int) -> None:
        """Expire at ``t_ns`` of the machine's monotonic clock, and at no earlier deadline."""
        self._value.first_s, self._value.first_ns = divmod(t_ns, _NS_PER_S)
        self._set(_ABSOLUTE)


class PeriodicTimer(_Timer):
    """A timer whose ``fileno`` is readable once each period, until :meth:`acknowledge`.

    Args:
        period_ns: the period [ns].

    Raises:
        OSError: the kernel has no timerfd, or no file descriptor is left.
    """

    def __init__(self, period_ns: int):
        super().__init__()
        value = self._value
        value.every_s, value.every_ns = value.first_s, value.first_ns = divmod(period_ns, _NS_PER_S)
        self._set(0)

    def acknowledge(self) -> bool:
        """Return True if the timer has expired since the last call. Never blocks."""
        with contextlib.suppress(BlockingIOError):
            return len(os.read(self.fileno, 8)) == 8
        return False
