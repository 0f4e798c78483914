"""Sensor models by name: one line each. All else about a model stands in its own file.

>>> from tactemu.sensors.models import load
>>> load("kinematic_taxel").level
2
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from tactemu.base.errors import SceneError

if TYPE_CHECKING:
    from tactemu.sensors.sensor_model import SensorModel

MODELS: dict[str, str] = {
    # name in scene files: "module:Class", imported only when asked for; for each quantity the cheapest first
    "contact_probe": "tactemu.sensors.probes.contact_probe:ContactProbe",
    "contact_depth_probe": "tactemu.sensors.probes.contact_depth_probe:ContactDepthProbe",
    "kinematic_taxel": "tactemu.sensors.probes.kinematic_taxel:KinematicTaxel",
    "proximity_taxel": "tactemu.sensors.points.proximity_taxel:ProximityTaxel",
    "elastomer_taxel": "tactemu.sensors.elastomer.elastomer_taxel:ElastomerTaxel",
    "elastic_layer_taxel": "tactemu.sensors.layer.elastic_layer_taxel:ElasticLayerTaxel",
}
"""Scene files, ``tactemu tune``, the benches, ``docs/sensors.md`` and the names in :mod:`tactemu` are made from it."""


def load(name: str) -> type[SensorModel]:
    """Return the class of a model, by its name in :data:`MODELS` or as ``"module:Class"`` of the user's own.

    Raises:
        LookupError: there is none of this name.
    """
    module, _, kind = MODELS.get(name, name).partition(":")
    try:
        return getattr(importlib.import_module(module), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise LookupError(f"no sensor model {name!r}: {error}") from error


def models_for(quantity: str) -> dict[str, type[SensorModel]]:
    """Return the models that give a quantity (see :data:`firmware_protocols.device.Quantity`), cheapest first."""
    loaded = {name: load(name) for name in MODELS}
    return {name: model for name, model in loaded.items() if quantity in model.layouts}


def cheapest(quantity: str) -> str:
    """Name of the first model that gives a quantity; no module behind it is imported.

    Raises:
        SceneError: none gives it.
    """
    for name in MODELS:
        if quantity in load(name).layouts:
            return name
    raise SceneError(f"no sensor model gives {quantity}; a transducer may (docs/transducers.md)")
