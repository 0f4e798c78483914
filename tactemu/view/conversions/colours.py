"""Colours and sizes in which viewers show what is felt."""

from __future__ import annotations

import numpy as np

from tactemu.truth.entries import Sample
from tactemu.view.conversions.surroundings import Part

NOTHING, MOST, NAN = np.array([0.18, 0.24, 0.36]), np.array([1.0, 0.55, 0.1]), np.array([0.9, 0.0, 0.9])
"""Colours of a taxel that feels nothing, of the one that has felt most so far, and of one that reads NaN."""


def colours(share: np.ndarray) -> np.ndarray:
    """From nothing (0) to the most (1), shape ``(..., 3)``, each from 0 to 1."""
    mixed = NOTHING + np.nan_to_num(share)[..., None] * (MOST - NOTHING)
    return np.where(np.isnan(share)[..., None], NAN, mixed)


def touched(sample: Sample) -> np.ndarray:
    """Which taxels are in contact: those that feel anything, without imperfections."""
    ideal = np.asarray(sample.ideal, float).reshape(len(sample.ideal), -1)
    return (ideal != 0).any(axis=1)


def pitch(part: Part) -> float:
    """Distance of a taxel to the nearest other one [m]."""
    positions = part.positions[:256]
    if len(positions) < 2:
        return 3e-3
    gaps = np.linalg.norm(positions[:, None] - positions, axis=-1)
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1))) or 3e-3
