"""The behaviour of each kind of line, by connector: one file per connector class, one line in :data:`LINE_MODELS`.

No other part of tactemu depends on the kind of a device's connector.
"""

from __future__ import annotations

import importlib

from firmware_protocols import Can, Connector, Dds, Rs485, Serial, Tcp, Udp, WebSocket
from tactemu.base.errors import DeviceError
from tactemu.wire.line import LineModel, Pacing

LINE_MODELS: dict[type[Connector], str] = {
    # connector: "module:Class", imported only when a device has one
    Can: "tactemu.wire.line_models.can:CanLine",
    Dds: "tactemu.wire.line_models.dds:DdsLine",
    Rs485: "tactemu.wire.line_models.rs485:Rs485Line",
    Serial: "tactemu.wire.line_models.serial:SerialLine",
    Tcp: "tactemu.wire.line_models.network:TcpLine",
    Udp: "tactemu.wire.line_models.network:UdpLine",
    WebSocket: "tactemu.wire.line_models.network:WebSocketLine",
}


def line_model_for(connector: Connector, *, pacing: Pacing = True) -> LineModel:
    """Return the model of the line that a connector is plugged into.

    Raises:
        DeviceError: there is no line model for this kind of connector.
    """
    if type(connector) not in LINE_MODELS:
        known = ", ".join(each.__name__ for each in LINE_MODELS)
        raise DeviceError(f"a {type(connector).__name__} connector has no line model (there are: {known})")
    return line_model_class(type(connector))(connector, pacing=pacing)


def line_model_class(connector: type[Connector]) -> type[LineModel]:
    """Return the class of the line model of a class of connectors."""
    module, _, attribute = LINE_MODELS[connector].partition(":")
    return getattr(importlib.import_module(module), attribute)


def kinds_with(fault: str) -> list[str]:
    """Return the kinds of line that name a fault in their ``faults``."""
    models = map(line_model_class, LINE_MODELS)
    return sorted({model.kind for model in models if fault in model.faults})


__all__ = ["LINE_MODELS", "LineModel", "kinds_with", "line_model_class", "line_model_for"]
