"""Sensing Tex mat: only touched cells are sent."""

import struct

import numpy as np

import firmware_protocols as fp
from tests.firmware.feeding import sample, send


def read(device) -> dict[tuple[int, int], int]:
    """Return the values of the points in an answer, by row and column."""
    (answer,) = send(device, b"R")
    assert answer[:2] == b"N\n" and len(answer) == 6 + 4 * int.from_bytes(answer[2:4], "big")
    return {(y, x): value for x, y, value in struct.iter_unpack(">BBH", answer[6:])}


def test_points_are_sent_row_by_row_with_their_column_first():
    device = fp.create("sensing_tex_mat", counts_per_newton=100.0)
    force = np.zeros((48 * 48, 3))
    force[[3, 48 + 2, 47 * 48 + 47], 2] = -1, -2, -1000
    sample(device, force=force)
    assert read(device) == {(0, 3): 100, (1, 2): 200, (47, 47): 4095}
    assert list(read(device)) == [(0, 3), (1, 2), (47, 47)]


def test_a_light_touch_is_not_sent_and_all_cells_are_in_a_long_answer():
    device = fp.create("sensing_tex_mat", counts_per_newton=100.0)
    sample(device, 0.59)
    assert read(device) == {}
    sample(device, 0.6)
    assert len(read(device)) == 2304 and set(read(device).values()) == {60}


def test_other_bytes_are_counted_and_not_answered():
    device = fp.create("sensing_tex_mat")
    sample(device)
    assert send(device, b"r\n") == [] and device.counters["unknown_command"] == 2
