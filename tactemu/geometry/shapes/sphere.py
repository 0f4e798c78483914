"""A ball."""

import functools
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tactemu.base.units import Length
from tactemu.geometry.shapes.rays import line_pieces
from tactemu.geometry.shapes.shape import Row, Shape, ShapeKind, table_type
from tactemu.geometry.shapes.surface import directions


@dataclass(frozen=True, kw_only=True)
class Sphere(Shape):
    """A ball around the origin."""

    radius: Annotated[Length, "[m]"]

    other_words = dict.fromkeys(("diameter", "size"), "radius= [m]")
    mujoco_geom = "sphere"

    def row(self, name: str, device) -> Row:
        r = self.radius
        return Row(SPHERE, (r, 0.0, 0.0), r, half=(r, r, r))

    def reach(self, name: str, direction: np.ndarray) -> float:
        return self.radius

    def sample(self, name: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        return self.radius * directions(count, rng), 4.0 * np.pi * self.radius**2

    @classmethod
    def from_mujoco(cls, size: list[float]) -> "Sphere":
        return cls(radius=size[0])


@functools.cache
def _distance(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def to_sphere(shapes: shapes_type, b: int, p: vec3):
        return wp.length(p) - shapes.size[b][0], wp.normalize(p)

    return to_sphere


@functools.cache
def _ray(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    ball = line_pieces(real).ball

    @wp.func
    def through_sphere(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        return ball(o, d, vec3(real(0.0)), shapes.size[b][0])

    return through_sphere


SPHERE = ShapeKind("sphere", _distance, _ray, is_oriented=False, is_voxelised=False)
