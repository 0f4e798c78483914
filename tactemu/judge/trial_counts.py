"""Counts of a trial: rows, samples and messages, and the driver's processor time and memory."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from tactemu.judge.columns import Columns
from tactemu.judge.excitation import STEP
from tactemu.judge.outcome import CleanRun, Outcome
from tactemu.judge.row_tracking import GRACE_MS, Questions, RowTracker
from tactemu.judge.sample_matching import Match
from tactemu.judge.trial_record import TrialRecord
from tactemu.wire.faults import FAULTS

MAX_OWN_LATENESS_MS = 2.0
"""Lateness of our own process with a sample's frames above which the driver may lose the sample [ms]."""
LEAK_BYTES = 500
"""Growth of the memory for each reading above which there is a leak [byte]."""
MIN_LEAK_BYTES = 1_000_000
"""Least total growth for such a leak [byte]."""
LEAK_AT_ONCE_BYTES = 100_000_000
"""Growth in a trial that is a finding however short the trial is [byte]."""
MAX_QUOTED_LENGTH = 200
"""Maximum length of a message that is quoted in a report [characters]."""
MIN_GROWING_SHARE = 0.15
"""Least share of measurements at which the memory has grown: a buffer that is doubled once is no leak."""


_EXCEPTION = re.compile(r"(?:\w+\.)*[A-Z]\w*(?:: .*)?")
"""A pattern of the last line of a traceback."""
_CHAINED = ("During handling of the above exception", "The above exception was the direct cause")


def template(text: str) -> str:
    """Return a message with its numbers replaced, so that its repetitions are equal."""
    return re.sub(r"0x[0-9a-fA-F]+|\d+(\.\d+)?(e-?\d+)?", "#", text)[:120]


def shortened(text: str) -> str:
    """Return a message for the reports: one that is too long ends at a word, with an ellipsis."""
    if len(text) <= MAX_QUOTED_LENGTH:
        return text
    start, _, _ = text[:MAX_QUOTED_LENGTH].rpartition(" ")
    return f"{(start or text[:MAX_QUOTED_LENGTH]).rstrip(' ,;:')} …"


def without_tracebacks(texts: Sequence[str]) -> list[str]:
    """Return lines with the last line, the exception, in place of each traceback of Python."""
    found, inside = [], False
    for text in texts:
        if text.startswith("Traceback (most recent call last)"):
            inside = True
        elif not inside and text.startswith(_CHAINED):
            found = found[:-1]  # the exception that comes ends the traceback
        elif not inside or _EXCEPTION.fullmatch(text):
            found.append(text)
            inside = False
    return found or list(texts[:1])


