"""The errors of the levels of fidelity compared with a real skin.

    python -m benchmarks reality RECORDINGS --page docs/reality.md

Each level predicts the force of presses on eFlesh's lattice (:mod:`tactemu.fit.sets.eflesh`): a flat face of 20 mm is
pressed 12 mm into a skin of 16 x 16 taxels. Each level has one gain, fitted on one recording; the height of contact
comes from the first press of the predicted recording. *With laws* the skin is conditioned as well: each press sets and
softens it as in the fitted recording, and the first press gives the number of presses before it. The last line is the
law of docs/realism.md, with a loading curve of its own. Errors are rms over all presses but the first, as shares of the
peak; each recording is predicted by the other. The page's second table is that of a finger that slides over ridges
(:mod:`benchmarks.ridges`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import tactemu as tt
from benchmarks import ridges
from tactemu.base.errors import TactemuError
from tactemu.fit.estimates import least_squares
from tactemu.fit.sets import eflesh
from tactemu.fit.sets.aims import folds
from tactemu.transducers.laws import conditioning

SIDE, PITCH, FACE, DEEPEST = 16, 1.5e-3, 0.02, 0.012
STEPS = 25
RAY = {"depth_query": "ray", "ray_reach": 0.03}
LEVELS: dict[str, tuple[str, dict[str, Any]]] = {
    "L1 depth, ray": ("ContactDepthProbe", {"radius": 1e-3, **RAY}),
    "L2 springs": ("KinematicTaxel", {"radius": 1e-3, "normal_damping": 0.0}),
    "L2 springs, ray": ("KinematicTaxel", {"radius": 1e-3, "normal_damping": 0.0, **RAY}),
    "L2 springs, ray, exponent 1.3": (
        "KinematicTaxel",
        {"radius": 1e-3, "normal_damping": 0.0, "normal_exponent": 1.3, **RAY},
    ),
    "L3 markers": ("ElastomerTaxel", {"radius": 1e-3, "shear_scale": 0.0}),
    "L4 layer": ("ElasticLayerTaxel", {"thickness": 0.03, "poisson_ratio": 0.3, "friction": 0.0}),
}


def level_curve(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return depths [mm], the summed reading of a level at each, and the time of a step [µs]."""
    kind, options = LEVELS[name]
    x = (np.arange(SIDE) - (SIDE - 1) / 2) * PITCH
    probes = np.stack([*np.meshgrid(x, x), np.full((SIDE, SIDE), 0.0)], axis=-1)
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(None, name="pad", fixed=True)
    face = scene.add_body(tt.Box(size=(FACE, FACE, 0.04)), name="face", position=(0, 0, 1))
    sensor = scene.add_sensor(getattr(tt, kind)(positions=probes, **options), link=pad)
    sim = scene.build()
    depths, readings, times = np.linspace(0.0, DEEPEST, STEPS), [], []
    quantity = next(each for each in ("force", "depth", "displacement") if each in sensor.quantities)
    for depth in depths:
        sim.set_pose(face, position=(0, 0, 0.02 - depth))
        for _ in range(3):
            begin = time.perf_counter_ns()
            sim.step()
            times.append(time.perf_counter_ns() - begin)
        values = sensor.quantity(quantity)
        readings.append(np.abs(values[..., 2] if values.ndim == 2 else values).sum())
    readings = np.array(readings) - readings[0]
    return depths * 1e3, readings / max(readings.max(), 1e-30), median(times[3:]) / 1e3


def error_of(shape: Callable[[np.ndarray], np.ndarray], known: Any, other: Any, *, laws: bool) -> float:
    """Return the rms error [% of the peak] of ``other``'s presses after the first, by a law fitted on ``known``."""

    def force(p: Sequence[float] | np.ndarray, depth: np.ndarray, touch: float, before: float) -> np.ndarray:
        worked = conditioning(np.asarray(before)) if laws else 0.0
        inside = np.maximum(depth - touch - p[1] * worked, 0.0)
        return p[0] * (1.0 - p[2] * worked) * shape(inside)

    def apart(p: np.ndarray) -> np.ndarray:
        return np.concatenate([force(p[:3], d, p[3], p[4] + n) - f for n, (d, f) in enumerate(known.loading)])

    peak = known.loading[0][1].max()
    ends = ([0.0, 0.0, -0.2, -1.0, 0.0], [np.inf, 2.0, 0.3, 6.0, 50.0])
    law = least_squares(apart, [peak, 0.2, 0.0, 0.5, 1.0], bounds=ends).x[:3]
    depth, felt = other.loading[0]
    tries = [
        least_squares(lambda q: force(law, depth, q[0], q[1]) - felt, [0.5, n], bounds=([-2.0, 0.0], [8.0, 200.0]))
        for n in (0.2, 3.0)
    ]
    touch, before = min(tries, key=lambda one: one.cost).x
    parts = [force(law, d, touch, before + n) - f for n, (d, f) in enumerate(other.loading) if n]
    return 100 * float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) / float(felt.max())


