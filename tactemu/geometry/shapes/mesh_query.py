"""The exact distance to a triangle mesh.

A tree over the faces in float32 (:mod:`~tactemu.geometry.shapes.face_tree`) finds the nearest one. The nearest point on
it, and from it distance and normal, are computed in the scene's own float type. Both use coordinates relative to the
middle of the mesh, so that its distance from the body's origin does not matter; the tree holds the mesh scaled to unit
size, so that neither does its scale.

Each mesh has a coarse grid of distances. As the distance changes by no more than the point moves, the nearest node
bounds the search (a query near the surface then costs a fifth), excludes far points, and gives the sign wherever that
is not in doubt. Elsewhere the sign follows from the normal of the feature on which the nearest point lies: face, edge
or vertex (:mod:`~tactemu.geometry.shapes.mesh_features`). For a surface with holes, or with faces within its solid, it
follows from the winding number, and Warp's hierarchy finds the face.
"""

# pyright: reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportAttributeAccessIssue=false

import functools
import logging
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.face_tree import FaceTree, build_tree, nearest_face_function, trees_type, upload_trees
from tactemu.geometry.shapes.mesh_features import Features, features_of
from tactemu.geometry.shapes.nearest_feature import feature_functions, normal_function, surfaces_type, upload_surfaces
from tactemu.geometry.shapes.shape import table_type
from tactemu.geometry.shapes.triangles import Triangles

log = logging.getLogger(__name__)

NODES_PER_LONGEST_SIDE = 32
"""Nodes of the bounding grid along the longest side."""
MAX_SAMPLED_FACES = 20_000
"""Most faces of a closed mesh that are first tested for lying within its solid."""
SAMPLE_WEIGHTS = ((0.33, 0.33), (0.98, 0.01), (0.01, 0.98), (0.01, 0.01), (0.49, 0.02), (0.02, 0.49), (0.49, 0.49))
"""Points tested on each face, as the weights of two corners: its middle, and points near its corners and sides."""
SAMPLE_OFFSET = 1.0e-5
"""Distance of the tested points from their face, in units of the mesh."""


@dataclass(frozen=True, eq=False)
class MeshQuery:
    """A mesh on the device."""

    mesh: wp.Mesh
    tree: FaceTree | None
    """The tree that finds the nearest face; None: the winding number gives the sign, and Warp's hierarchy the face."""
    unit: float
    """Metres that one stored unit stands for."""
    features: Features
    middle: np.ndarray
    """Centre of the box around it, body frame [m]."""
    half: np.ndarray
    """Half the extents of that box [m]."""
    values: np.ndarray
    """Signed distances at the nodes of the bounding grid [m], shape ``(nx, ny, nz)``."""
    origin: np.ndarray
    """Position of the grid's first node, relative to the middle [m]."""
    cell: float


def build_query(triangles: Triangles, device) -> MeshQuery:
    """Return a mesh on the device with its hierarchy, tree of faces, features and bounding grid."""
    used = triangles.vertices[np.unique(triangles.faces)]
    low, high = used.min(0), used.max(0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    unit = float(half.max())
    points = wp.array(((triangles.vertices - middle) / unit).astype(np.float32), dtype=wp.vec3, device=device)
    mesh = _hierarchy(points, triangles, device)
    wound = not triangles.closed
    if not wound and (kept := _without_interior_faces(triangles, mesh, device)) is not triangles:
        wound, triangles = True, kept
        mesh = _hierarchy(points, triangles, device)
    tree = None
    if not wound:
        mesh = _without_winding_numbers(mesh)
        tree = build_tree((triangles.vertices - middle) / unit, triangles.faces)
    features = features_of(triangles, middle)
    cell = 2.0 * unit / (NODES_PER_LONGEST_SIDE - 3)
    nodes = np.ceil(2.0 * half / cell).astype(int) + 3
    origin = -half - cell
    values, nearest = _node_values(mesh, tree, unit, features, origin, cell, tuple(map(int, nodes)), device)
    if tree is not None:
        tree = replace(tree, seeds=tree.index_of(nearest.reshape(-1)))
    return MeshQuery(mesh, tree, unit, features, middle, half, values, origin, cell)


def _hierarchy(points: wp.array, triangles: Triangles, device) -> wp.Mesh:
    indices = wp.array(triangles.faces.reshape(-1), dtype=wp.int32, device=device)
    return wp.Mesh(points=points, indices=indices, support_winding_number=True)


def _without_winding_numbers(mesh: wp.Mesh) -> wp.Mesh:
    """Return the mesh with a hierarchy a third as large; on a GPU it is cuBQL's, a fifth to a quarter faster."""
    if mesh.points.device is not None and mesh.points.device.is_cuda:
        try:
            return wp.Mesh(points=mesh.points, indices=mesh.indices, bvh_constructor="cubql")
        except (RuntimeError, ValueError) as error:  # this Warp was built without cuBQL
            log.debug("no cuBQL hierarchy: %s", error)
    return wp.Mesh(points=mesh.points, indices=mesh.indices)


@functools.cache
def _within_kernel():
    @warp_kernel
    def count_within(mesh: wp.uint64, every: int, places: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.int32)):
        """Count the tested points of each face that have solid on their outer side."""
        i, k = wp.tid()
        face = i * every
        beside = wp.mesh_eval_face_normal(mesh, face) * wp.static(SAMPLE_OFFSET)
        p = wp.mesh_eval_position(mesh, face, places[k][0], places[k][1]) + beside
        hit = wp.mesh_query_point_sign_winding_number(mesh, p, 2.0 * wp.static(SAMPLE_OFFSET))
        if hit.result and hit.sign < 0.0:
            wp.atomic_add(out, i, 1)

    return count_within


