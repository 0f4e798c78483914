"""Fields from runs of one reading, each certain only where a proof is seen.

An integer is certain if each byte carries into the next, no neighbour can belong to it, and its sign is seen: small
steps over zero, or over the middle of the range. A float is certain if it crosses zero smoothly, which no integer of
these bytes does. What is not certain names the capture that would decide it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactemu.fit.infer.costs import Kind, Part, bits_of, is_plausible
from tactemu.fit.infer.fields import Field, integers, signed
from tactemu.fit.infer.links import Crossings, Link, Links, crossings
from tactemu.fit.infer.segments import Run

LEAST_CROSSINGS = 5
CLEAR_RATIO = 20
LEAST_BITS = 8.0
SIGN_SHARE = 0.98
LEAST_VALUES = 6
LEAST_CHANGES = 15
OWN_BITS = 3.0
"""The least bits of a field's own evidence where its array supports it."""
POOLED_BITS = 10.0
"""The least mean of the bits of an array's links."""
FEW_STATES = 6
LONG_ARRAY = 16
LEAST_ALIKE = 8
ALIKE_SHARE = 0.9
FLOAT_RUN = 3
MAX_PERIOD = 6
"""The largest number of columns after which the signs of an array repeat, such as x, y, z."""
MORE = "a longer capture in which it moves: it took few values"
SLOW = "slow presses: the capture has too few carries"
FULL_SCALE = "full scale: the byte above it never moved"
BOTH_SIGNS = "slow presses to full scale and back: its top bit moves in leaps only"
CLOSED_KINDS = ("sum", "length", "selector")


@dataclass
class Sign:
    """The sign of an integer: ``u``, ``i`` or ``?`` where the top bit never moved."""

    kind: str
    is_certain: bool


class _Array:
    """The links of an array's fields, and of their neighbours, which support each other.

    Where a field's own evidence is thin, that of the fields of its phase (all x of x, y, z) decides with it.
    """

    def __init__(self, links: Links, fields: Sequence[Field], phases: Sequence[int]):
        self._links, self._fields, self._phases = links, fields, phases
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


def _digits(each: Field) -> list[int]:
    """Return the offsets of a field's bytes from the lowest."""
    places = list(range(each.at, each.end))
    return places if each.order != ">" else places[::-1]


