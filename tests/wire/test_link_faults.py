"""Faults of the port and of the bus: unplugging, bus-off, the chip's timer, other traffic."""

import time

import numpy as np
import pytest

import tactemu
from firmware_protocols import CanFrame
from tactemu.base.errors import SceneError
from tactemu.transports.can import CanTransport
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.transport import DROPPED, RAISED, Closed, Opened
from tactemu.wire.wire import ReceivedData, Wire
from tests.wire.fault_rig import CAN, MS, USB, stream


def test_unplug_and_replug():
    wire = Wire(MemoryTransport(), USB, faults=["unplug at 100ms for 50ms"])
    wire.open()
    events, seen = {}, []
    for now in range(0, 200 * MS, MS):
        if happened := wire.receive(now):
            events[now // MS] = happened
        wire.send([now.to_bytes(8, "big")], now)
        wire.flush(now)
        seen += [int.from_bytes(each, "big") // MS for each in wire.transport.driver.read()]
    assert events == {0: [Opened(), RAISED], 100: [Closed(), DROPPED], 150: [Opened(), RAISED]}
    assert seen == [*range(100), *range(150, 200)]
    assert wire.truth.injected == {"unplug": 1} and wire.counters["unheard"] == 50


def test_busoff_loses_both_directions():
    wire = Wire(MemoryTransport(), CAN, faults=["busoff at 100ms for 50ms"])
    wire.open()
    heard, seen = [], []
    for now in range(0, 200 * MS, MS):
        wire.transport.driver.write(CanFrame(arbitration_id=1))
        heard += [now // MS for event in wire.receive(now) if isinstance(event, ReceivedData)]
        wire.send([CanFrame(arbitration_id=2)], now, "pad")
        wire.flush(now + MS // 2)
        seen += [now // MS for _ in wire.transport.driver.read()]
    assert not set(range(101, 150)) & {*heard, *seen} and len(seen) == 150
    assert wire.truth.injected == {"busoff": 1}


def test_the_latency_timer_hands_over_62_bytes_or_what_is_there_every_16_ms():
    _, seen, _ = stream(USB, ["latency 16ms"], count=400, period=20 * MS)
    waits = np.array([when % (20 * MS) for when, _ in seen]) / MS
    assert [len(each) for _, each in seen] == [8] * len(seen)
    assert 0 <= waits.min() and waits.max() <= 16 and len(set(waits)) > 3
    _, seen, _ = stream(USB, ["latency"], count=400, period=MS)  # 62 bytes are there after eight frames
    assert {len(each) for _, each in seen} == {62}
    sent, seen, _ = stream(USB, ["latency"], count=400, period=3 * MS)  # the timer is first: five or six frames
    assert {len(each) for _, each in seen} <= {40, 48}
    assert b"".join(each for _, each in seen) == b"".join(sent)[: sum(len(each) for _, each in seen)]


def test_other_traffic_takes_its_share():
    _, seen, _ = stream(CAN, ["load 30%"], count=2000)
    ours = [each for _, each in seen if each.arbitration_id < 0x600]
    others = len(seen) - len(ours)
    assert len(ours) >= 1999 and others == pytest.approx(0.3 * 2e6 / 114.3, rel=0.02)


def test_a_babbling_node_lets_nobody_else_through():
    _, seen, injected = stream(CAN, ["babble from 500ms to 700ms"], count=1000)
    ours = [when for when, each in seen if each.arbitration_id >= 0x200]
    assert not [when for when in ours if 501 * MS < when < 700 * MS]
    assert injected["babble"] == pytest.approx(0.2e9 / 130_000, rel=0.05)  # zeros: 130 bits and more with stuffing
    assert len(ours) < 850


def test_an_error_frame_costs_the_frame_twice_over():
    sent, seen, injected = stream(CAN, ["error 10%"], count=2000)
    errors = [each for _, each in seen if each.is_error_frame]
    assert len(errors) == injected["error"] > 100
    assert [each for _, each in seen if not each.is_error_frame] == sent[: len(seen) - len(errors)]


def test_traffic_that_a_late_loop_leaves_out_is_counted():
    wire = Wire(MemoryTransport(), CAN, faults=["load 80%"])
    wire.open()
    for turn in range(20):
        wire.flush(turn * 50 * MS)
    sent, missed = wire.counters["load"], wire.counters["load_missed"]
    assert missed > 5 * sent > 0
    assert (sent + missed) * 0.115 / 950 == pytest.approx(0.8, rel=0.05), "what was asked for"


@pytest.mark.idle("the rate that is left is a rate of this machine")
@pytest.mark.parametrize("fault", ["load 90%", "babble 60%"])
def test_traffic_leaves_a_device_its_rate_on_a_machine_too_slow_for_it(fault, monkeypatch):
    """Make each frame take 1 ms, while the fault requests several thousand a second."""
    write = CanTransport.write

    def slow(self, frame):
        end = time.perf_counter() + 1e-3
        while time.perf_counter() < end:
            pass
        return write(self, frame)

    monkeypatch.setattr(CanTransport, "write", slow)
    with tactemu.serve("barrett_bh8", port="can:virtual:slow", faults=[fault]) as dev:
        time.sleep(2.0)
        kind, counted = fault.split()[0], dev.emulator.summary()[0]
    assert counted["samples"] > 100, "of 200, formerly fewer than 20"
    assert counted["wire"][f"{kind}_missed"] > counted["wire"][kind] > 10


class RealPort(MemoryTransport):
    """A port with a real line behind it."""

    is_paced = True


@pytest.mark.parametrize(
    ("spec", "fault", "instead"),
    [
        (USB, "unplug at 3s", "pull it out"),
        (USB, "latency 4ms", "latency_timer"),
        (CAN, "error 1%", "join CAN_H and CAN_L"),
        (CAN, "busoff at 3s", "ip link set can0 down"),
        (CAN, "load 30%", "cangen"),
        (CAN, "babble", "cangen"),
    ],
)
def test_a_real_line_refuses_what_only_a_model_can_have(spec, fault, instead):
    wire = Wire(RealPort(), spec, faults=[fault])
    with pytest.raises(SceneError, match=f"fault '{fault}': a real .* line cannot have it: .*{instead}"):
        wire.open()
    assert not wire.transport.has_reader, "the port is released"
    running = Wire(RealPort(), spec, faults=["drop 1%"])
    running.open()
    with pytest.raises(SceneError, match=r"a real .* line cannot have it"):
        running.add_fault(fault)
    assert [str(each) for each in running.faults] == ["drop 1%"]
