"""A cylinder. Formula: Inigo Quilez' exact distance of the capped cylinder."""

# pyright: reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tactemu.base.units import Length
from tactemu.geometry.shapes.rays import line_pieces
from tactemu.geometry.shapes.shape import Row, Shape, ShapeKind, table_type
from tactemu.geometry.shapes.surface import on_side


@dataclass(frozen=True, kw_only=True)
class Cylinder(Shape):
    """A cylinder with flat ends, along z around the origin."""

    radius: Annotated[Length, "[m]"]
    length: Annotated[Length, "along z [m]"]

    other_words = dict.fromkeys(
        ("half_height", "half_length", "height", "size"), "length=, the full extent along z [m]"
    )
    mujoco_geom = "cylinder"

    def row(self, name: str, device) -> Row:
        r, top = self.radius, self.length / 2
        return Row(CYLINDER, (r, top, 0.0), float(np.hypot(r, top)), half=(r, r, top))

    def reach(self, name: str, direction: np.ndarray) -> float:
        return self.radius * math.hypot(direction[0], direction[1]) + abs(float(direction[2])) * self.length / 2

    def sample(self, name: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        side, ends = 2.0 * np.pi * self.radius * self.length, 2.0 * np.pi * self.radius**2
        points = on_side(self.radius, self.length, count, rng)
        on_end = rng.random(count) >= side / (side + ends)
        n = int(on_end.sum())
        points[on_end, :2] *= np.sqrt(rng.random((n, 1)))
        points[on_end, 2] = 0.5 * self.length * rng.choice([-1.0, 1.0], size=n)
        return points, side + ends

    @classmethod
    def from_mujoco(cls, size: list[float]) -> "Cylinder":
        return cls(radius=size[0], length=2 * size[1])


@functools.cache
def _distance(real):
    import warp as wp

    vec3, vec2, shapes_type = wp.types.vector(3, real), wp.types.vector(2, real), table_type(real)

    @wp.func
    def to_cylinder(shapes: shapes_type, b: int, p: vec3):
        size = shapes.size[b]
        across = wp.length(vec2(p[0], p[1]))
        q = vec2(across - size[0], wp.abs(p[2]) - size[1])
        out = vec2(wp.max(q[0], real(0.0)), wp.max(q[1], real(0.0)))
        far = wp.length(out)
        inverse = real(0.0)
        if across > real(0.0):
            inverse = real(1.0) / across
        radial = vec3(p[0] * inverse, p[1] * inverse, real(0.0))
        axial = vec3(real(0.0), real(0.0), wp.where(p[2] < real(0.0), real(-1.0), real(1.0)))
        if far > real(0.0):
            return far, (out[0] * radial + out[1] * axial) / far
        if q[0] > q[1]:
            return q[0], radial
        return q[1], axial

    return to_cylinder


@functools.cache
def _ray(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    tube = line_pieces(real).tube

    @wp.func
    def through_cylinder(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        return tube(o, d, shapes.size[b][0], shapes.size[b][1])

    return through_cylinder


CYLINDER = ShapeKind("cylinder", _distance, _ray)
