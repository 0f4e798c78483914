"""Tests of the confirmation of findings, of the budget as a deadline, and of our own delays, which blame no driver."""

import os
import time
from types import SimpleNamespace

import pytest

from tactemu.base.errors import TactemuError
from tactemu.judge import smallest_case
from tactemu.judge.budget import Budget, BudgetSpentError, kind_of, ordered
from tactemu.judge.driver import command_of
from tactemu.judge.lateness import DriverTimeout, SchedulingDelay, late_ms
from tactemu.judge.outcome import FAILING, Finding, Outcome
from tactemu.judge.plan import Plan, Trial
from tactemu.judge.processes import queued_ns
from tactemu.judge.trial_runner import Judge, JudgeOptions
from tests.judge.test_plan import CAN, POLLED, STREAM
from tests.judge.trial_records import COLUMNS, PERIOD, record_of


def outcome_with(*kinds):
    findings = [Finding(kind, "so") for kind in kinds]
    return Outcome("clean", findings=findings, verdict="; ".join(map(str, findings)) or "right")


def judge_that_sees(monkeypatch, *outcomes, **options):
    """Return a judge whose runs without faults have the given outcomes in turn, and the list of those left."""
    judge, left = Judge("optoforce", ["driver"], JudgeOptions(**options)), list(outcomes)

    def look():
        outcome = left.pop(0)
        judge.columns = COLUMNS if not outcome.has("died") else type(COLUMNS)()
        return outcome

    monkeypatch.setattr(judge, "_clean", look)
    return judge, left


@pytest.mark.parametrize(
    ("first", "again", "counts", "verdict"),
    [
        (["wrong"], [], [], "right (not counted, as only the first of two runs showed it: silent wrong values: so)"),
        (["wrong"], ["wrong"], ["wrong"], "silent wrong values: so"),
        (["wrong", "late"], ["late"], ["late"], "late: so"),
        (["died"], [], [], "right (not counted, as only the first of two runs showed it: died: so)"),
        (["died"], ["died"], ["died"], "died: so"),
        (["loses"], ["died"], [], "loses readings: so"),
        (["died"], ["loses"], [], "loses readings: so"),
    ],
)
def test_a_finding_without_faults_must_come_again(monkeypatch, first, again, counts, verdict):
    judge, left = judge_that_sees(monkeypatch, outcome_with(*first), outcome_with(*again))
    outcome = judge.clean()
    assert not left and outcome.verdict == verdict
    assert [f.kind for f in outcome.findings if outcome.confirmed is not False] == counts
    assert outcome.doubt in ("", " (not counted: a second run did not show it)")
    assert outcome.fails(FAILING) == (bool(counts) and counts[0] in FAILING)
    assert bool(judge.columns.values) == ("died" not in counts), "the columns are those of a run that had some"


def test_without_a_finding_or_without_time_there_is_no_second_look(monkeypatch):
    judge, left = judge_that_sees(monkeypatch, outcome_with(), outcome_with())
    assert judge.clean().verdict == "right" and len(left) == 1
    judge, left = judge_that_sees(monkeypatch, outcome_with("wrong"), outcome_with(), budget_s=0.4)
    outcome = judge.clean()
    assert len(left) == 1 and not outcome.fails(FAILING)
    assert outcome.doubt.startswith(" (not counted: a second run takes ") and "of the budget are left" in outcome.doubt


def test_of_several_findings_those_that_come_again_count():
    outcome = outcome_with("wrong", "lost sync", "late")
    outcome.seen_again(outcome_with("lost sync"), FAILING)
    assert [f.kind for f in outcome.findings] == ["lost sync", "late"] and outcome.confirmed


# -- the budget --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("facts", [STREAM, POLLED, CAN], ids=["stream", "polled", "can"])
def test_one_of_each_kind_comes_before_repetitions_and_outages_come_early(facts):
    plan = Plan(facts).trials()
    trials = ordered(plan)
    assert sorted(trial.name for trial in trials) == sorted(trial.name for trial in plan)
    kinds = [kind_of(trial) for trial in trials if not trial.skipped]
    first = len(set(kinds))
    assert len(set(kinds[:first])) == first
    assert [bool(trial.skipped) for trial in trials] == sorted(bool(trial.skipped) for trial in trials)
    early = {"unplug", "hang", "silence"} & set(kinds)
    assert early and early <= set(kinds[:6]), kinds


def test_a_trial_without_room_is_not_begun_and_one_that_takes_too_long_ends(monkeypatch):
    judge = Judge("optoforce", ["driver"], JudgeOptions(budget_s=30.0))
    judge.starts = [0.5]
    judge.budget._end = time.monotonic() + 20.0
    begun = []

    def run_trial(trial, keep=True):
        begun.append(trial.name)
        judge.budget.sleep(60.0)

    monkeypatch.setattr(judge, "run_trial", run_trial)
    long = judge.judge(Trial("long", "why", ["silence"], takes_s=20.0))
    short = judge.judge(Trial("short", "why", ["silence"], takes_s=0.1))
    assert begun == ["short"] and "of the budget are left" in long.skipped and "spent" in short.skipped
    assert not short.findings, "what was not seen to the end accuses nobody"