def _without_interior_faces(triangles: Triangles, mesh: wp.Mesh, device) -> Triangles:
    """Return a closed mesh without the faces that lie within its solid, or the same one if there are none.

    Such faces exist where shells intersect or nest with the same sense, and where one shell passes through itself. A
    face that is partly within stays, so that the depth behind it is too small; a warning reports this once.
    """

    places = wp.array(SAMPLE_WEIGHTS, dtype=wp.vec2, device=device)

    def within(every: int) -> np.ndarray:
        found = wp.zeros(-(-len(triangles.faces) // every), dtype=wp.int32, device=device)
        dim = (found.shape[0], len(SAMPLE_WEIGHTS))
        wp.launch(_within_kernel(), dim=dim, inputs=[mesh.id, every, places], outputs=[found], device=device)
        return found.numpy()

    every = -(-len(triangles.faces) // MAX_SAMPLED_FACES)
    found = within(every)
    if not found.any():
        return triangles
    if every > 1:
        found = within(1)
    buried = found == len(SAMPLE_WEIGHTS)
    shells = triangles.shells()
    what = f"{shells} closed shells that intersect or nest" if shells > 1 else "a shell that passes through itself"
    log.warning(
        "%s has %s: the winding number decides between inside and outside; %d of %d faces lie within the solid and are "
        "left out, %d lie in it in part, and depth behind these is too small; give each shell as a body of its own, or "
        "unite them (trimesh.boolean.union)",
        triangles.name, what, buried.sum(), len(found), ((found > 0) & ~buried).sum(),
    )  # fmt: skip
    return replace(triangles, faces=triangles.faces[~buried])


@functools.cache
def _node_kernel(wound: bool):
    """Return a kernel in which a thread computes the distances of a row of nodes: each bounds the next search."""
    real, vec3 = wp.float64, wp.vec3d
    _foot, nearest = feature_functions(real)
    normal_of, nearest_face = normal_function(real), nearest_face_function()

    @warp_kernel
    def node_distances(
        mesh: wp.uint64,
        trees: trees_type(),
        surfaces: surfaces_type(real),
        origin: vec3,
        cell: real,
        unit: real,
        out: wp.array3d(dtype=real),
        faces: wp.array3d(dtype=wp.int32),
    ):
        i, j = wp.tid()
        first = wp.vec2i(0, 0)
        farthest = float(1.0e6)
        for k in range(out.shape[2]):
            p = origin + cell * vec3(real(i), real(j), real(k))
            q = wp.vec3(wp.float32(p[0] / unit), wp.float32(p[1] / unit), wp.float32(p[2] / unit))
            sign = real(1.0)
            found = int(0)
            if wp.static(wound):
                hit = wp.mesh_query_point_sign_winding_number(mesh, q, farthest)
                sign = real(hit.sign)
                found = hit.face
            else:
                found = nearest_face(trees, 0, q, farthest, -1)
            face, gap, feature = nearest(surfaces, mesh, first, found, p)
            if not wp.static(wound):
                n = normal_of(surfaces, mesh, first, face, feature)
                sign = wp.where(wp.dot(gap, n) < real(0.0), real(-1.0), real(1.0))
            d = wp.length(gap)
            out[i, j, k] = sign * d
            faces[i, j, k] = face
            farthest = 1.0001 * wp.float32((d + cell) / unit)

    return node_distances


def _node_values(mesh, tree, unit, features: Features, origin, cell, nodes, device) -> tuple[np.ndarray, np.ndarray]:
    """Return the signed distance and the nearest face of each node."""
    out, faces = (wp.zeros(nodes, dtype=dtype, device=device) for dtype in (wp.float64, wp.int32))
    surfaces = upload_surfaces([features], wp.float64, device)
    inputs = [mesh.id, upload_trees([tree], device), surfaces, wp.vec3d(*map(float, origin)), cell, unit]
    wp.launch(_node_kernel(tree is None), dim=nodes[:2], inputs=inputs, outputs=[out, faces], device=device)
    return out.numpy(), faces.numpy()


class MeshFunctions(NamedTuple):
    """Warp functions for a point ``p`` in the body's frame."""

    distance: Any
    """The distance: ``distance(shapes, b, p) -> (signed distance, normal)``."""
    nearest_node: Any
    """``nearest_node(shapes, b, p) -> (value, away)``: the signed distance at the nearest node of the coarse grid [m],
    and the most by which the distance at ``p`` may differ from it."""
    lower_bound: Any
    """``lower_bound(shapes, b, p)``: never above the distance of a closed mesh, for one node of the grid."""


@functools.cache
def mesh_functions(real, closed: bool) -> MeshFunctions:
    """Return the functions for one float type; ``closed``: for meshes that are closed and have no faces inside."""
    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    _foot, nearest = feature_functions(real)
    normal_of, nearest_face = normal_function(real), nearest_face_function()
    least = 1.0e-15 if real is wp.float64 else 2.5e-7  # in units of the mesh: a gap too short to have a direction

    @wp.func
    def node_near(shapes: shapes_type, b: int, p: vec3):
        """Return the index of the nearest node in its grid, and the most by which its distance differs."""
        n = shapes.grid_nodes[b]
        cell = shapes.grid_cell[b][0]
        from_origin = p - shapes.mesh_middle[b] - shapes.grid_origin[b]
        g = from_origin / cell
        i = wp.clamp(int(wp.rint(g[0])), 0, n[0] - 1)
        j = wp.clamp(int(wp.rint(g[1])), 0, n[1] - 1)
        k = wp.clamp(int(wp.rint(g[2])), 0, n[2] - 1)
        slack = real(1.0e-5) * shapes.mesh_unit[b]
        away = wp.length(from_origin - cell * vec3(real(i), real(j), real(k))) + slack
        return (i * n[1] + j) * n[2] + k, away

    @wp.func
    def nearest_node(shapes: shapes_type, b: int, p: vec3):
        at, away = node_near(shapes, b, p)
        return shapes.grid_values[shapes.grid_start[b] + wp.int64(at)], away

    @wp.func
    def lower_bound(shapes: shapes_type, b: int, p: vec3):
        d, away = nearest_node(shapes, b, p)
        return d - away

    @wp.func
    def distance(shapes: shapes_type, b: int, p: vec3):
        mesh = shapes.mesh[b]
        unit = shapes.mesh_unit[b]
        at, away = node_near(shapes, b, p)
        node = shapes.grid_values[shapes.grid_start[b] + wp.int64(at)]
        from_middle = p - shapes.mesh_middle[b]
        scaled = from_middle / unit
        q = wp.vec3(wp.float32(scaled[0]), wp.float32(scaled[1]), wp.float32(scaled[2]))
        farthest = wp.float32((wp.abs(node) + away) / unit)
        sign = real(1.0)
        found = int(-1)
        if wp.static(closed):
            found = nearest_face(shapes.trees, b, q, farthest, at)
        else:
            wound = wp.mesh_query_point_sign_winding_number(mesh, q, farthest)
            sign = real(wound.sign)
            found = wp.where(wound.result, wound.face, -1)
        if found < 0:  # the point is not finite
            return real(wp.nan), vec3(real(0.0))
        first = shapes.mesh_first[b]
        face, gap, feature = nearest(shapes.surfaces, mesh, first, found, from_middle)
        length = wp.length(gap)
        touching = length <= real(wp.static(least)) * unit
        if feature == 0 or touching or (wp.static(closed) and wp.abs(node) <= away):
            n = normal_of(shapes.surfaces, mesh, first, face, feature)
            side = wp.where(wp.dot(gap, n) < real(0.0), real(-1.0), real(1.0))
            if wp.static(closed):
                sign = side
            if feature == 0:
                return sign * length, (side * sign) * n
            if touching:
                return sign * length, n
        if wp.static(closed):
            if wp.abs(node) > away:
                sign = wp.where(node < real(0.0), real(-1.0), real(1.0))
        return sign * length, gap * (sign / length)

    return MeshFunctions(distance, nearest_node, lower_bound)
