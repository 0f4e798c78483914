"""A cylinder with round ends. Formula: Inigo Quilez' exact distance."""

# pyright: reportCallIssue=false, reportArgumentType=false

import functools
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tactemu.base.units import Length
from tactemu.geometry.shapes.rays import line_pieces
from tactemu.geometry.shapes.shape import Row, Shape, ShapeKind, table_type
from tactemu.geometry.shapes.surface import directions, on_side


@dataclass(frozen=True, kw_only=True)
class Capsule(Shape):
    """A cylinder with round ends, along z around the origin; its total length is ``length + 2 * radius``."""

    radius: Annotated[Length, "[m]"]
    length: Annotated[Length, "of the straight part, along z [m]"]

    other_words = dict.fromkeys(
        ("half_height", "half_length", "height", "size"), "length=, the full extent of the straight part along z [m]"
    )
    mujoco_geom = "capsule"

    def row(self, name: str, device) -> Row:
        r, top = self.radius, self.radius + self.length / 2
        return Row(CAPSULE, (r, self.length / 2, 0.0), top, half=(r, r, top))

    def reach(self, name: str, direction: np.ndarray) -> float:
        return self.radius + abs(float(direction[2])) * self.length / 2

    def sample(self, name: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        side, ends = 2.0 * np.pi * self.radius * self.length, 4.0 * np.pi * self.radius**2
        points = self.radius * directions(count, rng)
        points[:, 2] += np.copysign(0.5 * self.length, points[:, 2])
        straight = rng.random(count) < side / (side + ends)
        points[straight] = on_side(self.radius, self.length, int(straight.sum()), rng)
        return points, side + ends

    @classmethod
    def from_mujoco(cls, size: list[float]) -> "Capsule":
        return cls(radius=size[0], length=2 * size[1])


@functools.cache
def _distance(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def to_capsule(shapes: shapes_type, b: int, p: vec3):
        size = shapes.size[b]
        d = vec3(p[0], p[1], p[2] - wp.clamp(p[2], -size[1], size[1]))
        return wp.length(d) - size[0], wp.normalize(d)

    return to_capsule


@functools.cache
def _ray(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    pieces = line_pieces(real)
    tube, ball = pieces.tube, pieces.ball

    @wp.func
    def through_capsule(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        size = shapes.size[b]
        top = vec3(real(0.0), real(0.0), size[1])
        first, last = tube(o, d, size[0], size[1])
        above, from_above = ball(o, d, top, size[0])
        below, from_below = ball(o, d, -top, size[0])
        return wp.min(first, wp.min(above, below)), wp.max(last, wp.max(from_above, from_below))

    return through_capsule


CAPSULE = ShapeKind("capsule", _distance, _ray)
