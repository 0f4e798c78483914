"""The faults of single frames: lost, changed, late, sent twice, in pieces or in another order."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.frames import payload, with_payload
from tactemu.transports.transport import Part
from tactemu.wire.faults.fault import Corruption, FrameFault, Key, Memory, Parts
from tactemu.wire.faults.options import After, By, Byte, Bytes, Data, number

_MAX_EARLIER_FRAMES = 16
"""Number of earlier frames among which a stray one is chosen."""


class Drop(Corruption):
    """The loss of a frame."""

    word = "drop"
    about = "the frame is lost"

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        return []


class Silence(Drop):
    """The loss of all frames."""

    word = "silence"
    about = "no frame passes"


@dataclass(frozen=True, kw_only=True)
class Close(Drop):
    """The loss of a frame and of the connection."""

    word = "close"
    about = "the connection is closed in its place, and may be opened again"
    every_line = False
    code: Annotated[int, number("code", 1000, 4999)] = 1011
    """The code for the driver, where the protocol has one; by default that of an internal error."""

    @property
    def close_code(self) -> int:
        """The code with which the connection is closed."""
        return self.code


@dataclass(frozen=True, kw_only=True)
class Flip(Corruption):
    """Other bits in the data of a frame: ``bits N`` (1) different ones, or ``bit N`` (any) of ``byte N``."""

    word = "flip"
    about = "bits of the data change"
    bits: Annotated[int | None, number("bits")] = None
    byte: Byte = None
    bit: Annotated[int | None, number("bit", 0, 7)] = None

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data = bytearray(payload(frame))
        if not data or _outside(self.byte, data):
            return None
        if self.byte is not None:
            data[self.byte] ^= 1 << (int(rng.integers(8)) if self.bit is None else self.bit)
            return [(with_payload(frame, bytes(data)), 0)]
        for bit in rng.choice(8 * len(data), size=min(self.bits or 1, 8 * len(data)), replace=False):
            data[bit // 8] ^= 1 << bit % 8
        return [(with_payload(frame, bytes(data)), 0)]

    def _errors(self) -> Iterator[tuple[str, str]]:
        yield from super()._errors()
        if self.bit is not None and self.byte is None:
            yield "bit", "of which byte? Name it, as in 'byte 10 bit 3'"
        if self.byte is not None and self.bits is not None:
            yield "byte", f"give one place or {self.bits} random bits, not both"


def _outside(byte: int | None, data: bytes | bytearray) -> bool:
    return byte is not None and not -len(data) <= byte < len(data)


def _left(frame: WireFrame, data: bytes) -> Parts:
    """Return a frame with the data that are left; a serial frame without any does not arrive."""
    return [(with_payload(frame, data), 0)] if data or isinstance(frame, CanFrame) else []


@dataclass(frozen=True, kw_only=True)
class Lose(Corruption):
    """The loss of ``byte N`` (any); nothing is left of a serial frame with one byte."""

    word = "lose"
    about = "one byte is missing"
    byte: Byte = None

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data = payload(frame)
        if not data or _outside(self.byte, data):
            return None
        at = (int(rng.integers(len(data))) if self.byte is None else self.byte) % len(data)
        return _left(frame, data[:at] + data[at + 1 :])


@dataclass(frozen=True, kw_only=True)
class Truncate(Corruption):
    """The loss of the last ``bytes N`` (any number), or of all but ``to N`` bytes.

    At least one byte of a serial frame is left, except with ``to 0``.
    """

    word = "truncate"
    about = "the end is missing"
    cut: Bytes = None
    length: Annotated[int | None, number("to", 0, digits=True)] = None
    """The number of bytes that are left."""

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data = payload(frame)
        if self.length is not None:
            return _left(frame, data[: self.length]) if self.length < len(data) else None
        most = len(data) - (not isinstance(frame, CanFrame))
        if most < 1:
            return None
        cut = min(self.cut or int(rng.integers(1, most + 1)), most)
        return [(with_payload(frame, data[: len(data) - cut]), 0)]

    def _errors(self) -> Iterator[tuple[str, str]]:
        yield from super()._errors()
        if self.length is not None and self.cut is not None:
            yield "to", "give 'to' or 'bytes', not both"


@dataclass(frozen=True, kw_only=True)
class Length(Corruption):
    """A frame with ``bytes N`` (1) random bytes more; a CAN frame without room for them loses as many."""

    word = "length"
    about = "the frame is too long (a full CAN frame too short)"
    more: Bytes = None

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data, n = payload(frame), self.more or 1
        if isinstance(frame, CanFrame) and len(data) + n > (64 if frame.is_fd else 8):
            return [(with_payload(frame, data[: max(0, len(data) - n)]), 0)]
        return [(with_payload(frame, data + rng.bytes(n)), 0)]


@dataclass(frozen=True, kw_only=True)
class Checksum(Corruption):
    """Another value in each of the last ``bytes N`` (1)."""

    word = "checksum"
    about = "the last bytes are wrong"
    width: Bytes = None

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data, n = bytearray(payload(frame)), self.width or 1
        if not data:
            return None
        for k in range(max(0, len(data) - n), len(data)):
            data[k] ^= int(rng.integers(1, 256))
        return [(with_payload(frame, bytes(data)), 0)]


@dataclass(frozen=True, kw_only=True)
class Replace(Corruption):
    """The bytes of ``hex=`` in place of the data of a frame."""

    word = "replace"
    about = "other bytes in its place"
    data: Data = b""

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        return [(with_payload(frame, self.data), 0)]

    def _errors(self) -> Iterator[tuple[str, str]]:
        yield from super()._errors()
        if not self.data:
            yield "replace", "by what? Give the bytes, as in 'replace frame 3 hex=01830286'"


class Duplicate(Corruption):
    """A frame that is sent twice."""

    word = "duplicate"
    about = "sent twice"
    keeps_frame = True

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        return [(frame, 0), (frame, 0)]


class ErrorFrame(Corruption):
    """A frame that an error frame breaks, and that is sent again."""

    word = "error"
    about = "an error frame breaks the frame, which is sent again"
    every_line = False

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        return [(replace(frame, is_error_frame=True), 0), (frame, 0)] if isinstance(frame, CanFrame) else None


@dataclass(frozen=True, kw_only=True)
class Garbage(Corruption):
    """Extra bytes before a frame or ``after N`` bytes of it: ``bytes N`` (1 to 16) random ones or those of ``hex=``."""

    word = "garbage"
    about = "random bytes before the frame, or in it"
    every_line = False
    keeps_frame = True
    size: Bytes = None
    after: After = None
    data: Data = b""

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        junk = self.data or rng.bytes(self.size or int(rng.integers(1, 17)))
        if not self.after:
            return [(junk, 0), (frame, 0)]
        data = payload(frame)
        return [(data[: self.after] + junk + data[self.after :], 0)] if self.after <= len(data) else None


@dataclass(frozen=True, kw_only=True)
class Split(Corruption):
    """A frame in two pieces, cut anywhere or ``after N`` bytes, the second ``by`` later."""

    word = "split"
    about = "arrives in two pieces, the second later"
    every_line = False
    keeps_frame = True
    by_ns: By = 1_000_000
    after: After = None

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data = payload(frame)
        if len(data) < 2:
            return None
        cut = int(rng.integers(1, len(data))) if self.after is None else self.after
        return [(Part(data[:cut]), 0), (data[cut:], self.by_ns)] if 0 < cut < len(data) else None


@dataclass(frozen=True, kw_only=True)
class Chunk(Corruption):
    """A frame in pieces of ``bytes N`` (1), each ``by`` after the one before."""

    word = "chunk"
    about = "arrives in pieces, each later"
    every_line = False
    keeps_frame = True
    by_ns: By = 1_000_000
    size: Bytes = None

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        data, size = payload(frame), self.size or 1
        if len(data) <= size:
            return None
        return [(data[at : at + size], at // size * self.by_ns) for at in range(0, len(data), size)]


@dataclass(frozen=True, kw_only=True)
class Late(Corruption):
    """A frame that leaves ``by`` later."""

    word = "late"
    about = "leaves later; on a byte stream, so does all that follows"
    keeps_frame = True
    by_ns: By = 10_000_000

    def corrupt(self, frame: WireFrame, rng: np.random.Generator) -> Parts | None:
        return [(frame, self.by_ns)]


class HoldingFault(FrameFault):
    """A fault that holds a frame back until others have gone."""

    keeps_frame = True

    @property
    def ahead(self) -> int:
        """The number of frames that go first."""
        return 1

    @abstractmethod
    def join(self, held: WireFrame, frame: WireFrame) -> Parts:
        """Return what becomes of the frame that was held back and the last one that goes first."""

    def apply(self, frame: WireFrame, key: Key, hit: bool, memory: Memory) -> tuple[Parts, bool]:
        held, left = memory.held.pop(key, (None, 0))
        if held is None and hit:
            memory.held[key] = frame, self.ahead
            return [], False
        if held is None:
            return [(frame, 0)], False
        if left > 1:
            memory.held[key] = held, left - 1
            return [(frame, 0)], False
        return self.join(held, frame), True


@dataclass(frozen=True, kw_only=True)
class Reorder(HoldingFault):
    """A frame that is sent after the next one, or after ``frames N`` more."""

    word = "reorder"
    about = "sent after the next one"
    mixes_samples = True
    passed: Annotated[int | None, number("frames")] = None

    @property
    def ahead(self) -> int:
        """The number of frames that go first."""
        return self.passed or 1

    def join(self, held: WireFrame, frame: WireFrame) -> Parts:
        return [(frame, 0), (held, 0)]


class Merge(HoldingFault):
    """A frame that arrives together with the next one."""

    word = "merge"
    about = "arrives together with the next one"
    every_line = False

    def join(self, held: WireFrame, frame: WireFrame) -> Parts:
        return [(payload(held) + payload(frame), 0)]


class Stray(FrameFault):
    """An earlier frame that comes again after a frame."""

    word = "stray"
    about = "an earlier frame comes again, unasked"
    keeps_frame = True
    mixes_samples = True

    def apply(self, frame: WireFrame, key: Key, hit: bool, memory: Memory) -> tuple[Parts, bool]:
        earlier = memory.earlier.setdefault(key, deque(maxlen=_MAX_EARLIER_FRAMES))
        parts: Parts = [(frame, 0)]
        strays = hit and bool(earlier)
        if strays:
            parts.append((earlier[int(memory.rng.integers(len(earlier)))], 0))
        earlier.append(frame)
        return parts, strays
