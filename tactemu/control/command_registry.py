"""The declaration of commands: the decorator, the table of all commands, and the check of their arguments.

The commands themselves are the methods of :class:`tactemu.control.control_commands.ControlCommands`.
"""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, TypeVar

from tactemu.base.errors import SceneError, nearest
from tactemu.control.argument_types import ArgumentType, Options


@dataclass(frozen=True)
class Argument:
    """One argument of a command."""

    name: str
    type: ArgumentType
    needed: bool
    default: Any
    about: str


@dataclass(frozen=True)
class ControlCommand:
    """One command."""

    function: Callable[..., Any]
    name: str
    words: tuple[str, ...]
    """The arguments that stand on a command line without their names, in this order."""
    changes: bool
    """True for a command that changes the emulator: it is logged, and repeated when the log is replayed."""

    @property
    def method(self) -> str:
        """The name of the command's method, with an underscore before it that of the method that carries it out."""
        return self.function.__name__

    @property
    def about(self) -> str:
        """The first paragraph of the method's docstring, on one line."""
        return " ".join((self.function.__doc__ or "").split("\n\n")[0].split())

    @property
    def brief(self) -> str:
        """The first sentence of the method's docstring, which fits into a list of commands."""
        sentence, end, _ = self.about.partition(". ")
        return sentence + end.strip()

    @cached_property
    def arguments(self) -> dict[str, Argument]:
        """The arguments by name."""
        hints = typing.get_type_hints(self.function, include_extras=True)
        texts = _argument_texts(self.function.__doc__ or "")
        found = {}
        for name, parameter in list(inspect.signature(self.function).parameters.items())[1:]:
            argument_type = _type_in(hints[name])
            if argument_type is not None:
                needed = parameter.default is parameter.empty
                default = None if needed else parameter.default
                found[name] = Argument(name, argument_type, needed, default, texts.get(name, ""))
        return found

    @property
    def end(self) -> tuple[str, str]:
        """The argument that ends the change, if there is one, and the end if it is not given: "`mend`", from
        "default: until `mend`" of the argument, or from "until `mend`." of the first paragraph."""
        ends = {each.name: each.about.partition("default: until ")[2] for each in self.arguments.values()}
        own = self.about.partition(" until ")[2].partition(". ")[0].removesuffix(".")
        return next(((name, end) for name, end in ends.items() if end), ("", own))

    def checked(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments as plain data, without those that are ``None``.

        Raises:
            SceneError: an argument is unknown, missing, or of a wrong type or value.
        """
        if self.name == "happen":  # its arguments are one table, the keys of an event
            return EVENT_ARGUMENT.type.check("happen", "event", dict(given))
        for name in given:
            if name not in self.arguments:
                hint = nearest(name, self.arguments) or f"; it has: {', '.join(self.arguments) or 'none'}"
                raise SceneError(f"{self.name}: no argument {name!r}{hint}")
        for argument in self.arguments.values():
            if argument.needed and given.get(argument.name) is None:
                raise SceneError(f"{self.name}: {argument.name} is missing: {argument.about}")
        values = {name: given.get(name) for name in self.arguments}
        values |= {a.name: a.default for a in self.arguments.values() if values[a.name] is None}
        return {
            name: self.arguments[name].type.check(self.name, name, value)
            for name, value in values.items()
            if value is not None
        }


def _type_in(hint: Any) -> ArgumentType | None:
    """Return the argument type in ``Annotated[float, argument_type]``, also if the hint allows ``None`` beside it."""
    types = [each for each in getattr(hint, "__metadata__", ()) if isinstance(each, ArgumentType)]
    return next(iter(types + [k for part in typing.get_args(hint) if (k := _type_in(part))]), None)


def _argument_texts(doc: str) -> dict[str, str]:
    """Return the text of each argument in a docstring."""
    _, _, arguments = inspect.cleandoc(doc).partition("Args:\n")
    found = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", arguments, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


CONTROL_COMMANDS: dict[str, ControlCommand] = {}
"""All commands, in the order of their declaration."""
EVENT_ARGUMENT = Argument("event", _type_in(Options), True, None, "keys of an entry [[scenario]]")  # type: ignore[arg-type]

Method = TypeVar("Method", bound=Callable[..., Any])


def control_command(*words: str, name: str = "", changes: bool = True) -> Callable[[Method], Method]:
    """Return a decorator that declares a method as a command.

    Args:
        words: arguments that stand on a command line without their names.
        name: the command's word on the socket and the command line; default: the method's name.
        changes: the command changes the emulator, and so is logged.
    """

    def declare(function: Method) -> Method:
        declared = CONTROL_COMMANDS[name or function.__name__] = ControlCommand(
            function, name or function.__name__, words, changes
        )
        signature = inspect.signature(function)

        @wraps(function)
        def ask(self: Any, *args: Any, **kwargs: Any) -> Any:
            try:
                given = dict(signature.bind(self, *args, **kwargs).arguments)
            except TypeError as error:
                unknown = next((word for word in kwargs if word not in signature.parameters), None)
                near = "" if unknown is None else nearest(unknown, declared.arguments)
                raise TypeError(f"{declared.method}: {error}{near}") from None
            del given["self"]
            given |= given.pop("event", {})
            return self._do(declared.name, declared.checked(given))

        return typing.cast(Method, ask)

    return declare
