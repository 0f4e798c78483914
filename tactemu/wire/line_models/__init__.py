"""How each kind of line behaves, by connector: one file per connector class, one line in :data:`CARRIERS`.

Nothing else in tactemu asks what kind of connector a device has.
"""

from __future__ import annotations

import importlib

from firmware_protocols import Can, Connector, Dds, Rs485, Serial, Tcp, Udp, WebSocket
from tactemu.base.errors import DeviceError
from tactemu.wire.line_models.line_model import Carrier, Pacing

CARRIERS: dict[type[Connector], str] = {
    # connector: "module:Class", imported only when a device has one
    Can: "tactemu.wire.line_models.can:CanCarrier",
    Dds: "tactemu.wire.line_models.dds:DdsCarrier",
    Rs485: "tactemu.wire.line_models.rs485:Rs485Carrier",
    Serial: "tactemu.wire.line_models.serial:SerialCarrier",
    Tcp: "tactemu.wire.line_models.tcp:TcpCarrier",
    Udp: "tactemu.wire.line_models.udp:UdpCarrier",
    WebSocket: "tactemu.wire.line_models.websocket:WebSocketCarrier",
}


def carrier_of(connector: Connector, *, pacing: Pacing = True) -> Carrier:
    """The line that a connector is plugged into.

    Raises:
        DeviceError: there is no carrier for this kind of connector.
    """
    if type(connector) not in CARRIERS:
        known = ", ".join(each.__name__ for each in CARRIERS)
        raise DeviceError(f"a {type(connector).__name__} connector has no carrier (there are: {known})")
    module, _, attribute = CARRIERS[type(connector)].partition(":")
    return getattr(importlib.import_module(module), attribute)(connector, pacing=pacing)


__all__ = ["CARRIERS", "Carrier", "carrier_of"]
