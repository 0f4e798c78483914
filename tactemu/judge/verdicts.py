"""Verdicts on a driver: a pure function of the record of a trial.

A row is *right* if all its columns agree with one sample that was sent. The verdicts follow from the other rows and
from the times of all rows. Thresholds are at the top of the file that uses them, each with its reason.
"""

from __future__ import annotations

import json
from collections import Counter
from functools import cached_property

import numpy as np

from tactemu.judge import proof
from tactemu.judge.checks import clipped, frozen, mirrored, misnamed, misread, misscaled, unread_channels
from tactemu.judge.columns import Columns
from tactemu.judge.outcome import ABOUT, CleanRun, Finding, Outcome
from tactemu.judge.row_tracking import SETTLED, Questions, RowTracker, left_times, recovered
from tactemu.judge.trial_counts import (
    LEAK_AT_ONCE_BYTES,
    LEAK_BYTES,
    count_messages,
    count_rows,
    measure_resources,
    shortened,
    template,
)
from tactemu.judge.trial_record import TrialRecord

LATE_MS = 5.0
"""Latency that a driver may always have at its median; half a period if that is more [ms]."""
SPINNING_CPU_SHARE = 0.3
"""Least share of a core that a driver takes which waits in a busy loop."""
BLOCKING_SHARE = 0.8
"""Least share of an outage without a row or message, for a driver that blocks."""
USUAL_COUNT = 3
"""A message that the driver prints at least so often without faults does not count as a new one."""
MAX_LOST_SHARE = 0.004
"""Largest share of good readings lost without any fault."""
MIN_IN_TIME_SHARE = 0.5
"""Least share of readings sent in time; with fewer the machine is too busy to judge losses."""
COLLATERAL_SHARE = 0.05
"""Largest share of all good readings that may be lost besides those that were hit."""
COLLATERAL_PER_HIT = 0.25
"""Largest number of good readings for each hit frame that may be lost besides."""
OUT_OF_ORDER_TRIALS = ("reordered", "old frame")
"""Trials in which old frames come after newer ones; where frames carry a number, a driver can drop the old ones."""
ONE_BEHIND_SHARE = 0.7
"""Least share of rows that answer the previous question, for a driver that never takes its newest answer."""
MIN_ANSWERS = 20
"""Least number of rows for this share."""
OLD_ANSWER_TRIALS = ("doubled", "late answer", "old frame")
"""Trials in which an old answer does come; without a number in it, a driver cannot recognise one or two of them."""


def judge_record(record: TrialRecord) -> Outcome:
    """Return the outcome of a recorded trial."""
    columns, known = Columns.from_dict(record.columns or {"columns": []}), CleanRun(**record.known)
    trial = record.trial
    out = Outcome(
        record.name, trial.get("why", ""), skipped=trial.get("skipped", ""), lacks_time=trial.get("lacks_time", False)
    )
    out.seconds = (record.end - record.on) / 1e9
    if out.skipped:
        out.verdict = f"not tried: {out.skipped}"
        return out
    if record.trouble:
        kind = _kind_of_trouble(record.trouble)
        out.findings.append(Finding(kind, record.trouble.removeprefix(f"{kind}: ")))
        out.verdict = str(out.findings[0])
        return out
    tracker = RowTracker(columns, known)
    tracker.feed(record)
    left = left_times(record)
    count_rows(out, record, tracker, left)
    count_messages(out, record, known)
    measure_resources(out, record)
    out.recovered_s = recovered(record, tracker.matches, known, record.off, left)
    out.findings = _FindingRules(out, record, tracker, columns, known).findings()
    out.remark = trial.get("remark", "") if out.has("wrong") else ""
    out.skipped = "" if out.findings else proof.missing(record, columns, known)
    out.verdict = "; ".join(map(str, out.findings)) or _otherwise(out, known)
    return out


def _kind_of_trouble(text: str) -> str:
    for kind in ("died", "floods", "unlearned"):
        if text.startswith((kind, {"died": "exits", "unlearned": "no row", "floods": "prints more"}[kind])):
            return kind
    return "silent"


def _otherwise(out: Outcome, known: CleanRun) -> str:
    if out.skipped:
        return f"not tried: {out.skipped}"
    if out.notes or out.marked:
        return "noticed"
    if out.name == "clean" and known.keeps and not known.asks and out.sent < MIN_IN_TIME_SHARE * out.right:
        return "right; this machine was too busy to tell whether readings were lost"
    return "right" if not out.lost else f"right; {_readings(out.lost)} lost besides those that were hit"


def _readings(count: int, which: str = "") -> str:
    return f"{count} {which}reading{'s' * (count != 1)}"


