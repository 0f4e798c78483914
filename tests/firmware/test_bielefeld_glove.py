"""Bielefeld tactile glove: packets."""

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def test_a_scan_is_a_packet_of_each_channel():
    packets = sample(fp.create("bielefeld_glove"))
    assert len(packets) == 64 and {len(packet) for packet in packets} == {5}
    assert packets[0].hex() == "3c010fff00" and packets[17].hex() == "4d011fff00" and packets[63].hex() == "7b01ffff00"


def test_a_push_lowers_what_the_converter_reads():
    device = fp.create("bielefeld_glove", half_force=2.0)
    (packet, *_) = sample(device, 2.0)
    assert packet.hex() == "3c0107ff00" and device.counts[0] == 4095 - 0x7FF
    assert sample(device, 1e9)[0].hex() == "3c01000000"


def test_hears_nothing():
    device = fp.create("bielefeld_glove")
    assert send(device, b"hello") == [] and device.counters["ignored"] == 1
