"""A grid of samples of a shape's exact distance, for the voxel query."""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.distance import shape_functions
from tactemu.geometry.shapes.shape import table_type
from tactemu.geometry.shapes.voxel_grid import MAX_GRID_NODES, VoxelGrid
from tactemu.plan.plan import Context

CELLS_PER_LONGEST_SIDE = 64
"""Cells along the longest side if no cell size is given."""
MARGIN_SHARE = 0.1
"""Extent of the grid beyond the shape, as a share of the longest side."""


@functools.cache
def _sample_kernel(real, kinds: frozenset):
    vec3 = wp.types.vector(3, real)
    shapes_type = table_type(real)
    distance = shape_functions(real, kinds).distance

    @warp_kernel
    def sample(shapes: shapes_type, origin: vec3, cell: real, out: wp.array3d(dtype=real)):
        i, j, k = wp.tid()
        d, _n = distance(shapes, 0, origin + cell * vec3(real(i), real(j), real(k)))
        out[i, j, k] = d

    return sample


def voxelise(table, middle, half, cell: float | None, name: str, context: Context) -> VoxelGrid:
    """Return a grid of the distances to the shape in row 0 of ``table``.

    Args:
        table: a table with this one shape.
        middle: centre of the box around it [m].
        half: half the extents of that box [m].
        cell: distance of nodes [m]; ``None``: the longest side / 64.
        name: the body's name, for messages.
        context: the scene's context.

    Raises:
        SceneError: the cell size is not positive, or so small that the grid has too many nodes.
    """
    middle, half = np.asarray(middle), np.asarray(half)
    longest = 2.0 * float(half.max())
    cell = longest / CELLS_PER_LONGEST_SIDE if cell is None else float(cell)
    if not (np.isfinite(cell) and cell > 0):
        raise SceneError(f"voxel_size must be > 0 m, got {cell!r}")
    half = half + MARGIN_SHARE * longest
    nodes = np.ceil(2.0 * half / cell).astype(np.int64) + 1
    if nodes.prod() > MAX_GRID_NODES:
        raise SceneError(
            f"voxel_size {cell:g} m makes a grid of {' x '.join(map(str, nodes))} nodes for body {name!r}; "
            f"at most {MAX_GRID_NODES} are allowed: take a larger cell, or depth_query='sdf'"
        )
    origin = middle - 0.5 * cell * (nodes - 1)
    real = context.real
    out = wp.zeros(tuple(map(int, nodes)), dtype=real, device=context.device)
    inputs = [table.struct, wp.types.vector(3, real)(*map(float, origin)), cell]
    wp.launch(_sample_kernel(real, table.kinds), dim=out.shape, inputs=inputs, outputs=[out], device=context.device)
    return VoxelGrid(values=out.numpy().astype(np.float64), origin=tuple(origin), cell=cell)
