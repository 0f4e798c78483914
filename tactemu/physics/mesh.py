"""Triangle meshes: loading them, judging them, and the exact distance to them by a bounding volume hierarchy.

Meshes are stored scaled to unit extent, so that nanometres and kilometres are the same to Warp's float32 queries.
"""

import functools
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

from tactemu.errors import MeshError

log = logging.getLogger(__name__)

FARTHEST = 1.0e6
"""How far a query looks, in units of the mesh's extent."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh that has passed :func:`load_mesh`: metres, body frame."""

    name: str
    vertices: np.ndarray
    """Shape ``(n, 3)``, float64."""
    faces: np.ndarray
    """Shape ``(m, 3)``, int32, counter-clockwise seen from outside."""
    closed: bool

    @property
    def extent(self) -> float:
        """Largest distance of a vertex from the origin [m]."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def _read(source, name: str):
    """Vertices and faces of a path, a ``trimesh.Trimesh`` or a pair of arrays."""
    if isinstance(source, str | Path):
        path = Path(source)
        if not path.is_file():
            raise MeshError(f"mesh {path}: no such file (looked in {Path.cwd()}); give the full path")
        import trimesh

        try:
            source = trimesh.load(path, force="mesh", process=False)
        except Exception as error:
            raise MeshError(
                f"mesh {path}: trimesh cannot read it ({error}); formats: STL, OBJ, PLY, OFF, GLB"
            ) from None
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        return np.asarray(source.vertices), np.asarray(source.faces)
    try:
        vertices, faces = source
    except (TypeError, ValueError):
        raise MeshError(
            f"{name}: expected a path, a trimesh.Trimesh or (vertices, faces), got {type(source)}"
        ) from None
    return np.asarray(vertices), np.asarray(faces)


def load_mesh(source, scale=1.0, name: str = "mesh") -> Triangles:
    """Load a mesh and refuse what has no distance.

    Raises:
        MeshError: the file is missing or not readable, there are no triangles, numbers are not finite, or the scale
            is not positive. The message says which.
    """
    vertices, faces = _read(source, name)
    if isinstance(source, str | Path):
        name = f"mesh {source}"
    factor = np.asarray(scale, float)
    if factor.shape not in ((), (3,)) or not (np.isfinite(factor).all() and (factor > 0).all()):
        raise MeshError(f"{name}: scale must be > 0, one number or one per axis, got {scale!r}")
    vertices = np.ascontiguousarray(np.asarray(vertices, np.float64) * factor)
    faces = np.ascontiguousarray(faces, np.int32)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise MeshError(f"{name}: expected (n, 3) vertices and (m, 3) faces, got {vertices.shape} and {faces.shape}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(f"{name}: faces name vertices {faces.min()}..{faces.max()}, there are {len(vertices)}")
    bad = np.flatnonzero(~np.isfinite(vertices).all(1))
    if len(bad):
        raise MeshError(f"{name}: vertex {bad[0]} is not finite {vertices[bad[0]]} ({len(bad)} such)")
    return Triangles(name, vertices, faces, closed=True)


def build_mesh(triangles: Triangles, device) -> tuple[wp.Mesh, float]:
    """The query structure, and the metres that one of its units stands for."""
    unit = triangles.extent
    points = wp.array((triangles.vertices / unit).astype(np.float32), dtype=wp.vec3, device=device)
    indices = wp.array(triangles.faces.reshape(-1), dtype=wp.int32, device=device)
    return wp.Mesh(points=points, indices=indices, support_winding_number=True), unit


@functools.cache
def mesh_functions(real):
    """``mesh_distance(mesh, unit, p) -> (signed distance, normal)`` of a point in the body's frame."""
    vec3 = wp.types.vector(3, real)

    @wp.func
    def mesh_distance(mesh: wp.uint64, unit: real, p: vec3):
        inverse = real(1.0) / unit
        q = wp.vec3(wp.float32(p[0] * inverse), wp.float32(p[1] * inverse), wp.float32(p[2] * inverse))
        hit = wp.mesh_query_point_sign_winding_number(mesh, q, wp.float32(FARTHEST))
        d = real(1.0e18)
        n = vec3(real(0.0))
        if hit.result:
            away = q - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v)
            length = wp.length(away)
            d = real(hit.sign * length) * unit
            m = wp.mesh_eval_face_normal(mesh, hit.face)
            if length > 1.0e-6:
                m = away * (hit.sign / length)
            n = vec3(real(m[0]), real(m[1]), real(m[2]))
        return d, n

    return mesh_distance
