"""The errors of the levels of fidelity for a finger that slides over a board with ridges: spectral line and noise.

The recordings are those of :mod:`tactemu.fit.sets.cpm_finger`. Each level measures one period of the still board: bars
of half a pitch, 1 mm deep in a skin of 8 x 16 points of 1.5 mm, of which each of the finger's 2 x 8 taxels is the mean
of 4 x 2. The board is also a flat face with a texture, one wave as high as the bars. With a level's shape ``s`` of a
taxel, of mean 0, a slide under a grip of ``F`` counts at a speed ``v`` reads::

    F (1 + m s(v t))                    m: the share of the grip on the ridges, one gain of each level
    noise from sample to sample: sqrt(n² + (m F)² var(s(x + v T) - s(x)) / 2)

``n`` is the white noise of the capacitors and their converter, 0 without these laws. Both are fitted on the other
conditions (grip and speed), as is the pitch.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import tactemu as tt
from tactemu.fit.estimates import least_squares
from tactemu.fit.sets import cpm_finger
from tactemu.fit.sets.cpm_finger import Slide

POINTS, PITCH, BLOCK = (8, 16), 1.5e-3, (4, 2)
BARS, DEPTH, STEPS = 5, 1e-3, 320


def shape_of(
    kind: str, options: Mapping[str, Any], pitch_m: float, *, is_wave: bool = False
) -> tuple[np.ndarray, float]:
    """Return the taxels' readings at :data:`STEPS` places over a board's pitch, of mean 1, ``(steps, 16)``.

    The board has bars, or if ``is_wave`` a texture. The second value is the time of a step [µs].
    """
    x, y = ((np.arange(n) - (n - 1) / 2) * PITCH for n in POINTS)
    probes = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros(POINTS)], axis=-1)
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(None, name="pad", fixed=True)
    size = (0.04, BARS * pitch_m if is_wave else pitch_m / 2, 0.02)
    wave = tt.HeightSpectrum(amplitudes=(DEPTH / 2,), wavelengths=(pitch_m,), angles=(np.pi / 2,), phases=(0.0,))
    texture = wave if is_wave else None
    bars = [
        scene.add_body(tt.Box(size=size), name=f"bar {k}", position=(0, 0, 1 + k), texture=texture)
        for k in range(1 if is_wave else BARS)
    ]
    depth = DEPTH / 2 if is_wave else DEPTH
    sensor = scene.add_sensor(getattr(tt, kind)(positions=probes, **options), link=pad)
    sim = scene.build()
    quantity = next(each for each in ("force", "depth", "displacement") if each in sensor.quantities)
    felt, times = [], []
    for place in np.linspace(0.0, pitch_m, STEPS, endpoint=False):
        for k, bar in enumerate(bars):
            middle = 0 if is_wave else (k - BARS // 2) * pitch_m
            sim.set_pose(bar, position=(0, place + middle, size[2] / 2 - depth))
        begin = time.perf_counter_ns()
        sim.step()
        times.append(time.perf_counter_ns() - begin)
        values = np.asarray(sensor.quantity(quantity), float)
        felt.append(np.abs(values.reshape(*POINTS, -1)[..., -1]))
    blocks = np.reshape(felt, (STEPS, POINTS[0] // BLOCK[0], BLOCK[0], POINTS[1] // BLOCK[1], BLOCK[1]))
    taxels = blocks.mean(axis=(2, 4)).reshape(STEPS, -1)
    return taxels / taxels.mean(axis=0), median(times[3:]) / 1e3


def slope_of(shape: np.ndarray, share_of_pitch: float) -> float:
    """Return the median over the taxels of the std of a difference / √2, at a step of this share of a pitch."""
    places = np.arange(STEPS)
    moved = [np.interp(places + share_of_pitch * STEPS, np.arange(2 * STEPS), np.tile(column, 2)) for column in shape.T]
    return float(np.median((np.array(moved).T - shape).std(axis=0)) / np.sqrt(2))


def line_of(shape: np.ndarray, slide: Slide, pitch_m: float) -> float:
    """Return the strongest line of a level's readings in a slide [Hz], found as in the recording."""
    period_s = float(slide.periods_ms.mean()) / 1e3
    places = (slide.speed_mm_s * 1e-3 * period_s * np.arange(len(slide.periods_ms) + 1) / pitch_m) % 1.0
    rows = [np.interp(places * STEPS, np.arange(STEPS + 1), np.append(column, column[0])) for column in shape.T]
    return cpm_finger.strongest_line(np.array(rows).T, period_s)


