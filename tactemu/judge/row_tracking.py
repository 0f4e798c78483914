"""Tracking of a driver's rows: the sample of each row, its age, and the driver's recovery after a fault."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactemu.judge.columns import Columns
from tactemu.judge.outcome import CleanRun
from tactemu.judge.sample_matching import Match, Matcher
from tactemu.judge.trial_record import TrialRecord

SETTLED = 10
"""Number of consecutive right rows after which a driver has recovered."""
DISTINCT_SAMPLES = 2
"""Least number of samples between two questions by which their answers can be told apart."""
GRACE_MS = 100.0
"""Age from which a reading that is handed out again while nothing is sent is stale [ms]; three times the driver's 99th
percentile if that is longer."""


class RowTracker:
    """A tracker that matches the rows of a record with its samples; the record may grow between two calls."""

    def __init__(self, columns: Columns, known: CleanRun):
        self.columns, self.known = columns, known
        self.matcher = Matcher(columns)
        self.matches: list[Match] = []
        self._rows = 0

    def feed(self, record: TrialRecord) -> list[Match]:
        """Match the new rows of a growing record, and return the new matches, without rows that are no reading."""
        rows = record.rows[self._rows :]  # taken before the samples, so that the sample of each row is there
        self.matcher.add(record.samples[self.matcher.count :])
        new = [match for printed in rows if (match := self.matcher.match(printed)) is not None]
        self._rows += len(rows)
        self.matches += new
        return new


def left_times(record: TrialRecord) -> np.ndarray:
    """Return the time at which the last frame of each sample left, or its sampling time if no frame carried it [ns]."""
    times = np.array([sample.t_ns for sample in record.samples], np.int64)
    at = {sample.number: k for k, sample in enumerate(record.samples)}
    for frame in record.frames:
        if frame.kind == "tx" and frame.sample in at:
            k = at[frame.sample]
            times[k] = max(times[k], frame.t_ns)
    return times


def recovered(
    record: TrialRecord, matches: Sequence[Match], known: CleanRun, after: int, left: np.ndarray | None = None
) -> float | None:
    """Return the time from ``after`` to the first of ten consecutive right rows [s], or None if there are none.

    The rows must be of samples since then, in their order.
    """
    left = left_times(record) if left is None else left
    limit_ns = 1e6 * max(GRACE_MS, 2 * known.p99_ms + 2 * known.row_ms)
    questions = Questions(record, known.ask_ms)
    run: list[int] = []
    last = -1
    for match in matches:
        if match.printed.t_ns <= after:
            continue
        k = match.sample
        fresh = k is not None and k < len(left) and left[k] >= after and not match.marked
        if fresh and known.asks:
            fresh = not questions.is_old(match, known)
        elif fresh:
            fresh = match.printed.t_ns - left[k] <= limit_ns
        again = k == last and not known.asks and known.keeps and not known.repeats
        if not fresh or k is None or k < last or again:
            run, last = [], -1
            if not fresh or k is None:
                continue
        run.append(match.printed.t_ns)
        last = k
        if len(run) == SETTLED:
            return (run[0] - after) / 1e9
    return None


class Questions:
    """The questions of a driver that polls, with the newest sample at each."""

    def __init__(self, record: TrialRecord, ask_ms: float):
        self._asked = np.array([f.t_ns for f in record.frames if f.kind == "rx"])
        self._answered = np.sort(np.array([f.t_ns for f in record.frames if f.kind == "tx"]))
        self._usual_ns = 1e6 * ask_ms
        rows = sum(printed.t_ns > record.on for printed in record.rows)
        self._per_row = max(1, round(sum(f.t_ns > record.on for f in record.frames if f.kind == "rx") / max(1, rows)))
        """Number of questions for one row."""
        self._newest = _newest(record, self._asked)
        """Index of the newest sample at each question."""

    def behind(self, match: Match) -> int | None:
        """Return the number of samples between a row's sample and the question that it answers; None if unknown.

        A row is received a little after it was printed, and the next question may have been asked in between: the row
        answers the last question that is at least half of the usual time old, or that has been answered since.
        """
        last = self._last(match)
        if match.sample is None or last < 0:
            return None
        return int(self._newest[last]) - match.sample

    def _last(self, match: Match) -> int:
        """Return the number of the question that a row answers, or -1 if there was none."""
        if not len(self._asked):
            return -1
        answered = self._answered[: np.searchsorted(self._answered, match.printed.t_ns, side="right")]
        since = max(match.printed.t_ns - 0.5 * self._usual_ns, answered[-1] if len(answered) else 0)
        return int(np.searchsorted(self._asked, since)) - 1

    def is_one_behind(self, match: Match, matcher: Matcher) -> bool | None:
        """Return True if a row answers the previous question, or None if the two answers cannot be told apart."""
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
        """Return True if a row's sample was already old when the driver asked for it."""
        a_row = known.row_ms / max(known.period_ms, 1e-6)
        behind = self.behind(match)
        return behind is not None and behind > known.behind + max(1.0, 0.5 * a_row)


def _newest(record: TrialRecord, asked: np.ndarray) -> np.ndarray:
    """Return the index of the newest sample for each question: that of its answer, or by time if there is no answer.

    A busy loop takes samples between the arrival of a question and its answer, and a device may answer with its next
    sample. A frame that is no answer and older than the question is ignored.
    """
    newest = np.searchsorted(np.array([sample.t_ns for sample in record.samples]), asked, side="right") - 1
    index = {sample.number: k for k, sample in enumerate(record.samples)}
    question, is_open = -1, False
    for frame in sorted(record.frames, key=lambda frame: frame.t_ns):
        if frame.kind == "rx":
            question, is_open = question + 1, True
        elif is_open and frame.sample in index and (frame.is_answer or index[frame.sample] >= newest[question]):
            newest[question], is_open = index[frame.sample], False
    return newest
