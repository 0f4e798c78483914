"""Numbers with their 95 % intervals, and what a recording cannot tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tactemu.fit.solver import least_squares

SURE = 1.96
"""Standard errors of a 95 % interval."""


@dataclass(frozen=True)
class Estimate:
    """One parameter."""

    name: str
    value: float
    error: float
    """Standard error; 0: exact."""
    unit: str = ""
    about: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 %."""
        return self.value - SURE * self.error, self.value + SURE * self.error

    def holds(self, value: float) -> bool:
        """Is a value inside the interval?"""
        low, high = self.interval
        return low <= value <= high

    def __str__(self) -> str:
        low, high = self.interval
        span = f" ({low:.4g} ... {high:.4g})" if self.error else ""
        return f"{self.name} = {self.value:.4g}{span} {self.unit}".rstrip()


@dataclass
class Findings:
    """All that was found of one recording."""

    estimates: dict[str, Estimate] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    """What cannot be told, and what to record to tell it."""
    notes: list[str] = field(default_factory=list)

    def add(self, name: str, value: float, error: float, unit: str = "", about: str = "") -> None:
        """Add an estimate; one that is not finite cannot be told."""
        if np.isfinite([value, error]).all():
            self.estimates[name] = Estimate(name, float(value), float(error), unit, about)
        else:
            self.unknown.append(f"{name}: the recording does not determine it")

    def value(self, name: str, otherwise: float = 0.0) -> float:
        """Return a parameter's value."""
        return self.estimates[name].value if name in self.estimates else otherwise

    def told(self, name: str) -> bool:
        """Is a parameter known to differ from 0?"""
        return name in self.estimates and not self.estimates[name].holds(0.0)


def inflation(residuals: np.ndarray) -> float:
    """How many times larger standard errors are because residuals follow one another, from their correlations."""
    x = residuals - residuals.mean()
    power = float(x @ x)
    if not power or len(x) < 50:
        return 1.0
    size = 1 << (2 * len(x) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(x, size)) ** 2
    correlation = np.fft.irfft(spectrum, size)[1 : min(len(x) // 4, 2000)] / power
    small = np.flatnonzero(correlation < 1.0 / np.sqrt(len(x)))
    until = int(small[0]) if len(small) else len(correlation)
    return float(np.sqrt(max(1.0, 1.0 + 2.0 * correlation[:until].sum())))


def linear(bases: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least squares of ``y`` (n,) on ``bases`` (n, k): coefficients, their covariance, residuals.

    Outliers beyond six standard deviations are left out; errors are larger where residuals follow one another.
    """
    keep = np.ones(len(y), bool)
    found, apart = np.zeros(bases.shape[1]), y
    for _ in range(3):
        found = np.linalg.lstsq(bases[keep], y[keep], rcond=None)[0]
        apart = y - bases @ found
        spread = 1.4826 * np.median(np.abs(apart[keep] - np.median(apart[keep]))) or apart[keep].std()
        near = np.abs(apart) <= 6.0 * spread
        keep = near if near.sum() > 0.5 * len(y) else np.ones(len(y), bool)  # else what is usual is no noise
    inside = apart[keep]
    variance = inside @ inside / max(1, len(inside) - bases.shape[1]) * inflation(inside) ** 2
    return found, variance * np.linalg.pinv(bases[keep].T @ bases[keep]), apart


def ratio(a: float, b: float, covariance: np.ndarray) -> tuple[float, float]:
    """``a/b`` and its standard error, from the covariance of the two."""
    value = a / b
    gradient = np.array([1.0 / b, -value / b])
    return value, float(np.sqrt(max(0.0, gradient @ covariance @ gradient)))


def nonlinear(
    residuals: Callable[[np.ndarray], np.ndarray],
    begin: Sequence[float] | np.ndarray,
    bounds: tuple[Sequence, Sequence],
) -> tuple[np.ndarray, np.ndarray]:
    """Return parameters that make residuals small, and their standard errors."""
    found = least_squares(residuals, begin, bounds=bounds, x_scale="jac")
    apart = found.fun
    variance = apart @ apart / max(1, len(apart) - len(found.x)) * inflation(apart) ** 2
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    return found.x, np.sqrt(np.maximum(np.diag(covariance), 0.0))
