"""The loop: read this file first.

::

    scene ─▶ contact ─▶ sensor ─▶ imperfections ─▶ sampling ─▶ device ─▶ wire ─▶ transport ═══ driver under test
                                                                  ▲                      │
                                                                  └────── commands ◀─────┘

One thread and one clock. :meth:`Emulator.step` is the picture: the driver's bytes go to the devices, every stream of a
device that is due takes a sample of the simulation, the wires write what is due, and then scheduled calls run.
Deadlines are absolute integer nanoseconds; the loop is the same for every device, sensor model and transport.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from firmware_protocols import Convert, Counts, Restart
from firmware_protocols.can_frames import CanFrames
from tactemu.base.clock import Clock
from tactemu.base.loop import Action, Agenda, ScheduledCallback, earliest
from tactemu.emulator import actions
from tactemu.emulator.channel import Channel, SampledReadings, Source
from tactemu.emulator.lifecycle import Lifecycle, Simulated
from tactemu.transports.transport import Closed, Event, LinesChanged, Noted, Opened, SettingChanged
from tactemu.truth import Truth
from tactemu.wire.wire import ReceivedData, Wire

_MAX_SAMPLING_NS = 1_000_000
"""Longest time for which the samples of a turn delay the frames that are ready to leave."""
_MAX_STEPPING_NS = 50_000
"""Longest time for which a turn takes steps of the simulation ahead; bounds the delay of an answer to a driver."""
_MIN_LEAD_NS, _LEAD_PER_STEP_TIME = 200_000, 2
"""The lead of the simulation that steps need not to make a sample late, where live commands wait for it."""
MAX_STEPS_PER_TURN = 32
"""Maximum number of steps that a turn takes ahead in virtual time; bounds the delay of :meth:`Emulator.stop`."""
MAX_LAG_NS = 10_000_000_000
"""Longest time that the simulation makes up in whole steps; bounds the wait of a sample after a long idle time."""


class Emulator(Lifecycle):
    """A loop that runs devices on their wires against one simulation.

    Args:
        simulation: brought up to each sample's time; ``None`` when every source is a recording.
        channels: the devices. Several may share a :class:`~tactemu.wire.wire.Wire` (a CAN bus, an RS-485 line).
        clock: real time by default; a :class:`~tactemu.base.clock.VirtualClock` runs as fast as it can.
        truth: the log of samples, frames and faults.
        catch_up_steps: number of simulation steps, at most, for a sample that is late by a period.
        recipe: the scene and options of the emulator, as plain data; a state with another recipe is refused.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = (
        "catch_up_steps", "clock", "look_ahead_ns", "recipe", "_calls", "_channels", "_is_restored", "_ports",
        "_readable", "_step_ns", "_stop_requested",
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
        self.catch_up_steps = catch_up_steps
        self.simulation: Simulated | None = simulation
        super().__init__(channels, clock, truth, recipe or {})
        self.look_ahead_ns: int | None = None
        """Longest lead of the simulation over real time (or a step, if that is longer), and no more than its steps
        need; ``None``: unlimited."""
        self._step_ns = 0
        """Real time that a step takes, at most, of the latest ones."""
        self._outbox: Agenda[Action] = Agenda(self._is_valid)
        """Samples until their release times."""

    # -- the picture ------------------------------------------------------------------------------------------------

    def step(self, end_ns: int | None = None) -> None:
        """Run one turn: commands in, samples taken, frames out, calls; then wait until the next deadline."""
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
            if not self.clock.virtual and self.clock.now_ns() - sent_ns > _MAX_SAMPLING_NS:
                self._send_due(now)  # frames of some boards do not wait for the samples of many others
                sent_ns = self.clock.now_ns()
        self._send_due(now)
        self._calls.run(now)
        self._wait((self._look_ahead(end_ns),))

    def _receive(self, wire: Wire, now: int) -> None:
        """Pass commands and port events from the wire to every device on it."""
        for event in wire.receive(now, self._readable):
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
        """Pass the samples whose release time has come to their wires, and write what has left the wires to the
        ports."""
        for action in self._outbox.due(now):
            self._do(action)
        for wire in self.wires:
            wire.flush(self.clock.now_ns())

    def _due(self, now: int) -> list[tuple[Channel, str]]:
        """Return the streams whose next sample is due, by its time; equal times in the order of the devices.

        In real time, equal times take one stream of each device in turn, so that their lines are busy meanwhile.
        """
        in_turn = not self.clock.virtual
        due = [
            (t_ns, k * in_turn, channel, stream)
            for channel in self.channels
            for k, (t_ns, stream) in enumerate(channel.due(now))
        ]
        return [entry[2:] for entry in sorted(due, key=lambda entry: entry[:2])]

    def _sample(self, channel: Channel, stream: str, now: int, sampled: SampledReadings) -> None:
        """Take a sample: advance the simulation to its time, read, convert, and send after the sampling delay."""
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
        """Convert the readings of a stream at ``t_ns`` into the device's counts, log both, and return the sample's
        number."""
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
            period_ns: time that is made up in whole steps, at least, if it is longer than :data:`MAX_LAG_NS`.
        """
        simulation = self.simulation
        if simulation is None:
            return False
        most = self.catch_up_steps if is_late else max(period_ns, MAX_LAG_NS) // max(simulation.dt_ns, 1) + 1
        return simulation.advance_to(t_ns, most)

    def _look_ahead(self, end_ns: int | None) -> int | None:
        """Take simulation steps towards the next sample while nothing is due, so that the sample finds its state ready;
        return the time of the next turn.

        A step never passes a scheduled action. What comes from outside (a command that changes the period, a call from
        another thread) meets a simulation that leads by less than a period; in virtual time, where its time of arrival
        is known, one that does not lead.
        """
        simulation, clock = self.simulation, self.clock
        sample_ns, pending_ns = self._next_sample_ns(), self._next_pending_ns()
        planned_ns = earliest(sample_ns, self._agenda.next_ns, self._calls.next_ns, end_ns)
        next_ns = earliest(planned_ns, pending_ns)
        if simulation is None or sample_ns is None or (dt_ns := simulation.dt_ns) <= 0:
            return next_ns
        until_ns = earliest(next_ns if clock.virtual else planned_ns, clock.end_ns)
        assert until_ns is not None
        steps = (until_ns - simulation.time_ns) // dt_ns
        if steps <= 0:
            return next_ns
        if clock.virtual:
            simulation.advance_to(simulation.time_ns + min(steps, MAX_STEPS_PER_TURN) * dt_ns)
            return next_ns if steps <= MAX_STEPS_PER_TURN else self.now_ns
        return earliest(next_ns, self._step_for_a_while(simulation, steps))

    def _step_for_a_while(self, simulation: Simulated, steps: int) -> int | None:
        """Take at most so many steps in real time, for :data:`_MAX_STEPPING_NS`; return when to take the others."""
        begun_ns = self.clock.now_ns()
        stop_ns = begun_ns + _MAX_STEPPING_NS
        for _ in range(steps):
            t_ns = simulation.time_ns + simulation.dt_ns
            if self.look_ahead_ns is not None:
                lead_ns = _MIN_LEAD_NS + _LEAD_PER_STEP_TIME * self._step_ns
                begin_ns = t_ns - min(lead_ns, max(self.look_ahead_ns, simulation.dt_ns))
                if begin_ns > begun_ns:
                    return begin_ns
            simulation.advance_to(t_ns)
            ended_ns = self.clock.now_ns()
            self._step_ns = max(ended_ns - begun_ns, self._step_ns - self._step_ns // 16)
            if (begun_ns := ended_ns) > stop_ns:
                return stop_ns
        return None

    def _count(self, channel: Channel, stream: str, count: int, due: int) -> None:
        """Update the statistics and the timer; samples that are late by a whole period are missed, never made up."""
        late_ns = self.clock.now_ns() - due
        channel.statistics.add_sample(stream, due, late_ns)
        timer = channel.timers[stream]
        if timer.running and timer.due_ns == due:  # unless the call has restarted it
            past_ns = self.clock.now_ns() - timer.sampling.due_ns(count + 1)
            missed = max(0, past_ns // timer.sampling.period_ns)
            timer.next(missed)
            channel.statistics.missed += missed

    def _next_sample_ns(self) -> int | None:
        """Return the time of the next sample of any device; ``None`` if none is running."""
        return earliest(*[channel.next_due_ns() for channel in self.channels])

    def _next_pending_ns(self) -> int | None:
        """Return the time of the next frame, or of another action of a wire."""
        return earliest(self._outbox.next_ns, *[wire.next_due_ns() for wire in self.wires])

    @property
    def is_settled(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """True if everything that is due in this turn has been done."""
        next_ns = earliest(self._next_sample_ns(), self._next_pending_ns(), self._agenda.next_ns)
        return next_ns is None or next_ns > self.now_ns

    # -- calls into a device -------------------------------------------------------------------------------------------

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
        """Call a method of a device, send or schedule what it returns, and apply the settings that it changed.

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
                if channel.device.connector(to).is_plugged:  # the other connectors are in use only on request
                    channel.device.counters["unplugged"] += len(together)
            elif release_ns is None:
                channel.wires[to].send(together, now, source=channel.name, sample=sample)
            else:
                self._outbox.put(release_ns, Action("send", channel.name, (to, together, release_ns, sample)))
        channel.apply_changes(now)
        if channel.device.wake_ns != channel.alarm_ns:
            self._set_alarm(channel, now)

    def _send(self, channel: Channel, port: str, frames: Sequence[Any], release_ns: int, sample: int | None) -> None:
        channel.wires[port].send(frames, release_ns, source=channel.name, sample=sample)

    def _power_on(self, channel: Channel) -> None:
        """Power-cycle the device. It neither samples nor receives until it has booted."""
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
        """Convert every stream once, start their timers, and send the device's banner."""
        for stream in channel.timers:
            self._convert(channel, stream, now, channel.local_ns(now))
        channel.begin(now)
        self._call(channel, now, "boot", channel.local_ns(now))

    def _convert_once(self, channel: Channel, stream: str, t_ns: int) -> None:
        """Convert and send a stream once, outside its period."""
        local = channel.local_ns(t_ns)
        number = self._convert(channel, stream, t_ns, local)
        self._call(channel, t_ns, "stream", local, stream, sample=number)

    def _later(self, channel: Channel, t_ns: int, name: str, *args: Any) -> None:
        """Schedule an action that is void if the device has restarted by then."""
        self._agenda.put(t_ns, Action(name, channel.name, args, channel.power_cycles))

    def _set_alarm(self, channel: Channel, now: int) -> None:
        """Schedule the wake-up that the device has set, in the time of its own clock, or forget the one before."""
        wake_ns = channel.alarm_ns = channel.device.wake_ns
        if wake_ns is not None:
            self._later(channel, max(now, channel.sampling.world_ns(wake_ns)), "wake", wake_ns)

    def _wake(self, channel: Channel, wake_ns: int) -> None:
        """Wake the device, unless it has set another time since."""
        if channel.alarm_ns == wake_ns:
            channel.device.wake_ns = channel.alarm_ns = None
            self._call(channel, self.now_ns, "wake", channel.local_ns(self.now_ns))

    # -- actions -------------------------------------------------------------------------------------------------------

    def run_due_actions(self) -> None:
        """Run the actions that are due by the time of the turn."""
        for action in self._agenda.due(self.now_ns):
            self._do(action)

    def _do(self, action: Action | ScheduledCallback) -> None:
        if not isinstance(action, Action):
            action()
            return
        channel = self._channels[action.channel]
        if action.power_cycle is None or action.power_cycle == channel.power_cycles:
            ACTIONS[action.name](self, channel, *action.args)

    def _is_valid(self, action: Action) -> bool:
        return actions.is_valid(action, self._channels, ACTIONS)


def _by_sense(counts: Counts, measured: Mapping[str, Any]) -> Sequence[tuple[str, np.ndarray, str]]:
    """Return counts with the key of their sense and its name in the log; an array has the stream's first sense."""
    if isinstance(counts, Mapping):
        return [(key, values, key) for key, values in counts.items() if key in measured]
    return [(next(iter(measured)), counts, "")]


ACTIONS: dict[str, Callable[..., None]] = {
    "boot": Emulator._boot,
    "convert": Emulator._convert_once,
    "hang": actions.hang,
    "kill": actions.kill,
    "power on": Emulator._power_on,
    "reset": Emulator._reset,
    "revive": actions.revive,
    "send": Emulator._send,
    "set": actions.set_option,
    "wake": Emulator._wake,
}
"""The functions of the loop's actions on a device, by the name in an :class:`~tactemu.base.loop.Action`."""


__all__ = ["Channel", "Emulator", "Source"]
