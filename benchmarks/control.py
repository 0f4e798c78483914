"""The cost of live commands for the loop, and the delay of their effect: `python -m benchmarks control`.

An emulator with a skin at 1 kHz and another at 100 Hz runs in a process of its own; other processes read the ports and
keep a core busy. This process sends commands that put down and lift the ball over the first skin.

* Effect: from sending a command to the first sample that shows it, by the time at which that sample was taken.
* Cost: lateness of samples and missed ones in two runs of the same length, with 10,000 commands a minute and with none.
* The other skin: its frames in both runs, sample by sample.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

from tactemu.base.priority import can_enable_realtime_priority
from tactemu.control.client import connect
from tactemu.truth import Passage, entries, read_log
from tactemu.tune.timing import Report

COMMANDS_PER_S = 10_000 / 60
NEIGHBOUR = "while True: pass"
SCENE = """
[[body]]
name = "left pad"
shape = "frame"
fixed = true
[[body]]
name = "ball"
shape = "sphere"
radius = 0.01
position = [0, 0, 0.03]
[[skin]]
name = "left"
device = "anyskin"
link = "left pad"
rate_hz = 1000
[[body]]
name = "right pad"
shape = "frame"
fixed = true
position = [1, 0, 0]
[[body]]
name = "other"
shape = "sphere"
radius = 0.01
position = [1, 0, 0.012]
motion = { kind = "press", approach = 0.002, depth = 0.001 }
[[skin]]
name = "right"
device = "anyskin"
link = "right pad"
rate_hz = 100
"""


@contextlib.contextmanager
def _running(folder: Path, log: Path) -> Iterator[str]:
    """Run an emulator of the scene with its readers and a busy process, and yield its name."""
    scene, name = folder / "scene.toml", f"bench-{os.getpid()}"
    scene.write_text(SCENE, encoding="utf-8")
    ports = [f"{skin}=pty:{folder / skin}" for skin in ("left", "right")]
    command = [sys.executable, "-m", "tactemu", "run", str(scene), "--json", "--truth", str(log), "--name", name]
    command += ["--preempt"] * can_enable_realtime_priority()
    run = subprocess.Popen([*command, "--port", ports[0], "--port", ports[1]], stdout=subprocess.PIPE, text=True)
    others = [subprocess.Popen([sys.executable, "-c", NEIGHBOUR])]
    try:
        assert run.stdout is not None
        if not all('"ready"' in run.stdout.readline() for _ in ports):
            raise RuntimeError(f"{' '.join(command)} has ended (exit status {run.poll()})")
        for skin in ("left", "right"):
            reader = ["cat", str(folder / skin)]
            others.append(subprocess.Popen(reader, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        time.sleep(1.0)
        yield name
        run.terminate()
        run.communicate(timeout=60)
    finally:
        for process in (run, *others):
            process.kill()
            process.wait(10)


def _poke(name: str, seconds: float, per_s: float) -> tuple[list[int], dict]:
    """Put the ball down and lift it, and return the time of each command [ns of the machine's clock] and statistics."""
    sent = []
    with connect(name) as emulator:
        start = time.perf_counter()
        for k in range(int(seconds * per_s)):
            pause = (k + random.random()) / per_s  # at any moment of the time between two samples
            time.sleep(max(0.0, start + pause - time.perf_counter()))
            sent.append(time.monotonic_ns())
            emulator.set_pose("ball", position=(0, 0, 0.0095 if k % 2 == 0 else 0.03))
        time.sleep(max(0.0, start + seconds - time.perf_counter()))
        return sent, emulator.stats()["skins"]


def _effects_ms(log: Path, sent: list[int]) -> list[float]:
    """Return the time from each command to the first sample that shows its effect [ms]."""
    found = read_log(log)
    left = found["left"]
    assert found.origin_ns is not None
    times, pressed = left.t_ns + found.origin_ns, np.abs(left.ideal).reshape(len(left.t_ns), -1).any(axis=1)
    effects = []
    for k, t_ns in enumerate(sent):
        after = np.flatnonzero((times >= t_ns) & (pressed == (k % 2 == 0)))
        if len(after):
            effects.append((times[after[0]] - t_ns) / 1e6)
    return effects


def _frames(log: Path) -> dict[int, str]:
    """Return the frames of the other skin by the time of their sample [ns]."""
    samples = read_log(log)["right"]
    times = dict(zip(samples.sample.tolist(), samples.t_ns.tolist()))
    mine = (e for e in entries(log) if isinstance(e, Passage) and e.device == "right" and e.kind == "tx")
    return {times[entry.sample]: str(entry.frame) for entry in mine if entry.sample in times}


def run(report: Report, *, seconds: float = 60.0) -> dict[str, float]:
    """Measure everything, report one line per figure, and return the figures by name."""
    figures: dict[str, float] = {}
    frames = []
    has_priority = can_enable_realtime_priority()
    report("the emulator has " + ("real-time priority" if has_priority else "usual priority: --preempt is not allowed"))
    with tempfile.TemporaryDirectory(prefix="tactemu-bench-") as name:
        folder = Path(name)
        for words, per_s in (("without", 0.0), ("with", COMMANDS_PER_S)):
            log = folder / f"{words}.mcap"
            with _running(folder, log) as emulator:
                sent, stats = _poke(emulator, seconds, per_s)
            figures |= _cost(stats, words, report)
            frames.append(_frames(log))
            if sent:
                figures |= _effect(_effects_ms(log, sent), sent, report)
    both = frames[0].keys() & frames[1].keys()
    figures["frames_of_the_other_skin"] = len(both)
    figures["frames_that_differ"] = sum(frames[0][number] != frames[1][number] for number in both)
    report(f"other skin: {len(both)} frames in both runs, {figures['frames_that_differ']:.0f} differ")
    return figures


def _cost(stats: dict, words: str, report: Report) -> dict[str, float]:
    p99 = max(skin["lateness_p99_us"] for skin in stats.values())
    missed = sum(skin["missed"] for skin in stats.values())
    samples = sum(skin["samples"] for skin in stats.values())
    lost = sum(count for skin in stats.values() for what, count in skin["wire"].items() if what.startswith("dropped"))
    report(f"{words:7} commands: lateness p99 {p99:.0f} µs, missed {missed} of {samples}, dropped {lost}")
    return {f"lateness_p99_us_{words}": p99, f"missed_{words}": missed, f"dropped_{words}": lost}


def _effect(effects: list[float], sent: list[int], report: Report) -> dict[str, float]:
    took = sorted(effects)
    figures = {
        "commands": len(sent), "felt": len(took), "effect_ms_p50": median(took),
        "effect_ms_p99": took[len(took) * 99 // 100], "effect_ms_max": took[-1],
    }  # fmt: skip
    report(f"felt {len(took)} of {len(sent)} commands " + json.dumps({k: round(v, 2) for k, v in figures.items()}))
    return figures
