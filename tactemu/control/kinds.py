"""What an argument of a command may be: checked as a value, read from a text with its unit, described in a word."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from tactemu.base.errors import SceneError, shown
from tactemu.base.options import number, numbers
from tactemu.base.units import LENGTHS_M, SPEEDS_M_S, TIMES_S, scaled
from tactemu.geometry import rotation
from tactemu.geometry.limits import FARTHEST_M, METRES, MOST_DEPTH_M, MOST_S, SPEEDS

MOST_TAXELS = 1_000_000


@dataclass(frozen=True)
class Kind:
    """Of an argument."""

    word: str
    """What stands for it in help: ``LENGTH``."""
    check: Callable[[str, str, Any], Any]
    """``check(verb, name, value)`` gives the value as plain data, or raises a :class:`SceneError`."""
    read: Callable[[str], Any] = str
    """Its value in a text; what is none stays a text, for ``check`` to refuse."""
    json: str = "text"
    """What it is in JSON."""
    words: int = 1
    """How many words it takes on a command line; 0: all that are left."""


def _measured(units: Mapping[str, float]) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        value = scaled(text, {"": 1.0, **units})
        return text if value is None else value

    return read


def _number(units: Mapping[str, float], word: str, unit: str, **bounds: Any) -> Kind:
    def check(verb: str, name: str, value: Any) -> float:
        return number(verb, name, value, unit=unit, **bounds)

    return Kind(word, check, _measured(units), f"number [{unit.split()[0]}]" if unit else "number")


def _whole(verb: str, name: str, value: Any) -> int:
    return int(number(verb, name, value, at_least=0, at_most=MOST_TAXELS, whole=True))


def _integer(text: str) -> Any:
    return int(text) if text.isdecimal() else text


def _text(verb: str, name: str, value: Any) -> str:
    value = getattr(value, "name", value)  # a body may be given itself
    if not isinstance(value, str) or not value or not value.isprintable() or len(value) > 1000:
        raise SceneError(f"{verb}: {name} must be a text, got {shown(value)}")
    return value


def _file(verb: str, name: str, value: Any) -> str:
    """From where whoever says it is, and not from where the emulator is."""
    value = _text(verb, name, os.fspath(value) if isinstance(value, os.PathLike) else value)
    return os.path.abspath(os.path.expanduser(value))


def _truth(verb: str, name: str, value: Any) -> bool:
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
    if array.ndim != 1 or not 0 < array.size <= MOST_TAXELS or (array % 1 != 0).any() or array.min() < 0:
        raise SceneError(f"{verb}: {name} must be numbers of taxels, as [3, 4], or 3,4 or 3:7; got {shown(value)}")
    return array.astype(int).tolist()


def _read_taxels(text: str) -> Any:
    """``3``, ``3,5`` or, as in Python, ``3:7`` (3, 4, 5, 6)."""
    found: list[int] = []
    for part in text.split(","):
        first, colon, end = part.partition(":")
        if not first.isdecimal() or (colon and not (end.isdecimal() and int(first) < int(end) <= MOST_TAXELS)):
            return text
        found += range(int(first), int(end)) if colon else [int(first)]
    return found


def plain(value: Any) -> Any:
    """Return tables, lists, texts and numbers of a caller's as JSON has them; arrays become lists.

    Raises:
        TypeError, ValueError: it is none of these.
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
    """``["noise=0.1", "bias=[0, 0, 1]"]`` as a table."""
    pairs = [word.partition("=") for word in words]
    return {name: read_value(value) for name, given, value in pairs} if all(p[1] for p in pairs) else " ".join(words)


def _flag(text: str) -> Any:
    return {"yes": True, "true": True, "on": True, "no": False, "false": False, "off": False}.get(text.lower(), text)


def _of_vector(units: Mapping[str, float]) -> Callable[[list[str]], Any]:
    read = _measured(units)
    return lambda words: [read(word) for word in words]


Metres = Annotated[float, _number(LENGTHS_M, "LENGTH", METRES, at_least=-MOST_DEPTH_M, at_most=MOST_DEPTH_M)]
Seconds = Annotated[float, _number(TIMES_S, "TIME", "s", at_least=0, at_most=MOST_S)]
Speed = Annotated[float, _number(SPEEDS_M_S, "SPEED", "m/s", at_least=SPEEDS[0], at_most=SPEEDS[1])]
Number = Annotated[float, _number({}, "NUMBER", "")]
Whole = Annotated[int, Kind("N", _whole, _integer, "whole number")]
Text = Annotated[str, Kind("TEXT", _text)]
Name = Annotated[str, Kind("NAME", _text)]
File = Annotated[str | os.PathLike, Kind("FILE", _file)]
Flag = Annotated[bool, Kind("yes|no", _truth, _flag, "true or false")]
Position = Annotated[Any, Kind("X Y Z", _vector(3, FARTHEST_M), _of_vector(LENGTHS_M), "3 numbers [m]", 3)]  # type: ignore[arg-type]
Velocity = Annotated[Any, Kind("X Y Z", _vector(3, 1e3), _of_vector(SPEEDS_M_S), "3 numbers [m/s]", 3)]  # type: ignore[arg-type]
Turning = Annotated[Any, Kind("X Y Z", _vector(3, 1e4), _of_vector({}), "3 numbers [rad/s]", 3)]  # type: ignore[arg-type]
Quaternion = Annotated[Any, Kind("W X Y Z", _quaternion, _of_vector({}), "4 numbers", 4)]  # type: ignore[arg-type]
Taxels = Annotated[Any, Kind("TAXELS", _taxels, _read_taxels, "list of whole numbers")]
Options = Annotated[Mapping[str, Any], Kind("NAME=VALUE", _options, read_options, "table", 0)]  # type: ignore[arg-type]
