"""Frame tables of the kit from groups of messages: the text that encodes them, and the count of what it gives back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_protocols import Frame
from tactemu.fit.infer.fields import VALUE_KINDS, Field, Group
from tactemu.fit.infer.segments import LEAST_ROWS

CODES = {1: "1", 2: "2", 4: "4", 8: "8"}
MAX_CONSTANT = 16
"""The largest number of bytes in one line of constants."""


@dataclass(frozen=True)
class Line:
    """One line of a frame table."""

    at: int
    size: int
    type: str
    name: str = ""
    about: str = ""
    fields: tuple[Field, ...] = ()


def lines_of(group: Group) -> list[Line]:
    """Return the lines of the table of a group; every byte of its messages is in one."""
    rows = group.rows
    varies = (rows != rows[0]).any(axis=0)
    covering = _covering(group)
    lines: list[Line] = []
    at = 0
    while at < group.length:
        each = covering.get(at)
        if each is not None and each.at == at and each.end <= group.length:
            line = _field_line(group, each, covering)
        elif varies[at]:
            end = at
            while end < group.length and varies[end] and end not in covering:
                end += 1
            line = Line(at, max(end - at, 1), f"bytes x {max(end - at, 1)}", f"open_{at}", "not understood")
        else:
            line = _constant_line(rows[0], varies, covering, at)
        lines.append(line)
        at += line.size
    return lines


def _covering(group: Group) -> dict[int, Field]:
    """Return the field of each byte; packed values share one."""
    covering: dict[int, Field] = {}
    for each in group.fields:
        for k in range(each.at, each.end):
            covering.setdefault(k, each)
    return covering


def _constant_line(row: np.ndarray, varies: np.ndarray, covering: dict[int, Field], at: int) -> Line:
    end = at
    while end < len(row) and not varies[end] and end not in covering and end - at < MAX_CONSTANT:
        if end > at + 1 and row[end] != row[at] and len(set(row[at:end].tolist())) == 1:
            break
        end += 1
    values = row[at:end]
    if len(values) > 2 and len(set(values.tolist())) == 1:
        while end < len(row) and not varies[end] and end not in covering and row[end] == values[0]:
            end += 1
        return Line(at, end - at, f"{values[0]:02X} x {end - at}", "", "never moved")
    return Line(at, end - at, bytes(values).hex(" ").upper(), "", "never moved")


def _field_line(group: Group, each: Field, covering: dict[int, Field]) -> Line:
    if each.kind == "sum" and group.sum is not None:
        return _sum_line(group, each)
    if each.kind in ("length", "selector") and not each.bits and not _moves(group, each.at, each.end):
        value = group.rows[0, each.at : each.end].tobytes().hex(" ").upper()
        return Line(each.at, each.size, value, "", each.kind, (each,))
    if each.bits or each.size not in CODES:
        return _packed_line(group, each, covering)
    same = [each]
    while (following := covering.get(same[-1].end)) is not None and _is_alike(each, following, same[-1].end):
        same.append(following)
    letter = each.kind if each.kind in ("i", "f") else "u"
    code = f"{each.order}{letter}{each.size}"
    name = {"counter": "counter", "clock": "clock", "length": "length", "selector": "selector"}.get(each.kind, "values")
    several = f" x {len(same)}" if len(same) > 1 else ""
    return Line(each.at, each.size * len(same), code + several, f"{name}_{each.at}", _about(same), tuple(same))


def _moves(group: Group, begin: int, end: int) -> bool:
    return bool((group.rows[:, begin:end] != group.rows[0, begin:end]).any())


def _is_alike(each: Field, other: Field, at: int) -> bool:
    kinds = {"?": "u"}
    return (
        other.at == at
        and not other.bits
        and (kinds.get(other.kind, other.kind), other.size, other.order)
        == (kinds.get(each.kind, each.kind), each.size, each.order)
        and each.kind in ("u", "i", "f", "?")
        and other.is_certain == each.is_certain
    )


def _packed_line(group: Group, each: Field, covering: dict[int, Field]) -> Line:
    inside = [each]
    end = each.end
    for other in sorted(group.fields, key=lambda field: (field.at, field.shift)):
        if other.at < end and other.end > each.at and other is not each:
            inside.append(other)
            end = max(end, other.end)
    end = min(end, group.length)
    words = ", ".join(f"{field.width} bits from bit {field.shift} of byte {field.at}" for field in inside[:4])
    return Line(each.at, end - each.at, f"bytes x {end - each.at}", f"packed_{each.at}", words, tuple(inside))


def _sum_line(group: Group, each: Field) -> Line:
    found = group.sum
    assert found is not None
    name = found.kit_name
    is_plain = name is not None and found.end == found.at and each.end == group.length
    if is_plain and all(found.holds(row.tobytes()) for row in group.rows):
        start = f" from {found.start}" if found.start else ""
        return Line(
            each.at,
            each.size,
            f"{found.order if found.width > 1 else ''}{name}{start}",
            "check",
            _about([each]),
            (each,),
        )
    return Line(each.at, each.size, f"bytes x {each.size}", "check", f"{found}", (each,))


def _about(fields: list[Field]) -> str:
    first = fields[0]
    if first.kind == "sum":
        return "certain: it holds in every message" if first.is_certain else "likely"
    if first.is_certain:
        return f"certain: {first.why}"
    wider = "; bytes beside it may belong to it" if first.is_width_open else ""
    return f"likely{wider}; decided by {first.decide}" if first.decide else f"likely{wider}"


def table_text(group: Group, name: str) -> str:
    """Return the text of the frame table of a group."""
    rows = [(str(line.at), line.type, line.name, line.about) for line in lines_of(group)]
    if rows and lines_of(group)[-1].name == "check" and "bytes" not in rows[-1][1]:
        rows[-1] = ("last", *rows[-1][1:])
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    body = []
    for row in rows:
        name_cell = row[2] or "still"
        cells = [row[0].ljust(widths[0]), row[1].ljust(widths[1]), name_cell.ljust(max(widths[2], 5)), row[3]]
        body.append("    " + "  ".join(cells).rstrip())
    return "\n".join([f"    {name}", *body])


def table_of(group: Group) -> Frame:
    """Return the compiled frame table of a group."""
    return Frame(f"\n{table_text(group, 'message')}\n")


@dataclass
class Coverage:
    """The bytes of a capture by what stands behind them."""

    sent: int = 0
    """All bytes of the sensor."""
    values: int = 0
    """The bytes behind values, counters and clocks."""
    checks: int = 0
    """The bytes behind sums, lengths and selectors."""
    still: int = 0
    """The bytes that never move in their group."""
    encoded: int = 0
    """The bytes that come back when the decoded values are encoded again."""

    def __add__(self, other: Coverage) -> Coverage:
        return Coverage(*(a + b for a, b in zip(vars(self).values(), vars(other).values())))


def coverage_of(group: Group, table: Frame | None) -> Coverage:
    """Return what stands behind the bytes of a group, and how many its table encodes as they came."""
    n, found = len(group.rows), Coverage()
    found.sent = n * group.length
    if len(group.rows) < LEAST_ROWS:
        return found if table is None else _encoded(group, table, found)
    kinds = {k: each.kind for each in group.fields for k in range(each.at, min(each.end, group.length))}
    varies = (group.rows != group.rows[0]).any(axis=0)
    for k in range(group.length):
        kind = kinds.get(k)
        if kind in VALUE_KINDS or kind == "bits":
            found.values += n
        elif kind is not None:
            found.checks += n
        elif not varies[k]:
            found.still += n
    return found if table is None else _encoded(group, table, found)


def encoded_bytes(group: Group, rows: np.ndarray) -> int:
    """Return how many bytes of more messages the table of a group encodes as they came: constants and sums decide."""
    taken = {k for each in group.fields for k in range(each.at, each.end)}
    varies = (group.rows != group.rows[0]).any(axis=0)
    still = np.array([k for k in range(group.length) if not varies[k] and k not in taken], int)
    good = (rows[:, still] == group.rows[0, still]).all(axis=1)
    if group.sum is not None and any(line.name == "check" and "bytes" not in line.type for line in lines_of(group)):
        found = group.sum
        good &= np.array([found.holds(row.tobytes()) for row in rows], bool)
    return int(good.sum()) * group.length


def _encoded(group: Group, table: Frame, found: Coverage) -> Coverage:
    for row in group.rows:
        message = row.tobytes()
        values = table.unpack(message)
        found.encoded += len(message) if values is not None and table.pack(**values) == message else 0
    return found
