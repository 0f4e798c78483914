"""The smoothness of bytes under every reading of them: the number of bits that tell how a value changes.

Neighbouring samples of a real value are alike, so the right width, byte order and sign need the fewest bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactemu.fit.infer.fields import signed


@dataclass(frozen=True)
class Part:
    """One value inside the bytes of a reading."""

    bits: int
    shift: int = 0


@dataclass(frozen=True)
class Kind:
    """A reading of some bytes: one number, or packed ones."""

    size: int
    order: str = ""
    is_float: bool = False
    parts: tuple[Part, ...] = ()
    """The values inside; none: one value of all bits."""

    @property
    def values(self) -> tuple[Part, ...]:
        """The values inside, in the order of their bytes."""
        return self.parts or (Part(8 * self.size),)


BYTE = 0
KINDS = (
    Kind(1),
    *(Kind(size, order) for size in (2, 3, 4) for order in "<>"),
    *(Kind(size, order, is_float=True) for size in (4, 8) for order in "<>"),
    Kind(3, "<", parts=(Part(12), Part(12, 12))),
    Kind(3, ">", parts=(Part(12, 12), Part(12))),
    Kind(2, "<", parts=(Part(4), Part(12, 4))),
    Kind(2, ">", parts=(Part(4, 12), Part(12))),
    Kind(2, "<", parts=(Part(12), Part(4, 12))),
    Kind(2, ">", parts=(Part(12, 4), Part(4))),
)
"""Every reading, that of a single byte first."""
MAX_CELLS = 600_000
"""The largest number of bytes that are priced: more samples decide nothing."""
LEAST_ROWS = 200
MAX_STILL_BITS = 6
QUANTUM_ERROR, QUANTUM_SHARE = 0.1, 0.9
"""The largest distance to a multiple of the least step, and the least share of such steps, of a float that was made
of an integer."""
LEAST_MOVING_OF_8 = 5
"""The fewest bytes that move of a float of eight bytes: most of its digits are noise."""
FLOAT_RANGE = (1e-9, 1e9)
"""The sizes of a float that a sensor sends, but for 0."""


def sample(rows: np.ndarray) -> np.ndarray:
    """Return neighbouring messages in a number that can be priced."""
    n = max(LEAST_ROWS, MAX_CELLS // max(rows.shape[1], 1))
    if len(rows) <= n:
        return rows
    start = (len(rows) - n) // 2
    return rows[start : start + n]


def prices(rows: np.ndarray, nibbles: Sequence[int] = ()) -> list[np.ndarray]:
    """Return for each of :data:`KINDS` the bits at each offset; infinite where it cannot be.

    ``nibbles`` are the bytes of which a nibble is a selector: no value has all of their bits.
    """
    varies = (rows != rows[0]).any(axis=0)
    found = []
    for kind in KINDS:
        offsets = rows.shape[1] - kind.size + 1
        price = np.full(max(offsets, 0), np.inf)
        if offsets > 0:
            price[:] = _floats(rows, kind) if kind.is_float else _integers(rows, kind, nibbles)
            still = ~np.lib.stride_tricks.sliding_window_view(varies, kind.size).any(axis=1)
            if not kind.is_float:
                price[still] = 0.0
            for at in nibbles:
                if 4 not in {part.bits for part in kind.parts}:
                    price[max(0, at - kind.size + 1) : at + 1] = np.inf
        found.append(price)
    return found


def _byte_of(kind: Kind, part: Part) -> int:
    """Return the offset of a nibble's byte inside a reading."""
    byte = part.shift // 8
    return byte if kind.order == "<" else kind.size - 1 - byte


