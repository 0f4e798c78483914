"""IMADA ZT: the form of a line, the zero, two rates."""

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


@pytest.mark.parametrize("capacity, text", [(5, b"-1.250"), (50, b"-01.25"), (500, b"-001.2")])
def test_a_line_has_six_characters_of_force_at_each_capacity(capacity, text):
    device = fp.create("imada_zt", capacity=capacity)
    sample(device, -1.25)
    (line,) = send(device, b"XAR\r")
    assert len(line) == 21 and line[1:7] == text and line[15:16] == b"0"


def test_zero_is_forgotten_at_power_off():
    device = fp.create("imada_zt")
    sample(device, 10.0)
    assert send(device, b"Z\r") == []
    sample(device, 4.0)
    assert send(device, b"XAR\r")[0][1:7] == b"-06.00"
    device.power_cycle()
    sample(device, 4.0)
    assert send(device, b"XAR\r")[0][1:7] == b"+04.00"


def test_lines_come_at_one_of_two_rates_until_they_are_stopped():
    device = fp.create("imada_zt")
    assert sample(device) == [] and send(device, b"XAg\r") == [] and device.period_ns == 100_000_000
    assert len(sample(device)) == 1 and send(device, b"XAG\r") == [] and device.period_ns == 500_000
    assert len(sample(device)) == 1 and send(device, b"XAS\r") == [] and sample(device) == []


def test_other_words_are_counted():
    device = fp.create("imada_zt")
    assert send(device, b"XQT\rxar\r") == [] and device.counters["unknown_command"] == 2
