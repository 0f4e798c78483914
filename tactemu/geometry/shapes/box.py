"""A cuboid. Formula: Inigo Quilez' exact distance."""

# pyright: reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tactemu.base.units import Length
from tactemu.geometry.shapes.rays import line_pieces
from tactemu.geometry.shapes.shape import FAR, Row, Shape, ShapeKind, table_type


@dataclass(frozen=True, kw_only=True)
class Box(Shape):
    """A cuboid around the origin, with edges along the axes."""

    size: Annotated[tuple[Length, Length, Length], "full extents along x, y, z [m]"]

    other_words = dict.fromkeys(
        ("half_extents", "half_size", "hx", "hy", "hz", "extents", "lower", "upper"), "size=(x, y, z), full extents [m]"
    )
    mujoco_geom = "box"

    def row(self, name: str, device) -> Row:
        x, y, z = (0.5 * float(extent) for extent in self.size)
        return Row(BOX, (x, y, z), float(np.linalg.norm((x, y, z))), half=(x, y, z))

    def reach(self, name: str, direction: np.ndarray) -> float:
        return float(np.abs(direction) @ np.asarray(self.size, float)) / 2

    def sample(self, name: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        size = np.asarray(self.size, dtype=np.float64)
        areas = np.prod(size) / size  # the area of one face across each axis
        axis = rng.choice(3, size=count, p=areas / areas.sum())
        points = (rng.random((count, 3)) - 0.5) * size
        points[np.arange(count), axis] = 0.5 * size[axis] * rng.choice([-1.0, 1.0], size=count)
        return points, float(2.0 * areas.sum())

    @classmethod
    def from_mujoco(cls, size: list[float]) -> "Box":
        return cls(size=(2 * size[0], 2 * size[1], 2 * size[2]))


@functools.cache
def _distance(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def sign(x: real):
        return wp.where(x < real(0.0), real(-1.0), real(1.0))

    @wp.func
    def to_box(shapes: shapes_type, b: int, p: vec3):
        q = wp.abs(p) - shapes.size[b]
        outside = wp.max(q, vec3(real(0.0)))
        far = wp.length(outside)
        if far > real(0.0):
            n = outside / far
            return far, vec3(n[0] * sign(p[0]), n[1] * sign(p[1]), n[2] * sign(p[2]))
        axis = int(0)
        if q[1] > q[axis]:
            axis = 1
        if q[2] > q[axis]:
            axis = 2
        n = vec3(real(0.0))
        n[axis] = sign(p[axis])
        return q[axis], n

    return to_box


@functools.cache
def _ray(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    slab = line_pieces(real).slab

    @wp.func
    def through_box(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        first = real(-FAR)
        last = real(FAR)
        for k in range(3):
            enters, leaves = slab(o[k], d[k], shapes.size[b][k])
            first = wp.max(first, enters)
            last = wp.min(last, leaves)
        if first > last:
            first = real(FAR)
            last = real(-FAR)
        return first, last

    return through_box


BOX = ShapeKind("box", _distance, _ray)
