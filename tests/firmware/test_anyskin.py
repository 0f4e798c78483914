"""AnySkin: the frame as the driver's format string reads it, the ADC, the chips' axes."""

import struct

import numpy as np
import pytest

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def change(force, **options) -> np.ndarray:
    """What a force on every taxel changes at each chip, Bx, By, Bz [uT]."""
    device = fp.create("anyskin", **options)
    sample(device)
    rest = device.counts
    sample(device, force=force)
    return (device.counts - rest)[:, 1:]


def test_frame_is_twenty_floats_and_crlf():
    device = fp.create("anyskin")
    (frame,) = sample(device, 0.5, temperature=[20.0, 22.0, 24.0, 26.0, 28.0])
    *values, cr, lf = struct.unpack("<20fcc", frame)
    assert (cr, lf, len(frame)) == (b"\r", b"\n", 82)
    assert values == device.counts.reshape(-1).tolist()
    assert np.allclose(values[::4], [20, 22, 24, 26, 28], atol=0.5 / 45.2)


@pytest.mark.parametrize("force", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_the_viewer_draws_arrows_along_the_force(force):
    """The vendor's viewer turns each chip's x, y by these angles onto the screen, whose y points down."""
    changes = change((*force, 0.0))
    for chip, degrees in enumerate((-90, -90, 180, 90, 0)):
        turn = np.radians(degrees)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        assert np.allclose(rotation @ changes[chip, :2], (60 * force[0], -60 * force[1]), atol=0.15)


def test_adc_steps_and_saturates():
    assert np.allclose(change((0.0, 0.0, -0.5))[:, 2], 45.0, atol=0.484), "a push raises Bz"
    assert not change((0.0, 0.0, 0.0001)).any(), "0.009 uT is less than half a count of 0.484 uT"
    device = fp.create("anyskin")
    sample(device, 1e4)
    assert np.allclose(device.counts[:, 3], 32767 * 0.484)


def test_gains_are_options():
    assert np.allclose(change((0.0, 0.0, -1.0), gains=(0.0, 0.0, 10.0))[:, 2], -10.0, atol=0.484)


def test_nothing_is_ever_answered():
    device = fp.create("anyskin")
    assert not device.commands and not send(device, b"hello\r\n")
    assert device.counters["ignored"] == 1


def test_the_gain_that_the_library_sets():
    device = fp.create("anyskin", step_scale=4 / 3)
    sample(device, 1e4)
    assert np.allclose(device.counts[:, 3], 32767 * 0.242 * 4 / 3) and np.isclose(device.columns[1].high, 32767 * 0.2)