class Prover:
    """Turns the runs of one group into fields."""

    def __init__(self, rows: np.ndarray, taken: Sequence[Field], head: int, has_words: bool = False):
        self.has_words = has_words
        self.rows, self.links = rows, Links(rows)
        self.length = rows.shape[1]
        self.varies = (rows != rows[0]).any(axis=0)
        self.closed = np.zeros(self.length, bool)
        """Bytes that are known to be no part of a value: sums, lengths, selectors, counters, the head."""
        self.closed[:head] = ~self.varies[:head] & ~np.isin(rows[0, :head], (0, 0xFF))
        for each in taken:
            if (each.kind in CLOSED_KINDS or each.is_certain) and not each.bits:
                self.closed[each.at : each.end] = True

    def fields(self, runs: Sequence[Run]) -> list[Field]:
        """Return the fields of all runs, in the order of their bytes."""
        found: list[Field] = []
        for run in runs:
            if run.kind.is_float:
                found += self._floats(run)
            elif run.kind.parts:
                found += self._packed(run)
            else:
                found += self._integers(run)
        return sorted(found, key=lambda each: (each.at, each.shift))

    # -- integers --------------------------------------------------------------------------------------------------

    def _integers(self, run: Run) -> list[Field]:
        size, order = run.kind.size, run.kind.order
        moving = [at for at in run.offsets if self.varies[at : at + size].any()]
        begin, end = run.offsets[0], run.offsets[-1] + size
        is_word = self.has_words and size == 2 and order == ">"
        if size > 1 and not is_word and len(np.unique(self.rows[:, begin:end], axis=0)) <= FEW_STATES:
            return self._bytes(begin, end)
        columns = {at: integers(self.rows, at, size, order or "<") for at in moving}
        index = [(at - run.offsets[0]) // size for at in moving]
        signs, period = signs_of([columns[at] for at in moving], index, 8 * size)
        phases = [k % max(period, 1) for k in index]
        fields = [Field(at, size, sign.kind, order) for at, sign in zip(moving, signs)]
        array = _Array(self.links, fields, phases)
        for k, (each, sign) in enumerate(zip(fields, signs)):
            each.is_width_open = any(self._may_extend(each, at) for at in self._above(each))
            self._judge(each, sign, columns[each.at], array, k)
        return fields

    def _bytes(self, begin: int, end: int) -> list[Field]:
        """Return bytes that changed together a few times as single ones: nothing shows where a number ends."""
        return [Field(k, 1, "u", is_width_open=True, decide=MORE) for k in range(begin, end) if self.varies[k]]

    def _above(self, each: Field) -> list[int]:
        """Return the offsets of the bytes that would be its next upper byte."""
        if each.size == 1:
            return [each.at - 1, each.at + 1]
        return [each.at + each.size] if each.order == "<" else [each.at - 1]

    def _may_extend(self, each: Field, at: int) -> bool:
        """Return True if the byte at ``at`` never moved and may be an upper byte of the field."""
        if not 0 <= at < self.length or self.closed[at] or self.varies[at]:
            return False
        return not self.links.of(_digits(each)[-1], at).is_refuted

    def _judge(self, each: Field, sign: Sign, values: np.ndarray, array: _Array, k: int) -> None:
        digits = _digits(each)
        if not array.has_moved(values):
            each.decide = MORE
        elif not all(array.is_proven(k, low, high) for low, high in itertools.pairwise(digits)):
            each.decide = SLOW if self.varies[digits[-1]] else FULL_SCALE
        elif each.is_width_open:
            each.decide = FULL_SCALE
        elif not all(self._is_closed(each, at, array, k) for at in (each.at - 1, each.end)):
            each.decide = SLOW
        elif not sign.is_certain:
            each.decide = BOTH_SIGNS
        else:
            each.is_certain = True
            seen = "carries from byte to byte" if each.size > 1 else "no neighbour carries into it"
            each.why = seen + {"i": ", crosses zero", "u": ", crosses its middle"}.get(
                sign.kind, ", its top bit never moved"
            )

    def _is_closed(self, each: Field, at: int, array: _Array, k: int) -> bool:
        """Return True if the byte at ``at``, beside the field, is no part of it."""
        if not 0 <= at < self.length or self.closed[at]:
            return True
        if each.size == 1 and self.varies[at] and self._is_sign_of(each.at, at):
            return False
        digits, is_left = _digits(each), at < each.at
        roles = []
        if each.size == 1 or (is_left == (each.order == ">")):
            roles.append((digits[-1], at))  # above it
        if each.size == 1 or (is_left == (each.order == "<")):
            roles.append((at, digits[0]))  # below it
        for low, high in roles:
            if not self.varies[low] and low == at:
                if each.size == 1 and self.rows[0, at] == 0:
                    return False
            elif not (array.is_refuted(k, low, high) or self._has_other(low, high)):
                return False
        return True

    def _is_sign_of(self, low: int, high: int) -> bool:
        """Return True if one byte is FF where the other's top bit is set, and else 0: an extended sign."""
        extended = np.where(self.rows[:, low] & 0x80, 0xFF, 0)
        return bool((self.rows[:, high] == extended).mean() >= SIGN_SHARE)

    def _has_other(self, low: int, high: int) -> bool:
        """Return True if one of the two bytes has another partner, on its other side, that is proven."""
        step = high - low
        up, down = low - step, high + step
        return (0 <= up < self.length and self.links.of(low, up).is_proven) or (
            0 <= down < self.length and self.links.of(down, high).is_proven
        )

    # -- packed values ---------------------------------------------------------------------------------------------

    def _packed(self, run: Run) -> list[Field]:
        kind = run.kind
        found = []
        for at in run.offsets:
            whole = integers(self.rows, at, kind.size, kind.order)
            for part in kind.values:
                values = whole >> part.shift & (1 << part.bits) - 1
                if (values == values[0]).all():
                    continue
                found.append(self._packed_field(at, kind, part, values))
        return found

    def _packed_field(self, at: int, kind: Kind, part: Part, values: np.ndarray) -> Field:
        first, last = part.shift // 8, (part.shift + part.bits - 1) // 8
        size = last - first + 1
        start = at + first if kind.order == "<" else at + kind.size - 1 - last
        each = Field(start, size, "bits", kind.order if size > 1 else "", part.bits, part.shift - 8 * first)
        if part.bits < 8:
            each.decide = SLOW
            return each
        sign = signs_of([values], [0], part.bits)[0][0]
        each.kind = sign.kind
        each.is_certain = _carries(values) and not _carries(_mirrored(values)) and sign.is_certain
        each.why = "carries from nibble to nibble" if each.is_certain else ""
        each.decide = "" if each.is_certain else SLOW
        return each

    # -- floats ----------------------------------------------------------------------------------------------------

    def _floats(self, run: Run) -> list[Field]:
        size, order = run.kind.size, run.kind.order
        found, proven = [], 0
        for at in run.offsets:
            if not self.varies[at : at + size].any():
                continue
            each = Field(at, size, "f", order)
            values = each.values(self.rows)
            if not is_plausible(values):
                each.decide = "a capture without damaged messages"
            elif self._is_smooth_over_zero(values):
                each.is_certain, each.why = True, "crosses zero smoothly"
                proven += 1
            else:
                each.decide = "presses that take it through zero"
            found.append(each)
        if len(found) >= FLOAT_RUN and proven >= max(2, len(found) / 3):
            for each in found:
                if not each.is_certain and is_plausible(each.values(self.rows)):
                    each.is_certain, each.decide = True, ""
                    each.why = f"in an array of {len(found)} floats, {proven} of them cross zero smoothly"
        return found

    @staticmethod
    def _is_smooth_over_zero(values: np.ndarray) -> bool:
        span = np.ptp(values)
        flips = (values[1:] > 0) != (values[:-1] > 0)
        if flips.sum() < LEAST_CROSSINGS or not span:
            return False
        near = np.abs(np.diff(values)[flips]) <= 0.25 * span
        return bool(near.mean() >= 0.8 and len(np.unique(values)) >= 20)


def _carries(values: np.ndarray) -> bool:
    """Return True if each nibble of values of 12 bits carries into the next."""
    return Link(values & 0xFF, values >> 8, 8, 4).is_proven and Link(values & 0xF, values >> 4 & 0xFF, 4, 8).is_proven


def _mirrored(values: np.ndarray) -> np.ndarray:
    """Return values of 12 bits with their lowest nibble as the highest: those of a packing in the other order."""
    return values >> 4 | (values & 0xF) << 8


def signs_of(columns: list[np.ndarray], index: Sequence[int], bits: int) -> tuple[list[Sign], int]:
    """Return the sign of each of an array's unsigned readings, and the period in which they repeat.

    ``index`` is the number of each in the array. A column whose own crossings are too few is certain if it has some,
    none against, and the columns of its phase have many.
    """
    seen = [crossings(values, bits) for values in columns]
    own = [_sign(values, bits, each) for values, each in zip(columns, seen)]
    if len(columns) < 4:
        return own, 1
    period = _period(own, seen, index)
    for k, sign in enumerate(own):
        if sign.is_certain or not period:
            continue
        alike = [j for j in range(len(own)) if index[j] % period == index[k] % period]
        together = _kind_of(sum((seen[j] for j in alike), Crossings()), 2 * LEAST_CROSSINGS)
        if together:
            sign.kind = together
            sign.is_certain = together == _kind_of(seen[k], 1)
    return own, period


def _period(signs: list[Sign], seen: list[Crossings], index: Sequence[int]) -> int:
    """Return the least period in which the signs of an array never contradict each other; 0 for none."""
    known = [(k, sign.kind if sign.is_certain else _kind_of(each, 2)) for k, sign, each in zip(index, signs, seen)]
    known = [(k, kind) for k, kind in known if kind in ("u", "i")]
    for period in range(1, MAX_PERIOD + 1):
        phases = [{kind for k, kind in known if k % period == phase} for phase in range(period)]
        if all(len(kinds) <= 1 for kinds in phases):
            return period
    return 0


def _kind_of(seen: Crossings, least: int = LEAST_CROSSINGS) -> str:
    """Return the sign that crossings prove, or an empty text."""
    if seen.over >= least and seen.over > CLEAR_RATIO * seen.through and 2 * seen.over >= seen.leaps:
        return "i"
    if seen.through >= least and seen.through > CLEAR_RATIO * seen.over and 2 * seen.through >= seen.leaps:
        return "u"
    return ""


def _sign(values: np.ndarray, bits: int, seen: Crossings) -> Sign:
    half = 1 << bits - 1
    high = values >= half
    if high.all() or not high.any():
        return Sign("?", True)
    if kind := _kind_of(seen):
        return Sign(kind, True)
    if (values == 2 * half - 1).sum() > 2 * ((values > 2 * half - 9) & (values < 2 * half - 1)).sum():
        return Sign("u", False)  # it is clipped at the upper end
    unsigned = float(bits_of(values[:, None])[0])
    as_signed = float(bits_of(signed(values, bits)[:, None])[0])
    if abs(unsigned - as_signed) < LEAST_BITS:
        near_zero = (values[high] > 2 * half - half // 8) & (values[high] < 2 * half - 1)
        return Sign("i" if near_zero.mean() > 0.8 else "u", False)
    return Sign("i" if as_signed < unsigned else "u", False)
