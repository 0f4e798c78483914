"""Readings for a device: pushes along the taxels' normals, other quantities as without contact."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from firmware_protocols.device import Device
from firmware_protocols.senses import Reading, Sense

REST: Mapping[str, Any] = {"temperature": 25.0, "acceleration": (0.0, 0.0, 9.80665)}
"""The values without contact that are not 0, per point, SI with °C."""
NUMBERS_PER_POINT = {"force": 3, "displacement": 3, "acceleration": 3, "angular_velocity": 3, "wrench": 6}
"""The numbers per point of quantities that have several."""
METRES_PER_NEWTON = 1e-4
"""The compliance of the skin, for senses of depth and displacement [m/N]."""

Pushes = ArrayLike | Mapping[str, Any]
"""Pushes: one number for all taxels, one for each, images of patches by name [N], or the pushed taxels of an image,
``{"2,0": 0.5}``; or x, y, z of the force on each taxel, in the frame of its link [N]."""


def forces_of(device: Device, pushes: Pushes) -> np.ndarray:
    """Return the force on each taxel [N], shape ``(n_taxels, 3)``; 0 on patches without an image.

    Raises:
        ValueError: an image has another shape than its patch, or there is no such patch.
    """
    layout = device.layout
    if not isinstance(pushes, Mapping) and np.ndim(pushes) == 2:
        return np.array(np.broadcast_to(np.asarray(pushes, float), layout.positions.shape))
    return -_pushes_of(device, pushes)[:, None] * layout.normals


def _pushes_of(device: Device, pushes: Pushes) -> np.ndarray:
    if not isinstance(pushes, Mapping):
        return np.array(np.broadcast_to(np.asarray(pushes, float), len(device.layout)))
    newtons, patches = np.zeros(len(device.layout)), {patch.name: patch for patch in device.layout.patches}
    for name, rows in pushes.items():
        if name not in patches:
            raise ValueError(f"the example has an image of {name!r}, the layout's patches are {list(patches)}")
        patch = patches[name]
        shape = (patch.rows, patch.cols) if patch.rows else (patch.cols,)
        if isinstance(rows, Mapping):
            image = np.zeros(shape)
            for place, value in rows.items():
                image[tuple(map(int, place.split(",")))] = value
        else:
            image = np.array(rows, float)
        if image.shape != shape:
            raise ValueError(f"patch {name!r} is {_shape_text(shape)}, the example's image {_shape_text(image.shape)}")
        newtons[patch.taxels] = image.ravel()
    return newtons


def _shape_text(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def reading_of(device: Device, pushes: Pushes = 0.0, stream: str = "", **values: ArrayLike) -> Reading:
    """Return the reading of a stream under pushes; ``values`` by sense override it, broadcast over its points.

    Raises:
        ValueError: pushes do not fit the layout, or the stream lacks the sense of a value.
    """
    forces = forces_of(device, pushes)
    forces = np.broadcast_to(np.asarray(values.pop("force", forces), float), forces.shape)
    measured = {}
    for sense in device.senses_of(stream):
        value = values.pop(sense.key, None)
        measured[sense.key] = _measured(sense, device, forces) if value is None else _spread(sense, value)
    if values:
        raise ValueError(f"{device.name} has no sense {sorted(values)}")
    return Reading(measured, stream)


def _measured(sense: Sense, device: Device, forces: np.ndarray) -> np.ndarray:
    layout = device.layout
    if sense.quantity == "force":
        return _spread(sense, forces)
    if sense.quantity == "wrench":
        return _spread(sense, layout.wrenches(forces, sense.at or layout))
    match sense.quantity:
        case "pressure":
            return _spread(sense, layout.push(forces) / layout.areas)
        case "depth":
            return _spread(sense, METRES_PER_NEWTON * layout.push(forces))
        case "displacement":
            return _spread(sense, METRES_PER_NEWTON * forces)
        case "touch":
            return _spread(sense, layout.push(forces) > 0)
        case "vibration":
            return _spread(sense, layout.push(forces).sum() / layout.areas.sum())
    return _spread(sense, REST.get(sense.quantity, 0.0))


def _spread(sense: Sense, value: Any) -> np.ndarray:
    width, n = NUMBERS_PER_POINT.get(sense.quantity), len(sense.at) if sense.at is not None else 0
    value = np.asarray(value)
    value = value if value.dtype == bool else value.astype(float) + 0.0  # no pressure is 0.0, not -0.0
    spread = np.array(np.broadcast_to(value, (n,) if width is None else (n, width)))
    return spread if sense.burst == 1 else np.repeat(spread[..., None], sense.burst, axis=-1)
