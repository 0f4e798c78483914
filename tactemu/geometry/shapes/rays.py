"""The points at which a line, such as a taxel's normal, enters a shape and leaves it.

The distance to the nearest surface stops growing half-way through a thin object and falls again; the distance along
the normal keeps growing. For the line ``o + s d`` (``|d| = 1``) each function returns the first and the last ``s`` in
the solid; without a hit the first is +1e18 and the last -1e18. Convex shapes are exact.
"""

# pyright: reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
from typing import Any, NamedTuple

from tactemu.geometry.shapes.shape import FAR, kind_codes, table_type

PARALLEL_SINE = 1.0e-12
"""Sine of the angle below which a line counts as parallel to a face."""
MAX_TRACE_STEPS = 1024
"""The most steps along a line that is traced by the distance alone."""


class LinePieces(NamedTuple):
    """The Warp functions that the primitives' rays are made of; each returns ``(first, last)``."""

    ball: Any
    """A ball: ``ball(o, d, centre, radius)``."""
    slab: Any
    """The space between two planes, for one coordinate: ``slab(o, d, half)``."""
    tube: Any
    """A cylinder along z: ``tube(o, d, radius, half)``."""


@functools.cache
def line_pieces(real: Any) -> LinePieces:
    """Return the pieces for one float type."""
    import warp as wp

    vec3 = wp.types.vector(3, real)
    vec2 = wp.types.vector(2, real)

    @wp.func
    def ball(o: vec3, d: vec3, centre: vec3, radius: real):
        m = o - centre
        b = wp.dot(m, d)
        across = wp.length(m - b * d)
        first = real(FAR)
        last = real(-FAR)
        if across <= radius:
            # The drop from the ball's pole, since for a large ball the difference of the roots would be rounding.
            drop = across * across / (radius + wp.sqrt((radius - across) * (radius + across)))
            first = (-b - radius) + drop
            last = (-b + radius) - drop
        return first, last

    @wp.func
    def slab(o: real, d: real, half: real):
        first = real(-FAR)
        last = real(FAR)
        if wp.abs(d) < real(PARALLEL_SINE):
            if wp.abs(o) > half:
                first = real(FAR)
                last = real(-FAR)
        else:
            a = (-half - o) / d
            b = (half - o) / d
            first = wp.min(a, b)
            last = wp.max(a, b)
        return first, last

    @wp.func
    def tube(o: vec3, d: vec3, radius: real, half: real):
        first, last = slab(o[2], d[2], half)
        slope = wp.length(vec2(d[0], d[1]))
        if slope < real(PARALLEL_SINE):
            if wp.length(vec2(o[0], o[1])) > radius:
                first = real(FAR)
                last = real(-FAR)
        else:
            across = wp.abs(o[0] * d[1] - o[1] * d[0]) / slope
            if across > radius:
                first = real(FAR)
                last = real(-FAR)
            else:
                middle = -(o[0] * d[0] + o[1] * d[1]) / (slope * slope)
                reach = wp.sqrt((radius - across) * (radius + across)) / slope
                first = wp.max(first, middle - reach)
                last = wp.min(last, middle + reach)
        if first > last:
            first = real(FAR)
            last = real(-FAR)
        return first, last

    return LinePieces(ball, slab, tube)


@functools.cache
def bound_function(real):
    """Return the Warp function ``f(shapes, b, o, d, start) -> start``, which shortens the search along a line.

    The search then begins no farther back than the ball around the shape. The result is 1e18 if the line misses the
    ball.
    """
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def begin(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real):
        across = o - wp.dot(o, d) * d
        if not (wp.dot(across, across) <= shapes.bound[b] * shapes.bound[b]):
            return real(FAR)
        return wp.min(start, wp.length(o) + shapes.bound[b])

    return begin


