"""Time for the emulator: integer nanoseconds since the start, from one clock. Deadlines are absolute."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Protocol

from tactemu.base.waiting import wait_until

POLL_NS = 1_000_000
"""Period at which a port without a file descriptor is polled."""
_MAX_IDLE_WAIT_NS = 100_000_000
"""Longest wait without a deadline."""

_MAX_PACE_LAG_NS = 20_000_000
"""Longest lag that a paced clock makes up; beyond it, emulation time runs slower than real time."""


class Clock(Protocol):
    """The clock of a loop."""

    virtual: bool
    follows_real_time: bool
    """True if a late machine delays what is due, or slows time down."""

    @property
    def origin_ns(self) -> int | None:
        """Time of the machine's monotonic clock when this one showed 0; ``None`` where time is virtual."""
        ...

    @property
    def end_ns(self) -> int | None:
        """The time at which the clock pauses; ``None``: it never does."""
        ...

    def is_paused(self) -> bool:
        """Return True if the clock has reached :attr:`end_ns` and everything due by then is done."""
        ...

    def start(self) -> None:
        """Start the clock when the emulator opens."""
        ...

    def set_ns(self, t_ns: int) -> None:
        """Continue from this time, as a restored run does."""
        ...

    def now_ns(self) -> int:
        """Return the time since the start [ns]."""
        ...

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> Sequence[int] | None:
        """Return at the deadline, or earlier when a file descriptor is readable, with those that are; None: unknown.

        With ``poll`` it returns after :data:`POLL_NS` at the latest, for a port without a file descriptor.
        """
        ...


class RealClock:
    """A clock that follows the machine's monotonic clock."""

    virtual = False
    follows_real_time = True
    end_ns = None

    def __init__(self):
        self.origin_ns = time.monotonic_ns()

    def start(self) -> None:
        """Count from now."""
        self.origin_ns = time.monotonic_ns()

    def set_ns(self, t_ns: int) -> None:
        """Continue from this time."""
        self.origin_ns = time.monotonic_ns() - t_ns

    def is_paused(self) -> bool:
        """Return False: real time never pauses."""
        return False

    def now_ns(self) -> int:
        """Return the time since the clock was made, or started [ns]."""
        return time.monotonic_ns() - self.origin_ns

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> Sequence[int] | None:
        """Sleep until then."""
        if deadline_ns is None or poll:
            latest = self.now_ns() + (POLL_NS if poll else _MAX_IDLE_WAIT_NS)
            deadline_ns = latest if deadline_ns is None else min(deadline_ns, latest)
        return wait_until(self.origin_ns + deadline_ns, filenos)


class VirtualClock:
    """A clock that jumps: a wait takes no time, so the loop runs as fast as it can and always the same way."""

    virtual = True
    follows_real_time = False
    origin_ns = None

    def __init__(self, start_ns: int = 0):
        self._now = start_ns

    @property
    def end_ns(self) -> int | None:
        """Always ``None``: the clock never pauses."""
        return None

    def start(self) -> None:
        """Do nothing: the clock stays at the time to which it was set."""

    def set_ns(self, t_ns: int) -> None:
        """Continue from this time."""
        self._now = t_ns

    def is_paused(self) -> bool:
        """Return False: the clock never pauses."""
        return False

    def now_ns(self) -> int:
        """Return the latest deadline that was waited for."""
        return self._now

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Jump to the deadline."""
        if deadline_ns is not None:
            self._now = max(self._now, deadline_ns)


class PacedClock(VirtualClock):
    """A virtual clock at real-time pace: no sample is missed, and time runs slower on a machine that is late.

    Each turn of the loop has a time of its own, so that a run with a driver can be repeated in virtual time from the
    driver's bytes and their times.
    """

    follows_real_time = True

    def __init__(self, start_ns: int = 0):
        super().__init__(start_ns)
        self._origin = time.monotonic_ns() - start_ns

    @property
    def end_ns(self) -> int:
        """The present time: a driver may send at any moment, so nothing is computed ahead."""
        return self._now

    def start(self) -> None:
        """Keep pace with real time from now on."""
        self._origin = time.monotonic_ns() - self._now

    def set_ns(self, t_ns: int) -> None:
        """Continue from this time."""
        super().set_ns(t_ns)
        self.start()

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Sleep until the deadline, or until a file descriptor is readable; set the time to that moment."""
        before = self._now
        real = time.monotonic_ns() - self._origin
        until = max(real, before) + _MAX_IDLE_WAIT_NS if deadline_ns is None else max(deadline_ns, before + 1)
        if poll:
            until = min(until, max(real, before) + POLL_NS)
        ready = wait_until(self._origin + until, filenos)
        real = time.monotonic_ns() - self._origin
        self._now = max(before + 1, min(real, until)) if ready else until
        if real - self._now > _MAX_PACE_LAG_NS:
            self._origin += real - self._now - _MAX_PACE_LAG_NS


class LockstepClock(VirtualClock):
    """A virtual clock that pauses at a time that its controller sets, until the controller sets a later one.

    Call :meth:`go_on` in the loop's thread.
    """

    def __init__(self, start_ns: int = 0):
        super().__init__(start_ns)
        self._end = start_ns
        self._is_paused = False

    def set_ns(self, t_ns: int) -> None:
        """Pause at this time."""
        super().set_ns(t_ns)
        self._end, self._is_paused = t_ns, False

    @property
    def end_ns(self) -> int:
        """The time at which the clock pauses."""
        return self._end

    def is_paused(self) -> bool:
        """Return True if the clock has reached :attr:`end_ns` and everything due by then is done."""
        return self._is_paused

    def go_on(self, until_ns: int) -> None:
        """Advance the time at which the clock pauses to ``until_ns``; an earlier time changes nothing."""
        self._end = max(self._end, until_ns)
        self._is_paused = self._is_paused and self._now >= self._end

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Jump to the deadline, at most to :attr:`end_ns`; there wait for a file descriptor."""
        if deadline_ns is not None and deadline_ns <= self._now:
            return
        if self._now < self._end:
            super().wait(self._end if deadline_ns is None else min(deadline_ns, self._end), filenos)
            return
        if self._is_paused:
            wait_until(time.monotonic_ns() + (POLL_NS if poll else _MAX_IDLE_WAIT_NS), filenos)
        self._is_paused = True
