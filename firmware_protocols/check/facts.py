"""Facts that a device declares, and each of them changed: byte orders, lengths, neighbours, orders of taxels.

A change is made in place, tried, and taken back. What a worked example does not notice, no example vouches for.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from firmware_protocols.device import Device
from firmware_protocols.layouts import Layout, Patch
from firmware_protocols.registers import Reg, RegisterMap
from firmware_protocols.table_lines import Field, TableError, length_formula
from firmware_protocols.tables import Frame


@dataclass(frozen=True)
class Change:
    """One declared fact in another way."""

    text: str
    """What is true then."""
    made: Callable[[], AbstractContextManager[Callable[[], bool]]]
    """Within it the change holds; what it yields says whether it came to bear."""


def changes(cls: type[Device]) -> Iterator[Change]:
    """Every change of the tables, the registers and the order of the taxels."""
    for frame in frames_of(cls):
        for text, lines in _of_table(frame):
            yield Change(text, _table_change(frame, lines))
    for table in held(cls, RegisterMap):
        for reg in table.rows:
            if reg.type[:1] in "<>" and not reg.type.endswith("1"):
                other = (">" if reg.type[0] == "<" else "<") + reg.type[1:]
                yield Change(f"register {reg.name} as {other}", _register_change(table, reg, other))
    for name in WAYS:
        yield Change(f"taxels sent {name}", _order_change(cls, name))


# -- what is declared --------------------------------------------------------------------------------------------------


def frames_of(cls: type[Device]) -> list[Frame]:
    """Return the frame tables in the device's modules and classes."""
    return held(cls, Frame)


def held(cls: type[Device], kind: type | tuple[type, ...]) -> list[Any]:
    """Return the tables of a kind in the device's modules and classes, also in dicts and lists."""
    own = [each for each in cls.__mro__ if issubclass(each, Device) and each is not Device]
    places = [*(vars(sys.modules[each.__module__]) for each in own), *(vars(each) for each in own)]
    found: dict[int, Any] = {}
    for value in (each for place in places for each in list(place.values())):
        inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else [value]
        found |= {id(each): each for each in inner if isinstance(each, kind)}
    return list(found.values())


def words_of(cls: type[Device]) -> str:
    """What tables and docstrings say, in which the order of the taxels may stand in words."""
    parts = [frame.about for frame in frames_of(cls)]
    parts += [field.about for frame in frames_of(cls) for field in frame.fields]
    parts += [reg.about for table in held(cls, RegisterMap) for reg in table.rows]
    own = [each for each in cls.__mro__ if issubclass(each, Device) and each is not Device]
    parts += [sys.modules[each.__module__].__doc__ or "" for each in own]
    parts += [each.__doc__ or "" for each in own]
    parts += [fact.what for each in own for fact in vars(each).get("facts", ()) if hasattr(fact, "what")]
    text = " ".join(" ".join(parts).lower().replace("-", " ").split())
    return text.replace("row major", "row by row").replace("column major", "column by column")


# -- tables ------------------------------------------------------------------------------------------------------------


def _of_table(frame: Frame) -> Iterator[tuple[str, list[Field]]]:
    fields = list(frame.fields)
    for k, field in enumerate(fields):
        place = f"{frame.name}.{field.name}"

        def put(*new: Field, k: int = k) -> list[Field]:
            return [*fields[:k], *new, *fields[k + 1 :]]

        if field.kind == "const" and not field.formula:
            continue
        if field.kind in ("number", "sum") and field.dtype.itemsize > 1:
            other = "<" if field.byte_order == ">" else ">"
            text = field.text.replace(field.byte_order, other, 1)
            yield f"{place} as {text}", put(replace(field, text=text))
        if field.formula:
            for formula in _other_lengths(field.formula):
                yield f"{place} = {formula}", put(replace(field, formula=formula))
        if field.kind in ("number", "bytes"):
            yield (
                f"one byte more before {place}",
                put(replace(field, text="00", name="more", formula="", about=""), field),
            )
        if field.kind == "sum":
            yield from _of_sum(place, field, frame.head, put)
        if k + 1 < len(fields) and _plain(field) and _plain(fields[k + 1]):
            names = f"{field.name} and {fields[k + 1].name} of {frame.name}"
            yield f"{names} exchanged", [*fields[:k], fields[k + 1], field, *fields[k + 2 :]]


def _of_sum(
    place: str, field: Field, head: bytes, put: Callable[..., list[Field]]
) -> Iterator[tuple[str, list[Field]]]:
    kind = field.text.split()[0]
    if kind == "xor8" or field.sum is None:
        starts = set()  # constant bytes that cancel, or are 0, would hide it
    else:
        starts = {0, 1, 2, len(head)} - {field.start}
        if kind in ("sum8", "inv8", "lrc8") and not sum(head) & 0xFF and not field.start:
            starts -= {len(head)}  # a head that adds up to nothing does not show
    for start in sorted(starts):
        yield f"{place} from byte {start}", put(replace(field, text=f"{kind} from {start}"))


