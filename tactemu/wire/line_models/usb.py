"""Lines of USB devices that have no serial port: reports of a HID, transfers of a vendor's class."""

from __future__ import annotations

from typing import ClassVar

from firmware_protocols import Bulk, Hid, WireFrame
from tactemu.wire.line import LineModel


class UsbLine(LineModel):
    """A line at the host's own pace; the two directions do not delay each other."""

    title: ClassVar[str] = ""
    """The name of the class of devices."""
    schemes = ("usbip", "gadget")
    likely_faults = ("flip", "truncate", "silence", "unplug")

    def duration_ns(self, frame: WireFrame) -> int:
        """Return 0: the time on USB is not modelled."""
        return 0

    def describe(self) -> str:
        """Return the line in words: ``USB HID 16c0:0486``."""
        usb = self.connector.usb
        return f"USB {self.title} {usb.vid:04x}:{usb.pid:04x}"

    def usual_port(self, name: str) -> str:
        """Return the usual port of USB/IP, on this machine only."""
        return "usbip:"

    def fresh_port(self, name: str) -> str:
        """Return any free port of USB/IP."""
        return "usbip:0"


class HidLine(UsbLine, connector=Hid):
    """Reports, at most one in an interval of the endpoint."""

    kind = "hid"
    title = "HID"

    def duration_ns(self, frame: WireFrame) -> int:
        """Return the interval [ns]."""
        return self.connector.interval_ms * 1_000_000 if self.pacing else 0


class BulkLine(UsbLine, connector=Bulk):
    """Transfers, each of a frame."""

    kind = "bulk"
    title = "bulk"
