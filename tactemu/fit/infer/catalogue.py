"""The comparison of a capture with the devices of the catalogue: the bytes of their messages that are known.

Constants, lengths and sums are those of a device's frame tables. In messages of no such table, the bytes are known that
do not move while the model is pressed, warmed and turned.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from firmware_protocols import Can, CanFrame, Frame, registry
from firmware_protocols.check.host import Host, Subject
from firmware_protocols.check.readings import NUMBERS_PER_POINT
from firmware_protocols.declared import frames_of
from tactemu.fit.infer.analysis import Draft
from tactemu.fit.infer.fields import Group

LEAST_SHARE = 0.9
"""The least share of the bytes in messages like its own by which a device is recognised."""
LEAST_NEAREST_SHARE = 0.1
"""The least share by which a device is the nearest."""
ALIKE_SHARE = 0.01
"""The greatest difference of the shares of devices that send the same."""
LEAST_CONSTANTS = 2
"""The fewest constant bytes, identifiers included, that a message of a device is recognised by."""
HOLDS = 0.9
"""The least share of messages in which known bytes agree; noise on the line damages the others."""
LEAST_STILL_SHARE = 0.6
"""The least share of the bytes that never moved in the model that are the same in a capture; others had no occasion."""
TRIED_ROWS = 20
ROUNDS = 4
"""The number of times that a model sends each of its messages, the first time untouched."""
STEP_NS = 13_000_000
SPANS = {"temperature": (5.0, 60.0), "acceleration": (-15.0, 15.0), "angular_velocity": (-3.0, 3.0)}
"""The least and the greatest values of what is measured beside touch, SI with °C."""


@dataclass(frozen=True)
class Match:
    """A device of the catalogue that sends such bytes."""

    name: str
    share: float
    """The share of the bytes in messages like its own."""
    constants: int
    """The mean number of constant bytes of a message that agree."""
    alike: tuple[str, ...] = ()
    """The other devices that match as well."""

    @property
    def is_recognised(self) -> bool:
        """True if nearly all bytes are in messages like its own; else the device is the nearest only."""
        return self.share >= LEAST_SHARE


@dataclass(frozen=True)
class _Kind:
    """A kind of message of a device."""

    id: int | None
    length: int | None
    """The number of bytes; None: the table tells."""
    table: Frame | None
    """The table that has its constants, lengths and sums; None: its bytes never moved at these places."""
    places: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    """The offsets of the bytes that never moved in the model."""
    values: np.ndarray = field(default_factory=lambda: np.zeros(0, np.uint8))

    def known(self, identifier: int | None, rows: np.ndarray) -> int:
        """Return the number of known bytes if the rows are such messages, else 0."""
        if self.id != identifier or self.length not in (None, rows.shape[1]):
            return 0
        if self.table is not None:
            agrees = np.mean([_fits(self.table, row.tobytes()) for row in rows]) > HOLDS
            known = _checked_bytes(self.table)
        else:
            known = int(((rows[:, self.places] == self.values).mean(axis=0) > HOLDS).sum())
            agrees = known >= LEAST_STILL_SHARE * len(self.places)
        known += 0 if identifier is None else 2
        return known if agrees and known >= LEAST_CONSTANTS else 0


def match_catalogue(draft: Draft) -> Match | None:
    """Return the device whose messages are those of a capture, else the nearest; ``None`` if none is near."""
    matches = [each for name in registry.DEVICES if (each := _match(draft, name)) is not None]
    best = max(matches, key=_rank, default=None)
    if best is None:
        return None
    alike = [
        each.name for each in matches if each.constants == best.constants and best.share - each.share < ALIKE_SHARE
    ]
    return replace(best, alike=tuple(name for name in alike if name != best.name))


def _rank(match: Match) -> tuple:
    return match.is_recognised, match.constants * match.is_recognised, match.share, match.constants


def _match(draft: Draft, name: str) -> Match | None:
    if not (kinds := _kinds(name, draft.is_can)):
        return None
    total = matched = constants = 0
    for group in draft.groups:
        weight = group.rows.size
        best = max(kind.known(group.id, rows) for kind in kinds for rows in _tried(group))
        total += weight
        matched += weight * (best > 0)
        constants += weight * best
    if not total or matched < LEAST_NEAREST_SHARE * total:
        return None
    return Match(name, matched / total, constants // matched)


def _tried(group: Group) -> tuple[np.ndarray, ...]:
    """Return the first messages, since nothing may be touched in them, and some from the whole capture."""
    rows = group.rows
    return rows[:TRIED_ROWS], rows[:: max(1, len(rows) // TRIED_ROWS)][:TRIED_ROWS]


# -- messages of a device ----------------------------------------------------------------------------------------------


@cache
def _kinds(name: str, is_can: bool) -> tuple[_Kind, ...]:
    """Return the kinds of message of a device on CAN, or on its other ports."""
    try:
        device = registry.device_class(name)()
        if not any(isinstance(port, Can) == is_can for port in device.ports):
            return ()
        tables = [table for table in frames_of(device) if _checked_bytes(table)]
        messages = _messages(Subject(name, type(device)), is_can)
    except Exception:  # a device that cannot run here, for want of a library, is no match
        return ()
    kinds = [] if is_can else [_Kind(None, None, table) for table in tables]  # also what the model has not sent
    for (_, identifier, length), sent in messages.items():
        fitting = [table for table in tables if all(_fits(table, data) for data in sent)]
        if fitting:
            kinds.append(_Kind(identifier, length, max(fitting, key=_checked_bytes)))
        elif len(sent) > 1:
            rows = np.array([np.frombuffer(data, np.uint8) for data in sent])
            places = np.nonzero((rows == rows[0]).all(axis=0))[0]
            kinds.append(_Kind(identifier, length, None, places, rows[0][places]))
    return tuple(kinds)


def _fits(table: Frame, data: bytes) -> bool:
    """Return True if the constants, lengths and sums of a table hold in a message."""
    try:
        return table.unpack(data) is not None
    except (ValueError, TypeError, KeyError):  # not bound to a size
        return False


def _checked_bytes(table: Frame) -> int:
    """Return the number of bytes of a message that its table checks."""
    return sum(each.size or 0 for each in table.fields if each.kind in ("const", "sum") or each.formula)


def _messages(subject: Subject, is_can: bool) -> dict[tuple[Any, int | None, int], list[bytes]]:
    """Return the messages of a device, by request, identifier and length, under different pushes and temperatures."""
    messages: defaultdict[tuple[Any, int | None, int], list[bytes]] = defaultdict(list)
    for number in range(ROUNDS):
        for key, frame in _round(subject, number):
            if isinstance(frame, CanFrame) == is_can:
                data = bytes(frame.data) if isinstance(frame, CanFrame) else frame
                if isinstance(data, bytes) and data:
                    identifier = frame.arbitration_id if isinstance(frame, CanFrame) else None
                    messages[key, identifier, len(data)].append(data)
    return messages


def _round(subject: Subject, number: int) -> Iterator[tuple[Any, Any]]:
    """Yield the frames of a device that has powered up, each with its request and its place in the answer."""
    host = Host(subject.make())
    measure = _measuring(host, number)
    for _ in range(1 + 7 * number):  # counters and clocks are no constants
        host.t_ns += STEP_NS * (number + 1)
        measure()
    yield from _numbered("stream", [*measure(), *measure()])
    for command in subject.commands:
        host.prepare(command)
        yield from _numbered(command.name, [*host.send_stages(command), *measure()])


def _numbered(request: str, frames: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    return (((request, place), frame) for place, frame in enumerate(frames))


def _measuring(host: Host, number: int) -> Callable[[], list[Any]]:
    """Return a function that runs one conversion of every stream and returns its frames: a firm touch of all taxels
    with shear, at another temperature and in another motion each time; in round 0 without a touch."""
    device, rng = host.device, np.random.default_rng(number)
    normals = device.layout.normals

    def measure() -> list[Any]:
        push = number * np.abs(rng.standard_normal((len(normals), 1)))
        host.pushes = push * (0.3 * rng.standard_normal((len(normals), 3)) - normals) if len(normals) else 0.0
        sent: list[Any] = []
        for stream in [name for name, period in device.periods.items() if period]:
            senses = [sense for sense in device.senses_of(stream) if sense.quantity in SPANS]
            others = {s.key: rng.uniform(*SPANS[s.quantity], NUMBERS_PER_POINT.get(s.quantity)) for s in senses}
            host.measure(stream, **others)
            sent += host.streamed(stream)
        return sent

    measure()
    return measure
