"""Time for the emulator: integer nanoseconds since the start, from one clock. Deadlines are absolute."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from typing import Protocol

POLL_NS = 1_000_000
"""How often a port without a file descriptor is looked at."""
_LOOK_S = 0.1
"""How long a wait for nothing in particular takes at most."""

_LATE_NS = 20_000_000
"""A paced clock that is later than this does not hurry to catch up."""


class Clock(Protocol):
    """What the loop asks of time."""

    virtual: bool

    @property
    def origin_ns(self) -> int | None:
        """The machine's monotonic clock when this one showed 0; ``None`` where time is virtual."""
        ...

    @property
    def end_ns(self) -> int | None:
        """Where time stops until somebody lets it go on; ``None``: nowhere."""
        ...

    def is_paused(self) -> bool:
        """Whether it has stopped there."""
        ...

    def start(self) -> None:
        """The emulator opens: time begins."""
        ...

    def set_ns(self, t_ns: int) -> None:
        """Go on from this time: a saved run does."""
        ...

    def now_ns(self) -> int:
        """Nanoseconds since the start."""
        ...

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Return at the deadline, or earlier when a file descriptor is readable.

        ``poll`` says that some port has no file descriptor and must be looked at every :data:`POLL_NS`.
        """
        ...


class RealClock:
    """The machine's monotonic clock."""

    virtual = False
    end_ns = None

    def __init__(self):
        self.origin_ns = time.monotonic_ns()

    def start(self) -> None:
        """Count from now."""
        self.origin_ns = time.monotonic_ns()

    def set_ns(self, t_ns: int) -> None:
        """Go on from this time."""
        self.origin_ns = time.monotonic_ns() - t_ns

    def is_paused(self) -> bool:
        """Never."""
        return False

    def now_ns(self) -> int:
        """Nanoseconds since the clock was made, or started."""
        return time.monotonic_ns() - self.origin_ns

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Sleep in ``select``, whose timeout has microsecond steps (``epoll`` would round to milliseconds)."""
        now = self.now_ns()
        until = now + round(_LOOK_S * 1e9) if deadline_ns is None else deadline_ns
        if poll:
            until = min(until, now + POLL_NS)
        if until > now:
            select.select(filenos, (), (), (until - now) / 1e9)


class VirtualClock:
    """A clock that jumps: a wait takes no time, so the loop runs as fast as it can and always the same way."""

    virtual = True
    origin_ns = None

    def __init__(self, start_ns: int = 0):
        self._now = start_ns

    @property
    def end_ns(self) -> int | None:
        """None: it goes on for ever."""
        return None

    def start(self) -> None:
        """It stands where it was set."""

    def set_ns(self, t_ns: int) -> None:
        """Go on from this time."""
        self._now = t_ns

    def is_paused(self) -> bool:
        """Never."""
        return False

    def now_ns(self) -> int:
        """Return the deadline that was waited for last."""
        return self._now

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Jump to the deadline."""
        if deadline_ns is not None:
            self._now = max(self._now, deadline_ns)


class PacedClock(VirtualClock):
    """A virtual clock at the pace of the machine's: no sample is missed, and a machine that is late makes time slower.

    Each turn of the loop has a time of its own, so that a run with a driver can be done again in virtual time from
    what the driver sent and when.
    """

    def __init__(self, start_ns: int = 0):
        super().__init__(start_ns)
        self._origin = time.monotonic_ns() - start_ns

    @property
    def end_ns(self) -> int:
        """Now: what comes next is not known, so nothing is computed ahead of it."""
        return self._now

    def start(self) -> None:
        """Keep pace from now on."""
        self._origin = time.monotonic_ns() - self._now

    def set_ns(self, t_ns: int) -> None:
        """Go on from this time."""
        super().set_ns(t_ns)
        self.start()

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Sleep until the deadline, at which it then is, or earlier until a file descriptor is readable."""
        before = self._now
        real = time.monotonic_ns() - self._origin
        until = max(real, before) + round(_LOOK_S * 1e9) if deadline_ns is None else max(deadline_ns, before + 1)
        if poll:
            until = min(until, max(real, before) + POLL_NS)
        ready = until > real and select.select(filenos, (), (), (until - real) / 1e9)[0]
        real = time.monotonic_ns() - self._origin
        self._now = max(before + 1, min(real, until)) if ready else until
        if real - self._now > _LATE_NS:
            self._origin += real - self._now - _LATE_NS


class LockstepClock(VirtualClock):
    """A virtual clock that goes as far as it is let, and there waits for whoever lets it go on.

    Call :meth:`go_on` in the loop's thread.
    """

    def __init__(self, start_ns: int = 0):
        super().__init__(start_ns)
        self._end = start_ns
        self._is_paused = False

    def set_ns(self, t_ns: int) -> None:
        """Stand at this time."""
        super().set_ns(t_ns)
        self._end, self._is_paused = t_ns, False

    @property
    def end_ns(self) -> int:
        """As far as it was let."""
        return self._end

    def is_paused(self) -> bool:
        """Whether it has come there, and all that was due has been done."""
        return self._is_paused

    def go_on(self, until_ns: int) -> None:
        """Let time pass until ``until_ns``; it is never turned back."""
        self._end = max(self._end, until_ns)
        self._is_paused = self._is_paused and self._now >= self._end

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Jump to the deadline, no farther than time was let; there wait for a file descriptor."""
        if deadline_ns is not None and deadline_ns <= self._now:
            return
        if self._now < self._end:
            super().wait(self._end if deadline_ns is None else min(deadline_ns, self._end), filenos)
            return
        if self._is_paused:
            select.select(filenos, (), (), POLL_NS / 1e9 if poll else _LOOK_S)
        self._is_paused = True
