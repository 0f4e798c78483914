"""A narrow band of distances around the surface of a closed mesh: the ``band`` query.

Nodes of a regular grid near the surface hold the exact distance and its gradient. Between them the distance is

    d(p) = sum_c w_c (d_c + g_c . (p - x_c) / 2)

over the eight corners ``c`` of a cell with the trilinear weights ``w_c``: exact for quadratic functions, as trilinear
interpolation is for linear ones. Each cell is compared with the exact distance when the grid is built
(:mod:`tactemu.geometry.shapes.band_building`). The exact distance is computed where the two differ by more than the
band's tolerance (beside edges, within the medial surface), where the surface is nearer than it, so that the sign is not
in doubt, and beyond the band.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools
from dataclasses import dataclass

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.mesh import MESH
from tactemu.geometry.shapes.mesh_query import mesh_functions
from tactemu.geometry.shapes.shape import FAR, ShapeKind, table_type, unknown_function

AGREEMENT = 0.9
"""Largest error of an interpolated cell where it is compared, plus the growth allowed for between these points, as a
share of the tolerance."""
SAMPLE_DISTANCE_CELLS = 0.1
"""Distance between the compared points of a cell for which growth is allowed, in cells.

The error grows per length by as much as the gradients differ.
"""
MIN_GRADIENT_COSINE = 0.95
"""Smallest cosine between the gradients at a cell's corners and their mean; cells below it are not interpolated."""


@dataclass(frozen=True, eq=False)
class Band:
    """The grid of one mesh, in the frame of its body."""

    nodes: np.ndarray
    """Distance [m] and gradient, shape ``(nx, ny, nz, 4)``; 1e18 m where the surface is far."""
    smooth: np.ndarray
    """1 where the cell that begins at a node is interpolated, uint8, shape ``(nx, ny, nz)``."""
    origin: np.ndarray
    cell: float
    tolerance: float
    """Largest error [m], and the distance from the surface below which the exact distance is computed."""


@functools.cache
def interpolation(real):
    """Return the Warp function ``interpolated(shapes, start, n, i, j, k, f, cell) -> (distance, gradient)``.

    It interpolates in the cell that begins at node ``(i, j, k)`` of the band whose first node is ``start``, at ``f``
    parts of a cell from there.
    """
    vec3, vec4, shapes_type = wp.types.vector(3, real), wp.types.vector(4, real), table_type(real)

    @wp.func
    def interpolated(shapes: shapes_type, start: wp.int64, n: wp.vec3i, i: int, j: int, k: int, f: vec3, cell: real):
        d = real(0.0)
        slope = vec3(real(0.0))
        for corner in range(8):
            u = corner >> 2
            v = (corner >> 1) & 1
            w = corner & 1
            away = f - vec3(real(u), real(v), real(w))
            weight = (real(1.0) - wp.abs(away[0])) * (real(1.0) - wp.abs(away[1])) * (real(1.0) - wp.abs(away[2]))
            at = start + (wp.int64(i + u) * wp.int64(n[1]) + wp.int64(j + v)) * wp.int64(n[2]) + wp.int64(k + w)
            node = vec4(shapes.band_values[at])
            g = vec3(node[1], node[2], node[3])
            d += weight * (node[0] + real(0.5) * cell * wp.dot(g, away))
            slope += weight * g
        return d, slope

    return interpolated


def _distance(real):
    return _in_band(real, mesh_functions(real, True).distance)


def _unsearched(real):
    return _in_band(real, unknown_function(real))


@functools.cache
def _in_band(real, exact):
    """Return the distance function of a band, which calls ``exact`` where nothing is interpolated."""
    vec3, shapes_type, interpolated = wp.types.vector(3, real), table_type(real), interpolation(real)

    @wp.func
    def in_band(shapes: shapes_type, b: int, p: vec3):
        n = shapes.band_nodes[b]
        cell = shapes.band_cell[b]
        g = (p - shapes.band_origin[b]) / cell
        if (
            g[0] >= real(0.0) and g[1] >= real(0.0) and g[2] >= real(0.0)
            and g[0] < real(n[0] - 1) and g[1] < real(n[1] - 1) and g[2] < real(n[2] - 1)
        ):  # fmt: skip
            i = int(wp.floor(g[0]))
            j = int(wp.floor(g[1]))
            k = int(wp.floor(g[2]))
            start = shapes.band_start[b]
            if shapes.band_smooth[start + (wp.int64(i) * wp.int64(n[1]) + wp.int64(j)) * wp.int64(n[2]) + wp.int64(k)]:
                f = g - vec3(real(i), real(j), real(k))
                d, slope = interpolated(shapes, start, n, i, j, k, f, cell)
                if wp.abs(d) > shapes.band_tolerance[b]:
                    return d, wp.normalize(slope)
        return exact(shapes, b, p)

    return in_band


