"""Nibotics NI-PRVS01: channels, twelve bits, orders."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.adc import pack_12_bits
from firmware_protocols.check.readings import reading_of
from firmware_protocols.devices.nibotics_prvs01 import MESSAGE
from tests.firmware.feeding import sample, send


def order(positions, speeds) -> bytes:
    return MESSAGE.pack(kind=3, data=struct.pack("<7H7B", *positions, *speeds))


def test_channels_that_are_not_in_use_are_zero():
    hand = fp.create("nibotics_prvs01", counts_per_pascal=0.5)
    hand.measure(reading_of(hand, pressure=np.arange(1.0, 20.0), temperature=np.arange(19.0)), 0)
    data = hand.stream(0, "")[0]
    pressures, temperatures = np.split(np.frombuffer(data[7 : 7 + 192], "<f4"), 2)
    assert np.flatnonzero(pressures == 0).tolist() == [3, 7, 11, 15, 19]
    assert pressures[20:].tolist() == [8.0, 8.5, 9.0, 9.5] and temperatures[23] == 18.0


@pytest.mark.parametrize("n", [1, 2, 7, 8])
def test_twelve_bits(n):
    values = np.arange(n) * 511 + 3
    stream = int.from_bytes(pack_12_bits(values), "little")
    assert [stream >> 12 * k & 0xFFF for k in range(n)] == values.tolist()
    assert len(pack_12_bits(values)) == (12 * n + 7) // 8


def test_orders_are_obeyed_at_their_speed():
    hand = fp.create("nibotics_prvs01")
    assert send(hand, order([4095, 0, 0, 0, 0, 0, 9999], [50, 0, 0, 0, 0, 0, 200])) == []
    assert hand.motors.positions(1_000_000_000).tolist() == pytest.approx([2050, 0, 0, 0, 0, 0, 4095])
    assert hand.joints(3_000_000_000)["pinky"] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("spoiled", [2, 4, 6, 10])
def test_a_message_with_a_bad_check_is_dropped_and_the_next_one_is_not(spoiled):
    hand = fp.create("nibotics_prvs01")
    good = order([100] * 7, [100] * 7)
    bad = bytearray(good)
    bad[spoiled] ^= 0x40
    assert send(hand, bytes(bad) + good) == [] and hand.counters["requests"] == 1
    assert hand.motors.goals.tolist() == [100] * 7


def test_speeds_go_to_250_and_pressures_are_hectopascals():
    hand = fp.create("nibotics_prvs01")
    send(hand, order([4095] * 7, [250, 255, 125, 0, 0, 0, 0]))
    assert hand.motors.positions(200_000_000)[:3].tolist() == pytest.approx([2050, 2050, 1025])
    counts = hand.measure(reading_of(hand, pressure=np.full(19, 12345.0), temperature=25.0), 0)
    assert counts.tolist() == pytest.approx([123.45] * 19)


def test_messages_of_other_kinds_are_counted():
    hand = fp.create("nibotics_prvs01")
    send(hand, MESSAGE.pack(kind=9, data=b"") + MESSAGE.pack(kind=3, data=bytes(20)))
    assert hand.counters["unknown_command"] == hand.counters["bad_length"] == 1 and len(sample(hand)) == 2
