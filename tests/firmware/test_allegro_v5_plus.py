"""Allegro V5 Plus: reports with the servo, pressures, currents."""

import struct

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

NAME = "allegro_v5_plus"
EVERY_10_MS, ON, OFF = "204#0A0000000000", "100#", "104#"


def test_reports_need_a_period_and_the_servo():
    device = fp.create(NAME)
    for requests, frames in (((ON,), 0), ((EVERY_10_MS,), 6), ((OFF,), 0), ((ON,), 6), (("204#000000000000",), 0)):
        for request in requests:
            assert send(device, request) == []
        assert len(sample(device)) == frames
    assert device.period_ns == 10_000_000


@pytest.mark.parametrize(("pressures", "ids"), [("F0", [0x3C0, 0x3C8]), ("50", [0x140, 0x148])])
def test_pressures_are_pascals_within_the_range_of_the_chip(pressures, ids):
    device = fp.create(NAME, pressures=pressures)
    send(device, EVERY_10_MS)
    send(device, ON)
    for force, pascals in ((1.0, 300), (1e6, 23_700), (-1e6, -71_300)):
        frames = sample(device, force)[-2:]
        assert [frame.arbitration_id for frame in frames] == ids
        assert [struct.unpack("<2i", frame.data) for frame in frames] == [(pascals, pascals)] * 2


def test_currents_turn_the_joints_until_the_servo_is_off():
    device = fp.create(NAME, side="left")
    assert send(device, "220#R")[0].data == b"5TBL0001"
    send(device, "184#0A00F6FF00001400")
    assert send(device, "084#R", t_ns=10**9)[0].data == bytes(8), "the servo is off"
    send(device, ON, t_ns=10**9)
    send(device, "184#0A00F6FF00001400", t_ns=10**9)
    send(device, OFF, t_ns=2 * 10**9)
    (pose,) = send(device, "084#R", t_ns=3 * 10**9)
    assert struct.unpack("<4h", pose.data) == (100, -100, 0, 200)
    assert [str(frame) for frame in send(device, "224#", t_ns=3 * 10**9)] == ["248#"]
    assert send(device, "084#R", t_ns=3 * 10**9)[0].data == bytes(8)


@pytest.mark.parametrize(("request_", "counter"), [("150#00", "ignored"), ("204#0300", "bad_length"),
                                                   ("180#00", "bad_length"), ("00000200#R", "ignored")])  # fmt: skip
def test_what_is_not_for_it_gets_silence(request_, counter):
    device = fp.create(NAME)
    assert send(device, request_) == [] and device.counters[counter] == 1
