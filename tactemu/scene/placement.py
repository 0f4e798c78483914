"""A device on its link: where its taxels are, what they read in the device's own frame, what its chips feel beside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from firmware_protocols import Layout
from tactemu.errors import SceneError
from tactemu.scene import rotation
from tactemu.scene.bodies import Body

if TYPE_CHECKING:
    from tactemu.imperfections import Imperfections
    from tactemu.physics.sensor import Sensor

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


@dataclass(frozen=True)
class PlacedLayout:
    """A device's taxels on a body that moves."""

    layout: Layout
    link: Body
    position: tuple[float, float, float]
    """Of the device's frame on the link [m]."""
    quaternion: tuple[float, float, float, float]
    """From the device's frame to the link's."""

    def positions(self, t_s: float) -> np.ndarray:
        """All taxels in the world at ``t_s`` [m], shape ``(n_taxels, 3)``."""
        link = self.link.pose(t_s)
        on_link = rotation.rotate(rotation.normalised(self.quaternion), self.layout.positions) + self.position
        return link.position + rotation.rotate(link.quaternion, on_link)

    def normal(self, taxel: int, t_s: float) -> np.ndarray:
        """A taxel's direction out of the skin in the world at ``t_s``, shape ``(3,)``."""
        turn = rotation.multiply(self.link.pose(t_s).quaternion, rotation.normalised(self.quaternion))
        return rotation.rotate(turn, self.layout.normals[taxel])

    def chosen(self, taxel: int | None, near: np.ndarray, t_s: float) -> int:
        """The taxel that was asked for; ``None``: the one nearest to a point of the world at ``t_s``.

        Raises:
            SceneError: there is none of this number.
        """
        if taxel is None:
            return int(np.argmin(np.linalg.norm(self.positions(t_s) - near, axis=1)))
        if not 0 <= taxel < len(self.layout):
            raise SceneError(f"taxel: expected 0..{len(self.layout) - 1}, got {taxel}")
        return taxel


class PlacedSensor:
    """A built sensor on its link, turned by ``quaternion`` against the link's frame.

    Args:
        sensor: as :meth:`tactemu.Scene.add_sensor` returns it.
        quaternion: from the device's frame to the link's.
    """

    def __init__(self, sensor: Sensor, quaternion=rotation.IDENTITY):
        self.sensor = sensor
        self._to_link = rotation.normalised(quaternion)
        self._back = rotation.conjugate(self._to_link)
        self._turned = not np.array_equal(self._to_link, rotation.IDENTITY)
        course = sensor.model.temperature_course
        self._course = None if course is None else np.asarray(course, float)
        self._before: tuple[float, np.ndarray] | None = None
        """When a link that is posed by hand was last looked at [s], and its velocity then [m/s]."""

    @property
    def imperfections(self) -> Imperfections | None:
        """The sensor's."""
        return self.sensor.imperfections

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """The latest reading in the device's frame, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI."""
        values = self.sensor.quantity(name, ground_truth)
        return rotation.rotate(self._back, values) if self._turned and values.ndim == 2 else values

    def surroundings(self, t_ns: int) -> Surroundings:
        """Temperature by the sensor's ``temperature_course``; acceleration and turning by how its link moves.

        The accelerometer sits at the link's origin. A link that is posed by hand turns as fast as
        :meth:`Simulation.set_pose` was told, and is accelerated by how the velocity told differs from that at the
        last look; who tells no velocities says that it rests.
        """
        t_s = t_ns * 1e-9
        link = self.sensor.link
        if link.motion is not None or link.fixed:
            pose = link.pose(t_s)
            before, after = (link.pose(max(0.0, t_s + dt)).linear_velocity for dt in (-_HALF_STEP_S, _HALF_STEP_S))
            acceleration = (after - before) / (2 * _HALF_STEP_S)
        else:
            pose = self.sensor.link_pose()
            acceleration = self._change(t_s, pose.linear_velocity)
        to_device = rotation.conjugate(rotation.multiply(pose.quaternion, self._to_link))
        return Surroundings(
            temperature=self._temperature(t_s),
            acceleration=tuple(rotation.rotate(to_device, acceleration + GRAVITY)),
            angular_velocity=tuple(rotation.rotate(to_device, pose.angular_velocity)),
        )

    def _change(self, t_s: float, velocity: np.ndarray) -> np.ndarray:
        """Acceleration [m/s²] since the last look; none at the first, or when time starts anew."""
        before, self._before = self._before, (t_s, velocity)
        if before is None or before[0] >= t_s:
            return np.zeros(3)
        return (velocity - before[1]) / (t_s - before[0])

    def _temperature(self, t_s: float) -> float:
        if self._course is None:
            return ROOM_TEMPERATURE
        return float(np.interp(t_s, self._course[:, 0], self._course[:, 1]))
