"""How each kind of line behaves, by connector: one file per connector class, one line in :data:`CARRIERS`.

Nothing else in tactemu asks what kind of connector a device has.
"""

from __future__ import annotations

import importlib

from firmware_protocols import Can, Connector, Dds, Rs485, Serial, Tcp, Udp, WebSocket
from tactemu.errors import DeviceError
from tactemu.wire.carriers.carrier import Carrier, Pacing

CARRIERS: dict[type[Connector], str] = {
    # connector: "module:Class", imported only when a device has one
    Can: "tactemu.wire.carriers.can:CanCarrier",
    Dds: "tactemu.wire.carriers.dds:DdsCarrier",
    Rs485: "tactemu.wire.carriers.rs485:Rs485Carrier",
    Serial: "tactemu.wire.carriers.serial:SerialCarrier",
    Tcp: "tactemu.wire.carriers.tcp:TcpCarrier",
    Udp: "tactemu.wire.carriers.udp:UdpCarrier",
    WebSocket: "tactemu.wire.carriers.websocket:WebSocketCarrier",
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
