"""The aims of a set's laws, its constants, and how its recordings are left out."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Recordings = Mapping[str, Any]
"""The recordings of a set by name; their type is that of the set's module."""
Fold = tuple[Sequence[str], Sequence[str]]
"""Names of the recordings that a law is fitted on, and of those that it then predicts."""
LEAST_HALVED = 6
"""Minimum number of independent recordings of which a law is judged on half; of fewer, each is left out in turn."""


@dataclass(frozen=True)
class Aim:
    """A law, and the largest error that its predictions may have; it must be less than that of the simplest guess."""

    key: str
    law: str
    """The description of the law, with the parts of a predicted recording that it takes."""
    most: float
    unit: str
    each: str = ""
    """The condition of which every value is left out in turn and counts as one recording; the set's module has a
    ``value_of(condition, name)``. Without it :func:`folds` leaves out recordings."""


@dataclass(frozen=True)
class Constant:
    """A quantity that recordings give as one number each; it predicts no more than their mean."""

    key: str
    name: str
    unit: str = ""


def folds(names: Sequence[str], unit: Callable[[str], str] = str, *, one_by_one: bool = False) -> list[Fold]:
    """Return how recordings are left out: with six independent ones or more, half of them; else each in turn.

    Args:
        names: the names of the recordings.
        unit: returns what recordings share that are not independent, by their name.
        one_by_one: leave each out in turn, however many there are.
    """
    units = list(dict.fromkeys(unit(name) for name in names))
    is_halved = len(units) >= LEAST_HALVED and not one_by_one
    out = [halves(units)[1]] if is_halved else [[each] for each in units] if len(units) > 1 else []
    return [
        ([name for name in names if unit(name) not in held], [name for name in names if unit(name) in held])
        for held in out
    ]


def halves(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return two halves of the names: a law is chosen and fitted on the first, and judged once on the second.

    The half of a name follows from its SHA-256 alone, so it is not a choice: the names are sorted by it, and the
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
