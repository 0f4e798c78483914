"""The checks of options, with messages of one form."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Collection
from functools import cache
from typing import Any

import numpy as np

from firmware_protocols.options import LARGEST
from tactemu.base.errors import SceneError, shown


def number(
    where: str,
    name: str,
    value,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    integer: bool = False,
    unit: str = "",
) -> float:
    """Return a finite number, within its bounds; without ``at_most`` none is larger than :data:`LARGEST`.

    Args:
        where: the sensor, the model or the motion, for the message.
        name: the name of the option.
        value: the value of the user; neither a text nor a truth value is a number.
        above: it must be greater than this.
        at_least: it must not be less than this.
        at_most: it must not be more than this.
        integer: it must be a whole number.
        unit: the unit in the message.

    Raises:
        SceneError: the value is no such number.
    """
    limits = {">": above, ">=": at_least, "<=": at_most}
    bounds = [f"{sign} {bound:g}" for sign, bound in limits.items() if bound is not None]
    try:
        got = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        got = math.nan
    largest = LARGEST if at_most is None else max(LARGEST, at_most)
    if LARGEST < got < math.inf and at_most is None:
        bounds.append(f"<= {LARGEST:g}")
    elif -math.inf < got < -LARGEST and above is None and at_least is None:
        bounds.append(f">= {-LARGEST:g}")
    too_low = (above is not None and not got > above) or (at_least is not None and not got >= at_least)
    too_high = at_most is not None and not got <= at_most
    if not abs(got) <= largest or too_low or too_high or (integer and got != int(got)):
        kind = ["a whole number"] if integer else [] if bounds else ["a finite number"]
        expected = " ".join([*kind, " and ".join(bounds), unit])
        raise SceneError(f"{where}: {name} must be {' '.join(expected.split())}, got {shown(value)}")
    return got


def numbers(where: str, name: str, value) -> np.ndarray:
    """Return a float64 array of finite numbers, none larger than :data:`LARGEST`, of any shape.

    Neither texts nor truth values are numbers.

    Raises:
        SceneError: the value is no such array.
    """
    try:
        given = np.asarray(value)
        array = given.astype(np.float64) if given.dtype.kind in "iuf" or given.size == 0 else None
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is None:
        raise SceneError(f"{where}: {name} must be numbers in a regular shape, got {shown(value)}")
    if not np.isfinite(array).all():
        raise SceneError(f"{where}: {name} must be finite, got {shown(value)}")
    if (np.abs(array) > LARGEST).any():
        raise SceneError(f"{where}: {name} must be from {-LARGEST:g} to {LARGEST:g}, got {shown(value)}")
    return array


def triple(where: str, name: str, value) -> np.ndarray:
    """Return a float64 array of three finite numbers.

    Raises:
        SceneError: the value is no such array.
    """
    array = numbers(where, name, value)
    if array.shape != (3,):
        raise SceneError(f"{where}: {name} must be 3 numbers, got {shown(value)}")
    return array


def check_declared(where: str, options: Any, unbounded: Collection[str] = ()) -> None:
    """Check the options of a dataclass by their declared types: numbers, switches, tuples.

    Args:
        where: the sensor, the model or the transducer, for the message.
        options: an instance of the dataclass.
        unbounded: names of numbers that may be larger than :data:`LARGEST`, or infinite.

    Raises:
        SceneError: an option is not of its type: a finite number, a switch, or a tuple of the declared length.
    """
    for name, hint in _types(type(options)).items():
        value, parts = getattr(options, name), typing.get_args(hint)
        if isinstance(hint, types.UnionType) and len(parts) == 2 and type(None) in parts:
            if value is None:
                continue
            hint = next(part for part in parts if part is not type(None))
        if hint is bool and not isinstance(value, bool | np.bool_):
            raise SceneError(f"{where}: {name} must be true or false, got {shown(value)}")
        if hint in (int, float) and not (name in unbounded and isinstance(value, int | float) and value > LARGEST):
            number(where, name, value, integer=hint is int)
        if typing.get_origin(hint) is tuple and numbers(where, name, value).shape != (len(typing.get_args(hint)),):
            raise SceneError(f"{where}: {name} must be {len(typing.get_args(hint))} numbers, got {shown(value)}")


@cache
def _types(options: type) -> dict[str, Any]:
    """Return the types of the options of a dataclass, by name; an empty table if its file imports types only for
    type checkers.
    """
    try:
        hints = typing.get_type_hints(options)
    except NameError:
        return {}
    return {field.name: hints[field.name] for field in dataclasses.fields(options)}
