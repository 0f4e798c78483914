"""The search for the checksum of frames: plain sums and CRCs of the kit, each range, start value and byte order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_protocols import sums

PLAIN = ("sum", "neg", "xor")
CRCS: dict[str, sums.Sum] = {name: each for name, each in sums.SUMS.items() if name.startswith("crc")}
LEAST_FRAMES = 6
"""The fewest different frames that a sum is looked for in."""
PROOF_FRAMES = {1: 12, 2: 6, 4: 4}
"""The fewest different frames in which a sum of so many bytes must hold to be certain."""
TRIED = 64
"""The number of frames that every hypothesis is tried with."""
HOLDS_SHARE = 0.9
"""The least share of the frames in which a sum must hold: some are damaged on the wire."""
CHECKED = 2000
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
        got = int.from_bytes(frame[at : at + self.width], "little" if self.order == "<" else "big")
        return self.of(part) == got

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
        names = {("sum", 1, 0): "sum8", ("neg", 1, 0): "lrc8", ("neg", 1, 255): "inv8", ("xor", 1, 0): "xor8"}
        return (
            "sum16"
            if (self.name, self.width, self.constant) == ("sum", 2, 0)
            else names.get((self.name, self.width, self.constant))
        )

    def __str__(self) -> str:
        place = f"{-self.at} bytes before the end" if self.at < 0 else f"byte {self.at}"
        kind = self.kit_name or f"{self.name}, constant {self.constant:X}"
        end = "" if self.end in (self.at, 0) else f" to {self.end}"
        also = f" (or {', '.join(map(str, self.starts))})" if self.starts else ""
        return f"{self.order}{kind}, {self.width} bytes, {place}, over the bytes from {self.start}{also}{end}"


def find_sum(frames: Sequence[bytes]) -> FrameSum | None:
    """Return a checksum that holds in these frames, of one length or several, or ``None``."""
    distinct = list(dict.fromkeys(frames))
    if len(distinct) < LEAST_FRAMES:
        return None
    length = max(Counter(map(len, distinct)).items(), key=lambda item: item[1])[0]
    same = [frame for frame in distinct if len(frame) == length]
    step = max(1, len(same) // TRIED)
    same = same[::step][:TRIED]
    if length < 3 or len(same) < LEAST_FRAMES:
        return None
    rows = np.array([np.frombuffer(frame, np.uint8) for frame in same], np.int64)
    checked = distinct[:: max(1, len(distinct) // CHECKED)][:CHECKED]
    holding = [each for each in _hypotheses(rows, same) if _share(each, checked) >= HOLDS_SHARE]
    return _best(holding, checked) if holding else None


def _share(each: FrameSum, frames: Sequence[bytes]) -> float:
    if sum(map(each.holds, frames[:40])) < 0.5 * min(40, len(frames)):
        return 0.0
    return sum(map(each.holds, frames)) / len(frames)


def _best(found: list[FrameSum], frames: Sequence[bytes]) -> FrameSum:
    """Return the widest sum with the simplest constant and the longest range."""

    def rank(each: FrameSum) -> tuple:
        behind = each.at >= 0 or each.end == each.at
        simple = each.kit_name is not None
        return each.width, each.name not in PLAIN, simple, behind, each.name == "sum", -each.start

    best = max(found, key=rank)
    alike = [
        each
        for each in found
        if (each.at, each.width, each.name, each.order) == (best.at, best.width, best.name, best.order)
    ]
    starts = tuple(sorted({each.start for each in alike if each.constant == best.constant} - {best.start}))
    # A plain sum over all other bytes holds at every place at once: it says nothing against this one.
    elsewhere = [
        each for each in found if not best.at <= each.at < best.at + best.width and (each.start, each.end) != (0, 0)
    ]
    held = [frame for frame in frames if best.holds(frame)]
    values = {frame[best.place(len(frame)) :][: best.width] for frame in held}
    proven = not elsewhere and len(values) >= PROOF_FRAMES[best.width] and len(held) >= 0.98 * len(frames)
    return FrameSum(best.at, best.width, best.start, best.end, best.name, best.order, best.constant, proven, starts)


def _hypotheses(rows: np.ndarray, frames: list[bytes]) -> Iterator[FrameSum]:
    """Yield the sums that hold in all of ``rows`` but a few, frames of one length."""
    n = rows.shape[1]
    varies = (rows != rows[0]).any(axis=0)
    tails = list(range(max(1, n - MAX_BYTES_BEHIND), n))
    heads = [at for at in range(1, min(6, n)) if at not in tails]
    for at in dict.fromkeys((*tails, *heads)):
        for width in (1, 2, 4):
            if at + width > n or not varies[at + width - 1] or not varies[at]:
                continue
            is_tail = at >= n - MAX_BYTES_BEHIND
            place = at - n if is_tail else at
            for start, end in _ranges(at, width, n, is_tail):
                inside = varies[start:end].sum() - (varies[at : at + width].sum() if start <= at < end else 0)
                if inside < 2:
                    continue
                last = end - n if is_tail or end == n else end
                if width < 4:
                    yield from _plain(rows, at, width, start, end, place, last)
                if not start <= at < end:
                    yield from _crcs(frames, at, width, start, end, place, last)


def _ranges(at: int, width: int, n: int, is_tail: bool) -> Iterator[tuple[int, int]]:
    if is_tail:
        yield from ((start, at) for start in range(0, min(at - 1, MAX_START)))
    else:
        yield from ((at + width, n - k) for k in range(4) if n - k > at + width + 1)
    yield 0, n


def _plain(rows: np.ndarray, at: int, width: int, start: int, end: int, place: int, last: int) -> Iterator[FrameSum]:
    own = rows[:, at : at + width]
    part = rows[:, start:end]
    is_around = start <= at < end
    total = part.sum(axis=1) - (own.sum(axis=1) if is_around else 0)
    modulus = 1 << 8 * width
    for order in ("<", ">") if width == 2 else ("",):
        value = own[:, 0] if width == 1 else own @ (np.array([1, 256]) if order == "<" else np.array([256, 1]))
        for name, rest in (("sum", value - total), ("neg", value + total)):
            constant = _constant(rest % modulus)
            if constant is not None:
                yield FrameSum(place, width, start, last, name, order, constant)
    if width == 1:
        crossed = np.bitwise_xor.reduce(part, axis=1) ^ (0 if is_around else own[:, 0])
        constant = _constant(crossed)
        if constant is not None:
            yield FrameSum(place, width, start, last, "xor", "", constant)


def _constant(values: np.ndarray) -> int | None:
    """Return the value of nearly all, or ``None``."""
    middle = int(np.sort(values)[len(values) // 2])
    return middle if (values == middle).mean() >= HOLDS_SHARE else None


def _crcs(frames: list[bytes], at: int, width: int, start: int, end: int, place: int, last: int) -> Iterator[FrameSum]:
    for name, (function, size) in CRCS.items():
        if size != width:
            continue
        for order, byte_order in (("<", "little"), (">", "big")) if width > 1 else (("", "big"),):
            yield from _crc(frames, function, byte_order, FrameSum(place, width, start, last, name, order), at, end)


def _crc(
    frames: list[bytes], function: Callable[[bytes], int], byte_order: str, each: FrameSum, at: int, end: int
) -> Iterator[FrameSum]:
    """Yield the CRC if it differs from the bytes of nearly all frames by one constant, which another start gives."""
    rests: Counter[int] = Counter()
    for k, frame in enumerate(frames[:12]):
        got = int.from_bytes(frame[at : at + each.width], byte_order)  # type: ignore[arg-type]
        rests[function(frame[each.start : end]) ^ got] += 1
        if k - rests.most_common(1)[0][1] >= 2:
            return
    yield replace(each, constant=rests.most_common(1)[0][0])
