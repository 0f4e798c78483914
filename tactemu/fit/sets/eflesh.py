"""eFlesh: a printed lattice with magnets over five magnetometers, pressed in a sine by a probe on a scale.

A recording is a :class:`Presses`. The law of the force, after ``n`` presses, with the conditioning ``l = ln(1 + n)``::

    F(d) = (1 − s l) curve(d − w l)            d: depth below the first contact of the probe

The first press of a predicted recording gives the height of contact and the number ``n`` of presses before it; the
loading curves of the other presses are predicted. Presses along the surface are not read: a law of theirs predicted
recordings of other days no better than their mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Constant, Recordings, stem, table_of
from tactemu.fit.skill import Points
from tactemu.transducers.laws import conditioning, curve

DEPTHS = np.array([0.0, 0.5, 1.0, 2.0, 3.5, 5.5, 7.5, 9.0, 10.5, 12.0])
"""The depths of the points of the loading curve, for a deepest point of 12 mm."""
SCALE_DELAY_S = 0.3
"""The delay of the scale's reading: half of its refresh of 205 ms, and its filter."""
G_TO_N = 9.80665e-3

AIMS = (Aim("loading", "loading curve; height of contact and conditioning from the first press", 1.5, "% of peak"),)
CONSTANTS = (
    Constant("gap", "gap of field over depth between loading and unloading, of its peak, from the sixth press on"),
    Constant("baseline", "growth of the baseline after k presses, per ln k, of that after the first"),
)


@dataclass(frozen=True)
class Presses:
    """The loading branches, gaps and baselines of a recording's presses."""

    loading: list[tuple[np.ndarray, np.ndarray]]
    """The depth below the highest position [mm] and the force [N] of each press."""
    gaps: np.ndarray
    """The gap of each press, as a share of its peak."""
    baselines: np.ndarray
    """The change of the field from before the first press to before each other press, norm over channels [µT]."""


def read(folder: Path) -> Recordings:
    """Return the recordings of presses in a sine, ``normal_*``."""
    return {stem(path): presses(table_of(path)) for path in sorted(folder.glob("normal_*.csv.gz"))}


def presses(table: dict[str, np.ndarray]) -> Presses:
    """Cut a recording into its presses."""
    t, z = table["t_state_s"], table["z_mm"]
    field = np.stack([table[f"b{chip}{axis}"] for chip in range(5) for axis in "xyz"], axis=1)
    lowest = _turns(t, z)
    tops = [0, *(a + int(np.argmax(z[a:b])) for a, b in pairwise(lowest)), len(z) - 1]
    change = np.linalg.norm(field - field[:5].mean(axis=0), axis=1)
    weighed = table["mass_g"] >= 0
    loading, gaps = [], []
    for top, low, end in zip(tops[:-1], lowest, tops[1:]):
        read_at = np.flatnonzero(weighed & (t - SCALE_DELAY_S >= t[top]) & (t - SCALE_DELAY_S <= t[low]))
        depth = z.max() - np.interp(t[read_at] - SCALE_DELAY_S, t, z)
        loading.append((depth, table["mass_g"][read_at] * G_TO_N))
        gaps.append(_gap(z, change, top, low, end))
    return Presses(loading, np.array(gaps), change[tops[1:-1]])


def _turns(t: np.ndarray, z: np.ndarray) -> list[int]:
    """Return the rows at the lowest positions."""
    smooth = np.convolve(z, np.ones(9) / 9, "same")
    found: list[int] = []
    for i in range(20, len(z) - 20):
        lowest = smooth[i] == smooth[i - 20 : i + 21].min() and z[i] < z.min() + 0.1 * np.ptp(z)
        if lowest and (not found or t[i] - t[found[-1]] > 10):
            found.append(i)
    return found


def _gap(z: np.ndarray, change: np.ndarray, top: int, low: int, end: int) -> float:
    at = np.linspace(z[low], z.max(), 42)[1:-1]
    down, up = slice(top, low + 1), slice(low, end + 1)
    order, back = np.argsort(z[down]), np.argsort(z[up])
    apart = np.interp(at, z[up][back], change[up][back]) - np.interp(at, z[down][order], change[down][order])
    return float(apart.max() / change[top:end].max())


