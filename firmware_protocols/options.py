"""The options of a device, declared once, as annotated keyword arguments of its ``__init__``::

    def __init__(self, *, rows: Annotated[int, Option("as the board was flashed", low=1)] = 12): ...

The checks of :func:`checked`, the command line (``rows=16``), scene files and the datasheet follow from that.
"""

from __future__ import annotations

import contextlib
import inspect
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from firmware_protocols.bounds import Bounds
from firmware_protocols.messages import error_message, nearest, shown


@dataclass(frozen=True)
class Option(Bounds):
    """The meaning, unit and bounds of an option."""

    about: str = ""


@dataclass(frozen=True)
class Declared:
    """An option as a device declares it."""

    name: str
    annotation: Any
    default: Any
    option: Option

    def __str__(self) -> str:
        option = self.option
        extra = ", ".join(part for part in (option.unit, *option.limits(), option.about) if part)
        return f"{self.name} = {_short(self.default)}" + (f"   {extra}" if extra else "")


def _short(value: Any) -> str:
    """Return a default as a datasheet shows it: numbers with at most six digits, else the ``repr``."""
    if isinstance(value, tuple):
        return f"({', '.join(map(_short, value))}{',' if len(value) == 1 else ''})"
    return repr(float(f"{value:.6g}")) if isinstance(value, float) else repr(value)


def declared(device: type) -> dict[str, Declared]:
    """Return the options of a device class, by name; with ``**options`` those of its base class are before its own."""
    owner = next(cls for cls in device.__mro__ if "__init__" in vars(cls))
    init = vars(owner)["__init__"]
    hints, found = typing.get_type_hints(init, include_extras=True), {}
    for name, parameter in list(inspect.signature(init).parameters.items())[1:]:
        if parameter.kind == parameter.VAR_KEYWORD and owner is not object:
            found = {**declared(owner.__mro__[1]), **found}
        if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        annotation = hints.get(name, Any)
        option = next((each for each in typing.get_args(annotation)[1:] if isinstance(each, Option)), None)
        if option is None:
            option = Option()
            annotation = Annotated[annotation, option]
        found[name] = Declared(name, annotation, parameter.default, option)
    return found


def checked(device: type, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``options`` converted to their annotated types, text such as ``"6"`` to a number.

    Raises:
        ValueError: the device has no such option (the message names the nearest), or its value is invalid.
    """
    known = declared(device)
    return {name: _checked(known, name, value) for name, value in options.items()}


def _checked(known: dict[str, Declared], name: str, value: Any) -> Any:
    if name not in known:
        raise ValueError(f"unknown option {name!r}{nearest(name, known)} (options: {', '.join(known) or 'none'})")
    from pydantic import ConfigDict, TypeAdapter, ValidationError

    each = known[name]
    config = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False)
    try:
        adapter = TypeAdapter(each.annotation, config=config)
        return adapter.validate_python(_from_text(value, each.annotation))
    except ValidationError as error:
        entry = error.errors()[0]
        length = _fixed_length(each.annotation)
        if length and entry["type"] in ("tuple_type", "missing", "too_long"):
            such = f"[{', '.join(map(str, range(1, length + 1)))}]"
            raise ValueError(f"option {name}: expected {length} values, such as {such}, got {shown(value)}") from None
        raise ValueError(f"option {name}: {error_message(entry)}") from None


def _fixed_length(annotation: Any) -> int:
    """Return the number of values of a tuple of a fixed length; 0: the type is another."""
    kind = typing.get_args(annotation)[0]
    parts = typing.get_args(kind) if typing.get_origin(kind) is tuple else ()
    return 0 if Ellipsis in parts else len(parts)


def _from_text(value: Any, annotation: Any) -> Any:
    """Return the list of a text ``[1, 2, 3]``, the number of a text, or of a ``Literal`` in it, or the value itself."""
    kind = typing.get_args(annotation)[0] if typing.get_origin(annotation) is typing.Annotated else annotation
    if typing.get_origin(kind) is typing.Literal:
        return next((member for member in typing.get_args(kind) if str(member) == value), value)
    if isinstance(value, str) and value.startswith("[") and value.endswith("]"):
        return [part.strip() for part in value[1:-1].split(",")]
    for number in (int, float) if kind in (int, float) and isinstance(value, str) else ():
        with contextlib.suppress(ValueError):
            return number(value)
    return value


def from_words(words: typing.Iterable[str]) -> dict[str, str]:
    """Return the options in words such as ``["axes=6", "rows=16"]``, by name, still text.

    Raises:
        ValueError: a word has no ``=``, or an option is given twice.
    """
    found: dict[str, str] = {}
    for word in words:
        name, mark, value = word.partition("=")
        if not mark or not name.isidentifier():
            raise ValueError(f"device option {word!r}: expected NAME=VALUE")
        if name in found:
            raise ValueError(f"device option {name!r} is given twice")
        found[name] = value
    return found
