"""The commands to a running emulator, each declared once.

A method of :class:`ControlCommands` is a command: its signature says what it takes, the types in which unit, its
docstring what it does. From these come the command line ``tactemu poke``, the requests on the socket and the table in
the manual. :class:`tactemu.session.serving.Served` and :class:`tactemu.control.client.Connection` are such objects;
whoever carries a command out is :class:`tactemu.control.control.Control`.
"""

from __future__ import annotations

import inspect
import re
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, TypeVar

from tactemu.base.errors import SceneError, nearest
from tactemu.control.kinds import (
    File,
    Flag,
    Kind,
    Metres,
    Name,
    Number,
    Options,
    Position,
    Quaternion,
    Seconds,
    Speed,
    Taxels,
    Text,
    Turning,
    Velocity,
    Whole,
)

SPEED = 0.05
"""Of bodies that are moved [m/s], unless told otherwise."""


@dataclass(frozen=True)
class Argument:
    """Of a command."""

    name: str
    kind: Kind
    needed: bool
    default: Any
    about: str


@dataclass(frozen=True)
class ControlCommand:
    """One command."""

    function: Callable[..., Any]
    name: str
    words: tuple[str, ...]
    """Arguments that stand on a command line without their names, in this order."""
    changes: bool
    """It does something, and so is logged, and done again when a log is played."""

    @property
    def about(self) -> str:
        """The first paragraph of what it does, on one line."""
        return " ".join((self.function.__doc__ or "").split("\n\n")[0].split())

    @cached_property
    def arguments(self) -> dict[str, Argument]:
        """What it takes, by name."""
        hints = typing.get_type_hints(self.function, include_extras=True)
        said = _said(self.function.__doc__ or "")
        found = {}
        for name, parameter in list(inspect.signature(self.function).parameters.items())[1:]:
            kind = _kind_of(hints[name])
            if kind is not None:
                needed = parameter.default is parameter.empty
                default = None if needed else parameter.default
                found[name] = Argument(name, kind, needed, default, said.get(name, ""))
        return found

    def checked(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Arguments as plain data; what is ``None`` is left out.

        Raises:
            SceneError: one that it does not have, that it lacks, or that does not fit.
        """
        if self.name == "happen":  # a table of its own, checked as such
            return HAPPENS.kind.check("happen", "event", dict(given))
        for name in given:
            if name not in self.arguments:
                hint = nearest(name, self.arguments) or f"; it has: {', '.join(self.arguments) or 'none'}"
                raise SceneError(f"{self.name}: no argument {name!r}{hint}")
        for argument in self.arguments.values():
            if argument.needed and given.get(argument.name) is None:
                raise SceneError(f"{self.name}: {argument.name} is missing")
        values = {name: given.get(name) for name in self.arguments}
        values |= {a.name: a.default for a in self.arguments.values() if values[a.name] is None}
        return {
            name: self.arguments[name].kind.check(self.name, name, value)
            for name, value in values.items()
            if value is not None
        }


def _kind_of(hint: Any) -> Kind | None:
    """Return the kind in ``Annotated[float, kind]``, or in such a type or ``None``."""
    kinds = [each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Kind)]
    return next(iter(kinds + [k for part in typing.get_args(hint) if (k := _kind_of(part))]), None)


def _said(doc: str) -> dict[str, str]:
    """What a docstring says of each argument."""
    _, _, rest = inspect.cleandoc(doc).partition("Args:\n")
    found = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", rest, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


VERBS: dict[str, ControlCommand] = {}
"""All commands, in the order of their declaration."""
HAPPENS = Argument("event", _kind_of(Options), True, None, "keys of an entry [[scenario]]")  # type: ignore[arg-type]

Method = TypeVar("Method", bound=Callable[..., Any])


def verb(*words: str, name: str = "", changes: bool = True) -> Callable[[Method], Method]:
    """Declares a method as a command."""

    def declare(function: Method) -> Method:
        declared = VERBS[name or function.__name__] = ControlCommand(
            function, name or function.__name__, words, changes
        )
        signature = inspect.signature(function)

        @wraps(function)
        def ask(self: ControlCommands, *args: Any, **kwargs: Any) -> Any:
            given = dict(signature.bind(self, *args, **kwargs).arguments)
            del given["self"]
            given |= given.pop("event", {})
            return self._do(declared.name, declared.checked(given))

        return typing.cast(Method, ask)

    return declare


class ControlCommands(ABC):
    """What may be done to a running emulator. SI units; bodies and skins by their names in the scene."""

    @abstractmethod
    def _do(self, verb: str, arguments: dict[str, Any]) -> Any:
        """Have a command done, its arguments checked; returns what it gives."""

    # -- bodies ----------------------------------------------------------------------------------------------------

    @verb("skin")
    def press(
        self,
        depth: Metres,
        seconds: Seconds | None = None,
        *,
        taxel: Whole | None = None,
        body: Name | None = None,
        skin: Name | None = None,
        speed: Speed = SPEED,
        wait: Flag = True,
    ) -> None:
        """Bring a body over a taxel and press it in.

        A body that moves by itself is taken from its motion; :meth:`give_back` returns it.

        Args:
            depth: how far its foremost point goes below the skin
            seconds: how long it stays at depth; then it is released; default: until `release`
            taxel: number of the taxel; default: the one nearest to the body
            body: which body; default: of those in hand, else of all that may be moved, the one nearest to the taxel
            skin: which skin; default: the only one
            speed: of the body
            wait: come back when it is done (at depth, or released) and every skin has sampled it, not at once
        """
        ...

    @verb("body")
    def release(self, body: Name | None = None, *, speed: Speed = SPEED, wait: Flag = True) -> None:
        """Lift a body to where it was over the skin, and hold it there.

        Args:
            body: which body; default: the one that pressed last
            speed: of the body
            wait: come back when it is done and every skin has sampled it
        """
        ...

    @verb("body", "position")
    def move(
        self,
        position: Position | None = None,
        quaternion: Quaternion | None = None,
        *,
        by: Position | None = None,
        seconds: Seconds = 0.0,
        speed: Speed | None = None,
        body: Name | None = None,
        wait: Flag = True,
    ) -> None:
        """Move a body to a place in the world, or by a distance, along a straight line.

        Args:
            position: world
            quaternion: orientation w x y z; default: it does not turn
            by: this far from there, or from where it is
            seconds: how long it takes; 0: at once (no velocity is felt for more than a step)
            speed: no faster than this; it takes as long as it needs
            body: which body; default: the one that was moved last
            wait: come back when it is there and every skin has sampled it
        """
        ...

    @verb("body", "position", name="pose")
    def set_pose(
        self,
        body: Name,
        position: Position | None = None,
        quaternion: Quaternion | None = None,
        linear_velocity: Velocity | None = None,
        angular_velocity: Turning | None = None,
    ) -> None:
        """Put a body somewhere, from the next step of the simulation on.

        Args:
            body: which body, or the body itself
            position: world
            quaternion: orientation w x y z
            linear_velocity: told to what feels it; the body stays
            angular_velocity: likewise
        """
        ...

    @verb("body")
    def give_back(self, body: Name | None = None) -> None:
        """Let a body go on with its own motion, from where that has it by now.

        Args:
            body: which body; default: all
        """
        ...

    # -- what goes wrong -------------------------------------------------------------------------------------------

    @verb("event")
    def happen(self, **event: Any) -> None:
        """Let something go wrong, as an entry `[[scenario]]` of a scene file would; times count from now.

        ``dev.happen(fault="unplug for 0.5s")``, ``dev.happen(dead=[4])``, ``dev.happen(at=1, until=2, hang=True)``,
        ``dev.happen(reset=True)``, ``dev.happen(set={"noise": 0.1})``. Imperfections that were off when the device was
        built must be named in ``serve(..., adjustable=[...])``.
        """
        ...

    @verb("fault")
    def fault(self, fault: Text, skin: Name | None = None) -> None:
        """Let bytes or frames go wrong from now on, in the words of `tactemu faults`.

        Args:
            fault: such as 'drop 5% for 1s'
            skin: whose wire; default: all
        """
        ...

    @verb()
    def unplug(self, seconds: Seconds | None = None, skin: Name | None = None) -> None:
        """Let the port go away.

        Args:
            seconds: for how long; default: until `mend`
            skin: whose; default: all
        """
        ...

    @verb("fault")
    def mend(self, fault: Text | None = None, skin: Name | None = None) -> None:
        """End faults of bytes and frames; a port that is unplugged comes back.

        Args:
            fault: those of this kind, such as drop; default: all
            skin: whose; default: all
        """
        ...

    @verb("options")
    def set(
        self,
        options: Options,
        *,
        taxels: Taxels | None = None,
        seconds: Seconds | None = None,
        skin: Name | None = None,
    ) -> None:
        """Change imperfections, such as probe_gain=0.9; those that were off at the start must be `adjustable`.

        Args:
            options: sensor options and their values
            taxels: these only; 3:7 are 3, 4, 5, 6
            seconds: for how long; default: for ever
            skin: whose; default: all
        """
        ...

    @verb("taxels")
    def dead(
        self, taxels: Taxels, value: Number | None = None, seconds: Seconds | None = None, skin: Name | None = None
    ) -> None:
        """Let taxels die.

        Args:
            taxels: which; 3:7 are 3, 4, 5, 6
            value: what they read; default: their last reading
            seconds: for how long; default: for ever
            skin: whose; default: all
        """
        ...

    @verb()
    def hang(self, seconds: Seconds, skin: Name | None = None) -> None:
        """Let the device neither sample nor answer for a time.

        Args:
            seconds: for how long
            skin: which; default: all
        """
        ...

    @verb()
    def reset(self, skin: Name | None = None) -> None:
        """Let the device restart as after power-up.

        Args:
            skin: which; default: all
        """
        ...

    @verb(name="lines")
    def set_lines(self, *, dtr: Flag, rts: Flag, skin: Name | None = None) -> None:
        """Move the modem lines of a pseudo terminal, on which a driver cannot.

        Args:
            dtr: data terminal ready
            rts: request to send
            skin: whose; default: the only one
        """
        ...

    # -- time ------------------------------------------------------------------------------------------------------

    @verb("seconds", changes=False)
    def wait(self, seconds: Seconds) -> None:
        """Come back when so much emulation time has passed.

        Args:
            seconds: how much
        """
        ...

    @verb("n", changes=False)
    def step(self, n: Whole | None = None, *, seconds: Seconds | None = None, until: Seconds | None = None) -> float:
        """Let time pass on a clock in lockstep; comes back when all that is due by then is done, with the time [s].

        Args:
            n: so many steps of the simulation; default: one
            seconds: or so long
            until: or until this time
        """
        ...

    # -- saving ----------------------------------------------------------------------------------------------------

    @verb("file", changes=False)
    def save(self, file: File) -> int:
        """Save the whole state, to go on from it later; gives the size of the file [byte].

        Args:
            file: what to write
        """
        ...

    @verb("file", changes=False)
    def restore(self, file: File) -> None:
        """Go on from a saved state of such a run: the time is again what it was then.

        Args:
            file: what `save` wrote
        """
        ...

    # -- looks -----------------------------------------------------------------------------------------------------

    @verb("skin", changes=False)
    def sample(self, skin: Name | None = None) -> Any:
        """Return the latest sample of a skin: ideal and measured reading, and counts.

        Args:
            skin: which; default: the only one
        """
        ...

    @verb("skin", changes=False)
    def stats(self, skin: Name | None = None) -> dict[str, Any]:
        """What every device has done since the start: samples, lateness, frames, what was injected.

        Args:
            skin: whose; default: all
        """
        ...

    @verb(changes=False)
    def state(self) -> dict[str, Any]:
        """Return the time, every body with its pose, every skin with its port and latest reading."""
        ...

    @verb(changes=False)
    def describe(self) -> dict[str, Any]:
        """What is there: the scene's bodies and skins, and of each device its frames, commands, options and faults."""
        ...
