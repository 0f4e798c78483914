"""The comparison of a capture with the devices of the catalogue: the constant bytes of their messages, by length."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_protocols import CanFrame, registry
from tactemu.fit.infer.analysis import Draft

LEAST_SHARE = 0.9
LEAST_CONSTANTS = 2
"""The fewest constant bytes, identifiers included, that a message of a device is recognised by."""
PUSHES_N = (0.0, 0.7, 2.0)
TRIED_ROWS = 20


@dataclass(frozen=True)
class Match:
    """A device of the catalogue that sends such bytes."""

    name: str
    share: float
    """The share of the bytes in messages like its own."""
    constants: int
    """The mean number of constant bytes of a message that agree."""


def match_catalogue(draft: Draft) -> Match | None:
    """Return the device whose messages are those of a capture, ``None`` if there is none."""
    matches = [each for name in registry.DEVICES if (each := _match(draft, name)) is not None]
    return max(matches, key=lambda each: (each.constants, each.share), default=None)


def _match(draft: Draft, name: str) -> Match | None:
    masks: defaultdict[tuple[int | None, int], list[tuple[np.ndarray, np.ndarray]]] = defaultdict(list)
    for identifier, rows in _samples(name, draft.is_can):
        still = (rows == rows[0]).all(axis=0)
        masks[identifier, rows.shape[1]].append((np.nonzero(still)[0], rows[0]))
    if not masks:
        return None
    total = matched = constants = 0
    for group in draft.groups:
        weight = group.rows.size
        total += weight
        best = 0
        some = group.rows[:TRIED_ROWS]
        for still, values in masks.get((group.id, group.length), ()):
            known = len(still) + (2 if group.id is not None else 0)
            if known >= LEAST_CONSTANTS and (some[:, still] == values[still]).mean(axis=0).min(initial=1.0) > 0.9:
                best = max(best, known)
        matched += weight * (best > 0)
        constants += weight * best
    if not total or matched < LEAST_SHARE * total:
        return None
    return Match(name, matched / total, constants // matched)


def _samples(name: str, is_can: bool) -> Iterator[tuple[int | None, np.ndarray]]:
    """Yield the messages of a device under different pushes, with their identifier."""
    from firmware_protocols.check.host import Host, Subject

    try:
        subject = Subject(name, registry.device_class(name))
        frames: defaultdict[Any, list[bytes]] = defaultdict(list)
        for age, push in enumerate(PUSHES_N):
            host = Host(subject.make(), push)
            for _ in range(1 + 7 * age):  # counters and clocks are no constants
                host.t_ns += 13_000_000 * (age + 1)
                host.convert()
            sent = [(("stream", k), frame) for k, frame in enumerate([*host.convert(), *host.convert()])]
            for number, command in enumerate(subject.commands):
                host.prepare(command)
                answers = host.send(command.request, command.port)
                sent += [((number, k), frame) for k, frame in enumerate([*answers, *host.convert()])]
            for key, frame in sent:
                if isinstance(frame, CanFrame) == is_can:
                    data = bytes(frame.data) if isinstance(frame, CanFrame) else frame
                    if isinstance(data, bytes) and data:
                        identifier = frame.arbitration_id if isinstance(frame, CanFrame) else None
                        frames[key, identifier, len(data)].append(data)
    except Exception:  # a device that cannot run here, for want of a library, is no match
        return
    for (_, identifier, _), rows in frames.items():
        if len(rows) > 1:
            yield identifier, np.array([np.frombuffer(row, np.uint8) for row in rows])
