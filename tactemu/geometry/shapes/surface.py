"""Random points on surfaces, uniform by area, for the shapes' sampling."""

import numpy as np

from tactemu.base.errors import SceneError


def directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return random unit vectors, uniform over the sphere, ``(count, 3)``."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def on_side(radius: float, length: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return random points on the curved side of a cylinder along z, ``(count, 3)``."""
    angle = 2.0 * np.pi * rng.random(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), length * (rng.random(count) - 0.5)], axis=1)


def sample_triangles(
    vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Return random points on triangles, ``(count, 3)``, and the triangles' area; those without area get no points.

    Raises:
        SceneError: the triangles have no area at all.
    """
    a, b, c = (np.asarray(vertices, dtype=np.float64)[np.asarray(faces)[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    total = float(areas.sum())
    if not (np.isfinite(total) and total > 0.0):
        raise SceneError(f"the surface has an area of {total} m^2: points cannot be sampled on it")
    triangle = rng.choice(len(areas), size=count, p=areas / total)
    s, t = rng.random((2, count, 1))
    root = np.sqrt(s)
    return (1.0 - root) * a[triangle] + root * (1.0 - t) * b[triangle] + root * t * c[triangle], total
