"""Tests of rows that are out of order or one answer old, and of a port that disappears twice."""

import pytest

from tactemu.judge.verdicts import judge_record
from tactemu.truth import Injection, Passage
from tests.judge.trial_records import PERIOD, record_of, row, usual


def kinds(record):
    record.rows.sort(key=lambda printed: printed.t_ns)
    return [finding.kind for finding in judge_record(record).findings]


def out_of_turn(name, rows, **known):
    """Return a record in which six frames, and rows, come out of order."""
    record = record_of(usual(without=range(110, 116)) + rows, name=name, known=known)
    record.injected_faults = [Injection(k * PERIOD, "", name, name) for k in range(110, 116)]
    return record


@pytest.mark.parametrize("name", ["reordered", "old frame", "doubled"])
def test_a_driver_leaves_out_old_frames_that_carry_a_number(name):
    old = [(k + j, row(k)) for k in range(110, 116) for j in (0.1, 1.6)]
    expected = ["again"] if name != "doubled" else []
    assert kinds(out_of_turn(name, old, numbered=True)) == expected
    assert kinds(out_of_turn(name, old)) == [], "without a number nobody can tell"
    new = [(k + 0.1, row(k)) for k in range(110, 116)]
    assert kinds(out_of_turn(name, new, numbered=True)) == [], "it leaves them out"


def asking(behind, each=4, lag=0, **more):
    """Return a clean record with questions every 40 ms; a row answers the question ``behind`` before it."""
    rows = [(k + 0.2, row(k - behind * each - lag)) for k in range(2 * each, 200, each)]
    known = {"row_ms": 10.0 * each, "ask_ms": 2.0, "behind": behind * each}
    record = record_of(
        rows, name="clean", action="clean", asks=True, known=known, on=1, off=200, trial={"recovers": False}
    )
    record.frames = [Passage(k * PERIOD + late, "", way, b"\0", k, is_answer=True)
                   for k in range(0, 200, each) for late, way in ((1, "rx"), (2, "tx"))]  # fmt: skip
    return record


def test_an_answer_that_is_always_the_one_before_is_stale():
    record = asking(1)
    outcome = judge_record(record)
    assert kinds(record) == ["stale"] and "answer to the question before" in outcome.verdict
    assert kinds(asking(0)) == [] == kinds(asking(0, lag=1)), "a device may hand out a sample that is a little older"
    assert kinds(asking(1, each=1)) != ["stale"], "a sample for each question: it may be the device's own delay"


def test_a_device_that_answers_with_its_next_sample_makes_no_row_new():
    for behind, expected in ((1, ["stale"]), (0, [])):
        record = asking(behind)
        record.frames = [Passage(round((k - asked / 2) * PERIOD) + 1, "", "rx" if asked else "tx", b"\0", k)
                       for k in range(4, 200, 4) for asked in (True, False)]  # fmt: skip
        assert kinds(record) == expected


def test_some_answers_that_are_old_do_not_make_a_driver_always_late():
    record = asking(0)
    record.rows[::2] = asking(1).rows[::2]
    assert "question before" not in judge_record(record).verdict


def unplugged(times, last, notes=(), exit=None):
    """Return a record with outages of the port at 100 and 160; rows go on until ``last``, except during them."""
    away = [k for start in (100, 160)[:times] for k in range(start, start + 20)]
    record = record_of(usual(last=last, without=away), name="unplug", action="unplug", off=120 if times == 1 else 180,
                end=300, notes=notes, exit=exit, silent=set(away))  # fmt: skip
    record.injected_faults = [Injection(start * PERIOD, "", "unplug", "unplug") for start in (100, 160)[:times]]
    return record


def test_a_driver_that_came_back_from_one_outage_comes_back_from_the_next():
    words = [(101, "port lost")]
    assert kinds(unplugged(2, 300, words)) == []
    assert kinds(unplugged(2, 160, words, exit=1)) == ["died"], "also with a word: it had come back before"
    assert kinds(unplugged(2, 160, words)) == ["lost sync"]
    assert kinds(unplugged(1, 100, words, exit=1)) == [], "it leaves the first outage to its user"
