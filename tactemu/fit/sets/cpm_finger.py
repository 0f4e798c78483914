"""CPM-Finger: sixteen capacitive taxels that slide over cotton, and over a board with ridges.

A recording is :class:`Slide`. The law of the noise from sample to sample on a board, at a mean of ``F`` counts and a
speed of ``v``::

    noise = sqrt(n² + (a F sin(π f period))²)        f = v / pitch

The first term is white, the second is the ridges' own slope. Noise on cotton has no law: what it gains under a hard
grip was predicted no better than by the slide of the nearest condition.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.estimates import least_squares
from tactemu.fit.sets.aims import Aim, Constant, Recordings
from tactemu.fit.skill import Points
from tactemu.transducers.laws import sliding_noise

AIMS = (Aim("noise", "noise from sample to sample on a board with ridges", 10.0, "%"),)
CONSTANTS = (
    Constant("period", "period of a scan", "ms"),
    Constant("spread", "spread of the period within a recording", "ms"),
    Constant("noise", "noise from sample to sample on cotton", "counts"),
    Constant("pitch", "pitch of the board: speed over the frequency of its line", "mm"),
)


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
    """Return the noise from sample to sample of a slide over the board [counts]."""
    line = slide.speed_mm_s / parameters["pitch_mm"]
    amplitude = parameters["ridge_share"] * slide.grip
    return float(sliding_noise(parameters["white_ridged"], amplitude, line, parameters["period_ms"] / 1e3))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the period, and the parameters of the board."""
    every = list(recordings.values())
    periods = np.concatenate([each.periods_ms for each in every])
    found: dict[str, Any] = {"period_ms": float(periods.mean()), "period_std_ms": float(periods.std())}
    ridged = [each for each in every if each.line_hz]
    if ridged:
        found["pitch_mm"] = float(np.median([each.speed_mm_s / each.line_hz for each in ridged]))
        law = least_squares(lambda p: [np.log(predicted_noise(found | _ridged(p), e) / e.noise) for e in ridged],
                            [2.0, 0.6])  # fmt: skip
        found |= _ridged(law.x)
    return found


def _ridged(p: np.ndarray) -> dict[str, float]:
    return {"white_ridged": abs(float(p[0])), "ridge_share": abs(float(p[1]))}


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the periods and their spreads, the noise on cotton, and the pitches of boards, of all recordings."""
    every = list(recordings.values())
    return {
        "period": [float(each.periods_ms.mean()) for each in every],
        "spread": [float(each.periods_ms.std()) for each in every],
        "noise": [each.noise for each in every if not each.ridged],
        "pitch": [each.speed_mm_s / each.line_hz for each in every if each.line_hz],
    }


def unit(name: str) -> str:
    """Return the condition of a recording, which its repeats share: they are not independent."""
    return name.rpartition("_")[0]


def points(key: str, recording: Slide) -> Points | None:
    """Return the noise as a logarithm [%], under grip and speed."""
    if not recording.ridged:
        return None
    return Points(np.array([[recording.grip, recording.speed_mm_s]]), 100 * np.log([recording.noise]))


def predict(parameters: dict[str, Any], key: str, recording: Slide) -> np.ndarray:
    """Return the prediction for the point of a recording."""
    return 100 * np.log([predicted_noise(parameters, recording)])
