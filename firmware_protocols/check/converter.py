"""The ADC: as many counts as points, within the span of their columns, in their direction, however hard the push."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, error_of_result, source_line
from firmware_protocols.check.host import SECOND, Host, Subject
from firmware_protocols.check.report import Fault
from firmware_protocols.device import CONTACT, Column, Device, Sense

PUSHES = (0.0, *np.geomspace(1e-3, 1e9, 37).tolist())
"""Newtons on every taxel."""
PULL = -1e9
TIMES_S = (0, 70, 5_000, 5_000_000)
"""Clocks of 16 and 32 bits in milliseconds or microseconds are full in between."""
CONVERSIONS = 300
"""A counter of 8 bits is full by then."""
FAR = (-1e6, 1e6)
"""SI, of temperatures, accelerations and what else is no touch."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Wrong lengths, wraps, wrong directions, spans that do not hold, and fields that overflow."""
    yield from _ramp(subject)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for check in (_far, _late, _full):
            try:
                check(subject)
            except AuthorError as error:
                yield Fault.of("range", error)


def feels_touch(device: Device) -> bool:
    """Whether any of its senses sees its taxels: motors see loads alone."""
    return any(sense.quantity in (*CONTACT, "wrench", "vibration") for sense in device.sensed)


def by_sense(device: Device, stream: str, counts: Any) -> dict[str, np.ndarray]:
    """Return counts by the key of their sense.

    Raises:
        AuthorError: not as many as the sense has points, of another sense, or not finite.
    """
    senses = {sense.key: sense for sense in device.senses_of(stream)}
    found = counts if isinstance(counts, Mapping) else {next(iter(senses)): counts}
    for key, values in found.items():
        if key not in senses:
            raise error_of_result(
                device, "measure", f"returned counts of {key!r}; stream {stream!r} has {list(senses)}"
            )
        values, at = np.asarray(values), senses[key].at
        assert at is not None
        if values.ndim < 1 or len(values) != len(at):
            what = f"{len(values)} counts" if values.ndim else "one number"
            raise error_of_result(device, "measure", f"returned {what} for the {len(at)} points of {key!r}")
        if not np.isfinite(values.astype(float)).all():
            raise error_of_result(device, "measure", f"returned counts of {key!r} that are not finite")
    return {key: np.asarray(values) for key, values in found.items()}


def _ramp(subject: Subject) -> Iterator[Fault]:
    rows: dict[str, list[np.ndarray]] = {}
    for newtons in (PULL, *PUSHES):
        device = subject.make()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                host = Host(device, newtons)
                found = {}
                for stream in device.periods:
                    found |= by_sense(device, stream, host.measure(stream))
        except AuthorError as error:
            yield Fault.of("converter", error, f"a push of {newtons:g} N on every taxel: ")
            return
        for key, counts in found.items():
            rows.setdefault(key, []).append(counts.astype(float).reshape(len(counts), -1))
    device = subject.make()
    file, line = source_line(subject.cls, "measure")
    senses = {sense.key: sense for sense in device.sensed}
    texts = [text for key, ramp in rows.items() for text in _judged(device, senses[key], np.array(ramp))]
    if feels_touch(device) and not any(np.ptp(np.array(ramp), axis=0).any() for ramp in rows.values()):
        texts.append(f"{device.name}.measure: no push changes any count")
    yield from (Fault("converter", text, file, line) for text in texts)


def _judged(device: Device, sense: Sense, ramp: np.ndarray) -> Iterator[str]:
    """Of the counts of one sense: pull first, then rising pushes; shape ``(1 + n_pushes, n_points, n_columns)``."""
    first, key, wide = device.sensed[0].key, sense.key, sense.burst
    columns = [column for column in device.columns if (column.sense or first) == key and not column.shared]
    if columns and ramp.shape[2] not in (len(columns), len(columns) * wide):
        yield f"{device.name}.measure: {ramp.shape[2]} counts per point of {key!r}, {len(columns)} columns declared"
        return
    wide = ramp.shape[2] // len(columns) if columns else 1
    for k in range(ramp.shape[2]):
        column = columns[k // wide] if columns else None
        yield from _judged_column(f"{device.name}.measure: ", column, sense.quantity, ramp[..., k])


def _judged_column(start: str, column: Column | None, quantity: str, ramp: np.ndarray) -> Iterator[str]:
    start = f"{start}column {column.name!r}: " if column else start
    rising = ramp[1:]
    span = np.ptp(ramp) or 1.0
    steps = np.where(np.abs(steps := np.diff(rising, axis=0)) > 1e-9 * span, steps, 0.0)
    turned = (steps > 0).any(0) & (steps < 0).any(0)
    if quantity in CONTACT and turned.any():
        taxel = int(np.flatnonzero(turned)[0])
        yield f"{start}counts of taxel {taxel} rise and fall while the push only rises: they wrap, saturate instead"
        return
    if column is None:
        return
    slack = 1e-6 * (column.high - column.low)
    if ramp.min() < column.low - slack or ramp.max() > column.high + slack:
        yield f"{start}counts {ramp.min():g} to {ramp.max():g}, declared are {column.low:g} to {column.high:g}"
    if not column.push or quantity not in CONTACT:
        return
    if np.abs(rising[0] - column.rest).max() > max(1.0, slack):
        yield f"{start}{rising[0][0]:g} untouched, declared rest is {column.rest:g}"
    if not (column.push * (rising[-1] - rising[0]) > 0).all():
        way = "rise" if column.push > 0 else "fall"
        ends = f"from {rising[0][0]:g} to {rising[-1][0]:g}"
        yield f"{start}counts do not {way} under a push, {ends} (push={column.push})"


def _talk(host: Host, subject: Subject) -> None:
    """Every request once, with a conversion behind it: whatever is packed is packed now."""
    for request, port in subject.asked():
        host.send(request, port)
        host.convert()
    host.wait()


def _far(subject: Subject) -> None:
    """Pushes and other quantities beyond everything, in every frame."""
    for newtons in (PUSHES[-1], PULL):
        host = Host(subject.make(), newtons)
        host.convert()
        _talk(host, subject)
    host = Host(subject.make())
    for sense in (each for each in host.device.sensed if each.quantity not in CONTACT):
        for value in FAR:
            for stream in host.device.periods:
                if sense in host.device.senses_of(stream):
                    by_sense(host.device, stream, host.measure(stream, **{sense.key: value}))
                    host.streamed(stream)
            for request, port in subject.asked():
                host.send(request, port)


def _late(subject: Subject) -> None:
    """A device that has been on for long."""
    for seconds in TIMES_S:
        host = Host(subject.make(), 1.0, t_ns=seconds * SECOND)
        host.convert()
        _talk(host, subject)


def _full(subject: Subject) -> None:
    """Counters that are full: those declared, by preset; those not, if they have 8 bits."""
    for each in subject.make().rollovers:
        if not each.state:
            continue
        host = Host(subject.make())
        for request, port in [(None, ""), *subject.asked()]:
            if request is not None:
                host.send(request, port)
            host.device.preset(each.name, (1 << each.bits) - 1)
            host.wait(2 * SECOND if each.clock else SECOND // 100)
            host.convert()
            host.convert()
    host = Host(subject.make())
    for request, port in [(None, ""), *subject.asked()]:
        if request is not None:
            host.send(request, port)
        for stream in host.device.periods:
            host.measure(stream)
            if host.streamed(stream):
                for _ in range(CONVERSIONS):
                    host.streamed(stream)
                return
