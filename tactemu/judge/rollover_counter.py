"""Counters and clocks on the wire that roll over: set close to the end of their range, and watched."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from tactemu.judge.driver_rig import DriverRig

MAX_JUMP_DIVISOR = 4
"""A jump, and the rollover itself, spans at most 1 / this of the range: a driver that compares numbers modulo the range
takes a longer jump for one backwards."""
NUMBERS_PER_JUMP = 3
"""Numbers that pass between two jumps, so that the driver receives each."""
JUMP_TIMEOUT_S = 2.0
"""Time within which these numbers must pass [s]."""
MIN_AHEAD_S = 0.05
"""Least time to the end of the range at which a trial may begin [s]."""
SPEED_READS = 20
"""Number of reads of a counter by which its speed is measured."""
READ_PERIOD_S = 0.008
"""Time between two reads of a counter [s]."""


class RolloverCounter:
    """A settable counter or clock, on every skin that has it; the first skin's is watched.

    Args:
        rig: with the devices.
        name: of the counter, as the devices declare it.
        sleep: called with a time to wait [s]; it may raise if no time is left.
    """

    def __init__(self, rig: DriverRig, name: str, sleep: Callable[[float], object] = time.sleep):
        self.rig, self.name, self._sleep = rig, name, sleep
        self._all = [
            (channel, each)
            for channel in rig.emulator.channels
            for each in channel.device.rollovers
            if each.name == name and each.state
        ]
        self.size = 1 << self._all[0][1].bits
        self.jumps = 0
        """Number of jumps that :meth:`bring_near` has made."""

    @property
    def value(self) -> int:
        """The present number on the wire."""
        channel, rollover = self._all[0]
        return (getattr(channel.device, rollover.state) + self._elapsed(channel, rollover)) % self.size

    def _elapsed(self, channel: Any, rollover: Any) -> int:
        """Return the ticks that a clock has added to its preset value; 0 for a counter."""
        elapsed_ns = channel.local_ns(self.rig.emulator.now_ns) if rollover.clock else 0
        return elapsed_ns * rollover.step // 1_000_000_000

    def set(self, value: int) -> None:
        """Set the counter of every skin to a value."""

        def act() -> None:
            for channel, rollover in self._all:
                channel.device.preset(self.name, (value - self._elapsed(channel, rollover)) % self.size)

        self.rig.do(act)

    def set_ahead(self, seconds: float) -> None:
        """Set it to roll over after some seconds, at its declared speed, before a driver is connected."""
        rollover = self._all[0][1]
        turns = seconds if rollover.clock else seconds / max(1e-4, self.rig.period_s)
        self.set(-round(turns * max(1, rollover.step)))

    def speed(self) -> float:
        """Return the measured speed of the counter [1/s]."""
        began, last, passed = time.monotonic(), self.value, 0
        for _ in range(SPEED_READS):
            self._sleep(READ_PERIOD_S)
            now = self.value
            passed, last = passed + (now - last) % self.size, now
        return passed / (time.monotonic() - began)

    def bring_near(self, seconds: float, latest_s: float) -> str:
        """Bring it to some seconds before its rollover, unless that is due soon; return why this fails, "" if not.

        The counter only goes forward, in jumps that look like missing numbers to a driver.
        """
        speed = self.speed()
        ahead = min(max(1, round(seconds * speed)), self.size // 2)
        if speed and MIN_AHEAD_S * speed < self.size - self.value <= latest_s * speed:
            return ""
        counts = bool(speed) and self._passes(lambda: self.size - self.value >= ahead, seconds)
        while counts and (left := self.size - self.value - ahead) > 0:
            self.jumps += 1
            self.set(self.value + min(left, self.size // MAX_JUMP_DIVISOR))
            start = self.value
            counts = self._passes(lambda start=start: (self.value - start) % self.size >= NUMBERS_PER_JUMP)
        return "" if counts else f"the {self.name} does not advance while the driver reads"

    def _passes(self, reached: Callable[[], bool], seconds: float = 0.0) -> bool:
        """Wait until a condition on the number holds, and return whether it came in time."""
        deadline = time.monotonic() + seconds + JUMP_TIMEOUT_S
        while not reached():
            if time.monotonic() > deadline:
                return False
            self._sleep(READ_PERIOD_S)
        return True

    def wait_until_full(self, goes_on: Callable[[], bool], seconds: float) -> tuple[int, int] | None:
        """Return the numbers before and after the rollover, or None if it did not come.

        A counter that is set back, as by a command of the driver, has not rolled over.
        """
        before, deadline = self.value, time.monotonic() + seconds
        while goes_on() and time.monotonic() < deadline:
            self._sleep(READ_PERIOD_S / 2)
            now = self.value
            if now < before and (now - before) % self.size < self.size // MAX_JUMP_DIVISOR:
                return before, now
            before = now
        return None
