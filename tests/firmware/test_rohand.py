"""ROHand: dots, three-axis points, whole fingers; orders, exceptions, motors."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Restart
from firmware_protocols.protocols.modbus import rtu
from tests.firmware.feeding import sample, send


@pytest.fixture
def device():
    return fp.create("rohand")


def ask(device, pdu: bytes, t_ns=0, unit=2) -> bytes:
    (reply,) = send(device, rtu(unit, pdu), t_ns)
    return reply[1:-2]


def read(device, address, count, t_ns=0) -> list[int]:
    return list(struct.unpack(f">{count}H", ask(device, struct.pack(">BHH", 3, address, count), t_ns)[2:]))


def write(device, address, *values, t_ns=0) -> bytes:
    pdu = struct.pack(f">BHHB{len(values)}H", 16, address, len(values), 2 * len(values), *values)
    return ask(device, pdu, t_ns)


def test_three_axis_points_see_shear():
    device = fp.create("rohand", touch="three_axis")
    sample(device, {"ring": [[1.0], [0.0]]})
    assert device.counts.shape == (1 + 2 + 2 + 2 + 1 + 56, 3)
    forces = np.zeros((64, 3))
    forces[3] = (-3.0, 0.0, -2.0)
    device.measure(fp.Reading({"force": forces}), 0)
    assert device.counts[3].tolist() == [200, 300, 180]
    assert read(device, 2200, 6) == [0xC800, 0x2C01, 0xB400, 0, 0, 0]


def test_zero_is_taken_off_and_forgotten(device):
    sample(device, 1.0)
    assert read(device, 2400, 16) == [0x3232] * 16
    write(device, 1016, 1)
    sample(device, 1.5)
    assert read(device, 2400, 16) == [0x1919] * 16 and read(device, 1016, 1) == [0]
    device.power_cycle()
    sample(device, 1.5)
    assert read(device, 2400, 16) == [0x4B4B] * 16


def test_a_restart_comes_after_the_answer(device):
    write(device, 1135, 65535)
    assert write(device, 1014, 0, t_ns=10**9)[0] == 16
    assert device.wake_ns == 1_100_000_000 and device.wake(device.wake_ns) == [Restart()]


@pytest.mark.parametrize(
    ("pdu", "code", "cause"),
    [("0603ed0000", 4, 3), ("0603f00002", 4, 3), ("0603e80001", 2, 0), ("0607d00001", 2, 0), ("0403e80001", 1, 0)],
)
def test_exceptions_and_their_cause(device, pdu, code, cause):
    request = bytes.fromhex(pdu)
    assert ask(device, request) == bytes([request[0] | 0x80, code])
    assert read(device, 1006, 1) == [cause]


def test_another_value_than_0_waits_for_new_firmware(device):
    assert write(device, 1014, 1)[0] == 16 and device.wake_ns is None
    assert send(device, rtu(2, bytes.fromhex("0303ed0001"))) == [] and device.counters["ignored"] == 1
    device.power_cycle()
    assert read(device, 1005, 1) == [2]


def test_generations_have_maps_of_their_own(device):
    first = fp.create("rohand", touch="finger")
    sample(device, {"index": [[0.0] * 5] * 11 + [[1.5, 0, 0, 0, 1.0]]})
    sample(first, {"index": [[2.5]]})
    assert read(device, 1175, 6) == [*read(first, 1120, 5), 0] == [0, 2500, 0, 0, 0, 0]
    assert write(device, 1120, 9000)[0] == 16 and write(first, 1120, 9000) == b"\x90\x02"
    assert write(first, 1175, 40)[0] == 16 and write(device, 1175, 40) == b"\x90\x02"
    assert ask(first, bytes.fromhex("0304f10001")) == b"\x83\x02"


def test_what_is_set_is_kept(device):
    write(device, 1008, 0, 0)
    write(device, 1045, 123)
    write(device, 1095, 900)
    device.power_cycle()
    assert read(device, 1008, 2) == [0, 0] and read(device, 1045, 2) == [123, 25000]
    assert read(device, 1095, 2) == [1178, 1178]


def test_a_new_unit_is_kept_and_restarts_the_hand(device):
    write(device, 1005, 0x0107, t_ns=10**9)
    assert device.wake(device.wake_ns) == [Restart()] and device.wake_ns == 1_100_000_000
    device.power_cycle()
    assert send(device, rtu(2, bytes.fromhex("0303ed0001"))) == []
    assert ask(device, bytes.fromhex("0303ed0001"), unit=7) == bytes.fromhex("03020007")


def test_positions_and_angles_are_one(device):
    write(device, 1135, 65535, 0, 32768)
    assert read(device, 1085, 3, 100_000_000) == [1, 2, 1] and read(device, 1105, 2, 100_000_000) == [200, 0]
    assert read(device, 1145, 3, 2 * 10**9) == [65535, 0, 32768]
    assert read(device, 1165, 2, 2 * 10**9) == [226, 17837]
    write(device, 1155, 3670, t_ns=2 * 10**9)
    assert read(device, 1085, 1, 2_500_000_000) == [0] and read(device, 1145, 3, 4 * 10**9) == [0, 0, 32768]
    assert device.joints(4 * 10**9)["thumb"] == pytest.approx(np.deg2rad(36.7))
    write(device, 1125, 32768, t_ns=4 * 10**9)
    write(device, 1135, 65535, t_ns=4 * 10**9)
    assert read(device, 1145, 1, 5 * 10**9) == [32768]
