"""The processor time of steps on a CPU, in pairs with another commit: `python -m benchmarks steps 065386c`.

The probe below runs unchanged in both trees, through names that both have. It prints the least time of a step of each
case on one thread; a pair is one run of it in each tree, one after the other, so that a machine that becomes slower
does so for both. Cases: Genesis's scene (a ball 2 mm deep in a grid of 24 mm), and an elastic layer with friction over
which a ball slides.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

from benchmarks.same import TREE, export

BASE = "065386c"
"""The commit that the page on performance compares with."""
PROBE = """
import json, sys, time
import numpy as np
import warp as wp
import tactemu as tt
try:
    from tactemu.tune.speed.physics_cases import Case, build
except ImportError:
    from tactemu.bench.physics_cases import Case, build

def least(step, repeats, inner):
    times = []
    for _ in range(repeats):
        start = time.thread_time_ns()
        for _ in range(inner):
            step()
        times.append((time.thread_time_ns() - start) / inner)
    return min(times) / 1e3

def scene(sensor, side, n_envs):
    sim, ball, skin = build(Case(sensor=sensor, side=side, n_envs=n_envs, scene="genesis"), "cpu", threads=1)
    return least(sim.step, 20, max(1, 200_000 // (n_envs * side**2)))

def layer(side, pitch):
    x = (np.arange(side) - (side - 1) / 2) * pitch
    positions = np.stack([*np.meshgrid(x, x[::-1]), np.full((side, side), 0.005)], -1)
    options = {"iterations": 16, "tolerance": 1e-4, "friction": 0.5, "displacement": False}
    world = tt.Scene()
    pad = world.add_body(None, name="pad", fixed=True)
    ball = world.add_body(tt.Sphere(radius=0.06), position=(0, 0, 1))
    try:
        model = tt.ElasticLayerTaxel(positions=positions, **options)
    except TypeError:
        model = tt.ElasticLayerTaxel(probe_local_pos=positions, **options)
    world.add_sensor(model, link=pad)
    best = None
    sim = world.build(n_envs=1, device="cpu")
    for _ in range(3):
        times = []
        for k in range(40):
            sim.set_pose(ball, position=[[1e-5 * k, 0, 0.0645 - 2e-6 * k]])
            start = time.thread_time_ns()
            sim.step()
            times.append((time.thread_time_ns() - start) / 1e3)
        best = times if best is None else [min(pair) for pair in zip(best, times)]
    return float(np.median(best[8:]))

for line in sys.stdin:
    kind, *arguments = json.loads(line)
    print(json.dumps({"scene": scene, "layer": layer}[kind](*arguments)), file=sys.__stdout__, flush=True)
"""
NAMES = {"Depth": "ContactDepthProbe", "Kinematic": "KinematicTaxel", "Proximity": "ProximityTaxel, 500 points"}
CASES: Mapping[str, tuple[object, ...]] = {
    f"{name}, {n_envs} x {side**2}": ("scene", sensor, side, n_envs)
    for n_envs, side in ((1, 16), (1, 64), (64, 16), (64, 64))
    for name, sensor in NAMES.items()
} | {"layer with friction, 64 x 64": ("layer", 64, 5e-4), "layer with friction, 256 x 256": ("layer", 256, 1.25e-4)}
"""The arguments of the probe for each case."""


def times(tree: Path, names: list[str]) -> dict[str, float]:
    """Run the probe in a tree and return the time of a step [µs] of each case."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    asked = "".join(json.dumps(CASES[name]) + "\n" for name in names)
    command = [sys.executable, "-c", PROBE]
    done = subprocess.run(
        command, cwd=tree, env=environment, input=asked, stdout=subprocess.PIPE, text=True, check=True
    )
    found = [line for line in done.stdout.splitlines() if line[:1].isdigit()]
    return dict(zip(names, map(float, found), strict=True))


def run(
    echo: Callable[[str], None], commit: str = BASE, pairs: int = 10, only: str = ""
) -> dict[str, dict[str, float]]:
    """Measure pairs, report and return was, is and ratio of each case.

    Args:
        echo: takes the lines of the report.
        commit: the commit to compare with.
        pairs: number of runs in each tree.
        only: part of a case's name.
    """
    names = [name for name in CASES if only.lower() in name.lower()]
    with tempfile.TemporaryDirectory() as folder:
        export(commit, Path(folder))
        for tree in (Path(folder), TREE):
            times(tree, names)  # fills the kernel cache
        both = [(times(Path(folder), names), times(TREE, names)) for _ in range(pairs)]
    figures: dict[str, dict[str, float]] = {}
    for name in names:
        ratios = sorted(now[name] / before[name] for before, now in both)
        was, is_now = (median(run[k][name] for run in both) for k in (0, 1))
        low, high = ratios[len(ratios) // 4], ratios[-1 - len(ratios) // 4]
        figures[name] = {"was_us": was, "is_us": is_now, "ratio": median(ratios), "low": low, "high": high}
        echo(f"{name:<32} {was:9.1f} -> {is_now:9.1f} µs   ratio {median(ratios):.2f} ({low:.2f} to {high:.2f})")
    return figures
