"""The ports of the emulator, by scheme: ``memory:``, ``pty:PATH``, ``can:INTERFACE:CHANNEL``, ``tcp:HOST:PORT`` ...

A new transport is one file, one line in :data:`TRANSPORTS` and one driver's end in ``tests/transports``.
"""

from __future__ import annotations

import importlib
import re

from tactemu.base.errors import TransportError, TransportUnavailable, nearest
from tactemu.transports.transport import Transport

TRANSPORTS: dict[str, str] = {
    # scheme: "module:Class [extra]", imported only when asked for; Class(rest_of_the_address); the extra of tactemu to
    # install for an optional library
    "can": "tactemu.transports.can:CanTransport",
    "dds": "tactemu.transports.dds:DdsTransport [dds]",
    "gadget": "tactemu.transports.gadget:GadgetTransport",
    "gsusb": "tactemu.transports.gsusb:GsUsbTransport",
    "i2cdriver": "tactemu.transports.i2cdriver:I2cDriverTransport",
    "memory": "tactemu.transports.memory:MemoryTransport",
    "pty": "tactemu.transports.pty:PtyTransport",
    "rfc2217": "tactemu.transports.rfc2217:Rfc2217Transport",
    "serial": "tactemu.transports.serial_port:SerialPortTransport",
    "slcan": "tactemu.transports.slcan:SlcanTransport",
    "socketcand": "tactemu.transports.socketcand:SocketcandTransport",
    "tcp": "tactemu.transports.tcp:TcpTransport",
    "udp": "tactemu.transports.udp:UdpTransport",
    "udpto": "tactemu.transports.udp_to:UdpToTransport",
    "usbip": "tactemu.transports.usbip:UsbIpTransport",
    "ws": "tactemu.transports.ws:WebSocketTransport [websocket]",
}

INTERFACE_TRANSPORTS = {"can:socketcan": "tactemu.transports.socketcan:SocketCanTransport"}
"""Transports of single interfaces, in place of that of their scheme."""

__all__ = ["TRANSPORTS", "Transport", "create"]


def create(port: str) -> Transport:
    """Return the transport for ``scheme:location``, not yet open.

    Raises:
        TransportError: unknown scheme, or an address that cannot be parsed.
        TransportUnavailable: its library is not installed.
    """
    scheme, _, location = port.partition(":")
    if scheme not in TRANSPORTS:
        if re.match(r"/dev/(tty[A-Z]|serial/)", scheme):
            raise TransportError(
                f"port {port!r}: for a driver at the other end of its cable, write 'serial:{port}'; "
                "to make a virtual port of your own, name another path, such as 'pty:/tmp/skin'"
            )
        if scheme.startswith(("/", ".", "~")):
            raise TransportError(f"port {port!r}: a path needs its scheme; did you mean 'pty:{port}'?")
        hint = nearest(scheme, TRANSPORTS) or f"; expected one of {', '.join(sorted(TRANSPORTS))}"
        raise TransportError(f"port {port!r}: unknown scheme {scheme!r}{hint}")
    interface = port[: port.find(":", len(scheme) + 1)]
    target, _, extra = INTERFACE_TRANSPORTS.get(interface, TRANSPORTS[scheme]).partition(" ")
    module, _, attribute = target.partition(":")
    try:
        transport = getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        if not extra:
            raise
        raise TransportUnavailable(f"port {port!r} needs {error.name}: pip install 'tactemu{extra}'") from error
    return transport(location)
