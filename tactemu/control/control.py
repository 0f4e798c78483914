"""The commands to a running emulator, carried out in its loop: the same way for tests, people, pages and programs.

A command takes effect after the samples of its time. It is logged with that time, so that
:mod:`tactemu.control.command_replay` can repeat it.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tactemu.base.clock import LockstepClock
from tactemu.base.errors import SceneError, TactemuError, no_such
from tactemu.base.units import DEFAULT_STEP_S
from tactemu.control import state
from tactemu.control.control_commands import CONTROL_COMMANDS
from tactemu.control.description import described
from tactemu.control.loop_task import LoopTask, TaskResult
from tactemu.emulator.assembly import Assembled
from tactemu.emulator.channel import Channel
from tactemu.emulator.emulator import Emulator
from tactemu.emulator.saving import snapshots
from tactemu.emulator.scenario import apply_event
from tactemu.geometry import rotation
from tactemu.scene.events import Event
from tactemu.scene.placement import PlacedSkin
from tactemu.scene.steering import Steered, Waypoint, lift_path, nearest_body, press_path
from tactemu.transports.pty import PtyTransport
from tactemu.truth import COMMAND, Sample
from tactemu.truth.tap import Tap
from tactemu.wire.wire import Wire

LOOK_AHEAD_NS = 2_000_000
"""Longest lead of the simulation over real time once commands come; bounds how late a command takes effect."""


def mend(wires: Sequence[Wire], fault: str | None) -> None:
    """Switch faults off: those of a kind, or those whose text begins with ``fault``; ``None``: all.

    Raises:
        SceneError: no such fault is on.
    """
    on = [(wire, each) for wire in wires for each in wire.faults]
    found = [(wire, each) for wire, each in on if fault is None or fault == each.word or str(each).startswith(fault)]
    if fault is not None and not found:
        raise SceneError(f"mend: {no_such('fault', fault, sorted({str(each) for _, each in on}), 'those that are on')}")
    for wire, each in found:
        wire.remove_fault(each)


class Control:
    """The implementation of :class:`~tactemu.control.control_commands.ControlCommands` in an emulator's loop."""

    def __init__(self, assembled: Assembled):
        self.emulator: Emulator = assembled.emulator
        self.simulation = assembled.simulation
        bodies = [] if self.simulation is None else self.simulation.bodies
        self.steered = {body.name: body.motion for body in bodies if isinstance(body.motion, Steered)}
        """The motions of the bodies that you may move, by name."""
        self.clients: Counter[str] = Counter()
        """A server's counters of its clients and their requests."""
        self._scene, self._skins, self._posed = assembled.scene, assembled.skins, assembled.posed
        self._loaded = assembled.loaded

    # -- from any thread -------------------------------------------------------------------------------------------

    def submit(
        self, verb: str, arguments: Mapping[str, Any], by: str = "", on_done: Callable[[LoopTask], None] | None = None
    ) -> LoopTask:
        """Have the loop carry out a command whose arguments are checked already."""
        if changes := CONTROL_COMMANDS[verb].changes:
            self.emulator.look_ahead_ns = LOOK_AHEAD_NS
        return LoopTask(self.emulator, lambda: self.do(verb, arguments, by), changes=changes, on_done=on_done)

    def hello(self) -> dict[str, Any]:
        """Return what a server sends first to a client: clock, skins, and bodies that it may move."""
        clock = self.emulator.clock
        return {
            "clock": "lockstep" if self._lockstep else "virtual" if clock.virtual else "real",
            "skins": {channel.name: channel.device.name for channel in self.emulator.channels},
            "bodies": list(self.steered),
        }

    def watched(self, by: str, on_done: Callable[[LoopTask], None]) -> LoopTask:
        """Have the loop take the state for a client that watches it."""
        return self.submit("state", {}, by, on_done)

    def tap(self, most: int, skin: str | None) -> Tap:
        """Return a tap that collects what passes over the wires from now on, until :meth:`untap`.

        Raises:
            TactemuError: there is no such skin.
        """
        tap = Tap(most, None if skin is None else self.channel(skin).name)
        self.emulator.truth.tap(tap)
        return tap

    def untap(self, tap: Tap) -> None:
        """Remove a tap."""
        self.emulator.truth.untap(tap)

    # -- in the loop -----------------------------------------------------------------------------------------------

    def do(self, verb: str, arguments: Mapping[str, Any], by: str = "") -> TaskResult:
        """Begin a command, and log it if it changes the emulator.

        Raises:
            TactemuError: the command cannot be carried out; nothing has changed.
        """
        changes = CONTROL_COMMANDS[verb].changes
        if changes:
            self.emulator.advance_to(self.emulator.now_ns, is_late=not self.emulator.clock.virtual)
        task_result = getattr(self, f"_{CONTROL_COMMANDS[verb].method}")(**arguments)
        if changes or verb == "restore":
            text = json.dumps({"verb": verb, "args": dict(arguments), "by": by})
            self.emulator.truth.event(self.emulator.now_ns, "", COMMAND + text)
        return task_result or TaskResult()

    @property
    def _now_s(self) -> float:
        return self.emulator.now_ns / 1e9

    def channel(self, skin: str | None) -> Channel:
        """Return the channel of a skin; ``None``: that of the only skin.

        Raises:
            TactemuError: there is no such skin, or several without a name given.
        """
        channels = {channel.name: channel for channel in self.emulator.channels}
        if skin is None and len(channels) == 1:
            return next(iter(channels.values()))
        if skin is None:
            raise TactemuError(f"which skin? give one of: {', '.join(channels)}")
        if skin not in channels:
            raise TactemuError(no_such("skin", skin, channels))
        return channels[skin]

    def _wires(self, skin: str | None) -> list[Wire]:
        channels = self.emulator.channels if skin is None else [self.channel(skin)]
        return list(dict.fromkeys(wire for channel in channels for wire in channel.wires.values()))

    # -- bodies

    def _press(
        self,
        depth: float,
        approach: float,
        speed: float,
        dwell: float | None = None,
        taxel: int | None = None,
        body: str | None = None,
        skin: str | None = None,
        wait: bool = True,
    ) -> TaskResult:
        channel = self.channel(skin)
        taxels = self._taxels(channel)
        in_hand = {name: motion for name, motion in self.steered.items() if motion.is_steered} or self.steered
        choose = body is None and self.steered
        name = nearest_body(in_hand, taxels, taxel, self._now_s) if choose else self._body(body)
        here = self.steered[name].world(self._now_s)
        k = taxels.select_taxel(taxel, here.position, self._now_s)
        target, normal = taxels.positions(self._now_s)[k], taxels.normals(self._now_s)[k]
        legs, back = press_path(
            self._scene.body(name), here, target, normal, depth=depth, approach=approach, speed=speed,
            clearance=float(channel.device.layout.pitches[k]),
        )  # fmt: skip
        if dwell is not None:
            down = legs[-1].position
            legs += [Waypoint(dwell, down), *lift_path(down, back, speed)]
        task_result = self._go(name, legs, wait)
        self.steered[name].back = back
        return task_result

    def _release(self, speed: float, body: str | None = None, wait: bool = True) -> TaskResult:
        name = self._body(body)
        here = self.steered[name].world(self._now_s)
        back = self.steered[name].back
        stays = [Waypoint(0.0, here.position)]
        return self._go(name, stays if back is None else lift_path(here.position, back, speed), wait)

    def _move(
        self,
        seconds: float,
        position: Sequence[float] | None = None,
        quaternion: Sequence[float] | None = None,
        by: Sequence[float] = (0.0, 0.0, 0.0),
        speed: float = math.inf,
        order: rotation.Order = "wxyz",
        body: str | None = None,
        wait: bool = True,
    ) -> TaskResult:
        name = self._body(body)
        here = self.steered[name].world(self._now_s)
        goal = (here.position if position is None else np.asarray(position, float)) + np.asarray(by, float)
        seconds = max(seconds, float(np.linalg.norm(goal - here.position)) / speed)
        turned = rotation.wxyz(quaternion, order, "move")
        turn = None if turned is None else np.asarray(turned, float)
        return self._go(name, [Waypoint(seconds, goal, turn)], wait)

    def _set_pose(self, body: str, order: rotation.Order = "wxyz", **pose: list[float]) -> None:
        if "quaternion" in pose:
            pose["quaternion"] = rotation.wxyz(pose["quaternion"], order, "pose")
        if body in self.steered:
            self._in_hand(body).put(self._now_s, **pose)
        elif self.simulation is None:
            raise TactemuError("nothing is simulated: there are no bodies")
        else:
            self.simulation.set_pose(body, **pose)

    def _give_back(self, body: str | None = None) -> None:
        for name in self.steered if body is None else [self._body(body)]:
            self._in_hand(name).give_back()

    def _in_hand(self, name: str) -> Steered:
        """Return the motion by which a hand moves a body, and let it move the body, also one that a program posed."""
        if self.simulation is not None:
            self.simulation.release(name)
        return self.steered[name]

    def _go(self, name: str, legs: Sequence[Waypoint], wait: bool) -> TaskResult:
        end_s = self._in_hand(name).follow(self._now_s, legs)
        return TaskResult(round(end_s * 1e9), until_sampled=True) if wait and not self._lockstep else TaskResult()

    def _body(self, name: str | None) -> str:
        if name in self._posed or (self._posed and not self.steered):
            moved = name or ", ".join(sorted(self._posed))
            raise TactemuError(f"the source moves {moved}, and nothing else does; move bodies in your own simulation")
        if not self.steered:
            raise TactemuError("no body can be moved: none that is not fixed, carries no skin and follows no joint")
        if name is not None and name not in self.steered:
            raise TactemuError(no_such("steered body", name, self.steered, "steered bodies"))
        in_hand = [each for each, motion in self.steered.items() if motion.is_steered] or list(self.steered)
        return name or max(in_hand, key=lambda each: self.steered[each].moved_s)

    def _taxels(self, channel: Channel) -> PlacedSkin:
        if channel.name not in self._skins:
            (skin,) = (skin for skin in self._loaded.tables.skin if skin.title == channel.name)
            how = "plays recorded readings" if skin.readings else "has no taxels"
            if skin.link is None and skin.readings is None:
                how = "has the readings that your source gives"
            raise TactemuError(f"skin {channel.name!r} {how}; nothing can be pressed into it")
        return self._skins[channel.name]

    # -- faults and imperfections

    def _inject_event(self, **event: Any) -> None:
        checked = Event(**event)
        if checked.skin is not None:
            self.channel(checked.skin)
        apply_event(self.emulator, checked, self._now_s)
        self.emulator.run_due_actions()

    def _fault(self, fault: str, skin: str | None = None) -> TaskResult:
        self._inject_event(fault=fault, skin=skin)
        return TaskResult(until_settled=True)

    def _unplug(self, seconds: float | None = None, skin: str | None = None) -> TaskResult:
        self._inject_event(fault="unplug", until=seconds, skin=skin)
        return TaskResult(until_settled=True)  # the port has gone

    def _mend(self, fault: str | None = None, skin: str | None = None) -> TaskResult:
        mend(self._wires(skin), fault)
        return TaskResult(until_settled=True)  # the port is there again

    def _set(self, options: Mapping[str, Any], **when: Any) -> None:
        self._inject_event(set=dict(options), until=when.pop("seconds", None), **when)

    def _dead(self, taxels: Sequence[int], **when: Any) -> None:
        self._inject_event(dead=tuple(taxels), until=when.pop("seconds", None), **when)

    def _hang(self, seconds: float, skin: str | None = None) -> None:
        self._inject_event(hang=True, until=seconds, skin=skin)

    def _reset(self, skin: str | None = None) -> None:
        self._inject_event(reset=True, skin=skin)

    def _set_lines(self, dtr: bool, rts: bool, skin: str | None = None) -> None:
        transport = self.channel(skin).wire.transport
        if not isinstance(transport, PtyTransport):
            raise TactemuError(
                f"the port {transport.address} is no pseudo terminal; on other ports the driver sets them"
            )
        transport.set_lines(dtr, rts)

    # -- time

    @property
    def _lockstep(self) -> bool:
        return isinstance(self.emulator.clock, LockstepClock)

    def _wait(self, seconds: float) -> TaskResult:
        return TaskResult(self.emulator.now_ns + round(seconds * 1e9))

    def _step(self, n: int | None = None, seconds: float | None = None, until: float | None = None) -> TaskResult:
        clock = self.emulator.clock
        if not isinstance(clock, LockstepClock):
            raise TactemuError("step: time runs by itself; start it with --clock lockstep, serve(clock='lockstep')")
        if sum(given is not None for given in (n, seconds, until)) > 1:
            raise SceneError("step: give one of n, seconds and until")
        now = self.emulator.now_ns
        if until is not None and round(until * 1e9) < now:
            raise SceneError(f"step: it is {now / 1e9:g} s already, and time is not turned back to {until:g} s")
        if seconds is None:
            dt_ns = self.simulation.dt_ns if self.simulation is not None else round(DEFAULT_STEP_S * 1e9)
            end = now + (1 if n is None else n) * dt_ns
        else:
            end = now + round(seconds * 1e9)
        clock.go_on(end if until is None else round(until * 1e9))
        return TaskResult(clock.end_ns, clock.end_ns / 1e9, until_settled=True)

    # -- saving

    def _save(self, file: str) -> TaskResult:
        state = self.emulator.snapshot()
        return TaskResult(result=lambda: snapshots.write(file, state))

    def _restore(self, file: str) -> None:
        self.emulator.restore(file)

    # -- readings and statistics

    def sample(self, skin: str | None = None) -> Sample:
        """Return the latest sample of a skin (default: the only one).

        Raises:
            TactemuError: it has not been sampled yet.
        """
        name = self.channel(skin).name
        if (latest := self.emulator.truth.latest(name)) is None:
            raise TactemuError(f"skin {name!r} has not been sampled yet; wait, or step the time")
        return latest

    def _sample(self, skin: str | None = None) -> TaskResult:
        return TaskResult(result=self.sample(skin))

    def _stats(self, skin: str | None = None) -> TaskResult:
        channels = self.emulator.channels if skin is None else [self.channel(skin)]
        statistics = {channel.name: state.defer_statistics(self.emulator, channel) for channel in channels}
        return TaskResult(
            result=lambda: {
                "skins": {name: get() for name, get in statistics.items()},
                "clients": dict(self.clients),
            }
        )

    def _state(self) -> TaskResult:
        return TaskResult(result=state.state_of(self.emulator, self.steered))

    def _describe(self) -> TaskResult:
        return TaskResult(result=described(self.emulator))
