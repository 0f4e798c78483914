"""Reading, checking and repair of triangle meshes.

A mesh is checked before anything is computed. A mesh without a defined distance is refused. Defects that can be
repaired (degenerate triangles, a surface that is inside out, vertices given once per triangle) are repaired and logged.
A surface with holes is used with a warning; its inside is the space that it mostly encloses.
"""

import functools
import gc
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from tactemu.base.errors import MeshError

log = logging.getLogger(__name__)

MANY_FACES = 100_000
"""Number of faces from which on memory is given back while a mesh is read."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh that has passed :func:`load_mesh`: metres, body frame."""

    name: str
    vertices: np.ndarray
    """Shape ``(n, 3)``, float64."""
    faces: np.ndarray
    """Shape ``(m, 3)``, int32, counter-clockwise seen from outside."""
    closed: bool
    """True if every edge belongs to two triangles."""
    slivers: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    """Triangles without an area that lie between the faces, shape ``(k, 3)``."""

    def shells(self) -> int:
        """Return the number of connected surfaces, which share no vertex with one another."""
        label = np.arange(len(self.vertices))
        while True:
            least = label.copy()
            np.minimum.at(least, self.faces, label[self.faces].min(1)[:, None])
            least = least[least]
            if np.array_equal(least, label):
                return len(np.unique(label[self.faces]))
            label = least

    @property
    def bound(self) -> float:
        """Largest distance of a vertex from the body's origin [m]."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


@functools.lru_cache(maxsize=4)
def _read_file(path: Path, _changed_ns: int, _size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a mesh file, read once for its extent, its outline and its triangles."""
    import trimesh

    mesh = cast(Any, trimesh.load(path, force="mesh", process=False))
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    del mesh
    if len(faces) > MANY_FACES:
        gc.collect()  # its parts refer to one another: they would stay, several times as large as the arrays
    return _compact(vertices, faces)


def extent_of_file(path: Path, scale: float, name: str) -> float:
    """Return the longest side of the box around a mesh file's vertices [m].

    Raises:
        MeshError: the file cannot be read.
    """
    vertices, _ = _read(path, name)
    return float(np.ptp(np.asarray(vertices, float), axis=0).max(initial=0.0) * scale) if len(vertices) else 0.0


def _read(source, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a path, a ``trimesh.Trimesh`` or a pair of arrays."""
    if isinstance(source, str | Path):
        path = Path(source)
        if not path.is_file():
            raise MeshError(f"{name}: there is no such file (looked in {Path.cwd()}); give the full path")
        status = path.stat()
        try:
            return _read_file(path.resolve(), status.st_mtime_ns, status.st_size)
        except Exception as error:
            raise MeshError(f"{name}: trimesh cannot read it ({error}); try STL, OBJ, PLY, OFF or GLB") from None
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        return np.asarray(source.vertices), np.asarray(source.faces)
    try:
        vertices, faces = source
    except (TypeError, ValueError):
        expected = "a path, a trimesh.Trimesh or (vertices, faces)"
        raise MeshError(f"{name}: expected {expected}, got {type(source).__name__}") from None
    return np.asarray(vertices), np.asarray(faces)


def load_mesh(source, scale: float | Sequence[float] = 1.0, name: str = "mesh") -> Triangles:
    """Read a mesh, repair it where possible, and return its triangles.

    Args:
        source: a path, a ``trimesh.Trimesh``, or ``(vertices, faces)``.
        scale: metres per unit of the source, one number or one per axis.
        name: the name in messages; a path is appended.

    Raises:
        MeshError: the file is missing or unreadable, there are no triangles or none with an area, numbers are not
            finite, faces name vertices that do not exist, neighbours are wound against each other, or the scale is
            not positive.
    """
    if isinstance(source, str | Path):
        name = f"{name} ({source})"
    vertices, faces = _read(source, name)
    vertices, faces = _checked_arrays(vertices, faces, name)
    given = len(faces)
    vertices, faces = _compact(vertices * _checked_scale(scale, name), faces)
    faces = _without_points(faces)
    closed = len(faces) > 0 and _is_closed(faces, name)
    faces, slivers = _without_slivers(vertices, faces, given, name)
    if closed and _volume(vertices, faces) < 0.0:
        log.warning("%s is inside out: its faces are reversed", name)
        faces, slivers = np.ascontiguousarray(faces[:, ::-1]), slivers[:, ::-1]
    return Triangles(name, np.ascontiguousarray(vertices), faces, closed, slivers)


def _checked_arrays(vertices: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise MeshError(f"{name}: expected (n, 3) vertices and (m, 3) faces, got {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu" or faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(f"{name}: faces must name vertices 0..{len(vertices) - 1}, got {faces.min()}..{faces.max()}")
    vertices = vertices.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(vertices).all(1))
    if len(bad):
        raise MeshError(f"{name}: vertex {bad[0]} is not finite: {vertices[bad[0]]} ({len(bad)} such vertices)")
    return vertices, faces.astype(np.int32)


def _checked_scale(scale, name: str) -> np.ndarray:
    factor = np.asarray(scale, float)
    if factor.shape not in ((), (3,)) or not (np.isfinite(factor).all() and (factor > 0).all()):
        raise MeshError(f"{name}: scale must be > 0, one number or one per axis, got {scale!r}")
    return factor


def _compact(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each vertex that faces use once, in the order given, and the faces (int32) of these vertices.

    Arrays that :func:`_checked_arrays` refuses are returned as they are.
    """
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices) or not np.isfinite(vertices).all():
        return vertices, faces
    faces = _merged(vertices, faces)
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    return vertices[used], (np.cumsum(used, dtype=np.int32) - 1)[faces]


