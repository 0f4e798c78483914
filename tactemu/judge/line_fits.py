"""Robust line fits, checks of curves, ranks, and channels that are equal."""

from __future__ import annotations

import numpy as np

FILTERED = 3e-3
"""Largest remaining distance of a filter from its final value when a sample was held, as a share of the span."""
Line = tuple[float, float, float, float]
"""Gain, offset, tolerance and explained share of a line."""
_MIN_LEVELS = 5
"""A column with fewer distinct values is not taken for a rounded one."""
_SMOOTHED_ROWS = 5
"""Number of rows of the moving median by which a curve is checked for monotony."""
_MAX_FALL_BACK = 0.05
"""Largest fall-back that noise may cause, as a share of the span."""


def line(x: np.ndarray, y: np.ndarray, random: np.random.Generator, tries: int = 60, steps: bool = False) -> Line:
    """Return gain, offset, tolerance and explained share of the rows for the line with the most rows; zeros for none.

    With integer counts the tolerance is less than half a count, unless the driver prints fewer digits than that or
    filters (``steps``): then it is the remaining error of the filter.
    """
    spread = float(np.ptp(y)) if len(y) else 0.0
    if not spread or not np.isfinite(spread) or not np.ptp(x):
        return 0.0, 0.0, 0.0, 0.0
    count = 1.0 if np.array_equal(x, np.rint(x)) else 0.0
    printed = _resolution(y)
    i, k = random.integers(len(x), size=(2, tries))
    apart = np.abs(x[i] - x[k]) > 0.1 * np.ptp(x)
    i, k = i[apart], k[apart]
    if not len(i):
        return 0.0, 0.0, 0.0, 0.0
    gains = (y[i] - y[k]) / (x[i] - x[k])
    near = np.maximum((FILTERED if steps else 1e-5) * spread, 1.05 * np.abs(gains) * count + 1.1 * printed)
    inside = np.abs(y - y[i, None] - gains[:, None] * (x - x[i, None])) <= near[:, None]
    best = int(np.argmax(inside.sum(axis=1)))
    if inside[best].mean() < 0.2 or not gains[best]:
        return 0.0, 0.0, 0.0, 0.0
    gain, offset = np.polyfit(x[inside[best]], y[inside[best]], 1)
    off = np.abs(y - gain * x - offset)
    residuals = off[inside[best]]
    least = max(1e-6 * spread, 1e-12)
    if steps:
        tolerance = max(3 * float(np.quantile(residuals, 0.99)), 0.55 * printed, 0.45 * abs(gain) * count, least)
    elif (
        printed > 1.5 * abs(gain) * count
    ):  # the driver rounds more coarsely than the device, which limits the precision of the line
        tolerance = max(0.8 * printed, least)
    elif count:
        tolerance = max(0.45 * abs(gain), least)
    else:
        tolerance = max(3 * float(np.quantile(residuals, 0.99)), 0.55 * printed, least)
    return float(gain), float(offset), float(tolerance), float((off <= tolerance).mean())


def is_line(x: np.ndarray, turned: np.ndarray) -> bool:
    """Return True if a mistake changes these counts by a gain and an offset only."""
    if not np.ptp(x) or not np.ptp(turned):
        return True
    gain, offset = np.polyfit(x, turned, 1)
    return bool(np.abs(gain * x + offset - turned).max() <= 1e-6 * np.ptp(turned))


def is_monotone(values: np.ndarray) -> bool:
    """Return True if values in the order of their counts only rise, or only fall, apart from single outliers."""
    if len(values) < 2 * _SMOOTHED_ROWS:
        return True
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(values, _SMOOTHED_ROWS), axis=1)
    back = [float((np.maximum.accumulate(sign * smooth) - sign * smooth).max()) for sign in (1, -1)]
    return min(back) <= _MAX_FALL_BACK * float(np.ptp(smooth))


def _resolution(y: np.ndarray) -> float:
    """Return the step to which a column is rounded, or 0 if it is not rounded."""
    values = np.unique(y)
    if len(values) < _MIN_LEVELS:
        return 0.0
    gaps = np.diff(values)
    gap = float(gaps[gaps > 1e-9 * np.ptp(y)].min(initial=np.inf))
    if not np.isfinite(gap):
        return 0.0
    steps = (values - values[0]) / gap
    return gap if np.allclose(steps, np.rint(steps), atol=1e-3) and steps[-1] < 1e7 else 0.0


def ranks(values: np.ndarray) -> np.ndarray:
    """Return ranks along the first axis, with mean 0 and deviation 1; equal values get the mean of their ranks."""
    if not len(values):
        return values.astype(float)
    order = values.argsort(axis=0)
    ordered = np.take_along_axis(values, order, axis=0)
    at = np.broadcast_to(np.arange(len(values))[:, None], values.shape)
    first, last = np.ones((2, *values.shape), bool)
    first[1:] = last[:-1] = ordered[1:] != ordered[:-1]
    low = np.maximum.accumulate(np.where(first, at, 0), axis=0)
    high = np.minimum.accumulate(np.where(last, at, len(values))[::-1], axis=0)[::-1]
    ranks = np.empty(values.shape)
    np.put_along_axis(ranks, order, (low + high) / 2, axis=0)
    ranks -= ranks.mean(axis=0)
    return ranks / np.maximum(ranks.std(axis=0), 1e-12)


def distinct(x: np.ndarray, channels: np.ndarray) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Return the first of all equal channels, in order, and by each of them the channels with these counts."""
    if not len(channels):
        return channels, {}
    _, first, group = np.unique(x[:, channels], axis=1, return_index=True, return_inverse=True)
    equal = {int(channels[at]): channels[group.ravel() == k] for k, at in enumerate(first)}
    return channels[np.sort(first)], equal
