"""Tests of proofs: without proof of its event a trial counts as not tried, whatever the driver did."""

import struct

import pytest

from tactemu.judge.trial_record import sample_of
from tactemu.judge.verdicts import judge_record
from tactemu.truth import Injection, Passage
from tests.judge.trial_records import PERIOD, counts, record_of, row, usual


def trial(action, name=None, **more):
    """Return a record of a driver that reads on, whatever happens from 100 to 150."""
    return record_of(name=name or action, action=action, **more)


def changed(record, fault, at=101, kind="", **more):
    record.injected_faults.append(Injection(at * PERIOD, "", kind or fault, fault, **more))
    return record


def sampled(record, during):
    """Change the counts of the samples during the event."""
    record.samples = [
        sample_of(s.t_ns, s.number, during(s.number)) if 100 < s.number <= 150 else s for s in record.samples
    ]
    values = [dict(zip(("fx", "fy", "fz"), (0.5 * sample.counts).tolist())) for sample in record.samples]
    record.rows = [printed._replace(row={**printed.row, **value}) for printed, value in zip(record.rows, values)]
    return record


def wire(number):
    """Return a frame with a head, a number, three values and a flag."""
    return b"\xaa\x55" + struct.pack(">H3hB", number, *counts(number).astype(int), 0)


def flipped(place):
    """Return a record in which four frames have a bit flipped at a byte position, and none becomes a row."""
    hit = (110, 115, 120, 125)
    record = record_of(usual(without=hit))
    record.frames = [frame._replace(frame=wire(frame.sample)) for frame in record.frames]
    for number in hit:
        after = bytearray(wire(number))
        after[place] ^= 4
        record.frames[number] = record.frames[number]._replace(frame=bytes(after))
        changed(record, "flip", number, before=wire(number).hex(), after=(after.hex(),))
    return record


def asked(record, silent, *at):
    """Add questions every 40 ms with immediate answers; in ``silent`` only the questions at given times."""
    record.known["asks"] = True
    record.frames = [
        Passage(k * PERIOD + 1000 * j, "", way, b"\0", k, is_answer=True)
        for k in range(0, 200, 4)
        for j, way in enumerate(("rx", "tx"))
        if k not in silent
    ]
    record.frames += [Passage(t * PERIOD, "", "rx", b"\0") for t in at]
    return record


def late(*at):
    """Return a record with an answer that is 150 ms late, and questions before it."""
    record = record_of([(k + 1.0, row(k)) for k in range(0, 200, 4)], name="late answer", notes=[(119, "time out")])
    return changed(asked(record, range(101, 117), *at), "late frame 3 by 150ms", kind="late")


def hanging(**more):
    return record_of(
        [*usual(last=100), *usual(151)], name="hang", action="hang", off=150, notes=[(140, "time out")], **more
    )


def at_half_rate(first):
    record = trial("rate", "half the rate", trial={"rate_hz": 50.0})
    record.samples = [s for s in record.samples if s.number % 2 or not first < s.number <= 150]
    record.frames = [frame for frame in record.frames if any(s.number == frame.sample for s in record.samples)]
    record.rows = [each for each, k in zip(record.rows, range(200)) if k % 2 or not first < k <= 150]
    return record


EVENTS = {
    # a record with the event, a record without it, the reason given for the latter
    "flip": (flipped(5), flipped(0), "no flip hit a byte of a value"),
    "flip, low byte": (flipped(9), flipped(10), "no flip hit a byte of a value"),
    "faults": (
        changed(record_of(trial={"faults": ["drop frame 3"]}), "drop"), record_of(trial={"faults": ["drop frame 3"]}),
        "none of its faults hit anything",
    ),
    "faults before": (
        changed(record_of(trial={"faults": ["drop frame 3"]}), "drop"),
        changed(record_of(trial={"faults": ["drop frame 3"]}), "drop", 90), "none of its faults hit anything",
    ),
    "hang": (hanging(silent=range(101, 150)), hanging(), "the device went on sending frames"),
    "hang of what is asked": (
        asked(hanging(), range(100, 150), 120), asked(hanging(), range(100, 150)),
        "the driver asked for nothing meanwhile",
    ),
    "late answer": (late(110), late(), "the driver waited for each late answer"),
    "stop": (
        record_of([*usual(last=100), *[(151 + k / 100, row(k)) for k in range(100, 151)], *usual(152)],
                  name="slow reader", action="stop"),
        trial("stop", "slow reader"), "was not stopped",
    ),
    "reset": (changed(trial("reset"), "reset", 99), trial("reset"), "the device did not restart"),
    "wrap": (
        changed(trial("wrap", trial={"preset": "sequence"}), "wrap"), trial("wrap", trial={"preset": "sequence"}),
        "the sequence did not roll over while the driver read",
    ),
    "saturated": (
        sampled(trial("saturate"), lambda k: counts(k) if k % 3 else counts(k) * [1, 0, 1] + [0, 4000, 0]),
        sampled(trial("saturate"), lambda k: counts(k) * 1.5), "no channel came to an end of its range",
    ),
    "dead": (
        sampled(trial("dead"), lambda k: counts(k) * [1, 0, 1]), trial("dead"), "no channel stopped",
    ),
    "rate": (at_half_rate(100), at_half_rate(300), "100 readings a second were taken, 100 otherwise"),
}  # fmt: skip


@pytest.mark.parametrize("event", EVENTS)
def test_an_event_happened_or_the_trial_is_not_tried(event):
    happened, not_so, why = EVENTS[event]
    outcome = judge_record(happened)
    assert not outcome.findings and not outcome.skipped, outcome.verdict
    outcome = judge_record(not_so)
    assert not outcome.findings and why in outcome.skipped, outcome.verdict
    assert outcome.verdict == f"not tried: {outcome.skipped}"


def test_a_finding_stands_also_where_the_event_did_not_happen():
    record = record_of([*usual(without=[110]), (110.1, row(110, fy=7777.0))], trial={"faults": ["drop frame 3"]})
    record.rows.sort(key=lambda printed: printed.t_ns)
    outcome = judge_record(record)
    assert [finding.kind for finding in outcome.findings] == ["wrong"] and not outcome.skipped