BAND = ShapeKind("band", _distance, MESH.ray, MESH.lower_bound, is_searched=True, without_search=_unsearched)


@functools.cache
def node_kernel(real):
    """Return the kernel that computes the nodes of rows from ``first`` on, where the surface is within reach."""
    vec3, vec4, shapes_type = wp.types.vector(3, real), wp.types.vector(4, real), table_type(real)
    functions = mesh_functions(real, True)
    distance, nearest_node = functions.distance, functions.nearest_node

    @warp_kernel
    def fill_band(shapes: shapes_type, origin: vec3, cell: real, reach: real, first: int, out: wp.array3d(dtype=vec4)):
        i, j, k = wp.tid()
        i += first
        p = origin + cell * vec3(real(i), real(j), real(k))
        node, away = nearest_node(shapes, 0, p)
        out[i, j, k] = vec4(real(FAR), real(0.0), real(0.0), real(0.0))
        if wp.abs(node) - away <= reach:
            d, g = distance(shapes, 0, p)
            if wp.abs(d) <= reach:
                out[i, j, k] = vec4(d, g[0], g[1], g[2])

    return fill_band


@functools.cache
def cell_kernel(real):
    """Return the kernel that marks the cells, in rows from ``first`` on, that agree with the exact distance."""
    vec3, vec4, shapes_type = wp.types.vector(3, real), wp.types.vector(4, real), table_type(real)
    exact, interpolated = mesh_functions(real, True).distance, interpolation(real)

    @wp.func
    def agrees(shapes: shapes_type, n: wp.vec3i, i: int, j: int, k: int, f: vec3):
        cell = shapes.band_cell[0]
        d, slope = interpolated(shapes, wp.int64(0), n, i, j, k, f, cell)
        p = shapes.band_origin[0] + cell * (vec3(real(i), real(j), real(k)) + f)
        right, way = exact(shapes, 0, p)
        between = real(SAMPLE_DISTANCE_CELLS) * cell * wp.length(slope - way)
        tolerance = shapes.band_tolerance[0]
        close = wp.abs(d - right) + between <= real(AGREEMENT) * tolerance
        parallel = wp.dot(wp.normalize(slope), way) > real(MIN_GRADIENT_COSINE)
        return close and (wp.abs(right) <= tolerance or parallel)

    @warp_kernel
    def compare_cells(shapes: shapes_type, values: wp.array3d(dtype=vec4), first: int, out: wp.array3d(dtype=wp.uint8)):
        i, j, k = wp.tid()
        i += first
        n = wp.vec3i(values.shape[0], values.shape[1], values.shape[2])
        if i + 1 >= n[0] or j + 1 >= n[1] or k + 1 >= n[2]:
            return
        mean = vec3(real(0.0))
        least = real(1.0)
        for again in range(2):
            for corner in range(8):
                node = values[i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1)]
                if node[0] == real(FAR):
                    return
                g = vec3(node[1], node[2], node[3])
                if again == 0:
                    mean += g
                else:
                    least = wp.min(least, wp.dot(g, wp.normalize(mean)))
        if least < real(MIN_GRADIENT_COSINE):
            return
        same = agrees(shapes, n, i, j, k, vec3(real(0.5)))
        for corner in range(8):
            if same:
                at = vec3(real(corner >> 2), real((corner >> 1) & 1), real(corner & 1))
                same = agrees(shapes, n, i, j, k, vec3(real(0.25)) + real(0.5) * at)
        for side in range(6):
            if same:
                at = vec3(real(0.5))
                at[side >> 1] = real(side & 1)
                same = agrees(shapes, n, i, j, k, at)
        if same:
            out[i, j, k] = wp.uint8(1)

    return compare_cells
