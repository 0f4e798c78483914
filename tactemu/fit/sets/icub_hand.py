"""iCub hand: sixty capacitive taxels of one byte, 255 less the load, grasping objects.

A recording is a :class:`Grasp`. The law is a baseline pattern and a dead band, both equal for all grasps. The hand, not
the sensor, decides how hard an object is held: the median of the smallest values is the object's own if it was fitted,
else that of all objects together.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.fit.sets.aims import Aim, Fold, Recordings

AIMS = (
    Aim("mean", "mean of the first row, a third of the trials held out", 1.0, "counts"),
    Aim("spread", "spread over taxels of the first row, a third of the trials held out", 0.5, "counts"),
    Aim("unchanged", "share of readings that repeat, a third of the trials held out", 5.0, "points"),
    Aim("smallest", "median of smallest values by object, a third of its trials held out", 10.0, "counts"),
    Aim("smallest unseen", "median of smallest values of objects never seen, half of them", 10.0, "counts"),
)


@dataclass(frozen=True)
class Grasp:
    """The counts of one grasp."""

    thing: str
    first: np.ndarray
    """The first row, before contact, shape (60,)."""
    smallest: float
    unchanged: float
    """The share of readings that repeat those of the row before."""


def read(folder: Path) -> Recordings:
    """Return all grasps, by ``object_trial``."""
    found = {}
    for path in sorted(folder.glob("*.npz")):
        archive = np.load(path)
        taxels, ends = archive["taxels"].reshape(len(archive["taxels"]), 60), np.cumsum(archive["length"])
        for name, rows in zip(archive["name"], np.split(taxels.astype(float), ends[:-1])):
            thing = str(name).rpartition("_")[0]
            found[str(name)] = Grasp(thing, rows[0], rows.min(), float(np.mean(np.diff(rows, axis=0) == 0)))
    return found


def fit(recordings: Recordings) -> dict[str, Any]:
    """Return the baseline, its spread from trial to trial, the share of repeats, and the median of smallest values."""
    every = list(recordings.values())
    first = np.array([each.first for each in every])
    return {
        "rest": [round(float(each), 2) for each in first.mean(axis=0)],
        "rest_std_over_trials": float(first.std(axis=0).mean()),
        "unchanged": float(np.mean([each.unchanged for each in every])),
        "smallest": float(np.median([each.smallest for each in every])),
        "smallest_by_object": {
            thing: float(np.median([each.smallest for each in every if each.thing == thing]))
            for thing in sorted({each.thing for each in every})
        },
    }


def errors(parameters: dict[str, Any], recordings: Recordings, known: Recordings | None = None) -> dict[str, Any]:
    """Return the errors of all given grasps together [counts, points]."""
    other, rest = fit(recordings), np.array(parameters["rest"])
    own, seen = other["smallest_by_object"], parameters["smallest_by_object"]
    found = {
        "mean": [rest.mean() - np.mean(other["rest"])],
        "spread": [rest.std() - np.std(other["rest"])],
        "unchanged": [100 * (parameters["unchanged"] - other["unchanged"])],
        "smallest": [seen[thing] - own[thing] for thing in own if thing in seen],
    }
    if not found["smallest"]:
        found = {"smallest unseen": [parameters["smallest"] - other["smallest"]]}
    return {key: np.array(values) for key, values in found.items()}


def folds(recordings: Recordings) -> list[Fold]:
    """Return the folds that leave out every third trial of all objects, three times; then half of the objects, ten
    times."""
    names = list(recordings)
    found: list[Fold] = []
    for k in range(3):
        out = names[k::3]
        found.append(([name for name in names if name not in out], out))
    things = sorted({each.thing for each in recordings.values()})
    rng = np.random.default_rng(0)
    for _ in range(10):
        held = set(rng.choice(things, len(things) // 2, replace=False))
        out = [name for name, each in recordings.items() if each.thing in held]
        found.append(([name for name in names if name not in out], out))
    return found
