"""A pose with its velocities, and the base class of all motions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tactemu.geometry import rotation

Times = float | Any
"""A time [s]; in a batch an array of the environments' own times, float64, shape ``(n_envs,)``."""
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

ZERO = np.zeros(3)
UNTURNED = np.array(rotation.IDENTITY)
ZERO.flags.writeable = UNTURNED.flags.writeable = False  # shared by all poses


class Pose(NamedTuple):
    """The pose and the velocities of a body: float64 arrays, in the world frame.

    In a batch each may have a row for each environment: ``(n_envs, 3)``, ``(n_envs, 4)``.
    """

    position: np.ndarray = ZERO
    """Position of the body's origin [m], shape ``(3,)``."""
    quaternion: np.ndarray = UNTURNED
    """Orientation, a unit quaternion (w, x, y, z), shape ``(4,)``."""
    linear_velocity: np.ndarray = ZERO
    """Velocity of the body's origin [m/s], shape ``(3,)``."""
    angular_velocity: np.ndarray = ZERO
    """Angular velocity [rad/s], shape ``(3,)``."""

    def displaced(self, by: Pose) -> Pose:
        """Return this pose shifted along the world's axes and turned about its own origin by ``by``."""
        turned = by.quaternion is not UNTURNED
        spin = self.angular_velocity
        many = turned and np.ndim(by.quaternion) + np.ndim(self.quaternion) > 2
        if turned and spin is not ZERO:
            spin = rotation.rotate_many(by.quaternion, spin) if many else rotation.rotate(by.quaternion, spin)
        multiply = rotation.multiply_many if many else rotation.multiply
        return Pose(
            self.position + by.position,
            multiply(by.quaternion, self.quaternion) if turned else self.quaternion,
            self.linear_velocity + by.linear_velocity,
            by.angular_velocity + spin if spin is not ZERO else by.angular_velocity,
        )


class Motion(ABC):
    """A displacement over time. Subclasses are frozen dataclasses whose fields are the keys of a scene file."""

    kind: ClassVar[str]
    """The value of ``kind`` in a scene file."""
    __pydantic_config__: ClassVar[dict] = {"extra": "forbid"}

    @abstractmethod
    def pose(self, t_s: Times) -> Pose:
        """Return displacement and velocities at ``t_s`` [s] since the motion began, in a batch at an array of times.

        The body stands still before 0 and after the end.
        """

    @property
    def duration(self) -> float:
        """The duration [s]; infinite for a motion that does not end."""
        return math.inf
