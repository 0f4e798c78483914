"""Size and time of a saved state, and of a fork: `python -m benchmarks state`.

Times are those of the thread, so that other processes do not count.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import Assembled, assemble
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene import file
from tactemu.sensors.simulation import Simulation
from tactemu.truth import Truth
from tactemu.tune.speed import physics
from tactemu.tune.timing import Report

DEVICES = ("optoforce", "anyskin", "flexitac", "linker_hand_l6", "icub_skin", "inspire_rh56dftp")
"""The measured devices, of one taxel to a thousand, on serial lines and CAN."""
SIDE = 16
"""Number of taxels along each side of the sensor models' pad."""
PRESSED_S = 0.6
"""The time of the saved state, during the press of the default scenes."""


@dataclass
class Figures:
    """The figures of a device in its default scene, or of a sensor model by itself; times are medians."""

    name: str
    taxels: int
    bytes: int
    """The size of the file; for a model, of its arrays."""
    save_ms: float
    """The time to save to a file; for a model, to arrays."""
    restore_ms: float
    build_ms: float
    """The time of a new build with compiled kernels."""
    fork_ms: float
    fork_kb: float
    """The memory of each fork."""

    def __str__(self) -> str:
        return (
            f"{self.name:<28} {self.taxels:>6} {self.bytes / 1e3:>8.0f} kB {self.save_ms:>7.1f} ms "
            f"{self.restore_ms:>7.1f} ms {self.build_ms:>7.1f} ms {self.fork_ms:>7.1f} ms {self.fork_kb:>7.0f} kB"
        )


HEAD = f"{'':<28} {'taxels':>6} {'state':>11} {'save':>10} {'restore':>10} {'build':>10} {'fork':>10} {'each':>10}"


def run(say: Report, *, repeats: int = 10, forks: int = 100, only: str = "") -> list[dict[str, Any]]:
    """Measure every device and model whose name contains ``only``, and return the figures."""
    measures = {name: partial(of_device, name, repeats, forks) for name in DEVICES}
    measures |= {name: partial(of_model, name, repeats, forks) for name in physics.sensors()}
    say(HEAD)
    found = []
    for name in (name for name in measures if only in name):
        found.append(figures := measures[name]())
        say(str(figures))
    return [asdict(each) for each in found]


def of_device(name: str, repeats: int, forks: int) -> Figures:
    """Measure a device with the cheapest model, saved during its press."""
    data = file.default_scene(name).tables.model_dump(by_alias=True, exclude_none=True)
    _built(data)
    build_ms, assembled = _timed(lambda: _built(data), repeats)
    emulator = assembled.emulator
    with emulator, tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.npz"
        emulator.run(PRESSED_S)
        save_ms, size = _timed(lambda: emulator.save(path), repeats)
        restore_ms, _ = _timed(lambda: emulator.restore(path), repeats)
        state = emulator.snapshot()
        fork_ms, fork_kb = _forks(lambda: assembled.fork(state=state), forks)
    taxels = len(emulator.channels[0].device.layout)
    return Figures(name, taxels, size, save_ms, restore_ms, build_ms, fork_ms, fork_kb)


def of_model(name: str, repeats: int, forks: int) -> Figures:
    """Measure a sensor model on a pad that a ball presses."""
    case = physics.Case(sensor=name, side=SIDE)
    physics.build(case, "cpu")
    build_ms, (simulation, *_) = _timed(lambda: physics.build(case, "cpu"), min(repeats, 3))
    save_ms, state = _timed(simulation.state, repeats)
    restore_ms, _ = _timed(lambda: simulation.prepare_restore(state)(), repeats)

    def fork() -> Simulation:
        other = simulation.clone()
        other.prepare_restore(state)()
        return other

    size = sum(array.nbytes for array in state["memory"])
    return Figures(name, SIDE**2, size, save_ms, restore_ms, build_ms, *_forks(fork, forks))


def _forks(fork: Callable[[], Any], count: int) -> tuple[float, float]:
    """Return time [ms] and memory [kB] of each of ``count`` simultaneous forks."""
    fork()
    before, begun = _used_kb(), time.thread_time()
    kept = [fork() for _ in range(count)]
    took_ms = (time.thread_time() - begun) * 1e3
    return took_ms / len(kept), max(0.0, _used_kb() - before) / len(kept)


def _built(data: dict[str, Any]) -> Assembled:
    return assemble(file.check(data), AssemblyOptions(port="memory:"), clock=VirtualClock(), truth=Truth())


def _timed(action: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Return the median time [ms] and the last result of an action."""
    times: list[float] = []
    result = None
    for _ in range(repeats):
        begun = time.thread_time()
        result = action()
        times.append((time.thread_time() - begun) * 1e3)
    return median(times), result


def _used_kb() -> float:
    """Return the resident memory of this process [kB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e3
