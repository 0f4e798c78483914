"""The evidence of arrays: fields of one reading, one after another, support each other.

Where a field's own evidence is thin, that of the fields of its phase (all x of x, y, z) decides with it. Where it has
none, as it took few values, its array foretells it: fields that are proven by themselves stand on both sides of it,
many in the array, and no byte says anything else.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from tactemu.fit.infer.fields import Field, is_sign_of
from tactemu.fit.infer.links import Links, crossings

LEAST_VALUES = 6
LEAST_CHANGES = 15
OWN_BITS = 3.0
"""The least bits of a field's own evidence where its array supports it, and the most against it."""
POOLED_BITS = 10.0
"""The least mean of the bits of an array's links."""
LONG_ARRAY = 16
LEAST_ALIKE = 8
ALIKE_SHARE = 0.9
PROVEN_SHARE = 0.15
"""The least share of proven fields in an array that foretells the others."""
LEAST_OF_SIGN = 3
"""The fewest fields of a phase whose sign is proven, so that it is that of the others."""
MORE = "a longer capture in which it moves: it took few values"
SLOW = "slow presses: the capture has too few carries"
BOTH_SIGNS = "slow presses to full scale and back: its top bit moves in leaps only"


def digits_of(each: Field) -> list[int]:
    """Return the offsets of a field's bytes from the lowest."""
    places = list(range(each.at, each.end))
    return places if each.order != ">" else places[::-1]


class Array:
    """The links of an array's fields, and of their neighbours, which support each other.

    Where a field's own evidence is thin, that of the fields of its phase (all x of x, y, z) decides with it.
    """

    def __init__(self, links: Links, fields: Sequence[Field], index: Sequence[int], periods: Sequence[int]):
        self._links, self._fields, self._index, self._periods = links, fields, index, periods
        self._phases = [k % min(periods, default=1) for k in index]
        self._pooled: dict[tuple[int, int, int], tuple[float, float, int]] = {}

    def has_moved(self, values: np.ndarray) -> bool:
        """Return True if a field took so many values that its steps mean something; fewer do in a long array."""
        least = LEAST_VALUES if len(self._fields) < LONG_ARRAY else LEAST_VALUES - 2
        return len(np.unique(values)) >= least and (np.diff(values) != 0).sum() >= LEAST_CHANGES - 5

    def is_proven(self, k: int, low: int, high: int) -> bool:
        """Return True if ``low`` carries into ``high``, bytes of field ``k``."""
        link = self._links.of(low, high)
        if link.is_proven:
            return True
        bits, share, many = self._pool(k, low, high, 1)
        return link.bits >= OWN_BITS and many >= LEAST_ALIKE and bits >= POOLED_BITS * many and share >= ALIKE_SHARE

    def is_refuted(self, k: int, low: int, high: int) -> bool:
        """Return True if ``low``, a byte of field ``k`` or beside it, does not carry into ``high``."""
        link = self._links.of(low, high)
        if link.is_refuted or self._links.is_small(high):  # it may be the upper byte of a small value
            return link.is_refuted
        bits, share, many = self._pool(k, low, high, -1)
        return link.bits <= -OWN_BITS and many >= LEAST_ALIKE and bits <= -POOLED_BITS * many and share >= ALIKE_SHARE

    def _pool(self, k: int, low: int, high: int, sign: int) -> tuple[float, float, int]:
        """Return the bits of the same links of the array, the share of them with this sign, and their number."""
        at = self._fields[k].at
        key = low - at, high - at, self._phases[k]
        if (*key, sign) not in self._pooled:
            length = self._links.length
            places = [
                (low - at + each.at, high - at + each.at)
                for each, phase in zip(self._fields, self._phases)
                if phase == key[2]
            ]
            bits = [self._links.of(a, b).bits for a, b in places if 0 <= min(a, b) and max(a, b) < length]
            known = np.clip([each for each in bits if each != 0.0], -4 * POOLED_BITS, 4 * POOLED_BITS)
            share = float((known * sign > 0).mean()) if len(known) else 0.0
            self._pooled[(*key, sign)] = float(known.sum()), share, len(known)  # type: ignore[index]
        return self._pooled[(*key, sign)]  # type: ignore[index]

    # -- what is foretold ------------------------------------------------------------------------------------------

    def foretell(self, rows: np.ndarray, columns: Sequence[np.ndarray]) -> None:
        """Make fields certain that stand between proven ones and have nothing against them, if many are proven.

        ``columns`` are the unsigned readings of the fields.
        """
        proven = [k for k, each in enumerate(self._fields) if each.is_certain]
        if not self._periods or len(proven) < max(LEAST_ALIKE, PROVEN_SHARE * len(self._fields)):
            return
        signs: defaultdict[tuple[int, int], list[str]] = defaultdict(list)
        for k in proven:
            if self._fields[k].kind != "?":
                for period in self._periods:
                    signs[period, self._index[k] % period].append(self._fields[k].kind)
        known = {at for k in proven for at in range(self._fields[k].at, self._fields[k].end)}
        for k in range(proven[0], proven[-1]):
            each = self._fields[k]
            if each.is_certain or each.decide not in (MORE, SLOW, BOTH_SIGNS) or self._has_doubt(rows, each, known):
                continue
            alike = [signs[period, self._index[k] % period] for period in self._periods]
            kind = _foretold_sign(columns[k], alike, 8 * each.size)
            if kind:
                each.kind, each.is_certain, each.decide = kind, True, ""
                each.why = f"in an array of {len(self._fields)}, {len(proven)} of them proven, on either side of it"

    def _has_doubt(self, rows: np.ndarray, each: Field, known: set[int]) -> bool:
        """Return True if a byte of a field carries where it should not, or does not where it should."""
        inside = [(low, high) for low, high in itertools.pairwise(digits_of(each))]
        if any(self._links.of(low, high).bits <= -OWN_BITS for low, high in inside):
            return True
        outside = [(each.at - 1, each.at), (each.end - 1, each.end)]
        pairs = [(a, b) for a, b in outside if 0 <= a and b < self._links.length and not {a, b} & known]
        for low, high in [*pairs, *((b, a) for a, b in pairs)]:
            if self._links.of(low, high).bits >= OWN_BITS or is_sign_of(rows, low, high):
                return True
        return False


def _foretold_sign(values: np.ndarray, alike: Sequence[Sequence[str]], bits: int) -> str:
    """Return the sign that the fields of its phase foretell, empty if that is open or its own steps contradict.

    ``alike`` are the proven signs of its phase in each period.
    """
    high = values >> bits - 1
    if (high == high[0]).all():
        return "?"
    kinds = {kind for signs in alike for kind in signs}
    if len(kinds) != 1 or min(map(len, alike)) < LEAST_OF_SIGN:
        return ""
    (kind,) = kinds
    seen = crossings(values, bits)
    return "" if (seen.through if kind == "i" else seen.over) else kind