class _FindingRules:
    """The rules that turn the counts of a trial into findings."""

    def __init__(self, out: Outcome, record: TrialRecord, tracker: RowTracker, columns: Columns, known: CleanRun):
        self.out, self.record, self.tracker, self.columns, self.known = out, record, tracker, columns, known
        self.trial = record.trial
        self.action = record.trial.get("action", "")
        self.noticed = out.notes + out.marked > 0

    def findings(self) -> list[Finding]:
        """Return the findings, worst first."""
        found = [*self._ends(), *self._wrong(), *self._stale(), *self._sync(), *self._waits(), *self._clean()]
        found += [*self._mixed(), *self._collateral(), *self._keeps_up(), *self._late(), *self._leaks()]
        return sorted(found, key=lambda finding: list(ABOUT).index(finding.kind))

    @property
    def _outage(self) -> bool:
        return self.action in ("hang", "unplug", "halfopen", "stop", "baud")

    @property
    def _may_leave(self) -> bool:
        """True if the driver may end: with a message at the first outage of the port, not after it has come back."""
        return self.action in ("unplug", "halfopen") and self.noticed and proof.outages(self.record) < 2

    def _ends(self):
        exit = self.record.exit
        if exit is None or self._may_leave:
            return
        how = f"signal {-exit}" if exit < 0 else f"exit status {exit}"
        last = next((note.text for note in reversed(self.record.notes) if note.err), "")
        yield Finding("died", f"{how}{': ' + shortened(last) if last else ''}")

    def _wrong(self):
        out = self.out
        if out.wrong:
            odd = Counter(name for bad in out.bad if not bad["old"] for name in bad["odd"])
            names = [name for name, _ in odd.most_common(3)]
            which = f", such as in column{'s' * (len(names) > 1)} {', '.join(names)}" if names else ""
            yield Finding("wrong", f"{out.wrong} of {out.rows} rows match no sample that was sent{which}")

    def _stale(self):
        out = self.out
        asks = self.known.asks and not self._outage
        again = out.injected if asks and self.record.name in OLD_ANSWER_TRIALS else 0
        if out.stale >= 2 + again:
            since = "although the driver has asked since" if asks else "while nothing is sent"
            yield Finding("stale", f"{out.stale} rows: each repeats an earlier reading, {since}")
        if asks and out.behind > 5 + 2 * again and out.behind > 0.3 * out.rows:
            yield Finding("stale", f"{out.behind} rows: each is the answer to an earlier question")

    def _sync(self):
        out, exit = self.out, self.record.exit
        after = any(printed.t_ns > self.record.off for printed in self.record.rows)
        if self._may_leave and not after:
            return
        if out.recovered_s is None and exit is None and self.trial.get("recovers", True):
            waited = (self.record.end - self.record.off) / 1e9
            yield Finding("lost sync", f"no {SETTLED} consecutive right rows within {waited:.1f} s after the fault")

    def _waits(self):
        out = self.out
        lasted = (self.record.off - self.record.on) / 1e9
        if self.action not in ("hang", "halfopen") or self.noticed or lasted < 1.0 or out.stale >= 2:
            return
        if out.quiet_s > BLOCKING_SHARE * lasted:
            spins = out.cpu > SPINNING_CPU_SHARE
            words = f"uses {out.cpu:.0%} of a core" if spins else "waits"
            yield Finding("spins" if spins else "blocks", f"{words} during the outage and prints no message")

    @cached_property
    def _behind(self) -> tuple[int, int] | None:
        """The number of rows that answer the previous question, and of all rows that can be told; None if few do."""
        if self.action != "clean" or not self.known.asks:
            return None
        questions = Questions(self.record, self.known.ask_ms)
        during = [match for match in self.tracker.matches if match.printed.t_ns > self.record.on]
        answers = [questions.is_one_behind(match, self.tracker.matcher) for match in during]
        yes, no = answers.count(True), answers.count(False)
        return (yes, yes + no) if yes + no >= MIN_ANSWERS and yes > ONE_BEHIND_SHARE * (yes + no) else None

    def _clean(self):
        out = self.out
        if self.action != "clean":
            return
        if self._behind:
            behind, answers = self._behind
            yield Finding("stale", f"{behind} of {answers} rows: each is the answer to the question before")
        yield from (Finding("wrong", text) for text in misread(self.columns))
        if exchanged := misnamed(self.columns) or mirrored(self.columns):
            yield Finding("order", ", ".join(exchanged[:4]))
        if same := [*frozen(self.columns), *clipped(self.columns)]:
            yield Finding("clipped", ", ".join(same[:3]))
        if scaled := misscaled(self.columns):
            yield Finding("scale", ", ".join(scaled[:3]))
        if left := [channel.name for channel in unread_channels(self.columns)]:
            yield Finding("unread", f"{len(left)} channels are in no column, such as {', '.join(left[:3])}")
        if self.known.keeps and not self.known.asks and out.lost >= 2 and out.lost > MAX_LOST_SHARE * out.sent:
            yield Finding("loses", f"{out.lost} of {out.sent} good readings, without a fault")

    def _mixed(self):
        out, known = self.out, self.known
        usual = known.asks or not known.keeps or (known.repeats and self.action != "clean")
        odd = out.older + (0 if usual else out.again) - out.stale
        is_numbered = known.numbered and self.record.name in OUT_OF_ORDER_TRIALS
        allowed = out.injected if self.record.name in ("doubled", *OUT_OF_ORDER_TRIALS) and not is_numbered else 0
        if odd > allowed + 1 and not self._outage and self.action not in ("reset", "wrap", "saturate"):
            words = "are older than those before them, by their numbers" if is_numbered else "repeat earlier readings"
            yield Finding("again", f"{odd} rows {words}")

    def _collateral(self):
        out = self.out
        plain = not self._outage and self.action in ("", "frames")
        if not (self.known.keeps and plain) or self.known.asks or out.recovered_s is None:
            return
        if out.lost > 1 + COLLATERAL_PER_HIT * out.injected and out.lost > COLLATERAL_SHARE * max(1, out.sent):
            yield Finding("collateral", f"{_readings(out.lost, 'good ')} lost besides the {out.injected} that were hit")

    def _keeps_up(self):
        out = self.out
        if self.action == "rate" and self.known.keeps and not self.known.asks and out.lost > max(3, 0.02 * out.sent):
            yield Finding("loses", f"{out.lost} of {out.sent} at {self.trial.get('rate_hz', 0):g} Hz")

    def _late(self):
        out = self.out
        limit = max(LATE_MS, 0.5 * self.known.period_ms if not self.known.asks else LATE_MS) + self.record.late_ms
        is_late = out.p50_ms is not None and out.p50_ms > limit
        if self.action == "clean" and is_late and not self._behind:
            of = "after the answer's last byte" if self.known.asks else "after the frame's last byte"
            yield Finding("late", f"{out.p50_ms:.1f} ms {of} at the median, {out.p99_ms:.1f} ms at the 99th percentile")

    def _leaks(self):
        if self.out.leak > LEAK_BYTES:
            yield Finding("leaks", f"memory grows by {self.out.leak:.0f} bytes with each reading")
        elif self.out.grown >= LEAK_AT_ONCE_BYTES:
            took = (self.record.off - self.record.on) / 1e9
            yield Finding("leaks", f"memory grows by {self.out.grown / 1e6:.0f} MB within {took:.1f} s")


