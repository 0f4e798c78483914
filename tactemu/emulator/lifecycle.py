"""The part of an emulator that its callers use beside :class:`Loop`: open and close, events, saved states."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from tactemu.base.clock import Clock, RealClock
from tactemu.base.loop import Action, Agenda, Loop, ScheduledCallback
from tactemu.emulator import actions
from tactemu.emulator.channel import Channel
from tactemu.truth import Truth

if TYPE_CHECKING:
    from tactemu.plan.plan import Plan


class Simulated(Protocol):
    """A simulation, as the loop uses it."""

    time_ns: int

    @property
    def plan(self) -> Plan | None:
        """The plan of a step; ``None`` where nothing is simulated."""
        ...

    @property
    def dt_ns(self) -> int:
        """Length of a step."""
        ...

    def advance_to(self, t_ns: int, max_steps: int | None = None) -> bool:
        """Step until no whole step fits before ``t_ns``; return True if a step was stretched to keep ``max_steps``."""
        ...


class Lifecycle(Loop):
    """A loop that runs devices; a subclass defines its :meth:`step`.

    Args:
        channels: the devices.
        clock: real time by default.
        truth: the log of samples, frames and faults.
        recipe: the scene and options of the emulator, as plain data; a state with another recipe is refused.
    """

    def __init__(
        self, channels: Iterable[Channel], clock: Clock | None, truth: Truth | None, recipe: Mapping[str, Any]
    ):
        self.recipe = recipe
        self.channels: Sequence[Channel] = list(channels)
        self.wires = list(dict.fromkeys(wire for channel in self.channels for wire in channel.wires.values()))
        for wire in self.wires:
            wire.name = wire.name or "+".join(c.name for c in self.channels if wire in c.wires.values())
        super().__init__(clock or RealClock(), self.wires)
        self.truth = truth or Truth()
        self.truth.skins = {channel.name: [sense.key for sense in channel.device.sensed] for channel in self.channels}
        self.truth.buses = [wire.name for wire in self.wires]
        self._channels = {channel.name: channel for channel in self.channels}
        self._agenda: Agenda[Action | ScheduledCallback] = Agenda(self._is_valid)
        self._is_restored = False
        """True if the run continues from a state, rather than from power-up."""

    @abstractmethod
    def _power_on(self, channel: Channel) -> None: ...

    @abstractmethod
    def _is_valid(self, action: Action) -> bool: ...

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
            else:  # in real time some time has passed already; the start is 0 on every clock
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

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()

    def summary(self) -> list[dict[str, Any]]:
        """Return the counts of each device: samples, frames in both directions, injected faults."""
        return [channel.defer_statistics(self.truth.injected_at(channel.name))() for channel in self.channels]

    # -- scheduled calls and events ------------------------------------------------------------------------------------

    def at(self, t_ns: int, action: Action | ScheduledCallback) -> None:
        """Have ``action`` run by the loop at an emulation time, before the samples of that time. Call from the loop's
        thread, or before it runs."""
        self._agenda.put(t_ns, action)

    def hang(self, until_ns: int, name: str | None = None) -> None:
        """Let the device ``name`` (default: every one) neither sample nor receive until ``until_ns``."""
        for channel in self._named(name):
            actions.hang(self, channel, until_ns)

    def reset(self, name: str | None = None) -> None:
        """Restart the device ``name`` (default: every one) as after power-up, boot time included."""
        for channel in self._named(name):
            self._reset(channel)

    def _reset(self, channel: Channel) -> None:
        actions.inject(self, channel, "reset")
        self._power_on(channel)

    def _named(self, name: str | None) -> list[Channel]:
        return [channel for channel in self.channels if name in (None, channel.name)]

    # -- saving --------------------------------------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Return the complete state as plain data, for :meth:`restore`. Call between two turns: from :meth:`call`, or
        while the loop does not run.

        Raises:
            StateError: a part of it cannot be saved.
        """
        from tactemu.emulator.saving import snapshots

        return snapshots.snapshot_of(self)

    def restore(self, state: Mapping[str, Any] | str | Path) -> None:
        """Restore a state, or a file of one, as often as you like. Call between two turns; before :meth:`open`, the
        devices then do not power up.

        Raises:
            StateError: the state is of another emulator; the message names the difference. Nothing has changed.
        """
        from tactemu.emulator.saving import snapshots

        snapshots.restore(self, state)
        self._is_restored = True

    def save(self, path: str | Path) -> int:
        """Write the state to a file; return its size [byte]. Call as :meth:`snapshot`.

        Raises:
            StateError: a part of it cannot be saved, or the file cannot be written.
        """
        from tactemu.emulator.saving import snapshots

        return snapshots.write(path, self.snapshot())
