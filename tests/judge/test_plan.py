"""Tests of the plan: trials that fit the line, device and driver, and exact faults that parse and hit their target."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_protocols import Can, Rollover, Serial, Tcp
from firmware_protocols.sums import crc16_modbus
from tactemu.base.errors import TactemuError
from tactemu.judge import forged_replies
from tactemu.judge.plan import NO_CHECKSUM, LineFacts, Plan, positions
from tactemu.judge.trial_choice import check_names, chosen
from tactemu.wire.faults import check_fits, parse
from tactemu.wire.line_models import line_model_for

ROLLOVERS = [Rollover(name="counter", bits=16, state="sent"), Rollover(name="tick", bits=32, clock=True)]
STREAM = LineFacts(
    line=line_model_for(Serial(baud=115_200, usb=True)), frames=["aa07080a" + "00" * 12] * 50, rollovers=ROLLOVERS
)
RTU = bytes([1, 4, 8, 0, 1, 0, 2, 0, 3, 0, 4])
RTU += crc16_modbus(RTU).to_bytes(2, "little")
POLLED = LineFacts(asks=True, talks=True, frames=[RTU.hex()] * 50, requests=["010400070020" + "4013"] * 50, taxels=32)
CAN = LineFacts(line=line_model_for(Can()), frames=[f"7{k:02X}#00112233445566" for k in range(16)] * 4,
            frames_per_row=16, identifiers=range(0x710, 0x720), taxels=16)  # fmt: skip


def plan(facts, **more):
    return {trial.name: trial for trial in Plan(facts, **more).trials()}


@pytest.mark.parametrize("facts", [STREAM, POLLED, CAN], ids=["stream", "polled", "can"])
def test_every_fault_can_be_had_on_its_line_and_every_trial_has_a_reason(facts):
    trials = plan(facts).values()
    for trial in trials:
        assert trial.why and (trial.skipped or trial.faults or trial.action), trial
        for fault in trial.faults:
            check_fits(fault, facts.line)
            assert parse(str(fault)) == fault
    assert len({trial.name for trial in trials}) == len(trials) >= 14


def test_what_makes_no_sense_says_why():
    assert "USB" in plan(STREAM)["wrong baud"].skipped and not plan(POLLED)["wrong baud"].skipped
    assert "sends nothing" in plan(STREAM)["requests damaged"].skipped
    assert "sum of its own" in plan(replace(POLLED, line=line_model_for(Tcp(port=1))))["requests damaged"].skipped
    assert "cannot be unplugged" in plan(CAN)["unplug"].skipped
    assert "pull it out" in plan(replace(POLLED, is_real=True))["unplug"].skipped
    assert plan(STREAM)["counter wraps"].preset == "counter" and plan(CAN)["counter wraps"].skipped
    assert "nothing that sets it" in plan(STREAM)["tick wraps"].skipped and not plan(STREAM)["counter wraps"].skipped
    assert "one taxel" in plan(STREAM)["dead taxel"].skipped


def test_trials_are_chosen_by_name_else_by_words_and_one_that_is_none_says_so():
    trials = Plan(STREAM).trials()
    assert [trial.name for trial in chosen(trials, ["byte lost", "clean"])] == ["byte lost"]
    assert {trial.name for trial in chosen(trials, ["wraps", "cut"])} == {"counter wraps", "tick wraps", "cut"}
    hang, none = chosen(trials, ["flip", "hang"])
    assert hang.name == "hang" and not hang.skipped and none.name == "flip" and "no trial of this name" in none.skipped


def test_names_that_no_plan_has_are_refused_before_the_run():
    for facts in (STREAM, POLLED, CAN):
        check_names(list(plan(facts)))
    check_names(["clean", "tick wraps", "lost"])
    with pytest.raises(TactemuError, match="no trial 'flapped'; did you mean 'flipped'"):
        check_names(["hang", "flapped"])


@pytest.mark.parametrize("size", [1, 16, 30, 31, 82, 1000])
def test_positions_hold_head_and_end_and_some_between(size):
    found = positions(size, np.random.default_rng(0))
    assert found == sorted(set(found)) and found[0] == 0 and found[-1] == size - 1
    assert len(found) <= 30 and (size > 30 or found == list(range(size)))
    if size > 30:
        assert {*range(11), *range(size - 5, size)} <= set(found)
    assert positions(size, np.random.default_rng(0), every=True) == list(range(size))


def test_edits_are_apart():
    numbers = [fault.frames[0][0] for fault in plan(STREAM)["flipped"].edits]
    assert len(numbers) == 16 and set(np.diff(numbers)) == {4}
    assert "sum of its own" in plan(CAN)["flipped"].skipped
    numbers = [fault.frames[0][0] for fault in plan(CAN)["cut"].edits]
    assert min(np.diff(numbers)) > 2 * 16 and len({(n - 1) % 16 for n in numbers}) > 4, "of all frames of a scan"


def test_a_plan_takes_half_a_minute():
    assert sum(t.takes_s for t in Plan(STREAM).trials() if not t.skipped) < 30.0


def test_same_seed_same_plan():
    wide = LineFacts(frames=["00" * 400] * 9)
    assert plan(wide, seed=3) == plan(wide, seed=3) != plan(wide, seed=4)


def spoilt(frame, reply):
    """Return a frame after the exact faults of one frame."""
    rng = np.random.default_rng(0)
    for fault in reply.faults(((1, 1),)):
        ((frame, _),) = fault.corrupt(frame, rng)
    return frame


def test_answers_that_lie_are_whole():
    forged = {reply.name: spoilt(RTU, reply) for reply in forged_replies.forged_values([RTU.hex()], with_checksum=True)}
    assert all(crc16_modbus(reply[:-2]).to_bytes(2, "little") == reply[-2:] for reply in forged.values())
    assert forged["exception"][:3] == bytes([1, 0x84, 4]) and forged["another unit"][0] == 0 != RTU[0]
    assert forged["short answer"][2] == len(forged["short answer"]) - 5 < RTU[2]
    assert forged["another unit"][3:5] != RTU[3:5], "a wrong answer is no reading"

    body = bytes([1, 3, 8, 0, 1, 0, 2, 0, 3, 0, 4])
    answer = bytes.fromhex("00290000") + len(body).to_bytes(2, "big") + body
    forged = {
        reply.name: spoilt(answer, reply) for reply in forged_replies.forged_values([answer.hex()], with_checksum=False)
    }
    assert forged["exception"] == bytes.fromhex("002900000003018304")
    assert forged["short answer"][:9] == bytes.fromhex("002900000007010304") and len(forged["short answer"]) == 13
    assert forged["another transaction"][:2] == b"\x00\x28" and forged["another unit"][6] == 0
    assert forged_replies.forged_values(["aa07080a"], with_checksum=True) == []


def test_flipped_bits_of_a_device_without_a_checksum_have_a_remark():
    trials = plan(replace(STREAM, lacks_checksum=True))
    assert [name for name, trial in trials.items() if trial.remark] == ["flipped"]
    assert trials["flipped"].as_dict()["remark"] == NO_CHECKSUM and not plan(STREAM)["flipped"].remark
