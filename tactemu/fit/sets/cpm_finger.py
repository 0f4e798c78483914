"""CPM-Finger: sixteen capacitive taxels that slide over cotton, and over a board with ridges.

A recording is :class:`Slide`. The law of the noise from sample to sample on a board, at a mean of ``F`` counts and a
speed of ``v``::

    noise = sqrt(n² + (a F sin(π f period))²)        f = v / pitch

The first term is white, the second is the ridges' own slope. The amplitudes of the board's line and of its second
harmonic (root mean square over the taxels) are shares of the grip at every speed: the skin answers in equilibrium::

    A_k = m_k F

The noise on cotton is white under a light grip; an oscillation sets in around a grip of ``F_o``::

    noise = sqrt(n_c² + (b / (1 + exp(−(F − F_o) / w)))²)

It is not the fabric that moves past: its spectrum has a peak at 2.0 to 2.4 Hz at speeds of 10 as well as of 150 mm/s,
and more than half of it is common to all taxels.
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

BOARD, COTTON = "Board10mm", "BeigeCotton"
"""The materials of the laws of harmonics and of the noise on cotton."""
HARMONICS = 4
"""Number of lines that are fitted to a slide over a board."""
AIMS = (
    Aim("noise", "noise from sample to sample on a board with ridges", 10.0, "%"),
    Aim("line 1", "amplitude of the board's line; each speed left out", 10.0, "%", each="speed"),
    Aim("line 2", "amplitude of its second harmonic; each speed left out", 15.0, "%", each="speed"),
    Aim("cotton", "noise from sample to sample on cotton; each grip left out", 10.0, "%", each="grip"),
)
CONSTANTS = (
    Constant("period", "period of a scan", "ms"),
    Constant("spread", "spread of the period within a recording", "ms"),
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
    amplitudes: np.ndarray
    """The amplitudes of that line and its harmonics, rms over the taxels [counts]; empty without a line."""

    @property
    def ridged(self) -> bool:
        """True for a board with ridges."""
        return self.material.startswith("Board")


def read(folder: Path) -> Recordings:
    """Return all slides."""
    archives = [np.load(path) for path in sorted(folder.glob("*.npz"))]
    return {name: slide(name, archive[name].astype(float)) for archive in archives for name in archive}


def slide_name(name: str) -> re.Match[str]:
    """Return the parts of a slide's name: material, grip and speed.

    Raises:
        ValueError: it is no such name.
    """
    found = re.fullmatch(r"(\w+?)_F(\d+)_V-?(\d+)mmps_\d+", name)
    if found is None:
        raise ValueError(f"slide {name!r}: expected a name such as Board10mm_F120_V-10mmps_0")
    return found


def slide(name: str, rows: np.ndarray) -> Slide:
    """Return one slide, by its name ``material_F<grip>_V<mm/s>mmps_<repeat>``."""
    found = slide_name(name)
    taxels, t = rows[:, 2:], rows[:, 0]
    noise = np.median(np.diff(taxels, axis=0).std(axis=0)) / np.sqrt(2)
    material, speed = found[1], float(found[3])
    line = strongest_line(taxels, np.diff(t).mean() / 1e3) if material.startswith("Board") else None
    lines = np.zeros(0) if line is None else harmonics(taxels, t / 1e3, line)
    return Slide(material, float(found[2]), speed, np.diff(t), float(noise), line, lines)


def harmonics(taxels: np.ndarray, t_s: np.ndarray, line_hz: float) -> np.ndarray:
    """Return the amplitudes at a frequency and its first multiples, beside a straight trend, rms over the taxels.

    The frequency is the one within 2 % of ``line_hz`` that leaves least.
    """
    tries = []
    for each in line_hz * np.linspace(0.98, 1.02, 41):
        turns = 2 * np.pi * each * np.outer(t_s, np.arange(1, HARMONICS + 1))
        waves = np.column_stack([np.ones_like(t_s), t_s, np.cos(turns), np.sin(turns)])
        found = np.linalg.lstsq(waves, taxels, rcond=None)[0]
        tries.append((float(np.square(taxels - waves @ found).sum()), found))
    cosines, sines = np.split(min(tries, key=lambda one: one[0])[1][2:], 2)
    return np.sqrt(np.mean(np.square(cosines) + np.square(sines), axis=1))


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


def predicted_cotton(parameters: dict[str, Any], grip: float) -> float:
    """Return the noise from sample to sample of a slide over cotton [counts]."""
    above = np.clip((grip - parameters["cotton_onset"]) / parameters["cotton_width"], -50.0, 50.0)
    return float(np.hypot(parameters["cotton_white"], parameters["cotton_oscillation"] / (1.0 + np.exp(-above))))


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the period, and the parameters of board and cotton."""
    every = list(recordings.values())
    periods = np.concatenate([each.periods_ms for each in every])
    found: dict[str, Any] = {"period_ms": float(periods.mean()), "period_std_ms": float(periods.std())}
    ridged = [each for each in every if each.line_hz]
    if ridged:
        found["pitch_mm"] = float(np.median([each.speed_mm_s / each.line_hz for each in ridged]))
        law = least_squares(lambda p: [np.log(predicted_noise(found | _ridged(p), e) / e.noise) for e in ridged],
                            [2.0, 0.6])  # fmt: skip
        found |= _ridged(law.x)
    boards = [each for each in ridged if each.material == BOARD]
    if boards:
        shares = np.log([each.amplitudes[:2] / each.grip for each in boards]).mean(axis=0)
        found["line_shares"] = np.exp(shares).tolist()
    cotton = [each for each in every if each.material == COTTON]
    if cotton:
        law = least_squares(lambda p: [np.log(predicted_cotton(_cotton(p), e.grip) / e.noise) for e in cotton],
                            [0.4, 1.4, 5.27, 2.7])  # fmt: skip
        found |= _cotton(law.x)
    return found


