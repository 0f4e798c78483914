"""The commands to a running emulator, each declared once.

A method of :class:`ControlCommands` is a command: its signature names its arguments, their types the units, its
docstring what it does. From these come the command line ``tactemu poke``, the requests on the socket and the table in
the manual. :class:`tactemu.session.serving.Served` and :class:`tactemu.control.client.Connection` are its subclasses;
:class:`tactemu.control.control.Control` carries the commands out.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from tactemu.control.argument_types import (
    AngularVelocity,
    Depth,
    Distance,
    File,
    Flag,
    Name,
    NonNegativeInt,
    Number,
    Options,
    Position,
    Quaternion,
    QuaternionOrder,
    Seconds,
    Speed,
    Taxels,
    Text,
    Velocity,
)
from tactemu.control.command_registry import CONTROL_COMMANDS, control_command
from tactemu.geometry.motion import Press
from tactemu.truth.entries import Sample

DEFAULT_WATCH_RATE_HZ = 10.0
"""Rate at which a client watches the state, unless it gives another."""

__all__ = ["CONTROL_COMMANDS", "DEFAULT_WATCH_RATE_HZ", "ControlCommands"]


class ControlCommands(ABC):
    """The commands to a running emulator. Units are SI; bodies and skins have their names in the scene."""

    @abstractmethod
    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        """Carry out a command whose arguments are checked; return its result."""

    # -- bodies ----------------------------------------------------------------------------------------------------

    @control_command("skin")
    def press(
        self,
        depth: Depth,
        *,
        approach: Distance = Press.approach,
        dwell: Seconds | None = None,
        speed: Speed = Press.speed,
        taxel: NonNegativeInt | None = None,
        body: Name | None = None,
        skin: Name | None = None,
        wait: Flag = True,
    ) -> None:
        """Bring a body over a taxel and press it in. The arguments are those of the motion `press` of a scene.

        A body that moves by itself is taken from its motion; :meth:`give_back` returns it.

        Args:
            depth: depth of the body's foremost point below the untouched surface of the skin
            approach: free travel before the first touch
            dwell: time at depth, after which it is released; default: until `release`
            speed: speed of the approach, the press and the return; farther away it moves at 50 mm/s, or faster
            taxel: number of the taxel; default: the one nearest to the body
            body: the body; default: the nearest to the taxel, of those that you have moved before, else of all
            skin: the skin; default: the only one
            wait: return when the body is at depth (or released) and every skin has sampled it, not at once
        """
        ...

    @control_command("body")
    def release(self, body: Name | None = None, *, speed: Speed = Press.speed, wait: Flag = True) -> None:
        """Lift a body to where it was over the skin, and hold it there until it is moved again.

        Args:
            body: the body; default: the one that pressed last
            speed: speed until it has left the skin; then it moves at 50 mm/s, or faster
            wait: return when the body is there and every skin has sampled it, not at once
        """
        ...

    @control_command("body", "position")
    def move(
        self,
        position: Position | None = None,
        quaternion: Quaternion | None = None,
        *,
        by: Position | None = None,
        seconds: Seconds = 0.0,
        speed: Speed | None = None,
        order: QuaternionOrder = "wxyz",
        body: Name | None = None,
        wait: Flag = True,
    ) -> None:
        """Move a body along a straight line to a place in the world, or by a distance. It stays there until it is moved
        again.

        Args:
            position: position in the world; default: the present one
            quaternion: orientation w x y z; default: the present one
            by: distance that is added to the position
            seconds: duration; 0: at once (a skin measures its velocity for at most one step)
            speed: the highest speed; the motion takes longer than `seconds` if it must
            order: order of the quaternion's numbers
            body: the body; default: the one that was moved last
            wait: return when the body is there and every skin has sampled it, not at once
        """
        ...

    @control_command("body", "position", name="pose")
    def set_pose(
        self,
        body: Name,
        *,
        position: Position | None = None,
        quaternion: Quaternion | None = None,
        order: QuaternionOrder = "wxyz",
        linear_velocity: Velocity | None = None,
        angular_velocity: AngularVelocity | None = None,
    ) -> None:
        """Put a body at a pose. It is there from the next step of the simulation on, until it is moved again.

        Args:
            body: the body, or its name
            position: position in the world; default: the present one
            quaternion: orientation w x y z; default: the present one
            order: order of the quaternion's numbers
            linear_velocity: velocity for contact laws that depend on it; the body does not move by it
            angular_velocity: angular velocity, likewise
        """
        ...

    @control_command("body")
    def give_back(self, body: Name | None = None) -> None:
        """Return a body to its own motion, until it is moved again. It jumps to the pose that the motion has by now.

        Args:
            body: the body; default: all
        """
        ...

    # -- what goes wrong -------------------------------------------------------------------------------------------

    @control_command("event", name="happen")
    def inject_event(self, **event: Any) -> None:
        """Inject an event. Its keys are those of an entry `[[scenario]]` of a scene file; its times count from now.

        ``dev.inject_event(fault="unplug for 0.5s")``, ``dev.inject_event(dead=[4])``,
        ``dev.inject_event(at=1, until=2, hang=True)``, ``dev.inject_event(reset=True)``,
        ``dev.inject_event(set={"noise": 0.1})``. Name imperfections that are off when the device is built in
        ``serve(..., adjustable=[...])``.
        """
        ...

    @control_command("fault")
    def fault(self, fault: Text, skin: Name | None = None) -> None:
        """Inject a fault of bytes or frames from now on, until `mend`. `tactemu faults` lists them.

        Args:
            fault: the fault, such as 'drop 5%'; 'drop 5% for 1s' ends by itself
            skin: the skin whose wire has it; default: all
        """
        ...

    @control_command()
    def unplug(self, seconds: Seconds | None = None, skin: Name | None = None) -> None:
        """Remove the port, as if its cable were unplugged.

        Args:
            seconds: duration; default: until `mend`
            skin: the skin; default: all
        """
        ...

    @control_command("fault")
    def mend(self, fault: Text | None = None, skin: Name | None = None) -> None:
        """End faults of bytes and frames. A port that is unplugged comes back.

        Args:
            fault: only faults of this kind, such as drop; default: all
            skin: the skin; default: all
        """
        ...

    @control_command("options")
    def set(
        self,
        options: Options,
        *,
        taxels: Taxels | None = None,
        seconds: Seconds | None = None,
        skin: Name | None = None,
    ) -> None:
        """Change imperfections, such as gain=0.9. Those that were off at the start must be `adjustable`.

        Args:
            options: options of the sensor model and their values
            taxels: taxels to change; 3:7 are 3, 4, 5, 6; default: all
            seconds: duration; default: until the run ends
            skin: the skin; default: all
        """
        ...

    @control_command("taxels")
    def dead(
        self, taxels: Taxels, value: Number | None = None, seconds: Seconds | None = None, skin: Name | None = None
    ) -> None:
        """Make taxels dead: they return a constant value.

        Args:
            taxels: their numbers; 3:7 are 3, 4, 5, 6
            value: the value that they return; default: their last reading
            seconds: duration; default: until the run ends
            skin: the skin; default: all
        """
        ...

    @control_command()
    def hang(self, seconds: Seconds, skin: Name | None = None) -> None:
        """Hang the device: it neither samples nor answers for a time.

        Args:
            seconds: duration
            skin: the skin; default: all
        """
        ...

    @control_command()
    def reset(self, skin: Name | None = None) -> None:
        """Restart the device as after power-up.

        Args:
            skin: the skin; default: all
        """
        ...

    @control_command(name="lines")
    def set_lines(self, *, dtr: Flag, rts: Flag, skin: Name | None = None) -> None:
        """Set the modem lines of a pseudo terminal, until they are set again. Its driver cannot set them.

        Args:
            dtr: data terminal ready
            rts: request to send
            skin: the skin; default: the only one
        """
        ...

    # -- time ------------------------------------------------------------------------------------------------------

    @control_command("seconds", changes=False)
    def wait(self, seconds: Seconds) -> None:
        """Wait until an emulation time has passed.

        Args:
            seconds: duration
        """
        ...

    @control_command("n", changes=False)
    def step(
        self, n: NonNegativeInt | None = None, *, seconds: Seconds | None = None, until: Seconds | None = None
    ) -> float:
        """Advance a clock in lockstep. It returns the time [s] when everything that is due by then is done.

        Args:
            n: number of steps of the simulation; default: one
            seconds: time to advance by, instead of steps
            until: time to advance to, instead of steps
        """
        ...

    # -- saving ----------------------------------------------------------------------------------------------------

    @control_command("file", changes=False)
    def save(self, file: File) -> int:
        """Save the complete state to a file, for `restore`. It returns the size of the file [byte].

        Args:
            file: the file to write
        """
        ...

    @control_command("file", changes=False)
    def restore(self, file: File) -> None:
        """Restore a saved state of the same scene. The time is then that of the state.

        Args:
            file: a file that `save` wrote
        """
        ...

    # -- looks -----------------------------------------------------------------------------------------------------

    @control_command("skin", changes=False)
    def sample(self, skin: Name | None = None) -> Sample:
        """Return the latest sample of a skin. It has the ideal and the measured reading, and the counts.

        Args:
            skin: the skin; default: the only one

        Raises:
            TactemuError: it has not been sampled yet.
        """
        ...

    @control_command("skin", changes=False)
    def stats(self, skin: Name | None = None) -> dict[str, Any]:
        """Return the statistics of every device since the start. They count samples, lateness, frames, injected faults.

        Args:
            skin: the skin; default: all
        """
        ...

    @control_command(changes=False)
    def state(self) -> dict[str, Any]:
        """Return the present state. It has the time, each body with its pose, each skin with its port and reading."""
        ...

    @control_command(changes=False)
    def describe(self) -> dict[str, Any]:
        """Return a description. It has bodies and skins, and the frames, commands, options, faults of devices."""
        ...
