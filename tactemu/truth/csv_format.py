"""``.csv``: the samples of one sense of one skin; numbers are the shortest decimals that read back to the same bits."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.truth.entries import End, Entry, Header, Sample

_AXES = "xyz"


class CsvFile:
    """Rows of a time, a number, and all numbers of the arrays; the first sample decides skin and sense."""

    def __init__(self, target: Path):
        self._file = target.open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file)
        self._first: Sample | None = None

    def begin(self, header: Header) -> None:
        """Do nothing: the first sample names the columns."""

    def add(self, entry: Entry) -> bool:
        """Write the row of a sample; return False for another entry, and for a sample of another sense.

        Raises:
            TactemuError: the sample is of another skin.
        """
        if not isinstance(entry, Sample):
            return False
        if self._first is None:
            self._first = entry
            self._rows.writerow(["t_ns", "sample", *_columns(entry)])
        if entry.device != self._first.device:
            devices = f"{self._first.device!r}, {entry.device!r}"
            raise TactemuError(f"samples of {devices} have different columns; choose one with --skin")
        if entry.sense != self._first.sense:
            return False
        self._rows.writerow([entry.t_ns, entry.number, *_numbers(entry)])
        return True

    def finish(self, end: End) -> None:
        """Close the file."""
        self._file.close()


def _columns(sample: Sample) -> list[str]:
    """Return the names of the columns, taxel by taxel: ``ideal_0_x``, ``ideal_0_y`` ... ``counts_0``, ``counts_1``."""
    names = []
    for name in ("ideal", "measured", "counts"):
        for place in np.ndindex(getattr(sample, name).shape):
            last = _AXES[place[-1]] if name != "counts" and len(place) == 2 and place[-1] < 3 else place[-1]
            names.append("_".join(map(str, (name, *place[:-1], last))))
    return names


def _numbers(sample: Sample) -> list:
    flat = []
    for values in (sample.ideal, sample.measured, sample.counts):
        flat += [str(x) for x in values.ravel()] if values.dtype == np.float32 else values.ravel().tolist()
    return flat
