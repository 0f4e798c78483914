"""PaXini PX-6AX modules: what the GEN2 box and the GEN3 board have in common.

A module is a pad of taxels that each measure three force components. In its memory (region 7B) lie

    address       bytes  content
    0x3F0 (1008)  3      resultant: Fx int8, Fy int8, Fz uint8
    0x40E (1038)  3 n    taxels: Fx int8, Fy int8, Fz uint8 each

0.1 N per count. Fz counts a push as positive; Fx and Fy follow the taxel's own axes.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from firmware_protocols.device import Device, Layout, Outgoing, Reading
from firmware_protocols.layouts import filled, place, stack

TAXELS: Mapping[str, int] = {
    "S1813E": 31, "S1813C": 51, "S2015": 52, "S2716": 116, "S3013": 96, "M2826": 127,
    "L3530": 135, "S1610": 25, "M2324": 68, "M3025": 77, "L5325": 239, "M2020": 9,
}  # fmt: skip
"""Taxels by model; S1813E is the "elite", S1813C the "core"."""

NEWTON_PER_COUNT = 0.1
LOW, HIGH = np.array([-128, -128, 0]), np.array([127, 127, 255])

RESULTANT, TAXEL_DATA = 0x3F0, 0x40E
GAP_NS = 50_000_000
"""Silence after which a half request is forgotten [ns]; an assumption."""


class Px6axDevice(Device):
    """Modules behind a board or box.

    Args:
        models: one model name (see :data:`TAXELS`) or several; their pads lie side by side along x.
        places: the number by which a request picks each module: device id or port. By default a single module is
            reached by every number, several by 0, 1, 2 ...
    """

    senses = "force"
    taxel_counts: Mapping[str, int] = TAXELS

    def __init__(self, *, models: str | Sequence[str], places: Sequence[int] | None = None):
        super().__init__()
        self.models = (models,) if isinstance(models, str) else tuple(models)
        for model in self.models:
            if model not in self.taxel_counts:
                known = ", ".join(self.taxel_counts)
                raise ValueError(f"{self.name}: unknown model {model!r}; it knows: {known}")
        if places is not None and len(set(places)) != len(self.models):
            raise ValueError(f"{self.name}: {len(self.models)} modules need as many different numbers, got {places}")
        if places is None and len(self.models) > 1:
            places = range(len(self.models))
        self.places = None if places is None else tuple(places)
        self.layout = _side_by_side(self.models, self.taxel_counts)
        self._reset_modules()

    def _reset_modules(self) -> None:
        n = len(self.layout)
        self._raw = np.zeros((n, 3))
        self._raw_resultants = np.zeros((len(self.models), 3))
        self._zero = np.zeros((n, 3))
        self._zero_resultants = np.zeros((len(self.models), 3))
        self.counts = np.zeros((n, 3), np.int64)

    def digitize(self, reading: Reading) -> np.ndarray:
        """Fx, Fy, Fz of every taxel in counts of 0.1 N, zero applied, shape ``(n_taxels, 3)``."""
        self._raw, self._raw_resultants = self._raw_counts(reading)
        return self._zeroed()

    def _raw_counts(self, reading: Reading) -> tuple[np.ndarray, np.ndarray]:
        counts = self.layout.to_taxel_frame(np.asarray(reading.values)) * [1, 1, -1] / NEWTON_PER_COUNT
        sums = [counts[patch.taxels].sum(0) for patch in self.layout.patches]
        return np.rint(counts), np.rint(sums)

    def _zeroed(self) -> np.ndarray:
        return np.clip(self._raw - self._zero, LOW, HIGH).astype(np.int64)

    def zero(self, module: int) -> None:
        """What this module feels now is zero from now on."""
        taxels = self.layout.patches[module].taxels
        self._zero[taxels] = self._raw[taxels]
        self._zero_resultants[module] = self._raw_resultants[module]
        self.counts = self._zeroed()

    def module_at(self, place: int) -> int | None:
        """Index of the module that answers to this number."""
        if self.places is None:
            return 0
        return self.places.index(place) if place in self.places else None

    def memory(self, module: int, address: int, count: int) -> bytes | None:
        """``count`` bytes of region 7B, or ``None`` outside of it."""
        resultant = np.clip(self._raw_resultants[module] - self._zero_resultants[module], LOW, HIGH).astype(np.int64)
        taxels = self.counts[self.layout.patches[module].taxels]
        content = _to_bytes(resultant).ljust(TAXEL_DATA - RESULTANT, b"\0") + _to_bytes(taxels)
        start = address - RESULTANT
        return content[start : start + count] if 0 <= start and start + count <= len(content) else None

    @abstractmethod
    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Requests in chunks of any size."""


def _to_bytes(counts: np.ndarray) -> bytes:
    """Two's complement of Fx and Fy, Fz as it is."""
    return (counts & 0xFF).astype(np.uint8).tobytes()


def _side_by_side(models: Sequence[str], taxel_counts: Mapping[str, int]) -> Layout:
    """A model's name gives its size in mm: S1813 is 18 x 13."""
    pads, x = [], 0.0
    for index, model in enumerate(models):
        width, height = int(model[1:3]) * 1e-3, int(model[3:5]) * 1e-3
        pad = filled(taxel_counts[model], width, height, name=f"{index} {model}")
        pads.append(place(pad, (x + width / 2 * (index > 0), 0.0, 0.0)))
        x += width / 2 * (1 + (index > 0)) + 0.005
    return stack(*pads)
