"""The search for what begins each message of a binary stream: constant bytes at equal distances, or before a length."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

SAMPLE_BYTES = 120_000
LEAST_COUNT = 8
GRAMS = {2: 40, 3: 40, 4: 40, 1: 24}
"""The number of the commonest runs of so many bytes that are tried as heads."""
MAX_FRAME = 70_000
MAX_LENGTH_AT = 13
MAX_EXTRA = 16
"""The largest difference between a length field and the length of its message."""
GAIN_SHARE = 0.6
"""The least share of the best length's information that a shorter one, of which it is a multiple perhaps, must have."""
REGULAR_SHARE = 0.8
"""The least share of equal distances of what occurs once in each message."""
WEAK_HEADS = (b"\x00", b"\xff")


@dataclass(frozen=True)
class Cut:
    """A way to cut a stream into messages."""

    score: float
    """The share of the stream that it explains."""
    head: bytes
    size: int = 0
    """The length of every message; 0 where a field tells it."""
    length_at: int = 0
    length_size: int = 0
    length_order: str = ""
    extra: int = 0
    """The number that is added to the length field."""
    is_exclusive: bool = False
    """True if the head is hardly ever anywhere else: it is what divides the stream."""

    @property
    def is_fixed(self) -> bool:
        """True if all messages have one length."""
        return self.size > 0

    @property
    def length_text(self) -> str:
        """The length field in words."""
        return f"length {self.length_order}u{self.length_size} at {self.length_at} + {self.extra}"

    def size_at(self, stream: bytes, at: int) -> int | None:
        """Return the length of the message that begins at an offset, ``None`` if it is cut off."""
        if self.is_fixed:
            return self.size
        end = at + self.length_at + self.length_size
        if end > len(stream):
            return None
        order = "big" if self.length_order == ">" else "little"
        size = int.from_bytes(stream[end - self.length_size : end], order) + self.extra
        return size if size >= self.length_at + self.length_size else 0


def positions(data: np.ndarray, head: bytes) -> np.ndarray:
    """Return the offsets of a run of bytes."""
    n = len(data) - len(head) + 1
    hit = np.ones(max(n, 0), bool)
    for k, byte in enumerate(head):
        hit &= data[k : n + k] == byte
    return np.nonzero(hit)[0]


