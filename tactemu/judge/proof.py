"""Proof from a record that the event of its trial happened; without it the trial proves nothing about the driver."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from tactemu.judge.columns import Columns
from tactemu.judge.outcome import CleanRun
from tactemu.judge.trial_record import TrialRecord
from tactemu.truth import Injection, Passage
from tactemu.wire.faults import parse
from tactemu.wire.faults.frames import Late

MIN_OUTAGE_SHARE = 0.5
"""Least share of an outage in which no frame is sent, or for which the driver's process is stopped."""
STOPPED_SHARE = 0.3
"""Share of its former spread below which a channel has stopped changing."""
SATURATED_SHARE = 0.05
"""Least share of samples with one and the same extreme value, for a saturated channel."""
MIN_SATURATED_SAMPLES = 3
"""Least number of samples with this value."""
MIN_RATE_RISE = 1.1
"""Least factor on the readings that arrive at a higher rate."""
MAX_RATE_FALL = 0.9
"""Largest factor on the samples that are taken at a lower rate."""
SECOND_NS = 1_000_000_000
MAX_ACTION_NS = SECOND_NS
"""Greatest time by which the emulator's loop dates an action before its end [ns]."""
MIN_CORRELATION = 0.4
"""Least correlation with a channel by which a byte belongs to a value."""
MIN_FRAMES = 40
"""Least number of frames for this correlation."""
MAX_FRAMES = 400
"""Maximum number of frames for this correlation."""


