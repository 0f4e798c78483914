"""What a setting costs in the emulator's loop, and whether the loop then keeps its samples.

Steps come at the scene's time step and samples at the device's rate, so that the loop is busy for::

    load = steps/s * cost of a step + samples/s * cost of a sample     [of one core]

A sample costs its reading, the device's arithmetic and the wire. A step is taken in one piece: what falls due meanwhile
waits, and samples whose whole period has passed are missed, however low the load is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from firmware_protocols import Sense
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import RunOptions, assemble
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.scene.file import LoadedScene

MOST_LOAD = 0.7
"""Of one core that the loop may be busy: the rest is the machine's, and the waiting for ports."""
MOST_LOST = 0.01
"""Of its samples that a device may miss behind long steps."""
STEPS = 40
"""Steps and readings that are timed."""
WARM_UP_S, LOOK_S = 0.1, 0.2
"""How long the wire runs at the rate before it is looked at, and how long it is looked at [s], at no cost of time."""


@dataclass(frozen=True)
class Loop:
    """What the loop does for all skins of a scene besides physics, once per sample."""

    skins: int
    sample_us: float
    """Devices and wires, for a sample of every skin."""
    line_hz: float | None
    """Samples per second that the slowest wire carries; ``None``: all that were asked for."""


@dataclass(frozen=True)
class Cost:
    """What a setting costs."""

    step_us: float
    """A step in contact, median."""
    late_us: float
    """The slowest tenth of the steps begins here."""
    sample_us: float
    """A sample of every skin: readings, devices and wires."""

    def load(self, rate_hz: float, dt: float) -> float:
        """Part of one core that the loop is busy."""
        return 1e-6 * (self.step_us / dt + self.sample_us * rate_hz)

    def lost(self, rate_hz: float, dt: float) -> float:
        """Part of the samples that is missed behind slow steps: the first two that fall due are only late."""
        behind = max(0, int((self.late_us + self.sample_us) * 1e-6 * rate_hz) - 2)
        return min(1.0, behind / (rate_hz * dt))

    def keeps(self, rate_hz: float, dt: float) -> bool:
        """Does the loop keep the rate?"""
        return self.load(rate_hz, dt) <= MOST_LOAD and self.lost(rate_hz, dt) <= MOST_LOST


def stopwatch(on_cpu: bool) -> Callable[[], float]:
    """Return a clock [s]. On a CPU the thread's own time: what else the machine does now is no property of a
    setting.
    """
    return time.thread_time if on_cpu else time.perf_counter


class Still:
    """A source whose reading does not change."""

    imperfections = None

    def __init__(self, channel: Channel):
        senses = channel.device.sensed
        self._values = {sense.key: channel.source.sense(sense, 0) for sense in senses}

    def sense(self, sense: Sense, t_ns: int, ground_truth: bool = False) -> np.ndarray:
        """Return the reading."""
        return self._values[sense.key]


def measure_loop(loaded: LoadedScene, rate_hz: float, compute: str | None, moment: float) -> Loop:
    """Devices and wires of a scene at a rate, fed with what they feel ``moment`` seconds into it.

    Raises:
        TactemuError: the scene is wrong.
    """
    assembled = assemble(loaded, RunOptions(port="memory:", rate_hz=rate_hz, compute=compute))
    channels = assembled.emulator.channels
    if assembled.simulation is not None:
        assembled.simulation.step(moment)
    for channel in channels:
        channel.source = Still(channel)
    with Emulator(None, channels, clock=VirtualClock()) as emulator:
        emulator.run(WARM_UP_S + max(channel.device.boot_s for channel in channels))
        taken, dropped = _samples(channels), _dropped(channels)
        start = time.thread_time()
        emulator.run(max(LOOK_S, STEPS / rate_hz))
        spent = time.thread_time() - start
        taken = [after - before for after, before in zip(_samples(channels), taken)]
        dropped = [after - before for after, before in zip(_dropped(channels), dropped)]
    carried = min(1 - lost / max(count, 1) for lost, count in zip(dropped, taken))
    return Loop(len(channels), 1e6 * spent / max(*taken, 1), rate_hz * carried if carried < 1 else None)


def _samples(channels: list[Channel]) -> list[int]:
    return [channel.statistics.samples for channel in channels]


def _dropped(channels: list[Channel]) -> list[int]:
    """Return readings that found a channel's line full; skins on one wire share them."""
    sharing = [sum(other.wire is channel.wire for other in channels) for channel in channels]
    return [channel.wire.counters["dropped_readings"] // n for channel, n in zip(channels, sharing)]


def measure_cost(simulation, sensor, senses: str, moment: float, loop: Loop) -> Cost:
    """Steps around ``moment`` seconds into the scene, and readings of one skin's both branches."""
    clock = stopwatch(simulation.device.is_cpu)
    simulation.step(max(moment - 0.5 * STEPS * simulation.dt, 0.0))
    steps, reads = [], []
    for _ in range(STEPS):
        start = clock()
        simulation.step()
        between = clock()
        sensor.quantity(senses, ground_truth=True)
        sensor.quantity(senses)
        steps.append(1e6 * (between - start))
        reads.append(1e6 * (clock() - between))
    return Cost(median(steps), float(np.percentile(steps, 90)), loop.skins * median(reads) + loop.sample_us)
