"""The options of a device, declared once, as annotated keyword arguments of its ``__init__``::

    def __init__(self, *, rows: Annotated[int, Option("as the board was flashed", low=1)] = 12): ...

The checks of :func:`checked`, the command line (``rows=16``), scene files and the datasheet follow from that.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

LARGEST = 1e12
"""The largest magnitude of a number that is no integer, in SI units: the product of three still fits float32."""
LARGEST_INT = 2**63 - 1
"""The largest magnitude of an integer; serial numbers and times in nanoseconds fit."""


@dataclass(frozen=True)
class Option:
    """The meaning, unit and bounds of an option."""

    about: str = ""
    unit: str = ""
    low: float | None = None
    """The smallest valid value."""
    high: float | None = None
    """The largest valid value."""


@dataclass(frozen=True)
class Declared:
    """An option as a device declares it."""

    name: str
    annotation: Any
    default: Any
    option: Option

    def __str__(self) -> str:
        bounds = [f">= {self.option.low:g}"] if self.option.low is not None else []
        bounds += [f"<= {self.option.high:g}"] if self.option.high is not None else []
        extra = ", ".join(part for part in (self.option.unit, *bounds, self.option.about) if part)
        return f"{self.name} = {self.default!r}" + (f"   {extra}" if extra else "")


def declared(device: type) -> dict[str, Declared]:
    """Return the options of a device class, by name."""
    hints = typing.get_type_hints(device.__init__, include_extras=True)
    found = {}
    for name, parameter in list(inspect.signature(device.__init__).parameters.items())[1:]:
        if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        annotation = hints.get(name, Any)
        option = next((each for each in typing.get_args(annotation)[1:] if isinstance(each, Option)), Option())
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
        near = get_close_matches(name, list(known), n=1, cutoff=0.5)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown option {name!r}{hint} (options: {', '.join(known) or 'none'})")
    from pydantic import ConfigDict, TypeAdapter, ValidationError

    each = known[name]
    try:
        config = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False)
        value = TypeAdapter(each.annotation, config=config).validate_python(_from_text(value, each.annotation))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"option {name}: {first['msg'][0].lower()}{first['msg'][1:]}, got {_shown(value)}") from None
    for number in value if isinstance(value, list | tuple) else [value]:
        if isinstance(number, int | float):
            _check_bounds(name, number, each.option, value)
    return value


def _from_text(value: Any, annotation: Any) -> Any:
    """Return the list of a text ``[1, 2, 3]``, or the number of a ``Literal`` in it, or else the value itself."""
    kind = typing.get_args(annotation)[0] if typing.get_origin(annotation) is typing.Annotated else annotation
    if typing.get_origin(kind) is typing.Literal:
        return next((member for member in typing.get_args(kind) if str(member) == value), value)
    if isinstance(value, str) and value.startswith("[") and value.endswith("]"):
        return [part.strip() for part in value[1:-1].split(",")]
    return value


def _check_bounds(name: str, number: float, option: Option, value: Any) -> None:
    """Raise ValueError if a number is outside the bounds of its option, or larger than any number of a device."""
    largest = LARGEST_INT if isinstance(number, int) else LARGEST
    low = -largest if option.low is None else option.low
    high = largest if option.high is None else option.high
    if not low <= number <= high:
        named = (f">= {low:g}" if option.low is not None or number < low else "",
                 f"<= {high:g}" if option.high is not None or number > high else "")  # fmt: skip
        raise ValueError(f"option {name}: expected {' and '.join(filter(None, named))}, got {_shown(value)}")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]} ... ({len(text)} characters)"


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
