"""The frame tables of a device's file: names of the bytes of a frame, and which of them are declared to be constant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from firmware_protocols import Device
from firmware_protocols.declared import frames_of
from firmware_protocols.tables import Frame
from tactemu.judge.compare.frame_classes import FrameClass

MAX_TRIED_FRAMES = 6
"""Number of frames that a table must decode."""


def declare(made: FrameClass, device: Device, contents: Sequence[bytes]) -> None:
    """Add the names of the fields to a class of frames, and the constants that their table declares."""
    if made.envelope != "plain" or made.size is None:
        return
    tried = [each for each in contents if len(each) == made.size][-MAX_TRIED_FRAMES:]
    table = next((each for each in frames_of(device) if tried and _decodes(each, tried)), None)
    if table is None:
        return
    made.names = dict(_named(table, made.size))
    made.fixed = {at for at in made.const if made.names.get(at, "").startswith("constant")} | (
        {at for at in made.fixed if at not in made.names}
    )


def _decodes(table: Frame, frames: Sequence[bytes]) -> bool:
    if any(field.kind == "const" for field in table.fields) or any(field.kind == "sum" for field in table.fields):
        try:
            return all(table.unpack(frame) is not None for frame in frames)
        except (ValueError, TypeError, KeyError):  # not bound to a size
            return False
    return False


def _named(table: Frame, size: int) -> Iterator[tuple[int, str]]:
    """Yield place and name of each byte of a frame of this size."""
    sizes = [0 if field.is_open else field.size or 0 for field in table.fields]
    opened = size - sum(sizes)
    at = 0
    for field, own in zip(table.fields, sizes):
        length = opened if field.is_open else own
        name = f"constant {field.name}".strip() if field.kind == "const" or field.formula else field.name
        yield from ((at + k, name) for k in range(length))
        at += length
