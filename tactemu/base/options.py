"""The checks of options against their declared types, with messages of one form."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from firmware_protocols.bounds import LARGEST, Bounds
from tactemu.base.errors import SceneError, nearest, shown


def number(where: str, name: str, value: Any, kind: Any = float) -> Any:
    """Return a number of a declared type.

    Args:
        where: the sensor, the model or the motion, for the message.
        name: the name of the option.
        value: the value of the user; neither a text nor a truth value is a number.
        kind: ``float``, ``int``, or one of them with :class:`~firmware_protocols.bounds.Bounds`, as in
            :mod:`tactemu.base.units`; without bounds the number is at most :data:`LARGEST`.

    Raises:
        SceneError: the value is no such number.
    """
    extras = getattr(kind, "__metadata__", ())
    bounds = next((each for each in extras if isinstance(each, Bounds)), Bounds())
    try:
        return bounds.check(value, whole=(typing.get_args(kind)[0] if extras else kind) is int)
    except ValueError as error:
        raise SceneError(f"{where}: {name} {error}") from None


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


def choice(where: str, name: str, value: Any, choices: Any) -> Any:
    """Return a value that is one of a ``Literal``'s.

    Raises:
        SceneError: it is another.
    """
    known = typing.get_args(choices)
    if not any(value is each or (type(value) is type(each) and value == each) for each in known):
        near = nearest(value, [each for each in known if isinstance(each, str)]) if isinstance(value, str) else ""
        raise SceneError(f"{where}: {name} must be one of {', '.join(map(str, known))}, got {shown(value)}{near}")
    return value


def check_declared(where: str, options: Any) -> None:
    """Check the options of a dataclass by their declared types: numbers and their bounds, switches, choices, texts,
    tuples, sequences, and unions of these. Options of other types are not checked.

    Args:
        where: the sensor, the model or the transducer, for the message.
        options: an instance of the dataclass.

    Raises:
        SceneError: an option is not of its type.
    """
    for name, hint in _types(type(options)).items():
        _check_type(where, name, getattr(options, name), hint)


def _check_type(where: str, name: str, value: Any, hint: Any) -> None:
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        _check_union(where, name, value, parts)
    elif hint is bool:
        if not isinstance(value, bool | np.bool_):
            raise SceneError(f"{where}: {name} must be true or false, got {shown(value)}")
    elif hint in (int, float) or (origin is typing.Annotated and parts[0] in (int, float)):
        number(where, name, value, hint)
    elif origin is typing.Literal:
        choice(where, name, value, hint)
    elif origin is typing.Annotated:
        _check_type(where, name, value, parts[0])
    elif origin is tuple and parts[-1] is not Ellipsis:
        array = numbers(where, name, value)
        if array.shape != (len(parts),):
            raise SceneError(f"{where}: {name} must be {len(parts)} numbers, got {shown(value)}")
        for k, (each, part) in enumerate(zip(array.tolist(), parts)):
            _check_type(where, f"{name}[{k}]", each, part)
    elif origin is Sequence or hint in (Sequence, np.ndarray):
        _check_several(where, name, value, parts[0] if parts else None)
    elif hint is not Any and isinstance(hint, type) and not isinstance(value, hint):
        raise SceneError(f"{where}: {name} must be {_words(hint)}, got {shown(value)}")


def _check_union(where: str, name: str, value: Any, parts: Sequence[Any]) -> None:
    """Check a value against the part of a union that takes one of its kind: ``None``, several values, or one."""
    if any(value is None if part is type(None) else part is Any for part in parts):
        return
    several = _is_several(value)
    possible = [part for part in parts if part is not type(None)]
    fitting = possible if len(possible) == 1 else [part for part in possible if _takes_several(part) == several]
    if len(fitting) == 1 or (several and fitting):
        _check_type(where, name, value, fitting[0])
    elif not any(_is_of(value, part) for part in fitting):
        *most, last = dict.fromkeys(map(_words, possible))
        expected = f"{', '.join(most)} or {last}" if most else last
        raise SceneError(f"{where}: {name} must be {expected}, got {shown(value)}")


def _check_several(where: str, name: str, value: Any, each: Any) -> None:
    """Check a sequence or an array: every element is ``each``; ``None``: all are numbers, in any shape."""
    if not _is_several(value):
        raise SceneError(f"{where}: {name} must be {_words(Sequence)}, got {shown(value)}")
    if each in (None, int, float):
        if not _has_numbers_only(value):
            raise SceneError(f"{where}: {name} must be numbers, got {shown(value)}")
    else:
        for k, element in enumerate(value):
            _check_type(where, f"{name}[{k}]", element, each)


def _is_several(value: Any) -> bool:
    """Return True for a sequence or an array that is no single number."""
    return hasattr(value, "__iter__") and not isinstance(value, str | bytes | Mapping) and getattr(value, "ndim", 1) > 0


def _takes_several(hint: Any) -> bool:
    origin = typing.get_origin(hint)
    if origin is typing.Annotated:
        return _takes_several(typing.get_args(hint)[0])
    return hint in (Sequence, np.ndarray) or origin in (Sequence, tuple)


def _is_of(value: Any, hint: Any) -> bool:
    try:
        _check_type("", "", value, hint)
    except SceneError:
        return False
    return True


def _has_numbers_only(value: Any) -> bool:
    """Return True if all elements are numbers; parts may have different lengths."""
    try:
        array = np.asarray(value)
    except ValueError:  # parts of different lengths
        return all(_is_several(part) and _has_numbers_only(part) for part in value)
    return array.dtype.kind in "iuf" or array.size == 0


def _words(hint: Any) -> str:
    """Return a type in the words of a message."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return _words(parts[0])
    if origin is typing.Literal:
        return f"one of {', '.join(map(str, parts))}"
    if _takes_several(hint):
        return "a list"
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    return names.get(hint, f"of type {getattr(hint, '__name__', hint)}")


@cache
def _types(options: type) -> dict[str, Any]:
    """Return the types of the options of a dataclass, by name; an empty table if its file imports types only for
    type checkers.
    """
    try:
        hints = typing.get_type_hints(options, include_extras=True)
    except NameError:
        return {}
    return {field.name: hints[field.name] for field in dataclasses.fields(options)}
