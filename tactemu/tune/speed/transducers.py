"""The time of transducers: a part of `tactemu bench physics`.

The scene has five taxels of an AnySkin under a ball; each figure is the difference between a step with the transducer
and one without.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from statistics import median
from typing import Any

import numpy as np

from tactemu.geometry.shapes.sphere import Sphere
from tactemu.scene.scene import Scene
from tactemu.sensors.probes.kinematic_taxel import KinematicTaxel
from tactemu.transducers.registry import transducer_class

EXAMPLES: dict[str, tuple[str, dict[str, Any]]] = {
    "magnetic, 5 chips x 100 magnets": ("magnetic", {}),
    "magnetic, with the earth": ("magnetic", {"earth": (2e-5, 0.0, -4e-5)}),
    "material, creep": ("material", {"creep_per_decade": 0.1}),
    "material, loop, wear": ("material", {"loop": 0.1, "softening": 0.02, "baseline": 0.02}),
    "piezoresistive": ("piezoresistive", {}),
    "capacitive, baseline followed": ("capacitive", {"baseline_tau": 10.0}),
    "fluid": ("fluid", {}),
}
AIMS_US = {("magnetic, 5 chips x 100 magnets", "cpu"): 50.0, ("magnetic, 5 chips x 100 magnets", "cuda"): 100.0}
ENVS = {"cpu": 1, "cuda": 4096}
PLACES = 0.007 * np.array([(0, 0, 0), (-1, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0)])
ROUNDS = 5


def build(n_envs: int, device: str, transducers: Sequence = ()) -> Any:
    """Return a simulation of five taxels that a ball presses."""
    scene = Scene(dt=1e-3)
    pad = scene.add_body(None, name="pad", fixed=True)
    ball = scene.add_body(Sphere(radius=0.02), name="ball", position=(0, 0, 0.0215))
    model = KinematicTaxel(positions=PLACES, radius=3e-3)
    scene.add_sensor(model, link=pad, name="skin", transducers=transducers)
    sim = scene.build(n_envs, device=device)
    for _ in range(3):
        sim.set_pose(ball, linear_velocity=(0.01, 0, 0))
        sim.step()
    return sim


def step_us(sim: Any, steps: int = 400) -> float:
    """Return the mean time of a warm step in a run of many [µs]."""
    import warp as wp

    wp.synchronize_device(sim.device)
    start = time.perf_counter_ns()
    for _ in range(steps):
        sim.step()
    wp.synchronize_device(sim.device)
    return (time.perf_counter_ns() - start) / steps / 1e3


def run(report: Any, *, device: str = "cpu", only: str = "") -> dict[str, dict]:
    """Measure all examples whose title contains ``only``, and return the figures by title."""
    kind = "cuda" if device.startswith("cuda") else "cpu"
    chosen = {title: each for title, each in EXAMPLES.items() if only.lower() in title.lower()}
    if not chosen:
        return {}
    n_envs = ENVS[kind]
    sims = {"": build(n_envs, device)}
    sims |= {
        title: build(n_envs, device, [transducer_class(name)(**options)]) for title, (name, options) in chosen.items()
    }
    times: dict[str, list[float]] = {title: [] for title in sims}
    for _ in range(ROUNDS):  # in turn, so that other processes slow all of them equally
        for title, sim in sims.items():
            times[title].append(step_us(sim))
    bare, figures = median(times[""]), {}
    for title in chosen:
        aim = AIMS_US.get((title, kind))
        more = median(times[title]) - bare
        figures[title] = {"more_us": more, "step_us": median(times[title]), "aim_us": aim, "n_envs": n_envs}
        envs = f", {n_envs} envs" if n_envs > 1 else ""
        target = f"aim {aim:.0f}" if aim else ""
        report(f"{title + envs:<48} {more:9.1f} µs more than the {bare:.1f} µs of a step without  {target}")
    return figures
