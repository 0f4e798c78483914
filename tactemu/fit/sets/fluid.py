"""A silicone finger pad with a channel of air or oil, poked: force, and pressure at both ends of the channel.

A recording is a :class:`Pokes`. Holds of 2.4 s give two constants: the force at the end of a hold over its early peak,
and the lag of the pressure behind the force. The relaxation of a pad depends on its load and on the medium in its
channel no more than recordings differ; the lag is a property of the medium, which only its own recording gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.sets.aims import Aim, Constant, Recordings

RATE_HZ = 100.0
LEAST_N = 1.0
N_PER_STEP, UNIT_PER_STEP = -4.1448 * 0.2e-3, 5 * 0.2e-3

AIMS: tuple[Aim, ...] = ()
CONSTANTS = (
    Constant("relaxation", "force at the end of a hold of 2.4 s, of its early peak"),
    Constant("lag", "lag of the pressure; a property of the medium", "s"),
)


@dataclass(frozen=True)
class Pokes:
    """The measured values of each poke of a recording, in order."""

    relaxation: np.ndarray
    """The force at the end of the hold, as a share of its early peak."""
    lag_s: np.ndarray
    """The delay of pressure behind force at 90 % of their steps."""


def read(folder: Path) -> Recordings:
    """Return all recordings, by the medium in the channel."""
    paths = sorted(folder.glob("*.npz"))
    return {path.stem: pokes(np.load(path)["force_p_left_p_right"].astype(float)) for path in paths}


def pokes(rows: np.ndarray) -> Pokes:
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
            found.append((late / early.max(), _lag(force, pressure, first, last)))
    return Pokes(*np.array(found).T)


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
    """Return the median relaxation of all recordings, and the lag of each medium."""
    found = constants(recordings)
    return {"relaxation": float(np.median(found["relaxation"])), "lag_s": dict(zip(recordings, found["lag"]))}


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the medians of relaxation and lag of each recording."""
    every = recordings.values()
    return {
        "relaxation": [float(np.median(each.relaxation)) for each in every],
        "lag": [float(np.median(each.lag_s)) for each in every],
    }
