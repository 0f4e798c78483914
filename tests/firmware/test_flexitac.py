"""FlexiTac and 3D-ViTac: frame, order, ADC."""

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.check.readings import reading_of
from tests.firmware.feeding import sample, send


def test_frame_is_marker_and_row_major_bytes():
    picture = np.zeros((12, 32))
    picture[3, 7] = 1.0
    (frame,) = sample(fp.create("flexitac"), {"matrix": picture})
    image = np.frombuffer(frame[2:], np.uint8).reshape(12, 32)
    assert frame[:2] == b"\xaa\x55" and len(frame) == 386
    assert image[3, 7] == int(80 + 943 / 2) >> 2 and set(np.delete(image, 3 * 32 + 7)) == {20}


def test_adc_is_monotonic_and_saturates():
    device = fp.create("flexitac")
    forces = (-1.0, 0.0, 0.1, 0.5, 1.7, 10.0, 1e9)
    curve = [int(device.measure(reading_of(device, force), 0)[0]) for force in forces]
    assert curve[0] == 20 and curve[-1] in (254, 255) and curve[4] < 0xAA
    assert np.all(np.diff(curve[1:]) > 0)


def test_other_sizes():
    device = fp.create("flexitac", rows=16)
    assert len(sample(device)[0]) == 514 and "16 x 32" in device.title
    with pytest.raises(ValueError, match="option rows: must be a whole number >= 1"):
        fp.create("flexitac", rows=0)


def test_hears_nothing():
    device = fp.create("flexitac")
    assert send(device, b"\xaa\x55hello") == [] and device.counters["ignored"] == 1


def test_the_forerunner_prints_eight_bits_row_by_row():
    picture = np.zeros((16, 16))
    picture[3, 7] = 1.0
    (text,) = sample(fp.create("vitac_3d"), {"matrix": picture})
    *rows, after, end = text.decode("ascii").split("\r\n")
    assert (len(rows), after, end) == (16, "", "")
    assert all(row.endswith(" ") for row in rows), "the firmware prints a space behind each number"
    image = np.array([[int(number) for number in row[:-1].split(" ")] for row in rows])
    assert image[3, 7] == int(80 + 943 / 2) >> 2 and set(np.delete(image, 3 * 16 + 7)) == {20}
