r"""WiReSens: a matrix of resistive taxels read by a small wireless board, here on its serial port.

Wire: 250000 8N1 as the toolkit's configuration comes. Device to host only: there is no command. A scan is sent in
``PACKET`` s of so many values as the host's configuration says, at most 120.

The receiver splits the stream at 77 72 ("wr") and drops pieces of another length. So a packet that holds 77 72 anywhere
else is lost: each whose number does, 29303 the first.

Try it: ``tactemu run wiresens``, then the ``SerialReceiver`` of WiReSensPy with 64 values in a packet.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from firmware_protocols import Column, Counts, Device, Option, Outs, Reading, Rollover, Serial, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.tables import Frame

PACKET = Frame("""
    packet
    0     i1               sensor
    1     <u2              start      index of the first value, row by row
    3     <u2 x values     touch
    ..    <u4              number     of the packet
    ..    77 72            end        wr
""")
ADC_MAX = 4095


class Wiresens(Device):
    """A matrix, sent in packets of equal length."""

    name = "wiresens"
    kind = "fingertip"
    ports = (Serial(baud=250_000),)
    rate_hz = 30.0
    evidence = ("driver",)
    sources = ("WiReSens-Toolkit/WiReSensPy@2e9297c GenericReceiver.py l.33-57",)
    judge = "own second reader"
    assumed = (
        "16 x 16 taxels, 5 mm apart, 64 values in a packet; row 0 at the largest y, column 0 at the smallest x",
        "values beyond the last taxel are 0; packets are numbered from 0; 30 scans a second",
        "a push raises the value: 4095 F / (F + 1 N), 0 untouched",
    )

    def __init__(
        self,
        *,
        rows: Annotated[int, Option("of the matrix", low=1, high=64)] = 16,
        cols: Annotated[int, Option("of the matrix", low=1, high=64)] = 16,
        values: Annotated[int, Option("in a packet, as the configuration says", low=1, high=120)] = 64,
        sensor: Annotated[int, Option("its number", low=-128, high=127)] = 0,
        half_force: Annotated[float, Option("push half way to full scale", unit="N", low=1e-6)] = 1.0,
    ):
        self.title = f"WiReSens {rows} x {cols} tactile matrix"
        self.layout = grid_layout(rows, cols, 0.005, name="matrix")
        self.columns = (Column(name="touch", low=0, high=ADC_MAX, push=1),)
        self.half_force, self.sensor, self.number = half_force, sensor, 0
        self.packet, self.starts = PACKET.bind(values=values), np.arange(0, rows * cols, values)
        self.rollovers = (Rollover(name="number", bits=32, step=len(self.starts), state="number"),)
        self.sent = np.zeros((len(self.starts), values), np.int64)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """0..4095 of each taxel."""
        push = np.maximum(self.layout.push(reading["force"]), 0.0)
        self.counts = quantize(push / (push + self.half_force), ADC_MAX)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs:
        """The packets of one scan."""
        n = len(self.starts)
        self.sent.flat[: len(self.layout)] = self.layout.on_wire(self.counts)
        numbers = (self.number + np.arange(n)) & 0xFFFFFFFF
        self.number = (self.number + n) & 0xFFFFFFFF
        return self.packet.rows(n, sensor=self.sensor, start=self.starts, touch=self.sent, number=numbers)
