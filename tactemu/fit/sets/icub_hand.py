"""iCub hand: sixty capacitive taxels of one byte, 255 less the load, grasping objects.

A recording is :class:`Grasp`. The law is a resting pattern, and a dead band: what some grasps showed of both is what
others show. How hard an object is held is the hand's doing, not the sensor's: the median of the smallest values is that
object's own where it was seen, and that of all objects together where it was not.
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
    """One grasp, in counts."""

    thing: str
    first: np.ndarray
    """Its first row, before contact, shape (60,)."""
    smallest: float
    unchanged: float
    """Share of readings that are those of the row before."""


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
    """Resting pattern, its spread from trial to trial, share of repeats, and the median of smallest values."""
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
    """Return errors of all the grasps given together [counts, points]."""
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
    """Return every third trial of all objects held out, three times; then half of the objects, ten times."""
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
