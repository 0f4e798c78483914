"""A model on a bench: an emulator of one device with readings of its own, and all that passes on its wire.

In virtual time it shows what the model sends, and when; in real time, behind a pty or a socket, it is a sensor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_protocols import Connector, Device, Sense, WireFrame
from firmware_protocols.check.readings import reading_of
from tactemu.base.clock import Clock, VirtualClock
from tactemu.emulator.channel import Channel, StreamReadings
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.sampling import SampleClock
from tactemu.transports.memory import MemoryTransport
from tactemu.transports.transport import Transport
from tactemu.truth import Truth
from tactemu.truth.entries import Passage, Sample
from tactemu.wire.wire import Wire

NAME = "sensor"
"""The name of the device on the bench."""
MAX_PUSH_N = 20.0
"""Greatest push of readings that vary [N]: above the full scale of most taxels."""
MIN_PUSH_N = 0.003
"""Least push of such readings [N]."""
DEFAULT_PERIOD_NS = 10_000_000
"""Period of the clock of a device that has none of its own [ns]."""


@dataclass(frozen=True)
class Readings:
    """The law of the readings: rest, pushes that vary, or one specimen with its own baseline, gain and noise."""

    seed: int = 0
    varies: bool = False
    """True for pushes over the full range, new ones at each conversion, and for ambient quantities that vary."""
    baseline_n: float = 0.0
    """Push on each untouched taxel [N], spread by half of it from taxel to taxel."""
    gain: float = 1.0
    noise_n: float = 0.0
    """Standard deviation of white noise on each component of the force [N]."""
    pressed: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """Begin and end [s] of one push of 2 N on each of some taxels."""

    def forces(self, device: Device, t_ns: int) -> np.ndarray:
        """Return the force on each taxel [N], shape ``(n_taxels, 3)``."""
        n, normals = len(device.layout), device.layout.normals
        rng = np.random.default_rng([self.seed, t_ns & 0xFFFFFFFFFFFF])
        if self.varies:
            size = MIN_PUSH_N * (MAX_PUSH_N / MIN_PUSH_N) ** rng.random((n, 1))
            return size * (rng.normal(0, 0.4, (n, 3)) - normals * rng.uniform(0.2, 1, (n, 1)))
        spread = np.random.default_rng(self.seed).uniform(0.5, 1.5, (n, 1)) if self.baseline_n else 0.0
        forces = -self.baseline_n * spread * normals + rng.normal(0, 1, (n, 3)) * self.noise_n
        for taxel, (begin, end) in self.pressed.items():
            if begin <= t_ns * 1e-9 < end:
                forces[taxel] -= 2.0 * normals[taxel]
        return self.gain * forces

    def ambient(self, sense: Sense, t_ns: int) -> float | None:
        """Return a value that varies for quantities that touch does not change; ``None``: as at rest."""
        spread = {"temperature": 60.0, "acceleration": 25.0, "angular_velocity": 12.0, "load": 0.5}
        if not self.varies or sense.quantity not in spread:
            return None
        rng = np.random.default_rng([self.seed + 1, t_ns & 0xFFFFFFFFFFFF, len(sense.key)])
        return 20.0 * (sense.quantity == "temperature") + float(rng.uniform(-1, 1)) * spread[sense.quantity]


class BenchSource:
    """The source of a device's readings, by one law."""

    imperfections = None

    def __init__(self, device: Device, readings: Readings):
        self.readings = readings
        """The law; another one holds from the next conversion on."""
        self._device = device
        self._time_ns, self._values = -1, {}

    def read(self, senses: Iterable[Sense], t_ns: int) -> StreamReadings:
        """Return the readings of senses at this time."""
        if t_ns != self._time_ns:
            self._time_ns, self._values = t_ns, self._measured(t_ns)
        values = {sense.key: self._values[sense.key] for sense in senses}
        return values, values

    def _measured(self, t_ns: int) -> dict[str, np.ndarray]:
        forces, values = self.readings.forces(self._device, t_ns), {}
        for stream in self._device.periods:
            senses = self._device.senses_of(stream)
            given = {each.key: value for each in senses if (value := self.readings.ambient(each, t_ns)) is not None}
            of_stream = reading_of(self._device, forces, stream, **given).values
            values |= {each.key: _single(each, of_stream[each.key]) for each in senses}
        return values


def _single(sense: Sense, values: Any) -> np.ndarray:
    """Return one reading of a burst, which the emulator collects itself."""
    return values if sense.burst == 1 else values[..., 0]


class Log:
    """A watcher that keeps all frames and samples."""

    def __init__(self):
        self.entries: list[Passage | Sample] = []

    def put(self, entry: object) -> None:
        """Keep a frame or a sample."""
        if isinstance(entry, Passage | Sample):
            self.entries.append(entry)


class Bench:
    """A device on a bench, switched on.

    Args:
        device: the device, just made.
        connector: the port that is in use.
        readings: the law of its readings.
        shown_ns: the time of the device's own clock at power-up [ns].
        presets: values of its counters and clocks at power-up, by name.
        transport: the port; default: in memory.
        clock: default: virtual.
        skew_ppm: error of its oscillator.
    """

    def __init__(
        self,
        device: Device,
        connector: Connector,
        readings: Readings,
        *,
        shown_ns: int = 0,
        presets: Mapping[str, int] | None = None,
        transport: Transport | None = None,
        clock: Clock | None = None,
        skew_ppm: float = 0.0,
    ):
        self.device, self.log = device, Log()
        self.port = transport or MemoryTransport()
        truth = Truth()
        truth.tap(self.log)
        period = next((each for each in device.periods.values() if each), DEFAULT_PERIOD_NS)
        sampling = SampleClock(period_ns=period, shown_ns=shown_ns, skew_ppm=skew_ppm, name=NAME)
        wire = Wire(self.port, connector, truth=truth)
        self.source = BenchSource(device, readings)
        channel = Channel(NAME, device, self.source, {connector.name: wire}, sampling)
        self.emulator = Emulator(None, [channel], clock=clock or VirtualClock(), truth=truth)
        self.emulator.open()
        for name, value in (presets or {}).items():
            device.preset(name, value)

    @property
    def now_ns(self) -> int:
        """The time since power-up [ns]."""
        return self.emulator.clock.now_ns()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        self.emulator.run(seconds)
        if isinstance(self.port, MemoryTransport):
            self.port.driver.unread.clear()

    def ask(self, requests: Sequence[WireFrame], seconds: float) -> int:
        """Send requests, each ``seconds`` after the one before, and return the time of the last [ns]."""
        assert isinstance(self.port, MemoryTransport)
        sent_ns = self.now_ns
        for request in requests:
            sent_ns = self.now_ns
            self.port.driver.write(request)
            self.run(seconds)
        return sent_ns

    def close(self) -> None:
        """Switch the device off."""
        self.emulator.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
