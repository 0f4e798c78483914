"""A sensor as the device on it sees it: vectors in the device's own frame, and what its chips feel beside the touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactemu.scene import rotation

GRAVITY = (0.0, 0.0, 9.80665)
"""What an accelerometer at rest reads in the world's frame [m/s²]: up."""
ROOM_TEMPERATURE = 25.0
_HALF_STEP_S = 1e-4


@dataclass(frozen=True)
class Surroundings:
    """What a device's other sensors read, in the device's frame."""

    temperature: float = ROOM_TEMPERATURE
    """[°C]"""
    acceleration: tuple[float, float, float] = GRAVITY
    """Proper acceleration [m/s²]."""
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[rad/s]"""


class PlacedSensor:
    """A built sensor on its link, turned by ``quaternion`` against the link's frame.

    Args:
        sensor: as :meth:`tactemu.Scene.add_sensor` returns it.
        quaternion: from the device's frame to the link's.
    """

    def __init__(self, sensor: Any, quaternion=rotation.IDENTITY):
        self.sensor = sensor
        self._to_link = rotation.normalised(quaternion)
        self._back = rotation.conjugate(self._to_link)
        self._turned = not np.array_equal(self._to_link, rotation.IDENTITY)
        course = sensor.model.temperature_course
        self._course = None if course is None else np.asarray(course, float)

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """The latest reading in the device's frame, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI."""
        values = self.sensor.quantity(name, ground_truth)
        return rotation.rotate(self._back, values) if self._turned and values.ndim == 2 else values

    def surroundings(self, t_ns: int) -> Surroundings:
        """Temperature by the sensor's ``temperature_course``; acceleration and turning by the motion of its link.

        The accelerometer sits at the link's origin. A link that is posed by hand is taken to be at rest.
        """
        t_s = t_ns * 1e-9
        link = self.sensor.link
        quaternion, acceleration, turning = rotation.normalised(link.quaternion), np.array(GRAVITY), np.zeros(3)
        if link.motion is not None:
            motion = (
                link.motion.placed(link.position, link.quaternion) if hasattr(link.motion, "placed") else link.motion
            )
            pose = motion.pose(t_s)
            before, after = (motion.pose(max(0.0, t_s + dt)).linear_velocity for dt in (-_HALF_STEP_S, _HALF_STEP_S))
            acceleration = acceleration + (after - before) / (2 * _HALF_STEP_S)
            quaternion, turning = pose.quaternion, pose.angular_velocity
        to_device = rotation.conjugate(rotation.multiply(quaternion, self._to_link))
        return Surroundings(
            temperature=self._temperature(t_s),
            acceleration=tuple(rotation.rotate(to_device, acceleration)),
            angular_velocity=tuple(rotation.rotate(to_device, turning)),
        )

    def _temperature(self, t_s: float) -> float:
        if self._course is None:
            return ROOM_TEMPERATURE
        return float(np.interp(t_s, self._course[:, 0], self._course[:, 1]))