def measure_clean_run(
    record: TrialRecord, columns: Columns, *, asks: bool, period_ms: float, numbered: bool = False
) -> CleanRun:
    """Return the facts from the record of a run without faults, for the trials after it."""
    times = [printed.t_ns for printed in record.rows if record.on < printed.t_ns <= record.end]
    row_ms = float(np.median(np.diff(times))) / 1e6 if len(times) > 2 else period_ms
    known = CleanRun(asks=asks, period_ms=period_ms, row_ms=row_ms, behind=1_000_000, numbered=numbered)
    usual = Counter(template(note.text) for note in record.notes if note.t_ns > record.on)
    usual.update(template(json.dumps(dict(printed.row))) for printed in record.rows if columns.row(printed.row) is None)
    known.usual = [text for text, count in usual.most_common(200) if count >= USUAL_COUNT]
    tracker = RowTracker(columns, known)
    tracker.feed(record)
    probe = Outcome("clean")
    count_rows(probe, record, tracker, left_times(record))
    known.p50_ms, known.p99_ms = probe.p50_ms or 0.0, probe.p99_ms or 0.0
    known.repeats = probe.again > 0.1 * max(1, probe.rows)
    known.keeps = not asks and probe.lost <= 0.03 * max(1, probe.right)
    if asks:
        known.ask_ms = _ask_ms(record)
        known.behind = _usually_behind(record, tracker, known.ask_ms)
    return known


def _ask_ms(record: TrialRecord) -> float:
    asked = np.array([f.t_ns for f in record.frames if f.kind == "rx"])
    waits = [
        printed.t_ns - asked[last]
        for printed in record.rows
        if printed.t_ns > record.on and (last := int(np.searchsorted(asked, printed.t_ns)) - 1) >= 0
    ]
    return float(np.quantile(waits, 0.1)) / 1e6 if waits else 0.0


def _usually_behind(record: TrialRecord, tracker: RowTracker, ask_ms: float) -> int:
    questions = Questions(record, ask_ms)
    during = [match for match in tracker.matches if match.printed.t_ns > record.on]
    behind = [each for match in during if (each := questions.behind(match)) is not None]
    return max(0, round(float(np.quantile(behind, 0.99)))) if behind else 0
