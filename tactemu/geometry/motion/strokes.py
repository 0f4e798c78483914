"""The basic motions: hold, press, slide, roll, spin; and a distance over time, which most of them follow."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.options import check_declared, number
from tactemu.base.units import (
    LENGTH_UNIT,
    MAX_DEPTH_M,
    DepthAfterTravel,
    Distance,
    MetresPerSecond,
    Radians,
    RadiansPerSecond,
    Radius,
    Repeats,
    Seconds,
)
from tactemu.geometry import rotation
from tactemu.geometry.motion.pose import UNTURNED, ZERO, Motion, Pose, Vector


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


@dataclass(frozen=True, kw_only=True)
class Hold(Motion):
    """A pause: the body stays where it is."""

    kind = "hold"
    seconds: Seconds = math.inf
    """Duration [s], for a pause inside a sequence."""

    def __post_init__(self):
        if self.seconds != math.inf:
            number(self.kind, "seconds", self.seconds, Seconds)

    @property
    def duration(self) -> float:
        return self.seconds

    def pose(self, t_s: float) -> Pose:
        return Pose()


class Travel(Motion):
    """A motion along a line, of which the distance follows a profile over time; not one of a scene file itself.

    A subclass has the fields that the profile needs.
    """

    distance: float
    speed: float
    direction: Vector
    repeat: int | None
    delay: float

    @cached_property
    def _profile(self) -> DistanceProfile:
        """The distance over time: once, or there and back."""
        return travel_profile(self.distance, self.speed, self.repeat, self.delay)

    @property
    def duration(self) -> float:
        return self._profile.duration

    def pose(self, t_s: float) -> Pose:
        distance, speed = self._profile.at(t_s)
        axis = unit_vector(self.direction)
        return Pose(axis * distance, UNTURNED, axis * speed, ZERO)


@dataclass(frozen=True, kw_only=True)
class Press(Travel):
    """An approach, a press by ``depth``, a dwell, a return and a pause, ``repeat`` times."""

    kind = "press"
    depth: DepthAfterTravel
    """Distance beyond the end of the approach [m]."""
    approach: Distance = 0.0
    """Free travel before the first touch [m]."""
    speed: MetresPerSecond = 0.01
    """Speed of the approach and the press [m/s]."""
    dwell: Seconds = 0.5
    """Time at full depth [s]."""
    release: bool = True
    """Come back after the dwell; ``false`` leaves the body pressed in, for a slide that follows in a sequence."""
    release_speed: MetresPerSecond | None = None
    """Speed of the return [m/s]; default: ``speed``."""
    pause: Seconds = 0.0
    """Time back at the start before the next press [s]."""
    delay: Seconds = 0.0
    """Time before the first press [s]."""
    repeat: Repeats | None = 1
    """Number of presses; ``0`` or ``None``: for ever."""
    direction: Vector = (0.0, 0.0, -1.0)
    """Direction in the world; its length does not matter."""

    def __post_init__(self):
        check_declared(self.kind, self)
        check_direction(self, "direction")
        deepest = Bounds(unit=LENGTH_UNIT, low=0.0 - self.approach, high=MAX_DEPTH_M)
        number(self.kind, "depth", self.depth, Annotated[float, deepest])

    @cached_property
    def _profile(self) -> DistanceProfile:
        far = self.approach + self.depth
        knots = [(0.0, 0.0), (far / self.speed, far), (self.dwell, far)]
        if self.release:
            knots += [(far / (self.release_speed or self.speed), 0.0), (self.pause, 0.0)]
        return DistanceProfile(knots, self.repeat if self.release else 1, self.delay)


@dataclass(frozen=True, kw_only=True)
class Slide(Travel):
    """A travel along a line without turning; with ``repeat`` other than 1, there and back."""

    kind = "slide"
    distance: Distance
    """Distance to travel [m]."""
    speed: MetresPerSecond = 0.02
    """Speed [m/s]."""
    direction: Vector = (1.0, 0.0, 0.0)
    """Direction in the world; its length does not matter."""
    repeat: Repeats | None = 1
    """1: travel once and stay; n > 1: n times there and back; ``0`` or ``None``: there and back for ever."""
    delay: Seconds = 0.0
    """Time before the start [s]."""

    def __post_init__(self):
        check_declared(self.kind, self)
        check_direction(self, "direction")


@dataclass(frozen=True, kw_only=True)
class Roll(Travel):
    """A roll without slipping over a flat surface: a slide, with the rotation that a body of ``radius`` then has."""

    kind = "roll"
    distance: Distance
    """Distance to travel [m]."""
    radius: Radius
    """Distance of the surface from the body's centre [m]."""
    speed: MetresPerSecond = 0.02
    """Speed of the body's centre [m/s]."""
    direction: Vector = (1.0, 0.0, 0.0)
    """Direction in the world; its length does not matter."""
    normal: Vector = (0.0, 0.0, 1.0)
    """Normal of the surface, towards the body, in the world."""
    repeat: Repeats | None = 1
    """1: travel once and stay; n > 1: n times there and back; ``0`` or ``None``: there and back for ever."""
    delay: Seconds = 0.0
    """Time before the start [s]."""

    def __post_init__(self):
        check_declared(self.kind, self)
        check_direction(self, "direction")
        check_direction(self, "normal")

    def pose(self, t_s: float) -> Pose:
        distance, speed = self._profile.at(t_s)
        axis, turn = self._axes
        return Pose(axis * distance, rotation.from_rotation_vector(turn * distance), axis * speed, turn * speed)

    @cached_property
    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        """The direction of travel, and the rotation vector per metre.

        The touching point does not slip: v + w x (-radius normal) = 0.
        """
        axis = unit_vector(self.direction)
        return axis, np.cross(unit_vector(self.normal), axis) / self.radius


@dataclass(frozen=True, kw_only=True)
class Spin(Motion):
    """A rotation about an axis through the body's origin at a constant rate."""

    kind = "spin"
    rate: RadiansPerSecond
    """Angular rate [rad/s]; its sign is the sense of rotation."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction in the world; its length does not matter."""
    angle: Radians | None = None
    """Angle at which the motion stops [rad]; ``None``: it never stops."""
    delay: Seconds = 0.0
    """Time before the start [s]."""

    def __post_init__(self):
        check_declared(self.kind, self)
        check_direction(self, "axis")

    @property
    def duration(self) -> float:
        return math.inf if self.angle is None or self.rate == 0 else self.delay + self.angle / abs(self.rate)

    def pose(self, t_s: float) -> Pose:
        turning = self.delay <= t_s < self.duration
        elapsed = min(max(t_s, self.delay), self.duration) - self.delay
        axis = unit_vector(self.axis)
        turn = rotation.from_rotation_vector(axis * math.remainder(self.rate * elapsed, 4 * math.pi))
        return Pose(ZERO, turn, ZERO, axis * self.rate if turning else ZERO)


def check_direction(motion: Motion, name: str) -> None:
    """Raise :class:`SceneError` if a field is no direction."""
    v = np.asarray(getattr(motion, name), float)
    if v.shape != (3,) or not np.all(np.isfinite(v)) or not np.any(np.abs(v) > 1e-6) or np.any(np.abs(v) > 1e6):
        raise SceneError(
            f"{motion.kind}.{name}: expected three finite numbers, not all of them near zero, "
            f"got {getattr(motion, name)}"
        )