def missing(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why the event of a trial did not happen or cannot be proved; empty if it happened."""
    check = _BY_NAME.get(record.name) or _BY_ACTION.get(record.trial.get("action", ""), _no_check)
    if record.trial.get("faults") and not _changes(record):
        return "none of its faults hit anything"
    return check(record, columns, known)


def _no_check(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    return ""


def _changes(record: TrialRecord, *kinds: str) -> list[Injection]:
    """Return the faults injected in the trial, of the given kinds or of all."""
    return [
        change for change in record.injected_faults if change.t_ns >= record.on and (not kinds or change.what in kinds)
    ]


def outages(record: TrialRecord) -> int:
    """Return the number of times that the port was unplugged in the trial."""
    return len({change.t_ns for change in _changes(record, "unplug")})  # several skins lose their ports at one time


# -- edits of frames ---------------------------------------------------------------------------------------------------


def _flipped(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why no flip hit a value: bytes that correlate with a channel the driver reads; empty if one did."""
    changes = [change for change in _changes(record, "flip") if change.after]
    for size in {len(change.before) for change in changes}:
        places = _places_of_values(record, columns, size)
        own = [change for change in changes if len(change.before) == size]
        if not places or any(_differing(change) & places for change in own):
            return ""
    return "no flip hit a byte of a value that the driver reads" if changes else ""


def _differing(change: Injection) -> set[int]:
    before, after = bytes.fromhex(change.before), bytes.fromhex(change.after[0])
    return {k for k, (one, other) in enumerate(zip(before, after)) if one != other}


def _places_of_values(record: TrialRecord, columns: Columns, size: int) -> set[int]:
    """Return the positions of bytes that correlate with a channel that the driver reads, and of their neighbours.

    Low bytes of a value correlate with nothing, so varying bytes next to one that does are taken for its own.
    """
    read = sorted({int(k) for c in columns.values for k in (c.weights or (c.channel,))})
    samples = {sample.number: sample.counts for sample in record.samples if len(sample.counts) > max(read, default=0)}
    harmed = {change.before for change in record.injected_faults} | {
        after for c in record.injected_faults for after in c.after
    }
    carried = [
        (frame.text, samples[frame.sample])
        for frame in record.frames
        if frame.kind == "tx" and len(frame.text) == size and frame.text not in harmed
        if frame.sample is not None and frame.sample in samples
    ][:MAX_FRAMES]
    if len(carried) < MIN_FRAMES or not read:
        return set()
    sent = np.array([list(bytes.fromhex(data)) for data, _ in carried], np.uint8)
    counts = np.array([each[read] for _, each in carried])
    follows = _correlates(sent.astype(float), counts) | _correlates(sent.view(np.int8).astype(float), counts)
    varies = np.ptp(sent, axis=0) > 0
    near = follows | np.append(follows[1:], False) | np.append(False, follows[:-1])
    return set(np.flatnonzero(near & varies).tolist())


def _correlates(sent: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return for each byte True if it correlates with any of the channels."""

    def standard(x: np.ndarray) -> np.ndarray:
        spread = x.std(axis=0)
        return np.where(spread > 0, (x - x.mean(axis=0)) / np.where(spread > 0, spread, 1.0), 0.0)

    together = np.abs(standard(sent).T @ standard(counts)) / len(sent)
    return np.any(together > MIN_CORRELATION, axis=1)


def _late_answer(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why no late answer met another question: the driver must ask again before the answer comes."""
    asked = [frame.t_ns for frame in record.frames if frame.kind == "rx"]
    faults = [(change.t_ns, parse(change.fault)) for change in _changes(record, "late")]
    waits = [(t, t + fault.by_ns) for t, fault in faults if isinstance(fault, Late)]
    overtaken = any(ready < t < came for ready, came in waits for t in asked)
    return "" if overtaken else "the driver waited for each late answer: none came after another question"


# -- outages -----------------------------------------------------------------------------------------------------------


def _hang(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why the device did not hang: frames went on, or no question came that it could have answered."""
    if record.trial.get("faults"):
        return ""
    if known.asks and not any(frame.kind == "rx" and record.on < frame.t_ns < record.off for frame in record.frames):
        return "the driver asked for nothing meanwhile"
    quiet = _longest_gap([frame.t_ns for frame in record.frames if frame.kind == "tx"], record)
    return "" if quiet > MIN_OUTAGE_SHARE else "the device went on sending frames"


def _stopped(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    quiet = _longest_gap([printed.t_ns for printed in record.rows], record)
    return "" if quiet > MIN_OUTAGE_SHARE else "the driver's process was not stopped"


def _longest_gap(times: Sequence[int], record: TrialRecord) -> float:
    """Return the longest time between events, as a share of the trial's duration."""
    inside = [record.on, *(t for t in times if record.on < t < record.off), record.off]
    return max(b - a for a, b in itertools.pairwise(inside)) / max(1, record.off - record.on)


def _wrong_baud(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why the speed was not wrong: frames at another speed have other lengths, or none arrive."""
    during = [frame for frame in record.frames if record.on < frame.t_ns < record.off]
    usual = {(frame.kind, len(frame.text)) for frame in record.frames if frame.t_ns < record.on}
    misheard = [frame for frame in during if (frame.kind, len(frame.text)) not in usual]
    return "" if misheard or not during else "frames arrived as before"


# -- the device --------------------------------------------------------------------------------------------------------


def _reset(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    begun = record.on - MAX_ACTION_NS
    happened = any(change.what == "reset" and change.t_ns >= begun for change in record.injected_faults)
    return "" if happened else "the device did not restart"


def _wrap(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    return (
        "" if _changes(record, "wrap") else f"the {record.trial.get('preset')} did not roll over while the driver read"
    )


def _saturated(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why no channel was saturated: several samples must share an extreme that none reaches afterwards."""
    during, usual = _counts(record, record.on, record.off), _afterwards(record)
    for sign in (1.0, -1.0) if len(during) and len(usual) else ():
        end = (sign * during).max(axis=0)
        often = (sign * during == end).sum(axis=0) >= max(MIN_SATURATED_SAMPLES, SATURATED_SHARE * len(during))
        if (often & (end > (sign * usual).max(axis=0))).any():
            return ""
    return "no channel came to an end of its range"


def _dead(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why no taxel was dead: some channel must stop, once the filter has settled, while others change."""
    during, usual = _counts(record, (record.on + record.off) // 2, record.off), _afterwards(record)
    if len(during) and len(usual):
        moves = usual.std(axis=0)
        stopped = (moves > 0) & (during.std(axis=0) < STOPPED_SHARE * moves)
        if stopped.any() and not stopped[moves > 0].all():
            return ""
    return "no channel stopped while others changed"


def _afterwards(record: TrialRecord) -> np.ndarray:
    """Return the counts after the trial's end, as those before it may belong to another trial."""
    return _counts(record, (record.off + record.end) // 2, record.end)


def _counts(record: TrialRecord, since: int, until: int) -> np.ndarray:
    return np.array([sample.counts for sample in record.samples if since < sample.t_ns <= until])


def _rate(record: TrialRecord, columns: Columns, known: CleanRun) -> str:
    """Return why the rate did not change: more readings must arrive than usually, or fewer samples be taken."""
    rises = record.name == "high rate"
    times = _carried(record.frames) if rises else [sample.t_ns for sample in record.samples]
    during = _per_second(times, record.on, record.off)
    usual = max(_per_second(times, record.on - SECOND_NS, record.on), _per_second(times, record.off, record.end))
    if during > MIN_RATE_RISE * usual if rises else during < MAX_RATE_FALL * usual:
        return ""
    return f"{during:.0f} readings a second {'arrived' if rises else 'were taken'}, {usual:.0f} otherwise"


def _carried(frames: Sequence[Passage]) -> list[int]:
    """Return the times at which the first frame of each sample left [ns]."""
    first: dict[int, int] = {}
    for frame in frames:
        if frame.kind == "tx" and frame.sample is not None:
            first.setdefault(frame.sample, frame.t_ns)
    return list(first.values())


def _per_second(times: Sequence[int], since: int, until: int) -> float:
    return sum(since < t <= until for t in times) / max(1e-9, (until - since) / 1e9)


Check = Callable[[TrialRecord, Columns, CleanRun], str]
_BY_NAME: dict[str, Check] = {"flipped": _flipped, "late answer": _late_answer, "memory": _no_check}
_BY_ACTION: dict[str, Check] = {
    "hang": _hang, "stop": _stopped, "baud": _wrong_baud, "reset": _reset, "wrap": _wrap, "saturate": _saturated,
    "dead": _dead, "rate": _rate,
}  # fmt: skip
