"""The description of a scene: its bodies and skins as data, for everything that draws a scene or names what is in it.

A built scene writes it, and the truth log and the control socket carry it as JSON, which viewers and converters read.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from firmware_protocols import Device
from firmware_protocols.layouts import Layout, Patch
from tactemu.geometry import rotation

if TYPE_CHECKING:
    from tactemu.scene.placement import PlacedSensor, PlacedSkin
    from tactemu.sensors.drawing import DrawOptions
    from tactemu.sensors.simulation import Simulation


def _rounded(values: np.ndarray) -> list:
    """Return values as lists, rounded to a tenth of a micrometre: precise enough to draw, and short."""
    return np.round(np.asarray(values, float), 7).tolist()


def _patch(patch: Patch) -> dict[str, Any]:
    return {name: getattr(patch, name) for name in ("name", "start", "rows", "cols", "pitch")}


_Numbers = Annotated[np.ndarray, PlainValidator(lambda given: np.array(given, float)), PlainSerializer(_rounded)]
"""One number for each taxel or probe."""
_Vectors = Annotated[
    np.ndarray, PlainValidator(lambda given: np.array(given, float).reshape(-1, 3)), PlainSerializer(_rounded)
]
"""One vector for each taxel, probe or point, shape ``(n, 3)``."""
_Pose = Annotated[np.ndarray, PlainValidator(lambda given: np.array(given, float)), PlainSerializer(np.ndarray.tolist)]
"""A position [m] or a quaternion (w, x, y, z)."""
_Indices = Annotated[np.ndarray, PlainValidator(lambda given: np.array(given, int)), PlainSerializer(np.ndarray.tolist)]
_Patch = Annotated[Patch, PlainSerializer(_patch)]


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The points that a sensor has sampled on a body."""

    positions: _Vectors
    """The positions in the frame of the body [m], shape ``(n, 3)``."""
    color: list[float]
    radius: float


@dataclass(frozen=True, eq=False)
class BodyDescription:
    """A body and its initial pose."""

    name: str
    shape: str
    """The kind of the shape; ``frame`` for a body without one."""
    outline: dict[str, Any]
    """The options of the shape, or its ``vertices`` and ``faces``."""
    position: list[float]
    quaternion: list[float]
    skeleton: list[list[float]] | None = None
    """The lines between the joints of a link in its frame, (x, y, z, x, y, z) [m]; None: no link of a mechanism."""
    points: PointCloud | None = None
    """The points that are drawn; None if the sensors draw none."""


@dataclass(frozen=True, eq=False)
class DrawnProbes:
    """The probes of a sensor with ``draw_debug``, in the part's frame."""

    probes: _Vectors
    radii: _Numbers
    probe_color: list[float]
    contact_color: list[float]
    center_radius: float
    opacity: float


@dataclass(frozen=True, eq=False)
class PartDescription:
    """The taxels of a skin on one body, in the frame that ``position`` and ``quaternion`` place on it."""

    name: str
    body: str
    position: _Pose
    quaternion: _Pose
    taxels: _Indices
    """The indices of the taxels in the readings."""
    positions: _Vectors
    normals: _Vectors
    model: str = ""
    """The class of the sensor model."""
    draw: DrawnProbes | None = None
    """The probes that are drawn; None if the sensor draws none."""

    def __post_init__(self):
        if len(self.positions) != len(self.taxels):
            raise ValueError(f"{self.name}: {len(self.positions)} positions of {len(self.taxels)} taxels")


@dataclass(frozen=True)
class SenseDescription:
    """A sense of a device: its quantity, and the number of its points where they are not the taxels."""

    quantity: str = ""
    points: int = 0


@dataclass(frozen=True)
class ColumnDescription:
    """A column of a device's counts."""

    name: str
    axis: str = ""
    unit: str = ""
    sense: str = ""


