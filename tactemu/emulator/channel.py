"""One device in time: the readings that it samples, their times, and the wires through which its frames leave.

The channel owns the sampling period of each stream: the user's setting, else that of the firmware.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from firmware_protocols import Device, Reading, Sense, calls
from tactemu.base.errors import DeviceError, SceneError, no_such
from tactemu.base.statistics import ChannelStatistics
from tactemu.emulator.sampling import SampleClock
from tactemu.wire.wire import Wire

if TYPE_CHECKING:
    from tactemu.imperfections import Imperfections
    from tactemu.scene.placement import JoinedImperfections


StreamReadings = tuple[dict[str, np.ndarray], dict[str, np.ndarray]]
"""The readings of a stream's senses, ideal and measured, by the sense's key."""
SampledReadings = dict[tuple, StreamReadings]
"""The readings of one turn, by device, time and the keys of the senses."""


class Source(Protocol):
    """The source of a device's readings: a sensor of a simulation, a recording, or the user's function."""

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections | None:
        """The imperfections of the readings, which can change while it runs; ``None`` for a recording."""
        ...

    def read(self, senses: Iterable[Sense], t_ns: int) -> StreamReadings:
        """Return the readings of senses at ``t_ns``, the time of the simulation; SI, shape by their quantities."""
        ...


@dataclass
class StreamTimer:
    """The times at which one stream of a device converts."""

    sampling: SampleClock
    running: bool = False
    """False if the firmware has no period for the stream, or has not booted."""
    count: int = 1
    """Number of the next conversion since counting began."""
    burst: int = 1
    """Number of readings per conversion, evenly spaced over its period."""
    readings: list[StreamReadings] = field(default_factory=list)
    """The readings so far of the next conversion."""
    due_ns: int = 0
    """Time of the next reading, kept here because the loop compares it at every turn."""

    def __post_init__(self):
        if self.burst < 1 or len(self.readings) >= self.burst:
            raise ValueError(f"expected fewer than {self.burst} readings of a conversion, got {len(self.readings)}")

    def start(self, now_ns: int, period_ns: int) -> None:
        """Restart the count from now."""
        self.sampling = self.sampling.restarted(now_ns, period_ns)
        self.running = True
        self._schedule(1)

    def next(self, missed: int) -> None:
        """Continue with the next conversion, after ``missed`` ones that are skipped."""
        self._schedule(self.count + 1 + missed)

    def add_reading(self, read: StreamReadings) -> None:
        """Add one of several readings of the conversion that is due."""
        self._schedule(self.count, [*self.readings, read])

    def _schedule(self, count: int, seen: Sequence[StreamReadings] = ()) -> None:
        count = self.sampling.first_taken(count) if self.sampling.missed else count
        self.count, self.readings = count, list(seen)
        self.due_ns = self.sampling.due_ns(count)
        if left := self.burst - 1 - len(seen):
            self.due_ns -= (self.due_ns - self.sampling.due_ns(count - 1)) * left // self.burst


@dataclass
class Channel:
    """One device with its source and its wires.

    Raises:
        DeviceError: a period is given for a stream that the device does not have, or for one of several without name.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("name", "wanted_periods", "_applied_periods", "_ports", "_senses")

    name: str
    device: Device
    source: Source
    wires: dict[str, Wire]
    """The wires, by the name of the device's port."""
    sampling: SampleClock
    """The device's oscillator, and the delay of its frames."""
    wanted_periods: Mapping[str, int] = field(default_factory=dict)
    """The user's sampling periods, by stream [ns]; they override the firmware's and survive every restart."""
    statistics: ChannelStatistics = field(default_factory=ChannelStatistics)
    silent_until_ns: int = 0
    """Time until which the device boots or hangs: it neither samples nor receives."""
    power_cycles: int = 0
    """Number of times that the device has powered up; actions of an earlier power cycle are void."""
    refresh_ns: int = 0
    """Period at which the device's registers are refreshed; between, they keep their values; 0: always fresh."""
    samples: int = 0
    """Number of the next sample, over all power cycles and streams; 0 is the one taken at boot."""

    def __post_init__(self):
        self.alarm_ns: int | None = None
        """The device's own time at which it has asked to be woken."""
        self.held_readings: dict[str, tuple[int, dict[str, np.ndarray]]] = {}
        """The number of the last refresh and its readings, by stream."""
        self._ports = self.device.ports
        self._applied_periods: dict[str, int] = {}
        """The firmware's periods by which the timers run; empty: unknown."""
        timers: dict[str, StreamTimer] = {}
        self.timers: Mapping[str, StreamTimer] = timers
        """The timers, by stream."""
        self._read_senses()
        for stream in self.device.periods:
            name = f"{self.sampling.name}/{stream}" if stream else self.sampling.name
            burst = max((sense.burst for sense in self._senses[stream]), default=1)
            timers[stream] = StreamTimer(replace(self.sampling, name=name), burst=burst)
        for stream in self.wanted_periods:
            if stream not in self.device.periods:
                named = [name for name in self.device.periods if name]
                alone = f"no stream {stream!r}: {self.device.name} has one stream; give the rate alone"
                raise DeviceError(f"{self.name}: rate_hz: {no_such('stream', stream, named) if named else alone}")

    def _read_senses(self) -> None:
        """Read the senses of the streams, which are constant while the device has power."""
        self._senses = {stream: self.device.senses_of(stream) for stream in self.device.periods}

    @property
    def wire(self) -> Wire:
        """The wire of the first port in use."""
        return next(iter(self.wires.values()))

    @property
    def imperfections(self) -> Imperfections | JoinedImperfections:
        """The imperfections of the readings.

        Raises:
            SceneError: the readings are not simulated.
        """
        if self.source.imperfections is None:
            raise SceneError(f"skin {self.name!r}: its readings are not simulated; inject only faults, hang and reset")
        return self.source.imperfections

    # -- time ----------------------------------------------------------------------------------------------------------

    def local_ns(self, t_ns: int) -> int:
        """Return the time of the device's own clock, the only one that its firmware has."""
        return self.sampling.local_ns(t_ns)

    def period_ns(self, stream: str) -> int:
        """Return the sampling period in force [ns]; 0 if the firmware has switched the stream off."""
        own = self.device.periods[stream]
        return self.wanted_periods.get(stream, own) if own else 0

    def rates_hz(self) -> dict[str, float]:
        """Return the sampling rate in force, by stream."""
        return {name: 1e9 / period if (period := self.period_ns(name)) else 0.0 for name in self.timers}

    def begin(self, now_ns: int) -> None:
        """Start the timer of every stream when the device has booted."""
        for stream, timer in self.timers.items():
            if period := self.period_ns(stream):
                timer.start(now_ns, period)

    def halt(self) -> None:
        """Stop all timers when the device restarts; it samples again after :meth:`begin`."""
        self.alarm_ns = None
        self._applied_periods = {}
        self.held_readings.clear()
        self._read_senses()
        self.attach_wires()
        for timer in self.timers.values():
            timer.running = False

    def apply_changes(self, now_ns: int) -> None:
        """Apply the periods and line settings that a call into the device may have changed."""
        if self.device.periods != self._applied_periods:
            self._apply_periods(now_ns)
        if self.device.ports is not self._ports:
            self.attach_wires()

    def want_periods(self, periods: Mapping[str, int], now_ns: int) -> None:
        """Set the user's sampling periods, by stream [ns]; those of other streams are the firmware's."""
        self.wanted_periods = periods
        self._apply_periods(now_ns)

    def _apply_periods(self, now_ns: int) -> None:
        self._applied_periods = dict(self.device.periods)
        for stream, timer in self.timers.items():
            period = self.period_ns(stream)
            if not period:
                timer.running = False
            elif not timer.running or period != timer.sampling.period_ns:
                timer.start(now_ns, period)

    def defer_statistics(self, injected: Counter[str]) -> Callable[[], dict[str, Any]]:
        """Return a function that returns the present statistics and counters of this device as plain data; another
        thread than the loop's may call it. ``injected`` counts the injected faults, by name."""
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
        """Attach the device's connectors to their wires."""
        self._ports = self.device.ports
        for port, wire in self.wires.items():
            wire.attach(self.name, self.device.connector(port))

    def prepare_restore(self, state: Mapping[str, Any]) -> Callable[[], None]:
        """Return a callable that keeps the restored settings of the wires: the connectors need no second attachment."""
        return lambda: vars(self).update(_ports=self.device.ports, _applied_periods={})

    def due(self, now_ns: int) -> list[tuple[int, str]]:
        """Return the streams whose next reading is due, with its time."""
        return [(each.due_ns, name) for name, each in self.timers.items() if each.due_ns <= now_ns and each.running]

    def next_due_ns(self) -> int | None:
        """Return the time of the next reading of any stream; ``None`` if none is running."""
        return min([timer.due_ns for timer in self.timers.values() if timer.running], default=None)

    # -- calls into the device -----------------------------------------------------------------------------------------

    def read(self, stream: str, t_ns: int, sampled: SampledReadings | None = None) -> StreamReadings:
        """Return the readings of a stream's senses at ``t_ns``, the time of the simulation.

        ``sampled`` has the readings of this turn: streams with the same senses and time share one.
        """
        senses = self._senses[stream]
        if sampled is None or len(self.timers) == 1:
            return self._read(stream, senses, t_ns)
        key = (self.name, t_ns, *[sense.key for sense in senses])
        if key not in sampled:
            sampled[key] = self._read(stream, senses, t_ns)
        return sampled[key]

    def _read(self, stream: str, senses: Sequence[Sense], t_ns: int) -> StreamReadings:
        ideal, measured = self.source.read(senses, t_ns)
        return ideal, self._refreshed(stream, t_ns, measured) if self.refresh_ns else measured

    def _refreshed(self, stream: str, t_ns: int, measured: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the first readings in the present refresh period, which the registers keep until the next one."""
        number = self.local_ns(t_ns) // self.refresh_ns
        if stream not in self.held_readings or self.held_readings[stream][0] != number:
            self.held_readings[stream] = number, {key: np.array(values) for key, values in measured.items()}
        return self.held_readings[stream][1]

    def complete_conversion(self, stream: str, last: StreamReadings) -> StreamReadings:
        """Return the conversion that ends with the reading ``last``; the readings of a burst are stacked along a last
        axis."""
        timer = self.timers[stream]
        if timer.burst == 1:
            return last
        sampled = [*timer.readings, last]
        sampled = [last] * (timer.burst - len(sampled)) + sampled  # no earlier readings: at boot, or outside the period
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
        """Return the device's counts of one conversion.

        Raises:
            DeviceError: the device raised, or returned no array.
        """
        try:
            return calls.measure(self.device, Reading(measured, stream), stamp_ns)
        except calls.AuthorError as error:
            raise DeviceError(str(error)) from error

    def call(self, method: str, *args: Any) -> Sequence[Any]:
        """Call ``stream``, ``receive``, ``lines``, ``boot`` or ``wake``; return what the device transmits, checked.

        Raises:
            DeviceError: the device raised, or returned what no port can carry; names method, input, file and line.
        """
        port = args[2] if method == "receive" else args[3] if method == "lines" else ""
        try:
            return calls.transmissions(self.device, method, *args, port=port)
        except calls.AuthorError as error:
            raise DeviceError(str(error)) from error
