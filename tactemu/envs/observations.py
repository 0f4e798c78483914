"""The observed fields of skins, and their spaces: shapes from the layout, limits from the electronics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box

from tactemu.base.errors import SceneError, no_such
from tactemu.imperfections import ChainOptions
from tactemu.sensors.arrays import fields_of
from tactemu.sensors.sensor import Sensor


@dataclass(frozen=True)
class SkinField:
    """A field of a skin's reading in an observation."""

    name: str
    """The name in the observation, ``{skin}_{field}``."""
    skin: str
    field: str
    space: Box
    """The space of one environment's values."""
    unit: str
    taxels: tuple[int, ...]
    """Shape of its values without the vector's axis: that of the layout, behind the number of past readings."""
    history: int
    """Number of past readings that are delivered; 0 without history."""


def skin_fields(sensors: Sequence[Sensor], observed: Mapping[str, Sequence[str]] | None) -> list[SkinField]:
    """Return the observed fields.

    Args:
        sensors: the skins of a scene.
        observed: fields by the skin's name; ``None``: the first field of each skin.

    Raises:
        SceneError: there is no such skin or field.
    """
    skins = {sensor.name: sensor for sensor in sensors}
    if observed is None:
        observed = {name: [*fields_of(sensor)][:1] for name, sensor in skins.items()}
    found = []
    for name, fields in observed.items():
        if name not in skins:
            raise SceneError(f"observed: {no_such('skin', name, skins)}")
        found += [_field(skins[name], field) for field in fields]
    return found


def _field(sensor: Sensor, field: str) -> SkinField:
    fields = fields_of(sensor)
    if field not in fields:
        raise SceneError(f"observed: skin {sensor.name!r} has {no_such('field', field, fields)}")
    chain = sensor._chain
    n_channels = sensor.model.n_channels if chain is None else 3 if chain.output.vector else 1
    width = len(range(*fields[field].indices(n_channels)))
    history = sensor.model.electronics.history_length
    taxels = (history, sensor.n_taxels) if history else sensor.layout
    low, high = _limits(sensor)
    space = Box(low, high, (*taxels, width) if width > 1 else taxels, np.float32)
    units = sensor.unit.split(", ")
    unit = units[[*fields].index(field)] if len(units) == len(fields) else sensor.unit
    return SkinField(f"{sensor.name}_{field}", sensor.name, field, space, unit, taxels, history)


def _limits(sensor: Sensor) -> tuple[float, float]:
    """Return the least and the largest value that a skin can read; without saturation it has none.

    Readings are clipped and then rounded to the quantiser's step; a dead taxel reads a value of its own, and all read 0
    after a reset.
    """
    model = sensor.model
    options = ChainOptions.join(model.imperfections, model.electronics, model.adjustable)
    if options.saturation_range is None:
        return -np.inf, np.inf
    ends = np.array(options.saturation_range, float)
    step = float(np.max(np.asarray(options.resolution, float)))
    if step:
        ends = np.array([np.floor(ends[0] / step), np.ceil(ends[1] / step)]) * step
    ends = [0.0, *ends, *(options.dead_taxel_value_range if options.dead_taxel_probability else ())]
    return float(np.min(ends)), float(np.max(ends))
