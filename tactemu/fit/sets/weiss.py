"""Weiss DSA on a Schunk SDH-2 hand: dead weights on a piezoresistive matrix, cold and warm.

Recordings ``weight_*_*g`` are a :class:`Weights`, ``sensitivity*`` a :class:`GainSeries`. The law of the sum over one
matrix, ``t`` after a weight of ``m`` [g] was put down at ``T`` [°C], on its k-th imprint::

    sum(5 s) = full u/(1 + u) (1 + k-th imprint: i ln k) exp(g (T − 40)),   u = (m/half)² exp(a (T − 40))

The first is a divider of a fixed resistor and a piezoresistor ``R ∝ p^-2`` whose resistance falls as it warms. The gain
register multiplies: ``sum = sum(1.0) (offset + slope register)``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Constant, Recordings
from tactemu.fit.skill import Points
from tactemu.transducers.laws import divider

MATRIX = 1
"""The index of the matrix under the weights."""
EXPONENT = 2.0
"""The exponent of resistance over pressure; a fit gives 1.9 and predicts no better."""
REFERENCE_C = 40.0

AIMS = (Aim("sum", "sum 5 s after a weight is put down", 15.0, "%"),)
CONSTANTS = (
    Constant("creep", "creep per decade from 0.5 to 10 s, mean over the imprints of a weight"),
    Constant("register", "sum per unit of the gain register, of the sum at 1.0"),
)


@dataclass(frozen=True)
class Weights:
    """The imprints of one weight, in order."""

    mass_g: float
    temperature_c: np.ndarray
    sum_5s: np.ndarray
    creep: np.ndarray
    """The creep per decade, from 0.5 to 10 s."""


@dataclass(frozen=True)
class GainSeries:
    """The sums of one weight at settings of the gain register."""

    register: np.ndarray
    sums: np.ndarray


def read(folder: Path) -> Recordings:
    """Return the recordings of weights and of gain registers."""
    found: dict[str, Any] = {}
    for path in sorted(folder.glob("*.npz")):
        weight = re.search(r"weight.*?_(\d+)g", path.stem)
        if weight:
            found[path.stem] = weights(np.load(path), float(weight[1]))
        elif path.stem.startswith("sensitivity"):
            found[path.stem] = gains(np.load(path))
    return found


def weights(archive: Any, mass_g: float) -> Weights:
    """Return the imprints of a file."""
    t, total = sums_of(archive)
    seconds, degrees = archive["temp_t_ms"] / 1e3, archive["temp_c"][:, MATRIX]
    rows = []
    for first, last in imprints(t, total, at_least_s=6.0):
        after, here = t[first:last] - t[first], total[first:last]
        early = (after >= 0.5) & (after <= 10.0)
        slope, level = np.polyfit(np.log10(after[early]), here[early], 1)
        rows.append((np.interp(t[first], seconds, degrees), np.interp(5.0, after, here), slope / level))
    temperature, sum_5s, creep = np.array(rows).T
    return Weights(mass_g, temperature, sum_5s, creep)


def gains(archive: Any) -> GainSeries:
    """Return the sums of a file's imprints, 5 s after each; the register rises from 0.1 to 1.0 in their order."""
    t, total = sums_of(archive)
    sums = [np.interp(t[first] + 5.0, t, total) for first, last in imprints(t, total, at_least_s=6.0, share=0.02)]
    return GainSeries(np.linspace(0.1, 1.0, len(sums)), np.array(sums))


