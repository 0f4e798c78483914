"""The path of a plain motion: pieces of even speed between knots, as data that a kernel can evaluate, too."""

from __future__ import annotations

import bisect
import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tactemu.geometry import rotation
from tactemu.geometry.motion.pose import UNTURNED, ZERO, Motion, Pose, Times


class Knot(NamedTuple):
    """The beginning of a piece of a path, along which a distance grows evenly."""

    time_s: float
    """The time at which the piece begins [s]."""
    distance: float
    """The distance there."""
    speed: float
    """The distance per second from there on."""
    axis: np.ndarray = ZERO
    """The translation per distance [m]."""
    turn: np.ndarray = ZERO
    """The rotation vector per distance [rad]."""
    origin: np.ndarray = ZERO
    """The translation where the distance is 0 [m]."""
    quaternion: np.ndarray = UNTURNED
    """The rotation where the distance is 0."""


@dataclass(frozen=True, eq=False)
class Track:
    """A path in pieces. It stands still at its first knot before it begins, and at its last knot from its end on."""

    knots: tuple[Knot, ...]
    """The pieces' beginnings, in ascending order; the last is where the path ends, or an endless piece."""
    duration: float
    """Time at which it ends [s]; infinite for a path without end."""
    delay: float = 0.0
    """Time before the knots' time begins [s]."""
    repeats: bool = False
    """It starts over at the last knot, until it ends."""
    turn_period: float = 0.0
    """The distance after which an endless rotation is the same again, 0 for other paths: it keeps the angle small."""

    @cached_property
    def times(self) -> list[float]:
        """The time of each knot [s]."""
        return [knot.time_s for knot in self.knots]

    def pose(self, t_s: float) -> Pose:
        """Return displacement and velocities at ``t_s`` [s]; the kernel of :mod:`tactemu.sensors.motions` computes the
        same, to the bit."""
        times, local = self.times, t_s - self.delay
        at_rest = t_s >= self.duration or local < times[0]
        if at_rest:
            knot = self.knots[-1 if t_s >= self.duration else 0]
            moved, speed = knot.distance, 0.0
        else:
            if self.repeats and local >= times[-1]:
                local = times[0] + (local - times[0]) % (times[-1] - times[0])
            knot = self.knots[bisect.bisect_right(times, local) - 1]
            moved, speed = knot.distance + knot.speed * (local - knot.time_s), knot.speed
        position, quaternion, spin = knot.axis * moved, knot.quaternion, ZERO
        if knot.origin is not ZERO:
            position = knot.origin + position
        if knot.turn is not ZERO:
            angle = math.remainder(moved, self.turn_period) if self.turn_period else moved
            turned = rotation.from_rotation_vector(knot.turn * angle)
            quaternion = turned if quaternion is UNTURNED else rotation.multiply(turned, quaternion)
            spin = knot.turn * speed
        return Pose(position, quaternion, knot.axis * speed, spin)


def travel(
    knots: Sequence[tuple[float, float]], repeat: int | None, delay: float, axis: np.ndarray, turn: np.ndarray = ZERO
) -> Track:
    """Return the track of a distance over time, linear between knots.

    Args:
        knots: pairs (time since the knot before [s], distance [m]).
        repeat: number of times that it is made; 0 or ``None``: for ever.
        delay: time before it begins [s].
        axis: direction of the translation.
        turn: rotation vector per distance [rad/m].
    """
    times, values = [0.0], [knots[0][1]]
    for span, value in knots[1:]:
        if span > 0:
            times.append(times[-1] + span)
            values.append(value)
    slopes = [(b - a) / (v - u) for a, b, u, v in zip(values, values[1:], times, times[1:])]
    period = times[-1]
    return Track(
        tuple(Knot(*each, axis, turn) for each in zip(times, values, [*slopes, 0.0])),
        delay=delay,
        duration=delay + period * (repeat or math.inf) if period else delay,
        repeats=repeat != 1,
    )


class PlainMotion(Motion):
    """A motion that is a track, so that a kernel can compute it."""

    @cached_property
    def track(self) -> Track:
        """The path."""
        return self._make_track()

    @abstractmethod
    def _make_track(self) -> Track: ...

    @property
    def duration(self) -> float:
        return self.track.duration

    def pose(self, t_s: Times) -> Pose:
        return each_time(self.track.pose, t_s)


def each_time(pose: Callable[[float], Pose], t_s: Times) -> Pose:
    """Return the pose at a time, or the poses at each of an array of times."""
    if not isinstance(t_s, np.ndarray):
        return pose(t_s)
    times, which = np.unique(t_s, return_inverse=True)
    parts = zip(*(pose(float(each)) for each in times))
    return Pose(*(np.array(part)[which] for part in parts))
