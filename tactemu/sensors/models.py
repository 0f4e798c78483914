"""The registry of sensor models: one line each, by name. All else about a model stands in its own file.

>>> from tactemu.sensors.models import model_class
>>> model_class("kinematic_taxel").level
2
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_protocols.named_classes import NamedClasses
from tactemu.base.errors import SceneError
from tactemu.base.own_code import load_class

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
"""The models by their names in scene files. Scene files, ``tactemu tune``, the benches, ``docs/sensors.md`` and the
names in :mod:`tactemu` are made from it."""


REGISTRY = NamedClasses("model", "tactemu.models", MODELS, "tactemu.sensors.sensor_model:SensorModel")
"""The models of :data:`MODELS`, of installed packages and of files."""


def model_class(name: str) -> type[SensorModel]:
    """Return the class of a model by its name, or of your own model by ``path/to/file.py:Class``.

    Raises:
        SceneError: there is no such model, or the file raises an error.
    """
    return load_class(REGISTRY, name)


def models_for(quantity: str) -> dict[str, type[SensorModel]]:
    """Return the models that give a quantity (see :data:`firmware_protocols.device.Quantity`), cheapest first."""
    classes = {name: model_class(name) for name in MODELS}
    return {name: model for name, model in classes.items() if quantity in model.layouts}


def cheapest(quantity: str) -> str:
    """Return the name of the first model that gives a quantity; the modules after it are not imported.

    Raises:
        SceneError: no model gives it.
    """
    for name in MODELS:
        if quantity in model_class(name).layouts:
            return name
    raise SceneError(f"no sensor model gives {quantity}; a transducer may (docs/transducers.md)")
