"""Estimates from an untouched sensor: noise, its slow part, resolution, rate, stuck taxels, drift, temperature."""

from __future__ import annotations

import numpy as np

from firmware_protocols.senses import QUANTITY_UNITS
from tactemu.fit.estimates import Findings, linear
from tactemu.fit.recording import Recorded

MIN_ROWS = 100
"""Minimum number of pairs of untouched rows for an estimate of noise."""
MIN_WARMING_K = 2.0
"""Minimum range of temperature for an estimate of its effect."""
MIN_CHANNELS = 4
"""Minimum number of channels that distinguish a slow register from noise below a step."""


def untouched_rows(recorded: Recorded) -> np.ndarray:
    """Return the mask of untouched rows ``(n,)``: by the column `untouched`, else those without load, else all."""
    if "untouched" in recorded.truth:
        return recorded.truth["untouched"] != 0
    load = recorded.load
    if load is not None and np.ptp(load) > 0:
        free = load <= load.min() + 0.02 * np.ptp(load)
        return np.convolve(~free, np.ones(5), "same") == 0 if free.any() else free
    return np.ones(len(recorded.readings), bool)


def find_untouched(recorded: Recorded, untouched: np.ndarray, found: Findings) -> None:
    """Add all estimates from untouched rows."""
    find_clock(recorded, found)
    find_stuck(recorded, found)
    x = recorded.readings
    pairs = untouched[1:] & untouched[:-1]
    if recorded.t is not None:
        periods = np.diff(recorded.t)
        pairs &= periods < 3 * np.median(periods)
    if pairs.sum() < MIN_ROWS:
        found.unknown.append(
            f"noise: {int(pairs.sum())} rows at rest, {MIN_ROWS} are needed: record ten seconds without touching it"
        )
        return
    find_noise(x, untouched, pairs, recorded, found)
    find_drift(recorded, untouched, found)


def find_clock(recorded: Recorded, found: Findings) -> None:
    """Add rate, jitter, the share of doubled periods, and repeated rows."""
    if recorded.t is None:
        found.unknown.append("rate and jitter: the recording has no clock; give --rate, and spectra are per row")
    else:
        periods = np.diff(recorded.t)
        usual = float(np.median(periods))
        near = periods[np.abs(periods - usual) < 0.5 * usual]
        n = len(near)
        found.add("rate", 1.0 / near.mean(), near.std() / np.sqrt(n) / near.mean() ** 2, "Hz", "of the rows")
        if near.std() > 1e-3 * usual:
            kurtosis = float(np.mean((near - near.mean()) ** 4) / near.var() ** 2)
            error = near.std() * np.sqrt(max(kurtosis - 1, 0.1) / (4 * n))
            found.add("period spread", near.std(), error, "s", "std of usual periods")
        doubled = np.abs(periods - 2 * usual) < 0.4 * usual
        if doubled.mean() > 0.005:
            share = float(doubled.mean())
            found.add("missed", share, np.sqrt(share * (1 - share) / len(periods)), "", "share of doubled periods")
    find_repeats(recorded, found)


def find_repeats(recorded: Recorded, found: Findings) -> None:
    """Add the share of repeated rows and its cause.

    If all channels repeat together, a register is renewed more slowly than it is read; if each repeats by itself, noise
    is below a step.
    """
    changed = np.diff(recorded.readings, axis=0) != 0
    same = ~changed.any(axis=1)
    share = float(same.mean())
    if share <= 0.02 or same.all():
        return
    found.add("repeated", share, np.sqrt(share * (1 - share) / len(same)), "", "share of rows like the one before")
    alike = float(np.prod(1.0 - changed[~same].mean(axis=0)))  # the share if channels repeated independently
    if changed.shape[1] < MIN_CHANNELS:
        found.notes.append("rows repeat: a register that is renewed slowly, or noise below a step: too few channels")
    elif share < 3.0 * alike + 0.02:
        found.notes.append("rows repeat: noise is below a step")
    elif recorded.t is None:
        found.unknown.append("refresh: a register is renewed more slowly than it is read; give times or --rate")
    else:
        periods = np.diff(recorded.t[1:][~same])
        near = periods[periods < 3 * np.median(periods)]
        found.add("refresh", near.mean(), near.std() / np.sqrt(len(near)), "s", "between rows that are new")


def find_stuck(recorded: Recorded, found: Findings) -> None:
    """Note the channels that never change, or hardly ever while others do."""
    changes = (np.diff(recorded.readings, axis=0) != 0).mean(axis=0)
    usual = np.median(changes)
    stuck = [name for name, share in zip(recorded.names, changes) if share == 0 or share < 0.01 * usual]
    if stuck and len(stuck) < len(recorded.names):
        found.notes.append(f"stuck or dead: {', '.join(stuck)}")