def run(report: Callable[[str], Any], recordings: Path, page: Path | None = None) -> list[dict[str, Any]]:
    """Measure every level, and return a dictionary for each line of the tables.

    Raises:
        TactemuError: the folder does not have two recordings of one condition.
    """
    known = eflesh.read(recordings / "eflesh")
    pairs = folds(list(known))
    if not pairs:
        raise TactemuError(f"{recordings}: two recordings eflesh/normal_*.csv.gz are needed")
    lines = []
    for name in LEVELS:
        depths, readings, cost = level_curve(name)

        def shape(depth: np.ndarray, depths: np.ndarray = depths, readings: np.ndarray = readings) -> np.ndarray:
            return np.interp(depth, depths, readings) + np.maximum(depth - depths[-1], 0) * (readings[-1] / depths[-1])

        plain, with_laws = (
            float(np.mean([error_of(shape, known[a[0]], known[b[0]], laws=laws) for a, b in pairs]))
            for laws in (False, True)
        )
        lines.append({"level": name, "step_us": cost, "plain": plain, "laws": with_laws})
    own = []
    for a, b in pairs:
        fitted = eflesh.fit({each: known[each] for each in a})
        own.append(eflesh.predict(fitted, "loading", known[b[0]]) - eflesh.points("loading", known[b[0]]).y)
    best = float(np.sqrt(np.mean(np.concatenate(own) ** 2)))
    lines.append({"level": "loading curve of its own", "step_us": None, "plain": None, "laws": best})
    text = _table(lines)
    report(text)
    ridged = ridges.lines(LEVELS, recordings)
    slides = _table(ridged, ("line",)) if ridged else "No recordings of a board."
    report(slides)
    if page is not None:
        page.write_text(_PAGE.replace("TABLE", text).replace("SLIDES", slides), encoding="utf-8")
    return lines + ridged


def _table(lines: Sequence[dict[str, Any]], more: Sequence[str] = ()) -> str:
    """Return the table; the columns ``more`` are before those of the errors with and without laws."""
    heads = ("level", "a step", *more, "error", "error with laws of the material")
    rows = [f"| {' | '.join(heads)} |", "| --- " * len(heads) + "|"]
    for line in lines:
        cost = f"{line['step_us']:.0f} µs" if line["step_us"] else ""
        figures = [f"{line[key]:.1f} %" if line[key] is not None else "" for key in (*more, "plain", "laws")]
        rows.append(f"| {' | '.join([line['level'], cost, *figures])} |")
    return "\n".join(rows)


_PAGE = """# Accuracy on a real skin

Written by `python -m benchmarks reality RECORDINGS --page docs/reality.md`. [Speed for accuracy](accuracy.md) judges
the levels by a rubber layer that is solved finely; this page compares them with a real skin: the force of presses on
eFlesh's printed lattice, 12 mm deep, up to 34 N, each of two recordings predicted by the other.

TABLE

A level has one gain, fitted on the other recording; the height of contact comes from the first press. *Laws of the
material* are the set and the softening of the lattice by each press, fitted on the other recording, and the number of
earlier presses, fitted on the first press. The last line has a loading curve of ten points instead of a level's own
([how real is it?](realism.md)). Errors are rms over the presses after the first, as shares of the peak.

The face is modelled as a flat square of 20 mm, the skin as 16 x 16 taxels; no level models the shape of the lattice.

## A board with ridges

CPM-Finger slides over a board with ridges, at 5 to 30 mm/s under three grips; each condition is predicted from the
others. *Line* is the strongest spectral line of a level's readings, found as in the recording. The other errors are
of the noise from sample to sample, as logarithms of ratios: of the ridges alone, and with the capacitors' white
noise.

SLIDES

All levels have the line at the frequency of the board. The noise of bars with sharp edges under points 1.5 mm apart
grows more slowly with the speed than the finger's, whose skin rounds the edges; the level whose skin rounds them most
is nearest. The fitted white noise is zero, because the sharp edges replace it. *Textured* is a flat face with a
[texture](contact.md#textures) of one wave, as high as the bars: every level is then as good as a sine with white noise,
which needs no contact. The profile of the ridge matters here, and not the level. The recorded noise on a fabric is not
in these tables: it oscillates at 2 Hz at every speed, which no texture does ([how real is it?](realism.md#laws)).
"""
