r"""FlexiTac: a piezoresistive matrix that an Arduino-class board scans, 12 x 32 taxels as a rule (from 3D-ViTac).

Wire: UART at 2 000 000 8N1. Device to host only: there is no command; it streams from power-up. One frame per scan:

    offset  bytes        field
    0       2            AA 55
    2       rows x cols  uint8 per taxel, row by row: the 10-bit ADC, shifted right by 2

No length, no checksum, no escape: a driver that first finds AA 55 inside an image that stands still never recovers.
Taxels below AA (a push of less than 1.7 N here) cannot do that. Zeroing is the driver's: the median of 30 frames.

Try it: ``tactemu run flexitac``, then ``FlexiTacSensor(port).read()``. The stock viewers want 16 x 32 taxels, as other
boards are flashed: ``tactemu run flexitac rows=16``.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from firmware_protocols import Column, Counts, Device, Option, Outs, Reading, Serial, grid_layout

MARKER = b"\xaa\x55"
ADC_MAX = 1023
PITCH = 0.002


class FlexiTac(Device):
    """A grid of force-sensitive resistors, each read through a voltage divider."""

    name = "flexitac"
    kind = "fingertip"
    ports = (Serial(baud=2_000_000),)
    evidence = ("firmware", "driver")
    sources = (
        "WT-MM/PyFlexiTac firmware/template.ino BAUD_RATE, loop()",
        "flexitac 0.3.1 sensor.py l.16-38, 82-112, 156-196",
        "FlexiTac/FlexiTac_Hardware_Repo@9cf98bf 32_16_fast.ino (16 x 32)",
    )
    judge = "flexitac 0.3.1"
    assumed = (
        "2 mm pitch; row 0 at the largest y, column 0 at the smallest x",
        "a taxel conducts more the harder it is pushed: ADC = rest + (1023 - rest) F / (F + 1 N), rest 80",
        "100 scans a second (the firmware scans as fast as it can)",
    )

    def __init__(
        self,
        *,
        rows: Annotated[int, Option("as the board was flashed", low=1, high=256)] = 12,
        cols: Annotated[int, Option("as the board was flashed", low=1, high=256)] = 32,
        baseline: Annotated[int, Option("10-bit ADC value of an untouched taxel", low=0, high=ADC_MAX - 1)] = 80,
        half_force: Annotated[float, Option("push half way from rest to full scale", unit="N", low=1e-6)] = 1.0,
    ):
        self.title = f"FlexiTac {rows} x {cols} tactile matrix"
        self.layout = grid_layout(rows, cols, PITCH, name="matrix")
        self.baseline, self.half_force = baseline, half_force
        self.columns = (Column(name="touch", low=baseline >> 2, high=ADC_MAX >> 2, rest=baseline >> 2, push=1),)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """What the driver calls raw: 0..255, shape ``(rows * cols,)``."""
        push = np.maximum(self.layout.push(reading["force"]), 0.0)
        adc = self.baseline + (ADC_MAX - self.baseline) * push / (push + self.half_force)
        self.counts = adc.astype(np.int64) >> 2
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs:
        """One frame."""
        return [MARKER + self.layout.on_wire(self.counts).astype(np.uint8).tobytes()]
