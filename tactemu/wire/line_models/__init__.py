"""The behaviour of each kind of line: a file with a :class:`LineModel`, which names the connectors that it is for.

No other part of tactemu depends on the kind of a device's connector.
"""

from __future__ import annotations

import importlib
import pkgutil

from firmware_protocols import Connector
from tactemu.base.errors import DeviceError
from tactemu.wire.line import LINE_MODELS, LineModel, Pacing

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)


def line_model_for(connector: Connector, *, pacing: Pacing = True) -> LineModel:
    """Return the model of the line that a connector is plugged into.

    Raises:
        DeviceError: there is no line model for this kind of connector.
    """
    if type(connector) not in LINE_MODELS:
        known = ", ".join(sorted(each.__name__ for each in LINE_MODELS))
        raise DeviceError(f"a {type(connector).__name__} connector has no line model (there are: {known})")
    return LINE_MODELS[type(connector)](connector, pacing=pacing)


def kinds_with(fault: str) -> list[str]:
    """Return the kinds of line that name a fault in their ``faults``."""
    return sorted({model.kind for model in LINE_MODELS.values() if fault in model.faults})


def modelled_for(fault: str) -> list[str]:
    """Return the kinds of line of which only the model can have a fault, not a real line."""
    return sorted({model.kind for model in LINE_MODELS.values() if fault in model.only_modelled})


def network_schemes() -> list[str]:
    """Return the schemes of the ports on the machine's network."""
    return sorted({scheme for model in LINE_MODELS.values() if model.is_network for scheme in model.schemes})


__all__ = ["LINE_MODELS", "LineModel", "kinds_with", "line_model_for", "modelled_for", "network_schemes"]