def test_a_finding_that_could_not_be_tried_again_does_not_count(monkeypatch):
    judge = Judge("optoforce", ["driver"], JudgeOptions(budget_s=30.0))
    records = [record_of(action="hang", name="hang", exit=1)]

    def run_trial(trial, keep=True):
        if not records:
            judge.budget.sleep(60.0)
        return records.pop()

    monkeypatch.setattr(judge, "run_trial", run_trial)
    outcome = judge.judge(Trial("hang", "why", action="hang", takes_s=0.1))
    assert (
        outcome.has("died")
        and not outcome.fails(FAILING)
        and outcome.doubt == " (not counted: no time was left for a second run)"
    )


def test_a_budget_learns_how_slow_trials_are():
    budget = Budget(20.0)
    assert not budget.lacks(4.0, times=2)
    budget.end(expected_s=1.0, took_s=3.0)
    assert "may have to be repeated" in budget.lacks(4.0, times=2) and not budget.lacks(4.0)
    budget.begin()
    with pytest.raises(BudgetSpentError):
        budget.sleep(30.0)
    budget.end()
    budget.sleep(0.0)
    assert not Budget(None).lacks(1e9)


# -- our own delays ----------------------------------------------------------------------------------------------------


def test_how_late_our_own_side_was_is_known_of_drivers_that_ask_too():
    """Check the delay without sample times: by the thread that reads rows and the driver's wait for a processor."""
    quiet = record_of(on=0, off=100, end=100)
    quiet.frames = [frame._replace(is_answer=True) for frame in quiet.frames]
    looks = [SchedulingDelay(k * PERIOD, 100_000, 50_000 * k) for k in range(0, 100, 5)]
    assert late_ms(quiet, looks) == pytest.approx(0.1)
    assert late_ms(quiet, [*looks, SchedulingDelay(96 * PERIOD, 9_000_000, looks[-1].queued_ns)]) == pytest.approx(9.0)
    assert late_ms(quiet, [look._replace(queued_ns=7_000_000 * (look.t_ns // PERIOD)) for look in looks]) > 6.5
    assert late_ms(quiet, []) == 0.0


def test_waiting_for_a_processor_prolongs_patience_within_limits(monkeypatch):
    clock, queued = [100.0], [5.0]
    monkeypatch.setattr("tactemu.judge.lateness.time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr("tactemu.judge.lateness.queued_ns", lambda pid: 1e9 * queued[0])
    timeout = DriverTimeout(2.0)
    over = []
    for clock[0], queued[0] in ((101.9, 5.0), (102.1, 5.0), (102.1, 6.0), (103.5, 6.0), (107.9, 99.0), (108.1, 99.0)):
        over.append(timeout.is_over())
    assert over == [False, True, False, True, False, True]


def test_the_wait_for_a_processor_only_grows():
    before = queued_ns(os.getpid())
    assert 0 <= before <= queued_ns(os.getpid()) and queued_ns(1 << 30) == 0


# -- small things ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "became"),
    [("{channel}", "239.1.2.3"), ("--bus={interface}", "--bus=udp_multicast"), ("{port}", "udp_multicast:239.1.2.3")],
)
def test_on_can_the_command_has_interface_and_channel(word, became):
    assert command_of([word], {"hand": "udp_multicast:239.1.2.3"}) == [became]
    assert command_of([word], dict.fromkeys(("left", "right"), "udp_multicast:239.1.2.3")) == [became]


def test_elsewhere_they_stay_as_they_are():
    for port in ("/dev/pts/3", "tcp://127.0.0.1:5", "udp://127.0.0.1:5", "dds:0"):
        assert command_of(["{channel}", "{port}"], {"skin": port}) == ["{channel}", port]
    assert command_of(["{channel}"], {"channel": "/dev/pts/3"}) == ["/dev/pts/3"], "a skin of that name"
    with pytest.raises(TactemuError, match=r"\{port\}.*\{a\}, \{b\}"):
        command_of(["{port}"], {"a": "can0:x", "b": "can1:x"})


@pytest.mark.parametrize("at", [0, 40, 600, 1025])
@pytest.mark.parametrize("head", ["", "123##0"])
def test_a_long_frame_is_cut_around_what_differs(at, head):
    data = bytes(k % 251 for k in range(1026))
    wrong = bytearray(data)
    wrong[at] ^= 0xFF
    case = {
        "device": "d", "command": ["c"], "faults": [f"flip frame 6 byte {at}"], "verdict": "v", "row": None,
        "bytes": [{"before": head + data.hex(), "after": [head + wrong.hex()]}],
    }  # fmt: skip
    sent, arrived = (
        line for line in smallest_case.in_words(case).splitlines() if line.startswith(("  sent", "  arrived"))
    )
    assert sent != arrived and max(len(sent), len(arrived)) < 90
    assert f"[{data[at]:02x}]" in sent and f"[{wrong[at]:02x}]" in arrived and head in sent
    assert sent.rpartition("(")[2] == arrived.rpartition("(")[2], "the same part of both"


def test_a_long_frame_that_ends_early_shows_where():
    data = bytes(k % 251 for k in range(1026)).hex()
    case = {"device": "d", "command": ["c"], "faults": [""], "verdict": "v", "row": None,
            "bytes": [{"before": data, "after": [data[:1400]]}]}  # fmt: skip
    sent, arrived = (
        line for line in smallest_case.in_words(case).splitlines() if line.startswith(("  sent", "  arrived"))
    )
    assert f"{data[1382:1400]}[{data[1400:1418]}] …" in sent and f"{data[1382:1400]} (from byte 691 of 700)" in arrived
