"""The USB device that a connector is, for every port that offers one."""

from __future__ import annotations

from firmware_protocols import USB, Bulk, Connector, Hid, Serial
from tactemu.base.errors import TransportError
from tactemu.transports.usb.chip import Chip
from tactemu.transports.usb.raw_devices import BulkDevice, HidDevice
from tactemu.transports.usb.serial_chips import CHIPS, chip_of


def device_of(connector: Connector, address: str, chip: str = "") -> tuple[Chip, int | None]:
    """Return the device of a connector, and the number of its channel; None: any.

    Args:
        connector: the device's connector.
        address: the port's, for messages.
        chip: the name of another chip than the device's own; empty: its own.

    Raises:
        TransportError: the connector is none on USB, or the chip has no place in the device.
    """
    if isinstance(connector, (Hid, Bulk)):
        if chip:
            raise TransportError(f"port '{address}': the device has USB of its own; leave out the chip")
        return (HidDevice(connector) if isinstance(connector, Hid) else BulkDevice(connector)), None
    if not isinstance(connector, Serial):
        raise TransportError(f"port '{address}': the device has no serial port")
    own = chip_of(connector.usb)
    kind = CHIPS[chip] if chip else own
    usb = connector.usb
    identity = usb if kind is own and isinstance(usb, USB) else None  # another chip has its maker's ids
    device = kind(identity)
    return device, identity.interface if identity and len(device.channels) > 1 else None
