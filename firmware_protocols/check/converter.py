"""The check of the ADC: number of counts, range of their columns, and direction, under pushes of any size."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from firmware_protocols.calls import AuthorError, error_of_result, source_line
from firmware_protocols.check.host import SECOND_NS, Host, Subject
from firmware_protocols.check.report import Fault
from firmware_protocols.device import Device
from firmware_protocols.senses import CONTACT, Column, Sense

PUSHES_N = (0.0, *np.geomspace(1e-3, 1e9, 37).tolist())
"""The pushes on every taxel, in rising order."""
PULL_N = -1e9
"""The pull on every taxel."""
TIMES_S = (0, 70, 5_000, 5_000_000)
"""The device's times that are tried; clocks of 16 and 32 bits in milliseconds or microseconds roll over in between."""
N_CONVERSIONS = 300
"""The number of conversions after which a counter of 8 bits has rolled over."""
EXTREMES = (-1e6, 1e6)
"""The values of temperatures, accelerations and other quantities without contact, SI."""


def faults(subject: Subject) -> Iterator[Fault]:
    """Yield wrong lengths, wraps, wrong directions, counts out of range, and fields that overflow."""
    yield from _ramp(subject)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for check in (_try_extremes, _try_late_times, _try_full_counters):
            try:
                check(subject)
            except AuthorError as error:
                yield Fault.of("range", error)


def measures_contact(device: Device) -> bool:
    """Return True if any sense measures contact on the taxels; those of motors measure only loads."""
    return any(sense.quantity in (*CONTACT, "wrench", "vibration") for sense in device.sensed)


def by_sense(device: Device, stream: str, counts: Any) -> dict[str, np.ndarray]:
    """Return counts by the key of their sense.

    Raises:
        AuthorError: their number is not that of the sense's points, or the stream lacks the sense.
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
    return {key: np.asarray(values) for key, values in found.items()}


def _ramp(subject: Subject) -> Iterator[Fault]:
    rows: dict[str, list[np.ndarray]] = {}
    for newtons in (PULL_N, *PUSHES_N):
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
    texts = [text for key, ramp in rows.items() for text in _sense_faults(device, senses[key], np.array(ramp))]
    if measures_contact(device) and not any(np.ptp(np.array(ramp), axis=0).any() for ramp in rows.values()):
        texts.append(f"{device.name}.measure: no push changes any count")
    yield from (Fault("converter", text, file, line) for text in texts)


def _sense_faults(device: Device, sense: Sense, ramp: np.ndarray) -> Iterator[str]:
    """Yield faults of one sense: its counts under a pull, then rising pushes,
    shape ``(1 + n_pushes, n_points, n_columns)``."""
    first, key, wide = device.sensed[0].key, sense.key, sense.burst
    columns = [column for column in device.columns if (column.sense or first) == key and not column.shared]
    if columns and ramp.shape[2] not in (len(columns), len(columns) * wide):
        yield f"{device.name}.measure: {ramp.shape[2]} counts per point of {key!r}, {len(columns)} columns declared"
        return
    wide = ramp.shape[2] // len(columns) if columns else 1
    for k in range(ramp.shape[2]):
        column = columns[k // wide] if columns else None
        yield from _column_faults(f"{device.name}.measure: ", column, sense.quantity, ramp[..., k])


def _column_faults(start: str, column: Column | None, quantity: str, ramp: np.ndarray) -> Iterator[str]:
    start = f"{start}column {column.name!r}: " if column else start
    rising = ramp[1:]
    span = np.ptp(ramp) or 1.0
    steps = np.where(np.abs(steps := np.diff(rising, axis=0)) > 1e-9 * span, steps, 0.0)
    turned = (steps > 0).any(0) & (steps < 0).any(0)
    if quantity in CONTACT and turned.any():
        taxel = int(np.flatnonzero(turned)[0])
        yield f"{start}counts of taxel {taxel} rise and fall while the push only rises: they wrap, let them saturate"
        return
    if column is None:
        return
    slack = 1e-6 * (column.high - column.low)
    if ramp.min() < column.low - slack or ramp.max() > column.high + slack:
        yield f"{start}counts {ramp.min():g} to {ramp.max():g}, declared are {column.low:g} to {column.high:g}"
    if not column.push or quantity not in CONTACT:
        return
    if np.abs(rising[0] - column.rest).max() > max(1.0, slack):
        yield f"{start}{rising[0][0]:g} without contact, declared rest is {column.rest:g}"
    if not (column.push * (rising[-1] - rising[0]) > 0).all():
        way = "rise" if column.push > 0 else "fall"
        ends = f"from {rising[0][0]:g} to {rising[-1][0]:g}"
        yield f"{start}counts do not {way} under a push, {ends} (push={column.push})"


def _send_all(host: Host, subject: Subject) -> None:
    """Send every request once, each followed by a conversion, so that every frame is packed."""
    for request, port in subject.requests():
        host.send(request, port)
        host.convert()
    host.wait()


def _try_extremes(subject: Subject) -> None:
    """Apply pushes and other quantities beyond every range, and send every request."""
    for newtons in (PUSHES_N[-1], PULL_N):
        host = Host(subject.make(), newtons)
        host.convert()
        _send_all(host, subject)
    host = Host(subject.make())
    for sense in (each for each in host.device.sensed if each.quantity not in CONTACT):
        for value in EXTREMES:
            for stream in host.device.periods:
                if sense in host.device.senses_of(stream):
                    by_sense(host.device, stream, host.measure(stream, **{sense.key: value}))
                    host.streamed(stream)
            for request, port in subject.requests():
                host.send(request, port)


def _try_late_times(subject: Subject) -> None:
    """Send every request to devices that have been on for a long time."""
    for seconds in TIMES_S:
        host = Host(subject.make(), 1.0, t_ns=seconds * SECOND_NS)
        host.convert()
        _send_all(host, subject)


def _try_full_counters(subject: Subject) -> None:
    """Let counters roll over: declared ones after a preset, others of 8 bits after many conversions."""
    for each in subject.make().rollovers:
        if not each.state:
            continue
        host = Host(subject.make())
        for request, port in [(None, ""), *subject.requests()]:
            if request is not None:
                host.send(request, port)
            host.device.preset(each.name, (1 << each.bits) - 1)
            host.wait(2 * SECOND_NS if each.clock else SECOND_NS // 100)
            host.convert()
            host.convert()
    host = Host(subject.make())
    for request, port in [(None, ""), *subject.requests()]:
        if request is not None:
            host.send(request, port)
        for stream in host.device.periods:
            host.measure(stream)
            if host.streamed(stream):
                for _ in range(N_CONVERSIONS):
                    host.streamed(stream)
                return
