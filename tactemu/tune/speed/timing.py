"""What all benchmarks share: where their lines of text go, and how long a step takes."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp

from tactemu.sensors.simulation import Simulation
from tactemu.tune.cost import stopwatch

Report = Callable[[str], None]
"""Gets one line of text at a time."""


def timed_step(sim: Simulation) -> float:
    """Return time of a step [s], waited for on a GPU; on one thread of a CPU that of the thread, so that other work
    does not count."""
    clock = stopwatch(sim.device.is_cpu and sim.plan.threads == 1)
    start = clock()
    sim.step()
    wp.synchronize_device(sim.device)
    return clock() - start
