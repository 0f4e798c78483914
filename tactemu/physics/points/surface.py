"""Random points on the surface of a shape, evenly by area."""

from __future__ import annotations

import numpy as np

from tactemu.errors import SceneError
from tactemu.physics.shapes.mesh import load_mesh
from tactemu.scene import bodies


def sample_shape(shape: bodies.Shape, name: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """``count`` points ``(count, 3)`` [m] in the body's frame, and the area of the surface [m^2].

    Args:
        shape: of a body.
        name: of the body, for messages.

    Raises:
        SceneError: the shape has no finite surface of its own (a plane, a grid of distances): points must be given.
        MeshError: a mesh cannot be used.
    """
    match shape:
        case bodies.Sphere(radius=radius):
            return radius * _directions(count, rng), 4.0 * np.pi * radius**2
        case bodies.Box(size=size):
            return _on_box(np.asarray(size, dtype=np.float64), count, rng)
        case bodies.Capsule(radius=radius, length=length):
            return _on_capsule(radius, length, count, rng)
        case bodies.Cylinder(radius=radius, length=length):
            return _on_cylinder(radius, length, count, rng)
        case bodies.Mesh(source=source, scale=scale):
            triangles = load_mesh(source, scale, name=f"mesh of body {name!r}")
            return sample_triangles(triangles.vertices, triangles.faces, count, rng)
    kind = type(shape).__name__
    raise SceneError(f"body {name!r}: a {kind} has no surface to sample points on; give them (points=...)")


def sample_triangles(
    vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Points on triangles, and their area. Triangles without area get none.

    Raises:
        SceneError: the triangles have no area at all.
    """
    a, b, c = (np.asarray(vertices, dtype=np.float64)[np.asarray(faces)[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    total = float(areas.sum())
    if not (np.isfinite(total) and total > 0.0):
        raise SceneError(f"the surface has an area of {total} m^2: nothing to sample points on")
    triangle = rng.choice(len(areas), size=count, p=areas / total)
    s, t = rng.random((2, count, 1))
    root = np.sqrt(s)
    return (1.0 - root) * a[triangle] + root * (1.0 - t) * b[triangle] + root * t * c[triangle], total


def _directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors, evenly over the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _on_box(size: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    areas = np.prod(size) / size  # of one face across each axis
    axis = rng.choice(3, size=count, p=areas / areas.sum())
    points = (rng.random((count, 3)) - 0.5) * size
    points[np.arange(count), axis] = 0.5 * size[axis] * rng.choice([-1.0, 1.0], size=count)
    return points, float(2.0 * areas.sum())


def _on_side(radius: float, length: float, count: int, rng: np.random.Generator) -> np.ndarray:
    angle = 2.0 * np.pi * rng.random(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), length * (rng.random(count) - 0.5)], axis=1)


def _on_capsule(radius: float, length: float, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    side, ends = 2.0 * np.pi * radius * length, 4.0 * np.pi * radius**2
    points = radius * _directions(count, rng)
    points[:, 2] += np.copysign(0.5 * length, points[:, 2])
    on_side = rng.random(count) < side / (side + ends)
    points[on_side] = _on_side(radius, length, int(on_side.sum()), rng)
    return points, side + ends


def _on_cylinder(radius: float, length: float, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    side, ends = 2.0 * np.pi * radius * length, 2.0 * np.pi * radius**2
    points = _on_side(radius, length, count, rng)
    on_end = rng.random(count) >= side / (side + ends)
    n = int(on_end.sum())
    points[on_end, :2] *= np.sqrt(rng.random((n, 1)))
    points[on_end, 2] = 0.5 * length * rng.choice([-1.0, 1.0], size=n)
    return points, side + ends
