"""Motions through keyframes, to a fixed pose, and from a Python function."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.base.options import numbers
from tactemu.base.units import LENGTH_UNIT, MAX_TIME_S, MAX_TRAVEL_M
from tactemu.geometry import rotation
from tactemu.geometry.motion.pose import Motion, Pose, Quaternion, Vector


@dataclass(frozen=True, kw_only=True)
class Keyframes(Motion):
    """A motion through given displacements at given times: positions linearly, rotations by slerp the shorter way."""

    kind = "keyframes"
    times: tuple[float, ...]
    """Times of the keyframes [s], ascending."""
    positions: tuple[Vector, ...] = ()
    """Displacements [m], one per time; empty: no translation."""
    quaternions: tuple[Quaternion, ...] = ()
    """Rotations, one per time; empty: no rotation."""
    repeat: bool = False
    """Start over at the end."""

    def __post_init__(self):
        times = numbers(self.kind, "times", self.times)
        if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 1e-9) or np.abs(times).max() > MAX_TIME_S:
            raise SceneError(
                f"keyframes: times must be two or more that ascend, up to {MAX_TIME_S:g} s, got {list(self.times)}"
            )
        for name, given in (("positions", self.positions), ("quaternions", self.quaternions)):
            if given and len(given) != len(times):
                raise SceneError(f"keyframes.{name}: expected one per time ({len(times)}), got {len(given)}")
        if self.positions and np.abs(numbers(self.kind, "positions", self.positions)).max() > MAX_TRAVEL_M:
            raise SceneError(
                f"keyframes: positions must be within {MAX_TRAVEL_M:g} {LENGTH_UNIT} of where the body was placed"
            )
        self._segments  # noqa: B018  (computed now, so that a bad quaternion is an error of the scene)

    @cached_property
    def _segments(self) -> list[tuple[float, Pose]]:
        """The start time [s] of each interval, and the pose there with the velocities that hold until the next."""
        times = np.asarray(self.times, float)
        positions = np.asarray(self.positions or [(0.0, 0.0, 0.0)] * len(times), float)
        try:
            turns = [rotation.normalised(q) for q in self.quaternions or [rotation.IDENTITY] * len(times)]
        except ValueError as error:
            raise SceneError(f"keyframes.quaternions: {error}") from None
        found = []
        for k, span in enumerate(np.diff(times)):
            velocity = (positions[k + 1] - positions[k]) / span
            turn = rotation.to_rotation_vector(rotation.multiply(turns[k + 1], rotation.conjugate(turns[k])))
            found.append((float(times[k]), Pose(positions[k], turns[k], velocity, turn / span)))
        return [*found, (float(times[-1]), Pose(positions[-1], turns[-1]))]

    @property
    def duration(self) -> float:
        return math.inf if self.repeat else float(self.times[-1])

    def pose(self, t_s: float) -> Pose:
        first, last = self.times[0], self.times[-1]
        if self.repeat and t_s >= last:
            t_s = first + (t_s - first) % (last - first)
        at = bisect.bisect_right(self.times, t_s) - 1
        if at < 0:
            return Pose(*self._segments[0][1][:2])
        start, key = self._segments[at]
        elapsed = t_s - start
        turn = rotation.from_rotation_vector(key.angular_velocity * elapsed)
        return key._replace(
            position=key.position + key.linear_velocity * elapsed, quaternion=rotation.multiply(turn, key.quaternion)
        )


@dataclass(frozen=True)
class Placed(Motion):
    """A constant displacement, with the velocities that were given with it."""

    kind = "placed"
    at: Pose

    def pose(self, t_s: float) -> Pose:
        """Return the given displacement and velocities, whatever the time."""
        return self.at


@dataclass(frozen=True, kw_only=True)
class FromFunction(Motion):
    """A displacement computed by a Python function: ``function(t_s)`` returns a position [m], a pair (position,
    quaternion), or a :class:`Pose`. If it is no Pose, velocities are central differences over ``2 * step``."""

    kind = "function"
    function: Callable[[float], object]
    step: float = 1e-5
    """Half the interval of the central differences [s]."""

    def pose(self, t_s: float) -> Pose:
        here = self._evaluate(t_s)
        if isinstance(here, Pose):
            return here
        before, after = self._evaluate(t_s - self.step), self._evaluate(t_s + self.step)
        turn = rotation.to_rotation_vector(rotation.multiply(after[1], rotation.conjugate(before[1])))
        return Pose(here[0], here[1], (after[0] - before[0]) / (2 * self.step), turn / (2 * self.step))

    def _evaluate(self, t_s: float):
        value = self.function(t_s)
        if isinstance(value, Pose):
            return value
        try:
            position, turn = value if len(value) == 2 else (value, rotation.IDENTITY)  # type: ignore[arg-type]
            return np.asarray(position, np.float64).reshape(3), rotation.normalised(turn)
        except (TypeError, ValueError):
            expected = "a position, (position, quaternion) or a Pose"
            raise SceneError(f"motion by a function: at {t_s:g} s expected {expected}, got {value!r}") from None
