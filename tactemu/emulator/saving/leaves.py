"""The checks of a saved state, leaf by leaf, against the parts into which it is restored.

A file of a state may have been altered. The valid values of a leaf follow from the annotation of its attribute, from
the value in its place in the running part (of a device also in a fresh one), and from bounds for all numbers.
"""

from __future__ import annotations

import ast
import collections
import collections.abc
import inspect
import sys
import types
import typing
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from firmware_protocols import state as plain
from firmware_protocols.bounds import LARGEST
from tactemu.base.errors import StateError, shown

MAX_AHEAD_NS = 10**15
"""Largest excess of an integer over the time of the state: eleven days, the farthest time of a scheduled action."""
MAX_GROWTH = 1e3
"""Largest ratio of a float to the one in its place now, where that exceeds
:data:`~firmware_protocols.bounds.LARGEST`."""
_NO_HINT = object()
_NO_NUMBERS = (type(None), bool, str, bytes)


class LeafCheck:
    """A check of the values of a state against those in their places.

    Args:
        t_ns: the time of the state, which bounds the times and counts in it.
    """

    def __init__(self, t_ns: int):
        self.t_ns = t_ns
        self._max_int = t_ns + MAX_AHEAD_NS
        self._seen: set[int] = set()
        self._held: list[Any] = []
        self._may_be_infinite = False
        """True within a part with ``state()``, whose ``prepare_restore()`` checks that its arrays are finite."""

    def attributes(self, owner: type, found: Mapping[str, Any], here: Sequence[Mapping[str, Any]], where: str) -> None:
        """Check the attributes of one object of the class ``owner`` against those of the objects in its place.

        Raises:
            StateError: names the leaf, the expected value and the one found.
        """
        has_own, outer = hasattr(owner, "state"), self._may_be_infinite
        self._may_be_infinite = outer or has_own
        hints = {} if has_own else hints_of(owner)  # the keys of its state() are no attributes
        for name, value in found.items():
            there = [each[name] for each in here if name in each]
            self.value(value, there, hints.get(name, _NO_HINT), f"{where}.{name}".lstrip("."), _is_ours(owner))
        self._may_be_infinite = outer

    def value(self, value: Any, here: Sequence[Any], hint: Any, where: str, ours: bool) -> None:
        """Check one value, and the values in it.

        Args:
            value: from the state.
            here: the values in its place in the running parts; empty if there is none to compare.
            hint: the annotation of the attribute.
            where: the path of the value, for the message.
            ours: True if the emulator owns it, not the firmware of a device: then no integer is below -1.

        Raises:
            StateError: names the leaf, the expected value and the one found.
        """
        self._check_type(value, here, hint, where)
        if isinstance(value, _NO_NUMBERS):
            return
        if isinstance(value, int | float | np.generic):
            self._check_range(np.asarray(value), here, where, ours)
            return
        if id(value) in self._seen:
            return
        self._seen.add(id(value))
        self._held.append(value)
        if isinstance(value, np.ndarray):
            self._check_range(value, here, where, ours)
            return
        here = [each for each in here if type(each) is type(value)]
        if isinstance(value, dict):
            if typing.get_origin(hint) is collections.abc.Mapping and any(one.keys() != value.keys() for one in here):
                raise StateError(f"{where}: expected the keys {list(here[0])}, got {shown(list(value))}")
            every = [each for one in here for each in one.values()]
            inner = _inner_hint(value, hint)
            for key, each in value.items():
                there = [one[key] for one in here if key in one] or every
                self.value(each, there, inner, f"{where}[{shown(key)}]", ours)
        elif isinstance(value, list | deque | set | frozenset) or type(value) is tuple:
            self._check_items(value, here, hint, where, ours)
        elif not isinstance(value, bytearray | np.random.Generator | types.FunctionType):
            self._check_object(value, here, where)

    def _check_items(self, value: Any, here: Sequence[Any], hint: Any, where: str, ours: bool) -> None:
        inner = _inner_hint(value, hint)
        by_place = isinstance(value, tuple) and all(len(each) == len(value) for each in here)
        every = [each for one in here for each in one]
        for k, each in enumerate(value):
            there = [one[k] for one in here] if by_place else every
            self.value(each, there, inner, f"{where}[{k}]", ours)

    def _check_object(self, value: Any, here: Sequence[Any], where: str) -> None:
        found, there = _attributes(value), [_attributes(each) for each in here]
        if missing := [name for each in there for name in each if name not in found and not _is_cached(value, name)]:
            raise StateError(f"{where}: lacks {missing[0]}")
        if plain.has_own_state(type(value)):  # it has checked the sizes of its arrays itself
            there = [{k: each for k, each in one.items() if not isinstance(each, np.ndarray)} for one in there]
        self.attributes(type(value), found, there, where)

    def _check_type(self, value: Any, here: Sequence[Any], hint: Any, where: str) -> None:
        if hint is not _NO_HINT:
            if not fits(value, hint):
                raise StateError(f"{where}: expected {_name_of(hint)}, got {_kind_of(value)}")
        elif here and any(each is not None for each in here) and not any(_alike(each, value) for each in here):
            kinds = " or ".join(dict.fromkeys(_kind_of(each) for each in here))
            raise StateError(f"{where}: expected {kinds}, got {_kind_of(value)}")

    def _check_range(self, value: np.ndarray, here: Sequence[Any], where: str, ours: bool) -> None:
        """Check every number of ``value``."""
        if value.dtype.kind not in "iufc" or not value.size:
            if value.dtype.kind == "O":
                raise StateError(f"{where}: expected a number of at most 64 bits, got {shown(value.item())}")
            return
        comparable = [each for each in here if isinstance(each, int | float | np.generic | np.ndarray)]
        numbers = [each for each in map(np.asarray, comparable) if each.dtype.kind in "iufc" and each.size]
        if value.dtype.kind in "fc":
            finite = np.isfinite(value)
            may_be_infinite = self._may_be_infinite and value.ndim
            if not finite.all() and not may_be_infinite and all(np.isfinite(each).all() for each in numbers):
                raise StateError(f"{where}: expected finite numbers, got {value[~finite].flat[0]}")
            value = np.abs(value[finite])
            low, high = 0, max([LARGEST, *(MAX_GROWTH * _largest(each) for each in numbers)])
        elif ours:
            high = max([self._max_int, *(4 * _largest(each) for each in numbers)])
            low = -high if value.ndim else min([-1, *(-_largest(each.clip(max=0)) for each in numbers)])
        else:
            low, high = -(2**63), 2**64
        if value.size and not (low <= value.min() and value.max() <= high):
            raise StateError(
                f"{where}: expected numbers from {low:g} to {high:g}, got {value.min():g} to {value.max():g}"
            )


