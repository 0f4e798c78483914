"""Matching of rows with samples: a row is the recent sample with whose counts all its columns agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactemu.judge.columns import Columns
from tactemu.judge.trial_record import DriverRow
from tactemu.truth import Sample

WINDOW_S = 8.0
"""Greatest age of a row's sample [s]."""
AHEAD_NS = 2_000_000
"""Greatest time by which a sample may seem later than its row [ns]."""


@dataclass(frozen=True)
class Match:
    """The result of matching a row."""

    printed: DriverRow
    sample: int | None
    """Index of the row's sample, with several skins the oldest; ``None``: the row is no sample."""
    marked: bool = False
    """True if the driver marks the row as bad."""
    odd: tuple[str, ...] = ()
    """Columns that differ from the nearest sample."""
    nearest: int | None = None
    """Index of the sample with which most columns agree."""


class Matcher:
    """A search for the sample of each row among the samples added so far."""

    def __init__(self, columns: Columns):
        self.columns = columns
        self._expected = np.zeros((0, len(columns.values)))
        self._slack = np.zeros((0, len(columns.values)))
        self._times = np.zeros(0, np.int64)
        self._filled = 0
        self._skins = columns.by_skin()
        # The columns with the finest steps exclude most samples, so they are compared first.
        gains = [abs(column.gain) or 1.0 for column in columns.values]
        self._first = np.argsort([column.tolerance / gain for column, gain in zip(columns.values, gains)])[:3]

    def add(self, samples: list[Sample]) -> None:
        """Add further samples, in the order of time."""
        if not samples:
            return
        counts = np.array([sample.counts for sample in samples])
        new = self.columns.expected(counts)
        times = np.array([sample.t_ns for sample in samples], np.int64)
        need = self._filled + len(new)
        if need > len(self._times):
            room = max(need, 2 * len(self._times), 256)
            self._expected = np.resize(self._expected, (room, self._expected.shape[1]))
            self._slack = np.resize(self._slack, (room, self._slack.shape[1]))
            self._times = np.resize(self._times, room)
        self._expected[self._filled : need], self._times[self._filled : need] = new, times
        self._slack[self._filled : need] = self.columns.slack(counts)
        self._filled = need

    @property
    def count(self) -> int:
        """The number of samples added so far."""
        return self._filled

    def match(self, printed: DriverRow) -> Match | None:
        """Return the match of a row, or None if it lacks columns and so is no reading."""
        y = self.columns.row(printed.row)
        if y is None:
            return None
        marked = self.columns.marked(printed.row)
        times = self._times[: self._filled]
        low, high = np.searchsorted(times, (printed.t_ns - round(WINDOW_S * 1e9), printed.t_ns + AHEAD_NS))
        if high <= low:
            return Match(printed, None, marked)
        expected, slack = self._expected[low:high], self._slack[low:high]
        first = self._first
        likely = (np.abs(expected[:, first] - y[first]) <= slack[:, first]).all(axis=1)
        for at in np.flatnonzero(likely)[::-1]:
            if (np.abs(expected[at] - y) <= slack[at]).all():
                return Match(printed, int(low + at), marked)
        near = np.abs(expected - y) <= slack
        if len(self._skins) > 1:  # each skin has its own clock and port: only its own columns belong to one sample
            by_skin = [np.flatnonzero(near[:, skin].all(axis=1)) for skin in self._skins]
            if all(len(found) for found in by_skin):
                return Match(printed, int(low + min(found[-1] for found in by_skin)), marked)
        score = near.sum(axis=1)
        best = len(score) - 1 - int(score[::-1].argmax())
        names = self.columns.names
        if not score[best]:
            return Match(printed, None, marked, tuple(names))
        odd = tuple(name for name, ok in zip(names, near[best]) if not ok)
        return Match(printed, None, marked, odd, int(low + best))

    def fits(self, printed: DriverRow, sample: int) -> bool:
        """Return True if all columns of a row agree with the sample of an index."""
        y = self.columns.row(printed.row)
        if y is None or not 0 <= sample < self._filled:
            return False
        return bool((np.abs(self._expected[sample] - y) <= self._slack[sample]).all())

    def between(self, printed: DriverRow, back: int) -> bool:
        """Return True if every column lies in the range of the last ``back`` samples before the row.

        Such a row may come from a filter that is still settling.
        """
        y = self.columns.row(printed.row)
        if y is None or not self._filled:
            return False
        high = int(np.searchsorted(self._times[: self._filled], printed.t_ns + AHEAD_NS))
        window = self._expected[max(0, high - back) : high]
        if not len(window):
            return False
        slack = self._slack[max(0, high - back) : high].max(axis=0) + 1e-9
        return bool(((y >= window.min(axis=0) - slack) & (y <= window.max(axis=0) + slack)).all())
