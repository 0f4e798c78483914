"""The check of scales: what ``measure`` returns, and how much one unit on one point changes each count.

A column declares its scale, and the law is linear then: one newton on one taxel (0.1 g, 0.1 rad/s, 1 degree) changes
the taxel's count by the scale, and no other taxel's.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, source_line
from firmware_protocols.check.converter import by_sense
from firmware_protocols.check.host import SECOND_NS, Host, Subject
from firmware_protocols.check.readings import reading_of
from firmware_protocols.check.report import Fault
from firmware_protocols.device import Device
from firmware_protocols.senses import AXES, QUANTITY_UNITS, TOUCH, VECTORS, Column, Sense

UNITS = {"acceleration": 0.980665, "angular_velocity": 0.1, "temperature": 1.0, "depth": 1e-4, "displacement": 1e-4}
"""The amount by which a quantity is changed, SI; 1 for others."""
SETTLING_CONVERSIONS = 5
"""The number of conversions, a second apart, after which a filter has settled."""
MIN_COUNTS = 8
"""The smallest expected change, so that rounding does not hide a wrong scale."""
MAX_SHARE = 0.4
"""The largest expected change, as a share of the column's range."""
TOLERANCE = 0.02


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield senses that ``measure`` leaves out or adds, and counts whose change is not the one declared."""
    file, line = source_line(subject.cls, "measure")
    try:
        texts = list(_keys(subject)) or list(_slopes(subject))
    except AuthorError as error:
        yield Fault.of("scale", error)
        return
    yield from (Fault("scale", text, file, line) for text in texts)


def _declared(device: Device, stream: str) -> list[str]:
    """Return the keys of the stream's senses that have columns of their own."""
    first = device.sensed[0].key
    keys = {column.sense or first for column in device.columns if not column.shared}
    return [sense.key for sense in device.senses_of(stream) if sense.key in keys]


def _keys(subject: Subject) -> Iterator[str]:
    device = subject.make()
    host = Host(device)
    for stream in device.periods:
        found, declared = list(by_sense(device, stream, host.measure(stream))), _declared(device, stream)
        missing = [key for key in declared if key not in found]
        where = f" of stream {stream!r}" if stream else ""
        if missing:
            yield (
                f"{device.name}.measure leaves out {', '.join(map(repr, missing))}{where}, which have columns: it "
                f"returns {found}"
            )
        if odd := [key for key in found if key not in declared]:
            yield f"{device.name}.measure returns counts of {', '.join(map(repr, odd))}{where}, which have no columns"


def _slopes(subject: Subject) -> Iterator[str]:
    device = subject.make()
    first = device.sensed[0].key
    for stream in device.periods:
        for sense in device.senses_of(stream):
            columns = [c for c in device.columns if (c.sense or first) == sense.key and not c.shared]
            assert sense.at is not None
            if not columns or sense.quantity in ("vibration", "touch") or not len(sense.at) or sense.burst > 1:
                continue
            for k, column in enumerate(columns):
                if column.scale and (text := _slope_fault(subject, stream, sense, columns, k)):
                    yield text
                    break