def _regular(data: np.ndarray) -> Iterator[Cut]:
    """Yield runs of bytes that occur once in each message and nowhere else: at equal distances."""
    for n in (1, 2, 3, 4):
        code = _codes(data, n)
        order = np.argsort(code, kind="stable")
        ordered, where = code[order], order
        same = ordered[1:] == ordered[:-1]
        gaps, owners = np.diff(where)[same], ordered[1:][same]
        if not len(gaps):
            continue
        by_size = np.lexsort((gaps, owners))
        gaps, owners = gaps[by_size], owners[by_size]
        starts = np.nonzero(np.concatenate([[True], owners[1:] != owners[:-1]]))[0]
        counts = np.diff(np.append(starts, len(gaps)))
        usual = gaps[starts + counts // 2]
        equal = np.add.reduceat((gaps == np.repeat(usual, counts)).astype(int), starts)
        good = (
            (counts >= LEAST_COUNT - 1)
            & (equal >= REGULAR_SHARE * counts)
            & (equal * usual >= REGULAR_SHARE * len(data))
        )
        for k in np.nonzero(good & (usual >= max(3, n)))[0]:
            value = int(owners[starts[k]])
            head = bytes(value >> 8 * j & 255 for j in range(n))
            if set(head) - {0x00, 0xFF}:
                yield Cut(round(float(equal[k] / counts[k]), 3), head, int(usual[k]), is_exclusive=True)


def _codes(data: np.ndarray, n: int) -> np.ndarray:
    code = np.zeros(max(len(data) - n + 1, 0), np.int64)
    for k in range(n):
        code |= data[k : len(data) - n + 1 + k].astype(np.int64) << 8 * k
    return code


def _grams(data: np.ndarray) -> Iterator[bytes]:
    for n, many in GRAMS.items():
        if len(data) < n:
            continue
        values, counts = np.unique(_codes(data, n), return_counts=True)
        for i in np.argsort(-counts)[:many]:
            gram = bytes(int(values[i]) >> 8 * k & 255 for k in range(n))
            if counts[i] >= LEAST_COUNT and not (n > 1 and set(gram) == {0}):
                yield gram


def find_cuts(stream: bytes) -> list[Cut]:
    """Return the ways to cut a stream that explain nearly as much as the best, fixed lengths first."""
    data = np.frombuffer(stream[:SAMPLE_BYTES], np.uint8)
    cuts = list(_regular(data))
    for head in _grams(data):
        where = positions(data, head)
        cuts += _fixed(data, head, where)
        if len(head) < 4 and (len(head) > 1 or head not in WEAK_HEADS) and set(head) - {0x00, 0x01, 0xFF}:
            cuts += _with_length(data, head, where)
    if not cuts:
        return []
    top = max(cut.score for cut in cuts)
    return [cut for cut in cuts if (cut.score > top - 0.02 or cut.is_exclusive) and cut.score > 0.5]


def _fixed(data: np.ndarray, head: bytes, where: np.ndarray) -> Iterator[Cut]:
    inside = np.zeros(len(data) + MAX_FRAME, bool)
    inside[where] = True
    gaps: Counter[int] = Counter()
    for apart in (1, 2, 3):
        gaps.update((where[apart:] - where[:-apart]).tolist())
    for size, _ in gaps.most_common(6):
        if size < max(3, len(head)):
            continue
        asked = where[where + size < len(data)]
        if not len(asked):
            continue
        follows = inside[asked + size]
        cover = follows.sum() * size / len(data)
        yield Cut(round(min(float(follows.mean()), float(cover), 1.0), 3), head, size)


def _with_length(data: np.ndarray, head: bytes, where: np.ndarray) -> Iterator[Cut]:
    inside = np.zeros(len(data) + 2 * MAX_FRAME, bool)
    inside[where] = True
    where = where[:3000]
    for size, order in ((1, ""), (2, "<"), (2, ">")):
        for at in range(max(1, len(head)) if len(head) < 2 else len(head), MAX_LENGTH_AT):
            asked = where[where + at + size < len(data)]
            if len(asked) < LEAST_COUNT:
                continue
            values = data[asked + at].astype(np.int64)
            if size == 2:
                other = data[asked + at + 1].astype(np.int64)
                values = values | other << 8 if order == "<" else values << 8 | other
            if (values == values[0]).all():
                continue
            extras = Counter((np.diff(asked) - values[:-1]).tolist())
            for extra, _ in extras.most_common(2):
                if 0 <= extra <= MAX_EXTRA:
                    cut = _chained(len(data), head, asked, values + extra, inside)
                    if cut is not None:
                        yield Cut(cut, head, 0, at, size, order, extra)


def _chained(n: int, head: bytes, where: np.ndarray, sizes: np.ndarray, inside: np.ndarray) -> float | None:
    """Return the share of the bytes that messages of these lengths cover, each followed by a head."""
    ends = where + sizes
    good = (ends < n) & (ends > where) & inside[np.minimum(ends, n - 1)]
    covered, at, lengths = 0, 0, Counter()
    places, many = where.tolist(), len(where)
    while at < many:
        if good[at]:
            end = int(ends[at])
            covered += end - places[at]
            lengths[end - places[at]] += 1
        else:
            end = places[at] + 1
        at = int(np.searchsorted(where, end))
    if sum(count >= 3 for count in lengths.values()) < 2:
        return None
    span = max(places[-1] - places[0], 1)
    return round(min(covered / span, 1.0) * min(1.0, span / (n * 0.5)), 3)


def best_size(stream: bytes, sizes: set[int]) -> int:
    """Return the length of messages in which each byte tells most of itself: the least mean entropy of a column.

    In a stream of many zeros every length repeats itself; only the right one has columns of their own.
    """
    data = np.frombuffer(stream[:SAMPLE_BYTES], np.uint8)
    entropies = {size: _column_entropy(data, size) for size in sorted(sizes) if len(data) >= 4 * size}
    if not entropies:
        return min(sizes)
    least = min(entropies.values())
    whole = _column_entropy(data, 1)
    return next(size for size, entropy in entropies.items() if whole - entropy >= GAIN_SHARE * (whole - least))


def _column_entropy(data: np.ndarray, size: int) -> float:
    """Return the mean entropy of the bytes at each place [bits], corrected for the number of samples."""
    rows = data[: len(data) // size * size].reshape(-1, size)
    counts = np.bincount((rows + 256 * np.arange(size)).ravel(), minlength=256 * size).reshape(size, 256)
    shares = counts / len(rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        entropy = -np.where(counts > 0, shares * np.log2(shares), 0.0).sum(axis=1)
    seen = (counts > 0).sum(axis=1) - 1
    return float((entropy + seen / (2 * np.log(2) * len(rows))).mean())
