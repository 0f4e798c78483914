"""The aims of the laws: the errors that their predictions may have."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

Recordings = Mapping[str, Any]
"""The recordings of a set by name; their type is that of the set's module."""
Fold = tuple[Sequence[str], Sequence[str]]
"""Names of the recordings that a law is fitted on, and of those that it then predicts."""


@dataclass(frozen=True)
class Aim:
    """A figure of the table: an error of predictions, and its maximum."""

    key: str
    law: str
    """The description of the law, with the parameters that it takes from the predicted recording."""
    most: float
    unit: str
    by: Literal["rms", "mean", "worst"] = "rms"

    def summed(self, errors: np.ndarray) -> float:
        """Return the sum of many errors as one number, by the aim's rule."""
        errors = np.abs(np.asarray(errors, float).ravel())
        return float(_SUMS[self.by](errors)) if len(errors) else float("nan")


_SUMS: dict[str, Callable[[np.ndarray], float]] = {
    "rms": lambda errors: float(np.sqrt(np.mean(errors**2))),
    "mean": lambda errors: float(np.mean(errors)),
    "worst": lambda errors: float(np.max(errors)),
}


def each_left_out(names: Sequence[str]) -> list[Fold]:
    """Return the folds in which each recording is left out in turn."""
    return [([other for other in names if other != name], [name]) for name in names]


def halves(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return two halves of the names: a law is chosen and fitted on the first, and judged once on the second.

    The half of a name follows from its SHA-256 alone, so nobody has chosen it: the names are sorted by it, and the
    first half (the larger one) is given.
    """
    order = sorted(dict.fromkeys(names), key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    k = (len(order) + 1) // 2
    return order[:k], order[k:]


def table_of(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file, gzipped or not, by their names."""
    opened = gzip.open(path, "rt") if path.suffix == ".gz" else path.open(encoding="utf-8")
    with opened as file:
        names = file.readline().strip().split(",")
        values = np.loadtxt(file, delimiter=",", ndmin=2)
    return dict(zip(names, values.T))


def stem(path: Path) -> str:
    """Return a file's name without its suffixes."""
    return path.name.split(".")[0]
