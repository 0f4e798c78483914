"""Tesollo hands: parts, zero, motors, several connections."""

import numpy as np

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

FINGERTIPS = bytes.fromhex("00 04 01 05")


def tips(device) -> list[int]:
    (answer,) = send(device, FINGERTIPS)
    return np.frombuffer(answer[3:], ">i2").tolist()


def test_each_fingertip_measures_what_touches_it():
    device = fp.create("tesollo_dg", hand="DG-3F M")
    sample(device, force=[(0, 0, 0), (0, 0, -2.0), (1.0, 0, 0)])
    # 3 mm beside and 12 mm above the origin
    assert tips(device) == [0] * 6 + [0, 0, -20, -6, 0, 0] + [10, 0, 0, 0, 12, -3]


def test_the_zero_is_that_of_the_force_torque_sensors():
    for sensor, zeroed in (("6-axis", True), ("tactile_m", False)):
        device = fp.create("tesollo_dg", sensor=sensor)
        sample(device, 3.0)
        before = send(device, FINGERTIPS)
        assert send(device, bytes.fromhex("00 03 0B")) == []
        sample(device, 3.0)
        (after,) = send(device, FINGERTIPS)
        assert (after != before[0]) is zeroed and any(after[3:]) is not zeroed


def test_parts_that_are_not_requested_take_no_bytes():
    device = fp.create("tesollo_dg", hand="DG-3F M")
    sample(device)
    sizes = [len(send(device, bytes([0, 3 + len(codes), 1, *codes]))[0]) for codes in ([1], [1, 2], [4, 6], [6, 9])]
    assert sizes == [3 + 12 * 3, 3 + 12 * 5, 3 + 12 * 2 + 4, 3 + 4]


def test_orders_for_another_number_of_motors_are_refused():
    device = fp.create("tesollo_dg", hand="DG-4F")
    assert send(device, bytes([0, 3 + 51, 5]) + bytes(51)) == [] and device.counters["refused"] == 1


def test_half_a_request_ends_with_its_connection():
    device = fp.create("tesollo_dg")
    sample(device)
    assert send(device, b"\0\3") == []
    device.lines(False, False, 0, "")
    assert send(device, bytes.fromhex("00 03 08")) == [bytes.fromhex("00 09 08 5F 22 01 00 01 1F")]
