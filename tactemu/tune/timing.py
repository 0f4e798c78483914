"""The clock of all benchmarks, the time of a step, and the type of what receives their lines of text."""

from __future__ import annotations

import time
from collections.abc import Callable

import warp as wp

from tactemu.sensors.simulation import Simulation

Report = Callable[[str], None]
"""Receives one line of text at a time."""


def stopwatch(on_cpu: bool) -> Callable[[], float]:
    """Return a clock [s]: on a CPU that of the thread's own processor time, so that other processes do not count."""
    return time.thread_time if on_cpu else time.perf_counter


def timed_step(sim: Simulation) -> float:
    """Return the time of a step [s]; a GPU is waited for.

    On one thread of a CPU it is the thread's processor time, so that other processes do not count.
    """
    clock = stopwatch(sim.device.is_cpu and sim.plan.threads == 1)
    start = clock()
    sim.step()
    wp.synchronize_device(sim.device)
    return clock() - start
