"""Mutations of the facts that a device declares: byte orders, lengths, neighbouring fields, orders of taxels.

A mutation is applied in place, tried, and undone. A fact is unpinned if all worked examples pass with its mutation.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from firmware_protocols.check.taxel_orders import ORDERS, reordered, wire_order_of
from firmware_protocols.declared import frames_of, tables_of
from firmware_protocols.device import Device
from firmware_protocols.registers import Reg, RegisterMap
from firmware_protocols.table_lines import Field, TableError, length_formula
from firmware_protocols.tables import Frame

MAX_SUM_START = 9
"""The bytes that a sum may leave out, as a hint."""
UNIT_FACTORS = {
    1e3: "N for mN?", 1e-3: "mN for N?", np.pi / 180: "rad for deg?", 180 / np.pi: "deg for rad?",
    9.80665: "m/s² for g?", 1 / 9.80665: "g for m/s²?",
}  # fmt: skip
"""The factors between units that are easily mistaken for each other."""


@dataclass(frozen=True)
class Mutation:
    """A change of one declared fact."""

    text: str
    """The changed fact in words."""
    apply: Callable[[], AbstractContextManager[Callable[[], bool]]]
    """Returns the context in which the mutation holds; it yields a function that returns True if it had an effect."""


def mutations_of(cls: type[Device], hints: bool = False) -> Iterator[Mutation]:
    """Yield every mutation of the tables, the registers and the order of the taxels.

    With ``hints`` also those that an example need not exclude, but that explain why one fails: further ranges of sums,
    and scales in other units.
    """
    for frame in frames_of(cls):
        for text, lines in _table_variants(frame, hints):
            yield Mutation(text, _table_mutation(frame, lines))
    for table in tables_of(cls, RegisterMap):
        for reg in table.rows:
            if reg.type[:1] in "<>" and not reg.type.endswith("1"):
                other = (">" if reg.type[0] == "<" else "<") + reg.type[1:]
                yield Mutation(f"register {reg.name} as {other}", _register_mutation(table, reg, other))
    for name in ORDERS:
        yield Mutation(f"taxels sent {name}", _order_mutation(cls, name))
    for sense in dict.fromkeys(each.sense for each in cls.columns) if hints else ():
        names = ", ".join(each.name for each in cls.columns if each.sense == sense)
        for factor, why in UNIT_FACTORS.items():
            yield Mutation(f"the scale of {names} times {factor:g} ({why})", _scale_mutation(cls, sense, factor))


# -- declared tables --------------------------------------------------------------------------------------------------


def words_of(cls: type[Device]) -> str:
    """Return the text of tables and docstrings, which may name the order of the taxels in words."""
    parts = [frame.about for frame in frames_of(cls)]
    parts += [field.about for frame in frames_of(cls) for field in frame.fields]
    parts += [reg.about for table in tables_of(cls, RegisterMap) for reg in table.rows]
    own = [each for each in cls.__mro__ if issubclass(each, Device) and each is not Device]
    parts += [sys.modules[each.__module__].__doc__ or "" for each in own]
    parts += [each.__doc__ or "" for each in own]
    parts += [fact.what for each in own for fact in vars(each).get("facts", ()) if hasattr(fact, "what")]
    text = " ".join(" ".join(parts).lower().replace("-", " ").split())
    return text.replace("row major", "row by row").replace("column major", "column by column")


# -- tables ------------------------------------------------------------------------------------------------------------


def _table_variants(frame: Frame, hints: bool) -> Iterator[tuple[str, list[Field]]]:
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
            yield from _sum_variants(place, field, frame.head, hints, put)
        if k + 1 < len(fields) and _is_plain_number(field) and _is_plain_number(fields[k + 1]):
            names = f"{field.name} and {fields[k + 1].name} of {frame.name}"
            yield f"{names} exchanged", [*fields[:k], fields[k + 1], field, *fields[k + 2 :]]


def _sum_variants(
    place: str, field: Field, head: bytes, hints: bool, put: Callable[..., list[Field]]
) -> Iterator[tuple[str, list[Field]]]:
    kind = field.text.split()[0]
    if kind == "xor8" or field.sum is None:
        starts = set()  # constant bytes that cancel, or are 0, would hide the difference
    else:
        starts = {0, 1, 2, len(head), *(range(MAX_SUM_START) if hints else ())} - {field.start}
        if kind in ("sum8", "inv8", "lrc8") and not sum(head) & 0xFF and not field.start:
            starts -= {len(head)}  # a head whose sum is 0 makes no difference
    for start in sorted(starts):
        yield f"{place} from byte {start}", put(replace(field, text=f"{kind} from {start}"))


def _other_lengths(formula: str) -> Iterator[str]:
    of, more = length_formula(formula)
    of = of if of == "total" else f"{formula.partition('(')[0]}({of})"
    for other in (more - 1, more + 1):
        yield f"{of} {'-' if other < 0 else '+'} {abs(other)}" if other else of


def _is_plain_number(field: Field) -> bool:
    return field.kind == "number" and not field.formula


def _table_mutation(frame: Frame, fields: Iterable[Field]) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    @contextmanager
    def apply() -> Iterator[Callable[[], bool]]:
        state = frame.__getstate__()
        try:
            frame.__setstate__({**state, "text": _written(state["text"], list(fields))})
            yield lambda: True
        except TableError:
            yield lambda: False  # the table is invalid, so no example needs to exclude it
        finally:
            frame.__setstate__(state)

    return apply


def _written(text: str, fields: list[Field]) -> str:
    """Return a table's text with these fields, with the offsets that follow from their sizes."""
    lines, at = [next(line.strip() for line in text.splitlines() if line.strip())], 0
    for k, field in enumerate(fields):
        last = field.offset == "last" and k == len(fields) - 1
        offset = "last" if last else ".." if at is None else str(at)
        name = f"{field.name or '-'} = {field.formula}" if field.formula else field.name or "-"
        lines.append(f"{offset}  {field.text}  {name}  {field.about}")
        size = 1 if field.text == "00" else None if any(isinstance(n, str) for n in field.shape) else field.size
        at = None if at is None or size is None else at + size
    return "\n".join(lines)


