"""WiReSens: packets, and the one that its receiver loses."""

import struct

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def test_a_scan_in_packets():
    device = fp.create("wiresens", sensor=3)
    packets = sample(device, 1.0)
    assert [len(packet) for packet in packets] == [1 + 2 + 128 + 4 + 2] * 4
    assert [struct.unpack("<bHH", packet[:5]) for packet in packets] == [(3, 64 * k, 1552) for k in range(4)]
    assert [packet[-6:].hex() for packet in sample(device)] == [f"{k:02x}0000007772" for k in range(4, 8)]


def test_packet_29303_looks_like_two_to_the_receiver():
    device = fp.create("wiresens")
    device.preset("number", 29302)
    assert [packet.count(b"wr") for packet in sample(device)] == [1, 2, 1, 1]


def test_numbers_begin_anew():
    device = fp.create("wiresens", rows=2, cols=2, values=4)
    device.preset("number", 0xFFFFFFFF)
    assert [sample(device)[0][-6:-2].hex() for _ in range(2)] == ["ffffffff", "00000000"]


def test_a_packet_is_full_before_it_is_sent():
    device = fp.create("wiresens", rows=3, cols=5, values=8)
    packets = [packet for push in (0.0, 1.0) for packet in sample(device, push)]
    assert [struct.unpack("<bH", packet[:3]) for packet in packets] == [(1, 0), (1, 8), (1, 1)]
    assert struct.unpack("<8H", packets[1][3:19]) == (3103,) * 7 + (1552,)
    assert [len(sample(device)) for _ in range(6)] == [2] * 6


def test_it_takes_its_configuration_from_the_line_or_after_a_second():
    device = fp.create("wiresens", saved=False)
    assert device.boot(0)[0].endswith(b"Waiting for serial input...\r\n") and sample(device) == []
    told = b'{"id": 3, "protocol": "serial", "numNodes": 120, "startCoord": [0, 0], "endCoord": [15, 15]}'
    assert send(device, told[:20]) == [] and send(device, told[20:], 5) == [] and device.wake_ns == 1_000_000_005
    assert b"saved" in device.wake(device.wake_ns)[0]
    assert [packet[0] for packet in sample(device)] == [3, 3] and len(sample(device)) == 2
    assert send(device, told) == [] and device.counters["ignored"] == 1
    device.power_cycle()
    assert len(send(device, told + b"\n")) == 1 and len(sample(device)) == 2


def test_what_it_does_not_take():
    device = fp.create("wiresens", saved=False)
    for told in (b"hello\n", b"[" * 4000 + b"\n", b'{"id": 1}\n', b'{"id": 1e999, "numNodes": 3}\n'):
        assert b"failed" in send(device, told)[0]
    told = b'{"id": 1, "numNodes": 120, "startCoord": [0, 0], "endCoord": [0, 3]}\n'
    assert send(device, told) == [] and device.counters["refused"] == 1 and device.counters["bad_request"] == 4
    assert sample(device) == []


def test_hears_nothing_once_it_runs():
    device = fp.create("wiresens")
    assert send(device, b"hello") == [] and device.counters["ignored"] == 1
