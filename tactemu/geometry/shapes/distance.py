"""The distance from a point to any of the shapes in a scene.

:func:`shape_functions` builds the Warp functions for one float type and for the kinds of shape in the scene, so that a
kernel for a ball contains nothing about meshes. Distances are negative inside. A normal is the gradient of the
distance, a unit vector out of the shape, and *zero* where there is none (the centre of a ball, the axis of a capsule):
callers then use the taxel's own normal.
"""

# pyright: reportArgumentType=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.geometry.shapes.shape import FAR, kind_codes, table_type


class ShapeFunctions(NamedTuple):
    """Warp functions of one float type. ``shapes`` is the scene's table, ``b`` the index of a body in it."""

    distance: Any
    """``distance(shapes, b, p) -> (signed distance, normal)`` of the point ``p`` in the body's frame."""
    distance_in_link: Any
    """``distance_in_link(shapes, b, pose, r) -> (signed distance, normal)``: the same for a point ``r`` in a link's
    frame, where ``pose`` is the body's pose in that frame; the normal is in the link's frame."""
    reaches: Any
    """``reaches(shapes, b, pose, r, margin) -> bool``: true if the shape may be nearer to ``r`` than ``margin``.

    The test is cheap: it uses a ball around the shape, and the shape's own lower bound if it has one. It is also true
    where it cannot decide and for poses that are not finite.
    """


@functools.cache
def shape_functions(real, kinds: frozenset) -> ShapeFunctions:
    """Return the distance functions of a scene that holds these kinds of shape, for ``wp.float32`` or
    ``wp.float64``.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)

    @wp.func
    def to_nothing(shapes: shapes_type, b: int, p: vec3):
        return real(FAR), vec3(real(0.0))

    @wp.func
    def unbounded(shapes: shapes_type, b: int, p: vec3):
        return real(-FAR)

    distance, lower_bound = to_nothing, unbounded
    for code, kind in kind_codes(kinds):
        distance = _distance_or(real, code, kind.distance(real), distance)
        if kind.lower_bound is not None:
            lower_bound = _bound_or(real, code, kind.lower_bound(real), lower_bound)
    some_turn, all_turn = any(kind.is_oriented for kind in kinds), all(kind.is_oriented for kind in kinds)

    @wp.func
    def distance_in_link(shapes: shapes_type, b: int, pose: transform, r: vec3):
        p = r - wp.transform_get_translation(pose)
        q = wp.transform_get_rotation(pose)
        turn = bool(wp.static(some_turn))
        if wp.static(some_turn and not all_turn):
            turn = shapes.turns[b] == 1
        if turn:
            p = wp.quat_rotate_inv(q, p)
        d, n = distance(shapes, b, p)
        if turn:
            n = wp.quat_rotate(q, n)
        return d, n

    @wp.func
    def reaches(shapes: shapes_type, b: int, pose: transform, r: vec3, margin: real):
        reach = shapes.bound[b] + margin
        d = r - wp.transform_get_translation(pose)
        near = not (wp.dot(d, d) > reach * reach)
        if wp.static(lower_bound is not unbounded):
            if near:
                p = wp.quat_rotate_inv(wp.transform_get_rotation(pose), d)
                near = not (lower_bound(shapes, b, p) > margin)
        return near

    return ShapeFunctions(distance, distance_in_link, reaches)


def _distance_or(real, code: int, own, others):
    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def distance(shapes: shapes_type, b: int, p: vec3):
        if shapes.kind[b] == wp.static(code):
            d, n = own(shapes, b, p)
        else:
            d, n = others(shapes, b, p)
        return d, n

    return distance


def _bound_or(real, code: int, own, others):
    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def lower_bound(shapes: shapes_type, b: int, p: vec3):
        if shapes.kind[b] == wp.static(code):
            return own(shapes, b, p)
        return others(shapes, b, p)

    return lower_bound