def lines(levels: Mapping[str, tuple[str, dict[str, Any]]], recordings: Path) -> list[dict[str, Any]]:
    """Return the rms errors of line and noise over the conditions left out [%] and the time of a step, for each level.

    The list is empty if no board was recorded.
    """
    every = cpm_finger.read(recordings / "cpm_finger") if (recordings / "cpm_finger").is_dir() else {}
    boards = [slide for slide in every.values() if slide.line_hz]
    conditions = sorted({(slide.grip, slide.speed_mm_s) for slide in boards})
    if len(conditions) < 3:
        return []
    pitch_m = 1e-3 * float(np.median([slide.speed_mm_s / slide.line_hz for slide in boards if slide.line_hz]))
    found = []
    boards_of = [
        (f"{name}{', textured' * is_wave}", level, is_wave)
        for name, level in levels.items()
        for is_wave in (False, True)
    ]
    for name, (kind, options), is_wave in boards_of:
        shape, cost = shape_of(kind, options, pitch_m, is_wave=is_wave)
        apart: dict[str, list[float]] = {"line": [], "plain": [], "laws": []}
        for condition in conditions:
            known = [slide for slide in boards if (slide.grip, slide.speed_mm_s) != condition]
            own = float(np.median([slide.speed_mm_s / slide.line_hz for slide in known if slide.line_hz])) * 1e-3
            gains = {laws: _fitted(shape, known, own, laws=laws) for laws in (False, True)}
            for slide in boards:
                if (slide.grip, slide.speed_mm_s) == condition and slide.line_hz:
                    apart["line"].append(100 * (line_of(shape, slide, own) / slide.line_hz - 1))
                    for laws, key in ((False, "plain"), (True, "laws")):
                        apart[key].append(100 * float(np.log(_noise(gains[laws], shape, slide, own) / slide.noise)))
        errors = {key: float(np.sqrt(np.mean(np.square(values)))) for key, values in apart.items()}
        found.append({"level": name, "step_us": cost, **errors})
    return [*found, _own(boards, conditions)]


def _own(boards: Sequence[Slide], conditions: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return the law of docs/realism.md, a sine and white noise, on the same conditions."""
    named = {str(k): slide for k, slide in enumerate(boards)}
    apart: dict[str, list[float]] = {"line": [], "noise": []}
    for condition in conditions:
        out = {name for name, slide in named.items() if (slide.grip, slide.speed_mm_s) == condition}
        law = cpm_finger.fit({name: slide for name, slide in named.items() if name not in out})
        for slide in (named[name] for name in out):
            apart["line"].append(100 * (slide.speed_mm_s / law["pitch_mm"] / slide.line_hz - 1))
            apart["noise"].append(100 * float(np.log(cpm_finger.predicted_noise(law, slide) / slide.noise)))
    line, noise = (float(np.sqrt(np.mean(np.square(values)))) for values in apart.values())
    return {"level": "a sine and white noise", "step_us": None, "line": line, "plain": None, "laws": noise}


def _noise(gains: Sequence[float] | np.ndarray, shape: np.ndarray, slide: Slide, pitch_m: float) -> float:
    step = slide.speed_mm_s * 1e-3 * float(slide.periods_ms.mean()) / 1e3 / pitch_m
    return float(np.hypot(gains[1], gains[0] * slide.grip * slope_of(shape, step)))


def _fitted(shape: np.ndarray, known: Sequence[Slide], pitch_m: float, *, laws: bool) -> np.ndarray:
    """Return the fitted ``m`` and ``n``."""
    ends = ([1e-3, 0.0], [10.0, 20.0 if laws else 1e-9])
    begin = [0.5, 1.0 if laws else 0.0]

    def apart(p: np.ndarray) -> list[float]:
        return [float(np.log(_noise(p, shape, slide, pitch_m) / slide.noise)) for slide in known]

    return least_squares(apart, begin, bounds=ends).x