def count_rows(out: Outcome, record: TrialRecord, tracker: RowTracker, left: np.ndarray) -> None:
    """Count each row of the trial as right, wrong, marked, again or older, and measure the latencies."""
    known = tracker.known
    times = np.array([sample.t_ns for sample in record.samples])
    sent_at = np.sort(np.array([f.t_ns for f in record.frames if f.kind == "tx"], np.int64))
    questions = Questions(record, known.ask_ms)
    answers = _answers(record) if known.asks else {}
    grace = 1e6 * max(GRACE_MS, 3 * known.p99_ms)
    last, seen, ages = -1, set(), []
    for match in tracker.matches:
        t, k = match.printed.t_ns, match.sample
        if t > record.end:
            break
        if t <= record.on:  # needed only for the last sample that was handed out
            last = max(last, k if k is not None else -1)
            continue
        out.rows += 1
        has_nan = any(math.isnan(value) for value in match.printed.row.values())
        if match.marked or has_nan:
            out.marked += 1
        elif k is None:
            if tracker.columns.steps and tracker.matcher.between(match.printed, 2 * STEP + STEP // 2):
                continue
            out.wrong += 1
            _keep_bad(out, match, record, tracker)
        elif k > last or (known.asks and k == last):
            old = known.asks and questions.is_old(match, known)
            if old and k == last:  # it was handed out before, and asked for again since
                out.stale += 1
                _keep_bad(out, match, record, tracker, old=True)
            else:
                out.right += 1
                out.behind += old
                out.waits_ms.append(_wait_ns(match, left, answers, sent_at, record) / 1e6)
                ages.append((t - times[k]) / 1e6)
        else:
            idle = t - sent_at[max(0, int(np.searchsorted(sent_at, t)) - 1)] > grace if len(sent_at) else True
            stale = (t - left[k] > grace and idle) or (known.asks and questions.is_old(match, known))
            out.stale += stale
            if stale:
                _keep_bad(out, match, record, tracker, old=True)
            out.again += k == last
            out.older += k < last
        if k is not None and not match.marked:
            seen.add(k)
            last = max(last, k)
    out.lost, out.sent = _lost(record, seen)
    out.injected = len([change for change in record.injected_faults if change.t_ns >= record.on])
    if out.waits_ms:
        p50, p99, worst = np.quantile(out.waits_ms, (0.5, 0.99, 1.0))
        out.p50_ms, out.p99_ms, out.worst_ms = float(p50), float(p99), float(worst)
    if known.asks and ages:
        out.age_ms = float(np.median(ages))


def _wait_ns(
    match: Match, left: np.ndarray, answers: Mapping[int, list[int]], sent_at: np.ndarray, record: TrialRecord
) -> int:
    """Return the time from the last byte that a row needs, or of its answer if the driver polls, to the row [ns]."""
    t, k = match.printed.t_ns, match.sample
    assert k is not None
    if answers:
        own = [each for each in answers.get(record.samples[k].number, ()) if each <= t]
        if own:
            return t - own[-1]
        at = int(np.searchsorted(sent_at, t)) - 1
        return t - int(sent_at[at]) if at >= 0 else 0
    return t - int(left[k])


def _answers(record: TrialRecord) -> dict[int, list[int]]:
    """Return the times at which the frames of each sample left, by its number [ns]."""
    found: dict[int, list[int]] = {}
    for frame in record.frames:
        if frame.kind == "tx" and frame.sample is not None:
            found.setdefault(frame.sample, []).append(frame.t_ns)
    return found


def _lost(record: TrialRecord, seen: set[int]) -> tuple[int, int]:
    """Return the numbers of undamaged samples that were lost and that were sent.

    Only samples between the first and the last that the driver handed out count.
    """
    if not seen:
        return 0, 0
    times = np.array([sample.t_ns for sample in record.samples])
    number = {sample.number: k for k, sample in enumerate(record.samples)}
    carried = Counter(number[f.sample] for f in record.frames if f.kind == "tx" and f.sample in number)
    in_frames = bool(carried) and np.median(list(carried.values())) > 1
    harmed = set()
    for change in record.injected_faults:
        fault = FAULTS.get(change.what)
        if fault is not None and fault.keeps_frame and not (in_frames and fault.mixes_samples):
            continue
        harmed.add(int(np.searchsorted(times, change.t_ns, side="right")) - 1)
    held_up = _held_up(record, number)
    window = {k for k in carried if min(seen) < k < max(seen) and times[k] >= record.on} - held_up
    return len(window - seen - harmed), len(window)


def _held_up(record: TrialRecord, number: Mapping[int, int]) -> set[int]:
    """Return the samples whose frames left late because our own process was delayed, and those right after them.

    A driver may refuse them: their frames are further apart than those of the device, or closer together.
    """
    late = {f.sample for f in record.frames if f.kind == "tx" and f.late_ns > 1e6 * MAX_OWN_LATENESS_MS}
    held_up = {k for sample, k in number.items() if sample in late}
    return held_up | {k + 1 for k in held_up}


def _keep_bad(out: Outcome, match: Match, record: TrialRecord, tracker: RowTracker, old: bool = False) -> None:
    if len(out.bad) >= 8:
        return
    near = match.sample if old else match.nearest
    truth = {}
    if near is not None:
        expected = tracker.columns.expected(record.samples[near].counts[None])[0]
        truth = dict(zip(tracker.columns.names, expected.tolist()))
    names = list(dict.fromkeys((*match.odd[:16], *match.printed.row)))[:64]
    row = {name: match.printed.row[name] for name in names if name in match.printed.row}
    truth = {name: truth[name] for name in names if name in truth}
    out.bad.append({
        "t": match.printed.t_ns, "row": row, "odd": list(match.odd)[:16], "truth": truth, "old": old,
        "sample": None if near is None else record.samples[near].number,
    })  # fmt: skip


def count_messages(out: Outcome, record: TrialRecord, known: CleanRun) -> None:
    """Count the new messages, and measure the longest silence during the fault."""
    usual = set(known.usual)
    columns = Columns.from_dict(record.columns or {"columns": []})
    new = [(n.t_ns, n.text) for n in record.notes if record.on < n.t_ns <= record.end and template(n.text) not in usual]
    new += [
        (printed.t_ns, json.dumps(dict(printed.row)))
        for printed in record.rows
        if record.on < printed.t_ns <= record.end and columns.values and columns.row(printed.row) is None
    ]
    out.notes = len(new)
    first: dict[str, str] = {}
    for text in without_tracebacks([text for _, text in new]):
        first.setdefault(template(text), text)
    out.said = list(map(shortened, first.values()))[:4]
    times = sorted(
        [record.on, *(printed.t_ns for printed in record.rows if record.on < printed.t_ns <= record.off), record.off]
    )
    gaps = [later - earlier for earlier, later in itertools.pairwise(times)]
    out.quiet_s = max(gaps, default=0) / 1e9
    words = [t for t, _ in new if t <= record.off]
    if words:
        out.quiet_s = min(out.quiet_s, (words[0] - record.on) / 1e9)


def measure_resources(out: Outcome, record: TrialRecord) -> None:
    """Measure the driver's processor time and the growth of its memory."""
    during = [usage for usage in record.resource_usage if record.on <= usage.t_ns <= record.off]
    if len(during) > 3:
        took = (during[-1].t_ns - during[0].t_ns) / 1e9
        out.cpu = (during[-1].cpu - during[0].cpu) / took if took > 0 else 0.0
    out.leak = _growth(record)
    out.grown = _grown(record)


def _grown(record: TrialRecord) -> int:
    """Return the growth from the last measurement before the fault until the recovery [byte]."""
    before = [usage.bytes for usage in record.resource_usage if usage.t_ns <= record.on][-1:]
    sizes = before + [usage.bytes for usage in record.resource_usage if record.on < usage.t_ns <= record.end]
    return sizes[-1] - sizes[0] if sizes else 0


def _growth(record: TrialRecord) -> float:
    """Return the growth for each reading, as the median of all slopes after the first third of the time [byte]."""
    during = [usage for usage in record.resource_usage if record.on <= usage.t_ns <= record.off]
    if len(during) < 15:
        return 0.0
    late = during[len(during) // 3 :]
    size, t = np.array([usage.bytes for usage in late], float), np.array([usage.t_ns for usage in late])
    sent = np.array([sample.t_ns for sample in record.samples])
    n = np.searchsorted(sent, t).astype(float)
    i, k = np.triu_indices(len(n), 5)
    slopes = (size[k] - size[i]) / np.maximum(n[k] - n[i], 1.0)
    grows = (np.diff(size) > 0).mean()
    return float(np.median(slopes)) if grows > MIN_GROWING_SHARE and size[-1] - size[0] > MIN_LEAK_BYTES else 0.0
