"""Which sample a row is: the one of the last seconds with whose counts all its columns agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactemu.judge.columns import Columns
from tactemu.judge.trial_record import DriverRow, Sample

WINDOW_S = 8.0
"""A row is no older sample than this."""
AHEAD_NS = 2_000_000
"""By how much the times of a sample and of a row may contradict each other."""


@dataclass(frozen=True)
class Match:
    """What a row turned out to be."""

    printed: DriverRow
    sample: int | None
    """Index of its sample, of several skins the oldest; ``None``: it is none."""
    marked: bool = False
    """The driver says that something is wrong with it."""
    odd: tuple[str, ...] = ()
    """Columns that differ from the sample which the others name."""
    nearest: int | None = None
    """That sample."""


class Matcher:
    """Finds the sample of each row among those taken so far; more may be added."""

    def __init__(self, columns: Columns):
        self.columns = columns
        self._expected = np.zeros((0, len(columns.values)))
        self._slack = np.zeros((0, len(columns.values)))
        self._times = np.zeros(0, np.int64)
        self._filled = 0
        self._skins = columns.by_skin()
        # The columns with the finest steps exclude most samples: they are looked at first.
        gains = [abs(column.gain) or 1.0 for column in columns.values]
        self._first = np.argsort([column.tolerance / gain for column, gain in zip(columns.values, gains)])[:3]

    def add(self, samples: list[Sample]) -> None:
        """Samples after those that were added."""
        if not samples:
            return
        counts = np.array([sample.counts for sample in samples])
        new = self.columns.expected(counts)
        times = np.array([sample.t for sample in samples], np.int64)
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
        """How many samples were added."""
        return self._filled

    def match(self, printed: DriverRow) -> Match | None:
        """What a row is; ``None`` where it lacks columns: it is no reading."""
        y = self.columns.row(printed.row)
        if y is None:
            return None
        marked = self.columns.marked(printed.row)
        times = self._times[: self._filled]
        low, high = np.searchsorted(times, (printed.t - round(WINDOW_S * 1e9), printed.t + AHEAD_NS))
        if high <= low:
            return Match(printed, None, marked)
        expected, slack = self._expected[low:high], self._slack[low:high]
        first = self._first
        likely = (np.abs(expected[:, first] - y[first]) <= slack[:, first]).all(axis=1)
        for at in np.flatnonzero(likely)[::-1]:
            if (np.abs(expected[at] - y) <= slack[at]).all():
                return Match(printed, int(low + at), marked)
        near = np.abs(expected - y) <= slack
        if len(self._skins) > 1:  # each has a clock and a port of its own: only its own columns belong together
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
        """Return whether all columns of a row agree with a sample, given by its index."""
        y = self.columns.row(printed.row)
        if y is None or not 0 <= sample < self._filled:
            return False
        return bool((np.abs(self._expected[sample] - y) <= self._slack[sample]).all())

    def between(self, printed: DriverRow, back: int) -> bool:
        """Whether every column lies within what the last ``back`` samples before the row span: a filter on its way."""
        y = self.columns.row(printed.row)
        if y is None or not self._filled:
            return False
        high = int(np.searchsorted(self._times[: self._filled], printed.t + AHEAD_NS))
        window = self._expected[max(0, high - back) : high]
        if not len(window):
            return False
        slack = self._slack[max(0, high - back) : high].max(axis=0) + 1e-9
        return bool(((y >= window.min(axis=0) - slack) & (y <= window.max(axis=0) + slack)).all())