def step_of(values: np.ndarray) -> float:
    """Return the step of a quantiser that all values are multiples of, or 0 if there is none."""
    levels = np.unique(values)
    if len(levels) < 3:
        return 0.0
    apart = np.diff(levels)
    step = float(apart[apart > 1e-9 * max(np.abs(levels).max(), 1e-30)].min())
    counts = apart / step
    if np.abs(counts - np.rint(counts)).max() > 0.1 or len(levels) > 0.9 * len(values):
        return 0.0
    return float(np.ptp(levels) / np.rint(np.ptp(levels) / step))


def find_noise(x: np.ndarray, untouched: np.ndarray, pairs: np.ndarray, recorded: Recorded, found: Findings) -> None:
    """Add white noise and its slow part, mean over the channels (by axis if there are three), and the resolution."""
    unit = QUANTITY_UNITS.get(recorded.kind, "")
    alive = (np.diff(x, axis=0) != 0).any(axis=0)
    steps = np.array([step_of(x[:, k]) if alive[k] else 0.0 for k in range(x.shape[1])])
    axes = [slice(k, None, 3) for k in range(3)] if recorded.kind == "field" and x.shape[1] % 3 == 0 else [slice(None)]
    for axis, own in zip(("x", "y", "z") if len(axes) == 3 else ("",), axes):
        here = alive[own]
        label = f" {axis}" if axis else ""
        seen = steps[own][here]
        if len(seen) and (seen > 0).all():
            found.add(f"resolution{label}", float(np.median(seen)), 0.0, unit, "step of the readings")
        jumps = np.diff(x[:, own], axis=0)[pairs][:, here]
        if not jumps.size:
            continue
        clip = 6 * np.maximum(1.4826 * np.median(np.abs(jumps), axis=0), jumps.std(axis=0) / 3)
        jumps = np.where(np.abs(jumps) > clip, np.nan, jumps)
        step = np.median(seen) if len(seen) else 0.0
        white = np.sqrt(np.maximum(np.nanvar(jumps, axis=0) / 2 - step**2 / 12, 0.0))
        n, m = jumps.shape
        error = np.sqrt(np.mean(white**2) * 3.0 / (4.0 * n) / m + white.var() / max(m - 1, 1) / m)
        found.add(f"white noise{label}", white.mean(), error, unit, "std, mean over the channels")
        calm = x[untouched][:, own][:, here]
        lags = np.unique(np.geomspace(1, max(2, n // 10), 12).astype(int))
        centred = calm - calm.mean(axis=0)
        power = centred.var(axis=0)
        shares = [float(((centred[k:] * centred[:-k]).mean(axis=0) / np.maximum(power, 1e-300)).mean()) for k in lags]
        if shares[0] > 0.05:
            below = [lag for lag, share in zip(lags, shares) if share < shares[0] / np.e]
            found.add(f"slow share{label}", shares[0], 2.0 / np.sqrt(n), "", "of the variance, after one row")
            found.add(f"slow rows{label}", float(below[0] if below else n // 10), 0.5 * n / 10, "rows", "its memory")


def find_drift(recorded: Recorded, untouched: np.ndarray, found: Findings) -> None:
    """Add the drift over time, or the dependence on temperature, mean over the channels."""
    y = recorded.readings[untouched].mean(axis=1)
    unit = QUANTITY_UNITS.get(recorded.kind, "")
    warm = recorded.truth.get("temperature")
    if warm is not None and np.ptp(warm[untouched]) >= MIN_WARMING_K:
        degrees = warm[untouched] - warm[untouched].mean()
        law, covariance, _ = linear(np.column_stack([np.ones(len(y)), degrees]), y)
        found.add("offset per K", law[1], np.sqrt(covariance[1, 1]), f"{unit}/K", "mean over the channels")
        return
    if warm is None:
        found.unknown.append(
            "temperature terms: record the untouched sensor while it warms by ten degrees, with a thermometer's column"
        )
    else:
        found.unknown.append(f"temperature terms: it warmed by {np.ptp(warm[untouched]):.1f} K only; record ten")
    if recorded.t is not None and np.ptp(recorded.t[untouched]) > 60:
        hours = (recorded.t[untouched] - recorded.t[untouched].mean()) / 3600
        law, covariance, _ = linear(np.column_stack([np.ones(len(y)), hours]), y)
        found.add("drift", law[1], np.sqrt(covariance[1, 1]), f"{unit}/h".lstrip("/"), "mean over the channels")
