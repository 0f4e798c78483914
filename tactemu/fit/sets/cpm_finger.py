"""CPM-Finger: sixteen capacitive taxels that slide over cotton, and over a board with ridges.

A recording is :class:`Slide`. The laws, at a mean of ``F`` counts and a speed of ``v``::

    line of a board with ridges:   v / pitch
    noise from sample to sample:   sqrt(n² + (a F sin(π line period))²)        n = n0 + n1 max(0, F − F0)²

The first term is white and grows where the gripper holds hard; the second is the ridges' own slope, on a board.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Fold, Recordings
from tactemu.transducers.laws import sliding_noise

AIMS = (
    Aim("line", "line of a board with ridges", 1.0, "%"),
    Aim("period", "period", 2.0, "%"),
    Aim("spread", "spread of the period", 2.0, "%"),
    Aim("noise", "noise from sample to sample", 15.0, "%"),
)


LEAST_PERIODS = 5000
"""Minimum number of periods that determine their spread within 1 %."""


@dataclass(frozen=True)
class Slide:
    """The condition of a slide and the quantities measured in it."""

    material: str
    grip: float
    """Set-point of the gripper [counts]."""
    speed_mm_s: float
    periods_ms: np.ndarray
    noise: float
    """Noise from sample to sample: median over the taxels of the std of the difference / √2 [counts]."""
    line_hz: float | None
    """The frequency of the strongest line, for a board with ridges; else None."""

    @property
    def ridged(self) -> bool:
        """True for a board with ridges."""
        return self.material.startswith("Board")


def read(folder: Path) -> Recordings:
    """Return all slides."""
    archives = [np.load(path) for path in sorted(folder.glob("*.npz"))]
    return {name: slide(name, archive[name].astype(float)) for archive in archives for name in archive}


def slide(name: str, rows: np.ndarray) -> Slide:
    """Return one slide, by its name ``material_F<grip>_V<mm/s>mmps_<repeat>``."""
    found = re.fullmatch(r"(\w+?)_F(\d+)_V-?(\d+)mmps_\d+", name)
    if found is None:
        raise ValueError(f"slide {name!r}: expected a name such as Board10mm_F120_V-10mmps_0")
    taxels, t = rows[:, 2:], rows[:, 0]
    noise = np.median(np.diff(taxels, axis=0).std(axis=0)) / np.sqrt(2)
    material, speed = found[1], float(found[3])
    line = strongest_line(taxels, np.diff(t).mean() / 1e3) if material.startswith("Board") else None
    return Slide(material, float(found[2]), speed, np.diff(t), float(noise), line)


def strongest_line(taxels: np.ndarray, period_s: float) -> float:
    """Return the frequency of the strongest line, from a spectrum padded to sixteen times the recording's length."""
    n = len(taxels)
    fine = 16 * n
    window = np.hanning(n)[:, None]
    trend = np.linspace(-1, 1, n)[:, None]
    still = taxels - taxels.mean(axis=0) - trend * (taxels * trend).sum(axis=0) / (trend**2).sum()
    power = (np.abs(np.fft.rfft(window * still, fine, axis=0)) ** 2).sum(axis=1)
    least = 2 * 16  # two lines above the trend
    k = least + int(np.argmax(power[least:]))
    a, b, c = np.log(power[k - 1 : k + 2])
    return float((k + 0.5 * (a - c) / (a - 2 * b + c)) / (fine * period_s))


def predicted_noise(parameters: dict[str, Any], slide: Slide) -> float:
    """Return the noise from sample to sample of a slide [counts]; for an unknown material, that of the fitted one."""
    if not slide.ridged:
        return parameters["white"] + parameters["white_grip"] * max(0.0, slide.grip - parameters["grip_from"]) ** 2
    line = slide.speed_mm_s / parameters["pitch_mm"]
    amplitude = parameters["ridge_share"] * slide.grip
    return float(sliding_noise(parameters["white_ridged"], amplitude, line, parameters["period_ms"] / 1e3))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the parameters of all materials together."""
    every = list(recordings.values())
    periods = np.concatenate([each.periods_ms for each in every])
    found: dict[str, Any] = {"period_ms": float(periods.mean()), "period_std_ms": float(periods.std())}
    ridged = [each for each in every if each.line_hz]
    plain = [each for each in every if not each.ridged]
    if plain:
        names = ("white", "white_grip", "grip_from")
        law = least_squares(_apart, [1.4, 2.0, 1.5], args=(found, plain, names))
        found |= dict(zip(names, _named(law.x)))
    if ridged:
        found["pitch_mm"] = float(np.median([each.speed_mm_s / each.line_hz for each in ridged]))
        law = least_squares(lambda p: [np.log(predicted_noise(found | _ridged(p), e) / e.noise) for e in ridged],
                            [2.0, 0.6])  # fmt: skip
        found |= _ridged(law.x)
    return found


def _named(p: np.ndarray) -> tuple[float, float, float]:
    return abs(float(p[0])), abs(float(p[1])) * 1e-4, 100.0 * float(p[2])


def _ridged(p: np.ndarray) -> dict[str, float]:
    return {"white_ridged": abs(float(p[0])), "ridge_share": abs(float(p[1]))}


def _apart(p: np.ndarray, found: dict[str, Any], slides: list[Slide], names: tuple[str, ...]) -> list[float]:
    law = found | dict(zip(names, _named(p)))
    return [np.log(predicted_noise(law, each) / each.noise) for each in slides]


def errors(parameters: dict[str, Any], recordings: Recordings, known: Recordings | None = None) -> dict[str, Any]:
    """Return the errors of the slides [%], of noise as logarithms of ratios; for a material not ``known``, of periods
    only."""
    every = list(recordings.values())
    periods = np.concatenate([each.periods_ms for each in every])
    found = {"period": np.array([100 * (parameters["period_ms"] / periods.mean() - 1)])}
    if len(periods) >= LEAST_PERIODS:
        found["spread"] = np.array([100 * (parameters["period_std_ms"] / periods.std() - 1)])
    seen = [each for each in every if known is None or each.material in {one.material for one in known.values()}]
    lines = [(each.speed_mm_s / parameters["pitch_mm"], each.line_hz) for each in seen if each.line_hz]
    found["line"] = np.array([100 * (expected / line - 1) for expected, line in lines])
    found["noise"] = np.array([100 * np.log(predicted_noise(parameters, each) / each.noise) for each in seen])
    return found


def folds(recordings: Recordings) -> list[Fold]:
    """Return the folds that leave out each condition (material, grip, speed) with all its repeats, then each material
    for the periods."""
    names, found = list(recordings), []
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(name.rpartition("_")[0], []).append(name)
        groups.setdefault(recordings[name].material, []).append(name)
    for out in groups.values():
        found.append(([other for other in names if other not in out], out))
    return found
