"""A half-space."""

import functools
from dataclasses import dataclass

import numpy as np

from tactemu.geometry.shapes.rays import PARALLEL_SINE
from tactemu.geometry.shapes.shape import FAR, Row, Shape, ShapeKind, table_type


@dataclass(frozen=True, kw_only=True)
class Plane(Shape):
    """The half-space z <= 0 of its own frame: solid below, free above."""

    mujoco_geom = "plane"

    def row(self, name: str, device) -> Row:
        return Row(PLANE, bound=FAR)

    def reach(self, name: str, direction: np.ndarray) -> float:
        """Return 0: the surface passes through the origin, and a plane is assumed to press face on."""
        return 0.0

    @classmethod
    def from_mujoco(cls, size: list[float]) -> "Plane":
        return cls()


@functools.cache
def _distance(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def to_plane(shapes: shapes_type, b: int, p: vec3):
        return p[2], vec3(real(0.0), real(0.0), real(1.0))

    return to_plane


@functools.cache
def _ray(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def through_plane(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        first = real(FAR)
        last = real(-FAR)
        if wp.abs(d[2]) < real(PARALLEL_SINE):
            if o[2] <= real(0.0):
                first = real(-FAR)
                last = real(FAR)
        else:
            at = -o[2] / d[2]
            if d[2] < real(0.0):
                first = at
                last = real(FAR)
            else:
                first = real(-FAR)
                last = at
        return first, last

    return through_plane


PLANE = ShapeKind("plane", _distance, _ray, is_voxelised=False)
