"""eFlesh's binary board: the page's frame, the converter's steps, what goes wrong."""

import struct

import numpy as np

import firmware_protocols as fp
from firmware_protocols import Restart
from tests.firmware.feeding import sample, send

REST = bytes.fromhex(
    "AA5505000000000000000000C0F345000000000000000000C0C14500000000000000000080BB450000000000000000004067C5"
    "000000000000000000808945E7"
)


def field(force, **options):
    """Bx, By, Bz of the five sensors [uT]."""
    (frame,) = sample(fp.create("eflesh_binary", **options), force=force)
    return np.reshape(struct.unpack("<15f", frame[3:63]), (5, 3))


def test_the_frame_at_rest_of_the_documentation():
    device = fp.create("eflesh_binary")
    device.preset("sequence", 5)
    device.counts = np.array([(0, 0, z) for z in (7800, 6200, 6000, -3700, 4400)], np.float32)
    assert device.stream(0, "") == [REST] and device.sequence == 6


def test_steps_and_full_scale():
    rest = field((0.0, 0.0, 0.0))
    assert np.allclose(rest[:, 2], (7800, 6200, 6000, -3700, 4400), atol=1.936 / 2) and not rest[:, :2].any()
    assert np.allclose(field((0.01, 0.0, -0.01))[0], (5 - 5 % 1.2, 0, 7810), atol=1.936 / 2)
    assert np.allclose(field((1e6, 0.0, -1e6))[0], (39_320, 0, 63_437), atol=1)
    assert field((0.0, 0.0, -1.0))[3, 2] < -4000, "the magnet that is built in upside down"


def test_with_res_16_a_press_wraps_around():
    before, after = (field((0.0, 0.0, -push), resolution=16)[0, 2] for push in (0.1, 0.2))
    assert np.isclose(after - before, 100 - 15_860, atol=1)


def test_a_sensor_that_does_not_answer_sends_zeros():
    (frame,) = sample(fp.create("eflesh_binary", missing=(2, 4)), force=(1.0, 1.0, -1.0))
    for sensor in range(5):
        assert (frame[3 + 12 * sensor :][:12] == bytes(12)) == (sensor in (1, 3))


def test_an_oversampling_that_is_too_slow_gives_two_zero_frames_of_three():
    device = fp.create("eflesh_binary", zero_frames=True)
    frames = [sample(device)[0] for _ in range(6)]
    assert [not any(frame[3:63]) for frame in frames] == [False, True, True] * 2
    assert [frame[2] for frame in frames] == list(range(6))


def test_opening_the_port_restarts_the_board():
    device = fp.create("eflesh_binary")
    assert device.lines(True, True, 0, "") == [Restart()] and not device.lines(False, False, 0, "")
    assert send(device, b"hello") == [] and device.counters["ignored"] == 1
