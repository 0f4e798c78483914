"""Robotiq TSF-85 against its tables: packets, fields, autosend."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def make(**options) -> fp.Device:
    device = fp.create("robotiq_tsf85", **options)
    sample(device)
    return device


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


def test_fields():
    device, tips, roots = make(magnetometer=True), np.zeros((7, 4)), np.zeros((7, 4))
    tips[1, 1], roots[6, 3] = 0.25, 1.0
    chips = {"temperature": [31.5, 20.0], "angular_velocity": (0.0, 0.0, np.pi)}
    sample(device, {"finger 0": tips, "finger 1": roots}, 7_000_000, **chips)
    (packet,) = send(device, "9a006100", 8_000_000)
    fields = parse(packet)
    assert packet[2] == 0x61 and len(fields) == 14
    static = [np.array(fields[0x10, finger]) - 1000 for finger in (0, 1)]
    assert np.flatnonzero(static[0]).tolist() == [5] and static[0][5] == 500
    assert np.flatnonzero(static[1]).tolist() == [27] and static[1][27] == 2000
    assert fields[0x20, 0] == (round(500 / 16),) and fields[0x20, 1] == (125,)
    assert fields[0x30, 0] == (0, 0, 16384)
    assert fields[0x40, 1] == (0, 0, 131 * 180)
    assert (fields[0x60, 0], fields[0x60, 1]) == ((3150,), (2000,))
    assert fields[0x70, 0] == fields[0x70, 1] == (7000,)


def test_without_being_asked_there_is_no_magnetometer_and_two_fingers_need_172_bytes():
    (packet,) = send(make(), "9a006100")
    assert packet[3] == 172 and not any(kind == 0x50 for kind, _ in parse(packet))


def test_a_packet_per_finger():
    packets = send(make(packets="per_finger"), "9a006100")
    assert [{finger for _, finger in parse(packet)} for packet in packets] == [{0}, {1}]


@pytest.mark.parametrize("command", [0x58, 0x59])
def test_autosend_has_a_period_and_stops(command):
    device = make()
    assert sample(device) == []
    assert send(device, bytes([0x9A, 0, command, 1, 5])) == []
    assert device.period_ns == 5_000_000
    (packet,) = sample(device, 0.1, 5_000_000)
    assert packet[2] == command
    send(device, bytes([0x9A, 0, command, 1, 0]), 6_000_000)
    assert sample(device, 0.1, 10_000_000) == []


def test_counts_saturate():
    device = make()
    for newtons, counts in ((1e6, 0xFFFF), (-1e6, 0)):
        sample(device, newtons)
        assert set(device.counts.tolist()) == {counts}


@pytest.mark.parametrize("request_", ["9a00e200", "9a00580105 9a00e200"])
def test_bootloader_forgets_autosend(request_):
    device = make()
    send(device, "9a00580105")
    send(device, request_)
    assert sample(device) == [] and device.period_ns == 10_000_000


def test_pads_face_each_other():
    layout = make().layout
    left, right = layout.positions[:28], layout.positions[28:]
    assert np.allclose(left[:, 0], -0.0425) and np.allclose(right[:, 0], 0.0425)
    assert np.allclose(layout.normals[:28], [1, 0, 0]) and np.allclose(layout.normals[28:], [-1, 0, 0])
    assert left[0, 2] > left[-1, 2] and len({tuple(p) for p in layout.positions}) == 56
    assert layout.links == ("left", "right")


def test_static_counts_change_60_times_a_second_and_all_else_in_each_packet():
    device = fp.create("robotiq_tsf85", static_hz=60)
    send(device, "9a 00 58 01 01")
    seen = []
    for ms in range(100):
        (packet,) = sample(device, 1e-3 * ms, t_ns=ms * 1_000_000)
        seen.append((packet[5:61], packet[-8:]))
    assert len({static for static, _ in seen}) == 6 and len({stamp for _, stamp in seen}) == 100
