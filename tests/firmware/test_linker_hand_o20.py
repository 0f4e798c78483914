"""LinkerHand O20: registers, what is kept, goals within the joints' stops, what is not for this hand."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

PAD = "00" * 14


def ident(register: int, write: int = 0, hand: int = 1) -> str:
    return f"{hand << 21 | register << 13 | write << 12:08X}##1"


def asked(device, register: int, t_ns: int = 0) -> bytes:
    (answer,) = send(device, ident(register), t_ns)
    assert answer.arbitration_id == 1 << 21 | register << 13 and answer.is_fd
    return answer.data


def test_a_finger_comes_in_two_frames_and_can_be_asked_for():
    device = fp.create("linker_hand_o20")
    frames = sample(device, np.arange(360) / 1000)
    assert [len(frame.data) for frame in frames] == [64, 12] * 5
    counts = b"".join(a.data + b.data[:9] for a, b in zip(frames[::2], frames[1::2]))
    assert list(counts[1:73]) == device.counts[:72].tolist() and counts[73] == 1
    assert asked(device, 0x0B) == frames[2].data and asked(device, 0x0C)[:9] == frames[3].data[:9]


def test_goals_end_at_the_stops_of_the_joints():
    device = fp.create("linker_hand_o20")
    assert send(device, ident(6, 1) + "E803" * 17 + PAD) == []
    there = np.frombuffer(asked(device, 3, t_ns=10_000_000_000)[:34], "<i2")
    assert there.tolist() == [120, 150, 180, 130, 30, 180, 180, 30, 180, 180, 20, 180, 180, 20, 180, 180, 1000]


def test_offsets_and_information_are_kept_without_power():
    device = fp.create("linker_hand_o20", serial_number="LHO20-7")
    assert asked(device, 0)[10:17] == b"LHO20-7" and asked(device, 0)[50] == 1
    send(device, ident(0x16, 1) + "0100" * 17 + PAD)
    send(device, ident(0x6E, 1) + "41" * 64)
    send(device, ident(0x20, 1) + "0100" * 17 + PAD)
    device.power_cycle()
    assert asked(device, 0x16)[:2] == b"\1\0" and asked(device, 0x6E) == b"A" * 63 + b"\0"
    assert asked(device, 0x20)[:2] == b"\xdc\0"


@pytest.mark.parametrize(
    ("frame", "counter"),
    [
        (ident(3, hand=2), "other_address"),
        (ident(0x30), "unknown_command"),
        (ident(3) + "00", "bad_length"),
        (ident(3, 1) + "00" * 48, "refused"),
        (ident(8, 1) + "E903" * 17 + PAD, "refused"),
        (ident(8, 1) + "00" * 8, "refused"),
    ],
)
def test_what_is_not_answered(frame, counter):
    device = fp.create("linker_hand_o20")
    assert send(device, frame) == [] and device.counters[counter] == 1
