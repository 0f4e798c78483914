"""SUN fingertip: 5 x 5 taxels, a frame for each letter.

Wire: 500 000 8N1, or 1 000 000 (option). The host sends ``a`` and gets ``FRAME``; a count is 3.3 V / 4096. Nothing
marks where a frame begins, and there is no sum. The driver wants a port of low latency.

Try it: ``tactemu run sun_fingertip``, then send ``a``.
"""

from __future__ import annotations

from typing import Annotated, Literal

from firmware_protocols import Column, Command, Counts, Device, Option, Outs, Reading, Serial, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.tables import Frame

FRAME = Frame("""
    frame, row by row
    0     <u2 x taxels    counts    0 to 4095
""")
REQUEST = b"a"
ROWS = COLS = 5
PITCH = 0.0035


class SunFingertip(Device):
    """Twenty-five taxels, asked for."""

    name = "sun_fingertip"
    kind = "fingertip"
    title = "SUN fingertip, 5x5"
    evidence = ("driver",)
    sources = ("marcocostanzo/tactile_sensor_ros@149032e",)
    judge = "own second reader"
    assumed = (
        "row by row from the upper left, pitch 3.5 mm",
        "600 counts above 0 untouched, 400 counts/N along each taxel's normal",
        "100 conversions per second; a frame is what was converted last; other letters are not answered",
    )

    def __init__(
        self,
        *,
        baud: Annotated[Literal[500_000, 1_000_000], Option("of its firmware")] = 500_000,
        baseline: Annotated[int, Option("counts untouched", low=0, high=4095)] = 600,
        counts_per_newton: Annotated[float, Option("of a taxel", unit="1/N", low=1e-6)] = 400.0,
    ):
        self.ports = (Serial(baud=baud),)
        self.columns = (Column(name="voltage", low=0, high=4095, rest=baseline, push=1),)
        self.layout = grid_layout(ROWS, COLS, PITCH)
        self.frame = FRAME.bind(wire_order=self.layout.wire_order)
        self.baseline, self.counts_per_newton = baseline, counts_per_newton

    @property
    def commands(self) -> tuple[Command, ...]:
        """The only one."""
        return (Command(name="read", request="61", reply="..{50}", origin=self.sources[0]),)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Counts of each taxel, 0..4095, shape ``(25,)``."""
        push = self.layout.push(reading["force"])
        self.counts = quantize(push, self.counts_per_newton, 0, 4095, rest=self.baseline)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Letters."""
        asked = data.count(REQUEST)
        self.counters["requests"] += asked
        self.counters["unknown_command"] += len(data) - asked
        return [self.frame.pack(counts=self.counts)] * asked
