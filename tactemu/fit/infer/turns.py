"""The search for where messages of one length begin: at constants, behind a tail or a silence, or where a sum holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tactemu.base.sum_search import FrameSum
from tactemu.fit.infer.sums import find_sum

TIMED_SHARE = 0.6
TRIED_SUMS = 120
OTHER_SHARE = 0.3
TAILS = (b"\x00\x00\x80\x7f", b"\r\n")
"""The ends of binary messages for plotters and terminals: an infinite float, and the end of a line."""
LENGTH_BONUS = 4.0
"""The weight of a length among the constants of a head, in bytes of the head."""
MAX_LENGTH_AT = 12
LEAST_TOLD = 16
"""The least number that is taken for a length."""
BEGUN_SHARE = 0.9
"""The least share of the messages before which the line was silent, where there are other silences, too."""


def turns_of(constant: np.ndarray, values: np.ndarray) -> list[int]:
    """Return where a message may begin: at runs of constants, the longest and oddest first."""
    size, is_constant = len(constant), constant
    if is_constant.all() or not is_constant.any():
        return [0]
    found = []
    for begin in np.nonzero(is_constant & ~np.roll(is_constant, 1))[0]:
        run = 0
        while is_constant[(begin + run) % size] and run < size:
            run += 1
        for k in range(run):
            rest = [int(values[(begin + j) % size]) for j in range(k, run)]
            odd = sum(byte != 0 for byte in rest[:4]) + (-2 if rest[0] in (0, 0x0D, 0x0A) else 0.5)
            head = [int(values[at]) if constant[at] else -1 for at in (begin + k + np.arange(MAX_LENGTH_AT + 2)) % size]
            if rest[0] not in (0, 0x0D, 0x0A) and _tells_size(head, size):
                odd += LENGTH_BONUS
            found.append((-odd + 0.01 * k + (0.3 if k else 0.0), int(begin + k) % size))
    ended = [turn for tail in TAILS for turn in _behind(tail, constant, values)]
    return [*ended, *[turn for _, turn in sorted(found) if turn not in ended]][:40]


def _behind(tail: bytes, constant: np.ndarray, values: np.ndarray) -> list[int]:
    """Return where a message begins if these bytes end it: behind them, if they occur once."""
    size = len(constant)
    rings = [np.roll(constant & (values == byte), -k) for k, byte in enumerate(tail)]
    found = np.nonzero(np.all(rings, axis=0))[0]
    return [(int(found[0]) + len(tail)) % size] if len(found) == 1 and size > len(tail) else []


def _tells_size(head: list[int], size: int) -> bool:
    """Return True if constants at the beginning of a message are the number of the bytes behind them.

    ``head`` has -1 for bytes that change.
    """
    for at in range(1, MAX_LENGTH_AT):
        one, two = head[at], head[at + 1]
        words = [(1, one)] if min(one, two) < 0 else [(1, one), (2, one | two << 8), (2, one << 8 | two)]
        for width, value in words:
            behind = size - at - width
            if value >= LEAST_TOLD and value in (behind, behind - 1, behind - 2):
                return True
    return False


def timed_turn(silences: Sequence[int] | None, size: int, anchors: np.ndarray) -> int | None:
    """Return where messages begin behind an anchor, if the line was silent there mostly."""
    known = np.array([each for each in silences or () if anchors[0] <= each <= anchors[-1] + size], int)
    if not len(known):
        return None
    before = anchors[np.searchsorted(anchors, known, side="right") - 1]
    turns = Counter(((known - before) % size).tolist()).most_common(2)
    turn, count = turns[0]
    is_alone = len(turns) < 2 or turns[1][1] < OTHER_SHARE * len(anchors)
    if count > TIMED_SHARE * len(known) or (count > BEGUN_SHARE * len(anchors) and is_alone):
        return turn
    return None


def best_turn(stream: bytes, size: int, anchors: np.ndarray, turns: list[int]) -> tuple[int, FrameSum | None]:
    """Return the turn, of those that are likely in this order, with the widest sum, and that sum; else the first."""
    best: tuple[int, FrameSum] | None = None
    anchors = anchors[:: max(1, len(anchors) // TRIED_SUMS)]
    for rank, turn in enumerate(turns):
        begins = [int(at) + turn for at in anchors if at + turn + size <= len(stream)]
        found = find_sum([stream[at : at + size] for at in begins])
        if found and (best is None or found.width > best[1].width):
            best = turn, found
        if (found and (found.width > 1 or rank > 6)) or (rank > 12 and size > 600):
            break
    return best or (turns[0], None)
