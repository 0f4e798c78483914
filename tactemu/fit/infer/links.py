"""The proof that one part of a message is the upper digits of another: it steps when, and only when, the lower wraps.

Two models foretell the lower part from its last value. In the first it is the low digits of one number, which moves by
little: when the upper part steps, it must wrap. In the second it is a value of its own, with or without sign. Each
half of the capture is foretold with the statistics of the other half, and the difference is counted in bits: many bits
prove the link, many bits less than none refute it, and in between it is open.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

PROOF_BITS = 30.0
HALF_BITS = 6.0
"""The least bits of each half of the capture, so that neither rests on one event."""
REFUTED_BITS = -25.0
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
    def _halves(self) -> tuple[float, float]:
        """The bits in favour of the link in each half of the capture, foretold from the other half."""
        full = 1 << self.high_bits
        high_step = (np.diff(self.high) + full // 2) % full - full // 2
        if (high_step != 0).sum() + self._leaps().sum() < LEAST_EVENTS:
            return 0.0, 0.0
        middle = len(high_step) // 2
        parts = slice(None, middle), slice(middle, None)
        first, second = (self._foretold(high_step, known, asked) for known, asked in (parts[::-1], parts))
        return first, second

    def _leaps(self) -> np.ndarray:
        return np.abs(np.diff(self.low)) > (1 << self.low_bits) // 2

    def _foretold(self, high_step: np.ndarray, known: slice, asked: slice) -> float:
        full = 1 << self.low_bits
        before, step = self.low[:-1], np.diff(self.low)
        joined = full * high_step + step
        steps = Steps(joined[known])
        new = self._different(asked)
        offset = full * high_step[new] - before[new]
        possible = np.maximum(steps.share_between(offset, full - 1), 1e-12)
        as_digits = np.minimum(steps.bits(joined[new]) + np.log2(possible), 24.0)
        alone = min(self._alone(before, step, known, new, turn).sum() for turn in (0, full // 2))
        return float(alone - as_digits.sum())

    def _different(self, asked: slice) -> np.ndarray:
        """Return the numbers of the steps that were not seen before: one that repeats itself proves nothing again."""
        low, high, bits = self.low, self.high, self.high_bits
        code = ((low[:-1] << bits | high[:-1]) << self.low_bits | low[1:]) << bits | high[1:]
        _, first = np.unique(code[asked], return_index=True)
        return first + (asked.start or 0)

    def _alone(self, before: np.ndarray, step: np.ndarray, known: slice, asked: np.ndarray, turn: int) -> np.ndarray:
        """Return the bits of the lower part as a value of its own, unsigned, or signed if turned by half its range."""
        full = 1 << self.low_bits
        start = (before + turn) % full
        turned = (before + step + turn) % full - start
        steps = Steps(turned[known])
        possible = np.maximum(steps.share_between(-np.arange(full), full - 1), 1e-12)[start[asked]]
        return np.minimum(steps.bits(turned[asked]) + np.log2(possible), 24.0)

    @cached_property
    def bits(self) -> float:
        """The bits in favour of the link."""
        return sum(self._halves)

    @property
    def is_proven(self) -> bool:
        """True if the lower part wraps where the upper one steps, in both halves of the capture."""
        return self.bits >= PROOF_BITS and min(self._halves) >= HALF_BITS

    @property
    def is_refuted(self) -> bool:
        """True if the upper part steps while the lower stays near, or stands still while the lower wraps."""
        return self.bits <= REFUTED_BITS and max(self._halves) <= 0.0


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
    themselves count only where the middle half of the range is never seen and the upper end is not the only high value.
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
    turns = (values == full // 2) | (values == full // 2 - 1)  # the ends of a signed value, which may be clipped
    through = crossed & ~is_leap & (circular <= full // 8) & ~(turns[1:] & turns[:-1])
    return Crossings(int(over.sum()), int(through.sum()), int((is_leap & (~between | is_small)).sum()))
