"""What a step costs: `tactemu bench physics`.

A ball pressed 1 mm into a 40 mm pad; each figure is the median time of ``step()`` and ``read()`` [µs] (on a GPU: of a
step in a long run of steps, the device waited for at the end, and the read apart). Beside it stand the figure aimed at
and that of Genesis (genesis-world 1.4.5), measured on machines of these kinds. ``bound`` is the time that moving the
counted bytes (poses read, readings written) would take at the memory's full speed.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np

import tactemu as tt
from tactemu import kernels
from tactemu.bench import transducers
from tactemu.bench.timing import Report
from tactemu.physics.models import MODELS, load
from tactemu.physics.sensor_model import SensorModel

SIDE = 0.04
MEMORY_BYTES_PER_S = {"cpu": 20e9, "cuda": 4.8e12}
"""Full speed of the memory: a server core, and an H200."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One line of the table."""

    sensor: str
    """A key of :func:`sensors`."""
    side: int
    """Taxels along a side of the grid."""
    n_envs: int = 1
    aim_us: float | None = None
    genesis_us: float | None = None
    mesh: bool = False
    """The ball as a mesh of 80k faces."""

    @property
    def title(self) -> str:
        """What is measured, in words."""
        envs = f", {self.n_envs} envs" if self.n_envs > 1 else ""
        return f"{self.sensor}{' on a mesh' if self.mesh else ''}, {self.side**2} taxels{envs}"


@dataclass(frozen=True, kw_only=True)
class Figure:
    """What was measured."""

    title: str
    step_us: float
    read_us: float
    aim_us: float | None
    genesis_us: float | None
    bound_us: float
    build_s: float
    bytes_per_env_taxel: float | None
    """Device memory of the scene for one taxel of one environment; known on a GPU."""

    def __str__(self) -> str:
        aim = f"aim {self.aim_us:7.0f}" if self.aim_us else " " * 11
        genesis = f"genesis {self.genesis_us:7.0f}" if self.genesis_us else " " * 12
        total = self.step_us + self.read_us
        memory = f"  {self.bytes_per_env_taxel:.0f} B/env/taxel" if self.bytes_per_env_taxel else ""
        return (
            f"{self.title:<48} {total:9.1f} µs (step {self.step_us:.1f}, read {self.read_us:.1f})  {aim}  {genesis}  "
            f"bound {self.bound_us:.1f}  build {self.build_s:.2f} s{memory}"
        )


def sensors() -> dict[str, tuple[type[SensorModel], Mapping[str, Any]]]:
    """What is measured, by its name in the table: a model, and its options beside the probes."""
    return {
        f"{model.__name__}{words}": (model, options)
        for model in map(load, MODELS)
        for words, options in model.examples.items()
    }


CPU_CASES = (
    Case(sensor="KinematicTaxel", side=16, aim_us=40, genesis_us=760),
    Case(sensor="ContactDepthProbe", side=16, aim_us=30, genesis_us=600),
    Case(sensor="ElastomerTaxel with shear", side=16, aim_us=250, genesis_us=2100),
    Case(sensor="ProximityTaxel, 500 points", side=16, aim_us=100, genesis_us=780),
    Case(sensor="KinematicTaxel", side=64, aim_us=250, genesis_us=1400),
    Case(sensor="ContactDepthProbe", side=64, aim_us=200, genesis_us=760),
    Case(sensor="ElastomerTaxel with shear", side=64, aim_us=2000, genesis_us=3400),
    Case(sensor="ProximityTaxel, 500 points", side=64, aim_us=1000, genesis_us=3300),
    Case(sensor="KinematicTaxel", side=64, n_envs=64, aim_us=6000, genesis_us=30000),
    Case(sensor="ContactDepthProbe", side=64, n_envs=64, aim_us=1320, genesis_us=6600),
    Case(sensor="ElastomerTaxel with shear", side=64, n_envs=64, aim_us=13600, genesis_us=68000),
    Case(sensor="ProximityTaxel, 500 points", side=64, n_envs=64, aim_us=26000, genesis_us=130000),
    Case(sensor="ContactDepthProbe", side=16, mesh=True, aim_us=300, genesis_us=3400),
)

