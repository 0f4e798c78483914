"""The division of messages into fields: the readings that need the fewest bits together, found by dynamic programming.

A change of the reading has a price, so that an array of equal fields is one run, also where some of its bytes stand
still.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tactemu.fit.infer.costs import BYTE, KINDS, Kind, prices, sample
from tactemu.fit.infer.fields import Field

NEW_RUN_BITS = 24.0
STILL_BYTE_BITS = 3.0
"""The price of each byte of a first field that never moves: a field has rarely more bytes than it needs."""
CONSTANT_BITS = 8.0
FIELD_BITS = 0.5
PACKED_BITS = {2: 60.0, 3: 30.0}
"""The extra price of a run of packed values, which are rare, by their bytes."""
RARE_BITS = {3: 20.0, 8: 40.0}
"""The extra price of a run of fields of a size that is rare."""
FLOAT_BITS = 24.0
"""The extra price of a run of floats: bytes that are pressed together may look like one."""
LEAST_ROWS = 12
"""The fewest messages in which fields are looked for."""
_STILL = -1
WORD = KINDS.index(Kind(2, ">"))
WORD_BITS = 12.0
"""The bits in favour of each word where a protocol has words."""


@dataclass(frozen=True)
class Run:
    """Neighbouring fields of one reading."""

    kind: Kind
    offsets: tuple[int, ...]
    margin_bits: float
    """The bits that the best other reading needs more."""


def find_runs(rows: np.ndarray, taken: Iterable[Field], words_from: int | None = None) -> list[Run]:
    """Return the runs of fields in the bytes that no field of ``taken`` has.

    From ``words_from`` on the protocol has big-endian words: without evidence against it, a pair of bytes is one.
    """
    rows = sample(rows)
    length = rows.shape[1]
    varies = (rows != rows[0]).any(axis=0)
    blocked = np.zeros(length, bool)
    nibbles = []
    for each in taken:
        if each.bits:
            nibbles.append(each.at)
        else:
            blocked[each.at : each.end] = True
    price = prices(rows, nibbles)
    for kind, costs in zip(KINDS, price):
        if len(costs):
            costs[np.lib.stride_tricks.sliding_window_view(blocked, kind.size).any(axis=1)] = np.inf
    if words_from is not None:
        price[WORD][words_from::2] -= WORD_BITS
    steps = _cheapest(price, varies, blocked, nibbles)
    return _runs(steps, price)


def _cheapest(
    price: list[np.ndarray], varies: np.ndarray, blocked: np.ndarray, nibbles: Sequence[int]
) -> list[tuple[int, int]]:
    """Return offset and reading of each field of the cheapest division."""
    length = len(varies)
    best: list[dict[int, tuple[float, int, int, bool]]] = [{} for _ in range(length + 1)]
    best[0][_STILL] = (0.0, -1, _STILL, False)  # bits, offset before, reading before, is a field

    for at in range(length):
        states = best[at]
        if not states:
            continue
        lowest = min(states, key=lambda state: states[state][0])
        free = not varies[at] or blocked[at]
        for state, (bits, _, _, _) in states.items():
            if free:
                more = 0.0 if state == _STILL or blocked[at] else CONSTANT_BITS
                _put(best[at + 1], _STILL, bits + more, at, state, False)
            for number, kind in enumerate(KINDS):
                if at + kind.size > length or not np.isfinite(price[number][at]):
                    continue
                if state == number:
                    _put(best[at + kind.size], number, bits + price[number][at] + FIELD_BITS, at, state, True)
                elif state == lowest:
                    still = kind.size - int(varies[at : at + kind.size].sum())
                    more = NEW_RUN_BITS + STILL_BYTE_BITS * still + RARE_BITS.get(kind.size, 0.0)
                    more += FLOAT_BITS if kind.is_float else 0.0
                    more += PACKED_BITS[kind.size] if kind.parts and at not in nibbles else 0.0
                    if kind.is_float and not varies[_top(kind, at)].any():
                        continue
                    _put(best[at + kind.size], number, bits + price[number][at] + more, at, state, True)
    steps, at = [], length
    state = min(best[length], key=lambda each: best[length][each][0])
    while at > 0:
        _, before, previous, is_field = best[at][state]
        if is_field:
            steps.append((before, state))
        at, state = before, previous
    return steps[::-1]


def _top(kind: Kind, at: int) -> slice:
    """Return the two uppermost bytes of a number."""
    return slice(at + kind.size - 2, at + kind.size) if kind.order == "<" else slice(at, at + 2)


def _put(states: dict, state: int, bits: float, at: int, before: int, is_field: bool) -> None:
    if state not in states or bits < states[state][0]:
        states[state] = (bits, at, before, is_field)


def _runs(steps: list[tuple[int, int]], price: list[np.ndarray]) -> list[Run]:
    runs: list[Run] = []
    k = 0
    while k < len(steps):
        number, offsets = steps[k][1], [steps[k][0]]
        size = KINDS[number].size
        while k + 1 < len(steps) and steps[k + 1] == (offsets[-1] + size, number):
            offsets.append(steps[k + 1][0])
            k += 1
        k += 1
        runs.append(Run(KINDS[number], tuple(offsets), _margin(number, offsets, price)))
    return runs


def _margin(number: int, offsets: list[int], price: list[np.ndarray]) -> float:
    """Return how many bits the best other reading of a run needs more."""
    size, own = KINDS[number].size, sum(price[number][at] for at in offsets)
    begin, end = offsets[0], offsets[-1] + size
    others = []
    for other, kind in enumerate(KINDS):
        for shift in range(kind.size):
            places = range(begin + shift, end - kind.size + 1, kind.size)
            if (other == number and shift == 0) or not len(places):
                continue
            bits = sum(price[other][at] for at in places)
            edges = [*range(begin, begin + shift), *range(places[-1] + kind.size, end)]
            others.append(bits + sum(price[BYTE][at] for at in edges))
    return min(others, default=0.0) - own
