"""The commands to a recording that is replayed: faults on its wire, and its state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from tactemu.base.errors import TactemuError
from tactemu.control.control import mend
from tactemu.control.loop_task import LoopTask, TaskResult
from tactemu.emulator.replay import Replay
from tactemu.scene.events import Event, timed_fault
from tactemu.truth.tap import Tap


class ReplayControl:
    """The implementation of those :class:`~tactemu.control.control_commands.ControlCommands` that need no simulation
    and no firmware."""

    def __init__(self, replay: Replay):
        self.replay = replay
        self.clients: Counter[str] = Counter()
        """A server's counters of its clients and their requests."""

    def hello(self) -> dict[str, Any]:
        """Return what a server sends first to a client."""
        return {"clock": "real", "skins": {}, "bodies": []}

    def submit(
        self, verb: str, arguments: Mapping[str, Any], by: str = "", on_done: Callable[[LoopTask], None] | None = None
    ) -> LoopTask:
        """Have the loop carry out a command whose arguments are checked already."""
        return LoopTask(self.replay, lambda: self.do(verb, arguments), on_done=on_done)

    def watched(self, by: str, on_done: Callable[[LoopTask], None]) -> LoopTask:
        """Have the loop take the state for a client that watches it."""
        return self.submit("state", {}, by, on_done)

    def tap(self, most: int, skin: str | None) -> Tap:
        """Return a tap that collects what passes over the wire from now on, until :meth:`untap`."""
        tap = Tap(most)
        self.replay.wire.truth.tap(tap)
        return tap

    def untap(self, tap: Tap) -> None:
        """Remove a tap."""
        self.replay.wire.truth.untap(tap)

    def do(self, verb: str, arguments: Mapping[str, Any]) -> TaskResult:
        """Begin a command.

        Raises:
            TactemuError: a recording does not have this command.
        """
        action = getattr(self, f"_{verb}", None)
        if action is None:
            can = ", ".join(name.lstrip("_") for name in vars(ReplayControl) if name[:1] == "_" and name[1] != "_")
            raise TactemuError(f"{verb}: a recording is replayed here, nothing is simulated; use one of: {can}")
        return action(**arguments) or TaskResult()

    def _fault(self, fault: str, skin: str | None = None) -> None:
        self.replay.wire.add_fault(timed_fault(Event(fault=fault), self.replay.now_ns / 1e9))

    def _unplug(self, seconds: float | None = None, skin: str | None = None) -> None:
        event = Event(fault="unplug", until=seconds)
        self.replay.wire.add_fault(timed_fault(event, self.replay.now_ns / 1e9))

    def _mend(self, fault: str | None = None, skin: str | None = None) -> None:
        mend([self.replay.wire], fault)

    def _wait(self, seconds: float) -> TaskResult:
        return TaskResult(self.replay.now_ns + round(seconds * 1e9))

    def _stats(self, skin: str | None = None) -> TaskResult:
        return TaskResult(result={"wire": dict(self.replay.wire.counters), "clients": dict(self.clients)})

    def _state(self) -> TaskResult:
        replay = self.replay
        played = {"frame": replay.position, "of": len(replay.entries), "port": replay.wire.transport.address}
        return TaskResult(result={"t_s": replay.now_ns / 1e9, **played})