def _other_lengths(formula: str) -> Iterator[str]:
    of, more = length_formula(formula)
    of = of if of == "total" else f"len({of})"
    for other in (more - 1, more + 1):
        yield f"{of} {'-' if other < 0 else '+'} {abs(other)}" if other else of


def _plain(field: Field) -> bool:
    return field.kind == "number" and not field.formula


def _table_change(frame: Frame, fields: Iterable[Field]) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    @contextmanager
    def made() -> Iterator[Callable[[], bool]]:
        state = frame.__getstate__()
        try:
            frame.__setstate__({**state, "text": _written(state["text"], list(fields))})
            yield lambda: True
        except TableError:
            yield lambda: False  # a table that cannot be: no example needs to speak against it
        finally:
            frame.__setstate__(state)

    return made


def _written(text: str, fields: list[Field]) -> str:
    """Return a table's text with these fields, offsets as they follow."""
    lines, at = [next(line.strip() for line in text.splitlines() if line.strip())], 0
    for k, field in enumerate(fields):
        last = field.offset == "last" and k == len(fields) - 1
        offset = "last" if last else ".." if at is None else str(at)
        name = f"{field.name or '-'} = {field.formula}" if field.formula else field.name or "-"
        lines.append(f"{offset}  {field.text}  {name}  {field.about}")
        size = 1 if field.text == "00" else None if any(isinstance(n, str) for n in field.shape) else field.size
        at = None if at is None or size is None else at + size
    return "\n".join(lines)


def _register_change(
    table: RegisterMap, reg: Reg, kind: str
) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    @contextmanager
    def made() -> Iterator[Callable[[], bool]]:
        rows, by_name = table.rows, table.by_name
        other = replace(reg, type=kind)
        table.rows = tuple(other if each is reg else each for each in rows)
        table.by_name = by_name | {reg.name: other}
        vars(table).pop("defaults", None)  # made of the rows, and kept
        try:
            yield lambda: True
        finally:
            table.rows, table.by_name = rows, by_name
            vars(table).pop("defaults", None)

    return made


# -- order of the taxels -----------------------------------------------------------------------------------------------

WAYS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "row by row": lambda grid: grid,
    "row by row from the right": lambda grid: grid[:, ::-1],
    "row by row from the bottom": lambda grid: grid[::-1],
    "row by row from the bottom right": lambda grid: grid[::-1, ::-1],
    "column by column": lambda grid: grid.T,
    "column by column from the bottom": lambda grid: grid[::-1].T,
    "column by column from the right": lambda grid: grid[:, ::-1].T,
    "there and back": lambda grid: np.array([row[:: 1 - 2 * (k % 2)] for k, row in enumerate(grid)]),
    "last patch first": lambda grid: grid,
}
"""How the taxels of a patch may follow on the wire, by the words for it."""


def order(layout: Layout, way: str) -> np.ndarray:
    """``wire_order`` if the taxels follow in this way, patch by patch."""
    patches = sorted(layout.patches, key=lambda patch: patch.start)
    runs = [order_of(patch, way) for patch in patches]
    return np.concatenate(runs[::-1] if way == "last patch first" else runs)


def order_of(patch: Patch, way: str) -> np.ndarray:
    """Return taxels of a patch as they follow in this way; those of a free one lie in one row."""
    return WAYS[way](np.arange(patch.start, patch.start + len(patch)).reshape(max(patch.rows, 1), -1)).ravel()


def ways(layout: Layout, found: np.ndarray) -> list[str]:
    """Return the words that fit an order."""
    return [way for way in WAYS if np.array_equal(order(layout, way), found)]


def said(text: str) -> list[str]:
    """Return the ways that a text speaks of; of words that contain each other the longer ones."""
    found = [way for way in WAYS if way in text]
    return [way for way in found if not any(way != other and way in other for other in found)]


def _order_change(cls: type[Device], way: str) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    return lambda: reordered(cls, lambda layout: order(layout, way))


@contextmanager
def reordered(cls: type[Device], turned: Callable[[Layout], np.ndarray]) -> Iterator[Callable[[], bool]]:
    """Devices of the class get a layout with another ``wire_order``; yields whether any order was another one."""
    changed: list[np.ndarray] = []

    def put(device: Device, layout: Layout) -> None:
        other = turned(layout)
        if not np.array_equal(other, layout.wire_order) and not any(np.array_equal(other, each) for each in changed):
            changed.append(other)
        vars(device)["layout"] = replace(layout, wire_order=other)

    cls.layout = property(lambda device: vars(device)["layout"], put)  # type: ignore[assignment]
    try:
        yield lambda: bool(changed)
    finally:
        del cls.layout
