"""The loop: read this file first.

::

    scene ─▶ contact ─▶ sensor ─▶ imperfections ─▶ sampling ─▶ device ─▶ wire ─▶ transport ═══ driver under test
                                                                  ▲                      │
                                                                  └────── commands ◀─────┘

One thread and one clock. :meth:`Emulator.step` is the picture: what the driver sent goes to the devices, every device
whose time has come takes a sample of the simulation, and what the wires have due is written. Deadlines are absolute
integer nanoseconds; nothing here knows which device, sensor model or transport it runs.
"""

from __future__ import annotations

import heapq
import queue
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Protocol

from firmware_protocols import Outgoing
from tactemu.channel import Channel, Source
from tactemu.clock import Clock, RealClock
from tactemu.transports.transport import Closed, Event, Opened, Received, SettingChanged
from tactemu.truth import Truth
from tactemu.wire.wire import Wire

if TYPE_CHECKING:
    from tactemu.plan.plan import Plan


class Simulated(Protocol):
    """What the loop asks of a simulation: to be brought up to a time."""

    time_ns: int

    @property
    def dt_ns(self) -> int:
        """Length of a step."""
        ...

    @property
    def plan(self) -> Plan | None:
        """What a step computes; ``None`` where nothing is simulated."""
        ...

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Step until no whole step fits before ``t_ns``; true if a step was stretched to keep to ``max_steps``."""
        ...


class Emulator:
    """Runs devices on their wires against one simulation.

    Args:
        simulation: brought up to each sample's time; ``None`` when every source is a recording.
        channels: the devices. Several may share a :class:`~tactemu.wire.wire.Wire` (one CAN bus).
        clock: real time by default; a :class:`~tactemu.clock.VirtualClock` runs as fast as it can.
        truth: where samples, frames and faults are logged.
        catch_up_steps: a loop that is late by a period takes at most so many simulation steps for one sample.
    """

    def __init__(
        self,
        simulation: Simulated | None,
        channels: Iterable[Channel],
        *,
        clock: Clock | None = None,
        truth: Truth | None = None,
        catch_up_steps: int = 50,
    ):
        self.catch_up_steps = catch_up_steps
        self.simulation = simulation
        self.channels = list(channels)
        self.wires = list(dict.fromkeys(channel.wire for channel in self.channels))
        for wire in self.wires:
            wire.name = "+".join(channel.name for channel in self.channels if channel.wire is wire)
        self.clock: Clock = clock or RealClock()
        self.truth = truth or Truth()
        self.running = False
        self._actions: list[tuple[int, int, Callable[[], None]]] = []
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._outbox: list[tuple[int, int, Channel, list[Outgoing]]] = []
        self._serial = 0

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open every port, or none.

        Raises:
            TransportError: a port cannot be made; those already open are closed again.
        """
        self.truth.begin(self.clock.origin_ns, patient=self.clock.virtual)
        try:
            for wire in self.wires:
                wire.open()
        except BaseException:
            self.close()
            raise
        for channel in self.channels:
            self._power_on(channel, self.clock.now_ns())

    def close(self) -> None:
        """Remove every port. Safe to call twice."""
        for wire in self.wires:
            wire.close()
        self.truth.close()

    def _power_on(self, channel: Channel, now: int) -> None:
        """The device boots: its first sample comes a period after that."""
        channel.silent_until_ns = now + round(channel.device.boot_s * 1e9)
        channel.restart(channel.silent_until_ns)
        self._send(channel, channel.device.power_on(channel.local_ns(now)), now)

    def run(self, seconds: float | None = None) -> None:
        """Run for ``seconds`` of emulation time, or until :meth:`stop`."""
        end = None if seconds is None else self.clock.now_ns() + round(seconds * 1e9)
        self.running = True
        while self.running and (end is None or self.clock.now_ns() < end):
            self.step(end)

    def stop(self) -> None:
        """Leave :meth:`run` after the current turn. May be called from a signal handler or another thread."""
        self.running = False

    def summary(self) -> dict[str, dict[str, float]]:
        """Statistics of every device with the counters of its wire (shared by all on one bus) and of its firmware."""
        return {
            channel.name: channel.statistics.as_dict()
            | {f"wire_{name}": count for name, count in sorted(channel.wire.counters.items())}
            | {f"device_{name}": count for name, count in sorted(channel.device.counters.items())}
            for channel in self.channels
        }

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()

    # -- the picture ------------------------------------------------------------------------------------------------

    def step(self, end_ns: int | None = None) -> None:
        """One turn: commands in, samples taken, frames out, then wait for whatever comes next."""
        now = self.clock.now_ns()
        self._act(now)
        for wire in self.wires:
            self._listen(wire, now)
        for channel in sorted(self.channels, key=lambda c: c.due_ns):
            if channel.due_ns <= now:
                self._sample(channel, now)
        self._release(now)
        for wire in self.wires:
            wire.flush(self.clock.now_ns())
        self._wait(end_ns, busy=self._look_ahead(end_ns))

    def _listen(self, wire: Wire, now: int) -> None:
        """Commands and port events, from the wire to every device on it."""
        for event in wire.receive(now):
            for channel in self.channels:
                if channel.wire is wire:
                    self._hand_over(channel, event, now)

    def _hand_over(self, channel: Channel, event: Event, now: int) -> None:
        device, period = channel.device, channel.device.period_ns
        if isinstance(event, Received) and now < channel.silent_until_ns:
            device.counters["unheard"] += 1
        elif isinstance(event, Received):
            self._send(channel, device.receive(event.data, channel.local_ns(now)), now)
        elif isinstance(event, Opened):
            self.truth.event(now, channel.name, "opened")
            self._send(channel, device.opened(channel.local_ns(now)), now)
        elif isinstance(event, Closed):
            self.truth.event(now, channel.name, "closed")
            device.closed(channel.local_ns(now))
        elif isinstance(event, SettingChanged) and event.setting.baud is not None:
            self.truth.event(now, channel.name, f"baud {event.setting.baud}")
        if device.period_ns != period:
            channel.restart(now)

    def _sample(self, channel: Channel, now: int) -> None:
        """Simulation up to the sample's time, reading, device, and out after the sampling delay."""
        due = channel.due_ns
        if due < channel.silent_until_ns:
            channel.count += 1
            channel.statistics.silent += 1
            return
        self._advance(channel, due)
        senses = channel.device.senses
        ideal = channel.source.quantity(senses, ground_truth=True)
        measured = channel.source.quantity(senses)
        frames = channel.device.sample(channel.reading(due, measured), channel.sampling.stamp_ns(channel.count))
        self.truth.sample(due, channel.name, ideal, measured, channel.device.counts)
        self._post(channel, frames, channel.sampling.release_ns(channel.count, due))
        self._count(channel, due, now)

    def _advance(self, channel: Channel, due: int) -> None:
        """Bring the simulation to ``due``; late in real time, in few steps."""
        if self.simulation is None:
            return
        behind = self.clock.now_ns() - due > channel.device.period_ns and not self.clock.virtual
        stretched = self.simulation.advance_to(due, self.catch_up_steps if behind else None)
        channel.statistics.stretched += stretched

    def _look_ahead(self, end_ns: int | None) -> bool:
        """While nothing is due, one simulation step towards the next sample, which then finds its state ready.

        Never past an action that is scheduled. What comes from outside meanwhile (a command that changes the period, a
        call from another thread) meets a simulation that is less than a period ahead.
        """
        simulation = self.simulation
        if simulation is None or not self.channels:
            return False
        ends = [channel.due_ns for channel in self.channels]
        ends += [entry[0] for entry in self._actions[:1]]
        horizon = min(ends if end_ns is None else [*ends, end_ns])
        if simulation.dt_ns <= 0 or horizon - simulation.time_ns < simulation.dt_ns:
            return False
        simulation.advance_to(simulation.time_ns + simulation.dt_ns)
        return True

    def _count(self, channel: Channel, due: int, now: int) -> None:
        """Statistics, and on to the next sample: those whose time has wholly passed are missed, never made up."""
        statistics = channel.statistics
        statistics.first_ns = statistics.first_ns or due
        statistics.last_ns = due
        statistics.samples += 1
        statistics.lateness.add(max(0, self.clock.now_ns() - due))
        channel.count += 1
        behind = (self.clock.now_ns() - channel.due_ns) // channel.device.period_ns
        if behind > 0:
            channel.count += behind
            statistics.missed += behind

    # -- what leaves -------------------------------------------------------------------------------------------------

    def _send(self, channel: Channel, frames: Iterable[Outgoing], now: int) -> None:
        frames = list(frames)
        if frames:
            channel.wire.send(frames, now, source=channel.name)

    def _post(self, channel: Channel, frames: Iterable[Outgoing], release_ns: int) -> None:
        """Keep a sample's frames until their release time. They stay together: a line takes them all, or none."""
        frames = list(frames)
        if frames:
            self._serial += 1
            heapq.heappush(self._outbox, (release_ns, self._serial, channel, frames))

    def _release(self, now: int) -> None:
        while self._outbox and self._outbox[0][0] <= now:
            release_ns, _, channel, frames = heapq.heappop(self._outbox)
            channel.wire.send(frames, release_ns, source=channel.name)

    # -- what others ask of the loop -----------------------------------------------------------------------------------

    def call(self, action: Callable[[], None]) -> None:
        """Have ``action`` run by the loop, between two turns. Safe from any thread."""
        self._calls.put(action)

    def at(self, t_ns: int, action: Callable[[], None]) -> None:
        """Have ``action`` run by the loop at an emulation time. Call from the loop's thread, or before it runs."""
        self._serial += 1
        heapq.heappush(self._actions, (t_ns, self._serial, action))

    def hang(self, until_ns: int, name: str | None = None) -> None:
        """Let the device ``name`` (default: every one) neither sample nor hear until ``until_ns``, then go on."""
        for channel in self._named(name):
            channel.silent_until_ns = max(channel.silent_until_ns, until_ns)
            self.truth.inject(self.clock.now_ns(), channel.name, "hang", f"until {until_ns} ns")

    def reset(self, name: str | None = None) -> None:
        """Let the device ``name`` (default: every one) restart as after power-up, boot time included."""
        now = self.clock.now_ns()
        for channel in self._named(name):
            self.truth.inject(now, channel.name, "reset")
            self._power_on(channel, now)

    def _named(self, name: str | None) -> list[Channel]:
        return [channel for channel in self.channels if name in (None, channel.name)]

    def _act(self, now: int) -> None:
        while self._actions and self._actions[0][0] <= now:
            heapq.heappop(self._actions)[2]()
        while not self._calls.empty():
            self._calls.get()()

    def _wait(self, end_ns: int | None, *, busy: bool) -> None:
        """Until whatever comes next; when busy, no longer than a look at the ports."""
        deadlines = [channel.due_ns for channel in self.channels]
        deadlines += [due for wire in self.wires if (due := wire.next_due_ns()) is not None]
        deadlines += [entries[0][0] for entries in (self._actions, self._outbox) if entries]
        if end_ns is not None:
            deadlines.append(end_ns)
        filenos = [fileno for wire in self.wires for fileno in wire.filenos()]
        poll = any(not wire.filenos() for wire in self.wires)
        deadline = self.clock.now_ns() if busy else min(deadlines, default=None)
        self.clock.wait(deadline, filenos, poll=poll)


__all__ = ["Channel", "Emulator", "Simulated", "Source"]
