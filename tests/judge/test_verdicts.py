"""Tests of verdicts on records with known outcomes, also after they were written and read."""

import json

import pytest

from tactemu.base.errors import TactemuError
from tactemu.judge.columns import Columns
from tactemu.judge.outcome import FAILING
from tactemu.judge.trial_record import DriverRow, TrialRecord
from tactemu.judge.verdicts import judge_record
from tests.judge.trial_records import PERIOD, counts, record_of, row, usual

OLD = [(160 + k * 0.5, row(149)) for k in range(60)]


def waiting(**more):
    silent = range(60, 190)
    rows = [*usual(last=60), *usual(191, 240)]
    return record_of(rows, name="hang", action="hang", on=60, off=190, end=240, silent=silent, **more)


def leaking(per_reading):
    return [(k, 10_000_000 + per_reading * k, 0.001 * k) for k in range(0, 200, 5)]


STORIES = {
    "right": (record_of(), []),
    "a frame that was hit is missing": (record_of(usual(without=[110]), hit=[110]), []),
    "a wrong row": (record_of([*usual(without=[110]), (110.1, row(110, fy=7777.0))]), ["wrong"]),
    "a wrong row that the driver marks": (
        record_of([*usual(without=[110]), (110.1, row(110, fy=7777.0, valid=0.0))]), [],
    ),
    "no number in place of a wrong one": (record_of([*usual(without=[110]), (110.1, row(110, fy=float("nan")))]), []),
    "all that comes after is wrong": (
        record_of(usual(last=110) + [(k + 0.1, row(k, fx=0.123)) for k in range(110, 200)]), ["wrong", "lost sync"],
    ),
    "nothing comes after": (record_of(usual(last=110)), ["lost sync"]),
    "it ends": (record_of(usual(last=110), exit=1, notes=[(110.2, "ValueError: checksum")]), ["died"]),
    "it ends, with a word, because the port has gone": (
        record_of(usual(last=110), name="unplug", action="unplug", exit=1, notes=[(110.2, "port lost")]), [],
    ),
    "it ends without a word": (record_of(usual(last=110), name="unplug", action="unplug", exit=1), ["died"]),
    "the last reading, for as long as nothing comes": (
        record_of(usual(last=110) + [(k + 0.1, row(109)) for k in range(111, 150)] + usual(150), name="hang",
                  action="hang", silent=range(110, 150)), ["stale"],
    ),
    "the last reading once more is no crime": (
        record_of([*usual(last=110), (149.1, row(109)), *usual(150)], name="hang", action="hang",
                  silent=range(110, 150), notes=[(120, "nothing comes")]), [],
    ),
    "it waits": (waiting(), ["blocks"]),
    "it waits in a loop": (waiting(weights=[(k, 1_000_000, 0.009 * k) for k in range(0, 240, 5)]), ["spins"]),
    "it says that nothing comes": (waiting(notes=[(80, "timeout")]), []),
    "good readings go with the bad": (
        record_of(usual(without=range(110, 150, 2)), hit=[111, 121, 131]), ["collateral"],
    ),
    "old ones among the new": (
        record_of(sorted(usual() + [(k + 0.6, row(k - 3)) for k in range(110, 120)], key=lambda each: each[0])),
        ["again"],
    ),
    "late without a fault": (
        record_of([(k + 1.2, row(k)) for k in range(298)], name="clean", action="clean", end=300,
                  trial={"recovers": False}),
        ["late"],
    ),
    "late, but so was our own loop": (
        record_of([(k + 1.2, row(k)) for k in range(298)], name="clean", action="clean", end=300, late_ms=9.0,
             trial={"recovers": False}), [],
    ),
    "late by more than our own loop": (
        record_of([(k + 3.2, row(k)) for k in range(296)], name="clean", action="clean", end=300, late_ms=9.0,
             trial={"recovers": False}), ["late"],
    ),
    "what our own loop held up is refused": (
        record_of(usual(last=300, without=range(5, 300, 50)), name="clean", action="clean", on=1, off=300, end=300,
             trial={"recovers": False}, held_up=range(5, 300, 50)), [],
    ),
    "memory grows by 264 MB within half a second": (
        record_of(weights=[(k, 30_000_000 + 6_000_000 * (k - 106), 0.0) for k in range(106, 151, 5)],
                  name="foreign frames", action="traffic"), ["leaks"],
    ),
    "every hundredth is missing": (
        record_of(usual(last=300, without=range(5, 300, 50)), name="clean", action="clean", on=1, off=300, end=300,
             trial={"recovers": False}), ["loses"],
    ),
    "memory grows": (record_of(weights=leaking(20_000), name="high rate", action="rate", on=10), ["leaks"]),
    "memory grows once": (
        record_of(weights=[(k, 10_000_000 + 5_000_000 * (k > 99), 0.0) for k in range(0, 200, 5)], action="rate",
                  on=10), [],
    ),
}  # fmt: skip


