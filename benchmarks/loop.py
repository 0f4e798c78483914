"""The time to the first frame, and the lateness of the frames after it: `python -m benchmarks loop`.

* Start: from the command `tactemu run anyskin` to its first byte on the port, with an empty and with a filled kernel
  cache; median of several runs.
* Lateness: time from a sample's deadline to its complete frame, as the loop itself counts it, while another process
  drains the port; at 1 kHz also with a truth log open.
* Answers: the time that a polled driver waits (:mod:`benchmarks.answers`).
* Truth: the loop's time to keep a sample, and to pass it to a log's writer.
* The closed loop, with and without a page: steps a second, lateness, and from a contact in the engine to the wire
  (:mod:`benchmarks.closed_loop`); without MuJoCo it is left out, and a line says so.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks import answers, closed_loop
from tactemu.base.statistics import ChannelStatistics
from tactemu.truth import Truth
from tactemu.tune.timing import Report

STARTING_S = 0.5
"""The time for a reader to start."""
TAXELS = (16, 1000, 19_000)
"""The numbers of taxels whose truth is logged."""


def first_frame_s(cache: Path, *, device: str = "anyskin", limit_s: float = 120.0) -> float:
    """Return the time from the start of the command to a reader's first byte [s], with kernels cached in ``cache``.

    Raises:
        RuntimeError: the command ended, or no byte came in ``limit_s``.
    """
    folder = Path(tempfile.mkdtemp(prefix="tactemu-bench-"))
    link = folder / "port"
    command = [sys.executable, "-m", "tactemu", "run", device, "--port", f"pty:{link}", "--json"]
    start = time.perf_counter()
    environment = {**os.environ, "WARP_CACHE_PATH": str(cache)}
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    try:
        while not link.exists():
            if process.poll() is not None or time.perf_counter() - start > limit_s:
                raise RuntimeError(f"no port from {' '.join(command)} (exit status {process.poll()})")
            time.sleep(0.001)
        with open(link, "rb", buffering=0) as port:
            port.read(1)
        return time.perf_counter() - start
    finally:
        process.terminate()
        process.wait(10)
        folder.rmdir()


def truth_us(n_taxels: int, path: Path | None, samples: int = 100) -> float:
    """Return the median time of the loop to log the truth of a sample [us], one sample after another.

    A sample has the forces of ``n_taxels`` taxels, ideal and measured, and as many counts of 16 bits.
    """
    forces = np.random.default_rng(0).normal(size=(n_taxels, 3)).astype(np.float32)
    measured, counts = forces * np.float32(1.01), (forces * 100).astype(np.int16)
    truth, times = Truth(path), []
    for k in range(samples):
        start = time.perf_counter_ns()
        truth.sample(k * 10_000_000, "skin", forces, measured, counts)
        times.append(time.perf_counter_ns() - start)
    truth.close()
    return median(times) / 1e3


def lateness(rate_hz: float, seconds: float, *, device: str = "anyskin", truth: Path | None = None) -> dict[str, float]:
    """Return the statistics of a device that streams at ``rate_hz`` for ``seconds`` to a process that reads all; the
    time in which that process starts does not count."""
    from tactemu.base.clock import RealClock
    from tactemu.emulator.assembly import assemble
    from tactemu.emulator.options import AssemblyOptions
    from tactemu.scene import file

    folder = tempfile.mkdtemp(prefix="tactemu-bench-")
    run_options = AssemblyOptions(port=f"pty:{folder}/port", rate_hz=rate_hz)
    emulator = assemble(file.load(device), run_options, truth=Truth(truth)).emulator
    emulator.clock = RealClock()
    channel = emulator.channels[0]
    with emulator, _drained(f"{folder}/port"):
        emulator.run(STARTING_S)
        channel.statistics = ChannelStatistics()
        emulator.run(seconds)
    os.rmdir(folder)
    return channel.statistics.as_dict()


@contextmanager
def _drained(port: str) -> Iterator[None]:
    """Run a process that has the port open and reads."""
    reader = subprocess.Popen(["cat", port], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        reader.terminate()
        reader.wait(10)


def run(
    report: Report, *, seconds: float = 60.0, repeats: int = 5, questions: int = 10_000, only: str = ""
) -> dict[str, float]:
    """Measure everything, or ``only`` a part, report one line per figure, and return the figures by name."""
    if only == "closed":
        return _closed(report, seconds)
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as cache:
        figures["first_frame_cold_s"] = first_frame_s(Path(cache))
        report(f"first frame, empty kernel cache    {figures['first_frame_cold_s']:.2f} s")
        figures["first_frame_warm_s"] = median(first_frame_s(Path(cache)) for _ in range(repeats))
        report(f"first frame, filled kernel cache   {figures['first_frame_warm_s']:.2f} s   median of {repeats}")
    for rate, suffix in ((100.0, ""), (1000.0, ""), (1000.0, ".mcap"), (1000.0, ".jsonl")):
        with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as folder:
            measured = lateness(rate, seconds, truth=Path(folder) / f"truth{suffix}" if suffix else None)
        for name in ("lateness_p50_us", "lateness_p99_us", "lateness_max_us", "samples", "missed"):
            figures[f"{name}_at_{rate:.0f}_hz{suffix.replace('.', '_')}"] = measured[name]
        report(
            f"lateness at {rate:4.0f} Hz over {seconds:.0f} s {suffix:6} p50 {measured['lateness_p50_us']:.0f} µs, "
            f"p99 {measured['lateness_p99_us']:.0f} µs, max {measured['lateness_max_us']:.0f} µs, "
            f"missed {measured['missed']:.0f} of {measured['samples'] + measured['missed']:.0f}"
        )
    for n_taxels in TAXELS:
        _report_truth(n_taxels, figures, report)
    figures |= answers.run(report, count=questions)
    return figures if only == "open" else figures | _closed(report, seconds)


def _closed(report: Report, seconds: float) -> dict[str, float]:
    if importlib.util.find_spec("mujoco") is None:
        report("closed loop: MuJoCo is not installed: pip install 'tactemu[mujoco]'")
        return {}
    return closed_loop.run(report, seconds=seconds)


def _report_truth(n_taxels: int, figures: dict[str, float], report: Report) -> None:
    said = []
    for name in ("", ".mcap", ".jsonl"):
        with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as folder:
            cost = truth_us(n_taxels, Path(folder) / f"truth{name}" if name else None)
        figures[f"truth_us_of_{n_taxels}_taxels{name.replace('.', '_')}"] = cost
        said.append(f"{name or 'memory'} {cost:.0f} µs")
    report(f"truth of a sample, {n_taxels:5} taxels   {', '.join(said)}   (aim: {50 + 0.02 * n_taxels:.0f} µs)")
