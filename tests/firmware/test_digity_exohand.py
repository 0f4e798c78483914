"""Digity exohand: packets, records, senses."""

import struct

import numpy as np

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

FINGER_2 = bytes.fromhex("01020001020700180001122301204E00000000000000000000D204FF0F00000000")


def test_the_packet_of_the_protocol_page():
    """Touch 0 0 1234 4095 0 0 of the middle finger at 20 ms, sequence 7."""
    device = fp.create("digity_exohand", records=("touch",))
    sample(device, t_ns=20_000_000)
    device.preset("sequence", 6)
    device.counts["force"][12:18] = [0, 0, 1234, 4095, 0, 0]
    assert device.stream(20_000_000, "")[2] == FINGER_2


def test_motion_of_each_board():
    device = fp.create("digity_exohand", records=("imu",))
    acceleration = np.arange(15).reshape(5, 3) - 7.0
    turning = np.radians([[1, -2, 300], [0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 1, 1]])
    packets = sample(device, acceleration=acceleration, angular_velocity=turning)
    values = np.array([struct.unpack("<6h", packet[-12:]) for packet in packets])
    assert np.allclose(values[:, :3], acceleration / 9.80665 * 16384, atol=0.5)
    assert values[:, 3:].tolist() == [[131, -262, 32767], *[[0] * 3] * 3, [131] * 3]


def test_records_are_those_of_the_option():
    (packet, *_) = sample(fp.create("digity_exohand", records=("touch", "angles")))
    assert packet[9:12].hex() == "021203" and packet[9 + 1 + 23] == 0x10 and len(packet) == 9 + 1 + 23 + 23


def test_hears_nothing():
    device = fp.create("digity_exohand")
    assert send(device, b"\x01\x02hello") == [] and device.counters["ignored"] == 1
