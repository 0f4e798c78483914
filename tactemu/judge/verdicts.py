"""What a recorded trial says of the driver: a pure function of the tape.

A row is *right* if it is, column by column, a sample that was sent. What is done with the others, and when they come,
are the verdicts. Thresholds stand at the top of this file; each has its reason.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from tactemu.judge.columns import MISTAKES as MISTAKEN
from tactemu.judge.columns import Columns, misnamed, misscaled
from tactemu.judge.excitation import STEP
from tactemu.judge.matching import Match, Matcher
from tactemu.judge.tape import Tape

SETTLED = 10
"""Right rows in a row after which a driver is well again."""
LATE_MS = 5.0
"""A driver may always be so late at its median; half a period, if that is more."""
GRACE_MS = 100.0
"""A reading that is handed out again so long after it was sent, while nothing comes, is stale; or three times as long
as the driver takes at its 99th percentile."""
OWN_LATE_MS = 2.0
"""Where our own loop was later than this, nobody judges how late the driver is."""
LEAK_BYTES, LEAK_FLOOR = 500, 1_000_000
"""Growth for each reading, and in all, from which on memory is said to leak [byte]."""
LEAK_STEPS = 0.15
"""Share of looks at the memory at which it must have grown: a buffer that is doubled once is no leak."""
SPINS = 0.3
"""Share of a core that a driver takes which waits in a loop."""
BLOCKS = 0.8
"""Share of a silence in which nothing comes of a driver that blocks."""
OFTEN = 3
"""What a driver says so often when nothing is wrong says nothing when something is."""
LOSES = 0.004
"""Share of good readings lost without any fault."""
COLLATERAL = 0.05, 0.25
"""Share of good readings, and of those hit, that may be lost beside those that were hit."""

ABOUT = {
    "wrong": "silent wrong values",
    "stale": "stale",
    "lost sync": "lost sync",
    "died": "died",
    "silent": "prints nothing",
    "late": "late",
    "leaks": "leaks",
    "blocks": "blocks",
    "spins": "spins",
    "collateral": "collateral loss",
    "loses": "loses readings",
    "again": "again or out of order",
    "order": "axes exchanged",
    "scale": "another scale",
    "floods": "floods",
    "unlearned": "cannot be told",
}
"""Kinds of finding, worst first, with the words of the reports."""
FAILING = ("wrong", "stale", "lost sync", "died", "silent", "floods", "unlearned")
"""Those that fail a run unless ``--fail-on`` says otherwise."""


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with the driver."""

    kind: str
    text: str

    def __str__(self) -> str:
        return f"{ABOUT[self.kind]}: {self.text}" if self.text else ABOUT[self.kind]


@dataclass
class Known:
    """What the run without faults has shown."""

    asks: bool = False
    """The driver asks for readings; a stream comes by itself."""
    period_ms: float = 10.0
    """Of the device's samples."""
    row_ms: float = 10.0
    """Median time from row to row."""
    p50_ms: float = 0.0
    p99_ms: float = 0.0
    keeps: bool = True
    """Every sample comes out, so that a lost one counts."""
    repeats: bool = False
    """It hands out readings more than once, also when nothing is wrong."""
    behind: int = 0
    """Of a driver that asks: by how many samples a row may be older than the question."""
    ask_ms: float = 0.0
    """Of a driver that asks: from the question to the row, in the quickest tenth."""
    usual: list[str] = field(default_factory=list)
    """What the driver says when nothing is wrong, digits aside."""


