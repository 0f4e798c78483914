"""The search for a stuffing that no standard names: a head, a tail, an escape, and a code for each of the three.

Head and tail are always beside each other, and nowhere else. The escape is the byte whose number in a packet tells its
length: without escapes all packets are as long as each other.
"""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np

from firmware_protocols import Stuffing

LEAST_MESSAGES = 12
BESIDE_SHARE = 0.98
"""The least share of heads and tails that are beside each other."""
SAME_SHARE = 0.95
"""The least share of the packets that are as long as each other without escapes."""
LEAST_ESCAPED = 8
"""The fewest packets with an escape."""
MAX_CODES = 3


def find_stuffing(stream: bytes) -> Stuffing | None:
    """Return head, tail, escape and codes of a stream's packets, ``None`` if they are not stuffed."""
    data = np.frombuffer(stream, np.uint8).astype(np.int64)
    if len(data) < 2:
        return None
    follows = np.bincount(data[:-1] << 8 | data[1:], minlength=1 << 16).reshape(256, 256)
    counts = np.bincount(data, minlength=256)
    usual = BESIDE_SHARE * np.maximum(counts[:, None], counts[None, :]) - 1
    for tail, head in np.argwhere((follows >= LEAST_MESSAGES) & (follows >= usual)):
        if tail == head:
            continue
        packets = [part[1:] for part in stream.split(bytes([tail]))[1:-1] if part[:1] == bytes([head])]
        for escape in np.nonzero((follows > 0).sum(axis=1) <= MAX_CODES)[0]:
            if escape not in (tail, head) and _evens_lengths(packets, bytes([escape])):
                codes = np.nonzero(follows[escape])[0].tolist()
                return _stuffing(packets, int(head), int(tail), int(escape), codes)
    return None


def _evens_lengths(packets: list[bytes], escape: bytes) -> bool:
    """Return True if packets with and without escapes are as long as each other once those are gone."""
    escaped = [len(each) - each.count(escape) for each in packets if escape in each]
    plain = [len(each) for each in packets if escape not in each]
    if min(len(escaped), len(plain)) < LEAST_ESCAPED:
        return False
    usual = Counter(plain).most_common(1)[0][0]
    return all(some.count(usual) >= SAME_SHARE * len(some) for some in (escaped, plain))


def _stuffing(packets: list[bytes], head: int, tail: int, escape: int, codes: list[int]) -> Stuffing:
    """Return a stuffing with the meaning of its codes: the bytes that are nearest to what stands there otherwise."""
    near = {code: _mean_beside(packets, escape, code) for code in codes}
    order = min(
        itertools.permutations((head, tail, escape), len(codes)),
        key=lambda each: (
            len({byte ^ code for byte, code in zip(each, codes)}) > 1,
            sum(abs(near[code] - byte) for code, byte in zip(codes, each)),
        ),
    )
    meanings = dict(zip(order, codes))
    unused = (code for code in range(256) if code not in codes)
    for byte in (head, tail, escape):
        meanings.setdefault(byte, next(unused))  # the capture has none
    return Stuffing(
        head=bytes([head]),
        tail=bytes([tail]),
        escape=bytes([escape]),
        codes={bytes([byte]): bytes([code]) for byte, code in meanings.items()},
    )


def _mean_beside(packets: list[bytes], escape: int, code: int) -> float:
    """Return the mean of the bytes in the packets before and behind at the places where a code stands."""
    rows = [_marked(each, escape) for each in packets]
    values = []
    for before, row, behind in zip(rows, rows[1:], rows[2:]):
        for at in np.nonzero(row == -1 - code)[0]:
            values += [other[at] for other in (before, behind) if at < len(other) and other[at] >= 0]
    return float(np.mean(values)) if values else 0.0


def _marked(packet: bytes, escape: int) -> np.ndarray:
    """Return the content of a packet, less than 0 for codes."""
    first, *rest = packet.split(bytes([escape]))
    content = [*first]
    for piece in rest:
        content += [-1 - byte if k == 0 else byte for k, byte in enumerate(piece)]
    return np.array(content)
