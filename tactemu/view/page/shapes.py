"""Meshes of the page: rounded boxes, capsules, and the plates that carry the taxels of a patch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_EDGE_STEPS = 2
"""Number of facets of a quarter of a rounded edge; more cost time on a machine without a GPU."""
_CORNERS = 16
"""Number of directions in which a plate's outline is rounded."""
_MARGIN_PITCHES = 0.75
"""The distance of a plate's edge from the outermost taxels [pitches]."""
_MAX_PITCHES_SQUARED = 3.0
"""The largest area of a plate per taxel [squared pitches]; a patch with gaps gets a plate for each taxel."""
_FLAT = 0.05
"""The largest deviation of normals [1] and of positions [extents] of a patch that is flat."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh."""

    vertices: np.ndarray
    faces: np.ndarray

    def moved(self, turn: np.ndarray, place: np.ndarray) -> Mesh:
        """Return the mesh turned by a rotation matrix, then shifted."""
        return Mesh(self.vertices @ turn.T + place, self.faces)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return one mesh of several."""
    starts = np.cumsum([0, *(len(each.vertices) for each in meshes)])
    return Mesh(
        np.concatenate([np.zeros((0, 3)), *(each.vertices for each in meshes)]).astype(np.float32),
        np.concatenate(
            [np.zeros((0, 3), int), *(each.faces + start for each, start in zip(meshes, starts))]
        ).astype(np.uint32),
    )  # fmt: skip


def faceted(mesh: Mesh) -> Mesh:
    """Return a mesh whose faces share no vertex, so that each has a colour of its own."""
    return Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3))


def rounded(half: Sequence[float] | np.ndarray, radius: float, steps: int = _EDGE_STEPS) -> Mesh:
    """Return a box around the origin with rounded edges; a capsule if two of its sides are as long as two radii.

    Args:
        half: half the side lengths [m].
        radius: radius of the edges [m], at most the smallest of ``half``.
        steps: number of facets of a quarter of an edge.
    """
    quarter = np.linspace(0, np.pi / 2, steps + 1)
    turns = np.concatenate([quarter + k * np.pi / 2 for k in range(4)])
    signs = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], steps + 1, axis=0)
    heights, above = np.concatenate([quarter - np.pi / 2, quarter]), np.repeat([-1, 1], steps + 1)
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    sphere = np.concatenate(
        [np.cos(heights)[:, None, None] * ring, np.tile(np.sin(heights)[:, None, None], (1, len(ring), 1))], axis=2
    )
    corner = np.concatenate([np.tile(signs, (len(heights), 1, 1)), np.tile(above[:, None, None], (1, len(ring), 1))], 2)
    vertices = (corner * (np.asarray(half, float) - radius) + radius * sphere).reshape(-1, 3)
    n, faces = len(ring), []
    for row in range(len(heights) - 1):
        a = row * n + np.arange(n)
        b = row * n + (np.arange(n) + 1) % n
        faces += [np.stack([a, b, b + n], axis=1), np.stack([a, b + n, a + n], axis=1)]
    top, corners = (len(heights) - 1) * n, np.arange(4) * (steps + 1)
    for ends in (corners[::-1], top + corners):
        faces.append(np.array([[ends[0], ends[1], ends[2]], [ends[0], ends[2], ends[3]]]))
    return Mesh(vertices, np.concatenate(faces))


def capsule(begin: np.ndarray, end: np.ndarray, radius: float, steps: int = _EDGE_STEPS) -> Mesh:
    """Return a capsule between the centres of its ends [m]."""
    along = np.asarray(end, float) - begin
    length = float(np.linalg.norm(along))
    mesh = rounded((radius, radius, radius + length / 2), radius, steps)
    return mesh.moved(_basis(along / length if length else np.array([0.0, 0.0, 1.0])), (begin + np.asarray(end)) / 2)


def carrier(positions: np.ndarray, normals: np.ndarray, pitch: float) -> Mesh:
    """Return what lies below the taxels of a patch: a thin plate; if they are not flat or have gaps, one for each."""
    normal = normals.mean(axis=0)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
    turn = _basis(normal)
    flat = (positions - positions.mean(axis=0)) @ turn
    extent = max(float(np.ptp(flat[:, :2], axis=0).max()), pitch)
    is_flat = np.abs(normals - normal).max() < _FLAT and np.ptp(flat[:, 2]) < _FLAT * extent
    if is_flat:
        outline = _offset(hull(flat[:, :2]), _MARGIN_PITCHES * pitch)
        if _area(outline) < _MAX_PITCHES_SQUARED * (len(positions) + 3) * pitch**2:
            return _plate(outline, 0.5 * pitch).moved(turn, positions.mean(axis=0))
    tile = _plate(0.68 * pitch * _circle(8), 0.35 * pitch)
    return joined([tile.moved(_basis(n), p - 0.05 * pitch * n) for p, n in zip(positions, normals)])


def hull(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull of points in a plane, counterclockwise, shape ``(n, 2)``."""
    ordered = np.unique(np.round(points, 9), axis=0)
    if len(ordered) < 3:
        return ordered
    halves = []
    for run in (ordered, ordered[::-1]):
        chain: list[np.ndarray] = []
        for point in run:
            while len(chain) > 1 and _cross(chain[-1] - chain[-2], point - chain[-1]) <= 1e-15:
                chain.pop()
            chain.append(point)
        halves += chain[:-1]
    return np.array(halves)


def _cross(first: np.ndarray, second: np.ndarray) -> float:
    return float(first[0] * second[1] - first[1] * second[0])


def _circle(corners: int) -> np.ndarray:
    turns = 2 * np.pi * np.arange(corners) / corners
    return np.stack([np.cos(turns), np.sin(turns)], axis=1)


def _offset(corners: np.ndarray, margin: float) -> np.ndarray:
    """Return a convex outline that is wider by a margin, with round corners."""
    return hull((corners[:, None] + margin * _circle(_CORNERS)).reshape(-1, 2))


def _area(outline: np.ndarray) -> float:
    x, y = outline.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def _plate(outline: np.ndarray, thickness: float) -> Mesh:
    """Return a plate whose top lies at z = 0, with a bevelled edge."""
    n, bevel, middle = len(outline), 0.4 * thickness, outline.mean(axis=0)
    inward = middle - outline
    inset = outline + bevel * inward / np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-9)
    levels = [(outline, -thickness), (outline, -bevel), (inset, 0.0)]
    rings = [np.column_stack([ring, np.full(n, z)]) for ring, z in levels]
    a, b, faces = np.arange(n), (np.arange(n) + 1) % n, []
    for level in (0, n):
        faces += [np.stack([a + level, b + level, b + level + n], axis=1)]
        faces += [np.stack([a + level, b + level + n, a + level + n], axis=1)]
    faces.append(np.stack([a + 2 * n, b + 2 * n, np.full(n, 3 * n)], axis=1))
    faces.append(np.stack([np.zeros(n - 2, int), a[2:], a[1:-1]], axis=1))
    return Mesh(np.concatenate([*rings, [[*middle, 0.0]]]), np.concatenate(faces))


def _basis(normal: np.ndarray) -> np.ndarray:
    """Return a rotation matrix whose third column is the normal; the first lies as near to x as it can."""
    seed = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = seed - normal * (seed @ normal)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal, right), normal], axis=1)
