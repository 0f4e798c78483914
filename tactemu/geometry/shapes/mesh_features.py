"""Faces, edges and vertices of a mesh with the normal of each, in float64, relative to the middle of the mesh.

The angle-weighted normal of the feature on which the nearest point lies distinguishes inside from outside, also at
sharp edges and vertices: J. A. Baerentzen and H. Aanaes, Signed distance computation using the angle weighted
pseudonormal, IEEE Transactions on Visualization and Computer Graphics 11 (2005).
"""

from dataclasses import dataclass

import numpy as np

from tactemu.geometry.shapes.triangles import Triangles

MAX_SLIVER_CHAIN = 8
"""Most triangles without an area, one behind another, across which an edge finds its neighbour's normal."""
BLOCK_FACES = 2**17
"""Number of faces whose corners are held at a time."""


@dataclass(frozen=True, eq=False)
class Features:
    """The features of one mesh."""

    points: np.ndarray
    """Vertices less the middle of the mesh [m], shape ``(n, 3)``."""
    point_normals: np.ndarray
    """Normals of the vertices, weighted by the angles of the faces, shape ``(n, 3)``; zero where they cancel."""
    side_normals: np.ndarray
    """The unit normal of each face and of its three sides, shape ``(m, 4, 3)``; side ``k`` runs from corner ``k`` to
    the next."""
    beside: np.ndarray
    """The face beyond each side, -1 for none or several, shape ``(m, 3)``, int32."""


def features_of(triangles: Triangles, middle: np.ndarray) -> Features:
    """Return the features of a mesh. Triangles without an area have no normal, so that those behind them count.

    A mesh may have millions of faces: no more than a few numbers per side are held at a time.
    """
    points = triangles.vertices - middle
    many = len(triangles.faces)
    faces = np.concatenate([triangles.faces, triangles.slivers])
    edge, uses = _edges(faces, len(points))
    sides = np.empty((many, 4, 3))
    normals = sides[:, 0]
    angles = np.empty((len(faces), 3))
    for start in range(0, len(faces), BLOCK_FACES):
        part = slice(start, start + BLOCK_FACES)
        corners = points[faces[part]]
        way = np.roll(corners, -1, axis=1) - corners
        angles[part] = _angles(way)
        count = len(normals[part])  # slivers have no normal of their own
        normals[part] = _unit(np.cross(way[:count, 0], way[:count, 1]))
    beside_slivers, shown_by_slivers = _across_slivers(points, triangles.slivers, normals, edge, len(uses))
    edge_normals = _cleared(_edge_sums(normals, beside_slivers, edge, len(uses)))
    for k in range(3):
        sides[:, 1 + k] = edge_normals[edge[k : 3 * many : 3]]
    del edge_normals
    vertex_sums = np.empty((len(points), 3))
    for k in range(3):
        shown = np.concatenate([normals[:, k], shown_by_slivers[:, k]])
        vertex_sums[:, k] = np.bincount(faces.reshape(-1), (angles * shown[:, None]).reshape(-1), len(points))
    return Features(points, _cleared(vertex_sums), sides, _beside(edge, uses, many))


def _edges(faces: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of the edge of each side, flat, and how many sides each edge has."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end).astype(np.int64)
    key *= points
    key += np.maximum(start, end)
    del start, end
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    return edge.astype(np.int32), uses


def _across_slivers(
    points: np.ndarray, slivers: np.ndarray, normals: np.ndarray, edge: np.ndarray, edges: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal that each side of a sliver contributes, ``(k, 3, 3)``, and that of its corners, ``(k, 3)``.

    A sliver's short side takes the normal beyond its longest side.
    """
    seen = np.zeros((len(slivers), 3, 3))
    if not len(slivers):
        return seen, np.zeros((0, 3))
    corners = points[slivers]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = length.argmax(1)
    rows = np.arange(len(longest))
    weight = length.copy()
    weight[rows, longest] = 0.0
    for _ in range(MAX_SLIVER_CHAIN):
        beyond = _edge_sums(normals, seen, edge, edges)[edge[3 * len(normals) :]].reshape(-1, 3, 3) - seen
        through = np.repeat(beyond[rows, longest][:, None], 3, axis=1)
        through[rows, longest] = np.einsum("fk,fkx->fx", weight, beyond)
        seen = _unit(through)
    return seen, seen[rows, (longest + 1) % 3]


def _edge_sums(normals: np.ndarray, of_slivers: np.ndarray, edge: np.ndarray, edges: int) -> np.ndarray:
    """Return the sum of the normals on both sides of each edge, ``(edges, 3)``."""
    sums = np.empty((edges, 3))
    for k in range(3):
        weights = np.concatenate([np.repeat(normals[:, k], 3), of_slivers[..., k].reshape(-1)])
        sums[:, k] = np.bincount(edge, weights, edges)
    return sums


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def _cleared(sums: np.ndarray) -> np.ndarray:
    """Return unit vectors, zero where normals cancel up to rounding, as at the rim of the two sides of a sheet."""
    return np.where(np.linalg.norm(sums, axis=1, keepdims=True) > 1e-9, _unit(sums), 0.0)


def _angles(way: np.ndarray) -> np.ndarray:
    """Return the angle between the sides at each corner [rad]."""
    back = -np.roll(way, 1, axis=1)
    across = np.linalg.norm(np.cross(way, back), axis=2)
    return np.arctan2(across, np.einsum("fkx,fkx->fk", way, back))


def _beside(edge: np.ndarray, uses: np.ndarray, many: int) -> np.ndarray:
    """Return the face beyond each side, or -1 unless exactly two faces share the edge, shape ``(m, 3)``."""
    order = np.argsort(edge, kind="stable")
    first = np.concatenate([[0], np.cumsum(uses)[:-1]])[uses == 2]
    one, two = order[first], order[first + 1]
    beside = np.full(len(edge), -1, np.int32)
    beside[one], beside[two] = two // 3, one // 3
    beside[beside >= many] = -1
    return beside[: 3 * many].reshape(-1, 3)
