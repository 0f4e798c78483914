"""The loop: read this file first.

::

    scene ─▶ contact ─▶ sensor ─▶ imperfections ─▶ sampling ─▶ device ─▶ wire ─▶ transport ═══ driver under test
                                                                  ▲                      │
                                                                  └────── commands ◀─────┘

One thread and one clock. :meth:`Emulator.step` is the picture: what the driver sent goes to the devices, every stream
of a device whose time has come takes a sample of the simulation, what the wires have due is written, and then others
may have something done. Deadlines are absolute integer nanoseconds; nothing here knows which device, sensor model or
transport it runs.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from firmware_protocols import Convert, Counts, Restart
from firmware_protocols.can_frames import CanFrames
from tactemu.base.agenda import Action, Agenda, ScheduledCallback
from tactemu.base.calls import Calls
from tactemu.base.clock import Clock, RealClock
from tactemu.emulator.channel import Channel, SampledReadings, Source
from tactemu.transports.transport import Closed, Event, LinesChanged, Noted, Opened, SettingChanged
from tactemu.truth import Truth
from tactemu.wire.wire import ReceivedData, Wire

if TYPE_CHECKING:
    from tactemu.plan.plan import Plan


MAX_LAG_NS = 10_000_000_000
"""Longest time that the simulation makes up in whole steps when nothing has asked for it; bounds the wait of whatever
asks after a long idle time."""
_SAMPLING_NS = 1_000_000
"""After so long what is due of others leaves before the next sample is taken."""


class Simulated(Protocol):
    """What the loop asks of a simulation: to be brought up to a time."""

    time_ns: int

    @property
    def plan(self) -> Plan | None:
        """What a step computes; ``None`` where nothing is simulated."""
        ...

    @property
    def dt_ns(self) -> int:
        """Length of a step."""
        ...

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Step until no whole step fits before ``t_ns``; true if a step was stretched to keep to ``max_steps``."""
        ...


