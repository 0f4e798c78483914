"""A distance over time, and the checks that the basic motions share."""

from __future__ import annotations

import bisect
import math

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.base.options import number
from tactemu.base.units import LENGTH_UNIT, MAX_TIME_S, MAX_TRAVEL_M, SPEED_RANGE_M_S
from tactemu.geometry.motion.pose import Motion


class DistanceProfile:
    """A distance over time, linear between knots and repeated, with its exact value and slope."""

    def __init__(self, knots: list[tuple[float, float]], repeat: int | None, delay: float):
        """Build the profile from ``knots``: pairs (time since the knot before [s], distance [m])."""
        self.times = [0.0]
        self.values = [knots[0][1]]
        for span, value in knots[1:]:
            if span > 0:
                self.times.append(self.times[-1] + span)
                self.values.append(value)
        self.delay = delay
        self.period = self.times[-1]
        self.repeat = repeat if repeat else math.inf
        self.duration = delay + self.period * self.repeat if self.period else delay

    def at(self, t_s: float) -> tuple[float, float]:
        """Return the distance [m] and the speed [m/s] at ``t_s``."""
        if t_s < self.delay:
            return self.values[0], 0.0
        if t_s >= self.duration:
            return self.values[-1], 0.0
        t = (t_s - self.delay) % self.period
        k = bisect.bisect_right(self.times, t) - 1
        slope = (self.values[k + 1] - self.values[k]) / (self.times[k + 1] - self.times[k])
        return self.values[k] + slope * (t - self.times[k]), slope


def travel_profile(distance: float, speed: float, repeat: int | None, delay: float) -> DistanceProfile:
    """Return the profile of a travel that is made once, or there and back ``repeat`` times (``None``: for ever)."""
    there = [(0.0, 0.0), (distance / speed, distance)]
    return DistanceProfile(there if repeat == 1 else [*there, (distance / speed, 0.0)], repeat, delay)


def unit_vector(vector) -> np.ndarray:
    """Return the unit vector along ``vector``."""
    v = np.asarray(vector, np.float64)
    return v / math.sqrt(float(v @ v))


def check_direction(motion: Motion, name: str) -> None:
    """Raise :class:`SceneError` if a field is no direction."""
    v = np.asarray(getattr(motion, name), float)
    if v.shape != (3,) or not np.all(np.isfinite(v)) or not np.any(np.abs(v) > 1e-6) or np.any(np.abs(v) > 1e6):
        raise SceneError(
            f"{motion.kind}.{name}: expected three finite numbers, not all of them near zero, "
            f"got {getattr(motion, name)}"
        )


def check_times(motion: Motion, *names: str) -> None:
    """Raise :class:`SceneError` if a field is no time from 0 to :data:`MAX_TIME_S`; ``None`` is accepted."""
    for name in names:
        if getattr(motion, name) is not None:
            number(motion.kind, name, getattr(motion, name), at_least=0, at_most=MAX_TIME_S, unit="s")


def check_distances(motion: Motion, *names: str) -> None:
    """Raise :class:`SceneError` if a field is no distance from 0 to :data:`MAX_TRAVEL_M`."""
    for name in names:
        number(motion.kind, name, getattr(motion, name), at_least=0, at_most=MAX_TRAVEL_M, unit=LENGTH_UNIT)


def check_speeds(motion: Motion, *names: str) -> None:
    """Raise :class:`SceneError` if a field is no speed within :data:`SPEED_RANGE_M_S`; ``None`` is accepted."""
    for name in names:
        if getattr(motion, name) is not None:
            least, most = SPEED_RANGE_M_S
            number(motion.kind, name, getattr(motion, name), at_least=least, at_most=most, unit="m/s")


def check_repeat(motion: Motion, name: str = "repeat") -> None:
    """Raise :class:`SceneError` if a field is no count; ``None`` is accepted."""
    if getattr(motion, name) is not None:
        number(motion.kind, name, getattr(motion, name), at_least=0, at_most=1e9, integer=True)