@dataclass(frozen=True, eq=False)
class SkinDescription:
    """A skin: its device, and its taxels in the device's frame and on bodies."""

    device: str = ""
    title: str = ""
    senses: dict[str, SenseDescription] = field(default_factory=dict)
    columns: list[ColumnDescription] = field(default_factory=list)
    patches: list[_Patch] = field(default_factory=list)
    positions: _Vectors = field(default_factory=lambda: np.zeros((0, 3)))
    normals: _Vectors = field(default_factory=lambda: np.zeros((0, 3)))
    parts: list[PartDescription] = field(default_factory=list)

    @cached_property
    def layout(self) -> Layout:
        """The layout of the taxels; the normals have length 1 again, as rounding has changed their digits."""
        normals = self.normals / np.maximum(np.linalg.norm(self.normals, axis=1, keepdims=True), 1e-9)
        return Layout(positions=self.positions, normals=normals, patches=tuple(self.patches))

    def column_names(self, sense: str) -> list[str]:
        """Return the names of the counts of a taxel of a sense, as far as the device names them."""
        return [each.name for each in self.columns if each.sense in ("", sense) or not sense]


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """The bodies and skins of a scene; without any if nothing is known."""

    bodies: list[BodyDescription] = field(default_factory=list)
    skins: dict[str, SkinDescription] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the description as an object of JSON, in SI units."""
        return _adapter().dump_python(self, exclude_none=True, warnings=False)

    @staticmethod
    def from_json(described: Mapping[str, Any] | None) -> SceneDescription:
        """Return the description that an object of JSON contains; None: an empty one.

        Raises:
            ValueError: the object is malformed.
        """
        try:
            return _adapter().validate_python(described or {})
        except (TypeError, ValueError) as error:
            raise ValueError(f"the description of the scene: {error}") from None


@functools.cache
def _adapter() -> TypeAdapter[SceneDescription]:
    """Return the adapter of the description, which takes 10 ms to make."""
    return TypeAdapter(SceneDescription)


class SceneContext:
    """The bodies and skins of a built scene, for :class:`tactemu.truth.Truth`.

    Args:
        simulation: the built scene; ``None`` if nothing is simulated.
        devices: the device of each skin, by the skin's name.
        skins: the skins that are on bodies.
    """

    def __init__(self, simulation: Simulation | None, devices: Mapping[str, Device], skins: Mapping[str, PlacedSkin]):
        self._simulation, self._devices, self._skins = simulation, devices, skins
        self.names: Sequence[str] = [body.name for body in simulation.bodies] if simulation else []

    def poses(self) -> np.ndarray:
        """Return position and quaternion (w, x, y, z) of each body in environment 0, shape ``(n_bodies, 7)``."""
        return self._simulation._world.poses() if self._simulation else np.zeros((0, 7))

    def description(self) -> dict[str, Any]:
        """Return the :class:`SceneDescription` as an object of JSON."""
        skins = {name: _skin(device, self._skins.get(name)) for name, device in self._devices.items()}
        return SceneDescription(self._bodies(), skins).to_json()

    def _bodies(self) -> list[BodyDescription]:
        if self._simulation is None:
            return []
        sensors = [part.sensor for skin in self._skins.values() for part in skin.parts]
        drawn = next((sensor.model.draw for sensor in sensors if sensor.model.draw.draw_debug), None)
        clouds = {cloud.body: _points(cloud.positions, drawn) for cloud in self._simulation._clouds if drawn}
        return [
            BodyDescription(
                name=body.name,
                shape=type(body.shape).__name__.lower() if body.shape else "frame",
                outline=body.shape.outline(body.name) if body.shape else {},
                position=list(body.position),
                quaternion=list(body.quaternion),
                skeleton=body.skeleton,
                points=clouds.get(body.index),
            )
            for body in self._simulation.bodies
        ]


def _skin(device: Device, placed: PlacedSkin | None) -> SkinDescription:
    layout = device.layout
    return SkinDescription(
        device=device.name,
        title=device.title,
        senses={
            sense.key: SenseDescription(sense.quantity, len(sense.at) if sense.at else 0) for sense in device.sensed
        },
        columns=[ColumnDescription(each.name, each.axis, each.unit, each.sense) for each in device.columns],
        patches=list(layout.patches),
        positions=layout.positions,
        normals=layout.normals,
        parts=[_part(part) for part in placed.parts] if placed else [],
    )


def _points(positions: np.ndarray, draw: DrawOptions) -> PointCloud:
    return PointCloud(positions, list(draw.debug_point_cloud_color), draw.debug_point_cloud_radius)


def _part(placed: PlacedSensor) -> PartDescription:
    part, sensor = placed.part, placed.sensor
    return PartDescription(
        name=part.name,
        body=sensor.link.name,
        position=np.asarray(part.position, float),
        quaternion=np.asarray(part.quaternion, float),
        taxels=part.taxels,
        positions=part.layout.positions,
        normals=part.layout.normals,
        model=type(sensor.model).__name__,
        draw=_probes(placed) if sensor.model.draw.draw_debug else None,
    )


def _probes(placed: PlacedSensor) -> DrawnProbes:
    part, sensor, draw = placed.part, placed.sensor, placed.sensor.model.draw
    back = rotation.conjugate(rotation.normalised(part.quaternion))
    return DrawnProbes(
        probes=rotation.rotate(back, sensor.positions.reshape(-1, 3) - np.asarray(part.position)),
        radii=sensor.radii.reshape(-1),
        probe_color=list(draw.debug_probe_color),
        contact_color=list(draw.debug_contact_color),
        center_radius=draw.debug_probe_center_radius,
        opacity=draw.debug_probe_sphere_opacity,
    )
