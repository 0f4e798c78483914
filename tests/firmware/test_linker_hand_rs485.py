"""LinkerHand L10 on RS-485: one finger at a time in the registers."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


@pytest.fixture
def device():
    return fp.create("linker_hand_l10_rs485")


def ask(device, pdu: bytes, unit=0x28) -> bytes:
    (reply,) = send(device, rtu(unit, pdu))
    return reply[1:-2]


def inputs(device, address, count) -> list[int]:
    return list(struct.unpack(f">{count}H", ask(device, struct.pack(">BHH", 4, address, count))[2:]))


def select(device, finger):
    return ask(device, struct.pack(">BHH", 6, 70, finger))


def test_each_finger_is_shown_after_it_is_selected(device):
    sample(device, np.linspace(0.0, 0.5, 360))
    assert inputs(device, 72, 86) == [0] * 86
    for k, patch in enumerate(device.layout.patches, 1):
        select(device, k)
        assert inputs(device, 82, 72) == device.counts[patch.taxels].tolist()
    assert inputs(device, 153, 1) == [250]


def test_a_finger_that_there_is_not_is_refused_and_changes_nothing(device):
    select(device, 2)
    assert select(device, 6) == b"\x86\x03"
    assert inputs(device, 70, 1) == [2] and device.counters["refused"] == 1


def test_joints_answer_what_was_set_and_forget_it_at_power_off(device):
    assert ask(device, struct.pack(">BHHB3H", 16, 9, 3, 6, 1, 2, 3)) == bytes.fromhex("1000090003")
    assert inputs(device, 8, 5) == [128, 1, 2, 3, 255]
    device.power_cycle()
    assert inputs(device, 8, 5) == [128, 128, 255, 255, 255]


def test_left_and_right_have_units_of_their_own(device):
    assert send(device, rtu(0x27, bytes.fromhex("0400480060"))) == []
    right = fp.create("linker_hand_l10_rs485", side="right")
    assert chr(struct.unpack(">H", ask(right, bytes.fromhex("0400a10001"), unit=0x27)[2:])[0]) == "R"
