"""SUN fingertip: frames."""

import struct

import numpy as np

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def test_a_frame_for_each_letter():
    device = fp.create("sun_fingertip", baud=500_000)
    assert device.ports[0].baud == 500_000
    pushes = np.linspace(0, 20, 25)
    assert sample(device, pushes) == []
    frames = send(device, b"ab\naa")
    assert len(frames) == 3 and device.counters == {"requests": 3, "unknown_command": 2}
    expected = [min(4095, round(600 + 400 * push)) for push in pushes]
    assert [list(struct.unpack("<25H", frame)) for frame in frames] == [expected] * 3


def test_counts_end_where_12_bits_do():
    device = fp.create("sun_fingertip")
    for newtons, count in ((1e9, 4095), (-1e9, 0), (0, 600)):
        sample(device, newtons)
        assert set(struct.unpack("<25H", send(device, b"a")[0])) == {count}
