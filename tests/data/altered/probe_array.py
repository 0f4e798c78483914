"""Probe array: nine taxels that see any quantity of touch, for scenes whose values are altered.

Wire: serial; it streams.
"""

from typing import Annotated, Literal

from firmware_protocols import Column, Counts, Device, Option, Reading, Serial, Transmissions, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.tables import Frame

IMAGE = Frame("""
    image
    0     A5             start
    1     >u2 x taxels   counts
    last  sum8           check
""")


class ProbeArray(Device):
    """Nine taxels."""

    name = "probe_array"
    title = "Probe array, 3x3"
    evidence = ("assumed",)
    sources = ("no sensor",)

    def __init__(
        self,
        *,
        sees: Annotated[Literal["touch", "depth", "displacement", "pressure"], Option("what its taxels measure")],
        counts_per_unit: Annotated[float, Option("scale of the converter", low=1e-6, high=1e9)] = 1e5,
    ):
        self.ports = (Serial(baud=115200),)
        self.senses = (sees,)
        self.columns = (Column(name="push", low=0, high=0xFFFF, push=1),)
        self.layout = grid_layout(3, 3, 0.003)
        self.sees, self.counts_per_unit = sees, counts_per_unit
        self.frame = IMAGE.bind(taxels=9)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Counts of each taxel, 0..65535."""
        values = reading[self.sees]
        self.counts = quantize(values[:, 2] if values.ndim == 2 else values, self.counts_per_unit, 0, 0xFFFF)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """One image."""
        return [self.frame.pack(counts=self.counts)]
