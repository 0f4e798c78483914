"""PaXini PX-6AX modules: the part that the GEN2 box and the GEN3 board share.

A module is a pad of taxels that each measure three force components. In its memory (region 7B) lie

    address       bytes  content
    0x3F0 (1008)  3      resultant: Fx int8, Fy int8, Fz uint8
    0x40E (1038)  3 n    taxels: Fx int8, Fy int8, Fz uint8 each

0.1 N per count. Fz counts a push as positive; Fx and Fy follow the taxel's own axes.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np

from firmware_protocols import Counts, Device, Layout, Reading, filled, place, quantize, stack, xyz

TAXELS_BY_MODEL: Mapping[str, int] = {
    "S1813E": 31, "S1813C": 51, "S2015": 52, "S2716": 116, "S3013": 96, "M2826": 127,
    "L3530": 135, "S1610": 25, "M2324": 68, "M3025": 77, "L5325": 239, "M2020": 9,
}  # fmt: skip
"""The number of taxels by model; S1813E is the "elite", S1813C the "core"."""
Model = Literal[
    "S1813E", "S1813C", "S2015", "S2716", "S3013", "M2826", "L3530", "S1610", "M2324", "M3025", "L5325", "M2020"
]

NEWTONS_PER_COUNT = 0.1
LOW_COUNTS, HIGH_COUNTS = np.array([-128, -128, 0]), np.array([127, 127, 255])
RESULTANT_ADDRESS = 0x3F0
TAXEL_ADDRESS = 0x40E
GAP_NS = 50_000_000
"""The silence after which an incomplete request is dropped; an assumption."""


class Px6axDevice(Device):
    """Modules behind a board or box, with pads side by side along x."""

    columns = xyz("Fx Fy Fz", push=1, unit="N", counts_per_unit=1 / NEWTONS_PER_COUNT, low=LOW_COUNTS, high=HIGH_COUNTS)
    taxel_counts: ClassVar[Mapping[str, int]] = TAXELS_BY_MODEL

    def _power_up(
        self, models: str | Sequence[str], places: Sequence[int] | None, layout: Layout | None = None
    ) -> None:
        self.models = (models,) if isinstance(models, str) else tuple(models)
        if places is not None and len(set(places)) != len(self.models):
            raise ValueError(f"{self.name}: {len(self.models)} modules need as many different numbers, got {places}")
        if places is None and len(self.models) > 1:
            places = range(len(self.models))
        self.places = None if places is None else tuple(places)
        self.layout = layout or _in_a_row(self.models, self.taxel_counts, self.places or ())
        self.present, self.zero = np.zeros((len(self.layout), 3)), np.zeros((len(self.layout), 3))
        self.counts = np.zeros((len(self.layout), 3), np.int64)
        self.sums = self.zero_sums = np.zeros((len(self.models), 3))

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return Fx, Fy, Fz of every taxel in counts of 0.1 N, less the zero, shape ``(n_taxels, 3)``."""
        super().measure(reading, t_ns)
        newtons = [self.present[patch.taxels].sum(0) for patch in self.layout.patches]
        self.sums = np.rint(np.array(newtons) / NEWTONS_PER_COUNT)
        return self.counts

    def set_zero(self, module: int) -> None:
        """Make the present force on the module its zero."""
        taxels, self.zero_sums = self.layout.patches[module].taxels, self.zero_sums.copy()
        self.zero[taxels] = np.rint(self.present[taxels] / NEWTONS_PER_COUNT) * NEWTONS_PER_COUNT
        self.zero_sums[module] = self.sums[module]
        self.counts[taxels] = 0

    def module_at(self, place: int) -> int | None:
        """Return the index of the module that answers to the number ``place``, or None."""
        if self.places is None:
            return 0
        return self.places.index(place) if place in self.places else None

    def resultant(self, module: int) -> np.ndarray:
        """Return the counts of a module's resultant."""
        return quantize(self.sums[module] - self.zero_sums[module], 1.0, LOW_COUNTS, HIGH_COUNTS)

    def taxels(self, module: int) -> bytes:
        """Return the taxels of a module, three bytes each."""
        return _to_bytes(self.layout.on_wire(self.counts)[self.layout.patches[module].taxels])

    def memory(self, module: int, address: int, count: int) -> bytes | None:
        """Return ``count`` bytes of region 7B, or None outside of it."""
        start = address - RESULTANT_ADDRESS
        content = _to_bytes(self.resultant(module)).ljust(TAXEL_ADDRESS - RESULTANT_ADDRESS, b"\0")
        if start + count > len(content):  # the resultant alone needs no taxel
            content += self.taxels(module)
        return content[start : start + count] if 0 <= start and start + count <= len(content) else None


def _to_bytes(counts: np.ndarray) -> bytes:
    """Return a byte for each count: Fx and Fy in two's complement, Fz unsigned."""
    return (counts & 0xFF).astype(np.uint8).tobytes()


def _in_a_row(models: Sequence[str], taxel_counts: Mapping[str, int], places: Sequence[int]) -> Layout:
    """Return pads in a row; a model's name gives its size in mm: S1813 is 18 x 13.

    With several modules, each has a link of its own.
    """
    pads, x = [], 0.0
    for index, model in enumerate(models):
        width, height = int(model[1:3]) * 1e-3, int(model[3:5]) * 1e-3
        link = f"module {places[index]}" if len(models) > 1 else ""
        pad = filled(taxel_counts[model], width, height, name=f"{index} {model}", link=link)
        pads.append(place(pad, (x + width / 2 * (index > 0), 0.0, 0.0)))
        x += width / 2 * (1 + (index > 0)) + 0.005
    return stack(*pads)
