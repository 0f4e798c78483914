"""USB devices without a serial port: a HID, whose reports hidraw, hidapi and libusb read, and a vendor's class.

Requests and descriptors are those of the class definition HID 1.11; Linux 6.1, ``drivers/hid/usbhid/hid-core.c``, and
libusb send them.
"""

from __future__ import annotations

import struct

from firmware_protocols import Bulk, Hid
from tactemu.transports.usb.chip import CLASS, DONE, Chip, Setup
from tactemu.transports.usb.descriptors import Descriptors, Endpoint, Interface, descriptor

_HID, _REPORT = 0x21, 0x22
"""Types of descriptors: of the class HID, and of the format of reports."""
_SET_REPORT = 9
_INPUT, _OUTPUT = 1, 2
"""Types of reports."""


class HidDevice(Chip):
    """A device of the class HID with one interface.

    Args:
        connector: its identity and its reports.
    """

    data_in, data_out = 0x81, 0x02
    is_framed = True

    def __init__(self, connector: Hid):
        super().__init__(connector.usb)
        self._connector = connector
        self._newest = bytes(connector.input_bytes)
        """The last report, for a host that asks by a control request."""

    def descriptors(self) -> Descriptors:
        """Return the descriptors: one interface, with the class's own before its endpoints."""
        own = self._connector
        vid, pid = self.ids(0, 0)
        ends = [Endpoint(self.data_in, "interrupt", own.input_bytes, own.interval_ms)]
        if own.output_bytes:
            ends.append(Endpoint(self.data_out, "interrupt", own.output_bytes, own.interval_ms))
        return Descriptors(vid, pid, 0x0100, (Interface((3, 0, 0), ends, extra=self._class()),), self.named("", ""))

    def _class(self) -> bytes:
        return descriptor(_HID, struct.pack("<HBBBH", 0x0111, 0, 1, _REPORT, len(self._connector.report_descriptor)))

    def descriptor(self, kind: int, number: int) -> bytes | None:
        """Return a descriptor by its type and number, those of the class too, or None if there is none."""
        return {_HID: self._class(), _REPORT: self._connector.report_descriptor}.get(kind) or (
            super().descriptor(kind, number)
        )

    def takes(self, setup: Setup) -> bool:
        """Return True for an output report that comes as a control request."""
        return setup.type == CLASS and setup.request == _SET_REPORT and setup.value >> 8 == _OUTPUT

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out the requests of the class: the last input report, idle rate, protocol; no feature reports."""
        if setup.type != CLASS:
            return None
        match setup.request:
            case 1 if setup.value >> 8 == _INPUT:  # GET_REPORT
                return self._newest
            case 2:  # GET_IDLE: reports are sent when there is something new
                return b"\0"
            case 3:  # GET_PROTOCOL: that of the report descriptor
                return b"\1"
            case 10 | 11:  # SET_IDLE, SET_PROTOCOL
                return DONE
        return None

    def packets_to_host(self, data: bytearray, length: int) -> bytes:
        """Return one report."""
        self._newest = super().packets_to_host(data, length)
        return self._newest


class BulkDevice(Chip):
    """A device of the vendor's class with two bulk endpoints, which is read as soon as it is configured.

    Args:
        connector: its identity and endpoints.
    """

    listens_when_configured = True
    is_framed = True

    def __init__(self, connector: Bulk):
        super().__init__(connector.usb)
        self._connector = connector
        self.data_in, self.data_out = connector.endpoint_in, connector.endpoint_out

    def descriptors(self) -> Descriptors:
        """Return the descriptors: one interface of the vendor's class."""
        vid, pid = self.ids(0, 0)
        size = self._connector.packet_bytes
        ends = Endpoint(self.data_in, "bulk", size), Endpoint(self.data_out, "bulk", size)
        return Descriptors(vid, pid, 0x0100, (Interface((0xFF, 0, 0), ends),), self.named("", ""))

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Refuse the request: the vendor's own are not modelled."""
        return None
