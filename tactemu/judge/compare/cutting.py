"""Cutting of a real sensor's bytes into frames by the classes of its model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from tactemu.judge.compare.frame_classes import FrameClass, opened

MAX_HEAD_BYTES = 4
"""Largest number of constant first bytes by which frames of another length are found."""
SPACING_SHARE = 0.6
"""Least share of the heads that are followed by the next one at one distance, for frames of that length."""


@dataclass
class ByteStream:
    """Bytes with the times at which they were read."""

    data: bytes = b""
    times_ns: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    """The time of each piece."""
    ends: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    """The number of bytes up to the end of each piece."""

    @staticmethod
    def of(pieces: Sequence[tuple[int, bytes]]) -> ByteStream:
        """Return the stream of pieces with their times."""
        ends = np.cumsum([len(data) for _, data in pieces], dtype=np.int64)
        times = np.array([t_ns for t_ns, _ in pieces], np.int64)
        return ByteStream(b"".join(data for _, data in pieces), times, ends)

    def time_ns(self, end: int) -> int:
        """Return the time at which the byte before ``end`` was read."""
        return int(self.times_ns[min(int(np.searchsorted(self.ends, end)), len(self.times_ns) - 1)])


@dataclass(frozen=True, slots=True)
class Piece:
    """A frame of a class, or bytes between frames."""

    start: int
    end: int
    made: FrameClass | None
    content: bytes


def cut(data: bytes, classes: Sequence[FrameClass]) -> list[Piece]:
    """Return frames of these classes and the bytes between them, in order."""
    envelope = classes[0].envelope if classes else "plain"
    if envelope != "plain":
        return list(_split(data, [each for each in classes if each.envelope == envelope], envelope))
    sized = [
        each for each in classes if each.size is not None and each.envelope == "plain" and (each.fixed or each.sum)
    ]
    if len(classes) == 1 and classes[0].is_unmarked:
        return list(_cut_unmarked(data, classes[0]))
    return list(_cut_plain(data, sized))


def _split(data: bytes, classes: Sequence[FrameClass], envelope: str) -> Iterator[Piece]:
    """Yield the parts between the bytes that end frames; the first one may be incomplete, and is left out."""
    end = {"line": b"\n", "ppp": b"\x7e", "cobs": b"\0"}[envelope]
    at = data.find(end) + 1
    while (stop := data.find(end, at)) >= 0:
        raw = data[at : stop + 1]
        for content in opened(raw, envelope):
            made = next((each for each in classes if _fits(each, content)), None)
            yield Piece(at, stop + 1, made, content)
        at = stop + 1


def _cut_unmarked(data: bytes, made: FrameClass) -> Iterator[Piece]:
    """Yield frames that nothing marks: they follow each other from the first byte on."""
    assert made.size is not None
    for at in range(0, len(data), made.size):
        content = data[at : at + made.size]
        yield Piece(at, at + len(content), made if len(content) == made.size else None, content)


def _fits(made: FrameClass, content: bytes) -> bool:
    return made.fits(content) and (made.sum is None or made.sum.holds(content))


def _cut_plain(data: bytes, classes: Sequence[FrameClass]) -> Iterator[Piece]:
    starts = sorted(
        (at, k) for k, each in enumerate(classes) for at in places_of(data, each.fixed_bytes, each.size or 1)
    )
    known = {at for at, _ in starts}
    done = 0
    for at, k in starts:
        made = classes[k]
        assert made.size is not None
        end = at + made.size
        if at < done or end > len(data):
            continue
        content = data[at:end]
        if made.sum is not None:
            is_sound = made.sum.holds(content)
        else:
            is_sound = at == done or end in known or len(made.fixed) > MAX_HEAD_BYTES or end > len(data) - made.size
        if not is_sound:
            continue
        if at > done:
            yield Piece(done, at, None, data[done:at])
        yield Piece(at, end, made, content)
        done = end
    if done < len(data):
        yield Piece(done, len(data), None, data[done:])


def places_of(data: bytes, fixed: dict[int, int], size: int) -> list[int]:
    """Return the places at which frames of this size with these constants can begin."""
    array = np.frombuffer(data, np.uint8)
    n = len(array) - size + 1
    if n <= 0:
        return []
    fits = np.ones(n, bool)
    for at, value in fixed.items():
        fits &= array[at : at + n] == value
    return np.flatnonzero(fits).tolist()


def spacing_of(data: bytes, made: FrameClass, classes: Sequence[FrameClass]) -> int | None:
    """Return the distance from a frame of a class to the next frame, if most have the same; ``None``: there is none."""
    heads = [head for each in classes if (head := const_head(each))]
    own = const_head(made)
    if not own:
        return None
    others = sorted({at for head in heads for at in places_of(data, dict(enumerate(head)), len(head))})
    starts = places_of(data, dict(enumerate(own)), len(own))
    if len(starts) < 4:
        return None
    following = np.array(others)
    nexts = np.searchsorted(following, np.array(starts), side="right")
    apart = [int(following[k] - at) for at, k in zip(starts, nexts) if k < len(following)]
    if not apart:
        return None
    values, counts = np.unique(apart, return_counts=True)
    best = int(counts.argmax())
    return int(values[best]) if counts[best] >= SPACING_SHARE * len(apart) else None


def const_head(made: FrameClass) -> bytes:
    """Return the constant first bytes of a class, at most :data:`MAX_HEAD_BYTES`."""
    n = next(k for k in range(MAX_HEAD_BYTES + 1) if k not in made.const or k == MAX_HEAD_BYTES)
    return bytes(made.const[k] for k in range(n))
