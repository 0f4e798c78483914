"""Everything that must be on time, with its limit: `python -m benchmarks on_time`, in less than four minutes.

* Samples at 1 kHz: lateness and missed ones, in the process of a run, and beside a driver in the same process.
* Answers: from a request to its reply, on a quiet machine and beside three busy processes.
* Live commands: from the command to the first sample that shows it, and what 10,000 a minute cost.
* The closed loop at 500 steps a second, without and with a live page.
* 100 devices served and closed, one after the other, and `tactemu check-host`.

Limits are for two cores with nothing else to do; the first lines say what they do at the moment, and how late a loop
is there that only waits.
"""

from __future__ import annotations

import gc
import importlib.util
import os
import subprocess
import sys
import time
from dataclasses import dataclass

from benchmarks import answers, closed_loop, control
from benchmarks.loop import lateness
from tactemu.base.clock import RealClock
from tactemu.base.low_latency import low_latency
from tactemu.base.statistics import Lateness
from tactemu.tune.timing import Report

DEVICES = 100
QUESTIONS_PER_S = 50
"""Questions for a second of the run at 1 kHz: 3,000 on each port."""
PERIOD_NS = 1_000_000
FAST_STEP_S = 0.002
"""The step of the closed loop: 500 steps a second."""
BUSY_PROCESSES = 3
CAN_LINE_MS = 0.22
"""Time that request and answer take on the bus."""


@dataclass(frozen=True)
class Figure:
    """A figure and its limit."""

    name: str
    value: float
    limit: float
    unit: str
    at_least: bool = False
    """True where the limit is a minimum."""

    @property
    def is_met(self) -> bool:
        """True if the figure keeps its limit."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def __str__(self) -> str:
        sign, met = "≥" if self.at_least else "≤", "met" if self.is_met else "NOT MET"
        return f"{met:8} {self.name:52} {self.value:10.2f} {self.unit:8} {sign} {self.limit:g}"


def run(report: Report, *, seconds: float = 60.0) -> tuple[dict[str, float], bool]:
    """Measure everything, report a line per figure as soon as it is there, and return the figures by name, and whether
    all keep their limits."""
    load, cpus = os.getloadavg()[0], os.cpu_count() or 1
    report(f"load {load:.1f} on {cpus} CPUs" + (": NOT QUIET, the limits do not hold" if load > cpus / 2 else ""))
    report(_idle_loop(seconds / 5))
    found: list[Figure] = []
    for part in (_samples, _answers, _commands, _closed_loop, _life):
        for figure in part(seconds):
            found.append(figure)
            report(str(figure))
    missed = [figure.name for figure in found if not figure.is_met]
    others = f"; not: {', '.join(missed)}" if missed else ""
    report(f"{len(found) - len(missed)} of {len(found)} limits are met{others}")
    return {figure.name: figure.value for figure in found}, not missed


def _idle_loop(seconds: float) -> str:
    """Return how late a loop at 1 kHz is that only waits: what the machine itself adds to the figures below."""
    clock, late, missed, k = RealClock(), Lateness(), 0, 0
    with low_latency():
        while k < 1000 * seconds:
            k += 1
            clock.wait(k * PERIOD_NS, [])
            behind_ns = max(0, clock.now_ns() - k * PERIOD_NS)
            late.add(behind_ns)
            missed += behind_ns // PERIOD_NS
            k += behind_ns // PERIOD_NS
    p50, p99 = (late.percentile_ns(q) / 1e3 for q in (50, 99))
    return (
        f"a loop at 1 kHz that only waits: late {p50:.0f} us (median), {p99:.0f} us (99 of 100), {missed} of {k} missed"
    )


def _samples(seconds: float) -> list[Figure]:
    late = lateness(1000.0, seconds)
    return [
        Figure("1 kHz: late, median", late["lateness_p50_us"], 120, "us"),
        Figure("1 kHz: late, 99 of 100", late["lateness_p99_us"], 250, "us"),
        Figure(f"1 kHz: missed of {late['samples'] + late['missed']:.0f}", late["missed"], 0, "samples"),
        *_served(seconds / 6),
    ]


def _served(seconds: float) -> list[Figure]:
    """Return the figures of a served device whose driver runs in the same process and makes garbage."""
    import serial

    import tactemu

    with tactemu.serve("anyskin", rate_hz=1000.0) as dev, serial.Serial(dev.port, 115_200, timeout=0.1) as port:
        statistics = dev.emulator.channels[0].statistics
        dev.wait_for_driver()
        dev.in_loop(lambda: vars(statistics).update(lateness=Lateness(), missed=0))
        before, end = gc.get_stats()[2]["collections"], time.monotonic() + seconds
        kept: list[list[bytes]] = []
        while time.monotonic() < end:
            kept.append([port.read(port.in_waiting or 1)])
        full = gc.get_stats()[2]["collections"] - before
        late = dev.stats()["skins"]["anyskin"]
    return [
        Figure("1 kHz, served in the driver's process: late, median", late["lateness_p50_us"], 250, "us"),
        Figure("1 kHz, served in the driver's process: late, 99 of 100", late["lateness_p99_us"], 1000, "us"),
        Figure("full garbage collections meanwhile", full, 0, ""),
    ]


def _answers(seconds: float) -> list[Figure]:
    found = []
    for busy, most_ms in ((0, 1.0), (BUSY_PROCESSES, 3.0)):
        words = f"beside {busy} busy processes" if busy else "quiet"
        with answers.busy_processes(busy):
            for case in answers.CASES:
                took = answers.answer_ms(case, max(20, round(seconds * QUESTIONS_PER_S)))
                line_ms = CAN_LINE_MS if case.name == "can" else 0.0
                if not busy:
                    found.append(Figure(f"answer on {case.name}, {words}: median", took["p50"], 0.15 + line_ms, "ms"))
                found.append(Figure(f"answer on {case.name}, {words}: 99 of 100", took["p99"], most_ms + line_ms, "ms"))
    return found


def _commands(seconds: float) -> list[Figure]:
    figures = control.run(lambda _: None, seconds=max(1.0, seconds / 5))
    more_us = figures["lateness_p99_us_with"] - figures["lateness_p99_us_without"]
    return [
        Figure("live command: effect, median", figures["effect_ms_p50"], 1.5, "ms"),
        Figure("live command: effect, 99 of 100", figures["effect_ms_p99"], 4, "ms"),
        Figure("live commands: later, 99 of 100", more_us, 300, "us"),
    ]


def _closed_loop(seconds: float) -> list[Figure]:
    if importlib.util.find_spec("mujoco") is None:
        return []
    found = []
    for looked_at in (False, True):
        got = closed_loop.measured(max(2.0, seconds / 5), looked_at=looked_at, step_s=FAST_STEP_S)
        words = "closed loop with a page" if looked_at else "closed loop"
        found += [
            Figure(f"{words}: rate", got["steps_per_s"], 0.99 / FAST_STEP_S, "steps/s", at_least=True),
            Figure(f"{words}: late, 99 of 100", got["lateness_p99_us"] / 1e3, 2, "ms"),
        ]
    return found


def _life(seconds: float) -> list[Figure]:
    import tactemu

    began = time.perf_counter()
    for _ in range(DEVICES):
        with tactemu.serve("anyskin"):
            pass
    served_s, began = time.perf_counter() - began, time.perf_counter()
    subprocess.run([sys.executable, "-m", "tactemu", "check-host"], stdout=subprocess.DEVNULL, check=False)
    return [
        Figure(f"{DEVICES} devices served and closed", served_s, 5, "s"),
        Figure("check-host", time.perf_counter() - began, 10, "s"),
    ]
