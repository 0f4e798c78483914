"""The analogue-to-digital converter, from SI units to counts, and the filter before it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def quantize(
    values: ArrayLike,
    counts_per_unit: float | np.ndarray = 1.0,
    low: float | np.ndarray = 0,
    high: float | np.ndarray = 0xFFFF,
    rest: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Return ``rest + values * counts_per_unit``, rounded to nearest and saturated to ``low..high``.

    ``values`` may have any shape; ``counts_per_unit``, the limits and ``rest`` (the reading of zero) broadcast against
    it. The counts are int64, so that they do not wrap.
    """
    counts = np.rint(np.asarray(values, float) * counts_per_unit + rest)
    return np.minimum(np.maximum(counts, low), high).astype(np.int64)


def int16(values: ArrayLike, order: str = ">") -> bytes:
    """Pack values as signed 16 bit, rounded and saturated; ``order`` is ``">"`` (high byte first) or ``"<"``."""
    return np.asarray(quantize(values, 1.0, -0x8000, 0x7FFF), f"{order}i2").tobytes()


def pack_12_bits(values: np.ndarray) -> bytes:
    """Pack integers 0..4095 as a stream of 12 bits each, low bits first: two in three bytes, an odd last one in two."""
    pairs = np.append(values, np.zeros(len(values) % 2, np.int64))
    even, odd = pairs[0::2], pairs[1::2]
    packed = np.stack([even & 0xFF, even >> 8 | (odd & 0x0F) << 4, odd >> 4], axis=-1)
    return packed.astype(np.uint8).tobytes()[: (12 * len(values) + 7) // 8]


class LowPass:
    """A first-order low-pass, exact for steps of any length.

    The first value passes as it is. ``cutoff_hz`` may be changed at any time; ``None`` passes everything.
    """

    def __init__(self, cutoff_hz: float | None = None):
        self.cutoff_hz = cutoff_hz
        self.value: np.ndarray | None = None
        """The latest output, of the shape of the input."""
        self._t_ns = 0

    def __call__(self, values: ArrayLike, t_ns: int) -> np.ndarray:
        """Return the output at ``t_ns`` for an input that has been ``values`` since the previous call."""
        values = np.asarray(values, float)
        out = values
        if self.value is not None and self.cutoff_hz is not None:
            passed = -np.expm1(-2 * np.pi * self.cutoff_hz * (t_ns - self._t_ns) * 1e-9)
            out = self.value + (values - self.value) * passed
        self.value, self._t_ns = out, t_ns
        return out
