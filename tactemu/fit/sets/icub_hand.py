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

from tactemu.fit.sets.aims import Aim, Constant, Recordings
from tactemu.fit.skill import Points

AIMS = (Aim("smallest", "smallest value of a grasp of an object that was grasped before", 30.0, "counts"),)
CONSTANTS = (
    Constant("mean", "mean of the first row", "counts"),
    Constant("spread", "spread over taxels of the first row", "counts"),
    Constant("unchanged", "share of readings that repeat"),
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


def constants(recordings: Recordings) -> dict[str, list[float]]:
    """Return the means and spreads of first rows, and the shares of repeats, of all grasps."""
    every = list(recordings.values())
    return {
        "mean": [float(each.first.mean()) for each in every],
        "spread": [float(each.first.std()) for each in every],
        "unchanged": [each.unchanged for each in every],
    }


def points(key: str, recording: Grasp) -> Points:
    """Return the smallest value of a grasp; nothing but its object is known before."""
    return Points(np.zeros((1, 0)), np.array([recording.smallest]))


def predict(parameters: dict[str, Any], key: str, recording: Grasp) -> np.ndarray:
    """Return the median of the object's other grasps; for an object that was not grasped before, of all objects."""
    return np.array([parameters["smallest_by_object"].get(recording.thing, parameters["smallest"])])
