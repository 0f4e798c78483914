"""The search for the checksum of frames: plain sums and CRCs of the kit, each range, start value and byte order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_protocols import sums

CRCS: dict[str, sums.Sum] = {name: each for name, each in sums.SUMS.items() if name.startswith("crc")}
_KIT_NAMES = {
    ("sum", 1, 0): "sum8",
    ("sum", 2, 0): "sum16",
    ("neg", 1, 0): "lrc8",
    ("neg", 1, 255): "inv8",
    ("xor", 1, 0): "xor8",
}
"""The kit's names of plain sums, by :attr:`FrameSum.name`, width and constant."""
TRIED = 64
"""The number of frames that every hypothesis is tried with."""
HOLDS_SHARE = 0.9
"""The least share of the frames in which a sum must hold: some are damaged on the wire."""
MAX_START = 9
"""The last offset at which the range of a sum may begin."""
MAX_BYTES_BEHIND = 8
"""The farthest distance of a sum from the end of its frame."""


@dataclass(frozen=True)
class FrameSum:
    """A checksum of a frame."""

    at: int
    """The offset of the sum; negative from the end of the frame."""
    width: int
    start: int
    """The first byte that it covers."""
    end: int
    """The end of the bytes that it covers; 0 or negative from the end of the frame."""
    name: str
    """``sum``, ``neg`` (sum and message add up to :attr:`constant`), ``xor``, or the kit's name of a CRC."""
    order: str = ""
    constant: int = 0
    is_certain: bool = False
    starts: tuple[int, ...] = ()
    """Other starts that fit as well, since the bytes between never change."""

    def place(self, length: int) -> int:
        """Return the offset of the sum in a frame."""
        return self.at if self.at >= 0 else length + self.at

    def holds(self, frame: bytes) -> bool:
        """Return True if the frame has the right sum."""
        at, end = self.place(len(frame)), self.end if self.end > 0 else len(frame) + self.end
        if at < 0 or at + self.width > len(frame) or end <= self.start:
            return False
        if self.start <= at < end:
            part = frame[self.start : at] + frame[at + self.width : end]
        else:
            part = frame[self.start : end]
        return self.of(part) == self.sent(frame)

    def share(self, frames: Sequence[bytes]) -> float:
        """Return the share of frames in which it holds."""
        return sum(map(self.holds, frames)) / max(1, len(frames))

    def sent(self, frame: bytes) -> int:
        """Return the number at the place of the sum."""
        at = self.place(len(frame))
        return int.from_bytes(frame[at : at + self.width], "little" if self.order == "<" else "big")

    def of(self, part: bytes) -> int:
        """Return the sum of the bytes that it covers."""
        modulus = 1 << 8 * self.width
        if self.name == "sum":
            return (sum(part) + self.constant) % modulus
        if self.name == "neg":
            return (self.constant - sum(part)) % modulus
        if self.name == "xor":
            return sums.xor8(part) ^ self.constant
        return CRCS[self.name].function(part) ^ self.constant

    @property
    def kit_name(self) -> str | None:
        """The name in frame tables of the kit, ``None`` if those have no such sum."""
        if self.name in CRCS and not self.constant:
            return self.name
        return _KIT_NAMES.get((self.name, self.width, self.constant))

    def __str__(self) -> str:
        place = f"{-self.at} bytes before the end" if self.at < 0 else f"byte {self.at}"
        kind = self.kit_name or f"{self.name}, constant {self.constant:X}"
        end = "" if self.end in (self.at, 0) else f" to {self.end}"
        also = f" (or {', '.join(map(str, self.starts))})" if self.starts else ""
        return f"{self.order}{kind}, {self.width} bytes, {place}, over the bytes from {self.start}{also}{end}"


def hypotheses(frames: Sequence[bytes], least: int) -> Iterator[FrameSum]:
    """Yield the sums that hold in nearly all frames of the most frequent length.

    Args:
        frames: frames of one length or several.
        least: the fewest different frames of that length in which a sum is looked for.
    """
    distinct = list(dict.fromkeys(frames))
    n = Counter(map(len, distinct)).most_common(1)[0][0] if distinct else 0
    same = [frame for frame in distinct if len(frame) == n]
    same = same[:: max(1, len(same) // TRIED)][:TRIED]
    if n < 3 or len(same) < least:
        return
    rows = np.array([np.frombuffer(frame, np.uint8) for frame in same], np.int64)
    varies = (rows != rows[0]).any(axis=0)
    tails = list(range(max(1, n - MAX_BYTES_BEHIND), n))
    heads = [at for at in range(1, min(6, n)) if at not in tails]
    for at in dict.fromkeys((*tails, *heads)):
        for width in (1, 2, 4):
            if at + width > n or not varies[at + width - 1] or not varies[at]:
                continue
            is_tail = at >= n - MAX_BYTES_BEHIND
            for start, end in _ranges(at, width, n, is_tail):
                inside = varies[start:end].sum() - (varies[at : at + width].sum() if start <= at < end else 0)
                if inside < 2:
                    continue
                last = end - n if is_tail or end == n else end
                made = FrameSum(at - n if is_tail else at, width, start, last, "")
                if width < 4:
                    yield from _plain(rows, made, at, end)
                if not start <= at < end:
                    yield from _crcs(same, made, end)


def _ranges(at: int, width: int, n: int, is_tail: bool) -> Iterator[tuple[int, int]]:
    if is_tail:
        yield from ((start, at) for start in range(0, min(at - 1, MAX_START)))
    else:
        yield from ((at + width, n - k) for k in range(4) if n - k > at + width + 1)
    yield 0, n


def _plain(rows: np.ndarray, made: FrameSum, at: int, end: int) -> Iterator[FrameSum]:
    own = rows[:, at : at + made.width]
    part = rows[:, made.start : end]
    is_around = made.start <= at < end
    total = part.sum(axis=1) - (own.sum(axis=1) if is_around else 0)
    modulus = 1 << 8 * made.width
    for order in ("<", ">") if made.width == 2 else ("",):
        value = own[:, 0] if made.width == 1 else own @ (np.array([1, 256]) if order == "<" else np.array([256, 1]))
        for name, rest in (("sum", value - total), ("neg", value + total)):
            constant = _constant(rest % modulus)
            if constant is not None:
                yield replace(made, name=name, order=order, constant=constant)
    if made.width == 1:
        crossed = np.bitwise_xor.reduce(part, axis=1) ^ (0 if is_around else own[:, 0])
        constant = _constant(crossed)
        if constant is not None:
            yield replace(made, name="xor", constant=constant)


def _constant(values: np.ndarray) -> int | None:
    """Return the value of nearly all, or ``None``."""
    middle = int(np.sort(values)[len(values) // 2])
    return middle if (values == middle).mean() >= HOLDS_SHARE else None


def _crcs(frames: list[bytes], made: FrameSum, end: int) -> Iterator[FrameSum]:
    for name, (_, size) in CRCS.items():
        if size == made.width:
            for order in ("<", ">") if size > 1 else ("",):
                yield from _crc(frames, replace(made, name=name, order=order), end)


def _crc(frames: list[bytes], each: FrameSum, end: int) -> Iterator[FrameSum]:
    """Yield the CRC if it differs from the bytes of nearly all frames by one constant, which another start gives."""
    rests: Counter[int] = Counter()
    for k, frame in enumerate(frames[:12]):
        rests[each.of(frame[each.start : end]) ^ each.sent(frame)] += 1
        if k - rests.most_common(1)[0][1] >= 2:
            return
    yield replace(each, constant=rests.most_common(1)[0][0])
