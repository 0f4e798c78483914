"""A converter of frame tables with a CAN identifier to a DBC file, for cantools, SavvyCAN and similar programs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from firmware_protocols.tables import Field, Frame

_EXTENDED = 1 << 31
"""The bit that marks 29-bit identifiers in a DBC file."""


def dbc(messages: Iterable[tuple[Frame, Mapping[str, int]]]) -> str:
    """Return the text of a DBC file, for frames with parts of their identifiers.

    ``dbc([(TAIL, {"board": 1, "triangle": 0})])``: frames that share an identifier are distinguished by their first
    byte, which must be constant then: a multiplexer named ``kind``. Constants are no signals; an array is a signal per
    element.

    Raises:
        ValueError: a frame has an open length or no identifier, or frames of one identifier cannot be distinguished.
    """
    by_identifier: dict[int, list[tuple[str, Frame]]] = {}
    for frame, parts in messages:
        if frame.id is None or frame.size is None:
            raise ValueError(
                f"{frame.name}: a DBC message needs an identifier and a size: add `id ...`, bind its counts"
            )
        identifier = frame.id.of(**parts) | _EXTENDED * frame.id.extended
        name = "_".join([frame.name, *map(str, parts.values())]).replace(" ", "_")
        by_identifier.setdefault(identifier, []).append((name, frame))
    blocks = [_message(identifier, frames) for identifier, frames in by_identifier.items()]
    return "\n\n".join(['VERSION ""', "NS_ :", "BS_:", "BU_:", *blocks]) + "\n"


def _message(identifier: int, frames: list[tuple[str, Frame]]) -> str:
    size = max(frame.size or 0 for _, frame in frames)
    lines = [f"BO_ {identifier} {frames[0][0]}: {size} Vector__XXX"]
    shared = len(frames) > 1
    if shared:
        if len({frame.head[:1] for _, frame in frames} - {b""}) < len(frames):
            raise ValueError(
                f"{[name for name, _ in frames]} share {identifier:X}: their first bytes must tell them apart"
            )
        lines.append(' SG_ kind M : 0|8@1+ (1,0) [0|255] "" Vector__XXX')
    for _, frame in frames:
        at = 0
        for field in frame.fields:
            if field.kind == "number":
                lines += _signals(field, at, f" m{frame.head[0]}" if shared else "")
            at += field.size
    return "\n".join(lines)


def _signals(field: Field, at: int, kind: str) -> list[str]:
    """Return the signal of a number, or one per element of an array."""
    n, width = int(np.prod(field.shape, dtype=int)), field.dtype.itemsize
    big = field.byte_order == ">"
    sign = "-" if field.dtype.kind in "if" else "+"
    names = [field.name] if not field.shape else [f"{field.name}_{k}" for k in range(n)]
    return [
        f" SG_ {name}{kind} : {8 * (at + k * width) + (7 if big else 0)}|{8 * width}@{0 if big else 1}{sign}"
        ' (1,0) [0|0] "" Vector__XXX'
        for k, name in enumerate(names)
    ]