GPU_CASES = (
    Case(sensor="KinematicTaxel", side=16, n_envs=4096, aim_us=50, genesis_us=760),
    Case(sensor="KinematicTaxel", side=32, n_envs=4096, aim_us=150, genesis_us=1480),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, aim_us=40, genesis_us=570),
    Case(sensor="ContactDepthProbe", side=16, n_envs=4096, mesh=True, aim_us=500, genesis_us=8960),
    Case(sensor="ProximityTaxel, 500 points", side=16, n_envs=4096, aim_us=150, genesis_us=940),
    Case(sensor="ElastomerTaxel", side=32, n_envs=4096, aim_us=400, genesis_us=2380),
    Case(sensor="ElastomerTaxel with shear", side=32, n_envs=4096, aim_us=800, genesis_us=3930),
)


def all_cases(device: str) -> list[Case]:
    """The cases with a figure aimed at, and one for each other sensor."""
    aimed = CPU_CASES if device == "cpu" else GPU_CASES
    named = {case.sensor for case in aimed}
    return [*aimed, *(Case(sensor=name, side=16, n_envs=aimed[0].n_envs) for name in sensors() if name not in named)]


def grid(side: int) -> np.ndarray:
    """``side * side`` probes on the top of the pad, shape ``(side, side, 3)``."""
    x = (np.arange(side) - (side - 1) / 2) * (SIDE / side)
    return np.stack([*np.meshgrid(x, x), np.full((side, side), 0.01)], -1)


def build(case: Case, device: str):
    """``(sim, ball, sensor)`` of a case, the ball 1 mm deep and sliding."""
    scene = tt.Scene(dt=1e-3)
    pad = scene.add_body(tt.Box(size=(SIDE, SIDE, 0.02)), fixed=True, name="pad")
    ball = scene.add_body(_ball(case.mesh), name="ball", position=(0, 0, 0.029))
    kind, options = sensors()[case.sensor]
    model = kind(probe_local_pos=grid(case.side), **options)
    sensor = scene.add_sensor(model, link=pad, name="skin")
    sim = scene.build(case.n_envs, device=device)
    sim.set_pose(ball, linear_velocity=(0.01, 0, 0))
    sim.step()
    sim.set_pose(ball, position=(0.001, 0, 0.029))
    sim.step()
    sim.step()
    sensor.read()
    return sim, ball, sensor


def _ball(mesh: bool):
    if not mesh:
        return tt.Sphere(radius=0.02)
    import trimesh

    return tt.Mesh(source=trimesh.creation.icosphere(6, radius=0.02))


def measure(case: Case, device: str = "cpu", repeats: int = 300) -> Figure:
    """Run one case."""

    kernels.start()
    before = _device_memory(device)
    start = time.perf_counter()
    sim, _ball, sensor = build(case, device)
    build_s = time.perf_counter() - start
    taken = _device_memory(device) - before
    repeats = max(5, min(repeats, int(3e7 / (case.n_envs * case.side**2))))
    steps, reads = [], []
    for _ in range(repeats):
        if sim.device.is_cuda:
            continue
        start = time.perf_counter_ns()
        sim.step()
        middle = time.perf_counter_ns()
        sensor.read()
        steps.append(middle - start)
        reads.append(time.perf_counter_ns() - middle)
    if sim.device.is_cuda:
        steps, reads = _on_gpu(sim, sensor)
    kind = "cuda" if sim.device.is_cuda else "cpu"
    n = case.n_envs * case.side**2
    moved = sensor.array().size * 4 + 2 * case.n_envs * (13 * 8 + 13 * 4)
    return Figure(
        title=case.title,
        step_us=median(steps) / 1e3,
        read_us=median(reads) / 1e3,
        aim_us=case.aim_us,
        genesis_us=case.genesis_us,
        bound_us=moved / MEMORY_BYTES_PER_S[kind] * 1e6,
        build_s=build_s,
        bytes_per_env_taxel=taken / n if kind == "cuda" else None,
    )


