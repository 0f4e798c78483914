"""The proof that one part of a message is the upper digits of another: it steps when, and only when, the lower wraps.

Two models foretell the lower part from its last value. In the first it is the low digits of one number, which moves by
little: when the upper part steps, it must wrap. In the second it is a value of its own, with or without sign, which
may leap when the upper part does. Each half of the capture is foretold with the statistics of the other half, and the
difference is counted in bits: many bits prove the link, many bits less than none refute it, and in between it is open.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

PROOF_BITS = 30.0
HALF_BITS = 6.0
"""The least bits of each half of the capture, so that neither rests on one event."""
REFUTED_BITS = -25.0
PAIR_BITS = 20.0
"""The most bits that the steps of the upper part between two of its values say together."""
NEAR = 4
"""The part of its range that the lower part steps at most in a small step, over its ends as well."""
NEAR_BITS = 15.0
"""The least bits of small steps: two values may leap together, as two digits do."""
MAX_NOISE = 16
"""The largest step between -1 and a positive value, where -1 is most of what looks negative."""
CLASSES = 40
LEAST_EVENTS = 4
SMALL = 8


class Steps:
    """The distribution of a step by its size: equal within each power of two."""

    def __init__(self, steps: np.ndarray):
        counts = np.bincount(_class_of(steps), minlength=CLASSES)[:CLASSES] + 0.05
        self._share = counts / counts.sum()
        self._each = self._share / _SPANS
        self._below = np.concatenate([[0.0], np.cumsum(self._share)])

    def bits(self, steps: np.ndarray) -> np.ndarray:
        """Return the bits of each step."""
        return -np.log2(self._each[_class_of(steps)])

    def share_between(self, low: np.ndarray, span: int) -> np.ndarray:
        """Return the probability of a step from ``low`` to ``low + span``, both included."""
        return self._up_to(low + span) - self._up_to(low - 1)

    def _up_to(self, step: np.ndarray) -> np.ndarray:
        """Return the probability of a step that is not larger, less one half."""
        number = _class_of(step)
        beyond = (np.abs(step) - _STARTS[number] + 1) * self._each[number]
        above_zero = (self._below[number] - self._share[0]) / 2 + beyond
        share = np.where(number == 0, 0.0, np.where(step > 0, above_zero, -above_zero + self._each[number]))
        return share + np.where(step >= 0, self._share[0] / 2, -self._share[0] / 2)


_STARTS = np.concatenate([[0.0], 2.0 ** np.arange(CLASSES - 1)])
"""The least size of each class of steps: 0, 1, 2, 4 ..."""
_SPANS = np.concatenate([[1.0], 2.0 ** np.arange(1, CLASSES)])
"""The number of steps of each class, both directions."""


def _class_of(steps: np.ndarray) -> np.ndarray:
    return np.minimum(np.frexp(np.abs(steps).astype(float))[1], CLASSES - 1)


@dataclass(frozen=True)
class Link:
    """The evidence that two parts of a message are digits of one number."""

    low: np.ndarray
    high: np.ndarray
    low_bits: int = 8
    high_bits: int = 8

    @cached_property
    def _halves(self) -> list[tuple[float, float]]:
        """The bits in favour of the link in each half of the capture, and those of small steps alone."""
        full = 1 << self.high_bits
        high_step = (np.diff(self.high) + full // 2) % full - full // 2
        if (high_step != 0).sum() + (np.abs(np.diff(self.low)) > (1 << self.low_bits) // 2).sum() < LEAST_EVENTS:
            return [(0.0, 0.0)] * 2
        middle = len(high_step) // 2
        parts = slice(None, middle), slice(middle, None)
        return [self._foretold(high_step, known, asked) for known, asked in (parts[::-1], parts)]

    def _foretold(self, high_step: np.ndarray, known: slice, asked: slice) -> tuple[float, float]:
        full = 1 << self.low_bits
        before, step = self.low[:-1], np.diff(self.low)
        joined = full * high_step + step
        steps = Steps(joined[known])
        new = self._different(asked)
        offset = full * high_step[new] - before[new]
        possible = np.maximum(steps.share_between(offset, full - 1), 1e-12)
        as_digits = np.minimum(steps.bits(joined[new]) + np.log2(possible), 24.0)
        changed, learnt = high_step != 0, np.zeros(len(high_step), bool)
        learnt[known] = True
        total = near = 0.0
        circular = np.abs((step + full // 2) % full - full // 2)
        for is_part in (changed, ~changed):
            part = new[is_part[new]]
            alone = self._alone(before, step, (learnt, learnt & is_part), part)
            gained = alone - as_digits[is_part[new]]
            total += self._capped(gained, part)
            near += float(gained[circular[part] <= full // NEAR].sum())
        return total, near

    def _capped(self, gained: np.ndarray, events: np.ndarray) -> float:
        """Return the sum of the bits, where one step of the upper part says no more than so much, however often."""
        if not len(events):
            return 0.0
        ends = np.sort([self.high[events], self.high[events + 1]], axis=0)
        _, pair = np.unique(ends[0] << self.high_bits | ends[1], return_inverse=True)
        return float(np.minimum(np.bincount(pair, weights=gained), PAIR_BITS).sum())

    def _different(self, asked: slice) -> np.ndarray:
        """Return the numbers of the steps that were not seen before: one that repeats itself proves nothing again."""
        low, high, bits = self.low, self.high, self.high_bits
        code = ((low[:-1] << bits | high[:-1]) << self.low_bits | low[1:]) << bits | high[1:]
        _, first = np.unique(code[asked], return_index=True)
        return first + (asked.start or 0)

    def _alone(
        self, before: np.ndarray, step: np.ndarray, known: tuple[np.ndarray, ...], asked: np.ndarray
    ) -> np.ndarray:
        """Return the bits of the lower part as a value of its own, the fewest of several models.

        It is unsigned, or signed: turned by half its range. ``known`` are the events that it is learnt from: all, and
        those in which the upper part stepped or stood still as in those asked, since two values may leap together.
        """
        full = 1 << self.low_bits
        models = []
        for turn in (0, full // 2):
            start = (before + turn) % full
            turned = (before + step + turn) % full - start
            for learnt in known:
                steps = Steps(turned[learnt])
                possible = np.maximum(steps.share_between(-np.arange(full), full - 1), 1e-12)[start[asked]]
                models.append(np.minimum(steps.bits(turned[asked]) + np.log2(possible), 24.0))
        return min(models, key=lambda each: each.sum())

    @cached_property
    def bits(self) -> float:
        """The bits in favour of the link."""
        return sum(bits for bits, _ in self._halves)

    @cached_property
    def near_bits(self) -> float:
        """The bits in favour of the link of the small steps of its lower part, over its ends as well."""
        return sum(near for _, near in self._halves)

    @property
    def is_proven(self) -> bool:
        """True if the lower part wraps where the upper one steps, in both halves of the capture, and in small steps."""
        is_near = (self.near_bits >= NEAR_BITS and min(near for _, near in self._halves) > 0) or self.low_bits < 8
        return is_near and self.bits >= PROOF_BITS and min(bits for bits, _ in self._halves) >= HALF_BITS

    @property
    def is_refuted(self) -> bool:
        """True if the upper part steps while the lower stays near, or stands still while the lower wraps."""
        against = max(near for _, near in self._halves)
        return max(self.bits, self.near_bits) <= REFUTED_BITS and against <= 0.0


class Links:
    """The links between the bytes of a group's messages."""

    def __init__(self, rows: np.ndarray):
        self.length = rows.shape[1]
        self._columns = rows.T.astype(np.int64)
        self._found: dict[tuple[int, int], Link] = {}

    def is_small(self, at: int) -> bool:
        """Return True if a byte, read as a signed one, stays near 0: so does the upper byte of a small value."""
        return bool((np.abs((self._columns[at] + 128) % 256 - 128) <= SMALL).all())

    def of(self, low: int, high: int) -> Link:
        """Return the link from the byte at ``low`` to that at ``high``."""
        if (low, high) not in self._found:
            self._found[low, high] = Link(self._columns[low], self._columns[high])
        return self._found[low, high]


