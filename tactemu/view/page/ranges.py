"""The ranges of readings: the scene, its legend and the pictures show a quantity on one colour scale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tactemu.truth.entries import Sample
from tactemu.view.conversions.display import prefixed
from tactemu.view.page.feed import DescribedRun, PageSkin, magnitudes
from tactemu.view.page.ground import round_length

NO_CONTACT = "no contact yet"
"""The text at the end of a colour bar whose quantity has no range yet."""


class Range:
    """The range of the readings of one quantity: from 0 to the largest so far, rounded up to 1, 2, 4 or 5."""

    def __init__(self, quantity: str, unit: str):
        self.quantity, self.unit = quantity, unit
        self.top = 0.0

    def include(self, readings: np.ndarray) -> None:
        """Widen the range if a reading is larger."""
        largest = float(np.nanmax(readings, initial=0.0))
        if np.isfinite(largest) and largest > self.top:
            low = round_length(largest)
            self.top = next(step for step in (low, 2 * low, 2.5 * low) if step >= largest * (1 - 1e-9))

    def shares(self, readings: np.ndarray) -> np.ndarray:
        """Return readings as shares of the range."""
        return readings / self.top if self.top else 0.0 * readings

    def end(self) -> str:
        """Return the end of the range with its unit; "" before the first reading that is not 0."""
        factor, unit = prefixed(self.top, self.unit)
        return f"{self.top * factor:.4g} {unit}".rstrip() if self.top else ""

    def half(self) -> str:
        """Return half of the range in the unit of its end; "" before the first reading that is not 0."""
        return f"{self.top * prefixed(self.top, self.unit)[0] / 2:.4g}" if self.top else ""


class Ranges:
    """The ranges of all quantities of a run; skins of one quantity share theirs."""

    def __init__(self, run: DescribedRun):
        self._skins = run.skins
        self._ranges: dict[str, Range] = {}
        for name, skin in run.skins.items():
            self.of(name, _sense(skin))

    def __iter__(self) -> Iterator[Range]:
        return iter(self._ranges.values())

    def of(self, skin: str, sense: str) -> Range:
        """Return the range of a skin's sense."""
        quantity = self._skins[skin].quantity(sense)
        return self._ranges.setdefault(quantity, Range(quantity, self._skins[skin].unit(sense)))

    def include(self, samples: Mapping[str, Sample]) -> None:
        """Widen the ranges by the ideal and measured readings of samples."""
        for name, sample in samples.items():
            if name in self._skins:
                for readings in (sample.ideal, sample.measured):
                    self.of(name, sample.sense).include(magnitudes(readings) if np.ndim(readings) else readings)


def _sense(skin: PageSkin) -> str:
    """Return the name of a skin's first sense that has a value for each taxel."""
    senses = skin.described.senses.items()
    return next((name for name, each in senses if each.points in (0, len(skin.layout))), "")
