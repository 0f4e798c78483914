"""The distance to a textured shape, and the place where a line enters it: those of its smooth shape, and a height.

:func:`textured` wraps a kind of shape, so that kernels for scenes without textures contain nothing of them. The theory
is in :mod:`tactemu.geometry.shapes.texture`.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import dataclasses
import functools
import math

from tactemu.geometry.shapes.shape import FAR, Row, ShapeKind, table_type
from tactemu.geometry.shapes.texture import Texture

LEAST_COSINE = 0.2
"""Smallest cosine between a line and the normal that moves its place of entry; bounds the move at five heights."""
LEAST_SHARE = 1.0e-6
"""Square of a component of the normal below which its function is left out."""


def textured(row: Row, texture: Texture | None) -> Row:
    """Return a shape's row with a texture; the row itself without one."""
    if texture is None or row.kind is None:
        return row
    own = texture.row
    # Kinds differ in the power of two above their slopes, not in each slope: few are compiled.
    slope = 0.0 if own.slope <= 0 else 2.0 ** math.ceil(math.log2(own.slope))
    kind = _textured_kind(row.kind, own.is_map, slope)
    return dataclasses.replace(row, kind=kind, bound=row.bound + own.peak, texture=own)


@functools.cache
def _textured_kind(kind: ShapeKind, is_map: bool, slope: float) -> ShapeKind:
    """Return the kind of a shape with a map or a spectrum of this slope or less."""
    searches = kind.without_search
    return dataclasses.replace(
        kind,
        name=f"{kind.name} with a {'map' if is_map else 'spectrum'} of slope {slope:g}",
        distance=_distance_of(kind.distance, is_map),
        ray=_ray_of(kind.distance, kind.ray, is_map),
        lower_bound=None if kind.lower_bound is None else _lower_bound_of(kind.lower_bound),
        without_search=None if searches is None else _distance_of(searches, is_map),
        is_oriented=True,
        max_slope=kind.max_slope + slope,
    )


@functools.cache
def height_function(real, is_map: bool):
    """Return the Warp function ``height(shapes, b, x, n)``: the height [m] at ``x`` on the smooth surface with the
    normal ``n``, body frame; 0 where there is no normal."""
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def wrapped(i: int, n: int):
        """Return the index of a grid that repeats."""
        rest = i % n
        return wp.where(rest < 0, rest + n, rest)

    @wp.func
    def on_map(shapes: shapes_type, b: int, u: real, v: real):
        shape = shapes.textures.shape[b]
        start = shapes.textures.start[b]
        x = u / shapes.textures.step[b]
        y = v / shapes.textures.step[b]
        i = int(wp.floor(x))
        j = int(wp.floor(y))
        x -= wp.floor(x)
        y -= wp.floor(y)
        here = start + wrapped(i, shape[0]) * shape[1]
        below = start + wrapped(i + 1, shape[0]) * shape[1]
        left = wrapped(j, shape[1])
        right = wrapped(j + 1, shape[1])
        values = shapes.textures.values
        first = (real(1.0) - y) * values[here + left] + y * values[here + right]
        second = (real(1.0) - y) * values[below + left] + y * values[below + right]
        return (real(1.0) - x) * first + x * second

    @wp.func
    def of_waves(shapes: shapes_type, b: int, u: real, v: real):
        start = shapes.textures.start[b]
        values = shapes.textures.values
        total = real(0.0)
        for k in range(shapes.textures.shape[b][0]):
            at = start + 4 * k
            cycles = u * values[at] + v * values[at + 1] + values[at + 2]
            total += values[at + 3] * wp.cos(real(2.0 * math.pi) * (cycles - wp.floor(cycles)))
        return total

    one = on_map if is_map else of_waves

    @wp.func
    def height(shapes: shapes_type, b: int, x: vec3, n: vec3):
        total = real(0.0)
        for k in range(3):
            share = n[k] * n[k]
            if share > real(LEAST_SHARE):
                total += share * one(shapes, b, x[(k + 1) % 3], x[(k + 2) % 3])
        return total

    return height


@functools.cache
def _distance_of(smooth, is_map: bool):
    """Return the builder of the distance to a textured shape."""

    @functools.cache
    def build(real):
        import warp as wp

        vec3, shapes_type = wp.types.vector(3, real), table_type(real)
        distance, height = smooth(real), height_function(real, is_map)

        @wp.func
        def to_textured(shapes: shapes_type, b: int, p: vec3):
            d, n = distance(shapes, b, p)
            if d > real(-0.5 * FAR):  # a distance that needs a search, where none is made, stays unknown
                d -= height(shapes, b, p - d * n, n)
            return d, n

        return to_textured

    return build


@functools.cache
def _ray_of(smooth_distance, smooth_ray, is_map: bool):
    """Return the builder of the part of a line that lies in a textured shape."""

    @functools.cache
    def build(real):
        import warp as wp

        vec3, shapes_type = wp.types.vector(3, real), table_type(real)
        distance, ray, height = smooth_distance(real), smooth_ray(real), height_function(real, is_map)

        @wp.func
        def through_textured(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
            first, last = ray(shapes, b, o, d, start, end + shapes.textures.peak[b] / real(LEAST_COSINE))
            if first > -start and first < real(FAR):
                _gap, n = distance(shapes, b, o + first * d)
                cosine = wp.max(-wp.dot(n, d), real(LEAST_COSINE))
                # The height where the line meets the smooth surface, then where it meets the texture.
                h = height(shapes, b, o + first * d, n)
                h = height(shapes, b, o + (first - h / cosine) * d - h * n, n)
                first -= h / cosine
            return first, last

        return through_textured

    return build


@functools.cache
def _lower_bound_of(smooth):
    """Return the builder of a bound below the distance to a textured shape."""

    @functools.cache
    def build(real):
        import warp as wp

        vec3, shapes_type = wp.types.vector(3, real), table_type(real)
        bound = smooth(real)

        @wp.func
        def below(shapes: shapes_type, b: int, p: vec3):
            return bound(shapes, b, p) - shapes.textures.peak[b]

        return below

    return build
