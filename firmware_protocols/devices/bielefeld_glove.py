r"""Bielefeld tactile glove: 64 channels.

Wire: 115200 8N1. Device to host only: there is no command. A scan is one ``PACKET`` a channel, from channel 0
to 63. The driver shows 4095 - value; a scan is complete with the last channel.

The driver wants each packet in one piece, and gives up after 100 ms of silence. No checksum: a bit that is turned over
in a value is a value. A scan takes 27.8 ms at this speed, 36 scans a second at most.

Try it: ``tactemu run bielefeld_glove``, then the ``SerialInput`` of ubi-agni/TactileGlove on its port.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from firmware_protocols import Column, Counts, Device, Option, Outs, Reading, Serial
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import filled
from firmware_protocols.tables import Frame

PACKET = Frame("""
    packet
    0     u1      index      3C + channel
    1     01      mark
    2     >u2     value      bits 15..12 the converter's channel, 11..0 what it read
    4     00      end
""")
CHANNELS, ADC_MAX = 64, 4095
INDEX = 0x3C + np.arange(CHANNELS)
CONVERTER = np.arange(CHANNELS) % 16 << 12


class BielefeldGlove(Device):
    """Sixty-four channels, one packet each."""

    name = "bielefeld_glove"
    kind = "glove"
    title = "Bielefeld tactile glove"
    ports = (Serial(baud=115200),)
    rate_hz = 30.0
    evidence = ("firmware", "driver")
    sources = ("ubi-agni/TactileGlove@59a0ef6 libio/SerialInput.cpp l.115-157; the firmware in that repository",)
    judge = "own second reader"
    assumed = (
        "places: 64 taxels spread over a field of 80 x 160 mm, in the order of the channels",
        "the converter's channel is the index modulo 16; 30 scans a second",
        "a push lowers what the converter reads: shown are 4095 F / (F + 1 N), 0 untouched",
    )

    def __init__(
        self,
        *,
        half_force: Annotated[float, Option("push half way to full scale", unit="N", low=1e-6)] = 1.0,
    ):
        self.layout = filled(CHANNELS, 0.08, 0.16, name="glove")
        self.columns = (Column(name="touch", low=0, high=ADC_MAX, push=1),)
        self.half_force = half_force

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """What the driver shows, 0..4095."""
        push = np.maximum(self.layout.push(reading["force"]), 0.0)
        self.counts = quantize(push / (push + self.half_force), ADC_MAX)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs:
        """A packet of each channel."""
        value = CONVERTER | ADC_MAX - self.layout.on_wire(self.counts)
        return PACKET.rows(CHANNELS, index=INDEX, value=value)
