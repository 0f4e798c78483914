"""AnySkin: the frame as the driver's format string reads it, the ADC, the chips' axes."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from firmware_protocols.devices.anyskin import GAIN_UT_PER_N
from firmware_protocols.magnetic import LinearMagnet

NO_OFFSET = LinearMagnet(gain=GAIN_UT_PER_N)


def sampled(force, **reading) -> tuple[fp.Device, bytes]:
    device = fp.create("anyskin", transducer=NO_OFFSET)
    (frame,) = device.sample(fp.Reading(t_ns=0, values=np.broadcast_to(force, (5, 3)), **reading), 0)
    return device, frame


def test_frame_is_twenty_floats_and_crlf():
    device, frame = sampled((0.1, 0.2, -0.5), temperature=np.array([20.0, 22.0, 24.0, 26.0, 28.0]))
    *values, cr, lf = struct.unpack("<20fcc", frame)
    assert (cr, lf, len(frame)) == (b"\r", b"\n", 82)
    assert values == device.counts.reshape(-1).tolist()
    assert np.allclose(values[::4], [20, 22, 24, 26, 28], atol=0.5 / 45.2)
    assert np.allclose(values[3::4], 45.0, atol=0.242 / 2)


@pytest.mark.parametrize("force", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_the_viewer_draws_arrows_along_the_force(force):
    """The vendor's viewer turns each chip's x, y by these angles onto the screen, whose y points down."""
    device, _ = sampled((*force, 0.0))
    for chip, degrees in enumerate((-90, -90, 180, 90, 0)):
        turn = np.radians(degrees)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        drawn = rotation @ device.counts[chip, 1:3]
        assert np.allclose(drawn, (60 * force[0], -60 * force[1]), atol=0.15)


def test_adc_steps_and_saturates():
    device, _ = sampled((0.0, 0.0, 0.001))
    assert device.counts[:, 3].tolist() == [0.0] * 5, "0.09 uT is less than half a count of 0.242 uT"
    device, _ = sampled((0.0, 0.0, -1e4))
    assert np.allclose(device.counts[:, 3], 32767 * 0.242)


def test_nothing_is_ever_answered():
    device = fp.create("anyskin")
    assert not device.commands and not device.receive(b"hello\r\n", 0)
    assert device.counters["ignored"] == 1
