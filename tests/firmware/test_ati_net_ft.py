"""ATI Net F/T and OnRobot HEX: records, bias, filter, rates; TCP; the page."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

START = "12340002 00000000"
UNFILTERED = "12340081 00000000"
READ = bytes(20)


def record(device, pushes=0.0, **values):
    (datagram,) = sample(device, pushes, **values)
    return struct.unpack(">III6i", datagram)


@pytest.mark.parametrize(("name", "force", "torque"), [("ati_net_ft", 1e6, 1e6), ("onrobot_hex", 1e4, 1e5)])
def test_axes_and_torque_about_the_origin(name, force, torque):
    device = fp.create(name, tool=(0.0, 0.1, 0.05))
    send(device, UNFILTERED)
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
    send(device, UNFILTERED)
    record(device, 5.0)
    send(device, on)
    assert record(device, 7.0)[5] == round(-2 * device.scale[2])
    if name == "onrobot_hex":
        send(device, "12340042 00000000")
        assert record(device, 7.0)[5] == -70_000


@pytest.mark.parametrize("halves", ["0000", "same"])
def test_hex_filter_and_period(halves):
    """The vendor's ROS driver repeats the 16 bits of an argument in both halves."""

    def ask(command, value):
        send(device, f"1234{command}{f'{value:04X}' if halves == 'same' else halves}{value:04X}")

    device = fp.create("onrobot_hex")
    assert device.period_ns == 10_000_000 and device.low_pass.cutoff_hz == 15.0
    ask("0082", 3)
    assert device.period_ns == 3_000_000
    for cutoff, hz in enumerate((None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)):
        ask("0081", cutoff)
        assert device.low_pass.cutoff_hz == hz
    send(device, START)
    record(device, 0.0, t_ns=0)
    assert record(device, 100.0, t_ns=10_000_000)[5] == round(-1e6 * (1 - np.exp(-2 * np.pi * 1.5 * 0.01)))
    assert not device.counters["unknown_command"]
    for command, wrong in (("0081", 7), ("0082", 0x100), ("0042", 1)):
        ask(command, wrong)
    assert device.period_ns == 3_000_000 and device.counters["unknown_command"] == 3
    ask("0082", 0)
    assert device.period_ns == 0, "nothing is read out"


def test_hex_says_which_axes_are_overloaded():
    device = fp.create("onrobot_hex", status=0x2000, torque_range=2.0)
    send(device, UNFILTERED)
    send(device, START)
    assert record(device, force=(0.0, 30.0, -201.0))[2] == 0x2000 | 1 << 6 | 1
    assert record(device, force=(201.0, 50.0, 0.0))[2] == 0x2000 | 1 << 4 | 1 << 7 | 1 << 8 | 1
    assert record(device, force=(0.0, 30.0, -199.0))[2] == 0x2000


def test_ati_bias_over_tcp_and_what_is_refused():
    device = fp.create("ati_net_ft", counts_per_force=1000, counts_per_torque=1000)
    sample(device, 110.0)
    (answer,) = send(device, READ, port="tcp")
    assert struct.unpack(">HH6h", answer) == (0x1234, 0, 0, 0, -10_000, 0, 0, 0), "330 N need a scale of 11"
    (answer,) = send(device, READ[:19] + b"\1", port="tcp")
    assert answer[4:] == bytes(12) and device.bias.any()
    assert send(device, b"\2" + READ[1:], port="tcp") == [bytes.fromhex("12340201")]
    assert send(device, b"\4" + READ[1:], port="tcp") == []
    assert device.counters["refused"] == device.counters["unknown_command"] == 1


@pytest.mark.parametrize("name", ["ati_net_ft", "onrobot_hex"])
def test_requests_over_tcp_come_in_pieces_and_a_client_that_goes_takes_its_half_along(name):
    device = fp.create(name)
    assert send(device, READ[:7], port="tcp") == []
    assert len(send(device, READ[7:] + READ, port="tcp")) == 2
    assert send(device, b"\1" * 5, port="tcp") == []
    device.lines(False, False, 0, "tcp")
    (answer,) = send(device, READ, port="tcp")
    assert len(answer) == 16


def test_ati_sends_several_records_in_a_datagram():
    device = fp.create("ati_net_ft", buffered=3)
    send(device, "12340003 00000005")
    sent = [sample(device) for _ in range(6)]
    assert [len(out[0]) // 36 if out else 0 for out in sent] == [0, 0, 3, 0, 2, 0]
    numbers = [struct.unpack_from(">I", out[0], 36 * k)[0] for out in sent if out for k in range(len(out[0]) // 36)]
    assert numbers == [1, 2, 3, 4, 5]
    send(device, "12340003 00000000")
    sample(device)
    send(device, START)
    assert record(device)[0] == 1, "what was held is forgotten"


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
    for said in (b"runstat>0x00000000<", b"comrdte>Enabled<", b"cfgmr>330;330;330;30;30;30<"):
        assert said in answer
    sample(device, 5.0)
    send(device, "12340042 00000000")
    sample(device, 7.0)
    (answer,) = send(device, ask, port="http")
    assert b"runft>0;0;-4000;0;0;0<" in answer and b"setbias>0;0;-10000;0;0;0<" in answer


@pytest.mark.parametrize(("asked", "adopted"), [(7000, 7000), (1000, 1000), (150, 152), (99, 100), (1, 1)])
def test_rates_are_rounded_up_to_what_divides_7000(asked, adopted):
    device = fp.create("ati_net_ft", records_per_second=asked)
    assert device.period_ns == round(1e9 / 7000 * (7000 // asked))
    (answer,) = send(device, b"GET /netftapi2.xml HTTP/1.1\r\nHost: box\r\n\r\n", port="http")
    assert b"comrdtrate>%d<" % adopted in answer