def _on_gpu(sim, sensor, runs: int = 9, steps: int = 200) -> tuple[list[float], list[float]]:
    """Times of a step within long runs, and of a read [ns]."""
    import warp as wp

    times, reads = [], []
    for _ in range(runs):
        wp.synchronize_device(sim.device)
        start = time.perf_counter_ns()
        for _ in range(steps):
            sim.step()
        wp.synchronize_device(sim.device)
        times.append((time.perf_counter_ns() - start) / steps)
        start = time.perf_counter_ns()
        sensor.read()
        reads.append(time.perf_counter_ns() - start)
    return times, reads


def _device_memory(device: str) -> int:
    """Bytes that Warp holds on a GPU; 0 on the CPU."""
    import warp as wp

    found = wp.get_device(device)
    return wp.get_mempool_used_mem_current(found) if found.is_cuda and found.is_mempool_enabled else 0


def first_reading_s(sensor: str, cache: str, device: str) -> float:
    """Seconds from starting Python to the first reading, kernels cached in the folder ``cache``."""
    code = f"from tactemu.bench import physics as p; p.build(p.Case(sensor={sensor!r}, side=16), {device!r})"
    start = time.perf_counter()
    environment = {**os.environ, "WARP_CACHE_PATH": cache}
    subprocess.run([sys.executable, "-c", code], env=environment, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start


def largest_batch(case: Case, device: str) -> int:
    """Environments of a case that fit on the GPU, by doubling; 0 on the CPU, where memory is not the limit."""
    import warp as wp

    if not wp.get_device(device).is_cuda:
        return 0
    n_envs, fits = case.n_envs, 0
    while n_envs * case.side**2 < 2**31:
        gc.collect()  # scene and sensors refer to each other
        try:
            sim, _ball, _sensor = build(Case(sensor=case.sensor, side=case.side, n_envs=n_envs), device)
            wp.synchronize_device(sim.device)
        except RuntimeError:
            break
        fits, n_envs = n_envs, 2 * n_envs
        del sim
    return fits


def run(
    report: Report, *, device: str = "cpu", starts: bool = True, only: str = "", largest: bool = False
) -> dict[str, dict]:
    """Measure all cases of the device whose title contains ``only``; returns the figures by title.

    Args:
        report: gets one line per figure.
        device: a Warp device.
        starts: also measure cold and warm starts, in processes of their own.
        only: part of a title.
        largest: also look for the largest batch that fits on a GPU.
    """
    figures: dict[str, dict] = {}
    cases = all_cases(device)
    for case in cases:
        if only.lower() in case.title.lower():
            figure = measure(case, device)
            figures[figure.title] = asdict(figure)
            report(str(figure))
    figures |= transducers.run(report, device=device, only=only)
    for sensor in sensors() if starts else ():
        if only.lower() in sensor.lower():
            with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as cache:
                cold = first_reading_s(sensor, cache, device)
                warm = median(first_reading_s(sensor, cache, device) for _ in range(3))
            figures[f"start of {sensor}"] = {"cold_s": cold, "warm_s": warm}
            report(
                f"{'first reading of ' + sensor:<48} {cold:6.2f} s with an empty cache, {warm:.2f} s with a filled one"
            )
    if largest:
        for case in cases:
            if only.lower() in case.title.lower() and not case.mesh:
                fits = largest_batch(case, device)
                figures[f"largest batch of {case.title}"] = {"n_envs": fits}
                report(f"{'largest batch of ' + case.title:<48} {fits} environments")
    return figures