def _merged(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return faces that share one vertex wherever positions are equal bit for bit (STL repeats them per triangle)."""
    odd = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)

    def mixed(axis: int) -> np.ndarray:
        bits = (vertices[:, axis].astype(np.float64) + 0.0).view(np.uint64)  # adding 0.0 makes -0.0 equal to 0.0
        return (bits ^ (bits >> np.uint64(29))) * odd[axis]

    with np.errstate(over="ignore"):
        key = mixed(0)
        key ^= mixed(1) * odd[2]
        key ^= (mixed(2) >> np.uint64(7)) * odd[0]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    same = first.astype(np.int32)[inverse]
    if not all(np.array_equal(vertices[same, axis], vertices[:, axis]) for axis in range(3)):
        return faces  # two keys collided: this is unlikely, and harmless
    return same[faces]


def _without_points(faces: np.ndarray) -> np.ndarray:
    """Return the faces without triangles that name a vertex twice: their neighbours share the edge that remains."""
    a, b, c = faces.T
    return np.ascontiguousarray(faces[(a != b) & (b != c) & (c != a)])


def _without_slivers(vertices: np.ndarray, faces: np.ndarray, given: int, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces with an area, and those without: Warp finds no distance to the latter.

    Call it after the edges were checked, since a triangle without an area may close a surface.
    """
    corners = vertices[faces]
    extent = np.ptp(corners.reshape(-1, 3), axis=0).max() if len(faces) else 0.0
    sides = (np.roll(corners, -1, axis=1) - corners) / (extent or 1.0)
    longest = np.linalg.norm(sides, axis=2).max(1, initial=0.0)
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    proper = area > longest * np.maximum(1e-6 * longest, 1e-7)
    if not proper.any():
        raise MeshError(f"{name}: no triangle has an area; check the scale, and that not all vertices are in one line")
    dropped = given - int(proper.sum())
    if dropped:
        log.warning("%s: %d of %d triangles have no area and are dropped", name, dropped, given)
    return np.ascontiguousarray(faces[proper]), faces[~proper]


def _is_closed(faces: np.ndarray, name: str) -> bool:
    """Return True if every edge belongs to two triangles, in opposite directions.

    Raises:
        MeshError: neighbouring triangles are wound against each other.
    """
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end).astype(np.int64), np.maximum(start, end)
    edge = low * (int(faces.max()) + 1) + high
    _, inverse, uses = np.unique(edge, return_inverse=True, return_counts=True)
    turns = np.bincount(inverse, weights=np.where(start < end, 1.0, -1.0))
    against = int(((uses == 2) & (turns != 0)).sum())
    if against:
        raise MeshError(
            f"{name}: at {against} of {len(uses)} edges neighbouring triangles are wound against each other, so that "
            "inside and outside are not defined; repair it with trimesh.repair.fix_normals(mesh)"
        )
    holes = int((uses % 2 == 1).sum())
    if holes:
        log.warning("%s is not closed (%d edges on a border): inside is the space that it mostly encloses", name, holes)
    return not holes


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = ((vertices - vertices[faces[0, 0]])[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)))