@dataclass
class Outcome:
    """What came of a trial."""

    name: str
    why: str = ""
    findings: list[Finding] = field(default_factory=list)
    verdict: str = ""
    """One line: the findings, or what there is instead."""
    injected: int = 0
    rows: int = 0
    right: int = 0
    wrong: int = 0
    marked: int = 0
    again: int = 0
    older: int = 0
    stale: int = 0
    behind: int = 0
    """Of a driver that asks: rows that answer an earlier question."""
    lost: int = 0
    """Unharmed samples that left and never came, though earlier and later ones did."""
    sent: int = 0
    """Samples that left."""
    notes: int = 0
    """New things that it said."""
    said: list[str] = field(default_factory=list)
    p50_ms: float | None = None
    p99_ms: float | None = None
    worst_ms: float | None = None
    age_ms: float | None = None
    """Of a driver that asks: how old the samples were, median."""
    waits_ms: list[float] = field(default_factory=list)
    """Of every right row."""
    recovered_s: float | None = None
    quiet_s: float = 0.0
    """The longest time without a row or a word while the fault lasted."""
    cpu: float = 0.0
    """Share of a core."""
    leak: float = 0.0
    """Growth for each reading [byte]."""
    bad: list[dict[str, Any]] = field(default_factory=list)
    """The first rows that are no sample, each beside the sample that it is nearest to."""
    seconds: float = 0.0
    confirmed: bool | None = None
    """Whether the findings came again in a second run; ``None``: not tried."""
    skipped: str = ""
    case: dict[str, Any] | None = None
    """The smallest case, as :mod:`tactemu.judge.smallest` found it."""

    def has(self, *kinds: str) -> bool:
        """Whether there is a finding of one of these kinds."""
        return any(finding.kind in kinds for finding in self.findings)

    def fails(self, kinds: Sequence[str]) -> bool:
        """Whether it fails a run."""
        return self.has(*kinds) and self.confirmed is not False

    def as_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def template(text: str) -> str:
    """A text without what differs each time."""
    return re.sub(r"0x[0-9a-fA-F]+|\d+(\.\d+)?(e-?\d+)?", "#", text)[:120]


# -- how the rows go on ------------------------------------------------------------------------------------------------


class Reading:
    """The tape's rows as samples, in order of time. Also used while a trial runs: more may be fed."""

    def __init__(self, columns: Columns, known: Known):
        self.columns, self.known = columns, known
        self.matcher = Matcher(columns)
        self.matches: list[Match] = []
        self._rows = 0

    def feed(self, tape: Tape) -> list[Match]:
        """Match what is new on a tape that only grows; returns the new matches, without rows that are no reading."""
        rows = tape.rows[self._rows :]  # before the samples: no row is there before its own
        self.matcher.add(tape.samples[self.matcher.count :])
        new = [match for said in rows if (match := self.matcher.match(said)) is not None]
        self._rows += len(rows)
        self.matches += new
        return new


def left_times(tape: Tape) -> np.ndarray:
    """When the last frame of each sample left [ns]; of those that none carried, when they were taken."""
    times = np.array([sample.t for sample in tape.samples], np.int64)
    at = {sample.number: k for k, sample in enumerate(tape.samples)}
    for frame in tape.frames:
        if frame.way == "tx" and frame.sample in at:
            k = at[frame.sample]
            times[k] = max(times[k], frame.t)
    return times


def recovered(
    tape: Tape, matches: Sequence[Match], known: Known, after: int, left: np.ndarray | None = None
) -> float | None:
    """Seconds from ``after`` to the first of ten right rows in a row, all of samples since then and in their order."""
    left = left_times(tape) if left is None else left
    limit_ns = 1e6 * max(GRACE_MS, 2 * known.p99_ms + 2 * known.row_ms)
    asked = np.array([f.t for f in tape.frames if f.way == "rx"]) if known.asks else np.zeros(0)
    times = np.array([sample.t for sample in tape.samples])
    run: list[int] = []
    last = -1
    for match in matches:
        if match.said.t <= after:
            continue
        k = match.sample
        fresh = k is not None and k < len(left) and left[k] >= after and not match.marked
        if fresh and known.asks:
            fresh = not _old(match, times, asked, known)
        elif fresh:
            fresh = match.said.t - left[k] <= limit_ns
        again = k == last and not known.asks and known.keeps and not known.repeats
        if not fresh or k is None or k < last or again:
            run, last = [], -1
            if not fresh or k is None:
                continue
        run.append(match.said.t)
        last = k
        if len(run) == SETTLED:
            return (run[0] - after) / 1e9
    return None


def _old(match: Match, times: np.ndarray, asked: np.ndarray, known: Known) -> bool:
    """Whether a row of a driver that asks was already old when it asked."""
    if match.sample is None or not len(asked):
        return False
    # A row is heard a little after it was printed; what was asked in between is not what it answers.
    last = int(np.searchsorted(asked, match.said.t - 0.5e6 * known.ask_ms)) - 1
    if last < 0:
        return False
    newest = int(np.searchsorted(times, asked[last], side="right")) - 1
    a_row = known.row_ms / max(known.period_ms, 1e-6)
    return newest - match.sample > known.behind + max(1.0, 0.5 * a_row)


