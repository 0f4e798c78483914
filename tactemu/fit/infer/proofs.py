"""Fields from runs of one reading, each certain only where a proof is seen.

An integer is certain if each byte carries into the next, no neighbour can belong to it, and its sign is seen: small
steps over zero, or over the middle of the range. Its array may foretell what it lacks. A float has proofs of its own
(:mod:`tactemu.fit.infer.floats`). What is not certain names the capture that would decide it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tactemu.fit.infer import floats
from tactemu.fit.infer.arrays import BOTH_SIGNS, MORE, SLOW, Array, digits_of
from tactemu.fit.infer.costs import Kind, Part
from tactemu.fit.infer.fields import Field, integers, is_sign_of
from tactemu.fit.infer.links import Link, Links
from tactemu.fit.infer.segments import Run
from tactemu.fit.infer.signs import Sign, signs_of

FEW_STATES = 6
FULL_SCALE = "full scale: the byte above it never moved"
COARSE = "finer steps: its lowest four bits never moved, as where 12 bits are beside those of another value"
CLOCK_SHARE = 0.9
"""The least share of equal steps of a clock."""
LEAST_LABELLED = 8
"""The fewest fields of an array whose labels are recognised."""
CLOSED_KINDS = ("sum", "length", "selector")


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
        for run in itertools.chain.from_iterable(map(self._cut_off, runs)):
            if run.kind.is_float:
                found += self._floats(run)
            elif run.kind.parts:
                found += self._packed(run)
            else:
                found += self._integers(run)
        return sorted(found, key=lambda each: (each.at, each.shift))

    def _cut_off(self, run: Run) -> list[Run]:
        """Return a run without the upper bytes that are no part of its values for all the capture shows.

        Those are bytes of the head, to which its first field does not extend, and labels: constants that differ from
        field to field. The width of what is left is open.
        """
        size, order = run.kind.size, run.kind.order
        if size == 1 or run.kind.is_float or run.kind.parts:
            return [run]
        if labels := self._labels(run):
            narrowed = _narrowed(run, labels)
            for at in narrowed.offsets:
                beside = at - 1 if order == ">" else at + narrowed.kind.size
                self.closed[beside] = False  # it may be part of the value after all
            return [narrowed]
        first = run.offsets[0]
        inside = 0 if order == "<" else int(self.closed[first : first + size - 1].sum())
        if not inside or not self.closed[first : first + inside].all():
            return [run]
        self.closed[first : first + inside] = False  # they may be part of it
        rest = [Run(run.kind, run.offsets[1:], run.margin_bits)] if len(run.offsets) > 1 else []
        return [_narrowed(Run(run.kind, run.offsets[:1], run.margin_bits), inside), *rest]

    def _labels(self, run: Run) -> int:
        """Return how many of the uppermost bytes of an array's fields are labels."""
        if len(run.offsets) < LEAST_LABELLED:
            return 0
        labels = 0
        for k in range(run.kind.size - 1):
            tops = np.array(run.offsets) + (run.kind.size - 1 - k if run.kind.order == "<" else k)
            if self.varies[tops].any():
                break
            if len(np.setdiff1d(self.rows[0, tops], (0, 0xFF))) > 1:
                labels = k + 1
        return labels

    # -- integers --------------------------------------------------------------------------------------------------

    def _integers(self, run: Run) -> list[Field]:
        size, order = run.kind.size, run.kind.order
        moving = [at for at in run.offsets if self.varies[at : at + size].any()]
        begin, end = run.offsets[0], run.offsets[-1] + size
        is_word = self.has_words and size == 2 and order == ">"
        if size > 1 and not is_word and len(np.unique(self.rows[:, begin:end], axis=0)) <= FEW_STATES:
            return self._bytes(begin, end)
        columns = {at: integers(self.rows, at, size, order or "<") for at in moving}
        index = [k for k, at in enumerate(run.offsets) if self.varies[at : at + size].any()]
        signs, periods = signs_of([columns[at] for at in moving], index, 8 * size)
        fields = [Field(at, size, sign.kind, order) for at, sign in zip(moving, signs)]
        array = Array(self.links, fields, index, periods)
        for k, (each, sign) in enumerate(zip(fields, signs)):
            each.is_width_open = any(self._may_extend(each, at) for at in self._above(each))
            self._judge(each, sign, columns[each.at], array, k)
        array.foretell(self.rows, list(columns.values()))
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
        return not self.links.of(digits_of(each)[-1], at).is_refuted

    def _judge(self, each: Field, sign: Sign, values: np.ndarray, array: Array, k: int) -> None:
        digits = digits_of(each)
        if not array.has_moved(values):
            each.decide = MORE
        elif not all(array.is_proven(k, low, high) for low, high in itertools.pairwise(digits)):
            each.decide = SLOW if self.varies[digits[-1]] else FULL_SCALE
        elif each.is_width_open:
            each.decide = FULL_SCALE
        elif not all(self._is_closed(each, at, array, k) for at in (each.at - 1, each.end)):
            each.decide = SLOW
        elif each.size > 1 and not np.bitwise_or.reduce(values ^ values[0]) & 0xF:
            each.decide = COARSE
        elif not sign.is_certain:
            each.decide = BOTH_SIGNS
        else:
            each.is_certain = True
            seen = "carries from byte to byte" if each.size > 1 else "no neighbour carries into it"
            each.why = seen + {"i": ", crosses zero", "u": ", crosses its middle"}.get(
                sign.kind, ", its top bit never moved"
            )

    def _is_closed(self, each: Field, at: int, array: Array, k: int) -> bool:
        """Return True if the byte at ``at``, beside the field, is no part of it."""
        if not 0 <= at < self.length or self.closed[at]:
            return True
        if each.size == 1 and self.varies[at] and is_sign_of(self.rows, each.at, at):
            return False
        digits, is_left = digits_of(each), at < each.at
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
        each.is_certain &= not _is_clock(values)
        each.why = "carries from nibble to nibble" if each.is_certain else ""
        each.decide = "" if each.is_certain else SLOW
        return each

    # -- floats ----------------------------------------------------------------------------------------------------

    def _floats(self, run: Run) -> list[Field]:
        size, order = run.kind.size, run.kind.order
        found = [Field(at, size, "f", order) for at in run.offsets if self.varies[at : at + size].any()]
        floats.prove(found, self.rows)
        return found


def _narrowed(run: Run, bytes_off: int) -> Run:
    """Return a run whose fields lack their uppermost bytes."""
    size, order = run.kind.size - bytes_off, run.kind.order
    offsets = tuple(at + (bytes_off if order == ">" else 0) for at in run.offsets)
    return Run(Kind(size, order if size > 1 else ""), offsets, run.margin_bits)


def _carries(values: np.ndarray) -> bool:
    """Return True if each nibble of values of 12 bits carries into the next."""
    return Link(values & 0xFF, values >> 8, 8, 4).is_proven and Link(values & 0xF, values >> 4 & 0xFF, 4, 8).is_proven


def _is_clock(values: np.ndarray) -> bool:
    """Return True if values of 12 bits step regularly: then a nibble below them may be their lowest digit."""
    steps = np.diff(values) % 4096
    usual = np.median(steps)
    return bool(1 < usual < 2048 and (np.abs(steps - usual) <= 1).mean() > CLOCK_SHARE)


def _mirrored(values: np.ndarray) -> np.ndarray:
    """Return values of 12 bits with their lowest nibble as the highest: those of a packing in the other order."""
    return values >> 4 | (values & 0xF) << 8
