"""A device on its link: where its taxels are, what they read in the device's own frame, what its chips feel beside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.base.options import numbers
from tactemu.geometry import rotation
from tactemu.geometry.motion import Pose
from tactemu.scene.skins import SkinPart

if TYPE_CHECKING:
    from tactemu.imperfections import ImperfectionOptions, Imperfections
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.sensor_model import SensorModel

GRAVITY = (0.0, 0.0, 9.80665)
"""What an accelerometer at rest reads in the world's frame [m/s²]: up."""
AMBIENT = {"temperature": 25.0, "acceleration": GRAVITY, "angular_velocity": (0.0, 0.0, 0.0)}
"""What is around a device of which nothing is known: temperature [°C], proper acceleration [m/s²], turning [rad/s]."""
_HALF_STEP_S = 1e-4


class PlacedSensor:
    """A built sensor on its body, with vectors in the frame of the device or link that it belongs to.

    Args:
        sensor: as :meth:`tactemu.Scene.add_sensor` returns it.
        part: the taxels that it has, and where they are.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("sensor", "part", "_to_link", "_back", "_turned", "_course")

    def __init__(self, sensor: Sensor, part: SkinPart):
        self.sensor, self.part = sensor, part
        self._to_link = rotation.normalised(part.quaternion)
        self._back = rotation.conjugate(self._to_link)
        self._turned = not np.array_equal(self._to_link, rotation.IDENTITY)
        course = sensor.model.temperature_course
        self._course = None if course is None else numbers(f"sensor {sensor.name!r}", "temperature_course", course)
        self._before: tuple[float, np.ndarray] | None = None
        """When a link that is posed by hand was last looked at [s], and its velocity then [m/s]."""

    def positions(self, t_s: float) -> np.ndarray:
        """Its taxels in the world at ``t_s`` [m], shape ``(n_taxels, 3)``."""
        link = self._link(t_s)
        on_link = rotation.rotate(self._to_link, self.part.layout.positions) + self.part.position
        return link.position + rotation.rotate(link.quaternion, on_link)

    def normals(self, t_s: float) -> np.ndarray:
        """Its taxels' directions out of the skin in the world at ``t_s``, shape ``(n_taxels, 3)``."""
        turn = rotation.multiply(self._link(t_s).quaternion, self._to_link)
        return rotation.rotate(turn, self.part.layout.normals)

    def _link(self, t_s: float) -> Pose:
        """Where its link is: by its motion at ``t_s``, else as it was posed last."""
        link = self.sensor.link
        return link.pose(t_s) if link.motion is not None or link.fixed else self.sensor.link_pose()

    @property
    def imperfections(self) -> Imperfections | None:
        """The sensor's."""
        return self.sensor.imperfections

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading in the device's frame, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI."""
        values = self.sensor.quantity(name, ground_truth)
        return self.to_device_frame(values) if values.ndim == 2 else values

    def to_device_frame(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors of the link's frame, ``(..., 3)``, in the device's."""
        return rotation.rotate(self._back, vectors) if self._turned else vectors

    def ambient(self, name: str, t_ns: int) -> np.ndarray | float:
        """What a chip beside its taxels feels, in the device's frame.

        ``temperature`` by the sensor's course; ``acceleration`` and ``angular_velocity`` by how its link moves.

        The accelerometer sits at the link's origin. A link that is posed by hand turns as fast as
        :meth:`Simulation.set_pose` was told, and is accelerated by how the velocity told differs from that at the
        last look; who tells no velocities says that it rests.
        """
        t_s = t_ns * 1e-9
        if name == "temperature":
            return AMBIENT[name] if self._course is None else float(np.interp(t_s, *self._course.T))
        pose = self._link(t_s)
        to_device = rotation.conjugate(rotation.multiply(pose.quaternion, self._to_link))
        felt = self._acceleration(t_s) + GRAVITY if name == "acceleration" else pose.angular_velocity
        return rotation.rotate(to_device, felt)

    def _acceleration(self, t_s: float) -> np.ndarray:
        link = self.sensor.link
        if link.motion is None and not link.fixed:
            return self._change(t_s, self.sensor.link_pose().linear_velocity)
        before, after = (link.pose(max(0.0, t_s + dt)).linear_velocity for dt in (-_HALF_STEP_S, _HALF_STEP_S))
        return (after - before) / (2 * _HALF_STEP_S)

    def _change(self, t_s: float, velocity: np.ndarray) -> np.ndarray:
        """Acceleration [m/s²] since the last look; none at the first, or when time starts anew."""
        before, self._before = self._before, (t_s, velocity)
        if before is None or before[0] >= t_s:
            return np.zeros(3)
        return (velocity - before[1]) / (t_s - before[0])


class PlacedSkin:
    """A device's skin on one body or several: what its taxels read, and where they are, in the device's order."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("n_taxels",)

    wrench = None
    """It follows from the forces."""

    def __init__(self, parts: Sequence[PlacedSensor], n_taxels: int):
        self.parts = list(parts)
        self.n_taxels = n_taxels

    @property
    def model(self) -> SensorModel:
        """Of its first sensor; all are of one class."""
        return self.parts[0].sensor.model

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """What spoils its readings, to be changed while it runs."""
        if len(self.parts) == 1:
            return self.parts[0].imperfections
        return JoinedImperfections(
            [(part.imperfections, part.part.taxels) for part in self.parts if part.imperfections]
        )

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading in the frames of the device's links, shape ``(n_taxels,)`` or ``(n_taxels, 3)``,
        SI.
        """
        if len(self.parts) == 1:
            return self.parts[0].quantity(name, ground_truth)
        return self._joined([part.quantity(name, ground_truth) for part in self.parts])

    def ambient(self, name: str, t_ns: int, link: str = "") -> np.ndarray | float:
        """Temperature, acceleration or turning of one link of the device; "" the first."""
        part = next((part for part in self.parts if link in part.part.links), self.parts[0])
        return part.ambient(name, t_ns)

    def positions(self, t_s: float) -> np.ndarray:
        """Return all taxels in the world at ``t_s`` [m], shape ``(n_taxels, 3)``."""
        return self._joined([part.positions(t_s) for part in self.parts])

    def normals(self, t_s: float) -> np.ndarray:
        """Their directions out of the skin in the world at ``t_s``, shape ``(n_taxels, 3)``."""
        return self._joined([part.normals(t_s) for part in self.parts])

    def select_taxel(self, taxel: int | None, near: np.ndarray, t_s: float) -> int:
        """Return the taxel that was asked for; ``None``: the one nearest to a point of the world at ``t_s``.

        Raises:
            SceneError: there is none of this number.
        """
        if taxel is None:
            return int(np.argmin(np.linalg.norm(self.positions(t_s) - near, axis=1)))
        if not 0 <= taxel < self.n_taxels:
            raise SceneError(f"taxel: expected 0..{self.n_taxels - 1}, got {taxel}")
        return taxel

    def _joined(self, values: list[np.ndarray]) -> np.ndarray:
        whole = np.empty((self.n_taxels, *values[0].shape[1:]), values[0].dtype)
        for part, own in zip(self.parts, values):
            whole[part.part.taxels] = own
        return whole


class JoinedImperfections:
    """The imperfections of a skin on several bodies, under the numbers of the device's taxels."""

    def __init__(self, parts: Sequence[tuple[Imperfections, np.ndarray]]):
        self._parts = list(parts)

    @property
    def options(self) -> ImperfectionOptions:
        """Of its first part; all were built with the same."""
        return self._parts[0][0].options

    @property
    def adjustable(self) -> tuple[str, ...]:
        """What may be changed of all its parts."""
        return tuple(name for name in self._parts[0][0].adjustable if all(name in s.adjustable for s, _ in self._parts))

    def set(
        self, option: str, value: Any, envs_idx: Sequence[int] | None = None, taxels: Sequence[int] | None = None
    ) -> None:
        """Change one option of all its parts, or of some taxels; a value per taxel goes to each part in its order."""
        if taxels is not None:
            self._set_some(option, value, envs_idx, np.asarray(taxels))
            return
        for spoil, own in self._parts:
            each = np.ndim(value) and len(value) == sum(len(taxels) for _, taxels in self._parts)
            spoil.set(option, np.asarray(value)[own] if each else value, envs_idx)

    def _set_some(self, option: str, value: Any, envs_idx: Sequence[int] | None, taxels: np.ndarray) -> None:
        for spoil, own in self._parts:
            here = [(where[0], k) for k, taxel in enumerate(taxels) if len(where := np.flatnonzero(own == taxel))]
            if here:
                places, which = zip(*here)
                each = np.asarray(value)[list(which)] if np.ndim(value) and len(value) == len(taxels) else value
                spoil.set(option, each, envs_idx, places)

    def set_dead(self, taxels: Sequence[int], dead: bool = True, value: float | None = None) -> None:
        """Let taxels die, or revive them."""
        for spoil, own in self._parts:
            here = np.flatnonzero(np.isin(own, taxels)).tolist()
            if here:
                spoil.set_dead(here, dead, value)