# -- one trial ---------------------------------------------------------------------------------------------------------


def judged(tape: Tape) -> Outcome:
    """What a recorded trial says."""
    columns, known = Columns.from_dict(tape.columns or {"columns": []}), Known(**tape.known)
    trial = tape.trial
    out = Outcome(tape.name, trial.get("why", ""), skipped=trial.get("skipped", ""))
    out.seconds = (tape.end - tape.on) / 1e9
    if out.skipped:
        out.verdict = f"skipped: {out.skipped}"
        return out
    if tape.trouble:
        out.findings.append(Finding(_kind_of_trouble(tape.trouble), tape.trouble))
        out.verdict = str(out.findings[0])
        return out
    reading = Reading(columns, known)
    reading.feed(tape)
    left = left_times(tape)
    _count(out, tape, reading, left)
    _listen(out, tape, known)
    _weigh(out, tape)
    out.recovered_s = recovered(tape, reading.matches, known, tape.off, left)
    out.findings = _Rules(out, tape, columns, known).findings()
    out.verdict = "; ".join(map(str, out.findings)) or _otherwise(out)
    return out


def _kind_of_trouble(text: str) -> str:
    for kind in ("died", "floods", "unlearned"):
        if text.startswith((kind, {"died": "exits", "unlearned": "no row", "floods": "prints more"}[kind])):
            return kind
    return "silent"


def _otherwise(out: Outcome) -> str:
    if out.notes or out.marked:
        return "noticed"
    return "right" if not out.lost else f"right; {out.lost} readings beside those hit never came"