def _slope_fault(subject: Subject, stream: str, sense: Sense, columns: list[Column], k: int) -> str:
    """Return the fault of one column, pressed at the first, a middle and the last point."""
    column = columns[k]
    amount = _amount(column, sense)
    has_own_law = column.unit and sense.quantity in TOUCH and column.unit != QUANTITY_UNITS[sense.quantity]
    if amount is None or has_own_law:
        return ""
    if (component := _component(column, columns, sense)) is None:
        return ""
    way = -1 if component == AXES.index("z") and column.push and sense.quantity in (*VECTORS, "wrench") else 1
    assert sense.at is not None
    n = len(sense.at)
    rest, silent, responding = _settled(subject, stream, sense, None), list[str](), False
    for point in dict.fromkeys((0, n // 2, n - 1)):
        counts = _settled(subject, stream, sense, (point, component, way * amount))
        if counts.shape != rest.shape or counts.reshape(n, -1).shape[1] != len(columns):
            return ""
        change = (counts - rest).reshape(n, -1)
        expected = amount * (column.scale or 0.0) * (column.push or 1)
        found = abs(change[point, k]) if sense.quantity == "load" else change[point, k]
        if _differs(found, expected, column):
            text = _described(subject, sense, columns, k, point, change, amount, expected)
            if change.any():
                return text
            silent.append(text)  # a point may lack an axis that others have
        else:
            responding = True
    return silent[0] if silent and not responding else ""


def _amount(column: Column, sense: Sense) -> float | None:
    """Return by how much to change the quantity [SI]; ``None`` where the column's range is too small."""
    scale = abs(column.scale or 0.0)
    amount = UNITS.get(sense.quantity, 1.0)
    room = min(MAX_SHARE * (column.high - column.low), *_room(column))
    smallest = 0.0 if column.is_float else MIN_COUNTS
    if room < smallest:
        return None
    return min(max(amount, smallest / scale), room / scale)


def _room(column: Column) -> tuple[float, ...]:
    """Return the counts between the rest and the end of the range in the direction of a push."""
    up, down = column.high - column.rest, column.rest - column.low
    return (up,) if column.push > 0 else (down,) if column.push < 0 else (max(up, down),)


def _component(column: Column, columns: list[Column], sense: Sense) -> int | None:
    """Return the index of the component that the column shows, -1 for a push; ``None`` for a magnitude."""
    if sense.quantity == "wrench":
        return columns.index(column) if len(columns) == 6 else None
    if column.axis:
        return AXES.index(column.axis)
    if sense.quantity in VECTORS:
        return -1 if column.push else None
    return -1


def _settled(subject: Subject, stream: str, sense: Sense, pressed: tuple[int, int, float] | None) -> np.ndarray:
    """Return the counts of a sense after the same reading for seconds."""
    device = subject.make()
    host = Host(device)
    values: Any = reading_of(device, 0.0, stream)[sense.key].astype(float)
    if pressed is not None:
        point, component, amount = pressed
        values = values.copy()
        values[point] += _added(sense, point, component, amount)
    counts = np.zeros(0)
    for _ in range(SETTLING_CONVERSIONS):
        host.t_ns += SECOND_NS
        counts = by_sense(device, stream, host.measure(stream, **{sense.key: values}))[sense.key]
    return counts.astype(float)


def _added(sense: Sense, point: int, component: int, amount: float) -> Any:
    """Return what a change of one component adds to the value of a point."""
    layout = sense.at
    assert layout is not None
    if sense.quantity in VECTORS:
        axes = layout.axes[point]
        return -amount * axes[2] if component < 0 else amount * axes[component]
    if component < 0:
        return amount
    return amount * np.eye(6 if sense.quantity == "wrench" else 3)[component]


def _differs(found: float, expected: float, column: Column) -> bool:
    return abs(found - expected) > TOLERANCE * abs(expected) + (0.0 if column.is_float else 1.01)


def _described(
    subject: Subject,
    sense: Sense,
    columns: list[Column],
    k: int,
    point: int,
    change: np.ndarray,
    amount: float,
    expected: float,
) -> str:
    column, name = columns[k], subject.cls.name
    unit = column.unit or (QUANTITY_UNITS[sense.quantity] if sense.quantity in TOUCH else "")
    along = f" along {column.axis}" if column.axis and sense.quantity != "wrench" else ""
    what = f"{amount:.4g} {unit}{along} on point {point} of {sense.key!r}"
    others = [j for j in range(len(columns)) if j != k and not _differs(abs(change[point, j]), abs(expected), column)]
    places = np.flatnonzero(np.abs(np.abs(change[:, k]) - abs(expected)) <= TOLERANCE * abs(expected) + 1.01)
    if not change[point, k] and others:
        return f"{name}.measure: {what} changes {columns[others[0]].name!r} and not {column.name!r}: exchanged?"
    if not change[point, k] and len(places) == 1:
        return f"{name}.measure: {what} changes the count of point {places[0]}: exchanged?"
    declared = "counts_per_unit" if column.counts_per_unit is not None else "assumed_per_unit"
    return (
        f"{name}.measure: {what} changes {column.name!r} by {change[point, k]:.6g} counts, {declared} "
        f"{column.scale:.6g} makes {expected:.6g}"
    )
