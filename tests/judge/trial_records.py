"""Trial records with known outcomes: samples at 100 Hz, a driver that hands them out, and faults on both sides."""

import functools
from dataclasses import asdict

import numpy as np

from tactemu.judge.columns import Channel, Column, Columns
from tactemu.judge.outcome import CleanRun
from tactemu.judge.trial_record import DriverRow, Note, ResourceUsage, TrialRecord, sample_of
from tactemu.truth import Injection, Passage

PERIOD = 10_000_000
NAMES = ("fx", "fy", "fz")
COLUMNS = Columns(
    [Column(name, "value", k, gain=0.5, tolerance=0.2, share=1.0) for k, name in enumerate(NAMES)]
    + [Column("valid", "flag", constant=1.0)],
    [Channel(name.upper(), name[1], "N", 2.0) for name in NAMES],
)


@functools.cache
def counts(number):
    found = np.random.default_rng(number).integers(-3000, 3000, 3).astype(float)
    found.setflags(write=False)
    return found


def row(number, **more):
    return dict(zip(NAMES, (0.5 * counts(number)).tolist())) | {"valid": 1.0} | more


def record_of(rows=None, *, name="flipped", action="", on=100, off=150, end=200, asks=False, notes=(), **more):
    """Return a record of samples 0 to 299, 10 ms apart; ``rows`` are ``(time in periods, row)``.

    By default there is a row 1 ms after each sample.
    """
    known = CleanRun(asks=asks, p50_ms=1.0, p99_ms=2.0, **more.pop("known", {}))
    record = TrialRecord(
        name, {"name": name, "action": action} | more.pop("trial", {}), asdict(known), COLUMNS.as_dict(),
        on=on * PERIOD, off=off * PERIOD, end=end * PERIOD,
    )  # fmt: skip
    record.samples = [sample_of(k * PERIOD, k, counts(k)) for k in range(300)]
    silent = more.pop("silent", range(0))
    record.frames = [Passage(k * PERIOD, "", "tx", k.to_bytes(2), k) for k in range(300) if k not in silent]
    for k in more.pop("held_up", ()):
        record.frames[k] = record.frames[k]._replace(late_ns=6_000_000)
    rows = [(k + 0.1, row(k)) for k in range(end)] if rows is None else rows
    record.rows = [DriverRow(round(t * PERIOD), dict(each)) for t, each in rows]
    record.notes = [Note(round(t * PERIOD), text, True) for t, text in notes]
    record.injected_faults = [
        Injection(round(t * PERIOD), "", "flip", f"flip frame {t} byte 0 bit 0", "00", ("01",), t)
        for t in more.pop("hit", ())
    ]
    record.resource_usage = [ResourceUsage(k * PERIOD, size, cpu) for k, size, cpu in more.pop("weights", ())]
    for key, value in more.items():
        setattr(record, key, value)
    return record


def usual(first=0, last=200, without=()):
    return [(k + 0.1, row(k)) for k in range(first, last) if k not in without]