# -- annotations -------------------------------------------------------------------------------------------------------


@cache
def hints_of(cls: type) -> dict[str, Any]:
    """Return the annotations of a class's attributes, including those of ``self.name: type`` in its methods."""
    found: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        module = sys.modules.get(base.__module__)
        for name, text in _annotated(base) if module is not None else ():
            holder = types.SimpleNamespace(__annotations__={name: text})
            try:
                hint = typing.get_type_hints(holder, vars(module))[name]
            except (NameError, TypeError, AttributeError, SyntaxError):  # imported for type checkers only
                hint = Any
            if typing.get_origin(hint) is not typing.ClassVar:
                found[name] = hint
    return found


def _annotated(cls: type) -> Iterator[tuple[str, Any]]:
    yield from vars(cls).get("__annotations__", {}).items()
    for node in ast.walk(_source_of(cls)):
        if not isinstance(node, ast.AnnAssign) or not isinstance(target := node.target, ast.Attribute):
            continue
        if isinstance(target.value, ast.Name) and target.value.id == "self":
            yield target.attr, ast.unparse(node.annotation)


def _source_of(cls: type) -> ast.AST:
    """Return the definition of a class; an empty module if it has no source."""
    classes = _classes_of(cls.__module__)
    return classes.get(cls.__name__, ast.Module([], []))


