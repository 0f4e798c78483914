"""Functions that corrupt one frame: ``(frame, fault, random numbers) -> [(frame, delay in ns), ...]``.

They return None where nothing can be corrupted (an empty frame has no bit to flip); such a fault is not counted. On
CAN, a changed frame is one that a faulty node or gateway sent with a good CRC: the bus itself would have rejected it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.frames import payload, with_payload
from tactemu.transports.transport import Part
from tactemu.wire.faults.fault import Fault

Parts = list[tuple[WireFrame, int]]
"""Frames, each with its delay [ns]."""

Corruption = Callable[[WireFrame, Fault, np.random.Generator], "Parts | None"]
"""The type of the functions below."""


def drop(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return no frame."""
    return []


def flip(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame with ``bits N`` (1) different bits of its data flipped, or ``bit N`` (any) of ``byte N``."""
    data = bytearray(payload(frame))
    if not data or _outside(fault.byte, data):
        return None
    if fault.byte is not None:
        data[fault.byte] ^= 1 << (int(rng.integers(8)) if fault.bit is None else fault.bit)
        return [(with_payload(frame, bytes(data)), 0)]
    for bit in rng.choice(8 * len(data), size=min(fault.amount or 1, 8 * len(data)), replace=False):
        data[bit // 8] ^= 1 << bit % 8
    return [(with_payload(frame, bytes(data)), 0)]


def _outside(byte: int | None, data: bytes | bytearray) -> bool:
    return byte is not None and not -len(data) <= byte < len(data)


def lose(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame without ``byte N`` (any); of a serial frame with one byte nothing is left."""
    data = payload(frame)
    if not data or _outside(fault.byte, data):
        return None
    at = (int(rng.integers(len(data))) if fault.byte is None else fault.byte) % len(data)
    left = data[:at] + data[at + 1 :]
    return [(with_payload(frame, left), 0)] if left or isinstance(frame, CanFrame) else []


def replaced(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the bytes of ``hex=`` in place of the frame's data."""
    return [(with_payload(frame, fault.data), 0)]


def truncate(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame without its last ``bytes N`` (any number), or cut to ``to N`` bytes.

    Of a serial frame at least one byte is left, except with ``to 0``.
    """
    data = payload(frame)
    if fault.length is not None:
        if fault.length >= len(data):
            return None
        left = data[: fault.length]
        return [(with_payload(frame, left), 0)] if left or isinstance(frame, CanFrame) else []
    most = len(data) - (not isinstance(frame, CanFrame))
    if most < 1:
        return None
    cut = min(fault.amount or int(rng.integers(1, most + 1)), most)
    return [(with_payload(frame, data[: len(data) - cut]), 0)]


def length(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame with ``bytes N`` (1) random bytes more; a CAN frame without room for them loses as many."""
    data, n = payload(frame), fault.amount or 1
    if isinstance(frame, CanFrame) and len(data) + n > (64 if frame.is_fd else 8):
        return [(with_payload(frame, data[: max(0, len(data) - n)]), 0)]
    return [(with_payload(frame, data + rng.bytes(n)), 0)]


def checksum(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame with another value in each of its last ``bytes N`` (1)."""
    data, n = bytearray(payload(frame)), fault.amount or 1
    if not data:
        return None
    for k in range(max(0, len(data) - n), len(data)):
        data[k] ^= int(rng.integers(1, 256))
    return [(with_payload(frame, bytes(data)), 0)]


def duplicate(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame twice."""
    return [(frame, 0), (frame, 0)]


def garbage(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return ``bytes N`` (1 to 16) random bytes, or those of ``hex=``, before the frame or ``after N`` of its bytes."""
    junk = fault.data or rng.bytes(fault.amount or int(rng.integers(1, 17)))
    if not fault.after:
        return [(junk, 0), (frame, 0)]
    data = payload(frame)
    return [(data[: fault.after] + junk + data[fault.after :], 0)] if fault.after <= len(data) else None


def split(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return two pieces, cut anywhere or ``after N`` bytes, the second ``by`` later."""
    data = payload(frame)
    if len(data) < 2:
        return None
    cut = int(rng.integers(1, len(data))) if fault.after is None else fault.after
    if not 0 < cut < len(data):
        return None
    return [(Part(data[:cut]), 0), (data[cut:], fault.by_ns)]


def chunk(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return pieces of ``bytes N`` (1), each ``by`` after the one before."""
    data, size = payload(frame), fault.amount or 1
    if len(data) <= size:
        return None
    return [(data[at : at + size], at // size * fault.by_ns) for at in range(0, len(data), size)]


def late(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame, ``by`` later. On a byte stream later frames wait for it, on a bus they do not."""
    return [(frame, fault.by_ns)]


def error(frame: WireFrame, fault: Fault, rng: np.random.Generator) -> Parts | None:
    """Return the frame broken by an error frame, then the frame again."""
    return [(replace(frame, is_error_frame=True), 0), (frame, 0)] if isinstance(frame, CanFrame) else None


CORRUPTIONS: dict[str, Corruption] = {
    "drop": drop,
    "silence": drop,
    "close": drop,
    "flip": flip,
    "lose": lose,
    "replace": replaced,
    "truncate": truncate,
    "length": length,
    "checksum": checksum,
    "duplicate": duplicate,
    "garbage": garbage,
    "split": split,
    "chunk": chunk,
    "late": late,
    "error": error,
}
"""The function of each kind of fault that corrupts single frames by itself."""