@dataclass
class Crossings:
    """Counts of the small steps of unsigned readings over their ends and through their middle, and of their leaps."""

    over: int = 0
    """Steps from one end to the other: the crossing of zero of a signed value."""
    through: int = 0
    """Steps through the middle: a large value of an unsigned one."""
    leaps: int = 0

    def __add__(self, other: Crossings) -> Crossings:
        return Crossings(self.over + other.over, self.through + other.through, self.leaps + other.leaps)

    def __sub__(self, other: Crossings) -> Crossings:
        return Crossings(self.over - other.over, self.through - other.through, self.leaps - other.leaps)


def crossings(values: np.ndarray, bits: int) -> Crossings:
    """Count the crossings of a column of unsigned readings.

    A value that is clipped at its upper end and let go steps from end to end, too: steps between the two ends
    themselves count only where the middle half of the range is never seen and the upper end is not the only high value,
    and where it is most of them only short steps from it do.
    """
    full = 1 << bits
    steps = np.diff(values)
    is_high = values >= full // 2
    crossed = is_high[1:] != is_high[:-1]
    circular = np.abs((steps + full // 2) % full - full // 2)
    is_leap = np.abs(steps) > full // 2
    ends = (values == 0) | (values == full - 1)
    between = ends[1:] & ends[:-1]
    is_middle = (values >= full // 4) & (values < full - full // 4)
    is_small = not is_middle.any() and (is_high & (values < full - 1)).sum() >= 3
    over = crossed & is_leap & (circular <= max(2, full // 16)) & (~between | is_small)
    last = values == full - 1
    if 2 * last.sum() > is_high.sum():  # it is clipped there, if it does not come back in steps of its noise
        over &= ~(last[1:] | last[:-1]) | (circular <= MAX_NOISE)
    turns = (values == full // 2) | (values == full // 2 - 1)  # the ends of a signed value, which may be clipped
    through = crossed & ~is_leap & (circular <= full // 8) & ~(turns[1:] & turns[:-1])
    return Crossings(int(over.sum()), int(through.sum()), int((is_leap & (~between | is_small)).sum()))
