import copy

import numpy as np
import pytest

from firmware_protocols import LowPass, int16, quantize
from tests.kit.saving import restored, saved


def test_counts_are_rounded_saturated_and_never_wrap():
    counts = quantize([-1e9, -0.26, 0.24, 0.26, 1e9], 2.0, 0, 255, rest=10)
    assert counts.tolist() == [0, 9, 10, 11, 255]
    assert counts.dtype == np.int64


def test_scale_and_rest_may_differ_by_channel():
    counts = quantize(np.ones((4, 3)), [10, 20, 30], -100, 100, rest=[0, 1, 2])
    assert counts.tolist() == [[10, 21, 32]] * 4


def test_int16_saturates_in_both_byte_orders():
    assert int16([1.6, -40_000, 40_000]) == bytes.fromhex("0002 8000 7FFF")
    assert int16(258) == b"\x01\x02" and int16(258, "<") == b"\x02\x01"


@pytest.mark.parametrize("steps", [1, 3, 100])
def test_a_low_pass_is_exact_for_steps_of_any_length(steps):
    filtered = LowPass(15.0)
    filtered([0.0, 2.0], 0)
    for k in range(1, steps + 1):
        value = filtered([1.0, 1.0], 10_000_000 * k // steps)
    left = np.exp(-2 * np.pi * 15.0 * 0.01)
    assert value == pytest.approx([1 - left, 1 + left], abs=1e-12)


def test_a_low_pass_without_cutoff_passes_everything():
    filtered = LowPass()
    filtered([5.0], 0)
    assert filtered([7.0], 1).tolist() == [7.0]


def test_a_low_pass_goes_on_from_a_copy_and_from_a_file():
    filtered = LowPass(5.0)
    filtered(np.array([1.0, 2.0]), 0)
    others = [copy.deepcopy(filtered), restored(saved(filtered))]
    expected = filtered(np.array([3.0, 3.0]), 5_000_000)
    for other in others:
        assert other(np.array([3.0, 3.0]), 5_000_000).tolist() == expected.tolist()