@cache
def _classes_of(module: str) -> dict[str, ast.AST]:
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError, SyntaxError):
        return {}
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def fits(value: Any, hint: Any) -> bool:
    """Return True if a value is of an annotated type, or if the annotation cannot be checked."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(fits(value, each) for each in args)
    if origin is typing.Annotated:
        return fits(value, args[0])
    if origin is typing.Literal:
        return any(type(each) is type(value) and each == value for each in args)
    if hint is Any:
        return True
    if hint is None or hint is type(None):
        return value is None
    if hint in (bool, int, float):
        return _number_fits(value, hint)
    if isinstance(value, np.ndarray) and origin in (tuple, list, collections.abc.Sequence):
        return _is_numeric(value)
    if origin is tuple and args[-1:] != (...,):
        return type(value) is tuple and len(value) == len(args) and all(map(fits, value, args))
    if isinstance(origin, type):
        return isinstance(value, origin) and _items_fit(value, args)
    if isinstance(hint, type) and not getattr(hint, "_is_protocol", False):
        return isinstance(value, hint)
    return True


def _inner_hint(value: Any, hint: Any) -> Any:
    """Return the annotation of the items of a container, if all have the same one."""
    kinds = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    for kind in kinds:
        args = [each for each in typing.get_args(kind) if each is not ...]
        if (
            typing.get_origin(kind) is not None
            and fits(value, kind)
            and len(args) == (2 if isinstance(value, dict) else 1)
        ):
            return args[-1]
    return _NO_HINT


def _number_fits(value: Any, hint: type) -> bool:
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    numbers = (int, np.integer) if hint is int else (int, float, np.integer, np.floating)
    return isinstance(value, numbers) and not isinstance(value, bool)


def _items_fit(value: Any, args: tuple[Any, ...]) -> bool:
    if isinstance(value, collections.Counter):
        return all(fits(key, args[0]) and fits(each, int) for key, each in value.items())
    if isinstance(value, dict) and len(args) == 2:
        return all(fits(key, args[0]) and fits(each, args[1]) for key, each in value.items())
    if isinstance(value, list | tuple | deque | set | frozenset) and args:
        return all(fits(each, args[0]) for each in value)
    return True


# -- values ------------------------------------------------------------------------------------------------------------


def _alike(here: Any, there: Any) -> bool:
    """Return True if two values of one place have the same type; arrays also the same shape."""
    if isinstance(here, np.ndarray) and isinstance(there, np.ndarray):
        return here.shape == there.shape and (here.dtype == there.dtype or (_is_numeric(here) and _is_numeric(there)))
    return _kind_of(here) == _kind_of(there) or {_kind_of(here), _kind_of(there)} == {"float", "int"}


def _largest(array: np.ndarray) -> float:
    """Return the largest finite magnitude in an array; 0 where there is none."""
    magnitudes = np.abs(array.astype(np.float64))
    return float(magnitudes[np.isfinite(magnitudes)].max(initial=0))


def _is_numeric(array: np.ndarray) -> bool:
    return array.dtype.kind in "iuf"


def _kind_of(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array {value.shape} {value.dtype}"
    for kind, types_ in {"bool": np.bool_, "int": np.integer, "float": np.floating}.items():
        if isinstance(value, types_):
            return kind
    return "null" if value is None else type(value).__name__


def _name_of(hint: Any) -> str:
    return hint.__name__ if type(hint) is type else str(hint).replace("typing.", "")


def _attributes(value: Any) -> dict[str, Any]:
    if isinstance(value, tuple):  # a named one
        return dict(zip(getattr(type(value), "_fields", ()), value))
    return {} if isinstance(value, bytes) else plain.attributes_of(value)


def _is_cached(value: Any, name: str) -> bool:
    return hasattr(getattr(type(value), name, None), "__set_name__")


def _is_ours(cls: type) -> bool:
    return cls.__module__.startswith("tactemu.")
