"""Counters and clocks on the wire that begin anew when they are full: set shortly before, and watched."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from tactemu.judge.driver_rig import DriverRig

TURN_PARTS = 4
"""A jump, and the way over the end, spans at most this part of the range: a driver that compares numbers modulo the
range takes a longer way for one backwards."""
NUMBERS_PER_JUMP = 3
"""Numbers that pass between two jumps, so that the driver sees each."""
JUMP_TIMEOUT_S = 2.0
SOONEST_S = 0.05
"""Time to the end of the range that suffices for a trial to begin [s]."""
SPEED_LOOKS, LOOK_S = 20, 0.008
"""Looks at a counter, and the time between them, by which its speed is measured."""


class RolloverCounter:
    """A counter or clock that can be set, on every skin that has it; the first skin's is watched.

    Args:
        rig: where the devices are.
        name: the counter's, as the devices declare it.
        sleep: waits some seconds, or raises where no time is left.
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
        """Jumps that :meth:`bring_near` has made."""

    @property
    def value(self) -> int:
        """The number on the wire now."""
        channel, rollover = self._all[0]
        return (getattr(channel.device, rollover.state) + self._elapsed(channel, rollover)) % self.size

    def _elapsed(self, channel: Any, rollover: Any) -> int:
        """Return what a clock adds by itself to the attribute that sets it."""
        elapsed_ns = channel.local_ns(self.rig.emulator.now_ns) if rollover.clock else 0
        return elapsed_ns * rollover.step // 1_000_000_000

    def set(self, value: int) -> None:
        """Go on from this number."""

        def act() -> None:
            for channel, rollover in self._all:
                channel.device.preset(self.name, (value - self._elapsed(channel, rollover)) % self.size)

        self.rig.do(act)

    def set_ahead(self, seconds: float) -> None:
        """Let it be full after some seconds, by its declared speed: no driver has it count yet."""
        rollover = self._all[0][1]
        turns = seconds if rollover.clock else seconds / max(1e-4, self.rig.period_s)
        self.set(-round(turns * max(1, rollover.step)))

    def speed(self) -> float:
        """Return how many numbers pass in a second."""
        began, last, passed = time.monotonic(), self.value, 0
        for _ in range(SPEED_LOOKS):
            self._sleep(LOOK_S)
            now = self.value
            passed, last = passed + (now - last) % self.size, now
        return passed / (time.monotonic() - began)

    def bring_near(self, seconds: float, latest_s: float) -> str:
        """Let it be full in some seconds, unless it soon will be by itself; returns why it cannot.

        It only goes forward, in jumps that a driver which looks for missing numbers takes for those.
        """
        speed = self.speed()
        ahead = min(max(1, round(seconds * speed)), self.size // 2)
        if speed and SOONEST_S * speed < self.size - self.value <= latest_s * speed:
            return ""
        counts = bool(speed) and self._passes(lambda: self.size - self.value >= ahead, seconds)
        while counts and (left := self.size - self.value - ahead) > 0:
            self.jumps += 1
            self.set(self.value + min(left, self.size // TURN_PARTS))
            start = self.value
            counts = self._passes(lambda start=start: (self.value - start) % self.size >= NUMBERS_PER_JUMP)
        return "" if counts else f"the {self.name} stands still while the driver reads"

    def _passes(self, reached: Callable[[], bool], seconds: float = 0.0) -> bool:
        """Wait for a number; returns whether it came."""
        deadline = time.monotonic() + seconds + JUMP_TIMEOUT_S
        while not reached():
            if time.monotonic() > deadline:
                return False
            self._sleep(LOOK_S)
        return True

    def wait_until_full(self, goes_on: Callable[[], bool], seconds: float) -> tuple[int, int] | None:
        """Return the numbers before and after the end of its range; ``None`` if it did not get there.

        A counter that is set back, as by a command of the driver, has not been full.
        """
        before, deadline = self.value, time.monotonic() + seconds
        while goes_on() and time.monotonic() < deadline:
            self._sleep(LOOK_S / 2)
            now = self.value
            if now < before and (now - before) % self.size < self.size // TURN_PARTS:
                return before, now
            before = now
        return None