def _count(out: Outcome, tape: Tape, reading: Reading, left: np.ndarray) -> None:
    """Every row of the trial is one of: right, wrong, marked, again, older."""
    known = reading.known
    times = np.array([sample.t for sample in tape.samples])
    sent_at = np.sort(np.array([f.t for f in tape.frames if f.way == "tx"], np.int64))
    asked = np.array([f.t for f in tape.frames if f.way == "rx"]) if known.asks else np.zeros(0)
    answers = _answers(tape) if known.asks else {}
    grace = 1e6 * max(GRACE_MS, 3 * known.p99_ms)
    last, seen, ages = -1, set(), []
    for match in reading.matches:
        t, k = match.said.t, match.sample
        if t > tape.end:
            break
        if t <= tape.on:  # only to know what was handed out last
            last = max(last, k if k is not None else -1)
            continue
        out.rows += 1
        nothing = any(math.isnan(value) for value in match.said.row.values())
        if match.marked or nothing:
            out.marked += 1
        elif k is None:
            if reading.columns.steps and reading.matcher.between(match.said, 2 * STEP + STEP // 2):
                continue
            out.wrong += 1
            _keep_bad(out, match, tape, reading)
        elif k > last or (known.asks and k == last):
            old = known.asks and _old(match, times, asked, known)
            if old and k == last:  # handed out before, and asked for again since
                out.stale += 1
                _keep_bad(out, match, tape, reading, old=True)
            else:
                out.right += 1
                out.behind += old
                out.waits_ms.append(_wait_ns(match, left, answers, sent_at, tape) / 1e6)
                ages.append((t - times[k]) / 1e6)
        else:
            idle = t - sent_at[max(0, int(np.searchsorted(sent_at, t)) - 1)] > grace if len(sent_at) else True
            stale = (t - left[k] > grace and idle) or (known.asks and _old(match, times, asked, known))
            out.stale += stale
            if stale:
                _keep_bad(out, match, tape, reading, old=True)
            out.again += k == last
            out.older += k < last
        if k is not None and not match.marked:
            seen.add(k)
            last = max(last, k)
    out.lost, out.sent = _lost(tape, seen)
    out.injected = len([change for change in tape.changes if change.t >= tape.on])
    if out.waits_ms:
        p50, p99, worst = np.quantile(out.waits_ms, (0.5, 0.99, 1.0))
        out.p50_ms, out.p99_ms, out.worst_ms = float(p50), float(p99), float(worst)
    if known.asks and ages:
        out.age_ms = float(np.median(ages))


def _wait_ns(match: Match, left: np.ndarray, answers: Mapping[int, list[int]], sent_at: np.ndarray, tape: Tape) -> int:
    """From the last byte that a row needed to the driver's hands; of one that asks, from the end of the answer."""
    t, k = match.said.t, match.sample
    assert k is not None
    if answers:
        own = [each for each in answers.get(tape.samples[k].number, ()) if each <= t]
        if own:
            return t - own[-1]
        at = int(np.searchsorted(sent_at, t)) - 1
        return t - int(sent_at[at]) if at >= 0 else 0
    return t - int(left[k])


def _answers(tape: Tape) -> dict[int, list[int]]:
    """When frames left that carried a sample, by its number."""
    found: dict[int, list[int]] = {}
    for frame in tape.frames:
        if frame.way == "tx" and frame.sample is not None:
            found.setdefault(frame.sample, []).append(frame.t)
    return found


def _lost(tape: Tape, seen: set[int]) -> tuple[int, int]:
    """Unharmed samples that left between the first and the last that came and did not come; and how many left."""
    if not seen:
        return 0, 0
    times = np.array([sample.t for sample in tape.samples])
    number = {sample.number: k for k, sample in enumerate(tape.samples)}
    carried = {number[f.sample] for f in tape.frames if f.way == "tx" and f.sample in number}
    harmed = set()
    for change in tape.changes:
        if change.what in HARMLESS:
            continue
        harmed.add(int(np.searchsorted(times, change.t, side="right")) - 1)
    window = {k for k in carried if min(seen) < k < max(seen) and times[k] >= tape.on}
    return len(window - seen - harmed), len(window)


CAME_AGAIN = ("doubled", "late answer", "old frame")
"""Trials in which an old answer does come; where answers have no number, nobody can tell one or two."""
HARMLESS = ("duplicate", "garbage", "split", "chunk", "merge", "late", "stray", "reorder", "latency")
"""Faults after which the frame itself is still there."""


def _keep_bad(out: Outcome, match: Match, tape: Tape, reading: Reading, old: bool = False) -> None:
    if len(out.bad) >= 8:
        return
    near = match.sample if old else match.nearest
    truth = {}
    if near is not None:
        expected = reading.columns.expected(tape.samples[near].counts[None])[0]
        truth = dict(zip(reading.columns.names, expected.tolist()))
    row = dict(list(match.said.row.items())[:64])
    out.bad.append({
        "t": match.said.t, "row": row, "odd": list(match.odd)[:16], "truth": dict(list(truth.items())[:64]), "old": old,
        "sample": None if near is None else tape.samples[near].number,
    })  # fmt: skip


def _listen(out: Outcome, tape: Tape, known: Known) -> None:
    """New things that were said, and the longest silence while the fault lasted."""
    usual = set(known.usual)
    columns = Columns.from_dict(tape.columns or {"columns": []})
    new = [(n.t, n.text) for n in tape.notes if tape.on < n.t <= tape.end and template(n.text) not in usual]
    new += [
        (said.t, json.dumps(dict(said.row)))
        for said in tape.rows
        if tape.on < said.t <= tape.end and columns.values and columns.row(said.row) is None
    ]
    out.notes = len(new)
    out.said = list(dict.fromkeys(template(text) for _, text in new))[:4]
    heard = sorted([tape.on, *(said.t for said in tape.rows if tape.on < said.t <= tape.off), tape.off])
    gaps = [later - earlier for earlier, later in itertools.pairwise(heard)]
    out.quiet_s = max(gaps, default=0) / 1e9
    words = [t for t, _ in new if t <= tape.off]
    if words:
        out.quiet_s = min(out.quiet_s, (words[0] - tape.on) / 1e9)


def _weigh(out: Outcome, tape: Tape) -> None:
    """Processor and memory."""
    during = [weight for weight in tape.weights if tape.on <= weight.t <= tape.off]
    if len(during) > 3:
        took = (during[-1].t - during[0].t) / 1e9
        out.cpu = (during[-1].cpu - during[0].cpu) / took if took > 0 else 0.0
    out.leak = _growth(tape)


def _growth(tape: Tape) -> float:
    """Bytes for each reading, by the median of all slopes after the first third of the time."""
    weights = [weight for weight in tape.weights if tape.on <= weight.t <= tape.off]
    if len(weights) < 15:
        return 0.0
    late = weights[len(weights) // 3 :]
    size, t = np.array([weight.bytes for weight in late], float), np.array([weight.t for weight in late])
    sent = np.array([sample.t for sample in tape.samples])
    n = np.searchsorted(sent, t).astype(float)
    i, k = np.triu_indices(len(n), 5)
    slopes = (size[k] - size[i]) / np.maximum(n[k] - n[i], 1.0)
    grows = (np.diff(size) > 0).mean()
    return float(np.median(slopes)) if grows > LEAK_STEPS and size[-1] - size[0] > LEAK_FLOOR else 0.0


class _Rules:
    """From counts to findings."""

    def __init__(self, out: Outcome, tape: Tape, columns: Columns, known: Known):
        self.out, self.tape, self.columns, self.known = out, tape, columns, known
        self.trial = tape.trial
        self.action = tape.trial.get("action", "")
        self.noticed = out.notes + out.marked > 0

    def findings(self) -> list[Finding]:
        """Worst first."""
        found = [*self._ends(), *self._wrong(), *self._stale(), *self._sync(), *self._waits(), *self._clean()]
        found += [*self._mixed(), *self._collateral(), *self._keeps_up(), *self._late(), *self._leaks()]
        return sorted(found, key=lambda finding: list(ABOUT).index(finding.kind))

    @property
    def _outage(self) -> bool:
        return self.action in ("hang", "unplug", "halfopen", "stop", "baud")

    def _ends(self):
        _out, exit = self.out, self.tape.exit
        if exit is None or (self.action in ("unplug", "halfopen") and self.noticed):
            return
        how = f"signal {-exit}" if exit < 0 else f"exit status {exit}"
        last = next((note.text for note in reversed(self.tape.notes) if note.err), "")
        yield Finding("died", f"{how}{': ' + last if last else ''}")

    def _wrong(self):
        out = self.out
        if out.wrong:
            odd = Counter(name for bad in out.bad if not bad["old"] for name in bad["odd"])
            which = f", such as {', '.join(name for name, _ in odd.most_common(3))}" if odd else ""
            yield Finding("wrong", f"{out.wrong} of {out.rows} rows are nothing that was sent{which}")

    def _stale(self):
        out = self.out
        asks = self.known.asks and not self._outage
        again = out.injected if asks and self.tape.name in CAME_AGAIN else 0
        if out.stale >= (1 + again if asks else 2):
            what = "was handed out before, and asked for since" if asks else "repeats an old one while nothing comes"
            yield Finding("stale", f"{out.stale} rows: each {what}")
        if asks and out.behind > 5 + 2 * again and out.behind > 0.3 * out.rows:
            yield Finding("stale", f"{out.behind} rows: each is the answer to an earlier question")

    def _sync(self):
        out, exit = self.out, self.tape.exit
        after = any(said.t > self.tape.off for said in self.tape.rows)
        if self.action in ("unplug", "halfopen") and self.noticed and not after:
            return  # it says so, and leaves the rest to its user
        if out.recovered_s is None and exit is None and self.trial.get("recovers", True):
            waited = (self.tape.end - self.tape.off) / 1e9
            yield Finding("lost sync", f"no {SETTLED} right rows in a row within {waited:.1f} s after it was over")

    def _waits(self):
        out = self.out
        lasted = (self.tape.off - self.tape.on) / 1e9
        if self.action not in ("hang", "halfopen") or self.noticed or lasted < 1.0 or out.stale >= 2:
            return
        if out.quiet_s > BLOCKS * lasted:
            spins = out.cpu > SPINS
            words = f"takes {out.cpu:.0%} of a core" if spins else "waits"
            yield Finding("spins" if spins else "blocks", f"{words} for ever while nothing comes, without a word")

    def _clean(self):
        out = self.out
        if self.action != "clean":
            return
        for column in self.columns.values:
            if column.how in MISTAKEN:
                name = self.columns.channels[column.channel].name
                yield Finding("wrong", f"column {column.name!r} holds {name} as {column.how}")
        if exchanged := misnamed(self.columns):
            yield Finding("order", ", ".join(exchanged[:4]))
        if scaled := misscaled(self.columns):
            yield Finding("scale", ", ".join(scaled[:3]))
        if self.known.keeps and not self.known.asks and out.lost >= 2 and out.lost > LOSES * out.sent:
            yield Finding("loses", f"{out.lost} of {out.sent} good readings, without a fault")

    def _mixed(self):
        out, known = self.out, self.known
        usual = known.asks or not known.keeps or (known.repeats and self.action != "clean")
        odd = out.older + (0 if usual else out.again) - out.stale
        allowed = {"doubled": out.injected, "old frame": out.injected, "reordered": out.injected}.get(self.tape.name, 0)
        if odd > allowed + 1 and not self._outage and self.action not in ("reset", "wrap"):
            yield Finding("again", f"{odd} rows are readings that were handed out before")

    def _collateral(self):
        out = self.out
        plain = not self._outage and self.action in ("", "frames")
        if not (self.known.keeps and plain) or self.known.asks or out.recovered_s is None:
            return
        share, hit = COLLATERAL
        if out.lost > 1 + hit * out.injected and out.lost > share * max(1, out.sent):
            yield Finding("collateral", f"{out.lost} good readings lost beside the {out.injected} that were hit")

    def _keeps_up(self):
        out = self.out
        if self.action == "rate" and self.known.keeps and not self.known.asks and out.lost > max(3, 0.02 * out.sent):
            yield Finding("loses", f"{out.lost} of {out.sent} at {self.trial.get('rate_hz', 0):g} Hz")

    def _late(self):
        out = self.out
        limit = max(LATE_MS, 0.5 * self.known.period_ms if not self.known.asks else LATE_MS)
        if (
            self.action == "clean"
            and self.tape.late_ms <= OWN_LATE_MS
            and out.p50_ms is not None
            and out.p50_ms > limit
        ):
            of = "after the answer's last byte" if self.known.asks else "after the frame's last byte"
            yield Finding("late", f"{out.p50_ms:.1f} ms {of} at the median, {out.p99_ms:.1f} ms at the 99th percentile")

    def _leaks(self):
        if self.out.leak > LEAK_BYTES:
            yield Finding("leaks", f"memory grows by {self.out.leak:.0f} bytes with each reading")


def known_of(tape: Tape, columns: Columns, *, asks: bool, period_ms: float) -> Known:
    """What a run without faults shows, for the trials after it."""
    times = [said.t for said in tape.rows if tape.on < said.t <= tape.end]
    row_ms = float(np.median(np.diff(times))) / 1e6 if len(times) > 2 else period_ms
    known = Known(asks=asks, period_ms=period_ms, row_ms=row_ms, behind=1_000_000)
    usual = Counter(template(note.text) for note in tape.notes if note.t > tape.on)
    usual.update(template(json.dumps(dict(said.row))) for said in tape.rows if columns.row(said.row) is None)
    known.usual = [text for text, count in usual.most_common(200) if count >= OFTEN]
    reading = Reading(columns, known)
    reading.feed(tape)
    probe = Outcome("clean")
    _count(probe, tape, reading, left_times(tape))
    known.p50_ms, known.p99_ms = probe.p50_ms or 0.0, probe.p99_ms or 0.0
    known.repeats = probe.again > 0.1 * max(1, probe.rows)
    known.keeps = not asks and probe.lost <= 0.03 * max(1, probe.right)
    if asks:
        asked = np.array([f.t for f in tape.frames if f.way == "rx"])
        known.ask_ms = _ask_ms(tape, asked)
        known.behind = _usually_behind(tape, reading, asked, known.ask_ms)
    return known


def _ask_ms(tape: Tape, asked: np.ndarray) -> float:
    waits = [
        said.t - asked[last]
        for said in tape.rows
        if said.t > tape.on and (last := int(np.searchsorted(asked, said.t)) - 1) >= 0
    ]
    return float(np.quantile(waits, 0.1)) / 1e6 if waits else 0.0


def _usually_behind(tape: Tape, reading: Reading, asked: np.ndarray, ask_ms: float) -> int:
    times = np.array([sample.t for sample in tape.samples])
    behind = []
    for match in reading.matches:
        last = int(np.searchsorted(asked, match.said.t - 0.5e6 * ask_ms)) - 1
        if match.sample is not None and last >= 0 and match.said.t > tape.on:
            behind.append(int(np.searchsorted(times, asked[last], side="right")) - 1 - match.sample)
    return max(0, round(float(np.quantile(behind, 0.99)))) if behind else 0
