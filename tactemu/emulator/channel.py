"""One device in time: what it samples, when, and through which wires its frames leave.

The channel owns the sampling period of each stream: the user's wish, else what the firmware last set.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from firmware_protocols import Device, Reading, Sense, calls
from tactemu.base.errors import DeviceError, SceneError
from tactemu.base.statistics import ChannelStatistics
from tactemu.emulator.sampling import SampleClock
from tactemu.wire.wire import Wire

if TYPE_CHECKING:
    from tactemu.imperfections import Imperfections
    from tactemu.scene.placement import JoinedImperfections


class Source(Protocol):
    """What a device's transducers sense: a sensor of a simulation, a recording, or the user's own."""

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """What spoils its readings, to be changed while it runs; ``None`` for a recording."""
        ...

    def sense(self, sense: Sense, t_ns: int, ground_truth: bool = False) -> np.ndarray:
        """What one sense sees at ``t_ns``, to which the simulation has been brought; SI, shape by its quantity."""
        ...


StreamReadings = tuple[dict[str, np.ndarray], dict[str, np.ndarray]]
"""What the senses of a stream see, ideal and measured, by key."""
SampledReadings = dict[tuple, StreamReadings]
"""By device, time and keys."""


@dataclass
class StreamTimer:
    """When one stream of a device converts."""

    sampling: SampleClock
    running: bool = False
    """Off: the firmware has no period for it, or has not booted."""
    count: int = 1
    """Number of the next conversion since counting began."""
    burst: int = 1
    """Looks at the skin per conversion, evenly over its period."""
    readings: list[StreamReadings] = field(default_factory=list)
    """What was seen so far of the next conversion."""
    due_ns: int = 0
    """When the skin is looked at next; the loop asks for it at every turn."""

    def __post_init__(self):
        if self.burst < 1 or len(self.readings) >= self.burst:
            raise ValueError(f"expected fewer sampled than {self.burst} of a conversion, got {len(self.readings)}")

    def start(self, now_ns: int, period_ns: int) -> None:
        """Count anew from now."""
        self.sampling = self.sampling.restarted(now_ns, period_ns)
        self.running = True
        self._schedule(1)

    def next(self, missed: int) -> None:
        """On to the conversion after the one due, and after those whose time has wholly passed."""
        self._schedule(self.count + 1 + missed)

    def add_reading(self, read: StreamReadings) -> None:
        """One look of several of the conversion that is due."""
        self._schedule(self.count, [*self.readings, read])

    def _schedule(self, count: int, seen: Sequence[StreamReadings] = ()) -> None:
        count = self.sampling.first_taken(count) if self.sampling.missed else count
        self.count, self.readings = count, list(seen)
        self.due_ns = self.sampling.due_ns(count)
        if left := self.burst - 1 - len(seen):
            self.due_ns -= (self.due_ns - self.sampling.due_ns(count - 1)) * left // self.burst


@dataclass
class Channel:
    """One device: its source on one side, its wires on the other.

    Raises:
        DeviceError: a wish for a stream that the device does not have, or for one of several without its name.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("name", "wanted_periods", "_ports", "_senses")

    name: str
    device: Device
    source: Source
    wires: dict[str, Wire]
    """By the name of the device's port."""
    sampling: SampleClock
    """The device's oscillator, and how late its frames leave."""
    wanted_periods: Mapping[str, int] = field(default_factory=dict)
    """Sampling periods that the user wants, by stream [ns]; they beat the firmware's and survive every restart."""
    statistics: ChannelStatistics = field(default_factory=ChannelStatistics)
    silent_until_ns: int = 0
    """The device boots or hangs until then: it neither samples nor hears."""
    power_cycles: int = 0
    """How often it has powered up: what was planned in an earlier life does not happen."""
    refresh_ns: int = 0
    """How often what it reads is renewed: between, it reads the same again; 0: always."""
    samples: int = 0
    """Number of the next sample, over all lives and streams; 0 is the one taken at boot."""

    def __post_init__(self):
        self.alarm_ns: int | None = None
        """When the device's own clock wakes it."""
        self.held_readings: dict[str, tuple[int, dict[str, np.ndarray]]] = {}
        """By stream, what was read at the last refresh, and the number of that."""
        self._ports = self.device.ports
        timers: dict[str, StreamTimer] = {}
        self.timers: Mapping[str, StreamTimer] = timers
        """By stream."""
        self._read_senses()
        for stream in self.device.periods:
            name = f"{self.sampling.name}/{stream}" if stream else self.sampling.name
            burst = max((sense.burst for sense in self._senses[stream]), default=1)
            timers[stream] = StreamTimer(replace(self.sampling, name=name), burst=burst)
        for stream in self.wanted_periods:
            if stream not in self.device.periods:
                named = [name for name in self.device.periods if name]
                has = f"has the streams {', '.join(named)}" if named else "has one stream; give the rate alone"
                raise DeviceError(f"{self.name}: rate_hz: no stream {stream!r}: {self.device.name} {has}")

    def _read_senses(self) -> None:
        """What its streams sense, which does not change while it has power."""
        self._senses = {stream: self.device.senses_of(stream) for stream in self.device.periods}

    @property
    def wire(self) -> Wire:
        """The wire of its first port that is plugged in."""
        return next(iter(self.wires.values()))

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections:
        """What spoils its readings.

        Raises:
            SceneError: they are a recording, which has no imperfections of ours.
        """
        if self.source.imperfections is None:
            raise SceneError(
                f"skin {self.name!r}: its readings are not simulated; only faults, hang and reset befall it"
            )
        return self.source.imperfections

    # -- time ----------------------------------------------------------------------------------------------------------

    def local_ns(self, t_ns: int) -> int:
        """What the device's own clock shows at a time: its firmware knows no other."""
        return self.sampling.local_ns(t_ns)

    def period_ns(self, stream: str) -> int:
        """Return the sampling period in force [ns]; 0 when the firmware has the stream off."""
        own = self.device.periods[stream]
        return self.wanted_periods.get(stream, own) if own else 0

    def rates_hz(self) -> dict[str, float]:
        """Return the sampling rate in force, by stream."""
        return {name: 1e9 / period if (period := self.period_ns(name)) else 0.0 for name in self.timers}

    def begin(self, now_ns: int) -> None:
        """The device has booted: every stream counts from now."""
        for stream, timer in self.timers.items():
            if period := self.period_ns(stream):
                timer.start(now_ns, period)

    def halt(self) -> None:
        """The device has restarted: nothing is sampled until :meth:`begin`."""
        self.alarm_ns = None
        self.held_readings.clear()
        self._read_senses()
        self.attach_wires()
        for timer in self.timers.values():
            timer.running = False

    def apply_changes(self, now_ns: int) -> None:
        """After a call into the device: its periods and line settings may have changed."""
        for stream, timer in self.timers.items():
            period = self.period_ns(stream)
            if not period:
                timer.running = False
            elif not timer.running or period != timer.sampling.period_ns:
                timer.start(now_ns, period)
        if self.device.ports is not self._ports:
            self.attach_wires()

    def defer_statistics(self, injected: Counter[str]) -> Callable[[], dict[str, Any]]:
        """What gives the statistics and counters of this device as they are now, as plain data; other threads than the
        loop's may call it. ``injected``: the faults that befell it, by name."""
        statistics = self.statistics.copy()
        counts = {
            "wire": sum((wire.counters for wire in self.wires.values()), Counter()),
            "device": Counter(self.device.counters),
            "injected": injected,
        }
        return lambda: {
            "skin": self.name,
            **statistics.as_dict(),
            **{name: dict(sorted(each.items())) for name, each in counts.items()},
        }

    def attach_wires(self) -> None:
        """Tell the wires what is plugged into them."""
        self._ports = self.device.ports
        for port, wire in self.wires.items():
            wire.attach(self.name, self.device.connector(port))

    def after_restore(self) -> None:
        """A state was restored: its wires have the settings that they had then."""
        self._ports = self.device.ports

    def due(self, now_ns: int) -> list[tuple[int, str]]:
        """Streams whose time has come, with that time."""
        return [(each.due_ns, name) for name, each in self.timers.items() if each.running and each.due_ns <= now_ns]

    def next_due_ns(self) -> int | None:
        """When the next of its streams converts."""
        return min([timer.due_ns for timer in self.timers.values() if timer.running], default=None)

    # -- calls into the device -----------------------------------------------------------------------------------------

    def read(self, stream: str, t_ns: int, sampled: SampledReadings | None = None) -> StreamReadings:
        """What the senses of one stream see at ``t_ns``, to which the simulation has been brought.

        ``sampled`` are those taken since anything changed: boards that sample together share one.
        """
        senses, source = self._senses[stream], self.source
        key = (self.name, t_ns, *[sense.key for sense in senses])
        if sampled is not None and key in sampled:
            return sampled[key]
        ideal = {sense.key: source.sense(sense, t_ns, True) for sense in senses}
        seen = ideal, {sense.key: source.sense(sense, t_ns) for sense in senses}
        if self.refresh_ns:
            seen = ideal, self._refreshed(stream, t_ns, seen[1])
        if sampled is not None:
            sampled[key] = seen
        return seen

    def _refreshed(self, stream: str, t_ns: int, measured: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What a register holds that is renewed once in each refresh, by the first look."""
        number = self.local_ns(t_ns) // self.refresh_ns
        if stream not in self.held_readings or self.held_readings[stream][0] != number:
            self.held_readings[stream] = number, {key: np.array(values) for key, values in measured.items()}
        return self.held_readings[stream][1]

    def complete_conversion(self, stream: str, last: StreamReadings) -> StreamReadings:
        """Return a conversion that ends with the look ``last``: senses with a burst have a last axis of all looks."""
        timer = self.timers[stream]
        if timer.burst == 1:
            return last
        sampled = [*timer.readings, last]
        sampled = [last] * (timer.burst - len(sampled)) + sampled  # none before: at boot, or asked for out of turn
        bursts = {sense.key: sense.burst for sense in self._senses[stream]}
        ideal, measured = (
            {
                key: np.stack([read[side][key] for read in sampled], -1) if n > 1 else last[side][key]
                for key, n in bursts.items()
            }
            for side in (0, 1)
        )
        return ideal, measured

    def measure(self, stream: str, measured: Mapping[str, np.ndarray], stamp_ns: int) -> Any:
        """Return one conversion; returns the device's counts.

        Raises:
            DeviceError: the device raised, or returned no array.
        """
        try:
            return calls.measure(self.device, Reading(measured, stream), stamp_ns)
        except calls.AuthorError as error:
            raise DeviceError(str(error)) from error

    def call(self, method: str, *args: Any) -> Sequence[Any]:
        """Call ``stream``, ``receive``, ``lines``, ``boot`` or ``wake``; returns its outs, checked.

        Raises:
            DeviceError: the device raised or returned what cannot be sent; names method, input, file and line.
        """
        port = args[2] if method == "receive" else args[3] if method == "lines" else ""
        try:
            return calls.transmissions(self.device, method, *args, port=port)
        except calls.AuthorError as error:
            raise DeviceError(str(error)) from error