@pytest.mark.parametrize("story", STORIES)
def test_a_story(story, tmp_path):
    record, kinds = STORIES[story]
    record.rows.sort(key=lambda printed: printed.t_ns)
    outcome = judge_record(record)
    assert [finding.kind for finding in outcome.findings] == kinds, outcome.verdict
    record.write(tmp_path / "trial.jsonl")
    assert judge_record(TrialRecord.read(tmp_path / "trial.jsonl")) == outcome, "a verdict is a function of the file"


def test_a_driver_that_asks_may_repeat_but_not_answer_with_what_it_had():
    """Check repeated rows: asked every 40 ms, sampled every 10, a row may repeat until the next question."""
    asked = [(k + 1.0, row(k)) for k in range(0, 200, 4)]
    requests = {"asks": True, "known": {"row_ms": 40.0, "ask_ms": 9.0, "behind": 0}}
    right = record_of(asked, name="dropped", **requests)
    late = record_of([(t, row(116) if t in (121.0, 125.0) else each) for t, each in asked], name="dropped", **requests)
    soon = record_of(
        [(t - 0.98, row(116)) if t in (121.0, 125.0) else (t, each) for t, each in asked], name="dropped", **requests
    )
    once = record_of([(t, row(116) if t == 121.0 else each) for t, each in asked], name="dropped", **requests)
    twice = record_of(sorted([*asked, (121.2, row(120))], key=lambda each: each[0]), name="dropped", **requests)
    for record in (right, late, soon, once, twice):
        record.frames = [
            record.frames[k]._replace(t_ns=k * PERIOD + late, kind=way)
            for k in range(0, 200, 4)
            for late, way in ((1, "rx"), (2, "tx"))
        ]  # fmt: skip
    assert judge_record(right).findings == [] and judge_record(twice).findings == []
    assert judge_record(once).findings == [], "once may be the machine's fault"
    assert [finding.kind for finding in judge_record(late).findings] == ["stale"]
    assert [finding.kind for finding in judge_record(soon).findings] == ["stale"], (
        "an error's answer comes sooner than others"
    )


def test_of_a_wide_row_what_is_odd_is_kept():
    """Check that differing columns are kept, also beyond the first 64."""
    wide = record_of([*usual(without=[110]), (110.1, row(110, fz=7777.0))])
    wide.rows = [printed._replace(row={f"c{k}": 1.0 for k in range(100)} | dict(printed.row)) for printed in wide.rows]
    (bad,) = judge_record(wide).bad
    assert len(bad["row"]) == 64 and bad["row"]["fz"] == 7777.0 and bad["truth"]["fz"] == pytest.approx(row(110)["fz"])


