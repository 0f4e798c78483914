"""``gadget:NAME:CONTROLLER``: the sensor on this machine's own USB device port, at the end of a cable.

``tactemu gadget`` makes the gadget NAME, with a FunctionFS for this port, and runs the device. A driver is there while
the host has DTR up, or has configured a device without a serial port. A board's own CDC-ACM needs no such port: the
kernel has a function for it, and ``serial:/dev/ttyGS0`` is the sensor's side of it.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from firmware_protocols import Connector, WireFrame
from tactemu.base.errors import TransportError, reason_of
from tactemu.transports.transport import MAX_CHUNK_BYTES, Event, Noted, Received
from tactemu.transports.usb.chip import MAX_TO_HOST_BYTES
from tactemu.transports.usb.devices import device_of
from tactemu.transports.usb.functionfs import FunctionFs
from tactemu.transports.usb.port import UsbPort
from tactemu.transports.usb.raw_devices import HidDevice
from tactemu.transports.usb.serial_chips import CdcAcm, Ft232R

GADGETS = Path("/sys/kernel/config/usb_gadget")
CONTROLLERS = Path("/sys/class/udc")


def mount_of(name: str) -> Path:
    """Return the folder where the FunctionFS of a gadget is mounted."""
    return Path(f"/dev/ffs-{name}")


class GadgetTransport(UsbPort):
    """A USB device on this machine's device controller.

    Raises:
        TransportError: the address names no gadget.
    """

    scheme = "gadget"

    def __init__(self, location: str = ""):
        super().__init__(Ft232R())
        self._name, _, self._controller = location.partition(":")
        if not self._name:
            raise TransportError("port 'gadget:': expected gadget:NAME, as `tactemu gadget` makes it")
        self.address = f"gadget:{location}"
        self._function: FunctionFs | None = None

    def set_connector(self, connector: Connector) -> None:
        """Take the device from the connector.

        Raises:
            TransportError: it is none on USB, or a board's own CDC-ACM.
        """
        self._device, number = device_of(connector, self.address)
        if isinstance(self._device, CdcAcm):
            raise TransportError(f"port '{self.address}': the kernel has CDC-ACM; use serial:/dev/ttyGS0")
        self._chip = self._device.channels[number or 0]

    def open(self) -> None:
        """Offer the device to the host at the other end of the cable.

        Raises:
            TransportError: there is no such gadget, no controller, or either is in use.
        """
        if self._function is not None:
            return
        gadget = GADGETS / self._name
        if not gadget.exists():
            raise TransportError(f"there is no gadget {self._name}; sudo $(which tactemu) gadget ... makes it")
        controllers = sorted(each.name for each in CONTROLLERS.glob("*"))
        controller = self._controller or next(iter(controllers), "")
        if not controller:
            raise TransportError("this machine has no USB device controller")
        try:
            self._function = FunctionFs(mount_of(self._name), self._device, self._chip)
            (gadget / "UDC").write_text(controller)
        except OSError as error:
            self.close()
            raise TransportError(f"gadget {self._name} on {controller}: {reason_of(error)}") from None

    def close(self) -> None:
        """Pull the cable: the host's node goes. Safe to call twice."""
        function, self._function = self._function, None
        if function is not None:
            with contextlib.suppress(OSError):
                (GADGETS / self._name / "UDC").write_text("\n")
            function.close()
        self._forget()

    def filenos(self, reading: bool = True) -> list[int]:
        """Return the file descriptors of the function."""
        return self._function.filenos() if self._function is not None else []

    def poll(self, reading: bool = True) -> list[Event]:
        """Return a host that comes and goes, a driver that opens and closes the port, its settings and its bytes."""
        function = self._function
        if function is None:
            return []
        was_enabled = function.is_enabled
        function.serve()
        if function.is_enabled != was_enabled:
            self._events.append(Noted("configured by the host" if function.is_enabled else "detached by the host"))
        self._note_chip()
        had_reader = self._has_reader
        self._note_reader(function.is_enabled and (self._chip.lines.dtr or self._chip.is_framed))
        if had_reader and not self._has_reader:
            function.clear()
        room = MAX_CHUNK_BYTES if reading else 0
        while room > 0 and (data := function.take()) is not None:
            self._events.append(Received(data))
            room -= len(data)
        return self._take_events()

    def write(self, frame: WireFrame) -> bool:
        """Write one frame; ``False`` where no driver has the port open, or does not read."""
        if not isinstance(frame, bytes):
            raise TransportError(f"a USB device cannot carry the CAN frame {frame}")
        # A host without a program that reads a HID asks for no report: what waited would be stale.
        most = 2 * len(frame) if isinstance(self._chip, HidDevice) else MAX_TO_HOST_BYTES
        if self._function is None or not self._has_reader or self._function.waiting_bytes + len(frame) > most:
            return False
        self._function.put(frame)
        return True
