"""Skill: how much better a law predicts recordings that were left out than the simplest guesses do.

``skill = 1 − error of the law / zero skill``, where zero skill is the error of the best of the simplest guesses: the
mean of the given recordings, a straight line through them, the given one of the nearest condition, and what a set's
module adds, such as the recording's own first press. Errors are root mean squares over all predictions. A law is judged
on independent recordings only, and not on fewer than :data:`LEAST_RECORDINGS` of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

LEAST_RECORDINGS = 4
"""Minimum number of independent recordings for an interval of the skill; a law with fewer cannot be judged."""
_DRAWS = 4000
"""Number of draws of recordings from which the interval follows."""


@dataclass(frozen=True)
class Points:
    """The quantities of one recording that a law predicts, in the unit of its aim."""

    x: np.ndarray
    """The conditions of each quantity, shape (n, k); the guesses may use them as the law does."""
    y: np.ndarray
    """The measured quantities, shape (n,)."""
    guesses: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Guesses that the recording itself gives, by name, each of shape (n,)."""


@dataclass(frozen=True)
class Skill:
    """The error of a law beside that of the best simple guess."""

    error: float
    worst: float
    zero: float
    """Zero skill: the error of the best of the simplest guesses."""
    guess: str
    """The name of that guess."""
    count: int
    """The number of independent recordings that were predicted."""
    low: float
    """The 95 % interval of the skill over the recordings; NaN for fewer than :data:`LEAST_RECORDINGS`."""
    high: float

    @property
    def skill(self) -> float:
        """1 for perfect predictions, 0 for those of the best guess, negative for worse ones."""
        return 1.0 - self.error / self.zero if self.zero else float("nan")

    @property
    def interval(self) -> str:
        """The skill with its interval, if there is one: ``0.39 (0.18 to 0.66)``."""
        return f"{self.skill:.2f}" + (f" ({self.low:.2f} to {self.high:.2f})" if self.count >= LEAST_RECORDINGS else "")

    @property
    def verdict(self) -> str:
        """The words for whether the recordings show skill."""
        if self.count < LEAST_RECORDINGS:
            return "cannot be judged here"
        return "has skill" if self.low > 0 else "no skill shown"

    def __str__(self) -> str:
        return f"{self.interval}, {self.count} recording{'s' * (self.count != 1)}: {self.verdict}"


def guesses(given: Sequence[Points], held: Points) -> dict[str, np.ndarray]:
    """Return the predictions of the simplest guesses for a recording that was left out, by their names."""
    x, y = np.concatenate([each.x for each in given]), np.concatenate([each.y for each in given])
    found = {"mean of the given": np.full(len(held.y), y.mean())}
    if x.shape[1]:
        found["straight line"] = columns(held.x) @ straight_line(x, y)
        scale = np.where((spread := x.std(axis=0)) > 0, spread, 1.0)
        apart = ((held.x[:, None, :] - x) / scale) ** 2
        found["nearest of the given"] = y[apart.sum(axis=-1).argmin(axis=1)]
    return found | dict(held.guesses)


def straight_line(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the offset and the slopes of a least-squares line, shape (1 + k,)."""
    return np.linalg.lstsq(columns(x), y, rcond=None)[0]


def columns(x: np.ndarray) -> np.ndarray:
    """Return the columns of a straight line: ones, then the conditions."""
    return np.column_stack([np.ones(len(x)), x])


def skill_of(errors: Sequence[np.ndarray], guessed: Sequence[Mapping[str, np.ndarray]]) -> Skill:
    """Return the skill of a law.

    Args:
        errors: the law's errors on each independent recording.
        guessed: the errors of each guess on each of them, in the same order; guesses that not all recordings have are
            left out.
    """
    sizes = np.array([len(each) for each in errors], float)
    own = _squares(errors)
    names = [name for name in guessed[0] if all(name in each for each in guessed)]
    others = {name: _squares([each[name] for each in guessed]) for name in names}
    guess = min(names, key=lambda name: float(others[name].sum()))
    root = lambda squares: float(np.sqrt(squares.sum() / sizes.sum()))  # noqa: E731
    low = high = float("nan")
    if len(errors) >= LEAST_RECORDINGS:
        drawn = np.random.default_rng(0).integers(len(errors), size=(_DRAWS, len(errors)))
        ratio = np.sqrt(own[drawn].sum(axis=1) / np.maximum(others[guess][drawn].sum(axis=1), 1e-300))
        low, high = (float(each) for each in np.percentile(1.0 - ratio, (2.5, 97.5)))
    worst = float(max(np.abs(each).max() for each in errors))
    return Skill(root(own), worst, root(others[guess]), guess, len(errors), low, high)


def _squares(errors: Sequence[np.ndarray]) -> np.ndarray:
    return np.array([float(np.sum(np.square(each))) for each in errors])
