"""The equations of transducers and materials as functions of arrays, so that a fit can find their parameters.

They use SI units, or the unit of the sensor's counts where a law is a ratio, have no state and no randomness, and need
only numpy. The stages of this package compute the same on the device; a test compares the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MU0_OVER_4PI = 1e-7
"""The magnetic constant over 4 pi [T m/A]."""


@dataclass(frozen=True)
class LogMemory:
    """A memory that fills by the same share in each decade of time, as a sum of exponentials.

    A step that has lasted for ``t`` is remembered by ``Σ w_k (1 − exp(−t/τ_k))``, which follows
    ``at_first + log10(t/first)`` between ``first`` and ``last`` [s].
    """

    taus: np.ndarray
    weights: np.ndarray
    at_first: float
    """The memory of a step after ``first`` [decades]."""
    error: float
    """Largest deviation from the logarithm between ``first`` and ``last`` [decades]."""

    @classmethod
    def over(cls, first: float, last: float, terms_per_decade: int = 1) -> LogMemory:
        """Return a memory that follows the logarithm from ``first`` to ``last`` [s].

        It is constant outside this range, so that it is bounded.
        """
        decades = np.log10(last / first) + 1
        taus = 10.0 ** np.linspace(np.log10(first) - 0.5, np.log10(last) + 0.5, round(decades * terms_per_decade) + 1)
        times = np.geomspace(first, last, 40 * len(taus))
        terms = -np.expm1(-times[:, None] / taus)
        aim = np.log10(times / first)
        found = np.linalg.lstsq(np.column_stack([terms, -np.ones(len(times))]), aim, rcond=None)[0]
        error = float(np.abs(terms @ found[:-1] - found[-1] - aim).max())
        return cls(taus, found[:-1], float(found[-1]), error)

    def grown(self, t: np.ndarray) -> np.ndarray:
        """Return the memory of a step after ``t`` [s], in decades; it is 0 at ``t = 0``."""
        t = np.asarray(t, float)
        return (self.weights * -np.expm1(-t[..., None] / self.taus)).sum(axis=-1)


def divider(
    load: np.ndarray, full: float | np.ndarray, half: float | np.ndarray, exponent: float | np.ndarray
) -> np.ndarray:
    """Return the output of a divider with a piezoresistor ``R ∝ load^-n`` below a fixed resistor::

        V = full u / (1 + u),   u = (load / half)^n

    ``half`` is the load at which the output is half of ``full``, where the resistances are equal.
    """
    with np.errstate(divide="ignore"):
        return full / (1.0 + (np.asarray(half) / np.maximum(np.asarray(load, float), 0.0)) ** exponent)


def conditioning(presses: np.ndarray, most: float = 1000.0) -> np.ndarray:
    """Return how far a material is worked in after ``presses`` presses: ``ln(1 + n)``, at most that of ``most``."""
    return np.log1p(np.clip(presses, 0.0, most))


def curve(depth: np.ndarray, depths: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Return the force at ``depth`` on a monotone, smooth loading curve (piecewise cubic, Fritsch and Carlson).

    The curve passes through the points ``(depths, forces)``; it is constant before the first depth and straight past
    the last.
    """
    depths, forces = np.asarray(depths, float), np.asarray(forces, float)
    slopes = _slopes(depths, forces)
    depth = np.asarray(depth, float)
    k = np.clip(np.searchsorted(depths, depth) - 1, 0, len(depths) - 2)
    h = depths[k + 1] - depths[k]
    s = (depth - depths[k]) / h
    inside = (
        forces[k] * (1 + 2 * s) * (1 - s) ** 2
        + slopes[k] * h * s * (1 - s) ** 2
        + forces[k + 1] * s**2 * (3 - 2 * s)
        + slopes[k + 1] * h * s**2 * (s - 1)
    )
    beyond = forces[-1] + slopes[-1] * (depth - depths[-1])
    return np.where(depth <= depths[0], forces[0], np.where(depth >= depths[-1], beyond, inside))


def _slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return slopes at the points that keep the cubic monotone: the harmonic means of the chords' slopes."""
    chords = np.diff(y) / np.diff(x)
    left, right = chords[:-1], chords[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = np.where(left * right > 0, 2 * left * right / (left + right), 0.0)
    return np.concatenate([chords[:1], middle, chords[-1:]])


def sliding_noise(white: np.ndarray, amplitude: np.ndarray, line_hz: np.ndarray, period_s: float) -> np.ndarray:
    """Return the sample-to-sample noise (std of difference / √2) of white noise on a sampled sine of ``line_hz``."""
    return np.sqrt(np.square(white) + np.square(amplitude * np.sin(np.pi * np.asarray(line_hz) * period_s)))
