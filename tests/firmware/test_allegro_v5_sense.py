"""Allegro V5 Sense: channels at their places, saturation below the invalid byte."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "allegro_v5_sense"


def channels(frames) -> list[int]:
    assert [f.arbitration_id for f in frames] == [0x54 << 2, 0x55 << 2]
    return list(frames[0].data + frames[1].data)


def test_each_channel_at_its_place():
    device = fp.create(NAME)
    assert channels(sample(device, np.arange(16) * 0.4)) == list(range(0, 160, 10))
    names = [patch.name for patch in device.layout.patches]
    assert names[0] == "palm" and [names[k] for k in (3, 7, 11, 15)] == [
        "index tip", "middle tip", "ring tip", "thumb tip"
    ]  # fmt: skip


def test_a_push_never_says_invalid():
    device = fp.create(NAME, invalid=[5])
    got = channels(sample(device, 1e9))
    assert got == [254] * 5 + [255] + [254] * 10
    assert device.counts[5] == 0, "what a driver shows of it"


@pytest.mark.parametrize(("request_", "counter"), [
    ("150#00", "ignored"), ("080#00", "bad_length"), ("00000200#R", "ignored"), ("204#0300", "bad_length"),
    ("180#00", "bad_length"), ("100#R", "bad_length"),
])  # fmt: skip
def test_what_is_not_for_it_gets_silence(request_, counter):
    device = fp.create(NAME)
    sample(device)
    assert send(device, request_) == [] and device.counters[counter] == 1


@pytest.mark.parametrize(("side", "letter"), [("right", b"R"), ("left", b"L")])
def test_it_says_what_it_is_and_whether_its_servos_are_on(side, letter):
    device = fp.create(NAME, side=side)
    assert send(device, "220#R")[0].data[3:4] == letter
    states = [send(device, request)[0].data[6] for request in ("200#R",)]
    for request in ("100#", "104#"):
        send(device, request)
        states.append(send(device, "200#R")[0].data[6])
    assert states == [0, 1, 0]


def test_joints_come_at_their_period_until_it_is_0():
    device = fp.create(NAME)
    assert send(device, "204#030000000000", t_ns=1_000_000) == [] and device.wake_ns == 4_000_000
    assert [f.arbitration_id for f in device.wake(4_000_000)] == [0x80, 0x84, 0x88, 0x8C]
    assert device.wake_ns == 7_000_000
    send(device, "204#000000000000", t_ns=5_000_000)
    assert device.wake_ns is None


def test_a_finger_goes_to_positions_and_torques_move_nothing():
    device = fp.create(NAME)
    send(device, "188#E803E803E803E803")
    assert send(device, "088#R", t_ns=10**9)[0].data == bytes(8)
    send(device, "228#0100000000000000", t_ns=10**9)
    send(device, "188#E803E803E80318FC", t_ns=10**9)
    assert send(device, "088#R", t_ns=2 * 10**9)[0].data.hex() == "e803e803e80318fc"
    assert device.joints(2 * 10**9)["ring 3"] == pytest.approx(-np.radians(88))
    send(device, "224#", t_ns=2 * 10**9)
    assert send(device, "088#R", t_ns=2 * 10**9)[0].data == bytes(8)
    send(device, "388#0A00000000000000", t_ns=2 * 10**9)
    assert send(device, "088#R", t_ns=3 * 10**9)[0].data.hex() == "0a00000000000000"


def test_channels_that_it_does_not_have_are_refused():
    with pytest.raises(ValueError, match="invalid"):
        fp.create(NAME, invalid=[16])
