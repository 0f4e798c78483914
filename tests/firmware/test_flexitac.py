"""FlexiTac: frame, order, ADC."""

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import push


def test_frame_is_marker_and_row_major_bytes():
    device = fp.create("flexitac")
    force = np.zeros(384)
    force[32 * 3 + 7] = 1.0
    (frame,) = device.sample(push(device, force), 0)
    image = np.frombuffer(frame[2:], np.uint8).reshape(12, 32)
    assert frame[:2] == b"\xaa\x55" and len(frame) == 386
    assert image[3, 7] == int(80 + 943 / 2) >> 2 and set(np.delete(image, 3 * 32 + 7)) == {20}


def test_adc_is_monotonic_and_saturates():
    device = fp.create("flexitac")
    curve = [int(device.digitize(push(device, force))[0]) for force in (-1.0, 0.0, 0.1, 0.5, 1.7, 10.0, 1e9)]
    assert curve[0] == 20 and curve[-1] in (254, 255) and curve[4] < 0xAA
    assert np.all(np.diff(curve[1:]) > 0)


def test_other_sizes():
    device = fp.create("flexitac", rows=16, cols=16)
    assert len(device.sample(push(device, 0), 0)[0]) == 258
    assert fp.create("flexitac").receive(b"\xaa\x55hello", 0) == ()
    with pytest.raises(ValueError, match="rows=0"):
        fp.create("flexitac", rows=0)
