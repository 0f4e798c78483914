"""A device on its link: positions of its taxels, readings of its senses in the device's frame, auxiliary sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from firmware_protocols import Device, Sense
from firmware_protocols.senses import CONTACT, DERIVED, VECTORS
from tactemu.base.errors import SceneError
from tactemu.base.options import numbers
from tactemu.geometry import rotation
from tactemu.geometry.motion import Pose
from tactemu.scene.skins import SkinPart

if TYPE_CHECKING:
    from tactemu.imperfections import ChainOptions, Imperfections
    from tactemu.sensors.sensor import Sensor
    from tactemu.sensors.sensor_model import SensorModel

GRAVITY = (0.0, 0.0, 9.80665)
"""The reading of an accelerometer at rest in the world's frame [m/s²], which points up."""
AMBIENT = {"temperature": 25.0, "acceleration": GRAVITY, "angular_velocity": (0.0, 0.0, 0.0)}
"""The default temperature [°C], proper acceleration [m/s²] and angular velocity [rad/s] of a device."""
_HALF_STEP_S = 1e-4


class PlacedSensor:
    """A built sensor on its body, with vectors in the frame of the device or link that it belongs to.

    Args:
        sensor: the handle that :meth:`tactemu.Scene.add_sensor` returned.
        part: the sensor's taxels and their place on the body.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("sensor", "part", "_to_link", "_back", "_turned", "_course")

    def __init__(self, sensor: Sensor, part: SkinPart):
        self.sensor, self.part = sensor, part
        self._to_link = rotation.normalised(part.quaternion)
        self._back = rotation.conjugate(self._to_link)
        self._turned = not np.array_equal(self._to_link, rotation.IDENTITY)
        course = sensor.model.electronics.temperature_course
        self._course = None if course is None else numbers(f"sensor {sensor.name!r}", "temperature_course", course)
        self._before: tuple[float, np.ndarray] | None = None
        """The time of the last reading of a link that is posed by hand [s], and its velocity then [m/s]."""

    def positions(self, t_s: float) -> np.ndarray:
        """Return the world positions of the taxels at ``t_s`` [m], shape ``(n_taxels, 3)``."""
        link = self._link(t_s)
        on_link = rotation.rotate(self._to_link, self.part.layout.positions) + self.part.position
        return link.position + rotation.rotate(link.quaternion, on_link)

    def normals(self, t_s: float) -> np.ndarray:
        """Return the world normals of the taxels, out of the skin, at ``t_s``, shape ``(n_taxels, 3)``."""
        turn = rotation.multiply(self._link(t_s).quaternion, self._to_link)
        return rotation.rotate(turn, self.part.layout.normals)

    def _link(self, t_s: float) -> Pose:
        """Return the pose of the link: by its motion at ``t_s``, else as it was posed last."""
        link = self.sensor.link
        return link.pose(t_s) if link.motion is not None or link.fixed else self.sensor.link_pose()

    @property
    def imperfections(self) -> Imperfections | None:
        """The imperfections of the sensor."""
        return self.sensor.imperfections

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading in the device's frame, in SI units, shape ``(n_taxels,)`` or ``(n_taxels, 3)``."""
        values = self.sensor.quantity(name, ground_truth)
        return self.to_device_frame(values) if self._turned and values.ndim == 2 else values

    def to_device_frame(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors of the link's frame, ``(..., 3)``, in the device's frame."""
        return rotation.rotate(self._back, vectors) if self._turned else vectors

    def ambient(self, name: str, t_ns: int) -> np.ndarray | float:
        """Return the reading of an auxiliary sensor beside the taxels, in the device's frame.

        ``temperature`` follows the sensor's course; ``acceleration`` and ``angular_velocity`` follow the link's motion.

        The accelerometer is at the link's origin. A link that is posed by hand has the angular velocity that
        :meth:`Simulation.set_pose` was given; its acceleration follows from the given velocity and that of the last
        reading. Without given velocities the link is at rest.
        """
        t_s = t_ns * 1e-9
        if name == "temperature":
            return AMBIENT[name] if self._course is None else float(np.interp(t_s, *self._course.T))
        pose = self._link(t_s)
        to_device = rotation.conjugate(rotation.multiply(pose.quaternion, self._to_link))
        vector = self._acceleration(t_s) + GRAVITY if name == "acceleration" else pose.angular_velocity
        return rotation.rotate(to_device, vector)

    def _acceleration(self, t_s: float) -> np.ndarray:
        link = self.sensor.link
        if link.motion is None and not link.fixed:
            return self._change(t_s, self.sensor.link_pose().linear_velocity)
        before, after = (link.pose(max(0.0, t_s + dt)).linear_velocity for dt in (-_HALF_STEP_S, _HALF_STEP_S))
        return (after - before) / (2 * _HALF_STEP_S)

    def _change(self, t_s: float, velocity: np.ndarray) -> np.ndarray:
        """Return the acceleration [m/s²] since the last reading; 0 at the first one and after time restarts."""
        before, self._before = self._before, (t_s, velocity)
        if before is None or before[0] >= t_s:
            return np.zeros(3)
        return (velocity - before[1]) / (t_s - before[0])


class PlacedSkin:
    """A device's skin on one body or several: readings and positions of its taxels, in the device's order."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("n_taxels",)

    wrench = None
    """No wrench is given: it follows from the forces."""

    def __init__(self, parts: Sequence[PlacedSensor], n_taxels: int):
        self.parts = list(parts)
        self.n_taxels = n_taxels

    @property
    def model(self) -> SensorModel:
        """The model of the first sensor; all are of one class."""
        return self.parts[0].sensor.model

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """The imperfections of its sensors, which you may change while the scene runs."""
        if len(self.parts) == 1:
            return self.parts[0].imperfections
        return JoinedImperfections(
            [(part.imperfections, part.part.taxels) for part in self.parts if part.imperfections]
        )

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading in the frames of the device's links, in SI units.

        The shape is ``(n_taxels,)`` or ``(n_taxels, 3)``.
        """
        if len(self.parts) == 1:
            return self.parts[0].quantity(name, ground_truth)
        return self._joined([part.quantity(name, ground_truth) for part in self.parts])

    def ambient(self, name: str, t_ns: int, link: str = "") -> np.ndarray | float:
        """Return the temperature, acceleration or angular velocity of one link of the device; "" is the first."""
        parts = self.parts
        part = parts[0] if len(parts) == 1 else next((each for each in parts if link in each.part.links), parts[0])
        return part.ambient(name, t_ns)

    def positions(self, t_s: float) -> np.ndarray:
        """Return the world positions of all taxels at ``t_s`` [m], shape ``(n_taxels, 3)``."""
        return self._joined([part.positions(t_s) for part in self.parts])

    def normals(self, t_s: float) -> np.ndarray:
        """Return the world normals of all taxels, out of the skin, at ``t_s``, shape ``(n_taxels, 3)``."""
        return self._joined([part.normals(t_s) for part in self.parts])

    def select_taxel(self, taxel: int | None, near: np.ndarray, t_s: float) -> int:
        """Return ``taxel`` if there is such a taxel; ``None`` selects the one nearest to a world point at ``t_s``.

        Raises:
            SceneError: there is no taxel of this number.
        """
        if taxel is None:
            return int(np.argmin(np.linalg.norm(self.positions(t_s) - near, axis=1)))
        if not 0 <= taxel < self.n_taxels:
            raise SceneError(f"taxel: expected 0..{self.n_taxels - 1}, got {taxel}")
        return taxel

    def _joined(self, values: list[np.ndarray]) -> np.ndarray:
        joined = np.empty((self.n_taxels, *values[0].shape[1:]), values[0].dtype)
        for part, own in zip(self.parts, values):
            joined[part.part.taxels] = own
        return joined


class JoinedImperfections:
    """The imperfections of a skin on several bodies, indexed by the device's taxels."""

    def __init__(self, parts: Sequence[tuple[Imperfections, np.ndarray]]):
        self._parts = list(parts)

    @property
    def options(self) -> ChainOptions:
        """The options of the first part; all parts have the same."""
        return self._parts[0][0].options

    @property
    def adjustable(self) -> tuple[str, ...]:
        """The options that can change in all parts."""
        return tuple(name for name in self._parts[0][0].adjustable if all(name in s.adjustable for s, _ in self._parts))

    def set(
        self, option: str, value: Any, envs: Sequence[int] | None = None, taxels: Sequence[int] | None = None
    ) -> None:
        """Change one option of all parts, or of some taxels; a value per taxel is in the device's order."""
        if taxels is not None:
            self._set_some(option, value, envs, np.asarray(taxels))
            return
        for imperfections, own in self._parts:
            each = np.ndim(value) and len(value) == sum(len(taxels) for _, taxels in self._parts)
            imperfections.set(option, np.asarray(value)[own] if each else value, envs)

    def _set_some(self, option: str, value: Any, envs: Sequence[int] | None, taxels: np.ndarray) -> None:
        for imperfections, own in self._parts:
            here = [(where[0], k) for k, taxel in enumerate(taxels) if len(where := np.flatnonzero(own == taxel))]
            if here:
                places, which = zip(*here)
                each = np.asarray(value)[list(which)] if np.ndim(value) and len(value) == len(taxels) else value
                imperfections.set(option, each, envs, places)

    def set_dead(self, taxels: Sequence[int], dead: bool = True, value: float | None = None) -> None:
        """Make taxels dead, or revive them."""
        for imperfections, own in self._parts:
            here = np.flatnonzero(np.isin(own, taxels)).tolist()
            if here:
                imperfections.set_dead(here, dead, value)


class SkinReadings(Protocol):
    """The readings of one skin: of a placed sensor, a recording, or the user's function."""

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return the latest reading of environment 0, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI, device's
        frame.
        """
        ...

    def ambient(self, name: str, t_ns: int, link: str = "") -> Any:
        """Return ``temperature``, ``acceleration`` or ``angular_velocity`` of a link of the device; "" is the first."""
        ...

    @property
    def wrench(self) -> np.ndarray | None:
        """Force and torque [N, Nm], shape ``(6,)`` or ``(n, 6)``; ``None``: they follow from the taxels' forces."""
        ...

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """The imperfections of the readings; ``None`` for a recording."""
        ...


class SenseReader:
    """The senses of a device on a skin: a :class:`~tactemu.emulator.channel.Source`.

    Args:
        skin: the readings of the taxels, in the order of the device's layout.
        device: the device, whose motors measure their loads, too.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_layout", "_device")
    _ambient: dict[str | tuple[str, str], np.ndarray]
    """The ambient quantities at one time, by quantity and link; and the readings of their senses, by key."""

    def __init__(self, skin: SkinReadings, device: Device):
        self.skin = skin
        self._layout, self._device = device.layout, device
        self._ambient_ns, self._ambient = -1, {}

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """The imperfections of the readings, which can change while it runs; ``None`` for a recording."""
        return self.skin.imperfections

    def read(self, senses: Iterable[Sense], t_ns: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Return the ideal and the measured readings of senses now; shapes as in
        :data:`firmware_protocols.device.Quantity`."""
        ideal: dict[str, np.ndarray] = {}
        measured: dict[str, np.ndarray] = {}
        for sense in senses:
            key, quantity = sense.key, sense.quantity
            if quantity in CONTACT:
                ideal[key] = self.skin.quantity(quantity, ground_truth=True)
                measured[key] = self.skin.quantity(quantity)
            elif quantity in DERIVED:
                ideal[key] = self._derived(sense, ground_truth=True)
                measured[key] = self._derived(sense)
            elif quantity == "load":
                ideal[key] = measured[key] = self._loads(sense)
            else:
                ideal[key] = measured[key] = self._around(sense, t_ns)
        return ideal, measured

    def _derived(self, sense: Sense, ground_truth: bool = False) -> np.ndarray:
        """Return a reading that follows from those of all taxels together."""
        at: Any = sense.at
        if sense.quantity == "wrench" and (wrench := self.skin.wrench) is not None:
            return np.broadcast_to(wrench, (len(at), 6))
        forces = self.skin.quantity("force", ground_truth)
        if sense.quantity == "wrench":
            return self._layout.wrenches(forces, at)
        return np.full(len(at), self._layout.push(forces).sum() / self._layout.areas.sum())

    def _loads(self, sense: Sense) -> np.ndarray:
        """Return the torques of an engine's joints on the motors; zeros without an engine."""
        at: Any = sense.at
        motors = self._device.drives
        return np.zeros(len(at)) if motors is None or not motors.is_in_engine else motors.loads()

    def _around(self, sense: Sense, t_ns: int) -> np.ndarray:
        """Return an ambient reading, which is read once for all conversions of one time."""
        if self._ambient_ns != t_ns:
            self._ambient_ns, self._ambient = t_ns, {}
        at: Any = sense.at
        found, quantity = self._ambient, sense.quantity
        if sense.key not in found:
            if len(at.links) == 1:
                found[sense.key] = self._at(t_ns, quantity, at.links[0])[None].repeat(len(at), axis=0)
            else:
                values = [self._at(t_ns, quantity, patch.link) for patch in at.patches]
                found[sense.key] = np.repeat(values, [len(patch) for patch in at.patches], axis=0)
        return found[sense.key]

    def _at(self, t_ns: int, quantity: str, link: str) -> np.ndarray:
        found = self._ambient
        if (quantity, link) not in found:
            found[quantity, link] = np.asarray(self.skin.ambient(quantity, t_ns, link), float)
        return found[quantity, link]


class NullSource:
    """The readings of a device without taxels."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ()
    imperfections = None
    wrench = None

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """Return an empty array, shape ``(0, 3)`` or ``(0,)``."""
        return np.zeros((0, 3) if name in VECTORS else 0)

    def ambient(self, name: str, t_ns: int, link: str = "") -> Any:
        """Return room temperature, or the motion of a link at rest."""
        return AMBIENT[name]
