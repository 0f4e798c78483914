"""Time for the emulator: integer nanoseconds since the start, from one clock. Deadlines are absolute."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from typing import Protocol

POLL_NS = 1_000_000
"""How often a port without a file descriptor is looked at."""


class Clock(Protocol):
    """What the loop asks of time."""

    virtual: bool

    @property
    def origin_ns(self) -> int | None:
        """The machine's monotonic clock when this one showed 0; ``None`` where time is virtual."""
        ...

    def start(self) -> None:
        """The emulator opens: time begins."""
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

    def __init__(self):
        self.origin_ns = time.monotonic_ns()

    def start(self) -> None:
        """Count from now."""
        self.origin_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Nanoseconds since the clock was made, or started."""
        return time.monotonic_ns() - self.origin_ns

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Sleep in ``select``, whose timeout has microsecond steps (``epoll`` would round to milliseconds)."""
        now = self.now_ns()
        until = now + 100_000_000 if deadline_ns is None else deadline_ns
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

    def start(self) -> None:
        """It stands where it was set."""

    def now_ns(self) -> int:
        """The deadline that was waited for last."""
        return self._now

    def wait(self, deadline_ns: int | None, filenos: Sequence[int], *, poll: bool = False) -> None:
        """Jump to the deadline."""
        if deadline_ns is not None:
            self._now = max(self._now, deadline_ns)