# -- the laws ----------------------------------------------------------------------------------------------------------


def force(parameters: dict[str, Any], depth_mm: np.ndarray, touch_mm: float, presses_before: float) -> np.ndarray:
    """Return the force [N] at a depth of the probe [mm] while loading; ``touch_mm`` is the depth of first contact."""
    worked_in = conditioning(np.asarray(presses_before))
    inside = depth_mm - touch_mm - parameters["set_mm"] * worked_in
    softer = 1.0 - parameters["softening"] * worked_in
    return softer * curve(np.maximum(inside, 0.0), np.array(parameters["depths_mm"]), np.array(parameters["forces_n"]))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the parameters of the law."""
    several: list[Presses] = list(recordings.values())
    deepest = max(depth.max() for depth, _ in several[0].loading)
    depths = DEPTHS * deepest / 12.0
    peak = max(force.max() for force in (each for one in several for _, each in one.loading))
    k = len(depths) - 1

    def named(p: np.ndarray) -> dict[str, Any]:
        forces = np.concatenate([[0.0], np.cumsum(np.exp(p[:k]))])
        return {"depths_mm": depths.tolist(), "forces_n": forces.tolist(), "set_mm": p[k], "softening": p[k + 1]}

    def residuals(p: np.ndarray) -> np.ndarray:
        law, own = named(p), p[k + 2 :].reshape(-1, 2)
        apart = [
            force(law, depth, own[i, 0], own[i, 1] + n) - felt
            for i, one in enumerate(several)
            for n, (depth, felt) in enumerate(one.loading)
        ]
        return np.concatenate(apart) / peak

    rise = np.log(np.maximum(np.diff(depths) * peak / deepest, 1e-3))
    begin = np.concatenate([rise, [0.3, 0.0], *([0.05 * deepest, 0.5 + 2.0 * i] for i in range(len(several)))])
    low = np.concatenate([np.full(k, -8.0), [0.0, -0.2], np.tile([-1.0, 0.0], len(several))])
    high = np.concatenate([np.full(k, 6.0), [2.0, 0.3], np.tile([deepest / 2, 50.0], len(several))])
    found = least_squares(residuals, begin, bounds=(low, high))
    return {name: value if isinstance(value, list) else float(value) for name, value in named(found.x).items()}


def state(parameters: dict[str, Any], first: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Return the depth of contact [mm] and the number of presses before, from the loading curve of a first press."""
    depth, felt = first
    tries = [
        least_squares(
            lambda p: force(parameters, depth, p[0], p[1]) - felt,
            [begin, before],
            bounds=([-2.0, 0.0], [depth.max(), 200.0]),
        )
        for begin in (0.02 * depth.max(), 0.2 * depth.max())
        for before in (0.2, 3.0)
    ]
    best = min(tries, key=lambda one: one.cost)
    return float(best.x[0]), float(best.x[1])


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the gap and the growth of the baseline of each recording."""
    found: dict[str, list[float]] = {"gap": [], "baseline": []}
    for each in recordings.values():
        order = np.log(np.arange(2, len(each.baselines) + 1))
        found["gap"].append(float(np.mean(each.gaps[5:])))
        found["baseline"].append(float(np.median((each.baselines[1:] / each.baselines[0] - 1.0) / order)))
    return found


def points(key: str, recording: Presses) -> Points:
    """Return the forces of the presses after the first [% of its peak], under number and depth of each."""
    parts = [(np.full(len(depth), n), depth, felt) for n, (depth, felt) in enumerate(recording.loading) if n]
    number, depth, felt = (np.concatenate(part) for part in zip(*parts))
    first, order = recording.loading[0], np.argsort(recording.loading[0][0])
    share = 100 / first[1].max()
    repeated = np.interp(depth, first[0][order], first[1][order])
    return Points(np.column_stack([number, depth]), share * felt, {"its own first press": share * repeated})


def predict(parameters: dict[str, Any], key: str, recording: Presses) -> np.ndarray:
    """Return the predictions for the points of a recording, whose first press is given."""
    touch, before = state(parameters, recording.loading[0])
    parts = [force(parameters, depth, touch, before + n) for n, (depth, _) in enumerate(recording.loading) if n]
    return 100 / recording.loading[0][1].max() * np.concatenate(parts)
