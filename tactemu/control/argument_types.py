"""The types of the arguments of commands: each checks a value, reads it from a text with its unit, and has a word."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

from tactemu.base import units
from tactemu.base.errors import SceneError, shown
from tactemu.base.options import number, numbers
from tactemu.base.units import DURATIONS_S, LENGTHS_M, MAX_POSITION_M, MAX_TAXELS, SPEEDS_M_S, TIMES_S, scaled
from tactemu.geometry import rotation


@dataclass(frozen=True)
class ArgumentType:
    """The type of an argument of a command."""

    word: str
    """The placeholder in help texts: ``LENGTH``."""
    check: Callable[[str, str, Any], Any]
    """``check(verb, name, value)`` returns the value as plain data, or raises a :class:`SceneError`."""
    read: Callable[[str], Any] = str
    """``read(text)`` returns the value of a text; a text without one is returned as it is, and ``check`` refuses it."""
    json: str = "text"
    """The name of the JSON type in the manual."""
    words: int = 1
    """Number of words that the argument takes on a command line; 0: all that are left."""


def _unit_reader(units: Mapping[str, float]) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        value = scaled(text, {"": 1.0, **units})
        return text if value is None else value

    return read


def _number(kind: Any, word: str, json: str, units: Mapping[str, float]) -> ArgumentType:
    """Return the type of a number of :mod:`tactemu.base.units`, which as a text may have a unit."""

    def check(verb: str, name: str, value: Any) -> Any:
        try:
            return number(verb, name, value, kind)
        except SceneError as error:
            if isinstance(value, str) and units:
                raise SceneError(f"{error}; on a command line it may have a unit: {', '.join(units)}") from None
            raise

    return ArgumentType(word, check, _unit_reader(units), json)


def _integer(text: str) -> Any:
    return int(text) if text.isdecimal() else text


def _text(verb: str, name: str, value: Any) -> str:
    value = getattr(value, "name", value)  # a body may be given itself
    if not isinstance(value, str) or not value or not value.isprintable() or len(value) > 1000:
        raise SceneError(f"{verb}: {name} must be a text, got {shown(value)}")
    return value


def _file(verb: str, name: str, value: Any) -> str:
    """Return the absolute path of a file: a relative one starts at the caller's folder, not at the emulator's."""
    value = _text(verb, name, os.fspath(value) if isinstance(value, os.PathLike) else value)
    return os.path.abspath(os.path.expanduser(value))


def _true_or_false(verb: str, name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise SceneError(f"{verb}: {name} must be true or false, got {shown(value)}")
    return value


def _vector(width: int, most: float) -> Callable[[str, str, Any], list[float]]:
    def check(verb: str, name: str, value: Any) -> list[float]:
        array = numbers(verb, name, value.numpy() if hasattr(value, "numpy") else value)
        if array.shape != (width,):
            raise SceneError(f"{verb}: {name} must be {width} numbers, got {shown(value)}")
        if abs(array).max() > most:
            raise SceneError(f"{verb}: {name} must be within {most:g} of 0, got {shown(value)}")
        return array.tolist()

    return check


def _quaternion(verb: str, name: str, value: Any) -> list[float]:
    array = _vector(4, 1e6)(verb, name, value)
    try:
        rotation.normalised(array)
    except ValueError:
        raise SceneError(f"{verb}: {name} must not be zero, got {shown(value)}; no turn is [1, 0, 0, 0]") from None
    return array


def _taxels(verb: str, name: str, value: Any) -> list[int]:
    value = [value] if isinstance(value, int) else value
    array = numbers(verb, name, list(value) if isinstance(value, range | tuple) else value)
    if array.ndim != 1 or not 0 < array.size <= MAX_TAXELS or (array % 1 != 0).any() or array.min() < 0:
        raise SceneError(f"{verb}: {name} must be numbers of taxels, as [3, 4], or 3,4 or 3:7; got {shown(value)}")
    return array.astype(int).tolist()


def _read_taxels(text: str) -> Any:
    """Return the taxel numbers in ``3``, ``3,5`` or, as in Python, ``3:7`` (3, 4, 5, 6); else the text."""
    found: list[int] = []
    for part in text.split(","):
        first, colon, end = part.partition(":")
        if not first.isdecimal() or (colon and not (end.isdecimal() and int(first) < int(end) <= MAX_TAXELS)):
            return text
        found += range(int(first), int(end)) if colon else [int(first)]
    return found


def plain(value: Any) -> Any:
    """Return the caller's tables, lists, texts and numbers as JSON has them; arrays become lists.

    Raises:
        TypeError, ValueError: a value is none of these.
    """
    return json.loads(json.dumps(value, default=lambda array: array.tolist(), allow_nan=False))


def _options(verb: str, name: str, value: Any) -> dict[str, Any]:
    try:
        given = plain(value)
    except (TypeError, ValueError, AttributeError, RecursionError):
        given = None
    if not isinstance(given, dict):
        raise SceneError(f"{verb}: {name} must be a table of plain values, got {shown(value)}")
    return given


def read_value(text: str) -> Any:
    """Return a number with or without a unit, ``5%``, or anything in JSON; else the text."""
    value = scaled(text, {"": 1.0, "%": 0.01, **LENGTHS_M, **TIMES_S})
    if value is not None:
        return value
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def read_options(words: list[str]) -> Any:
    """Return ``["noise=0.1", "bias=[0, 0, 1]"]`` as a table; words without ``=`` as one text."""
    pairs = [word.partition("=") for word in words]
    return {name: read_value(value) for name, given, value in pairs} if all(p[1] for p in pairs) else " ".join(words)


def _flag(text: str) -> Any:
    return {"yes": True, "true": True, "on": True, "no": False, "false": False, "off": False}.get(text.lower(), text)


def _vector_reader(units: Mapping[str, float]) -> Callable[[list[str]], Any]:
    read = _unit_reader(units)
    return lambda words: [read(word) for word in words]


Depth = Annotated[float, _number(units.Depth, "LENGTH", "number [m]", LENGTHS_M)]
Distance = Annotated[float, _number(units.Distance, "LENGTH", "number [m]", LENGTHS_M)]
Seconds = Annotated[float, _number(units.Seconds, "TIME", "number [s]", DURATIONS_S)]
Speed = Annotated[float, _number(units.MetresPerSecond, "SPEED", "number [m/s]", SPEEDS_M_S)]
Number = Annotated[float, _number(units.Number, "NUMBER", "number", {})]
NonNegativeInt = Annotated[int, replace(_number(units.Taxel, "N", "whole number", {}), read=_integer)]
Text = Annotated[str, ArgumentType("TEXT", _text)]
Name = Annotated[str, ArgumentType("NAME", _text)]
File = Annotated[str | os.PathLike, ArgumentType("FILE", _file)]
Flag = Annotated[bool, ArgumentType("yes|no", _true_or_false, _flag, "true or false")]
Position = Annotated[
    Any,
    ArgumentType("X Y Z", _vector(3, MAX_POSITION_M), _vector_reader(LENGTHS_M), "3 numbers [m]", 3),  # type: ignore[arg-type]
]
Velocity = Annotated[Any, ArgumentType("X Y Z", _vector(3, 1e3), _vector_reader(SPEEDS_M_S), "3 numbers [m/s]", 3)]  # type: ignore[arg-type]
AngularVelocity = Annotated[Any, ArgumentType("X Y Z", _vector(3, 1e4), _vector_reader({}), "3 numbers [rad/s]", 3)]  # type: ignore[arg-type]
Quaternion = Annotated[Any, ArgumentType("W X Y Z", _quaternion, _vector_reader({}), "4 numbers", 4)]  # type: ignore[arg-type]
QuaternionOrder = Annotated[rotation.Order, ArgumentType("wxyz|xyzw", _text, json="wxyz or xyzw")]
Taxels = Annotated[Any, ArgumentType("TAXELS", _taxels, _read_taxels, "list of whole numbers")]
Options = Annotated[Mapping[str, Any], ArgumentType("NAME=VALUE", _options, read_options, "table", 0)]  # type: ignore[arg-type]
