"""The cost of a setting in the emulator's loop, and the samples that the loop loses by it.

Steps come at the scene's time step and samples at the device's rate, so that the loop uses this share of one core::

    cpu_share = steps/s * cost of a step + samples/s * cost of a sample

The cost of a sample is that of its reading, the device's arithmetic and the wire. A step cannot be interrupted: samples
that fall due meanwhile wait, and those whose period has passed by then are missed, however small the share is.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import floor, log10
from statistics import median

import numpy as np

from firmware_protocols import Sense
from tactemu.base.clock import VirtualClock
from tactemu.emulator.assembly import assemble
from tactemu.emulator.channel import Channel, StreamReadings
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.options import AssemblyOptions
from tactemu.scene.file import LoadedScene
from tactemu.tune.timing import stopwatch

MAX_CPU_SHARE = 0.7
"""Maximum share of one core that the loop may use; the remainder is left to the machine and to waiting for ports."""
MAX_LOST_SHARE = 0.01
"""Maximum share of samples that a device may miss because of long steps."""
TIMED_STEPS = 40
"""Number of steps and of readings that are timed."""
WARM_UP_S = 0.1
"""The virtual time for which the wire runs at the rate before it is timed."""
TIMED_S = 0.2
"""The virtual time for which the wire is timed."""


@dataclass(frozen=True)
class LoopCost:
    """The cost of the loop besides physics: once per sample, for all skins of a scene."""

    skins: int
    sample_us: float
    """The time of devices and wires for one sample of every skin."""
    line_hz: float | None
    """The samples per second that the slowest wire carries; None: it carries the required rate."""


@dataclass(frozen=True)
class Cost:
    """The measured times of a setting."""

    step_us: float
    """The median time of a step in contact."""
    late_us: float
    """The 90th percentile of a step's time."""
    sample_us: float
    """The time of one sample of every skin: readings, devices and wires."""

    def cpu_share(self, rate_hz: float, dt: float) -> float:
        """Return the share of one core that the loop uses."""
        return 1e-6 * (self.step_us / dt + self.sample_us * rate_hz)

    def lost_share(self, rate_hz: float, dt: float) -> float:
        """Return the share of samples missed because of slow steps; the first two that fall due are only late."""
        behind = max(0, int((self.late_us + self.sample_us) * 1e-6 * rate_hz) - 2)
        return min(1.0, behind / (rate_hz * dt))

    def keeps_rate(self, rate_hz: float, dt: float) -> bool:
        """Return True if the loop keeps the rate."""
        return self.cpu_share(rate_hz, dt) <= MAX_CPU_SHARE and self.lost_share(rate_hz, dt) <= MAX_LOST_SHARE

    def highest_rate_hz(self, dt: float) -> float:
        """Return nearly the highest rate that the loop keeps, in two digits [Hz]; 0: its steps alone are too much."""
        rate = (1e6 * MAX_CPU_SHARE - self.step_us / dt) / self.sample_us
        while rate >= 1:
            digit = 10.0 ** (floor(log10(rate)) - 1)
            if self.keeps_rate(rounded := digit * floor(rate / digit), dt):
                return rounded
            rate *= 0.95
        return 0.0


class ConstantSource:
    """A source of readings that always returns the first one."""

    imperfections = None

    def __init__(self, channel: Channel):
        _, self._values = channel.source.read(channel.device.sensed, 0)

    def read(self, senses: Iterable[Sense], t_ns: int) -> StreamReadings:
        """Return the constant readings of senses."""
        values = {sense.key: self._values[sense.key] for sense in senses}
        return values, values


def measure_loop(loaded: LoadedScene, rate_hz: float, device: str | None, moment: float) -> LoopCost:
    """Time the devices and wires of a scene at a rate, fed with their readings at ``moment`` seconds.

    Raises:
        TactemuError: the scene is invalid.
    """
    assembled = assemble(loaded, AssemblyOptions(port="memory:", rate_hz=rate_hz, device=device))
    channels = assembled.emulator.channels
    if assembled.simulation is not None:
        assembled.simulation.step(dt=moment)
    for channel in channels:
        channel.source = ConstantSource(channel)
    with Emulator(None, channels, clock=VirtualClock()) as emulator:
        emulator.run(WARM_UP_S + max(channel.device.boot_s for channel in channels))
        taken, dropped = _samples(channels), _dropped(channels)
        start = time.thread_time()
        emulator.run(max(TIMED_S, TIMED_STEPS / rate_hz))
        spent = time.thread_time() - start
        taken = [after - before for after, before in zip(_samples(channels), taken)]
        dropped = [after - before for after, before in zip(_dropped(channels), dropped)]
    carried = min(1 - lost / max(count, 1) for lost, count in zip(dropped, taken))
    return LoopCost(len(channels), 1e6 * spent / max(*taken, 1), rate_hz * carried if carried < 1 else None)


def _samples(channels: Sequence[Channel]) -> list[int]:
    return [channel.statistics.samples for channel in channels]


def _dropped(channels: Sequence[Channel]) -> list[int]:
    """Return the number of readings that each channel dropped on a full line; skins on one wire share it equally."""
    sharing = [sum(other.wire is channel.wire for other in channels) for channel in channels]
    return [channel.wire.counters["dropped_readings"] // n for channel, n in zip(channels, sharing)]


def measure_cost(simulation, sensor, senses: str, moment: float, loop: LoopCost) -> Cost:
    """Time steps around ``moment`` seconds, and the ideal and measured readings of one skin."""
    clock = stopwatch(simulation.device.is_cpu)
    simulation.step(dt=max(moment - 0.5 * TIMED_STEPS * simulation.dt, 0.0))
    steps, reads = [], []
    for _ in range(TIMED_STEPS):
        start = clock()
        simulation.step()
        between = clock()
        sensor.quantity(senses, ground_truth=True)
        sensor.quantity(senses)
        steps.append(1e6 * (between - start))
        reads.append(1e6 * (clock() - between))
    return Cost(median(steps), float(np.percentile(steps, 90)), loop.skins * median(reads) + loop.sample_us)