def _register_mutation(
    table: RegisterMap, reg: Reg, kind: str
) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    @contextmanager
    def apply() -> Iterator[Callable[[], bool]]:
        rows, by_name = table.rows, table.by_name
        other = replace(reg, type=kind)
        table.rows = tuple(other if each is reg else each for each in rows)
        table.by_name = by_name | {reg.name: other}
        vars(table).pop("defaults", None)  # cached, computed from the rows
        try:
            yield lambda: True
        finally:
            table.rows, table.by_name = rows, by_name
            vars(table).pop("defaults", None)

    return apply


# -- order of the taxels -----------------------------------------------------------------------------------------------


def _order_mutation(cls: type[Device], name: str) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    return lambda: reordered(cls, lambda layout: wire_order_of(layout, name))


# -- scales ------------------------------------------------------------------------------------------------------------


def _scale_mutation(
    cls: type[Device], sense: str, factor: float
) -> Callable[[], AbstractContextManager[Callable[[], bool]]]:
    @contextmanager
    def apply() -> Iterator[Callable[[], bool]]:
        declared, had = cls.columns, "columns" in vars(cls)

        def scaled(device: Device) -> Any:
            own = vars(device).get("columns", declared)
            return tuple(
                replace(each, **{name: getattr(each, name) and getattr(each, name) * factor for name in SCALES})
                if each.sense == sense
                else each
                for each in own
            )

        cls.columns = property(scaled, lambda device, columns: vars(device).update(columns=columns))  # type: ignore
        try:
            yield lambda: True
        finally:
            if had:
                cls.columns = declared
            else:
                del cls.columns

    return apply


SCALES = ("counts_per_unit", "assumed_per_unit")
"""The fields of a column with its scale."""
