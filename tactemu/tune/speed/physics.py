"""The time of a simulation step: `tactemu bench physics`.

Each figure is the median time of ``step()`` and ``read()`` [µs]; on a GPU the time of a step by the GPU's own events.
Scenes and poses come from :mod:`tactemu.tune.speed.physics_cases`. Each line also has the target (``aim``) and the time
of Genesis in the same scene, measured on machines of these kinds. ``bound`` is the time that moving the counted bytes
(poses read, readings written) takes at the memory's full speed. Loops around the step are in
:mod:`tactemu.tune.speed.physics_loops`.
"""

from __future__ import annotations

import gc
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from statistics import median

import warp as wp

from tactemu.base import kernels
from tactemu.plan.thread_pool import cores
from tactemu.sensors.sensor import reading_array
from tactemu.tune.speed import transducers
from tactemu.tune.speed.physics_cases import Case, Mover, all_cases, build, busy_kernel, sensors
from tactemu.tune.timing import Report

MEMORY_BYTES_PER_S = {"cpu": 20e9, "cuda": 4.8e12}
"""The full memory bandwidth of a server core and of an H200."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """The measured times and memory of a case."""

    title: str
    step_us: float
    read_us: float
    aim_us: float | None
    genesis_us: float | None
    bound_us: float
    build_s: float
    bytes_per_env_taxel: float | None
    """GPU memory for one taxel of one environment by Warp's pool, measured in a process of its own."""
    driver_bytes_per_env_taxel: float | None
    """The same by the driver."""
    threads: int
    """The number of CPU threads that shared the step."""

    def __str__(self) -> str:
        aim = f"aim {self.aim_us:7.0f}" if self.aim_us else " " * 11
        genesis = f"genesis {self.genesis_us:7.0f}" if self.genesis_us else " " * 12
        total = self.step_us + self.read_us
        memory = ""
        if self.bytes_per_env_taxel is not None:
            memory = f"  {self.bytes_per_env_taxel:.0f} B/env/taxel (driver: {self.driver_bytes_per_env_taxel:.0f})"
        memory += f"  {self.threads} threads" if self.threads > 1 else ""
        return (
            f"{self.title:<62} {total:9.1f} µs (step {self.step_us:.1f}, read {self.read_us:.1f})  {aim}  {genesis}  "
            f"bound {self.bound_us:.1f}  build {self.build_s:.2f} s{memory}"
        )


def measure(case: Case, device: str = "cpu", repeats: int = 300, memory: bool = True) -> Figure:
    """Measure one case; with ``memory`` also its GPU memory, in a process of its own."""
    kernels.start_warp()
    start = time.perf_counter()
    sim, ball, sensor = build(case, device)
    build_s = time.perf_counter() - start
    move = Mover(case, sim, ball)
    repeats = max(5, min(repeats, int(3e7 / (case.n_envs * case.side**2))))
    steps, reads = [], []
    for _ in range(repeats):
        if sim.device.is_cuda:
            break
        move()
        start = time.perf_counter_ns()
        sim.step()
        middle = time.perf_counter_ns()
        sensor.read()
        steps.append(middle - start)
        reads.append(time.perf_counter_ns() - middle)
    if sim.device.is_cuda:
        steps, reads = _on_gpu(sim, sensor, move)
    kind = "cuda" if sim.device.is_cuda else "cpu"
    taken = memory_of(case, device) if memory and sim.device.is_cuda else {}
    moved = reading_array(sensor).size * 4 + 2 * case.n_envs * (13 * 8 + 13 * 4)
    return Figure(
        title=case.title,
        step_us=median(steps) / 1e3,
        read_us=median(reads) / 1e3,
        aim_us=case.aim_us,
        genesis_us=case.genesis_us,
        bound_us=moved / MEMORY_BYTES_PER_S[kind] * 1e6,
        build_s=build_s,
        bytes_per_env_taxel=taken.get("pool"),
        driver_bytes_per_env_taxel=taken.get("driver"),
        threads=sim.plan.threads,
    )


def _on_gpu(sim, sensor, move, runs: int = 3, steps: int = 20) -> tuple[list[float], list[float]]:
    """Return the times of steps and of reads [ns]. The GPU times the steps, which wait in its queue behind a long
    kernel, so that Python never limits them."""
    device, out = sim.device, wp.zeros(1, dtype=wp.float32, device=sim.device)
    stream = wp.get_stream(device)
    times, reads = [], []
    for _ in range(5):
        move()
        sim.step()
    for _ in range(runs):
        events = [[wp.Event(device, enable_timing=True) for _ in range(2)] for _ in range(steps)]
        wp.launch(busy_kernel, dim=1, inputs=[4_000_000, out], device=device)
        for start, end in events:
            move()
            stream.record_event(start)
            sim.step()
            stream.record_event(end)
        wp.synchronize_device(device)
        times += [wp.get_event_elapsed_time(start, end) * 1e6 for start, end in events]
        begun = time.perf_counter_ns()
        sensor.read()
        reads.append(time.perf_counter_ns() - begun)
    return times, reads


