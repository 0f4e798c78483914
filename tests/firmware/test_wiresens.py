"""WiReSens: packets, and the one that its receiver loses."""

import struct

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def test_a_scan_in_packets():
    device = fp.create("wiresens", sensor=3)
    packets = sample(device, 1.0)
    assert [len(packet) for packet in packets] == [1 + 2 + 128 + 4 + 2] * 4
    assert [struct.unpack("<bHH", packet[:5]) for packet in packets] == [(3, 64 * k, 2048) for k in range(4)]
    assert [packet[-6:].hex() for packet in sample(device)] == [f"{k:02x}0000007772" for k in range(4, 8)]


def test_packet_29303_looks_like_two_to_the_receiver():
    device = fp.create("wiresens")
    device.preset("number", 29302)
    assert [packet.count(b"wr") for packet in sample(device)] == [1, 2, 1, 1]


def test_numbers_begin_anew():
    device = fp.create("wiresens", rows=2, cols=2, values=4)
    device.preset("number", 0xFFFFFFFF)
    assert [sample(device)[0][-6:-2].hex() for _ in range(2)] == ["ffffffff", "00000000"]


def test_hears_nothing():
    device = fp.create("wiresens")
    assert send(device, b"hello") == [] and device.counters["ignored"] == 1
