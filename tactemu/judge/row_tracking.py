"""How the rows of a driver go on: each as the sample that it is, and when it is well again after a fault."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactemu.judge.columns import Columns
from tactemu.judge.outcome import CleanRun
from tactemu.judge.sample_matching import Match, Matcher
from tactemu.judge.trial_record import TrialRecord

SETTLED = 10
"""Right rows in a row after which a driver is well again."""
DISTINCT_SAMPLES = 2
"""Samples between two questions that tell an answer to the one from an answer to the other."""
GRACE_MS = 100.0
"""A reading that is handed out again so long after it was sent, while nothing comes, is stale; or three times as long
as the driver takes at its 99th percentile."""


class RowTracker:
    """The record's rows as samples, in order of time. Also used while a trial runs: more may be fed."""

    def __init__(self, columns: Columns, known: CleanRun):
        self.columns, self.known = columns, known
        self.matcher = Matcher(columns)
        self.matches: list[Match] = []
        self._rows = 0

    def feed(self, record: TrialRecord) -> list[Match]:
        """Match what is new on a record that only grows; returns the new matches, without rows that are no reading."""
        rows = record.rows[self._rows :]  # before the samples: no row is there before its own
        self.matcher.add(record.samples[self.matcher.count :])
        new = [match for printed in rows if (match := self.matcher.match(printed)) is not None]
        self._rows += len(rows)
        self.matches += new
        return new


def left_times(record: TrialRecord) -> np.ndarray:
    """When the last frame of each sample left [ns]; of those that none carried, when they were taken."""
    times = np.array([sample.t for sample in record.samples], np.int64)
    at = {sample.number: k for k, sample in enumerate(record.samples)}
    for frame in record.frames:
        if frame.way == "tx" and frame.sample in at:
            k = at[frame.sample]
            times[k] = max(times[k], frame.t)
    return times


def recovered(
    record: TrialRecord, matches: Sequence[Match], known: CleanRun, after: int, left: np.ndarray | None = None
) -> float | None:
    """Return seconds from ``after`` to the first of ten right rows in a row, all of samples since then and in their
    order.
    """
    left = left_times(record) if left is None else left
    limit_ns = 1e6 * max(GRACE_MS, 2 * known.p99_ms + 2 * known.row_ms)
    questions = Questions(record, known.ask_ms)
    run: list[int] = []
    last = -1
    for match in matches:
        if match.printed.t <= after:
            continue
        k = match.sample
        fresh = k is not None and k < len(left) and left[k] >= after and not match.marked
        if fresh and known.asks:
            fresh = not questions.is_old(match, known)
        elif fresh:
            fresh = match.printed.t - left[k] <= limit_ns
        again = k == last and not known.asks and known.keeps and not known.repeats
        if not fresh or k is None or k < last or again:
            run, last = [], -1
            if not fresh or k is None:
                continue
        run.append(match.printed.t)
        last = k
        if len(run) == SETTLED:
            return (run[0] - after) / 1e9
    return None


class Questions:
    """Of a driver that asks: what was the newest when it asked for a row."""

    def __init__(self, record: TrialRecord, ask_ms: float):
        self._asked = np.array([f.t for f in record.frames if f.way == "rx"])
        self._answered = np.sort(np.array([f.t for f in record.frames if f.way == "tx"]))
        self._usual_ns = 1e6 * ask_ms
        rows = sum(printed.t > record.on for printed in record.rows)
        self._per_row = max(1, round(sum(f.t > record.on for f in record.frames if f.way == "rx") / max(1, rows)))
        """Questions that are asked for one row."""
        self._newest = _newest(record, self._asked)
        """Index of the newest sample by question."""

    def behind(self, match: Match) -> int | None:
        """How many samples were taken since the one that a row is, until the question that it answers; None: unknown.

        A row is heard a little after it was printed, and the next question may have been asked in between: only one
        that is half of the usual time old, or that has been answered since, is what the row answers.
        """
        last = self._last(match)
        if match.sample is None or last < 0:
            return None
        return int(self._newest[last]) - match.sample

    def _last(self, match: Match) -> int:
        """Return the number of the question that a row answers; -1: none was asked."""
        if not len(self._asked):
            return -1
        answered = self._answered[: np.searchsorted(self._answered, match.printed.t, side="right")]
        since = max(match.printed.t - 0.5 * self._usual_ns, answered[-1] if len(answered) else 0)
        return int(np.searchsorted(self._asked, since)) - 1

    def is_one_behind(self, match: Match, matcher: Matcher) -> bool | None:
        """Return True where a row is the answer to the question before; ``None`` where nothing tells them apart."""
        last = self._last(match)
        if match.sample is None or last < self._per_row:
            return None
        newest, before = int(self._newest[last]), int(self._newest[last - self._per_row])
        if newest - before < DISTINCT_SAMPLES:
            return None
        is_newest, is_before = matcher.fits(match.printed, newest), matcher.fits(match.printed, before)
        if is_newest or is_before:  # samples that are held may be both
            return None if is_newest and is_before else is_before
        return match.sample <= before

    def is_old(self, match: Match, known: CleanRun) -> bool:
        """Whether a row was already old when it was asked for."""
        a_row = known.row_ms / max(known.period_ms, 1e-6)
        behind = self.behind(match)
        return behind is not None and behind > known.behind + max(1.0, 0.5 * a_row)


def _newest(record: TrialRecord, asked: np.ndarray) -> np.ndarray:
    """Return the index of the newest sample for each question: the one of its answer, or by time where none came.

    A busy loop takes samples between the arrival of a question and its answer, and a device may answer with the sample
    that it takes next. A frame that is no answer and older than the question tells nothing.
    """
    newest = np.searchsorted(np.array([sample.t for sample in record.samples]), asked, side="right") - 1
    index = {sample.number: k for k, sample in enumerate(record.samples)}
    question, is_open = -1, False
    for frame in sorted(record.frames, key=lambda frame: frame.t):
        if frame.way == "rx":
            question, is_open = question + 1, True
        elif is_open and frame.sample in index and (frame.answer or index[frame.sample] >= newest[question]):
            newest[question], is_open = index[frame.sample], False
    return newest
