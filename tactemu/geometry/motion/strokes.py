"""The plain motions: hold, press, slide, roll, spin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactemu.base.options import number
from tactemu.geometry import rotation
from tactemu.geometry.limits import LENGTH_UNIT, MAX_ANGLE_RAD, MAX_DEPTH_M, MAX_RADIUS_M, SIZE_RANGE_M
from tactemu.geometry.motion.distance_profile import (
    DistanceProfile,
    check_direction,
    check_distances,
    check_repeat,
    check_speeds,
    check_times,
    travel_profile,
    unit_vector,
)
from tactemu.geometry.motion.pose import UNTURNED, ZERO, Motion, Pose, Vector

MAX_SPIN_RATE_RAD_S = 1e4
"""Of a spin [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Hold(Motion):
    """Stay where you are."""

    kind = "hold"
    seconds: float = math.inf
    """How long [s]: a pause inside a sequence."""

    def __post_init__(self):
        if self.seconds != math.inf:
            check_times(self, "seconds")

    @property
    def duration(self) -> float:
        return self.seconds

    def pose(self, t_s: float) -> Pose:
        return Pose()


@dataclass(frozen=True, kw_only=True)
class Press(Motion):
    """Approach, go in by ``depth``, dwell, come back, wait; again and again."""

    kind = "press"
    depth: float
    """How far beyond the end of the approach [m]."""
    approach: float = 0.0
    """Free way before first touch [m]."""
    speed: float = 0.01
    """[m/s]."""
    dwell: float = 0.5
    """Time at full depth [s]."""
    release: bool = True
    """Come back; ``false`` leaves the body pressed in, for a slide that follows in a sequence."""
    release_speed: float | None = None
    """[m/s]; default: ``speed``."""
    pause: float = 0.0
    """Time back at the start before the next press [s]."""
    delay: float = 0.0
    """Time before the first press [s]."""
    repeat: int | None = 1
    """Number of presses; ``0`` or ``None``: for ever."""
    direction: Vector = (0.0, 0.0, -1.0)
    """In the world; its length does not matter."""

    def __post_init__(self):
        check_distances(self, "approach")
        check_times(self, "dwell", "pause", "delay")
        check_speeds(self, "speed", "release_speed")
        check_direction(self, "direction")
        check_repeat(self)
        number(self.kind, "depth", self.depth, at_least=0.0 - self.approach, at_most=MAX_DEPTH_M, unit=LENGTH_UNIT)

    @cached_property
    def _way(self) -> DistanceProfile:
        far = self.approach + self.depth
        knots = [(0.0, 0.0), (far / self.speed, far), (self.dwell, far)]
        if self.release:
            knots += [(far / (self.release_speed or self.speed), 0.0), (self.pause, 0.0)]
        return DistanceProfile(knots, self.repeat if self.release else 1, self.delay)

    @property
    def duration(self) -> float:
        return self._way.duration

    def pose(self, t_s: float) -> Pose:
        distance, speed = self._way.at(t_s)
        axis = unit_vector(self.direction)
        return Pose(axis * distance, UNTURNED, axis * speed, ZERO)


@dataclass(frozen=True, kw_only=True)
class Slide(Motion):
    """Travel along a line without turning; with ``repeat`` other than 1, to and fro."""

    kind = "slide"
    distance: float
    """[m]."""
    speed: float = 0.02
    """[m/s]."""
    direction: Vector = (1.0, 0.0, 0.0)
    """In the world; its length does not matter."""
    repeat: int | None = 1
    """1: there, and stay; n > 1: n times there and back; ``0`` or ``None``: to and fro for ever."""
    delay: float = 0.0
    """Time before the start [s]."""

    def __post_init__(self):
        check_distances(self, "distance")
        check_times(self, "delay")
        check_speeds(self, "speed")
        check_direction(self, "direction")
        check_repeat(self)

    @cached_property
    def _way(self) -> DistanceProfile:
        return travel_profile(self.distance, self.speed, self.repeat, self.delay)

    @property
    def duration(self) -> float:
        return self._way.duration

    def pose(self, t_s: float) -> Pose:
        distance, speed = self._way.at(t_s)
        axis = unit_vector(self.direction)
        return Pose(axis * distance, UNTURNED, axis * speed, ZERO)


@dataclass(frozen=True, kw_only=True)
class Roll(Motion):
    """Roll without slipping over a flat surface: a slide, and the turn of a body of ``radius`` that goes with it."""

    kind = "roll"
    distance: float
    """[m]."""
    radius: float
    """Distance of the surface from the body's centre [m]."""
    speed: float = 0.02
    """[m/s]."""
    direction: Vector = (1.0, 0.0, 0.0)
    """In the world; its length does not matter."""
    normal: Vector = (0.0, 0.0, 1.0)
    """Of the surface, towards the body, in the world."""
    repeat: int | None = 1
    """As for a slide."""
    delay: float = 0.0
    """Time before the start [s]."""

    def __post_init__(self):
        check_distances(self, "distance")
        check_times(self, "delay")
        check_speeds(self, "speed")
        number(self.kind, "radius", self.radius, at_least=SIZE_RANGE_M[0], at_most=MAX_RADIUS_M, unit=LENGTH_UNIT)
        check_direction(self, "direction")
        check_direction(self, "normal")
        check_repeat(self)

    @cached_property
    def _way(self) -> DistanceProfile:
        return travel_profile(self.distance, self.speed, self.repeat, self.delay)

    @property
    def duration(self) -> float:
        return self._way.duration

    def pose(self, t_s: float) -> Pose:
        distance, speed = self._way.at(t_s)
        axis, turn = self._axes
        return Pose(axis * distance, rotation.from_rotation_vector(turn * distance), axis * speed, turn * speed)

    @cached_property
    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Travel, and rotation vector per metre: the touching point rests, v + w x (-radius normal) = 0."""
        axis = unit_vector(self.direction)
        return axis, np.cross(unit_vector(self.normal), axis) / self.radius


@dataclass(frozen=True, kw_only=True)
class Spin(Motion):
    """Turn about an axis through the body's origin at a constant rate."""

    kind = "spin"
    rate: float
    """[rad/s]; the sign is the sense."""
    axis: Vector = (0.0, 0.0, 1.0)
    """In the world; its length does not matter."""
    angle: float | None = None
    """Where to stop [rad]; ``None``: never."""
    delay: float = 0.0
    """Time before the start [s]."""

    def __post_init__(self):
        check_times(self, "delay")
        number(self.kind, "rate", self.rate, at_least=-MAX_SPIN_RATE_RAD_S, at_most=MAX_SPIN_RATE_RAD_S, unit="rad/s")
        if self.angle is not None:
            number(self.kind, "angle", self.angle, at_least=0, at_most=MAX_ANGLE_RAD, unit="rad")
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
