"""LinkerHand L30: what is refused and with which state, what is kept, values that come unasked."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import send


def request(command: int, part: int, write: int, data: str = "", hand: int = 1) -> str:
    size = len(bytes.fromhex(data))
    return f"{write << 25 | command << 21 | part << 13 | hand << 8:08X}##1{size:02X}00{data}"


def asked(device, *args, t_ns: int = 0) -> tuple[int, bytes]:
    """Return state and data of the answer."""
    (answer,) = send(device, request(*args), t_ns)
    size, transaction, state = answer.data[:3]
    assert transaction == 0 and answer.arbitration_id & 0x1FF8 == 1 << 3
    return state, answer.data[3 : 3 + size]


def test_the_configuration_is_locked_until_the_password():
    device = fp.create("linker_hand_l30")
    assert asked(device, 3, 6, 1, "01")[0] == 0x20
    assert asked(device, 3, 1, 1, "00" * 6)[0] == 0x20 and asked(device, 3, 1, 1, "123456789ABC")[0] == 0
    assert asked(device, 3, 6, 1, "01")[0] == 0 and asked(device, 3, 6, 0) == (0, b"\1")
    assert asked(device, 3, 5, 1)[0] == 0x23 and asked(device, 1, 8, 1)[0] == 0 and asked(device, 3, 5, 1)[0] == 0
    device.power_cycle()
    assert asked(device, 3, 6, 0) == (0, b"\1") and asked(device, 3, 3, 0)[1] == b"LHT30-06-169-R-B-1-A"


def test_another_id_holds_at_once():
    device = fp.create("linker_hand_l30")
    asked(device, 3, 1, 1, "123456789ABC")
    (answer,) = send(device, request(3, 4, 1, "07"))
    assert answer.data[2] == 0 and answer.arbitration_id >> 3 & 0x1F == 1
    assert send(device, request(3, 4, 0)) == [] and device.counters["other_address"] == 1
    (answer,) = send(device, request(3, 4, 0, hand=7))
    assert answer.data[3] == 7 and answer.arbitration_id >> 3 & 0x1F == 7


def test_a_disabled_joint_stays():
    device = fp.create("linker_hand_l30")
    assert asked(device, 6, 0x21, 1, "0064")[0] == 0
    assert asked(device, 1, 8, 1)[0] == 0 and asked(device, 6, 0x21, 1, "0000")[0] == 0x22
    send(device, request(1, 1, 1, "0000" * 17))
    positions = np.frombuffer(asked(device, 5, 1, 0, t_ns=5_000_000_000)[1], ">i2")
    assert positions.tolist() == [100] + [0] * 16


@pytest.mark.parametrize(
    ("args", "state"),
    [
        ((7, 1, 0), 0x12),
        ((5, 9, 0), 0x13),
        ((6, 0x21, 1, "00"), 0x11),
        ((4, 1, 1, "010000000A00000000"), 0x35),
    ],
)
def test_states_of_what_is_refused(args, state):
    assert asked(fp.create("linker_hand_l30"), *args)[0] == state


def test_values_come_unasked_from_the_joints_in_the_mask():
    device = fp.create("linker_hand_l30")
    assert asked(device, 4, 4, 1, "010000001400000003")[0] == 0
    assert device.wake_ns == 20_000_000
    (frame,) = device.wake(20_000_000)
    assert frame.data[:4] == b"\2\0\x19\x19" and device.wake_ns == 40_000_000
    assert asked(device, 4, 4, 1, "00" * 9)[0] == 0 and device.wake_ns is None
