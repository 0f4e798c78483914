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
    """Return the features of a mesh. Triangles without an area have no normal, so that those behind them count."""
    points = triangles.vertices - middle
    many = len(triangles.faces)
    faces = np.concatenate([triangles.faces, triangles.slivers])
    corners = points[faces]
    way = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(way, axis=2)
    start, end = faces.reshape(-1).astype(np.int64), np.roll(faces, -1, axis=1).reshape(-1)
    _, edge, uses = np.unique(
        np.minimum(start, end) * len(points) + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    seen = np.zeros((len(faces), 3, 3))  # the normal that each side of a face, or of a sliver, contributes
    seen[:many] = _unit(np.cross(way[:many, 0], way[:many, 1]))[:, None]
    for _ in range(MAX_SLIVER_CHAIN if len(faces) > many else 0):
        beyond = (_summed(seen.reshape(-1, 3), edge, len(uses))[edge].reshape(-1, 3, 3) - seen)[many:]
        longest = length[many:].argmax(1)
        rows = np.arange(len(longest))
        weight = length[many:].copy()
        weight[rows, longest] = 0.0
        through = np.repeat(beyond[rows, longest][:, None], 3, axis=1)
        through[rows, longest] = np.einsum("fk,fkx->fx", weight, beyond)
        seen[many:] = _unit(through)
    edge_normals = _cleared(_summed(seen.reshape(-1, 3), edge, len(uses)))
    sides = np.concatenate([seen[:many, :1], edge_normals[edge].reshape(-1, 3, 3)[:many]], axis=1)
    across = (length.argmax(1) + 1) % 3  # a sliver's short side takes the normal beyond its longest side
    shown = seen[np.arange(len(faces)), across][:, None]
    weighted = (_angles(way, length)[..., None] * shown).reshape(-1, 3)
    vertex_normals = _cleared(_summed(weighted, faces.reshape(-1), len(points)))
    return Features(points, vertex_normals, sides, _beside(edge, uses, many))


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def _summed(values: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(groups, weights=values[:, k], minlength=count) for k in range(3)], axis=1)


def _cleared(sums: np.ndarray) -> np.ndarray:
    """Return unit vectors, zero where normals cancel up to rounding, as at the rim of the two sides of a sheet."""
    return np.where(np.linalg.norm(sums, axis=1, keepdims=True) > 1e-9, _unit(sums), 0.0)


def _angles(way: np.ndarray, length: np.ndarray) -> np.ndarray:
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
