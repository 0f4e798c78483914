"""LinkerHand O30: errors, what is kept, joints that are enabled, matrices of one time."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def asked(device, header: str, data: str = "", t_ns: int = 0, hand: int = 1) -> bytes:
    (answer,) = send(device, f"{hand:03X}##1{header}{data}", t_ns)
    assert answer.arbitration_id == 0x400 | hand and answer.is_fd
    return answer.data


@pytest.mark.parametrize(
    ("header", "data", "error"),
    [
        ("600001", "", 0x01),
        ("0D0001", "01", 0x04),
        ("010040", "", 0x08),
        ("312D01", "06", 0x40),
        ("010005", "01", 0x08),
    ],
)
def test_errors(header, data, error):
    device = fp.create("linker_hand_o30")
    assert asked(device, header, data) == bytes([0x4F, 0, 1, error]) and device.counters["refused"] == 1


def test_a_matrix_is_of_the_time_of_its_first_part():
    device = fp.create("linker_hand_o30")
    sample(device, np.arange(360) / 2000)
    asked(device, "312D01", "02")
    first = asked(device, "32003D")[3:]
    sample(device, 0.0)
    assert list(first + asked(device, "323D0B")[3:14]) == [round(taxel / 4) for taxel in range(72, 144)]
    assert set(asked(device, "323D0B")[3:14]) == {0}, "a new one"


def test_joints_move_when_they_are_there_and_enabled():
    device = fp.create("linker_hand_o30")
    asked(device, "010019", "FF" * 25)
    assert asked(device, "010019", t_ns=2_000_000_000)[3:28] == bytes(25)
    asked(device, "0C0019", "0F" * 25)
    asked(device, "010019", "FF" * 25, t_ns=2_000_000_000)
    there = asked(device, "010019", t_ns=4_000_000_000)[3:28]
    assert [k for k in range(25) if there[k] == 0] == [1, 2, 3, 4, 15] and max(there) == 0xFF


def test_an_id_is_kept_if_saved_and_holds_from_then_on():
    device = fp.create("linker_hand_o30")
    asked(device, "350002", "0700")
    device.power_cycle()
    asked(device, "350002", "0700")
    asked(device, "351E01", "01")
    device.power_cycle()
    assert send(device, "001##1010001") == [] and device.counters["other_address"] == 1
    assert asked(device, "350002", hand=7)[3:5] == b"\7\0"
