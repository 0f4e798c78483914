"""The description of a scene as plain data, which the truth log contains so that viewers can draw the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from firmware_protocols import Device
from tactemu.geometry import rotation
from tactemu.scene.placement import PlacedSensor, PlacedSkin

if TYPE_CHECKING:
    from tactemu.sensors.sensor_model import SensorModel
    from tactemu.sensors.simulation import Simulation


class SceneDescription:
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
        return self._simulation.world.poses() if self._simulation else np.zeros((0, 7))

    def description(self) -> dict[str, Any]:
        """Return bodies with their shapes and start poses, and skins with senses, patches and taxels, in SI units."""
        return {
            "bodies": self._bodies(),
            "skins": {name: self._skin(device, self._skins.get(name)) for name, device in self._devices.items()},
        }

    def _bodies(self) -> list[dict[str, Any]]:
        if self._simulation is None:
            return []
        sensors = [part.sensor for skin in self._skins.values() for part in skin.parts]
        drawn = next((sensor.model for sensor in sensors if sensor.model.draw_debug), None)
        clouds = {cloud.body: _points(cloud.positions, drawn) for cloud in self._simulation.clouds if drawn}
        return [
            {
                "name": body.name,
                "shape": type(body.shape).__name__.lower() if body.shape else "frame",
                "outline": body.shape.outline(body.name) if body.shape else {},
                "position": list(body.position),
                "quaternion": list(body.quaternion),
                **({"points": clouds[body.index]} if body.index in clouds else {}),
            }
            for body in self._simulation.bodies
        ]

    def _skin(self, device: Device, placed: PlacedSkin | None) -> dict[str, Any]:
        layout = device.layout
        return {
            "device": device.name,
            "title": device.title,
            "senses": {
                sense.key: {"quantity": sense.quantity, "points": len(sense.at) if sense.at else 0}
                for sense in device.sensed
            },
            "columns": [
                {"name": column.name, "axis": column.axis, "unit": column.unit, "sense": column.sense}
                for column in device.columns
            ],
            "patches": [
                {"name": each.name, "start": each.start, "rows": each.rows, "cols": each.cols, "pitch": each.pitch}
                for each in layout.patches
            ],
            "positions": _listed(layout.positions),
            "normals": _listed(layout.normals),
            "parts": [_part(part) for part in placed.parts] if placed else [],
        }


def _points(positions: np.ndarray, model: SensorModel) -> dict[str, Any]:
    colour, radius = list(model.debug_point_cloud_color), model.debug_point_cloud_radius
    return {"positions": _listed(positions), "color": colour, "radius": radius}


def _part(placed: PlacedSensor) -> dict[str, Any]:
    """Return the taxels of one body, and its probes, in the frame that ``position`` and ``quaternion`` place on it."""
    part, sensor = placed.part, placed.sensor
    described = {
        "name": part.name,
        "body": sensor.link.name,
        "position": list(map(float, part.position)),
        "quaternion": list(map(float, part.quaternion)),
        "taxels": part.taxels.tolist(),
        "positions": _listed(part.layout.positions),
        "normals": _listed(part.layout.normals),
        "model": type(sensor.model).__name__,
    }
    if sensor.model.draw_debug:
        model, back = sensor.model, rotation.conjugate(rotation.normalised(part.quaternion))
        described["draw"] = {
            "probes": _listed(rotation.rotate(back, sensor.probes.positions - np.asarray(part.position))),
            "radii": _listed(sensor.probes.radii),
            "probe_color": list(model.debug_probe_color),
            "contact_color": list(model.debug_contact_color),
            "center_radius": model.debug_probe_center_radius,
            "opacity": model.debug_probe_sphere_opacity,
        }
    return described


def _listed(values: np.ndarray) -> list:
    """Return values as lists, rounded to a tenth of a micrometre: precise enough to draw, and short."""
    return np.round(np.asarray(values, float), 7).tolist()
