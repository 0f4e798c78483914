"""The probes of a skin: positions, normals, radii and grid from a sensor model's options, checked once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactemu.base.errors import SceneError, shown
from tactemu.base.options import numbers, triple
from tactemu.geometry import rotation
from tactemu.sensors.probe_grid import Grid, find_grid


@dataclass(frozen=True, kw_only=True, eq=False)
class Probes:
    """The probes of one sensor, in the frame of its link, offsets applied. ``n`` probes, flat in layout order."""

    layout: tuple[int, ...]
    """Shape of a reading without environments and channels: ``(n,)`` or ``(rows, cols)``."""
    positions: np.ndarray
    """Positions [m], shape ``(n, 3)``, float64."""
    normals: np.ndarray
    """Unit normals out of the skin, shape ``(n, 3)``."""
    radii: np.ndarray
    """Radii [m], shape ``(n,)``; 0 marks a filler."""

    @property
    def n(self) -> int:
        """Number of probes, fillers included."""
        return len(self.positions)

    @property
    def active(self) -> np.ndarray:
        """False for fillers, shape ``(n,)``."""
        return self.radii > 0

    @property
    def mean_normal(self) -> tuple[float, float, float]:
        """Unit normal of the layout: the grid's plane (columns x rows), else the mean of the normals."""
        mean = self.normals.sum(0) if self.n else np.array([0.0, 0.0, 1.0])
        if self.is_grid:
            plane = np.cross(*self.steps())
            mean = plane if np.linalg.norm(plane) > 0 else mean
        length = np.linalg.norm(mean)
        return tuple(mean / length) if length > 1e-12 else (0.0, 0.0, 1.0)

    @property
    def is_grid(self) -> bool:
        """Was the layout given as ``(rows, cols, 3)``?"""
        return len(self.layout) == 2

    @cached_property
    def grid(self) -> Grid | None:
        """The flat, even grid that the probes form, or ``None``."""
        return find_grid(self.positions.reshape(*self.layout, 3), self.normals)

    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean step vectors of a grid [m]: along the columns (u) and along the rows (v); zero for a single one."""
        grid = self.positions.reshape(*self.layout, 3)
        zero = np.zeros(3)
        u = np.diff(grid, axis=1).reshape(-1, 3).mean(0) if self.layout[1] > 1 and self.layout[0] else zero
        v = np.diff(grid, axis=0).reshape(-1, 3).mean(0) if self.layout[0] > 1 and self.layout[1] else zero
        return u, v

    @property
    def spacing(self) -> tuple[float, float]:
        """Pitch of a grid [m] along columns (u) and rows (v); a single row or column takes the other's."""
        du, dv = (float(np.linalg.norm(step)) for step in self.steps())
        return du or dv, dv or du


def _vectors(given, name: str, sensor: str) -> np.ndarray:
    array = numbers(sensor, name, given)
    if array.ndim == 1 and array.size == 0:
        array = array.reshape(0, 3)
    if array.ndim == 1:
        array = array[None]
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        raise SceneError(f"{sensor}: {name} must have shape (n, 3) or (rows, cols, 3), got {np.shape(given)}")
    return array


def _turn(quaternion, sensor: str) -> np.ndarray:
    try:
        return rotation.matrix(rotation.normalised(numbers(sensor, "quaternion", quaternion)))
    except ValueError:
        raise SceneError(
            f"{sensor}: quaternion must be 4 numbers (w, x, y, z), not all 0, got {shown(quaternion)}"
        ) from None


def make_probes(local_pos, local_normal, radius, position, quaternion, sensor: str) -> Probes:
    """Check the geometry options of a sensor and move the probes by its offsets.

    Args:
        local_pos: ``(n, 3)`` or ``(rows, cols, 3)`` [m].
        local_normal: one normal, or one per probe; any length > 0.
        radius: one number [m], or one per probe in any shape of that size.
        position: shift of the sensor's frame in the link [m].
        quaternion: its rotation (w, x, y, z), of any length > 0.
        sensor: name for messages.

    Raises:
        SceneError: a shape or a value is wrong; the message names the option.
    """
    positions = _vectors(local_pos, "positions", sensor)
    layout = positions.shape[:-1]
    n = int(np.prod(layout))
    normals = _vectors(local_normal, "normals", sensor).reshape(-1, 3)
    if len(normals) not in (1, n):
        raise SceneError(f"{sensor}: normals must be one vector or {n}, got {len(normals)}")
    largest = np.abs(normals).max(axis=1, keepdims=True, initial=0.0)
    with np.errstate(invalid="ignore"):
        normals = normals / largest  # so that no square under- or overflows
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    if not (largest > 0).all():
        at = int(np.argmin(largest))
        raise SceneError(f"{sensor}: normals[{at}] has length zero; give the direction out of the skin")
    normals = np.broadcast_to(normals / lengths, (n, 3))
    radii = numbers(sensor, "radius", radius).reshape(-1)
    if radii.size not in (1, n):
        raise SceneError(f"{sensor}: radius must be one number or {n}, got {radii.size}")
    if (radii < 0).any():
        raise SceneError(f"{sensor}: radius must be >= 0 m (0 marks a filler), got {radius!r}")
    offset = triple(sensor, "position", position)
    turn = _turn(quaternion, sensor)
    return Probes(
        layout=layout,
        positions=positions.reshape(-1, 3) @ turn.T + offset,
        normals=np.ascontiguousarray(normals @ turn.T),
        radii=np.ascontiguousarray(np.broadcast_to(radii, (n,))),
    )
