r"""Bielefeld tactile glove: 64 channels that stream over USB.

Wire: USB-CDC (04D8:000A), opened at 115200; the speed has no effect. Device to host only: there is no command. A scan
is one ``PACKET`` for each channel, from 0 to 63; channel 63 completes it. The driver shows 4095 - value.

The driver needs each packet in one piece, and gives up after 100 ms of silence. There is no checksum: a flipped bit in
a value goes unnoticed. This is the glove with a PIC18; those with a Teensy 3.2 or 4.0 have a protocol of their own.

Try it: ``tactemu run bielefeld_glove``, then the ``SerialInput`` of ubi-agni/TactileGlove on its port.
"""

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, Device, Frame, HalfForce, Reading, Serial, Transmissions, fact_table, filled, quantize,
)  # fmt: skip

PACKET = Frame("""
    packet
    0     u1      index      3C + channel
    1     01      mark
    2     >u2     value      bits 15..12 the converter's channel, 11..0 what it read
    4     00      end
""")
SOURCE = "ubi-agni/TactileGlove@59a0ef6"
PIC = f"{SOURCE} PIC18 usb_descriptors.c"
CHANNELS = 64
ADC_MAX = 4095
PACKET_INDEXES = 0x3C + np.arange(CHANNELS)
CONVERTER_BITS = np.arange(CHANNELS) % 16 << 12


class BielefeldGlove(Device):
    """A glove of 64 channels that sends one packet for each."""

    name = "bielefeld_glove"
    kind = "glove"
    title = "Bielefeld tactile glove"
    ports = (Serial(baud=115200, usb=USB(0x04D8, 0x000A, "Microchip Technology Inc.", "CDC RS-232 Emulation Demo")),)
    rate_hz = 30.0
    evidence = ("firmware", "driver")
    sources = (
        f"{SOURCE} linux/libio/SerialInput.cpp l.115-157; linux/console/main.cpp",
        f"{SOURCE} firmware/PIC18 tactGlove_main.c ProcessIO, usb_descriptors.c",
    )
    judge = SOURCE
    facts = fact_table(f"""
        stated identity: USB 04D8:000A, the text of Microchip's example, no serial number @ {PIC} l.174-179, 262-278
        stated identity: the console's port is /dev/ttyACM0 @ {SOURCE} linux/console/main.cpp l.52
        stated touch: the channel of the converter is the taxel's index modulo 16 @ {SOURCE} PIC18 tactGlove_main.c
            l.250-295
        assumed touch: 64 taxels over a field of 80 x 160 mm, in order @ {SOURCE} TaxelMapping.cpp, taxel.cfg
        assumed touch: the value is 4095 F / (F + 1 N), 0 if untouched @ {SOURCE} README, calib.py, raw.calib.yaml
        assumed timing: 30 scans a second @ tactGlove_main.c (one USB transfer a packet, as fast as the host asks)
    """)

    def __init__(self, *, half_force: HalfForce = 1.0):
        self.layout = filled(CHANNELS, 0.08, 0.16, name="glove")
        self.columns = (Column(name="touch", low=0, high=ADC_MAX, push=1),)
        self.half_force = half_force

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the values that the driver shows, 0..4095, shape ``(64,)``."""
        push = np.maximum(self.layout.push(reading["force"]), 0.0)
        self.counts = quantize(push / (push + self.half_force), ADC_MAX)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one packet for each channel."""
        value = CONVERTER_BITS | ADC_MAX - self.layout.on_wire(self.counts)
        return PACKET.pack_many(CHANNELS, index=PACKET_INDEXES, value=value)
