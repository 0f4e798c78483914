"""Motions through keyframes, to a fixed pose, and from a Python function."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.base.options import numbers
from tactemu.base.units import LENGTH_UNIT, MAX_TIME_S, MAX_TRAVEL_M
from tactemu.geometry import rotation
from tactemu.geometry.motion.pose import UNTURNED, ZERO, Motion, Pose, Quaternion, Times, Vector
from tactemu.geometry.motion.track import Knot, PlainMotion, Track


@dataclass(frozen=True, kw_only=True)
class Keyframes(PlainMotion):
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
        self.track  # noqa: B018  (computed now, so that a bad quaternion is an error of the scene)

    def _make_track(self) -> Track:
        times = np.asarray(self.times, float)
        positions = np.asarray(self.positions or [(0.0, 0.0, 0.0)] * len(times), float)
        try:
            turns = [rotation.normalised(q) for q in self.quaternions] or [UNTURNED] * len(times)
        except ValueError as error:
            raise SceneError(f"keyframes.quaternions: {error}") from None
        knots, spin = [], ZERO
        for k, span in enumerate(np.diff(times)):
            if self.quaternions:
                turn = rotation.multiply(turns[k + 1], rotation.conjugate(turns[k]))
                spin = rotation.to_rotation_vector(turn) / span
            velocity = (positions[k + 1] - positions[k]) / span
            knots.append(Knot(float(times[k]), 0.0, 1.0, velocity, spin, positions[k], turns[k]))
        knots.append(Knot(float(times[-1]), 0.0, 0.0, origin=positions[-1], quaternion=turns[-1]))
        return Track(tuple(knots), duration=math.inf if self.repeat else float(times[-1]), repeats=self.repeat)


@dataclass(frozen=True)
class Placed(Motion):
    """A constant displacement, with the velocities that were given with it."""

    kind = "placed"
    at: Pose

    def pose(self, t_s: Times) -> Pose:
        """Return the given displacement and velocities, whatever the time."""
        return self.at


@dataclass(frozen=True, kw_only=True)
class FromFunction(Motion):
    """A displacement computed by a Python function: ``function(t_s)`` returns a position [m], a pair (position,
    quaternion), or a :class:`Pose`. If it is no Pose, velocities are central differences over ``2 * step``.

    In a batch (``scene.build(n_envs)``) it gets the times of all environments, an array ``(n_envs,)``, each since the
    environment's own reset. It returns a row for each, or numbers for all of them; ``(0, 0, -2 * t_s)`` will do.
    """

    kind = "function"
    function: Callable[[Any], object]
    step: float = 1e-5
    """Half the interval of the central differences [s]."""

    def pose(self, t_s: Times) -> Pose:
        here = self._evaluate(t_s)
        if isinstance(here, Pose):
            return here
        before, after = self._evaluate(t_s - self.step), self._evaluate(t_s + self.step)
        velocity = (after[0] - before[0]) / (2 * self.step)
        if here[1] is UNTURNED:
            return Pose(here[0], UNTURNED, velocity)
        if here[1].ndim == 1:
            turn = rotation.to_rotation_vector(rotation.multiply(after[1], rotation.conjugate(before[1])))
        else:
            turn = rotation.between_many(before[1], after[1])
        return Pose(here[0], here[1], velocity, turn / (2 * self.step))

    def _evaluate(self, t_s: Times) -> Any:
        rows = t_s.shape if isinstance(t_s, np.ndarray) else ()
        value: Any = self._of_many(t_s) if isinstance(t_s, np.ndarray) else self.function(t_s)
        if isinstance(value, Pose):
            return value
        try:
            pair = isinstance(value, tuple | list) and len(value) == 2
            position, turn = value if pair else (value, UNTURNED)
            if turn is not UNTURNED:
                turn = _rows(turn, 4, rows)
                turn = rotation.normalised(turn) if turn.ndim == 1 else np.array([*map(rotation.normalised, turn)])
            return _rows(position, 3, rows), turn
        except (TypeError, ValueError):
            expected = "a position, (position, quaternion) or a Pose"
            where = f"for all {rows[0]} environments or with a row for each" if rows else f"at {t_s:g} s"
            raise SceneError(f"motion by a function: {where} expected {expected}, got {value!r}") from None

    def _of_many(self, times: np.ndarray) -> Any:
        try:
            return self.function(times)
        except (TypeError, ValueError) as error:
            raise SceneError(
                "motion by a function: in a batch it gets the times of all environments, an array "
                f"{times.shape}; compute with numpy's functions ({error})"
            ) from error


def _rows(values: Any, width: int, rows: tuple[int, ...]) -> np.ndarray:
    """Return numbers for all environments, ``(width,)``, or a row for each, ``(n, width)``, as float64.

    Raises:
        ValueError: they are of another shape.
    """
    if rows and isinstance(values, tuple | list) and len(values) == width:  # numbers, and numbers for each environment
        values = np.stack(np.broadcast_arrays(*values), axis=-1)
    array = np.asarray(values, np.float64)
    return array if rows and array.shape == (*rows, width) else array.reshape(width)
