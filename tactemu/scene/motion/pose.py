"""A pose with its velocities, and what every motion is."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from tactemu.scene import rotation

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

ZERO = np.zeros(3)
UNTURNED = np.array(rotation.IDENTITY)
ZERO.flags.writeable = UNTURNED.flags.writeable = False  # shared by all poses


class Pose(NamedTuple):
    """Where a body is and how it moves. Float64 arrays, in the world frame."""

    position: np.ndarray = ZERO
    """Of the body's origin [m], shape ``(3,)``."""
    quaternion: np.ndarray = UNTURNED
    """Unit, w, x, y, z, shape ``(4,)``."""
    linear_velocity: np.ndarray = ZERO
    """Of the body's origin [m/s], shape ``(3,)``."""
    angular_velocity: np.ndarray = ZERO
    """[rad/s], shape ``(3,)``."""

    def displaced(self, by: Pose) -> Pose:
        """This pose after the displacement ``by``: shifted along the world's axes, turned about its own origin."""
        turned = by.quaternion is not UNTURNED
        spin = self.angular_velocity
        if turned and spin is not ZERO:
            spin = rotation.rotate(by.quaternion, spin)
        return Pose(
            self.position + by.position,
            rotation.multiply(by.quaternion, self.quaternion) if turned else self.quaternion,
            self.linear_velocity + by.linear_velocity,
            by.angular_velocity + spin if spin is not ZERO else by.angular_velocity,
        )


class Motion(ABC):
    """A displacement over time. Subclasses are frozen dataclasses whose fields are the keys of a scene file."""

    kind: ClassVar[str]
    """The word for it in a scene file."""
    __pydantic_config__: ClassVar[dict] = {"extra": "forbid"}

    @abstractmethod
    def pose(self, t_s: float) -> Pose:
        """Displacement and velocities at ``t_s`` [s] since the motion began; at rest before 0 and after the end."""

    @property
    def duration(self) -> float:
        """[s]; infinite for a motion that does not end."""
        return math.inf

    def placed(self, position=(0.0, 0.0, 0.0), quaternion=rotation.IDENTITY) -> Placed:
        """The same motion of a body that was placed at this pose: gives poses in the world."""
        return Placed(self, Pose(np.array(position, np.float64), rotation.normalised(quaternion)))


@dataclass(frozen=True)
class Placed:
    """A motion seen from the world: the pose at which the body was placed, displaced."""

    motion: Motion
    start: Pose

    def pose(self, t_s: float) -> Pose:
        """World pose at ``t_s`` [s]."""
        return self.start.displaced(self.motion.pose(t_s))
