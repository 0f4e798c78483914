"""Faults of single frames: which frames they hit, what becomes of them, and how they are counted and logged."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocols import CanFrame, Tcp
from tactemu.base.frame_text import text
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.transport import DROPPED, RAISED, Closed, Opened
from tactemu.truth import Truth, read_log
from tactemu.wire.faults import FAULTS, possible_faults
from tactemu.wire.faults.fault import Corruption
from tactemu.wire.line_models import line_model_for
from tactemu.wire.wire import ReceivedData, Wire
from tests.wire.fault_rig import CAN, MS, UDP, USB, data_of, frame, stream

# -- exactly this ----------------------------------------------------------------------------------------------------

WHOLE = b"\x10\x11\x12\x13"


@pytest.mark.parametrize(
    ("fault", "becomes"),
    [
        ("flip frame 2 byte 1 bit 3", ["10191213"]),
        ("flip frame 2 byte -1 bit 0", ["10111212"]),
        ("lose frame 2 byte 2", ["101113"]),
        ("truncate frame 2 to 1", ["10"]),
        ("truncate frame 2 to 0", []),
        ("garbage frame 2 hex=aa07", ["aa07", "10111213"]),
        ("garbage frame 2 hex=aa07 after 3", ["101112aa0713"]),
        ("split frame 2 after 3", ["101112", "13"]),
        ("chunk frame 2 bytes 3", ["101112", "13"]),
        ("chunk frame 2", ["10", "11", "12", "13"]),
        ("replace frame 2 hex=0183", ["0183"]),
        ("drop frame 2-2", []),
        ("flip frame 2 byte 4", ["10111213"]),  # there is none: not counted
        ("split frame 2 after 4", ["10111213"]),
    ],
)
def test_a_fault_hits_the_frame_and_the_place_that_it_names(fault, becomes, tmp_path):
    truth = Truth(tmp_path / "t.jsonl")
    wire = Wire(MemoryTransport(), USB, faults=[fault], truth=truth)
    wire.open()
    wire.receive(0)
    for k in range(4):
        wire.send([WHOLE], k * 100 * MS, "pad")
        for t in range(10):
            wire.flush((k * 100 + t) * MS)
    wire.close()
    truth.close()
    assert [each.hex() for each in wire.transport.driver.read()] == [WHOLE.hex(), *becomes, WHOLE.hex(), WHOLE.hex()]
    injected = read_log(tmp_path / "t.jsonl")["pad"].injects
    if becomes == [WHOLE.hex()]:
        assert not injected
    else:
        (entry,) = injected
        assert entry.detail == f"{fault} [to_driver, frame 2]"
        assert (entry.fault, entry.frame) == (fault, 2)
        assert (entry.before, list(entry.after)) == (WHOLE.hex(), becomes)


def test_frames_are_counted_among_those_that_match_and_in_lists():
    sent, seen, injected = stream(CAN, ["drop frame 2,4-5 id=0x201", "lose byte 7 frame 1"], count=16)
    odd = [each for each in sent if each.arbitration_id == 0x201]
    left = [each for _, each in seen]
    assert len(left[0].data) == 7 and injected == Counter(drop=3, lose=1)
    assert [each for each in odd if each not in left] == [odd[1], odd[3], odd[4]]


def test_a_request_is_lost_by_its_number():
    wire = Wire(MemoryTransport(), USB, faults=["drop frame 2 from_driver"])
    wire.open()
    wire.receive(0)
    heard = []
    for k in range(3):
        wire.transport.driver.write(bytes([k]))
        for t in range(3):
            heard += [each.data for each in wire.receive((10 * k + t) * MS) if isinstance(each, ReceivedData)]
    assert heard == [b"\0", b"\2"]


# -- single frames ---------------------------------------------------------------------------------------------------

SPOILERS = ["drop", "flip", "truncate", "length", "checksum", "duplicate", "garbage", "split", "stray"]


@pytest.mark.parametrize(
    ("kind", "spec"),
    [(kind, spec) for kind in SPOILERS for spec in (USB, CAN, UDP) if kind in possible_faults(line_model_for(spec))],
    ids=str,
)
def test_a_fault_corrupts_as_many_as_it_counts_and_leaves_the_others_alone(kind, spec):
    sent, seen, injected = stream(spec, [f"{kind} 5%"])
    n = injected[kind]
    assert 60 <= n <= 145, "5 % of 2000 within five standard deviations"
    got = [data_of(each) for _, each in seen]
    good = set(map(data_of, sent))
    missing = len(good - set(got))
    wrong = [each for each in got if each not in good]
    extra = len(got) - len(wrong) - len(set(got) & good)
    expected = {
        "drop": (n, 0, 0),
        "flip": (n, n, 0),
        "truncate": (n, n, 0),
        "length": (n, n, 0),
        "checksum": (n, n, 0),
        "duplicate": (0, 0, n),
        "garbage": (0, n, 0),
        "split": (n, 2 * n, 0),
        "stray": (0, 0, n),
    }
    assert (missing, len(wrong), extra) == expected[kind]
    lengths = {len(each) for each in wrong}
    if kind in ("flip", "checksum"):
        assert lengths == {8}
    if kind == "checksum":
        assert {each[:-1] for each in wrong} <= {each[:-1] for each in good}
    if kind == "flip":
        numbers = {int.from_bytes(each, "big") for each in good}
        assert all(any((int.from_bytes(w, "big") ^ 1 << bit) in numbers for bit in range(64)) for w in wrong)
    if kind == "truncate":
        assert all(any(each.startswith(w) for each in good) for w in wrong) and max(lengths) == 7
    if kind == "length":
        assert lengths == ({7} if spec is CAN else {9})


def test_reorder_swaps_neighbours_and_merge_joins_them():
    sent, seen, injected = stream(USB, ["reorder 10%"])
    got = [each for _, each in seen]
    swaps = sum(a > b for a, b in pairwise(got))
    assert swaps == injected["reorder"] > 100 and sorted(got) == sent[: len(got)]
    sent, seen, injected = stream(USB, ["merge 10%"])
    got = [each for _, each in seen]
    assert sum(len(each) == 16 for each in got) == injected["merge"] > 100
    assert b"".join(got) == b"".join(sent)[: len(b"".join(got))]


def test_reorder_by_three_lets_three_others_pass():
    sent, seen, injected = stream(UDP, ["reorder every 10 frames 3"], count=60)
    assert [each for _, each in seen[:20]] == [*sent[:9], *sent[10:13], sent[9], *sent[13:19], sent[20]]
    assert sorted(each for _, each in seen) == sent[:59] and injected["reorder"] == 5, "the last is still held"


def test_late_comes_later_and_on_a_byte_stream_what_follows_waits_for_it():
    sent, seen, injected = stream(USB, ["late 10% by 3500us"])
    assert [each for _, each in seen] == sent[: len(seen)], "no line lets bytes overtake each other"
    delays = [when - k * MS for k, (when, _) in enumerate(seen)]
    assert max(delays) == 3_500_000 and min(delays) == 0 and injected["late"] > 100


@pytest.mark.parametrize("spec", [CAN, UDP])
def test_late_on_a_bus_and_as_a_datagram_lets_others_pass(spec):
    sent, seen, injected = stream(spec, ["late 10% by 3500us"])
    assert [each for _, each in seen] != sent[: len(seen)] and injected["late"] > 100


def test_silence_is_total_while_it_lasts():
    _, seen, injected = stream(USB, ["silence at 500ms for 200ms"])
    assert injected["silence"] == 200
    assert not [when for when, _ in seen if 500 * MS <= when < 700 * MS] and len(seen) == 1800


def test_targets_and_schedules():
    sent, seen, injected = stream(CAN, ["drop id=0x201 from 100ms to 300ms"])
    lost = [k for k, each in enumerate(sent) if each not in {got for _, got in seen}]
    assert lost[:-1] == list(range(101, 300, 2))[: len(lost) - 1] and injected["drop"] == 100
    sent, seen, injected = stream(USB, ["drop every 10", "flip at 705ms"])
    lost = [k for k, each in enumerate(sent) if each not in {got for _, got in seen}]
    assert lost == sorted([*range(9, 2000, 10), 705]) and injected == {"drop": 200, "flip": 1}
    sent, seen, injected = stream(USB, ["drop prefix=000001"])
    assert injected["drop"] == 256 and {each for _, each in seen} == set(sent) - set(sent[256:512])


def test_same_seed_same_faults_and_one_more_changes_no_other():
    _, first, _ = stream(USB, ["flip 5%"], seed=1)
    assert stream(USB, ["flip 5%"], seed=1)[1] == first
    assert stream(USB, ["flip 5%"], seed=2)[1] != first
    _, both, spoiled = stream(USB, ["duplicate 5%", "flip 5% from 0s"], seed=1)
    _, alone, _ = stream(USB, ["duplicate 5%"], seed=1)
    assert [when for when, _ in both] == [when for when, _ in alone] and spoiled["flip"] > 50


def test_directions():
    for direction, to_driver, from_driver in (("to_driver", 0, 9), ("from_driver", 9, 0), ("both", 0, 0)):
        truth = Truth()
        wire = Wire(MemoryTransport(), USB, faults=[f"drop {direction}"], truth=truth)
        wire.open()
        heard = []
        for now in range(9):
            wire.send([b"out"], now)
            wire.transport.driver.write(b"in")
            heard += [event for event in wire.receive(now) if isinstance(event, ReceivedData)]
            wire.flush(now)
        assert (len(wire.transport.driver.read()), len(heard)) == (to_driver, from_driver)
        assert truth.injected["drop"] == 18 - to_driver - from_driver


def test_faults_can_be_switched_while_running():
    wire = Wire(MemoryTransport(), USB)
    wire.open()
    wire.receive(0)
    assert wire.faults == []
    fault = wire.add_fault("drop")
    wire.send([b"lost"], 1)
    wire.remove_fault(fault)
    wire.send([b"kept"], 2)
    wire.flush(3)
    assert wire.transport.driver.read() == [b"kept"] and wire.faults == []


def test_a_connection_that_is_closed_in_place_of_a_frame_can_be_opened_again():
    wire = Wire(MemoryTransport(), Tcp(port=1), faults=["close every 3"])
    wire.open()
    wire.receive(0)
    got = []
    for k in range(9):
        wire.send([b"%d" % k], k * MS, "pad")
        wire.flush(k * MS)
        got += wire.transport.driver.read()
        if not wire.transport.driver.is_open:
            wire.transport.driver.open()
            assert wire.receive(k * MS) == [Closed(), DROPPED, Opened(), RAISED]
    assert b"".join(got) == b"013467" and wire.counters["close"] == 3


@pytest.mark.parametrize("kind", ["reorder", "merge"])
def test_what_a_fault_holds_back_is_never_lost_uncounted(kind):
    wire = Wire(MemoryTransport(), USB)
    wire.open()
    wire.receive(0)
    fault = wire.add_fault(kind)
    wire.send([frame(1, USB)], 0, "pad")
    wire.flush(0)
    assert not wire.transport.driver.read() and not wire.counters["sent"]
    wire.remove_fault(fault)
    wire.flush(MS)
    assert wire.transport.driver.read() == [frame(1, USB)]

    wire.add_fault(kind)
    wire.send([frame(2, USB)], MS, "pad")
    wire.transport.driver.close()
    wire.receive(2 * MS)
    assert wire.counters["sent"] == 1 and wire.counters["unheard"] == 1


@pytest.mark.parametrize("kind", ["reorder", "merge"])
def test_what_a_fault_held_back_is_not_overtaken_when_it_is_removed(kind):
    """Let the loop be late: the next reading is ready before the fault is removed."""
    wire = Wire(MemoryTransport(), USB)
    wire.open()
    wire.receive(0)
    fault = wire.add_fault(kind)
    wire.send([b"first"], 0, "pad")
    wire.flush(30 * MS)
    wire.remove_fault(fault)
    wire.send([b"second"], 10 * MS, "pad")
    wire.flush(31 * MS)
    assert wire.transport.driver.read() == [b"first", b"second"]


@pytest.mark.parametrize("kind", ["reorder", "drop"])
def test_a_held_command_reaches_the_device_when_the_fault_is_removed(kind):
    wire = Wire(MemoryTransport(), USB)
    wire.open()
    fault = wire.add_fault(f"{kind} from_driver")
    wire.transport.driver.write(b"command")
    assert wire.receive(0) == [Opened(), RAISED]
    wire.remove_fault(fault)
    assert wire.receive(MS) == ([ReceivedData(b"command")] if kind == "reorder" else [])


def test_a_usb_chip_that_is_taken_out_hands_over_what_it_has():
    wire = Wire(MemoryTransport(), USB)
    wire.open()
    wire.receive(0)
    fault = wire.add_fault("latency 16ms to 10ms")
    driver = wire.transport.driver
    wire.send([b"early"], 0, "pad")
    wire.flush(0)
    assert not driver.read()
    wire.send([b"late"], 11 * MS, "pad")
    wire.flush(11 * MS)
    assert driver.read() == [b"earlylate"], "its time is over: nothing waits any more"
    wire.remove_fault(fault)

    fault = wire.add_fault("latency 16ms")
    wire.send([b"held"], 20 * MS, "pad")
    wire.flush(20 * MS)
    assert not driver.read()
    wire.remove_fault(fault)
    assert driver.read() == [b"held"]


def test_flipped_bits_are_spread_evenly():
    rng_bits = np.zeros(64)
    sent, seen, _ = stream(USB, ["flip bits 4"], count=4000)
    for each, (_, got) in zip(sent, seen):
        flipped = int.from_bytes(each, "big") ^ int.from_bytes(got, "big")
        assert flipped.bit_count() == 4
        rng_bits += [(flipped >> k) & 1 for k in range(64)]
    assert np.abs(rng_bits - 250).max() < 5 * np.sqrt(250), "uniform within five standard deviations"


CORRUPTIONS = [fault for fault in FAULTS.values() if issubclass(fault, Corruption)]
COUNTS = ("bits", "cut", "more", "width", "size")


@given(st.binary(min_size=1, max_size=64), st.sampled_from(CORRUPTIONS), st.integers(1, 600), st.integers(0, 999))
def test_any_frame_can_be_corrupted(data, kind, count, seed):
    """Corrupt frames into frames: bytes, or a CAN frame of a valid length."""
    values = dict.fromkeys(kind.options().keys() & COUNTS, count) | dict.fromkeys(kind.options().keys() & {"by_ns"}, 5)
    fault = kind(**values | ({"data": b"\x01"} if kind.word == "replace" else {}))
    for spec, spoiled in ((USB, data), (CAN, CanFrame(arbitration_id=1, data=data[:8]))):
        if kind.word not in possible_faults(line_model_for(spec)):
            continue
        for each, delay in fault.corrupt(spoiled, np.random.default_rng(seed)) or []:
            assert delay % 5 == 0 and isinstance(each, type(spoiled))
            if isinstance(each, CanFrame):
                assert len(each.data) <= 8


@pytest.mark.parametrize("spec", [USB, CAN], ids=["usb", "can"])
@pytest.mark.parametrize("fault", ["flip", "drop", "duplicate", "truncate", "checksum"])
def test_the_log_has_the_frames_before_and_after_a_fault(fault, spec, tmp_path):
    truth = Truth(tmp_path / "t.mcap")
    wire = Wire(MemoryTransport(), spec, faults=[f"{fault} every 2"], truth=truth, pacing=False)
    wire.open()
    wire.receive(0)
    sent, arrived = [frame(k, spec) for k in range(6)], []
    for k, each in enumerate(sent):
        wire.send([each], k * MS, "pad", sample=k)
        wire.flush(k * MS)
        arrived.append(wire.transport.driver.read())
    truth.close()
    log = read_log(tmp_path / "t.mcap")["pad"]
    assert [each.before for each in log.injects] == [text(each) for each in sent[1::2]]
    assert [list(each.after) for each in log.injects] == [[text(each) for each in got] for got in arrived[1::2]]
    hit = {f"{fault} every 2 [to_driver, frame {number}]" for number in range(2, 2 + 2 * len(log.injects), 2)}
    assert {each.detail for each in log.injects} <= hit
    assert [each.sample for each in log.frames] == [k for k, got in enumerate(arrived) for _ in got]


def test_a_reading_that_is_dropped_is_logged_with_its_sample(tmp_path):
    truth = Truth(tmp_path / "t.jsonl")
    wire = Wire(MemoryTransport(), USB, truth=truth)
    wire.send([b"frame"], 0, "pad", sample=7)
    truth.close()
    (lost,) = read_log(tmp_path / "t.jsonl")["pad"].frames
    assert (lost.kind, lost.sample, lost.why) == ("drop", 7, "no reader")
