"""A silicone finger pad with a channel of air or oil, poked: force, and pressure at both ends of the channel.

A recording is a :class:`Pokes`. The laws of a hold of 2.4 s under a load ``F``::

    force at its end / early peak = 1 − k F         a property of the silicone, not of the medium in its channel
    pressure behind force         = lag             a property of the medium, which only its own recording gives
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Fold, Recordings

RATE_HZ = 100.0
LEAST_N = 1.0
N_PER_STEP, UNIT_PER_STEP = -4.1448 * 0.2e-3, 5 * 0.2e-3

AIMS = (
    Aim("relaxation", "relaxation in a hold, first half predicts the second", 1.0, "points", "worst"),
    Aim("lag", "median lag of the pressure, first half predicts the second", 0.1, "s", "worst"),
    Aim("relaxation other", "relaxation, from another medium", 3.0, "points", "worst"),
)


@dataclass(frozen=True)
class Pokes:
    """The measured values of each poke of a recording, in order."""

    medium: str
    load_n: np.ndarray
    relaxation: np.ndarray
    """The force at the end of the hold, as a share of its early peak."""
    lag_s: np.ndarray
    """The delay of pressure behind force at 90 % of their steps."""
    half: int = 0
    """The half of a recording, 1 or 2; 0 for the complete one."""


def read(folder: Path) -> Recordings:
    """Return the complete recordings, and the halves of long ones."""
    found: dict[str, Any] = {}
    for path in sorted(folder.glob("*.npz")):
        each = pokes(np.load(path)["force_p_left_p_right"].astype(float), path.stem)
        found[path.stem] = each
        k = len(each.lag_s) // 2
        if k >= 20:
            for half, part in ((1, slice(None, k)), (2, slice(k, None))):
                found[f"{path.stem}, half {half}"] = Pokes(
                    each.medium, each.load_n[part], each.relaxation[part], each.lag_s[part], half
                )
    return found


def pokes(rows: np.ndarray, medium: str) -> Pokes:
    """Cut a recording into its holds, without those below :data:`LEAST_N`, whose peak is noise."""
    force = (rows[:, 0] - np.median(rows[:200, 0])) * N_PER_STEP
    pressure = rows[:, 1:] * UNIT_PER_STEP
    smooth = np.convolve(force, np.ones(10) / 10, "same")
    edges = np.flatnonzero(np.diff(np.concatenate([[False], smooth > 0.4, [False]]).astype(int))).reshape(-1, 2)
    found = []
    for first, last in edges:
        early = smooth[first : first + 100]
        load = np.percentile(early, 90)
        if 1.2 * RATE_HZ < last - first < 6 * RATE_HZ and first >= 60 and load > LEAST_N:
            late = smooth[last - 40 : last - 15].mean()
            found.append((load, late / early.max(), _lag(force, pressure, first, last)))
    return Pokes(medium, *np.array(found).T)


def _lag(force: np.ndarray, pressure: np.ndarray, first: int, last: int) -> float:
    """Return the time between 90 % of the steps of force and of pressure [s], at the end of the channel with the larger
    step."""
    before = slice(first - 40, first - 10)
    steps = pressure[last - 35 : last - 10].mean(axis=0) - pressure[before].mean(axis=0)
    own = pressure[:, int(np.argmax(np.abs(steps)))]

    def reached(signal: np.ndarray) -> float:
        low, high = np.median(signal[before]), np.median(signal[last - 35 : last - 10])
        share = (signal[first - 20 : last] - low) / (high - low)
        smooth = np.convolve(share, np.ones(5) / 5, "same")
        return float(np.argmax(smooth >= 0.9)) / RATE_HZ

    return reached(own) - reached(force)


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the relaxation of all recordings, and the lag of each medium."""
    every = list(recordings.values())
    media = dict.fromkeys(each.medium for each in every)
    load, lost = (np.concatenate([getattr(each, name) for each in every]) for name in ("load_n", "relaxation"))
    law = least_squares(lambda p: 1.0 - p[0] * load - lost, [0.01], loss="soft_l1", f_scale=0.01)
    return {
        "relaxation_per_n": float(law.x[0]),
        "lag_s": {
            name: float(np.median(np.concatenate([each.lag_s for each in every if each.medium == name])))
            for name in media
        },
    }


def errors(parameters: dict[str, Any], recordings: Recordings, known: Recordings | None = None) -> dict[str, Any]:
    """Return the errors of medians [points, s]; a medium that was not fitted has no lag."""
    found: dict[str, list] = {aim.key: [] for aim in AIMS}
    for each in recordings.values():
        same = each.medium in parameters["lag_s"]
        expected = np.median(1.0 - parameters["relaxation_per_n"] * each.load_n)
        apart = 100 * (expected - np.median(each.relaxation))
        found["relaxation" if same else "relaxation other"].append(apart)
        if same:
            found["lag"].append(parameters["lag_s"][each.medium] - np.median(each.lag_s))
    return {key: np.array(values) for key, values in found.items() if values}


def folds(recordings: Recordings) -> list[Fold]:
    """Return the folds: the first half predicts the second; then each long recording predicts the other media."""
    halves = {each.medium for each in recordings.values() if each.half}
    found: list[Fold] = [([f"{medium}, half 1"], [f"{medium}, half 2"]) for medium in sorted(halves)]
    complete = [name for name, each in recordings.items() if not each.half]
    for name in complete:
        if name in halves:
            found.append(([name], [other for other in complete if other != name]))
    return found