def test_the_order_of_the_worst_is_first_and_each_failing_kind_is_known():
    outcome = judge_record(record_of(usual(last=110) + [(k + 0.1, row(k, fx=0.123)) for k in range(110, 200)], exit=3))
    assert [finding.kind for finding in outcome.findings] == ["wrong", "died"] and outcome.fails(FAILING)
    assert outcome.bad[0]["truth"]["fx"] == pytest.approx(row(110)["fx"]) and outcome.bad[0]["odd"] == ["fx"]


@pytest.mark.parametrize(
    ("how", "kinds"), [("curve", ["clipped"]), ("clipped", ["clipped"]), ("fold", ["wrong"]), ("line", [])]
)
def test_columns_that_are_flat_or_fall_back_are_findings_of_the_clean_run(how, kinds):
    record = record_of(name="clean", action="clean", trial={"recovers": False})
    columns = record.columns["columns"]
    table = {"fold": [[-3000.0, 0.0], [0.0, 1500.0], [1.0, 0.0], [3000.0, 1500.0]]}.get(
        how, [[-3000.0, 0.0], [0.0, 1500.0], [3000.0, 1500.0]]
    )
    record.columns = {**record.columns, "columns": [{**columns[0], "how": how, "table": table}, *columns[1:]]}
    columns = Columns.from_dict(record.columns)
    record.rows = [DriverRow(s.t_ns, {**s.row, "fx": float(columns.expected(counts(k)[None])[0, 0])})
                 for k, s in enumerate(record.rows)]  # fmt: skip
    assert [finding.kind for finding in judge_record(record).findings] == kinds


def test_a_record_of_version_1_is_read(tmp_path):
    record = record_of(hit=[120], held_up=[3], notes=[(130, "x")], weights=[(5, 10, 0.5)])
    record.frames[7] = record.frames[7]._replace(is_answer=True)
    record.write(tmp_path / "now.jsonl")
    kinds = {"sample": "samples", "inject": "changes", "row": "rows", "note": "notes", "usage": "weights"}
    names = {"t_ns": "t", "detail": "fault", "is_answer": "answer"}
    with (tmp_path / "then.jsonl").open("w") as file:
        for line in record.lines():
            kind = line.pop("kind")
            row = {names.get(name, name): value for name, value in line.items()}
            if kind == "sample":
                row = {"t": row["t"], "number": row["sample"], "counts": row["counts"].tolist()}
            elif kind == "tx":
                row |= {"way": "tx", "sample": row.get("sample")}
            elif kind == "trial":
                row["version"] = 1
            row.pop("device", None)
            file.write(json.dumps({"kind": "frames" if kind == "tx" else kinds.get(kind, kind)} | row) + "\n")
    now, then = TrialRecord.read(tmp_path / "now.jsonl"), TrialRecord.read(tmp_path / "then.jsonl")
    assert [*map(str, now.lines())] == [*map(str, then.lines())]
    assert judge_record(then) == judge_record(record)


@pytest.mark.parametrize(
    "text",
    ["", "{}", '{"kind": "rows"}', '{"kind": "trial", "version": 99}', "no json", '{"kind": "trial", "version": 1}'],
)
def test_an_invalid_record_is_refused(text, tmp_path):
    path = tmp_path / "x.jsonl"
    path.write_text(text)
    with pytest.raises(TactemuError, match=r"x\.jsonl.*not a recorded trial"):
        TrialRecord.read(path)


def test_losses_in_a_clean_run_are_not_judged_where_hardly_a_reading_was_sent_in_time():
    clean = {
        "name": "clean",
        "action": "clean",
        "on": 1,
        "off": 200,
        "known": {"keeps": True},
        "trial": {"recovers": False},
    }
    lossy = usual(without=range(10, 200, 50))
    assert (
        "loses" in judge_record(record_of(lossy, **clean)).verdict
        and judge_record(record_of(**clean)).verdict == "right"
    )
    assert "too busy to tell" in judge_record(record_of(lossy, held_up=range(0, 200, 2), **clean)).verdict
