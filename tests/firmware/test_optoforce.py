"""OptoForce: packets, configuration, filter, zero, status."""

import itertools
import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def configure(device, speed, cutoff, zero, t_ns=0):
    packet = bytes([0xAA, 0, 0x32, 3, speed, cutoff, zero])
    (answer,) = send(device, packet + struct.pack(">H", sum(packet)), t_ns)
    assert answer[:4].hex() == "aa005001" and struct.unpack(">H", answer[-2:])[0] == sum(answer[:-2])
    return answer[4]


def parse(packet: bytes):
    assert packet[:3].hex() == "aa0708" and packet[3] == len(packet) - 6
    assert struct.unpack(">H", packet[-2:])[0] == sum(packet[:-2])
    counter, status = struct.unpack_from(">HH", packet, 4)
    return counter, status, list(struct.unpack(f">{(packet[3] - 4) // 2}h", packet[8:-2]))


@pytest.mark.parametrize(("axes", "size", "values"), [("3", 16, 3), ("4x3", 34, 12), ("6", 22, 6)])
def test_packets(axes, size, values):
    device = fp.create("optoforce", axes=axes)
    (packet,) = sample(device, 100.0, 0)
    counter, status, got = parse(packet)
    assert len(packet) == size and len(got) == values and counter == 1 and status == 0
    assert got[2] == round(100 * 6049 / 2000)
    assert parse(sample(device, 100.0, 10**7)[0])[0] == 2


def captured() -> list[bytes]:
    """The whole packets of a real 6-axis sensor."""
    text = (Path(__file__).parents[1] / "data" / "captures" / "optoforce_6d.json").read_text()
    found = re.findall(rb"(?s)(?=(\xaa\x07\x08\x10.{18}))", bytes.fromhex(json.loads(text)["hex"]))
    return [packet for packet in found if struct.unpack(">H", packet[-2:])[0] == sum(packet[:-2])]


def test_a_real_sensors_packets_are_sent_byte_by_byte():
    packets = captured()
    assert len(packets) == 8
    device = fp.create("optoforce", axes="6", counter="samples")
    for packet in packets:
        counter, status, values = parse(packet)
        assert status == 0, "no overload"
        sample(device)
        device.preset("counter", counter - 10)
        device.counts = np.array([values])
        assert device.stream(0, "") == [packet]


def test_the_real_counter_is_of_milliseconds():
    counters = [parse(packet)[0] for packet in captured()]
    assert {(b - a) % 10 for a, b in itertools.pairwise(counters)} == {0}
    device = fp.create("optoforce", axes="6", counter="samples")
    assert [parse(sample(device)[0])[0] for _ in range(3)] == [10, 20, 30]
    configure(device, 33, 0, 0)
    assert parse(sample(device)[0])[0] == 63


def test_axes_and_torque():
    _, _, got = parse(sample(fp.create("optoforce", axes="6"), force=(3.0, -4.0, -10.0))[0])
    assert got[:3] == [round(3 * 7925 / 300), round(-4 * 8641 / 300), round(10 * 6049 / 2000)]
    assert got[3:] == [200, 150, 0], "0.05 m above the flange: T = r x F"


def test_speeds():
    device = fp.create("optoforce")
    for speed in (1, 3, 10, 33, 100):
        assert configure(device, speed, 0, 0) == 0
        assert device.period_ns == speed * 1_000_000 and len(sample(device, 0, 0)) == 1
    assert configure(device, 0, 0, 0) == 0 and sample(device) == []
    for bad in ((2, 0, 0), (10, 7, 0), (10, 4, 1)):
        assert configure(device, *bad) == 2


@pytest.mark.parametrize(("setting", "cutoff"), [(1, 500.0), (2, 150.0), (3, 50.0), (4, 15.0), (5, 5.0), (6, 1.5)])
def test_filter_is_a_first_order_low_pass(setting, cutoff):
    device = fp.create("optoforce")
    configure(device, 1, setting, 0)
    sample(device, 0.0, 0)
    sample(device, 2000.0, 1_000_000)
    assert abs(device.counts[0, 2] - 6049 * (1 - np.exp(-2 * np.pi * cutoff * 1e-3))) <= 1


def test_zero_and_no_zero():
    device = fp.create("optoforce")
    configure(device, 10, 0, 0)
    sample(device, 500.0, 0)
    configure(device, 10, 0, 255)
    sample(device, 700.0, 10**7)
    assert device.counts[0, 2] == round(200 * 6049 / 2000)
    configure(device, 10, 0, 0)
    sample(device, 700.0, 2 * 10**7)
    assert device.counts[0, 2] == round(700 * 6049 / 2000)


def test_overload_is_reported_per_axis():
    device = fp.create("optoforce")
    _, status, _ = parse(sample(device, force=(400.0, 0.0, -3000.0))[0])
    assert status == 1 << 9 | 1 << 7


def test_wrong_sum_is_refused_and_changes_nothing():
    device = fp.create("optoforce")
    (answer,) = send(device, "aa0032030104000000")
    assert answer[4] == 1 and device.period_ns == 10_000_000
    assert configure(device, 1, 4, 0) == 0


def test_a_wrong_sum_in_a_serial_number_request_is_silence():
    device = fp.create("optoforce")
    assert send(device, "ab00120800c6") == [] and device.counters["bad_checksum"] == 1


def test_the_counter_rolls_over_and_can_be_preset():
    device = fp.create("optoforce")
    device.preset("counter", 0xFFFE)
    assert [parse(sample(device)[0])[0] for _ in range(3)] == [0xFFFF, 0, 1]


def test_six_axes_feel_one_wrench_at_the_flange():
    device = fp.create("optoforce", axes="6")
    (sense,) = device.sensed
    assert sense.quantity == "wrench" and sense.at.positions.tolist() == [[0, 0, 0]]
    (packet,) = sample(device, wrench=[[1.0, 2.0, -100.0, 0.5, -0.25, 40.0]])
    assert device.counts.tolist() == [[26, 58, 302, 500, -250, 32767]] and packet[6:8] == bytes([0, 1 << 4])


def test_on_can_a_configuration_comes_in_two_frames():
    device = fp.create("optoforce_can")
    for text in ("101#AA00320300040000", "101#E2", "101#E3", "100#E3"):
        assert send(device, text) == []
    assert device.counters == {"bad_checksum": 1, "skipped_bytes": 9, "ignored": 1} and device.streaming
    assert send(device, "101#AA00320300040000") + send(device, "101#E3") == [] and sample(device) == []
