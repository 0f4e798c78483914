"""GSV-8: the zero, the user scale and the rate of each channel, refusals."""

import struct

import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send

VALUES = "AA 90 3B 85"


def values(device, *newtons: float) -> list[float]:
    """Return the values that it sends under pushes on the first channels."""
    send(device, "AA 90 23 85")
    sample(device, force=[[0.0, 0.0, -push] for push in [*newtons, *[0.0] * (8 - len(newtons))]])
    (frame,) = send(device, VALUES)
    return list(struct.unpack(">8f", frame[3:35]))[: len(newtons)]


def test_a_zero_of_one_channel_and_of_all():
    device = fp.create("me_gsv8")
    assert values(device, 10, 20) == [10, 20]
    assert send(device, "AA 91 0C 02 85") == [b"\xaa\x50\x00\x85"] and values(device, 10, 20) == [10, 0]
    send(device, "AA 91 0C 00 85")
    assert values(device, 15, 15) == [5, -5]
    device.power_cycle()
    assert values(device, 15, 15) == [15, 15]


def test_a_user_scale_of_all_channels_is_the_value_at_full_input():
    device = fp.create("me_gsv8", rated_load=1000.0, sensitivity=2.0)
    assert values(device, 500, -250) == [500, -250]
    send(device, "AA 95 15 00 3F 80 00 00 85")
    assert values(device, 500, -250, 5000) == [0.5, -0.25, 1.0]
    assert send(device, "AA 91 14 08 85") == [bytes.fromhex("AA54003F80000085")]


def test_readings_follow_each_conversion_between_start_and_stop():
    device = fp.create("me_gsv8")
    assert len(sample(device)) == 1 and send(device, "AA 90 23 85") == [b"\xaa\x50\x00\x85"] and sample(device) == []
    send(device, "AA 90 24 85")
    assert len(sample(device)) == 1


@pytest.mark.parametrize("request_, error", [("AA 94 8B 7F C0 00 00 85", 0x52), ("AA 95 15 09 3F 80 00 00 85", 0x51)])
def test_refusals(request_, error):
    device = fp.create("me_gsv8")
    assert send(device, request_) == [bytes([0xAA, 0x50, error, 0x85])] and device.counters["refused"] == 1
