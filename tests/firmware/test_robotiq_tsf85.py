"""Robotiq TSF-85 against its tables: packets, fields, autosend."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols import Reading
from firmware_protocols.devices.robotiq_tsf85 import RobotiqTsf85
from tests.firmware.feeding import check_commands, frames, push, survive
from tests.firmware.golden import golden_vectors, replay


@pytest.fixture
def device():
    return fp.create("robotiq_tsf85")


def parse(packet: bytes) -> dict[tuple[int, int], tuple]:
    """Fields by (type, finger), straight from the table."""
    start, _, _, length = packet[:4]
    assert start == 0x9A and length == len(packet) - 4
    formats = {0x10: ">28H", 0x20: ">h", 0x30: ">3h", 0x40: ">3h", 0x50: ">3h", 0x60: ">h", 0x70: ">Q"}
    found, at = {}, 4
    while at < len(packet):
        kind, finger = packet[at] & 0xF0, packet[at] >> 2 & 3
        found[kind, finger] = struct.unpack_from(formats[kind], packet, at + 1)
        at += 1 + struct.calcsize(formats[kind])
    assert at == len(packet)
    return found


def test_commands(device):
    check_commands(RobotiqTsf85, trailing=b"\x00\x55")


@pytest.mark.parametrize("vector", golden_vectors("robotiq_tsf85"), ids=lambda v: v["name"])
def test_golden(vector):
    replay(vector, "robotiq_tsf85")


def test_survives_noise(device):
    survive(device)


def test_fields(device):
    force = np.zeros((56, 3))
    force[5] = -0.25 * device.layout.normals[5]
    force[28 + 27] = -1.0 * device.layout.normals[55]
    reading = Reading(t_ns=0, values=force, temperature=31.5, angular_velocity=(0.0, 0.0, np.pi))
    device.sample(reading, 7_000_000)
    (packet,) = device.receive(bytes.fromhex("9a006100"), 8_000_000)
    fields = parse(packet)
    assert packet[2] == 0x61 and len(fields) == 14
    static = [np.array(fields[0x10, finger]) - 1000 for finger in (0, 1)]
    assert np.flatnonzero(static[0]).tolist() == [5] and static[0][5] == 500
    assert np.flatnonzero(static[1]).tolist() == [27] and static[1][27] == 2000
    assert fields[0x20, 0] == (round(500 / 16),) and fields[0x20, 1] == (125,)
    assert fields[0x30, 0] == (0, 0, 16384)
    assert fields[0x40, 1] == (0, 0, 131 * 180)
    assert fields[0x60, 0] == (3150,)
    assert fields[0x70, 0] == fields[0x70, 1] == (7000,)


def test_without_magnetometer_two_fingers_need_172_bytes():
    device = RobotiqTsf85(magnetometer=False)
    (packet,) = device.receive(bytes.fromhex("9a006100"), 0)
    assert packet[3] == 172


def test_a_packet_per_finger():
    device = RobotiqTsf85(packets="per_finger")
    packets = device.receive(bytes.fromhex("9a006100"), 0)
    assert [{finger for _, finger in parse(packet)} for packet in packets] == [{0}, {1}]


@pytest.mark.parametrize("command", [0x58, 0x59])
def test_autosend_has_a_period_and_stops(device, command):
    assert device.sample(push(device, 0), 0) == ()
    assert device.receive(bytes([0x9A, 0, command, 1, 5]), 0) == []
    assert device.period_ns == 5_000_000
    (packet,) = frames(device.sample(push(device, 0.1), 5_000_000))
    assert packet[2] == command
    device.receive(bytes([0x9A, 0, command, 1, 0]), 6_000_000)
    assert device.sample(push(device, 0.1), 10_000_000) == ()


def test_counts_saturate(device):
    assert device.digitize(push(device, 1e6)).max() == 0xFFFF
    assert device.digitize(push(device, -1e6)).min() == 0


def test_power_cycle_forgets_autosend(device):
    device.receive(bytes([0x9A, 0, 0x58, 1, 5]), 0)
    device.power_on(0)
    assert device.sample(push(device, 0), 0) == () and device.period_ns == 10_000_000


def test_pads_face_each_other(device):
    left, right = device.layout.positions[:28], device.layout.positions[28:]
    assert np.allclose(left[:, 0], -0.0425) and np.allclose(right[:, 0], 0.0425)
    assert np.allclose(device.layout.normals[:28], [1, 0, 0]) and np.allclose(device.layout.normals[28:], [-1, 0, 0])
    assert left[0, 2] > left[-1, 2] and len({tuple(p) for p in device.layout.positions}) == 56
