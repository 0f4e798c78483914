"""The colour scale that the page, the pictures and Rerun share."""

import numpy as np

from tactemu.view.conversions.display import NAN_COLOUR, SCALE, colours


def lightness(srgb: np.ndarray) -> np.ndarray:
    """The lightness L* of CIELAB, 0 to 100, from the luminance."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return 116 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16


def test_larger_readings_are_lighter_by_equal_steps():
    steps = np.diff(lightness(colours(np.linspace(0, 1, 65))))
    assert steps.min() > 0.4 * steps.mean() and steps.max() < 2 * steps.mean()


def test_shares_out_of_range_and_nan():
    shown = colours(np.array([-1.0, 0.0, 1.0, 7.0, np.inf, np.nan]))
    assert np.array_equal(shown, [SCALE[0], SCALE[0], SCALE[-1], SCALE[-1], SCALE[-1], NAN_COLOUR])
    assert np.linalg.norm(colours(np.linspace(0, 1, 65)) - NAN_COLOUR, axis=1).min() > 0.4
