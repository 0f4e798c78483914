"""ATI Net F/T and OnRobot HEX: records, bias, filter, rates; the page."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

START = "12340002 00000000"


def record(device, pushes=0.0, **values):
    (datagram,) = sample(device, pushes, **values)
    return struct.unpack(">III6i", datagram)


@pytest.mark.parametrize(("name", "force", "torque"), [("ati_net_ft", 1e6, 1e6), ("onrobot_hex", 1e4, 1e5)])
def test_axes_and_torque_about_the_origin(name, force, torque):
    device = fp.create(name, tool=(0.0, 0.1, 0.05))
    assert sample(device, 1.0) == [] and send(device, START) == []
    *_, fx, fy, fz, tx, ty, tz = record(device, force=(3.0, -4.0, -10.0))
    assert [fx, fy, fz] == [3 * force, -4 * force, -10 * force], "on the tool: a push is negative"
    assert [tx, ty, tz] == [round(v * torque) for v in (0.1 * -10 + 0.05 * 4, 0.05 * 3, -0.1 * 3)]


def test_so_many_records_then_silence_and_each_start_numbers_anew():
    device = fp.create("ati_net_ft")
    for _ in range(2):
        send(device, "12340002 00000003")
        assert [record(device)[0] for _ in range(3)] == [1, 2, 3]
        assert sample(device) == []


def test_counts_saturate_and_the_numbers_roll_over():
    device = fp.create("ati_net_ft")
    send(device, START)
    assert record(device, 1e5)[5] == -(2**31)
    device.preset("sequence", 2**32 - 2)
    assert [record(device)[0] for _ in range(3)] == [2**32 - 1, 0, 1]
    assert record(device, t_ns=2**32 * 10**9 // 7000)[1] in (2**32 - 1, 0)


@pytest.mark.parametrize(("name", "on"), [("ati_net_ft", "12340042 00000000"), ("onrobot_hex", "12340042 000000FF")])
def test_bias_is_what_is_felt_now(name, on):
    device = fp.create(name)
    send(device, START)
    record(device, 5.0)
    send(device, on)
    assert record(device, 7.0)[5] == round(-2 * device.scale[2])
    if name == "onrobot_hex":
        send(device, "12340042 00000000")
        assert record(device, 7.0)[5] == -70_000


def test_hex_filter_and_period():
    device = fp.create("onrobot_hex")
    assert device.period_ns == 2_000_000
    send(device, "12340082 0000000A")
    assert device.period_ns == 10_000_000
    for cutoff, hz in enumerate((None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)):
        send(device, f"12340081 {cutoff:08X}")
        assert device.low_pass.cutoff_hz == hz
    send(device, START)
    record(device, 0.0, t_ns=0)
    assert record(device, 100.0, t_ns=10_000_000)[5] == round(-1e6 * (1 - np.exp(-2 * np.pi * 1.5 * 0.01)))
    for wrong in ("12340081 00000007", "12340082 00000000", "12340082 00000100"):
        send(device, wrong)
    assert device.period_ns == 10_000_000 and device.counters["unknown_command"] == 3


@pytest.mark.parametrize("name", ["ati_net_ft", "onrobot_hex"])
def test_what_is_no_request_is_ignored(name):
    device = fp.create(name)
    for wrong in ("", "12", "12350002 00000000", "12340002 000000", "12340002 00000000 00"):
        assert send(device, wrong, port=device.ports[0].name) == []
    assert sample(device) == [] and device.counters["bad_request"] == 5


def test_the_page_says_how_it_is_set_and_forgets_half_a_request():
    device = fp.create("ati_net_ft", counts_per_force=2000, counts_per_torque=3000, records_per_second=500)
    assert device.period_ns == 2_000_000
    ask = b"GET /netftapi2.xml HTTP/1.1\r\nHost: box\r\n\r\n"
    assert send(device, ask[:20], port="http") == []
    device.lines(False, False, 0, "http")
    (answer,) = send(device, ask, port="http")
    for said in (b"cfgcpf>2000<", b"cfgcpt>3000<", b"comrdtrate>500<", b"scfgfu>N<", b"scfgtu>Nm<"):
        assert said in answer
