"""eFlesh: a printed lattice with magnets over five magnetometers, pressed in a sine by a probe on a scale.

A recording is a :class:`Presses`. The laws, after ``n`` presses, with the conditioning ``l = ln(1 + n)``::

    F(d) = (1 − s l) curve(d − w l)            d: depth below the first contact of the probe
    gap(n) = g∞ + (g0 − g∞) / (1 + n)          of the field between loading and unloading, of its peak
    baseline after press k = A (1 + b ln k)    A: of this recording

The first press of a predicted recording gives the height of contact, the number ``n`` of presses before it, and ``A``;
the loading curves, gaps and baselines of the other presses are predicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Fold, Recordings, each_left_out, stem, table_of
from tactemu.transducers.laws import conditioning, curve

DEPTHS = np.array([0.0, 0.5, 1.0, 2.0, 3.5, 5.5, 7.5, 9.0, 10.5, 12.0])
"""The depths of the points of the loading curve, for a deepest point of 12 mm."""
SCALE_DELAY_S = 0.3
"""The delay of the scale's reading: half of its refresh of 205 ms, and its filter."""
G_TO_N = 9.80665e-3

AIMS = (
    Aim("loading", "loading curve; height of contact and conditioning from the first press", 5.0, "% of peak"),
    Aim("gap", "gap of field over depth between loading and unloading", 2.0, "points"),
    Aim("baseline", "baseline after each press: shape, one amplitude per recording", 20.0, "%", "worst"),
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
    condition: str
    """The name of the condition; recordings of one condition follow one law."""


def read(folder: Path) -> Recordings:
    """Return the recordings of presses in a sine."""
    paths = [path for path in sorted(folder.glob("*.csv.gz")) if not stem(path).startswith("spatial")]
    return {stem(path): presses(table_of(path), stem(path).rpartition("_")[0]) for path in paths}


def presses(table: dict[str, np.ndarray], condition: str) -> Presses:
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
    return Presses(loading, np.array(gaps), change[tops[1:-1]], condition)


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


def gap(parameters: dict[str, Any], presses_before: np.ndarray) -> np.ndarray:
    """Return the widest gap of the field between loading and unloading, as a share of its peak."""
    last, first = parameters["gap_in_the_end"], parameters["gap_at_first"]
    return last + (first - last) / (1.0 + np.asarray(presses_before))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the parameters of each condition, by its name."""
    conditions = dict.fromkeys(each.condition for each in recordings.values())
    return {name: _fit([each for each in recordings.values() if each.condition == name]) for name in conditions}


def _fit(several: list[Presses]) -> dict[str, Any]:
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
    law = {name: value if isinstance(value, list) else float(value) for name, value in named(found.x).items()}
    before = found.x[k + 2 :].reshape(-1, 2)[:, 1]
    seen = np.concatenate([n + np.arange(len(one.gaps)) for n, one in zip(before, several)])
    slope, last = np.polyfit(1.0 / (1.0 + seen), np.concatenate([one.gaps for one in several]), 1)
    shapes = [(one.baselines[1:] / one.baselines[0] - 1.0) / np.log(np.arange(2, len(one.baselines) + 1))
              for one in several]  # fmt: skip
    return law | {
        "gap_in_the_end": float(last),
        "gap_at_first": float(last + slope),
        "baseline_per_log": float(np.median(np.concatenate(shapes))),
    }


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


def errors(parameters: dict[str, Any], recordings: Recordings, known: Recordings | None = None) -> dict[str, Any]:
    """Return the errors of the presses after the first: of force [% of peak], gap [points] and baseline [%]."""
    found: dict[str, list] = {"loading": [], "gap": [], "baseline": []}
    for each in recordings.values():
        if each.condition not in parameters:
            continue
        law = parameters[each.condition]
        touch, before = state(law, each.loading[0])
        peak = each.loading[0][1].max()
        for n, (depth, felt) in enumerate(each.loading[1:], 1):
            apart = force(law, depth, touch, before + n) - felt
            found["loading"].append(100 * np.sqrt(np.mean(apart**2)) / peak)
        found["gap"] += list(100 * (gap(law, before + np.arange(len(each.gaps))) - each.gaps))
        order = np.arange(2, len(each.baselines) + 1)
        expected = each.baselines[0] * (1.0 + law["baseline_per_log"] * np.log(order))
        found["baseline"] += list(100 * (expected / each.baselines[1:] - 1.0))
    return {key: np.array(values) for key, values in found.items()}


def folds(recordings: Recordings) -> list[Fold]:
    """Return the folds of each condition with several recordings."""
    several = {}
    for name, each in recordings.items():
        several.setdefault(each.condition, []).append(name)
    return [fold for names in several.values() if len(names) > 1 for fold in each_left_out(names)]