class Emulator:
    """Runs devices on their wires against one simulation.

    Args:
        simulation: brought up to each sample's time; ``None`` when every source is a recording.
        channels: the devices. Several may share a :class:`~tactemu.wire.wire.Wire` (a CAN bus, an RS-485 line).
        clock: real time by default; a :class:`~tactemu.base.clock.VirtualClock` runs as fast as it can.
        truth: where samples, frames and faults are logged.
        catch_up_steps: a loop that is late by a period takes at most so many simulation steps for one sample.
        recipe: what it was assembled from, as plain data: a state of another is refused by what differs.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = (
        "catch_up_steps", "clock", "look_ahead_ns", "recipe", "_calls", "_channels", "_is_restored", "_stop_requested",
    )  # fmt: skip

    def __init__(
        self,
        simulation: Simulated | None,
        channels: Iterable[Channel],
        *,
        clock: Clock | None = None,
        truth: Truth | None = None,
        catch_up_steps: int = 50,
        recipe: Mapping[str, Any] | None = None,
    ):
        self.recipe = recipe or {}
        self.catch_up_steps = catch_up_steps
        self.simulation = simulation
        self.channels = list(channels)
        self.wires = list(dict.fromkeys(wire for channel in self.channels for wire in channel.wires.values()))
        for wire in self.wires:
            wire.name = wire.name or "+".join(c.name for c in self.channels if wire in c.wires.values())
        self.clock: Clock = clock or RealClock()
        self.truth = truth or Truth()
        self._stop_requested = False
        self.now_ns = 0
        """Time of the turn: what happens in it happens then."""
        self.look_ahead_ns: int | None = None
        """In real time the simulation is at most so far ahead (or a step, if that is longer); ``None``: any way."""
        self._channels = {channel.name: channel for channel in self.channels}
        self._agenda: Agenda[Action | ScheduledCallback] = Agenda(self._is_valid)
        self._outbox: Agenda[Action] = Agenda(self._is_valid)
        """Samples until their release times."""
        self._calls = Calls()
        self._is_restored = False
        """Whether it goes on from a state, rather than from power-up."""

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open every port, or none; time starts here.

        Raises:
            TransportError: a port cannot be made; those already open are closed again.
            DeviceError: a device cannot be started.
        """
        try:
            for channel in self.channels:
                channel.attach_wires()
            for wire in self.wires:
                wire.is_paused, wire.is_real_time = self.clock.is_paused, not self.clock.virtual
                wire.open()
            self._calls.open()
            self.clock.start()
            if self._is_restored:
                self.clock.set_ns(self.now_ns)
            else:  # the same moments, whatever the clock
                self.now_ns = self.clock.now_ns() if self.clock.virtual else 0
            self.truth.begin(self.clock.origin_ns, block_when_full=self.clock.virtual)
            for channel in () if self._is_restored else self.channels:
                self._power_on(channel)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Remove every port. Safe to call twice."""
        for wire in self.wires:
            wire.close()
        self._calls.close()
        self.truth.close(self.summary())

    def summary(self) -> list[dict[str, Any]]:
        """What each device has done: samples, what became of frames both ways, what was injected."""
        return [channel.defer_statistics(self.truth.injected_at(channel.name))() for channel in self.channels]

    def _power_on(self, channel: Channel) -> None:
        """The device loses its memory and boots; until then it neither samples nor hears."""
        now = self.now_ns
        if channel.power_cycles:
            channel.device.power_cycle()
        channel.power_cycles += 1
        channel.halt()
        booted = channel.silent_until_ns = now + round(channel.device.boot_s * 1e9)
        if booted > now:
            self._later(channel, booted, "boot", booted)
        else:
            self._boot(channel, now)

    def _boot(self, channel: Channel, now: int) -> None:
        """One conversion of everything that nobody asked for, the banner, and then the periods."""
        for stream in channel.timers:
            self._convert(channel, stream, now, channel.local_ns(now))
        channel.begin(now)
        self._call(channel, now, "boot", channel.local_ns(now))

    def run(self, seconds: float | None = None) -> None:
        """Run for ``seconds`` of emulation time, or until :meth:`stop`, also one that came before."""
        end = None if seconds is None else self.clock.now_ns() + round(seconds * 1e9)
        try:
            while not self._stop_requested and (end is None or self.clock.now_ns() < end):
                self.step(end)
        finally:
            self._stop_requested = False

    def stop(self) -> None:
        """Leave :meth:`run` after the current turn, or the next one at once. Call it from anywhere, also from a signal
        handler or another thread."""
        self._stop_requested = True
        self.call(lambda: None)

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()

    # -- the picture ------------------------------------------------------------------------------------------------

    def step(self, end_ns: int | None = None) -> None:
        """One turn: commands in, samples taken, frames out, calls, then wait for whatever comes next."""
        now = self.now_ns = self.clock.now_ns()
        self.run_due_actions()
        for wire in self.wires:
            self._receive(wire, now)
            if not self.clock.virtual:  # an answer does not wait for the physics of a sample
                wire.flush(self.clock.now_ns())
        sampled: SampledReadings = {}
        sent_ns = now
        for channel, stream in self._due(now):
            self._sample(channel, stream, now, sampled)
            if not self.clock.virtual and self.clock.now_ns() - sent_ns > _SAMPLING_NS:
                self._send_due(now)  # what is ready of some boards does not wait for the samples of many others
                sent_ns = self.clock.now_ns()
        self._send_due(now)
        self._calls.run(now)
        self._wait(end_ns, self._look_ahead(end_ns))

    def _receive(self, wire: Wire, now: int) -> None:
        """Commands and port events, from the wire to every device on it."""
        for event in wire.receive(now):
            for channel in self.channels:
                for port, each in channel.wires.items():
                    if each is wire:
                        self._dispatch(channel, port, event, now)

    def _dispatch(self, channel: Channel, port: str, event: Event | ReceivedData, now: int) -> None:
        local = channel.local_ns(now)
        match event:
            case ReceivedData():
                data = channel.wires[port].received_by(channel.name, event)
                if data is not None and now < channel.silent_until_ns:
                    channel.device.counters["unheard"] += 1
                elif data is not None:
                    self._call(channel, now, "receive", data, local, port, port=port)
                elif channel.wires[port].is_addressed_to(channel.name, event):
                    channel.device.counters["ignored"] += 1
            case LinesChanged(dtr, rts):
                self._call(channel, now, "lines", dtr, rts, local, port, port=port)
            case Opened() | Closed():
                self.truth.event(now, channel.name, "opened" if isinstance(event, Opened) else "closed")
            case SettingChanged() if event.setting.baud is not None:
                self.truth.event(now, channel.name, f"baud {event.setting.baud}")
            case Noted(what):
                self.truth.event(now, channel.name, what)

    def _send_due(self, now: int) -> None:
        """Samples whose release time has come go to their wires, and what has left those to the ports."""
        self._release(now)
        for wire in self.wires:
            wire.flush(self.clock.now_ns())

    def _due(self, now: int) -> list[tuple[Channel, str]]:
        """Streams whose next sample is due, by its time; equal times in the order of the devices.

        In real time equal times are one stream of each device after the other: their lines are busy meanwhile.
        """
        in_turn = not self.clock.virtual
        due = [
            (t_ns, k * in_turn, channel, stream)
            for channel in self.channels
            for k, (t_ns, stream) in enumerate(channel.due(now))
        ]
        return [entry[2:] for entry in sorted(due, key=lambda entry: entry[:2])]

    def _deadlines(self, *others: int | None) -> list[int]:
        """When streams sample next, and what else is given."""
        samples = [channel.next_due_ns() for channel in self.channels]
        return [t_ns for t_ns in (*samples, *others) if t_ns is not None]

    def _sample(self, channel: Channel, stream: str, now: int, sampled: SampledReadings) -> None:
        """Simulation up to the sample's time, reading, device, and out after the sampling delay."""
        timer = channel.timers[stream]
        if not timer.running:
            return
        due, count = timer.due_ns, timer.count
        if due < channel.silent_until_ns:
            timer.next(0)
            channel.statistics.silent += 1
            return
        if len(timer.readings) < timer.burst - 1:
            self._advance(channel, stream, due)
            timer.add_reading(channel.read(stream, due, sampled))
            return
        stamp, release = timer.sampling.stamp_ns(count), timer.sampling.release_ns(count, due)
        number = self._convert(channel, stream, due, stamp, sampled)
        self._call(channel, now, "stream", stamp, stream, release_ns=release, sample=number)
        self._count(channel, stream, count, due)

    def _convert(
        self, channel: Channel, stream: str, t_ns: int, stamp_ns: int, sampled: SampledReadings | None = None
    ) -> int:
        """Return one conversion at ``t_ns``, logged; returns its number."""
        number, channel.samples = channel.samples, channel.samples + 1
        self._advance(channel, stream, t_ns)
        ideal, measured = channel.complete_conversion(stream, channel.read(stream, t_ns, sampled))
        counts = channel.measure(stream, measured, stamp_ns)
        for key, values, sense in _by_sense(counts, measured):
            self.truth.sample(t_ns, channel.name, ideal[key], measured[key], values, number=number, sense=sense)
        return number

    def _advance(self, channel: Channel, stream: str, t_ns: int) -> None:
        """Bring the simulation to ``t_ns``; late in real time, in few steps."""
        period_ns = channel.period_ns(stream)
        is_late = not self.clock.virtual and self.clock.now_ns() - t_ns > period_ns
        channel.statistics.stretched += self.advance_to(t_ns, is_late=is_late, period_ns=period_ns)

    def advance_to(self, t_ns: int, *, is_late: bool = False, period_ns: int = 0) -> bool:
        """Bring the simulation to ``t_ns``, in bounded time; return True if a step was stretched for it.

        Args:
            t_ns: emulation time.
            is_late: take at most :attr:`catch_up_steps`.
            period_ns: time that is made up in whole steps, at least, if that is more than :data:`MAX_LAG_NS`.
        """
        simulation = self.simulation
        if simulation is None:
            return False
        most = self.catch_up_steps if is_late else max(period_ns, MAX_LAG_NS) // max(simulation.dt_ns, 1) + 1
        return simulation.advance_to(t_ns, most)

    def _look_ahead(self, end_ns: int | None) -> int | None:
        """While nothing is due, one simulation step towards the next sample, which then finds its state ready.

        Never past an action that is scheduled. What comes from outside meanwhile (a command that changes the period, a
        call from another thread) meets a simulation that is less than a period ahead; in virtual time, where it is
        known when it will have come, one that is not ahead. Returns when to try the next one.
        """
        simulation, clock = self.simulation, self.clock
        if simulation is None or simulation.dt_ns <= 0 or not self._deadlines():
            return None
        comes = [wire.next_due_ns() for wire in self.wires] if clock.virtual else []
        until = min(self._deadlines(self._agenda.next_ns, self._calls.next_ns, clock.end_ns, end_ns, *comes))
        t_ns = simulation.time_ns + simulation.dt_ns
        if t_ns > until:
            return None
        if self.look_ahead_ns is not None and not clock.virtual:
            begin = t_ns - max(self.look_ahead_ns, simulation.dt_ns)
            if begin > clock.now_ns():
                return begin
        simulation.advance_to(t_ns)
        return clock.now_ns()

    def _count(self, channel: Channel, stream: str, count: int, due: int) -> None:
        """Statistics, and on to the next sample: those whose time has wholly passed are missed, never made up."""
        late_ns = self.clock.now_ns() - due
        channel.statistics.add_sample(stream, due, late_ns)
        timer = channel.timers[stream]
        if timer.running and timer.count == count:  # unless the call has started it anew
            past_ns = self.clock.now_ns() - timer.sampling.due_ns(count + 1)
            missed = max(0, past_ns // timer.sampling.period_ns)
            timer.next(missed)
            channel.statistics.missed += missed

    # -- what leaves -------------------------------------------------------------------------------------------------

    def _call(
        self,
        channel: Channel,
        now: int,
        method: str,
        *args: Any,
        port: str = "",
        release_ns: int | None = None,
        sample: int | None = None,
    ) -> None:
        """Call into a device, do what it returns, and follow what it changed.

        Frames of one call to one port stay together: a line takes them all, or none. Answers leave now, readings at
        ``release_ns``.
        """
        frames: dict[str, Sequence[Any]] = {}
        outs = channel.call(method, *args)
        if isinstance(outs, CanFrames):
            frames[port or next(iter(channel.wires))], outs = outs, ()
        for out in outs:
            match out:
                case Restart(delay_ns):
                    self._later(channel, now + delay_ns, "power on")
                case Convert(stream, delay_ns):
                    self._later(channel, now + delay_ns, "convert", stream, now + delay_ns)
                case _:
                    to = getattr(out, "port", "") or port or next(iter(channel.wires))
                    frames.setdefault(to.partition("/")[0], []).append(out)  # type: ignore[attr-defined]
        for to, together in frames.items():
            if to not in channel.wires:
                if channel.device.connector(to).plugged:  # the others are in use only if asked for
                    channel.device.counters["unplugged"] += len(together)
            elif release_ns is None:
                channel.wires[to].send(together, now, source=channel.name, sample=sample)
            else:
                self._outbox.put(release_ns, Action("send", channel.name, (to, together, release_ns, sample)))
        channel.apply_changes(now)
        if channel.device.wake_ns != channel.alarm_ns:
            self._set_alarm(channel, now)

    def _release(self, now: int) -> None:
        """Let samples go whose release time has come."""
        for action in self._outbox.due(now):
            self._do(action)

    def _send(self, channel: Channel, port: str, frames: Sequence[Any], release_ns: int, sample: int | None) -> None:
        channel.wires[port].send(frames, release_ns, source=channel.name, sample=sample)

    def _convert_once(self, channel: Channel, stream: str, t_ns: int) -> None:
        """A conversion out of its period."""
        local = channel.local_ns(t_ns)
        number = self._convert(channel, stream, t_ns, local)
        self._call(channel, t_ns, "stream", local, stream, sample=number)

    def _later(self, channel: Channel, t_ns: int, name: str, *args: Any) -> None:
        """Unless the device has restarted by then."""
        self._agenda.put(t_ns, Action(name, channel.name, args, channel.power_cycles))

    def _set_alarm(self, channel: Channel, now: int) -> None:
        """The device's alarm clock was set, to a time of its own clock, or switched off."""
        wake_ns = channel.alarm_ns = channel.device.wake_ns
        if wake_ns is not None:
            self._later(channel, max(now, channel.sampling.world_ns(wake_ns)), "wake", wake_ns)

    def _wake(self, channel: Channel, wake_ns: int) -> None:
        """The time has come that the alarm clock was set to, unless it was set to another since."""
        if channel.alarm_ns == wake_ns:
            channel.device.wake_ns = channel.alarm_ns = None
            self._call(channel, self.now_ns, "wake", channel.local_ns(self.now_ns))

    # -- what others ask of the loop -----------------------------------------------------------------------------------

    def call(self, action: ScheduledCallback, at_ns: int = 0) -> None:
        """Have ``action`` run by the loop at the end of a turn, not before ``at_ns``. Safe from any thread."""
        self._calls.put(action, at_ns)

    def at(self, t_ns: int, action: Action | ScheduledCallback) -> None:
        """Have ``action`` run by the loop at an emulation time, before what is sampled then. Call from the loop's
        thread, or before it runs."""
        self._agenda.put(t_ns, action)

    def run_due_actions(self) -> None:
        """Do what is planned until now."""
        for action in self._agenda.due(self.now_ns):
            self._do(action)

    def hang(self, until_ns: int, name: str | None = None) -> None:
        """Let the device ``name`` (default: every one) neither sample nor hear until ``until_ns``, then go on."""
        for channel in self._named(name):
            self._hang(channel, until_ns)

    def reset(self, name: str | None = None) -> None:
        """Let the device ``name`` (default: every one) restart as after power-up, boot time included."""
        for channel in self._named(name):
            self._reset(channel)

    def _named(self, name: str | None) -> list[Channel]:
        return [channel for channel in self.channels if name in (None, channel.name)]

    def _do(self, action: Action | ScheduledCallback) -> None:
        if not isinstance(action, Action):
            action()
            return
        channel = self._channels[action.channel]
        if action.power_cycle is None or action.power_cycle == channel.power_cycles:
            ACTIONS[action.name](self, channel, *action.args)

    def _is_valid(self, action: Action) -> bool:
        if action.name not in ACTIONS or not _takes(ACTIONS[action.name], action.args):
            return False
        if (channel := self._channels.get(action.channel)) is None:
            return False
        every = range(len(channel.device.layout))
        match action.name, action.args:
            case "set", (option, value, *taxels):
                channel.imperfections.set(option, value, (), *taxels)  # in no environment
            case "kill", (taxels, value):
                channel.imperfections.set_dead([], True, value)  # of no taxel
                return all(taxel in every for taxel in taxels)
            case "revive", (taxels,):
                return all(taxel in every for taxel in taxels)
            case "convert", (stream, _):
                return stream in channel.timers
            case "send", (port, *_):
                return port in channel.wires
        return True

    # -- saving --------------------------------------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Return the whole state as plain data, for :meth:`restore`. Call between two turns: from :meth:`call`, or
        while it does not run.

        Raises:
            StateError: some part of it cannot be saved.
        """
        from tactemu.emulator.saving import snapshots

        return snapshots.take(self)

    def restore(self, state: Mapping[str, Any] | str | Path) -> None:
        """Go on from a state, or from a file of one, as often as you like. Call between two turns, or before it opens:
        then nothing powers up.

        Raises:
            StateError: it is not one of such an emulator; says what differs. Nothing has changed.
        """
        from tactemu.emulator.saving import snapshots

        snapshots.restore(self, state)
        self._is_restored = True

    def save(self, path: str | Path) -> int:
        """Write the state to a file; returns its size [byte]. Call as :meth:`snapshot`.

        Raises:
            StateError: some part of it cannot be saved, or the file cannot be written.
        """
        from tactemu.emulator.saving import snapshots

        return snapshots.write(path, self.snapshot())

    # -- what befalls a device -----------------------------------------------------------------------------------------

    def _hang(self, channel: Channel, until_ns: int) -> None:
        channel.silent_until_ns = max(channel.silent_until_ns, until_ns)
        self._inject(channel, "hang", f"until {until_ns} ns")

    def _reset(self, channel: Channel) -> None:
        self._inject(channel, "reset")
        self._power_on(channel)

    def _set(self, channel: Channel, option: str, value: Any, taxels: Sequence[int] | None = None) -> None:
        channel.imperfections.set(option, value, None, taxels)
        of = "" if taxels is None else f" of {' '.join(map(str, taxels))}"
        self._inject(channel, "set", f"{option} = {value}{of}")

    def _kill(self, channel: Channel, taxels: Sequence[int], value: float | None) -> None:
        channel.imperfections.set_dead(list(taxels), True, value)
        self._inject(channel, "dead", " ".join(map(str, taxels)))

    def _revive(self, channel: Channel, taxels: Sequence[int]) -> None:
        channel.imperfections.set_dead(list(taxels), False)
        self._inject(channel, "revived", " ".join(map(str, taxels)))

    def _inject(self, channel: Channel, what: str, detail: str = "") -> None:
        self.truth.inject(self.now_ns, channel.name, what, detail)

    def _pending_times(self) -> list[int | None]:
        """When something is due, samples aside."""
        return [*(wire.next_due_ns() for wire in self.wires), self._agenda.next_ns, self._outbox.next_ns]

    @property
    def is_settled(self) -> bool:
        """Whether everything that is due in this turn has been done."""
        return min(self._deadlines(*self._pending_times()), default=self.now_ns + 1) > self.now_ns

    def _wait(self, end_ns: int | None, look_ns: int | None) -> None:
        """Until whatever comes next, or until it is time to look ahead again."""
        deadlines = self._deadlines(*self._pending_times(), self._calls.next_ns, look_ns, end_ns)
        filenos = [fileno for wire in self.wires for fileno in wire.filenos()] + self._calls.filenos
        poll = any(not wire.filenos() for wire in self.wires)
        self.clock.wait(min(deadlines, default=None), filenos, poll=poll)


def _takes(function: Callable[..., None], args: Sequence[Any]) -> bool:
    """Return True if an action may be called with these arguments of a saved state."""
    from tactemu.emulator.saving.leaves import fits

    hints = typing.get_type_hints(function)
    names = list(inspect.signature(function).parameters)[2:]
    needed = len(names) - len(function.__defaults__ or ())
    return needed <= len(args) <= len(names) and all(fits(value, hints[name]) for name, value in zip(names, args))


def _by_sense(counts: Counts, measured: Mapping[str, Any]) -> Sequence[tuple[str, np.ndarray, str]]:
    """Return counts with the key of their sense and its name in the log; an array stands for the stream's first
    sense.
    """
    if isinstance(counts, Mapping):
        return [(key, values, key) for key, values in counts.items() if key in measured]
    return [(next(iter(measured)), counts, "")]


ACTIONS: dict[str, Callable[..., None]] = {
    "boot": Emulator._boot,
    "convert": Emulator._convert_once,
    "hang": Emulator._hang,
    "kill": Emulator._kill,
    "power on": Emulator._power_on,
    "reset": Emulator._reset,
    "revive": Emulator._revive,
    "send": Emulator._send,
    "set": Emulator._set,
    "wake": Emulator._wake,
}
"""What the loop does with a device when its time has come, by the name in an :class:`~tactemu.base.agenda.Action`."""


__all__ = ["Channel", "Emulator", "Simulated", "Source"]
