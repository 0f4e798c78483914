"""The exact distance to a triangle mesh, by a bounding volume hierarchy (Warp's, which is float32).

Meshes are stored scaled to unit size, so that nanometres and kilometres are the same to it. Beside each lies a coarse
grid of distances: as the distance changes by no more than one moves, the nearest node bounds the search (a query costs
a fifth near the surface), rules out what is far away, and gives the sign wherever it is not in doubt. Where it is, the
sign is that of the nearest face for a point straight above or below it, and else that of the angle-weighted normal of
the nearest feature, which is right at sharp edges and vertices; for a surface with holes it is that of the winding
number.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false, reportAttributeAccessIssue=false

import functools
import logging
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from tactemu.physics.shapes.shape import table_type
from tactemu.physics.shapes.triangles import Triangles

log = logging.getLogger(__name__)

NODES = 32
"""Nodes of the bounding grid along the longest side."""
STRAIGHT = 0.9999
"""Cosine from which on a point is straight above a face, or below it: all of the surface is on the other side of the
plane through the nearest point, so that the face's own normal tells which."""


@dataclass(frozen=True, eq=False)
class MeshQuery:
    """A mesh on the device."""

    mesh: wp.Mesh
    unit: float
    """Metres that one stored unit stands for."""
    values: np.ndarray
    """Signed distances at the nodes of the bounding grid [m], shape ``(nx, ny, nz)``."""
    origin: np.ndarray
    cell: float


@functools.cache
def _node_kernel(closed: bool):
    """Distances along one row of nodes per thread: each bounds the search for the next."""

    @wp.kernel(module="unique", enable_backward=False)
    def node_distances(mesh: wp.uint64, origin: wp.vec3, cell: float, out: wp.array3d(dtype=wp.float32)):
        i, j = wp.tid()
        farthest = float(1.0e6)
        for k in range(out.shape[2]):
            p = origin + cell * wp.vec3(float(i), float(j), float(k))
            if wp.static(closed):
                hit = wp.mesh_query_point_sign_normal(mesh, p, farthest)
            else:
                hit = wp.mesh_query_point_sign_winding_number(mesh, p, farthest)
            d = wp.length(p - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v))
            out[i, j, k] = hit.sign * d
            farthest = 1.0001 * (d + cell)

    return node_distances


def build_query(triangles: Triangles, device) -> MeshQuery:
    """Build the hierarchy and the bounding grid of a mesh."""
    used = triangles.vertices[np.unique(triangles.faces)]
    low, high = used.min(0), used.max(0)
    unit = float(max(np.abs(used).max(), (high - low).max()))
    points = wp.array((triangles.vertices / unit).astype(np.float32), dtype=wp.vec3, device=device)
    indices = wp.array(triangles.faces.reshape(-1), dtype=wp.int32, device=device)
    mesh = _hierarchy(points, indices, triangles.closed)
    cell = float((high - low).max()) / (NODES - 3)
    nodes = np.ceil((high - low) / cell).astype(int) + 3
    origin = low - cell
    out = wp.zeros(tuple(nodes), dtype=wp.float32, device=device)
    inputs = [mesh.id, wp.vec3(*(origin / unit)), cell / unit]
    wp.launch(_node_kernel(triangles.closed), dim=out.shape[:2], inputs=inputs, outputs=[out], device=device)
    return MeshQuery(mesh, unit, out.numpy().astype(np.float64) * unit, origin, cell)


def _hierarchy(points: wp.array, indices: wp.array, closed: bool) -> wp.Mesh:
    """On a GPU that of cuBQL, which is a fifth to a quarter faster to search; it has no winding numbers."""
    assert points.device is not None
    if points.device.is_cuda and closed:
        try:
            return wp.Mesh(points=points, indices=indices, bvh_constructor="cubql")
        except (RuntimeError, ValueError) as error:  # a Warp that was built without it
            log.debug("no cuBQL hierarchy: %s", error)
    return wp.Mesh(points=points, indices=indices, support_winding_number=not closed)


class MeshFunctions(NamedTuple):
    """Warp functions for a point ``p`` in the body's frame."""

    distance: Any
    """``distance(shapes, b, p) -> (signed distance, normal)``"""
    nearest_node: Any
    """``nearest_node(shapes, b, p) -> (value, away)``: the signed distance at the nearest node of the coarse grid [m],
    and how far the distance at ``p`` may differ from it."""
    lower_bound: Any
    """``lower_bound(shapes, b, p)``: never more than the distance of a closed mesh, for one look into the grid."""


@functools.cache
def mesh_functions(real, closed: bool) -> MeshFunctions:
    """The functions for one float type, for meshes that are closed or not."""
    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def nearest_node(shapes: shapes_type, b: int, p: vec3):
        n = shapes.grid_nodes[b]
        cell = shapes.grid_cell[b][0]
        origin = shapes.grid_origin[b]
        g = (p - origin) / cell
        i = wp.clamp(int(wp.rint(g[0])), 0, n[0] - 1)
        j = wp.clamp(int(wp.rint(g[1])), 0, n[1] - 1)
        k = wp.clamp(int(wp.rint(g[2])), 0, n[2] - 1)
        at = shapes.grid_start[b] + wp.int64((i * n[1] + j) * n[2] + k)
        node = origin + cell * vec3(real(i), real(j), real(k))
        slack = real(1.0e-5) * shapes.mesh_unit[b]
        return shapes.grid_values[at], wp.length(p - node) + slack

    @wp.func
    def lower_bound(shapes: shapes_type, b: int, p: vec3):
        d, away = nearest_node(shapes, b, p)
        return d - away

    @wp.func
    def distance(shapes: shapes_type, b: int, p: vec3):
        mesh = shapes.mesh[b]
        unit = shapes.mesh_unit[b]
        node, away = nearest_node(shapes, b, p)
        scaled = p / unit
        q = wp.vec3(wp.float32(scaled[0]), wp.float32(scaled[1]), wp.float32(scaled[2]))
        farthest = wp.float32((wp.abs(node) + away) / unit)
        sign = float(1.0)
        face = int(-1)
        u = float(0.0)
        v = float(0.0)
        if wp.static(closed):
            found = wp.mesh_query_point_no_sign(mesh, q, farthest)
            u = found.u
            v = found.v
            face = wp.where(found.result, found.face, -1)
        else:
            wound = wp.mesh_query_point_sign_winding_number(mesh, q, farthest)
            sign = wound.sign
            u = wound.u
            v = wound.v
            face = wp.where(wound.result, wound.face, -1)
        if face < 0:  # not a number
            return real(wp.nan), vec3(real(0.0))
        gap = q - wp.mesh_eval_position(mesh, face, u, v)
        length = wp.length(gap)
        n = wp.mesh_eval_face_normal(mesh, face)
        if wp.static(closed):
            above = wp.dot(gap, n)
            if wp.abs(node) > away:
                sign = wp.where(node < real(0.0), -1.0, 1.0)
            elif wp.abs(above) > STRAIGHT * length:
                sign = wp.where(above < 0.0, -1.0, 1.0)
            else:
                sign = wp.mesh_query_point_sign_normal(mesh, q, 1.01 * length + 1.0e-6).sign
        if length > 1.0e-6:
            n = gap * (sign / length)
        return real(sign * length) * unit, vec3(real(n[0]), real(n[1]), real(n[2]))

    return MeshFunctions(distance, nearest_node, lower_bound)
