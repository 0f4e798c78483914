r"""FlexiTac: a piezoresistive matrix of 12 x 32 taxels that an Arduino-class board scans (lineage of 3D-ViTac).

Wire: UART at 2 000 000 8N1. Device to host only: there is no command; it streams from power-up. One frame per scan:

    offset  bytes        field
    0       2            AA 55
    2       rows x cols  uint8 per taxel, row by row: the 10-bit ADC, shifted right by 2

No length, no checksum, no escape: a driver that first finds AA 55 inside an image that stands still never recovers.
Taxels below AA (a push of less than 1.7 N here) cannot do that. Zeroing is the driver's: the median of 30 frames.

Try it: ``tactemu run flexitac``, then ``FlexiTacSensor(port).read()``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_protocols.device import Device, Outgoing, Reading, SerialWire, grid_layout

MARKER = b"\xaa\x55"
ADC_MAX = 1023
PITCH = 0.002


class FlexiTac(Device):
    """A grid of force-sensitive resistors, each read through a voltage divider.

    Args:
        rows, cols: as the board was flashed.
        baseline: 10-bit ADC value of an untouched taxel.
        half_force: push [N] that takes a taxel half way from there to full scale.
    """

    name = "flexitac"
    title = "FlexiTac 12 x 32 tactile matrix"
    wires = (SerialWire(baud=2_000_000),)
    senses = "force"
    rate_hz = 100.0
    evidence = ("firmware", "driver")
    sources = (
        "WT-MM/PyFlexiTac firmware/template.ino BAUD_RATE, loop()",
        "flexitac 0.3.1 sensor.py l.16-38, 82-112, 156-196",
    )
    judge = "flexitac 0.3.1"
    assumed = (
        "2 mm pitch; row 0 at the largest y, column 0 at the smallest x",
        "a taxel conducts more the harder it is pushed: ADC = rest + (1023 - rest) F / (F + 1 N), rest 80",
        "100 scans a second (the firmware scans as fast as it can)",
    )

    def __init__(self, *, rows: int = 12, cols: int = 32, baseline: int = 80, half_force: float = 1.0):
        super().__init__()
        if rows < 1 or cols < 1 or half_force <= 0 or not 0 <= baseline <= ADC_MAX:
            raise ValueError(f"flexitac: impossible options: {rows=}, {cols=}, {baseline=}, {half_force=}")
        self.layout = grid_layout(rows, cols, PITCH, name="matrix")
        self.baseline = baseline
        self.half_force = half_force

    def digitize(self, reading: Reading) -> np.ndarray:
        """What the driver calls raw: 0..255, shape ``(rows * cols,)``."""
        push = np.maximum(self.layout.push(reading.values), 0.0)
        adc = self.baseline + (ADC_MAX - self.baseline) * push / (push + self.half_force)
        return adc.astype(np.int64) >> 2

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """One frame."""
        return (MARKER + self.counts[self.layout.wire_order].astype(np.uint8).tobytes(),)