def _integers(rows: np.ndarray, kind: Kind, nibbles: Sequence[int]) -> np.ndarray:
    offsets = rows.shape[1] - kind.size + 1
    values = np.zeros((len(rows), offsets), np.int64)
    for k in range(kind.size):
        shift = 8 * (k if kind.order == "<" else kind.size - 1 - k)
        values |= rows[:, k : k + offsets].astype(np.int64) << shift
    if not kind.parts:
        zeros = _still_bits(values)
        return np.minimum(bits_of(values >> zeros), bits_of(signed(values, 8 * kind.size) >> zeros))
    total = np.zeros(offsets)
    for part in kind.parts:
        inside = values >> part.shift & (1 << part.bits) - 1
        if part.bits == 4:  # a nibble that never moves is a part of the value
            still = (inside == inside[0]).all(axis=0)
            total[still & ~np.isin(np.arange(offsets) + _byte_of(kind, part), nibbles)] = np.inf
        total += np.minimum(bits_of(inside), bits_of(signed(inside, part.bits)))
    return total


def _still_bits(values: np.ndarray) -> np.ndarray:
    """Return how many of the lowest bits of each column never move: a value may have a coarser unit than one."""
    moved = np.bitwise_or.reduce(values ^ values[0], axis=0)
    zeros = np.where(moved > 0, np.frexp((moved & -moved).astype(float))[1] - 1, 0)
    return np.where(zeros <= MAX_STILL_BITS, zeros, 0)  # a whole byte that never moves is no part of the value


def bits_of(values: np.ndarray) -> np.ndarray:
    """Return the bits that tell how each column of numbers changes: the classes of size, and the digits within."""
    sizes = np.frexp(np.abs(np.diff(values, axis=0)).astype(float))[1]
    n, columns = sizes.shape
    classes = 66
    counts = np.bincount((sizes + classes * np.arange(columns)).ravel(), minlength=classes * columns)
    shares = counts.reshape(columns, classes) / max(n, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        entropy = -np.nansum(np.where(shares > 0, shares * np.log2(shares), 0), axis=1)
    return n * entropy + sizes.sum(axis=0)


def _floats(rows: np.ndarray, kind: Kind) -> np.ndarray:
    offsets = rows.shape[1] - kind.size + 1
    windows = np.lib.stride_tricks.sliding_window_view(rows, kind.size, axis=1)
    price = np.full(offsets, np.inf)
    top = rows[:, kind.size - 1 :] if kind.order == "<" else rows[:, :offsets]
    few = top[:: max(1, len(top) // 20)]  # the top byte of a float of a sensor is 0, or near 3F or BF
    likely = ((few == 0) | ((few & 0x7F) > 0x2F) & ((few & 0x7F) < 0x4F) | (few == 0x80)).all(axis=0)
    for at in np.nonzero(likely)[0]:
        with np.errstate(all="ignore"):
            values = np.ascontiguousarray(windows[:, at]).view(f"{kind.order}f{kind.size}").ravel().astype(float)
        moving = _moving_bytes(windows[:, at])
        if is_plausible(values) and (moving >= (2 if kind.size == 4 else LEAST_MOVING_OF_8) or not moving):
            price[at] = _float_bits(values, kind.size)
    return price


def _moving_bytes(rows: np.ndarray) -> int:
    return int((rows != rows[0]).any(axis=0).sum())


def is_plausible(values: np.ndarray) -> bool:
    """Return True if all of these may be numbers of a sensor."""
    with np.errstate(all="ignore"):
        sizes = np.abs(values)
        low, high = FLOAT_RANGE
        return bool(np.isfinite(values).all() and ((sizes == 0) | ((sizes > low) & (sizes < high))).all())


def _float_bits(values: np.ndarray, size: int) -> float:
    """Return the bits of a float's changes: in units of its last digit, or of its least step if all are multiples."""
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0]
    if not len(moved):
        return 0.0
    unit = max(np.abs(values).max() * 2.0 ** (-23 if size == 4 else -52), 1e-30)
    least = moved.min()
    if size == 4:
        is_quantized = (np.abs(steps / least - np.rint(steps / least)) < QUANTUM_ERROR).mean() >= QUANTUM_SHARE
        unit = max(unit, least if is_quantized else least / 8)
    return float(bits_of(np.rint(values / unit)[:, None])[0]) - 4.0
