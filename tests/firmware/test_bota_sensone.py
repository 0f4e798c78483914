"""SensONE: frames, commands with and without an end, states, limits."""

import struct

import pytest

import firmware_protocols as fp
from firmware_protocols import Restart
from tests.firmware.feeding import frames, sample, send


def told(device, *commands: bytes) -> list:
    return [answer for command in commands for answer in send(device, command + b"\n")]


def test_a_frame():
    device = fp.create("bota_sensone")
    told(device, b"C", b"R")
    (frame,) = sample(
        device, wrench=[[1.5, -2.0, 3.0, 0.25, -0.5, 0.125]], temperature=31.5, t_ns=(1 << 32) * 1000 + 7000
    )
    assert len(frame) == 37 and frame[0] == 0xAA
    assert struct.unpack("<H6fIf", frame[1:35]) == (0, 1.5, -2.0, 3.0, 0.25, -0.5, 0.125, 7, 31.5)


def test_a_torque_follows_from_where_the_tool_is_touched():
    device = fp.create("bota_sensone", tool=(0.0, 0.0, 0.5))
    sample(device, force=(2.0, -3.0, -5.0))
    assert device.counts["wrench"].tolist() == [[2.0, -3.0, -5.0, 1.5, 1.0, 0.0]]


def test_it_answers_as_it_should_and_only_then():
    device = fp.create("bota_sensone")
    assert told(device, b"R", b"f,512,0,0,1", b"s") == [] and device.counters["refused"] == 3
    assert told(device, b"C", b"c,0,1,0,4", b"s") == [b"r,0,C,0\r\n", b"r,0,c,0\r\n", b"r,0,s,0\r\n"]
    assert sample(device) == []
    assert told(device, b"R") == [b"r,0,R,0\r\n"] and len(sample(device)) == 1
    assert told(device, b"R") == [b"r,0,R,0\r\n"] and len(sample(device)) == 1, "after a tare it is told again"
    assert told(device, b"f,512,0,0,1") == [] and told(device, b"C") == [b"r,0,C,0\r\n"] and sample(device) == []


def test_a_silence_ends_a_command():
    device = fp.create("bota_sensone")
    assert send(device, b"C") == [] and device.wake_ns == 20_000_000
    assert frames(device.wake(20_000_000)) == [b"r,0,C,0\r\n"]


@pytest.mark.parametrize(("line", "period_ns"), [(b"f,64,0,0,1", 1_250_000), (b"f,2048,0,0,1", 40_000_000)])
def test_the_filter_sets_the_rate(line, period_ns):
    device = fp.create("bota_sensone")
    told(device, b"C", line)
    assert device.period_ns == period_ns


@pytest.mark.parametrize(
    "line", [b"f,63,0,0,1", b"f,2049,0,0,1", b"f,512", b"b,1,2,3,4,5", b"b,1,2,3,4,5,nan", b"p", b"C1"]
)
def test_what_is_no_command(line):
    device = fp.create("bota_sensone")
    told(device, b"C")
    assert told(device, line) == [] and device.counters["refused"] == 1
    assert device.period_ns == 10_000_000 and not device.zero.any()


def test_overrange():
    device = fp.create("bota_sensone", force_range=100.0)
    told(device, b"C", b"R")
    (frame,) = sample(device, wrench=[[0, 120.0, 0, 0, 0, 0]])
    assert frame[1:3] == b"\2\0" and device.counts["wrench"][0].tolist() == [0, 100, 0, 0, 0, 0]


def test_it_restarts_where_its_port_is_opened():
    device = fp.create("bota_sensone")
    assert device.lines(True, True, 0, "") == [Restart()] and device.lines(False, False, 0, "") == ()
    assert device.boot(0) == [b"App Init\r\n"]


def test_the_serial_number_has_three_digits():
    device = fp.create("bota_sensone", serial_number=7)
    assert told(device, b"C", b"p?")[1].startswith(b"p,0,007,0,0,BFT-SENS-SER-M8\r\n")