def sums_of(archive: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the times [s], and the sum of the counts of one matrix."""
    ends = np.cumsum(archive["rows_cols"].prod(axis=1))
    own = archive["frames"][:, ends[MATRIX - 1] : ends[MATRIX]]
    return archive["t_ms"] / 1e3, own.sum(axis=1, dtype=float)


def imprints(t: np.ndarray, total: np.ndarray, *, at_least_s: float, share: float = 0.25) -> list[tuple[int, int]]:
    """Return the first and the last frame of each imprint: from half of its load until the weight is lifted."""
    pressed = total > share * np.percentile(total, 95)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], pressed, [False]]).astype(int)))
    found = []
    for first, last in edges.reshape(-1, 2):
        if t[last - 1] - t[first] >= at_least_s:
            half = 0.5 * np.median(total[first:last])
            found.append((first + int(np.argmax(total[first:last] > half)), int(last)))
    return found


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the parameters: five of the sum, its creep, two of the register."""
    rows = _rows(recordings)
    found = least_squares(lambda p: np.log(_sum(p, rows) / rows["sum"]), [11.0, np.log(750.0), 0.05, -0.01, 0.1])
    spread = np.sqrt(np.mean(found.fun**2))
    result = {
        "full_counts": float(np.exp(found.x[0])),
        "half_g": float(np.exp(found.x[1])),
        "half_per_k": float(found.x[2]),
        "gain_per_k": float(found.x[3]),
        "per_imprint": float(found.x[4]),
        "spread": float(spread),
        "creep_per_decade": float(np.mean(constants(recordings)["creep"])),
    }
    series = [each for each in recordings.values() if isinstance(each, GainSeries)]
    if series:
        result["register_slope"], result["register_offset"] = _line(
            series[0].register, series[0].sums / series[0].sums.max()
        )
    return result


def predicted_sum(parameters: dict[str, Any], mass_g: Any, temperature_c: Any, imprint: Any = 0) -> np.ndarray:
    """Return the sum [counts] 5 s after a weight [g] was put down at a temperature [°C]; ``imprint`` counts from 0."""
    p = [parameters[name] for name in ("full_counts", "half_g", "half_per_k", "gain_per_k", "per_imprint")]
    rows = {"mass": np.asarray(mass_g), "warm": np.asarray(temperature_c) - REFERENCE_C, "imprint": np.asarray(imprint)}
    return _sum([np.log(p[0]), np.log(p[1]), *p[2:]], rows)


def _sum(p: Sequence[float], rows: dict[str, np.ndarray]) -> np.ndarray:
    half = np.exp(p[1] - p[2] * rows["warm"] / EXPONENT)
    worked_in = 1.0 + p[4] * np.log1p(rows["imprint"])
    return divider(rows["mass"], np.exp(p[0] + p[3] * rows["warm"]), half, EXPONENT) * worked_in


def _rows(recordings: Recordings) -> dict[str, np.ndarray]:
    """Return all imprints of all weights, one row each."""
    each = [one for one in recordings.values() if isinstance(one, Weights)]
    return {
        "mass": np.concatenate([np.full(len(one.sum_5s), one.mass_g) for one in each]),
        "warm": np.concatenate([one.temperature_c for one in each]) - REFERENCE_C,
        "imprint": np.concatenate([np.arange(len(one.sum_5s)) for one in each]),
        "sum": np.concatenate([one.sum_5s for one in each]),
    }


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    slope, offset = np.polyfit(x, y, 1)
    return float(slope), float(offset)


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the creep of each weight, and the slope of each gain series."""
    every = recordings.values()
    series = [each for each in every if isinstance(each, GainSeries)]
    return {
        "creep": [float(each.creep.mean()) for each in every if isinstance(each, Weights)],
        "register": [_line(each.register, each.sums / each.sums.max())[0] for each in series],
    }


def points(key: str, recording: Any) -> Points | None:
    """Return the sums of a weight's imprints as logarithms [%], under the logarithm of the mass and the temperature."""
    if not isinstance(recording, Weights):
        return None
    rows = _rows({"": recording})
    return Points(np.column_stack([np.log(rows["mass"]), rows["warm"]]), 100 * np.log(rows["sum"]))


def predict(parameters: dict[str, Any], key: str, recording: Weights) -> np.ndarray:
    """Return the predictions for the points of a recording."""
    rows = _rows({"": recording})
    return 100 * np.log(predicted_sum(parameters, rows["mass"], rows["warm"] + REFERENCE_C, rows["imprint"]))