def memory_of(case: Case, device: str) -> dict[str, float]:
    """Return the GPU memory of a case for one taxel of one environment [bytes], by Warp's pool and by the driver.

    A fresh process measures it after a simulation of one environment has loaded all kernels, so that code does not
    count.
    """
    code = (
        "import json, sys, warp as wp\n"
        "from dataclasses import replace\n"
        "from tactemu.tune.speed.physics import Case, build\n"
        "case, device = Case(**json.loads(sys.argv[1])), sys.argv[2]\n"
        "small = build(replace(case, n_envs=1), device)\n"
        "wp.synchronize()\n"
        "found = wp.get_device(device)\n"
        "look = lambda: (wp.get_mempool_used_mem_current(found), -found.free_memory)\n"
        "before = look()\n"
        "large = build(case, device)\n"
        "wp.synchronize()\n"
        "print(json.dumps([b - a for a, b in zip(before, look())]))\n"
    )
    words = [sys.executable, "-c", code, json.dumps(asdict(case)), device]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    n = case.n_envs * case.side**2
    pool, driver = (taken / n for taken in json.loads(done.stdout.splitlines()[-1]))
    return {"pool": pool, "driver": driver}


def first_reading_s(sensor: str, cache: str, device: str) -> float:
    """Return the time from the start of Python to the first reading [s], with kernels cached in ``cache``."""
    code = f"from tactemu.tune.speed.physics import Case, build; build(Case(sensor={sensor!r}, side=16), {device!r})"
    start = time.perf_counter()
    environment = {**os.environ, "WARP_CACHE_PATH": cache}
    subprocess.run([sys.executable, "-c", code], env=environment, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start


def largest_batch(case: Case, device: str) -> int:
    """Return the largest number of environments of a case that fits on the GPU, by doubling; 0 on a CPU, where memory
    is not the limit."""
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
    report: Report,
    *,
    device: str = "cpu",
    starts: bool = True,
    only: str = "",
    largest: bool = False,
    loops: bool = False,
) -> dict[str, dict]:
    """Measure all cases of the device whose title contains ``only``, and return the figures by title.

    Args:
        report: receives one line per figure.
        device: a Warp device.
        starts: also measure cold and warm starts, in processes of their own.
        only: part of a title.
        largest: also search the largest batch that fits on a GPU.
        loops: also measure loops around the step.
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
    if loops:
        from tactemu.tune.speed import physics_loops

        figures |= physics_loops.run(report, device=device, only=only)
    return figures


def markdown_page(figures: dict[str, dict], device: str) -> str:
    """Return the figures of :func:`run` as a page of tables in Markdown."""
    found = wp.get_device(device)
    machine = found.name if found.is_cuda else f"{platform.processor() or platform.machine()}, {cores()} cores"
    lines = [
        "# What a step costs, and a loop around it",
        "",
        f"Written by `tactemu bench physics --device {device} --page FILE` on {machine}.",
        "Figures of Genesis (genesis-world 1.4.5) are of the same scene, on machines of this kind.",
        "",
        "| case | step, µs | read, µs | Genesis, µs | times as fast | aim, µs | B/env/taxel |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for title, figure in figures.items():
        if "genesis_us" in figure:
            genesis_us, memory, aim = (figure[name] for name in ("genesis_us", "bytes_per_env_taxel", "aim_us"))
            total_us = figure["step_us"] + (0.0 if found.is_cuda else figure["read_us"])
            cells = [title, f"{figure['step_us']:.1f}", f"{figure['read_us']:.1f}"]
            cells += [f"{genesis_us:.0f}", f"{genesis_us / total_us:.1f}"] if genesis_us else ["", ""]
            cells += [f"{aim:.0f}" if aim else "", "" if memory is None else f"{memory:.0f}"]
            lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| loop | µs | turns a second | in steps |", "| --- | --- | --- | --- |"]
    for title, figure in figures.items():
        if "turns_per_s" in figure:
            lines.append(f"| {title} | {figure['us']:.1f} | {figure['turns_per_s']:.0f} | {figure['steps']:.1f} |")
    return "\n".join(lines) + "\n"
