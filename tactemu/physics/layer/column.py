"""How deep a shape is in the skin along a taxel's normal: where the line through the taxel enters the shape.

The distance of the seed's probes is to the *nearest* surface, and near the side of a box that is its wall. A contact
needs what is straight above or below: ``enter`` follows the line from ``depth`` below the skin outwards.
"""

import functools

import warp as wp

from tactemu.physics.shapes.distance import (
    BOX,
    CAPSULE,
    CYLINDER,
    FAR,
    MESH,
    OPEN_MESH,
    PLANE,
    SPHERE,
    VOXEL,
    shape_functions,
    table_type,
)

TRACE_STEPS = 64


@functools.cache
def column_function(real, kinds: frozenset):
    """``enter(shapes, b, p, d, depth) -> height``, all in the frame of body ``b``.

    Where the line ``p + height * d`` enters the shape on its way along the unit vector ``d``, looking from
    ``height = -depth``: negative below the point ``p``, ``-depth`` if it is already inside there, and ``FAR`` if the
    line misses.
    """
    vec3, vec2 = wp.types.vector(3, real), wp.types.vector(2, real)
    shapes_type = table_type(real)
    distance = shape_functions(real, kinds).distance

    @wp.func
    def enter_interval(first: real, last: real, depth: real):
        if first > last or last < -depth:
            return real(FAR)
        return wp.max(first, -depth)

    @wp.func
    def ball(p: vec3, d: vec3, radius: real, depth: real):
        along = wp.dot(p, d)
        across = wp.length(p - along * d)
        if across > radius:
            return real(FAR)
        half = wp.sqrt((radius - across) * (radius + across))
        return enter_interval(-along - half, -along + half, depth)

    @wp.func
    def slab(p: real, d: real, half: real):
        """Where the line is between two planes."""
        if wp.abs(d) < real(1.0e-12):
            if wp.abs(p) > half:
                return vec2(real(FAR), real(-FAR))
            return vec2(real(-FAR), real(FAR))
        a = (-half - p) / d
        b = (half - p) / d
        return vec2(wp.min(a, b), wp.max(a, b))

    @wp.func
    def tube(p: vec3, d: vec3, radius: real):
        """Where the line is within ``radius`` of the z axis."""
        flat = d[0] * d[0] + d[1] * d[1]
        if flat < real(1.0e-24):
            if p[0] * p[0] + p[1] * p[1] > radius * radius:
                return vec2(real(FAR), real(-FAR))
            return vec2(real(-FAR), real(FAR))
        length = wp.sqrt(flat)
        across = wp.abs(p[0] * d[1] - p[1] * d[0]) / length
        if across > radius:
            return vec2(real(FAR), real(-FAR))
        middle = -(p[0] * d[0] + p[1] * d[1]) / flat
        half = wp.sqrt((radius - across) * (radius + across)) / length
        return vec2(middle - half, middle + half)

    @wp.func
    def box(p: vec3, d: vec3, size: vec3, depth: real):
        x = slab(p[0], d[0], size[0])
        y = slab(p[1], d[1], size[1])
        z = slab(p[2], d[2], size[2])
        return enter_interval(wp.max(x[0], wp.max(y[0], z[0])), wp.min(x[1], wp.min(y[1], z[1])), depth)

    @wp.func
    def cylinder(p: vec3, d: vec3, size: vec3, depth: real):
        side = tube(p, d, size[0])
        ends = slab(p[2], d[2], size[1])
        return enter_interval(wp.max(side[0], ends[0]), wp.min(side[1], ends[1]), depth)

    @wp.func
    def capsule(p: vec3, d: vec3, size: vec3, depth: real):
        side = tube(p, d, size[0])
        ends = slab(p[2], d[2], size[1])
        straight = enter_interval(wp.max(side[0], ends[0]), wp.min(side[1], ends[1]), depth)
        top = ball(p - vec3(real(0.0), real(0.0), size[1]), d, size[0], depth)
        bottom = ball(p + vec3(real(0.0), real(0.0), size[1]), d, size[0], depth)
        return wp.min(straight, wp.min(top, bottom))

    @wp.func
    def plane(p: vec3, d: vec3, depth: real):
        if wp.abs(d[2]) < real(1.0e-12):
            return wp.where(p[2] <= real(0.0), -depth, real(FAR))
        height = -p[2] / d[2]
        if d[2] < real(0.0):
            return enter_interval(height, real(FAR), depth)
        return enter_interval(real(-FAR), height, depth)

    @wp.func
    def mesh(shapes: shapes_type, b: int, p: vec3, d: vec3, depth: real):
        unit = shapes.mesh_unit[b]
        q = (p - depth * d) / unit
        start = wp.vec3(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]))
        along = wp.vec3(wp.float32(d[0]), wp.float32(d[1]), wp.float32(d[2]))
        hit = wp.mesh_query_ray(shapes.mesh[b], start, along, wp.float32(1.0e6))
        if not hit.result:
            return real(FAR)
        if hit.sign < 0.0:  # leaves the mesh there: it started inside
            return -depth
        return real(hit.t) * unit - depth

    @wp.func
    def trace(shapes: shapes_type, b: int, p: vec3, d: vec3, depth: real):
        """Sphere tracing, for what is known only by its distance."""
        height = -depth
        nearest = real(FAR)
        for _i in range(wp.static(TRACE_STEPS)):
            nearest, _n = distance(shapes, b, p + height * d)
            if nearest <= real(1.0e-7):
                return height
            height += nearest
            if height > real(1.0e3) * depth + real(1.0):
                return real(FAR)
        return height

    @wp.func
    def enter(shapes: shapes_type, b: int, p: vec3, d: vec3, depth: real):
        kind = shapes.kind[b]
        size = shapes.size[b]
        height = real(FAR)
        if wp.static(SPHERE in kinds):
            if kind == wp.static(SPHERE):
                height = ball(p, d, size[0], depth)
        if wp.static(BOX in kinds):
            if kind == wp.static(BOX):
                height = box(p, d, size, depth)
        if wp.static(CAPSULE in kinds):
            if kind == wp.static(CAPSULE):
                height = capsule(p, d, size, depth)
        if wp.static(CYLINDER in kinds):
            if kind == wp.static(CYLINDER):
                height = cylinder(p, d, size, depth)
        if wp.static(PLANE in kinds):
            if kind == wp.static(PLANE):
                height = plane(p, d, depth)
        if wp.static(MESH in kinds or OPEN_MESH in kinds):
            if kind == wp.static(MESH) or kind == wp.static(OPEN_MESH):
                height = mesh(shapes, b, p, d, depth)
        if wp.static(VOXEL in kinds):
            if kind == wp.static(VOXEL):
                height = trace(shapes, b, p, d, depth)
        return height

    return enter
