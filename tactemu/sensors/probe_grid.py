"""The test whether taxels form a flat rectangular grid: rows and columns at right angles, evenly spaced, one normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_TOLERANCE = 1e-5
"""Largest deviation from a regular grid: in cosines of angles, and in positions as a part of the extent."""


@dataclass(frozen=True)
class Grid:
    """A flat grid of taxels. Column step along u, row step along v; flat index ``row * cols + col``."""

    rows: int
    cols: int
    du: float
    """Distance of neighbouring columns [m]."""
    dv: float
    """Distance of neighbouring rows [m]."""
    u: np.ndarray
    """Unit tangent along a row, link frame."""
    v: np.ndarray
    """Unit tangent along a column."""
    normal: np.ndarray
    """Unit normal of all taxels."""
    corner: np.ndarray
    """Position of the taxel of row 0, column 0, link frame [m]."""
    deviation: float = 0.0
    """Largest deviation, in cosines of angles or as a part of the extent."""

    @property
    def is_exact(self) -> bool:
        """Is the grid regular to rounding, so that positions may be computed from rows and columns?"""
        return self.deviation < 1e-10


def find_grid(positions: np.ndarray, normals: np.ndarray) -> Grid | None:
    """Return the grid that the taxels form, or ``None`` where Genesis' grid conditions do not hold.

    Args:
        positions: link frame [m], shape ``(rows, cols, 3)``; other shapes are no grid, nor is a single row or column.
        normals: unit normals, shape ``(rows * cols, 3)``.
    """
    if positions.ndim != 3 or min(positions.shape[:2]) < 2:
        return None
    rows, cols = positions.shape[:2]
    step_u = np.diff(positions, axis=1).reshape(-1, 3).mean(axis=0)
    step_v = np.diff(positions, axis=0).reshape(-1, 3).mean(axis=0)
    du, dv = float(np.linalg.norm(step_u)), float(np.linalg.norm(step_v))
    normal = normals.mean(axis=0)
    if min(du, dv, float(np.linalg.norm(normal))) == 0.0:
        return None
    u, v, normal = step_u / du, step_v / dv, normal / np.linalg.norm(normal)
    i, j = np.indices((rows, cols))[..., None]
    centred = positions - positions.mean(axis=(0, 1))
    expected = (j - (cols - 1) / 2) * step_u + (i - (rows - 1) / 2) * step_v
    residual = np.abs(centred - expected).max() / np.abs(expected).max()
    skew = max(abs(u @ v), abs(u @ normal), abs(v @ normal), float(np.abs(normals - normal).max()))
    deviation = float(max(residual, skew))
    return Grid(rows, cols, du, dv, u, v, normal, positions[0, 0], deviation) if deviation <= _TOLERANCE else None