def _cotton(p: np.ndarray) -> dict[str, float]:
    white, oscillation, onset, width = np.exp(p).tolist()
    return {
        "cotton_white": white, "cotton_oscillation": oscillation, "cotton_onset": onset, "cotton_width": width
    }  # fmt: skip


def _ridged(p: np.ndarray) -> dict[str, float]:
    return {"white_ridged": abs(float(p[0])), "ridge_share": abs(float(p[1]))}


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the periods and their spreads, and the pitches of boards, of all recordings."""
    every = list(recordings.values())
    return {
        "period": [float(each.periods_ms.mean()) for each in every],
        "spread": [float(each.periods_ms.std()) for each in every],
        "pitch": [each.speed_mm_s / each.line_hz for each in every if each.line_hz],
    }


def unit(name: str) -> str:
    """Return the condition of a recording, which its repeats share: they are not independent."""
    return name.rpartition("_")[0]


def value_of(condition: str, name: str) -> str:
    """Return a condition of a recording, ``grip`` or ``speed``, by its name."""
    one = slide_name(name)
    return one[2] if condition == "grip" else one[3]


def points(key: str, recording: Slide) -> Points | None:
    """Return the noise, or the amplitude of a line, as a logarithm [%], under grip and speed."""
    of_board, of_cotton = recording.material == BOARD, recording.material == COTTON
    if not {"noise": recording.ridged, "cotton": of_cotton}.get(key, of_board):
        return None
    value = recording.amplitudes[int(key[-1]) - 1] if key.startswith("line") else recording.noise
    return Points(np.array([[recording.grip, recording.speed_mm_s]]), 100 * np.log([value]))


def predict(parameters: dict[str, Any], key: str, recording: Slide) -> np.ndarray:
    """Return the prediction for the point of a recording."""
    if key == "cotton":
        return 100 * np.log([predicted_cotton(parameters, recording.grip)])
    if key.startswith("line"):
        return 100 * np.log([parameters["line_shares"][int(key[-1]) - 1] * recording.grip])
    return 100 * np.log([predicted_noise(parameters, recording)])
