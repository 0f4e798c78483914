"""Devices on USB without a serial port: no sensors, but their reports are those of real ones or like them.

``ForceKeys``: a HID whose reports are those that the reader of HAND (aforren1/toon, ``toon/input/hand.py``) takes
apart: ``>Lh20H`` in the first 46 of 64 bytes. ``BulkPad``: a device of a vendor's class that streams and answers.
"""

import struct

from firmware_protocols import USB, Bulk, Column, Device, Hid, Serial, fact_table, grid_layout
from firmware_protocols.devices.anyskin import AnySkin

# The reports of PJRC's Teensy as "Raw HID": 64 bytes each way, no numbers (PaulStoffregen/cores usb_rawhid/usb.c).
REPORTS = bytes.fromhex("06ABFF 0A0002 A101 7508 1500 26FF00 9540 0901 8102 9540 0902 9102 C0")
TEENSY = USB(0x16C0, 0x0486, manufacturer="Teensyduino", product="Teensyduino RawHID", serial="12345")
RAW_HID = Hid(usb=TEENSY, report_descriptor=REPORTS)
PAD = USB(0x1209, 0x0002, manufacturer="Nobody", product="Bulk pad", serial="P1")


class _Pushed(Device):
    kind = "fingertip"
    senses = ("force",)
    rate_hz = 100.0
    evidence = ("assumed",)
    sources = ("tests",)
    judge = "none"
    columns = (Column(name="push", unit="N", counts_per_unit=1000.0, low=0, high=0xFFFF, push=1),)
    facts = fact_table("""
        assumed touch: everything @ nothing: it is an example
    """)


class ForceKeys(_Pushed):
    """Five keys with four strain gauges each."""

    name = "force_keys"
    title = "Force keys"
    ports = (RAW_HID,)

    def __init__(self):
        self.layout = grid_layout(5, 4, pitch=0.01)

    def stream(self, t_ns: int, name: str):
        return [struct.pack(">Lh20H", t_ns // 1_000_000, -1, *self.counts.ravel()).ljust(64, b"\0")]

    def receive(self, data, t_ns: int, port: str):
        """Return the report with its first byte changed."""
        return [b"\xff" + data[1:]]


class BulkPad(_Pushed):
    """A pad of 10 x 10 taxels, 200 bytes a transfer."""

    name = "bulk_pad"
    title = "Bulk pad"
    ports = (Bulk(usb=PAD),)

    def __init__(self):
        self.layout = grid_layout(10, 10, pitch=0.004)

    def stream(self, t_ns: int, name: str):
        return [struct.pack(">100H", *self.counts.ravel())]


class AnySkinFtdi(AnySkin):
    """AnySkin's frames behind an FT232R."""

    ports = (Serial(baud=115_200, usb=USB(0x0403, 0x6001, node="ttyUSB")),)


class AnySkinCp210x(AnySkin):
    """AnySkin's frames behind a CP2102."""

    ports = (Serial(baud=115_200, usb=USB(0x10C4, 0xEA60, node="ttyUSB")),)


class AnySkinCh341(AnySkin):
    """AnySkin's frames behind a CH340."""

    ports = (Serial(baud=115_200, usb=USB(0x1A86, 0x7523, node="ttyUSB")),)