def traced_ray(real: Any, distance: Any, near: Any = None) -> Any:
    """Return the ray function of a shape that is known by its distance alone: it steps along a line by the distance.

    A shape that is solid from ``-start`` to the skin is entered at ``-start``; ``last`` is 1e18 for every hit.

    Args:
        real: the float type.
        distance: the Warp function of :attr:`ShapeKind.distance`.
        near: Warp function ``f(shapes, b)``: a distance that counts as touching [m]; default: 1e-5 of the size.
    """
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    begin = bound_function(real)

    @wp.func
    def part_of_size(shapes: shapes_type, b: int):
        return real(1.0e-5) * shapes.bound[b]

    near = near or part_of_size

    @wp.func
    def follow(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        back = begin(shapes, b, o, d, start)
        if back == real(FAR):
            return real(FAR), real(-FAR)
        touching = near(shapes, b)
        s = -back
        gap, _n = distance(shapes, b, o + s * d)
        within = gap < real(0.0)
        for _ in range(wp.static(MAX_TRACE_STEPS)):
            gap, _m = distance(shapes, b, o + s * d)
            if within:
                if gap > touching:
                    within = False
                elif s >= real(0.0):
                    return -back, real(FAR)
                s += wp.max(-gap, touching)
            else:
                if gap <= touching:
                    return s + gap, real(FAR)
                s += gap
            if s > end:
                break
        return real(FAR), real(-FAR)

    return follow


@functools.cache
def ray_function(real: Any, kinds: frozenset[Any]) -> Any:
    """Return the Warp function ``enters(shapes, b, pose, r, m, reach, margin) -> s``.

    ``s`` is where the line ``r + s m`` (link frame) enters body ``b``, searched from ``reach`` behind ``r`` on. A body
    that begins farther back and ends before the skin touches the skin's back, not its front, and is ignored; a body
    that is solid all the way is entered at ``-reach``. The result is 1e18 if the line misses the body, or (grids)
    enters it farther out than ``margin``.
    """
    import warp as wp

    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)

    @wp.func
    def through_nothing(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        return real(FAR), real(-FAR)

    through = through_nothing
    for code, kind in kind_codes(kinds):
        through = _ray_or(real, code, kind.ray(real), through)

    @wp.func
    def enters(shapes: shapes_type, b: int, pose: transform, r: vec3, m: vec3, reach: real, margin: real):
        q = wp.transform_get_rotation(pose)
        o = r - wp.transform_get_translation(pose)
        d = m
        if shapes.turns[b] == 1:
            o = wp.quat_rotate_inv(q, o)
            d = wp.quat_rotate_inv(q, m)
        first, last = through(shapes, b, o, d, reach, margin)
        if first < -reach and last < real(0.0):
            first = real(FAR)
        return wp.max(first, -reach)

    return enters


def _ray_or(real, code: int, ray, others):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def through(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        if shapes.kind[b] == wp.static(code):
            first, last = ray(shapes, b, o, d, start, end)
        else:
            first, last = others(shapes, b, o, d, start, end)
        return first, last

    return through


@functools.cache
def _thickness_kernel(real, kinds: frozenset):
    import warp as wp

    from tactemu.base.kernels import warp_kernel

    vec3 = wp.types.vector(3, real)
    quat = wp.types.quaternion(real)
    shapes_type = table_type(real)
    enters = ray_function(real, kinds)

    @warp_kernel
    def find_thickness(
        shapes: shapes_type,
        b: int,
        positions: wp.array(dtype=vec3),
        normals: wp.array(dtype=vec3),
        reach_out: wp.array(dtype=real),
    ):
        i = wp.tid()
        here = wp.transformation(vec3(real(0.0)), quat(real(0.0), real(0.0), real(0.0), real(1.0)))
        s = enters(shapes, b, here, positions[i], normals[i], real(FAR), real(FAR))
        if s >= real(0.0):  # the point is not on the body, so nothing is behind it
            s = real(-FAR)
        reach_out[i] = -s

    return find_thickness


def thickness_behind(table, b: int, positions, normals, context):
    """Return the thickness of body ``b`` behind points on its surface, against their normals [m], shape ``(n,)``.

    It is 1e18 where a point is not on the body, or the body has no end. Positions and normals are in the body's frame.

    Args:
        table: a :class:`~tactemu.sensors.shape_table.ShapeTable`.
        b: the body's row.
        positions: ``wp.array`` of vectors [m], shape ``(n,)``.
        normals: ``wp.array`` of unit vectors, shape ``(n,)``.
        context: the scene's context.
    """
    import warp as wp

    reach = wp.zeros(len(positions), dtype=context.real, device=context.device)
    inputs = [table.struct, b, positions, normals]
    kernel = _thickness_kernel(context.real, table.kinds)
    wp.launch(kernel, dim=len(positions), inputs=inputs, outputs=[reach], device=context.device)
    return reach
