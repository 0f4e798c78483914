"""One device on one wire: what it samples, when, and through what its frames leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from firmware_protocols import Device, Reading
from tactemu.sampling import SampleClock
from tactemu.scene.placement import Surroundings
from tactemu.statistics import ChannelStatistics
from tactemu.wire.wire import Wire

if TYPE_CHECKING:
    from tactemu.imperfections import Imperfections


class Source(Protocol):
    """What a device samples: a sensor of a simulation, or a recording."""

    @property
    def imperfections(self) -> Imperfections | None:
        """What spoils its readings, to be changed while it runs; ``None`` for a recording."""
        ...

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """The latest reading of environment 0, shape ``(n_taxels,)`` or ``(n_taxels, 3)``, SI, link frame."""
        ...


@dataclass
class Channel:
    """One device: its source on one side, its wire on the other."""

    name: str
    device: Device
    source: Source
    wire: Wire
    sampling: SampleClock
    surroundings: Callable[[int], Surroundings] = lambda t_ns: Surroundings()
    """Temperature, acceleration and turning of the device at a time [ns]."""
    statistics: ChannelStatistics = field(default_factory=ChannelStatistics)
    count: int = 1
    """Number of the next sample."""
    silent_until_ns: int = 0
    """The device boots or hangs until then: it neither samples nor hears."""

    @property
    def due_ns(self) -> int:
        """When the next sample is taken."""
        return self.sampling.due_ns(self.count)

    def local_ns(self, t_ns: int) -> int:
        """What the device's own clock shows at a time: its firmware knows no other."""
        return self.sampling.local_ns(t_ns)

    def restart(self, now_ns: int) -> None:
        """The device's period was changed: count samples anew from now."""
        self.sampling = self.sampling.restarted(now_ns, self.device.period_ns)
        self.count = 1

    def reading(self, t_ns: int, values: np.ndarray) -> Reading:
        """What the device's transducers see at ``t_ns``: the touch, and its surroundings."""
        around = self.surroundings(t_ns)
        return Reading(
            t_ns=t_ns,
            values=values,
            temperature=around.temperature,
            acceleration=around.acceleration,
            angular_velocity=around.angular_velocity,
        )
