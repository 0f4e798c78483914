"""Estimates with 95 % intervals, and the least squares that find them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError

Z_95 = 1.96
"""Half width of a 95 % interval in standard errors."""


@dataclass(frozen=True)
class Estimate:
    """An estimated parameter."""

    name: str
    value: float
    error: float
    """The standard error; 0 for an exact value."""
    unit: str = ""
    about: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """The limits of the 95 % interval."""
        return self.value - Z_95 * self.error, self.value + Z_95 * self.error

    def contains(self, value: float) -> bool:
        """Return True if a value lies inside the 95 % interval."""
        low, high = self.interval
        return low <= value <= high

    def __str__(self) -> str:
        low, high = self.interval
        span = f" ({low:.4g} ... {high:.4g})" if self.error else ""
        return f"{self.name} = {self.value:.4g}{span} {self.unit}".rstrip()


@dataclass
class Findings:
    """The estimates and notes of one recording."""

    estimates: dict[str, Estimate] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    """The parameters that the recording does not determine, each with what to record to determine it."""
    notes: list[str] = field(default_factory=list)
    """Irregularities of the recording, and what was done about them."""

    def add(self, name: str, value: float, error: float, unit: str = "", about: str = "") -> None:
        """Add an estimate; one that is not finite is listed as unknown."""
        if np.isfinite([value, error]).all():
            self.estimates[name] = Estimate(name, float(value), float(error), unit, about)
        else:
            self.unknown.append(f"{name}: the recording does not determine it")

    def value(self, name: str, otherwise: float = 0.0) -> float:
        """Return a parameter's value, or ``otherwise`` if it was not estimated."""
        return self.estimates[name].value if name in self.estimates else otherwise

    def is_nonzero(self, name: str) -> bool:
        """Return True if a parameter was estimated and differs from 0 with 95 % confidence."""
        return name in self.estimates and not self.estimates[name].contains(0.0)


def least_squares(residuals: Any, begin: Any, **options: Any) -> Any:
    """Call ``scipy.optimize.least_squares``; scipy is imported here, when something is fitted.

    Raises:
        TactemuError: scipy is not installed.
    """
    try:
        from scipy import optimize
    except ImportError:
        raise TactemuError("fitting needs scipy: pip install 'tactemu[fit]'") from None
    return optimize.least_squares(residuals, np.asarray(begin, float), **options)


def inflation(residuals: np.ndarray) -> float:
    """Return the factor on standard errors that accounts for correlated residuals."""
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
    """Fit ``y`` (n,) by ``bases`` (n, k), and return coefficients, their covariance, and the residuals.

    Outliers beyond six standard deviations are left out; correlated residuals enlarge the covariance.
    """
    keep = np.ones(len(y), bool)
    found, apart = np.zeros(bases.shape[1]), y
    for _ in range(3):
        found = np.linalg.lstsq(bases[keep], y[keep], rcond=None)[0]
        apart = y - bases @ found
        spread = 1.4826 * np.median(np.abs(apart[keep] - np.median(apart[keep]))) or apart[keep].std()
        near = np.abs(apart) <= 6.0 * spread
        # if most rows are far, the spread is no measure of noise: keep all
        keep = near if near.sum() > 0.5 * len(y) else np.ones(len(y), bool)
    inside = apart[keep]
    variance = inside @ inside / max(1, len(inside) - bases.shape[1]) * inflation(inside) ** 2
    return found, variance * np.linalg.pinv(bases[keep].T @ bases[keep]), apart


def ratio(a: float, b: float, covariance: np.ndarray) -> tuple[float, float]:
    """Return ``a/b`` and its standard error, from the covariance of the two."""
    value = a / b
    gradient = np.array([1.0 / b, -value / b])
    return value, float(np.sqrt(max(0.0, gradient @ covariance @ gradient)))


def nonlinear(
    residuals: Callable[[np.ndarray], np.ndarray],
    begin: Sequence[float] | np.ndarray,
    bounds: tuple[Sequence, Sequence],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters with the least squares of the residuals, and their standard errors."""
    found = least_squares(residuals, begin, bounds=bounds, x_scale="jac")
    apart = found.fun
    variance = apart @ apart / max(1, len(apart) - len(found.x)) * inflation(apart) ** 2
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    return found.x, np.sqrt(np.maximum(np.diag(covariance), 0.0))
