"""A regular grid of signed distances, trilinear between nodes.

Beyond the grid the nearest surface is assumed to be the one that is nearest to the closest point of the grid, so that
the distance is continuous across the grid's border and keeps growing.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tactemu.base.errors import SceneError, reason_of
from tactemu.geometry.shapes.rays import traced_ray
from tactemu.geometry.shapes.shape import FAR, Row, Shape, ShapeKind, box_outline, table_type

MAX_GRID_NODES = 1 << 28
"""The most nodes of one grid: 1 GiB in float32."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VoxelGrid(Shape):
    """A signed distance sampled on a regular grid, trilinear between its nodes."""

    values: np.ndarray
    """Signed distances [m], negative inside, shape ``(nx, ny, nz)``, at least 2 nodes per axis."""
    origin: Sequence[float]
    """Position of node (0, 0, 0) in the body's frame [m]."""
    cell: float | Sequence[float]
    """Distance of neighbouring nodes [m], one number or one per axis."""
    gradients: np.ndarray | None = None
    """Gradients at the nodes, shape ``(nx, ny, nz, 3)``; ``None``: the gradient of the interpolated distance."""

    def __post_init__(self):
        super().__post_init__()
        shape = np.shape(self.values)
        if len(shape) != 3 or min(shape) < 2:
            raise SceneError(f"VoxelGrid: values must have shape (nx, ny, nz), each >= 2, got {shape}")
        if not np.isfinite(self.values).all():
            raise SceneError("VoxelGrid: values must be finite; replace unknown distances with a large number")
        if self.gradients is not None and np.shape(self.gradients) != (*shape, 3):
            raise SceneError(f"VoxelGrid: gradients must have shape {(*shape, 3)}, got {np.shape(self.gradients)}")
        if np.shape(self.origin) != (3,) or not np.isfinite(np.asarray(self.origin, float)).all():
            raise SceneError(f"VoxelGrid: origin must be 3 finite numbers [m], got {self.origin!r}")
        cell = np.asarray(self.cell, float)
        if cell.shape not in ((), (3,)) or not (np.isfinite(cell).all() and (cell > 0).all()):
            raise SceneError(f"VoxelGrid: cell must be > 0 m, got {self.cell!r}")

    def row(self, name: str, device) -> Row:
        return Row(VOXELS, bound=self._bound(), grid=self)

    def reach(self, name: str, direction: np.ndarray) -> float:
        """Return the extent of the balls that the distances at the nodes inside span.

        It falls short of the surface by less than a cell.

        Raises:
            SceneError: no node is inside.
        """
        values = np.asarray(self.values, float)
        inside = np.argwhere(values <= 0)
        if not len(inside):
            raise SceneError(f"body {name!r}: no node of its grid is inside, so that its extent is unknown")
        nodes = np.asarray(self.origin, float) + inside * np.broadcast_to(np.asarray(self.cell, float), 3)
        return float((nodes @ direction - values[values <= 0]).max())

    def outline(self, name: str) -> dict[str, Any]:
        """Return the outline of the box around the nodes inside."""
        nodes = np.argwhere(np.asarray(self.values) <= 0) if (np.asarray(self.values) <= 0).any() else np.zeros((1, 3))
        low, cell = np.asarray(self.origin, float), np.broadcast_to(np.asarray(self.cell, float), 3)
        return box_outline(low + nodes.min(0) * cell, low + nodes.max(0) * cell)

    @classmethod
    def from_file(  # pyright: ignore[reportIncompatibleMethodOverride]
        cls,
        folder: Path,
        *,
        path: Annotated[str, "of a .npz with values, origin, cell [m]; relative to the scene file"],
    ) -> "VoxelGrid":
        try:
            with zipfile.ZipFile(folder / path) as archive:
                if sum(member.file_size for member in archive.infolist()) > 32 * MAX_GRID_NODES:
                    raise SceneError(f"path: {path} unpacks to more than {MAX_GRID_NODES} nodes; take larger cells")
            arrays = dict(np.load(folder / path, allow_pickle=False))
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            raise SceneError(f"path: cannot read the grid {folder / path}: {reason_of(error)}") from None
        missing = {"values", "origin", "cell"} - set(arrays)
        if missing:
            raise SceneError(
                f"path: {path} lacks {', '.join(sorted(missing))}; it has {', '.join(arrays) or 'nothing'}"
            )
        return cls(**{key: arrays.get(key) for key in ("values", "origin", "cell", "gradients")})

    def _bound(self) -> float:
        """Return the radius of a ball around the origin that contains the solid [m]; 1e18 if the border cuts it off."""
        values = np.asarray(self.values)
        border = np.ones(values.shape, bool)
        border[1:-1, 1:-1, 1:-1] = False
        if (values[border] <= 0).any():
            return FAR
        cell = np.broadcast_to(np.asarray(self.cell, float), 3)
        low = np.asarray(self.origin, float)
        corner = np.maximum(np.abs(low), np.abs(low + cell * (np.array(values.shape) - 1)))
        return float(np.linalg.norm(corner))


