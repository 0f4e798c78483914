"""The motion of a body that follows a joint of a device, such as a finger that the hand's own motors move."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.options import check_declared, number
from tactemu.base.units import LENGTH_UNIT, MAX_ANGLE_RAD, MAX_TRAVEL_M, Coordinate
from tactemu.geometry import rotation
from tactemu.geometry.motion.free import FromFunction
from tactemu.geometry.motion.pose import Motion, Pose, Vector

_HALF_STEP_S = 1e-4


@dataclass(frozen=True, kw_only=True)
class Joint(Motion):
    """A motion that follows a joint of a skin's device: a turn about an axis, or with ``slide`` a shift along it.

    There is no displacement where the joint reads ``zero``. The motion takes effect once the scene is assembled with
    its devices; velocities are central differences over 0.2 ms.
    """

    kind = "joint"
    skin: str
    """Name of the skin whose device moves the body."""
    joint: str
    """Name of the joint, as in the device's datasheet."""
    axis: Vector = (1.0, 0.0, 0.0)
    """The direction of the joint's axis in the world."""
    pivot: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    """A point on the axis, relative to the body's origin at the start [m]."""
    slide: bool = False
    """The joint shifts the body along the axis instead of turning it."""
    zero: float = 0.0
    """The joint position without displacement [rad], or [m] for a joint that slides."""

    def __post_init__(self):
        length = math.sqrt(sum(each * each for each in self.axis))
        if not 0 < length < math.inf:
            raise SceneError(f"joint.axis: expected a direction, got {list(self.axis)}")
        check_declared(self.kind, self)
        most, unit = (MAX_TRAVEL_M, LENGTH_UNIT) if self.slide else (MAX_ANGLE_RAD, "rad")
        number(self.kind, "zero", self.zero, Annotated[float, Bounds(unit=unit, low=-most, high=most)])

    def pose(self, t_s: float) -> Pose:
        return Pose()

    def driven_by(self, position: Callable[[float], float]) -> FromFunction:
        """Return the motion of the body for the joint's position over time, ``position(t_s)`` [rad or m]."""
        axis = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        pivot = np.asarray(self.pivot, float)

        def pose(t_s: float) -> Pose:
            moved = position(t_s) - self.zero
            speed = (position(t_s + _HALF_STEP_S) - position(t_s - _HALF_STEP_S)) / (2 * _HALF_STEP_S)
            if self.slide:
                return Pose(moved * axis, linear_velocity=speed * axis)
            turn = rotation.from_rotation_vector(moved * axis)
            arm = rotation.rotate(turn, pivot)
            return Pose(pivot - arm, turn, -np.cross(speed * axis, arm), speed * axis)

        return FromFunction(function=pose)
