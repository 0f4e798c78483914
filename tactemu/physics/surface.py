"""Triangles of a shape's surface, for sampling points on it."""

from __future__ import annotations

import numpy as np

from tactemu.errors import SceneError
from tactemu.physics.mesh import load_mesh
from tactemu.scene import bodies


def surface_triangles(shape: bodies.Shape, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices ``(n, 3)`` [m] in the body's frame, and faces ``(m, 3)``. Round shapes are finely tessellated.

    Args:
        shape: of a body.
        name: of the body, for messages.

    Raises:
        SceneError: the shape has no finite surface of its own (a plane, a grid of distances): points must be given.
        MeshError: a mesh cannot be used.
    """
    import trimesh

    match shape:
        case bodies.Sphere(radius=radius):
            mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
        case bodies.Box(size=size):
            mesh = trimesh.creation.box(extents=np.asarray(size, dtype=np.float64))
        case bodies.Capsule(radius=radius, length=length):
            mesh = trimesh.creation.capsule(radius=radius, height=length, count=[64, 64])
            mesh.apply_translation(-mesh.bounds.mean(axis=0))
        case bodies.Cylinder(radius=radius, length=length):
            mesh = trimesh.creation.cylinder(radius=radius, height=length, sections=128)
        case bodies.Mesh(source=source, scale=scale):
            mesh = load_mesh(source, scale, name=f"mesh of body {name!r}")
        case _:
            kind = type(shape).__name__
            raise SceneError(f"body {name!r}: a {kind} has no surface to sample points on; give them (points=...)")
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces)


def project_onto(shape: bodies.Shape, points: np.ndarray) -> np.ndarray:
    """Move points of a tessellation onto the round surface that it stands for. Others stay as they are."""
    match shape:
        case bodies.Sphere(radius=radius):
            axis = np.zeros_like(points)
        case bodies.Capsule(radius=radius, length=length):
            axis = np.zeros_like(points)
            axis[:, 2] = np.clip(points[:, 2], -length / 2, length / 2)
        case bodies.Cylinder(radius=radius, length=length):
            side = np.abs(points[:, 2]) < (0.5 - 1e-9) * length
            axis = np.where(side[:, None], points * [0.0, 0.0, 1.0], points)
        case _:
            return points
    away = points - axis
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    return np.where(distance > 0, axis + away * (radius / np.where(distance > 0, distance, 1.0)), points)