@functools.cache
def _distance(real, least: bool = False):
    """Return the distance function of grids; ``least``: never above the true distance beyond the grid, to trace lines.

    Beyond the grid the function reads the nearest point ``c`` of its box. A solid inside the box is at least
    ``sqrt(|p - c|^2 + d(c)^2)`` away, since the angle at ``c`` is no less than a right one.
    """
    import warp as wp

    shapes_type = table_type(real)
    vec3 = wp.types.vector(3, real)

    @wp.func
    def node(shapes: shapes_type, start: wp.int64, n: wp.vec3i, i: int, j: int, k: int):
        return start + (wp.int64(i) * wp.int64(n[1]) + wp.int64(j)) * wp.int64(n[2]) + wp.int64(k)

    @wp.func
    def to_grid(shapes: shapes_type, b: int, p: vec3):
        start = shapes.grid_start[b]
        n = shapes.grid_nodes[b]
        cell = shapes.grid_cell[b]
        g = wp.cw_div(p - shapes.grid_origin[b], cell)
        top = vec3(real(n[0] - 1), real(n[1] - 1), real(n[2] - 1))
        c = wp.min(wp.max(g, vec3(real(0.0))), top)
        i = wp.min(int(wp.floor(c[0])), n[0] - 2)
        j = wp.min(int(wp.floor(c[1])), n[1] - 2)
        k = wp.min(int(wp.floor(c[2])), n[2] - 2)
        x = c[0] - real(i)
        y = c[1] - real(j)
        z = c[2] - real(k)
        d = real(0.0)
        slope = vec3(real(0.0))
        given = vec3(real(0.0))
        for corner in range(8):
            u = corner >> 2
            v = (corner >> 1) & 1
            w = corner & 1
            wx = wp.where(u == 1, x, real(1.0) - x)
            wy = wp.where(v == 1, y, real(1.0) - y)
            wz = wp.where(w == 1, z, real(1.0) - z)
            at = node(shapes, start, n, i + u, j + v, k + w)
            value = shapes.grid_values[at]
            d += wx * wy * wz * value
            slope += value * vec3(
                wp.where(u == 1, wy * wz, -wy * wz),
                wp.where(v == 1, wx * wz, -wx * wz),
                wp.where(w == 1, wx * wy, -wx * wy),
            )
            if shapes.grid_has_gradients[b] == 1:
                given += wx * wy * wz * shapes.grid_gradients[at]
        normal = wp.normalize(wp.cw_div(slope, cell))
        if shapes.grid_has_gradients[b] == 1:
            normal = wp.normalize(given)
        beyond = wp.cw_mul(g - c, cell)
        if wp.dot(beyond, beyond) > real(0.0):
            away = beyond + d * normal
            far = wp.length(away)
            if wp.static(least):
                d = wp.sqrt(wp.dot(beyond, beyond) + wp.max(d, real(0.0)) * wp.max(d, real(0.0)))
            elif far > real(0.0):
                normal = away / far
                d = far
        return d, normal

    return to_grid


@functools.cache
def _ray(real):
    import warp as wp

    shapes_type = table_type(real)

    @wp.func
    def part_of_cell(shapes: shapes_type, b: int):
        cell = shapes.grid_cell[b]
        return real(1.0e-3) * wp.min(cell[0], wp.min(cell[1], cell[2]))

    return traced_ray(real, _distance(real, least=True), part_of_cell)


VOXELS = ShapeKind("voxels", _distance, _ray, is_voxelised=False, max_slope=1.75)  # a trilinear slope may reach sqrt(3)
