"""Robotous RFT: what is saved, what waits for the end of the readings, overloads, filter."""

from typing import cast

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

ONCE, START, STOP, COUNTS = 0x0A, 0x0B, 0x0C, 0x12


def ask(device, *data: int) -> list[bytes]:
    """Send a command, and return the data of its answers."""
    frame = bytes([*data, *[0] * (8 - len(data))])
    answers = send(device, b"\x55" + frame + bytes([sum(frame) & 0xFF, 0xAA]))
    for each in answers:
        assert len(each) == 19 and each[:2] == bytes([0x55, data[0]])
        assert each[17] == sum(each[1:17]) & 0xFF and each[18] == 0xAA
    return [each[2:17] for each in answers]


def baud(device) -> int:
    return cast(fp.Serial, device.ports[0]).baud


def done(device, *data: int) -> bool:
    (answer,) = ask(device, *data)
    return {(1, 0): True, (0, 2): False}[answer[0], answer[1]]


def test_settings_are_saved_and_the_baud_rate_is_in_force_from_the_next_power_up():
    device = fp.create("robotous_rft")
    assert done(device, 0x06, 1) and done(device, 0x08, 1, 14) and done(device, 0x0F, 1)
    assert device.period_ns == 100_000_000 and baud(device) == 115200
    assert [ask(device, command)[0][:2] for command in (0x07, 0x09, 0x10)] == [b"\x00\x01", b"\x01\x0e", b"\x01\x00"]
    device.power_cycle()
    assert baud(device) == 921600 and device.period_ns == 100_000_000
    assert [ask(device, command)[0][:2] for command in (0x07, 0x09, 0x10)] == [b"\x01\x01", b"\x01\x0e", b"\x01\x00"]


@pytest.mark.parametrize("parameter, fastest", [(0, 6), (1, 8), (2, 7), (3, 7), (4, 6), (5, 5)])
def test_a_line_has_a_fastest_rate(parameter, fastest):
    device = fp.create("robotous_rft")
    assert done(device, 0x06, parameter)
    device.power_cycle()
    assert [rate for rate in range(10) if done(device, 0x0F, rate)] == list(range(fastest + 1))


def test_values_out_of_range_and_commands_of_can_fail():
    device = fp.create("robotous_rft")
    for data in ((0x06, 6), (0x08, 0, 1), (0x08, 1, 15), (0x08, 2, 0), (0x0F, 9)):
        assert not done(device, *data)
    assert device.counters["refused"] == 5
    assert ask(device, 0x05)[0][:2] == b"\x00\x01" and device.counters["unknown_command"] == 1


def test_while_readings_are_sent_other_commands_wait():
    device = fp.create("robotous_rft")
    sample(device, wrench=[[1, 2, 3, 0.1, 0.2, 0.3]])
    assert ask(device, START) == [] and ask(device, ONCE) == [] and ask(device, 0x01) == []
    assert device.counters["refused"] == 2 and ask(device, 0x10) == [bytes(15)]
    (frame,) = sample(device, wrench=[[1, 2, 3, 0.1, 0.2, 0.3]])
    assert frame[:14].hex() == "550b" + "0032" + "0064" + "0096" + "00c8" + "0190" + "0258"
    ask(device, 0x11, 1)
    assert sample(device, wrench=[[1, 2, 4, 0.1, 0.2, 0.3]])[0][2:14].hex() == "0000" * 2 + "0032" + "0000" * 3
    ask(device, 0x11, 0)
    assert sample(device, wrench=[[1, 2, 4, 0.1, 0.2, 0.3]])[0][2:8].hex() == "0032" + "0064" + "00c8"
    assert ask(device, STOP) == [] and sample(device) == []
    device.power_cycle()
    assert sample(device) == []


def test_an_overload_begins_beyond_120_percent_and_is_counted_once():
    device = fp.create("robotous_rft", model="RFT40-SA01")
    for fz, bits in ((179.9, 0), (180.1, 8), (190.0, 8), (0.0, 0), (-181.0, 8)):
        sample(device, wrench=[[0, 0, fz, 0, 0, 0]])
        assert ask(device, ONCE)[0][12] == bits
    assert ask(device, COUNTS)[0] == bytes([0, 0, 2, *[0] * 12])
    for _ in range(300):
        sample(device, wrench=[[0, 0, 0, 0, 0, 3.1]])
        sample(device)
    assert ask(device, COUNTS)[0][:6] == bytes([0, 0, 2, 0, 0, 255])


def test_the_filter_is_a_low_pass():
    device = fp.create("robotous_rft")
    assert done(device, 0x08, 1, 14)
    sample(device)
    sample(device, t_ns=5_000_000, wrench=[[100.0, 0, 0, 0, 0, 0]])
    assert 0 < int.from_bytes(ask(device, ONCE)[0][:2], "big") < 5000
    assert done(device, 0x08, 0, 0)
    sample(device, t_ns=10_000_000, wrench=[[100.0, 0, 0, 0, 0, 0]])
    assert int.from_bytes(ask(device, ONCE)[0][:2], "big") == 5000
