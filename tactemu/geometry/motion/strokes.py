"""The basic motions: hold, press, slide, roll, spin."""

from __future__ import annotations

import math
from dataclasses import dataclass
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
from tactemu.geometry.motion.pose import Motion, Vector
from tactemu.geometry.motion.track import Knot, PlainMotion, Track, travel


def unit_vector(vector) -> np.ndarray:
    """Return the unit vector along ``vector``."""
    v = np.asarray(vector, np.float64)
    return v / math.sqrt(float(v @ v))


@dataclass(frozen=True, kw_only=True)
class Hold(PlainMotion):
    """A pause: the body stays where it is."""

    kind = "hold"
    seconds: Seconds = math.inf
    """Duration [s], for a pause inside a sequence."""

    def __post_init__(self):
        if self.seconds != math.inf:
            number(self.kind, "seconds", self.seconds, Seconds)

    def _make_track(self) -> Track:
        return Track((Knot(0.0, 0.0, 0.0),), duration=self.seconds)


@dataclass(frozen=True, kw_only=True)
class Press(PlainMotion):
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

    def _make_track(self) -> Track:
        far = self.approach + self.depth
        knots = [(0.0, 0.0), (far / self.speed, far), (self.dwell, far)]
        if self.release:
            knots += [(far / (self.release_speed or self.speed), 0.0), (self.pause, 0.0)]
        return travel(knots, self.repeat if self.release else 1, self.delay, unit_vector(self.direction))


@dataclass(frozen=True, kw_only=True)
class Slide(PlainMotion):
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

    def _make_track(self) -> Track:
        return travel(_there(self), self.repeat, self.delay, unit_vector(self.direction))


@dataclass(frozen=True, kw_only=True)
class Roll(PlainMotion):
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

    def _make_track(self) -> Track:
        axis = unit_vector(self.direction)
        # the touching point does not slip: v + w x (-radius normal) = 0
        turn = np.cross(unit_vector(self.normal), axis) / self.radius
        return travel(_there(self), self.repeat, self.delay, axis, turn)


@dataclass(frozen=True, kw_only=True)
class Spin(PlainMotion):
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

    def _make_track(self) -> Track:
        axis = unit_vector(self.axis)
        knots, duration = [Knot(0.0, 0.0, self.rate, turn=axis)], math.inf
        if self.angle is not None and self.rate:
            duration = self.delay + self.angle / abs(self.rate)
            span = duration - self.delay
            knots.append(Knot(span, self.rate * span, 0.0, turn=axis))
        return Track(tuple(knots), delay=self.delay, duration=duration, turn_period=4 * math.pi)


def _there(motion: Slide | Roll) -> list[tuple[float, float]]:
    """Return the distance over time of a travel that is made once, or there and back."""
    seconds = motion.distance / motion.speed
    there = [(0.0, 0.0), (seconds, motion.distance)]
    return there if motion.repeat == 1 else [*there, (seconds, 0.0)]


def check_direction(motion: Motion, name: str) -> None:
    """Raise :class:`SceneError` if a field is no direction."""
    v = np.asarray(getattr(motion, name), float)
    if v.shape != (3,) or not np.all(np.isfinite(v)) or not np.any(np.abs(v) > 1e-6) or np.any(np.abs(v) > 1e6):
        raise SceneError(
            f"{motion.kind}.{name}: expected three finite numbers, not all of them near zero, "
            f"got {getattr(motion, name)}"
        )
