"""Distance from a point to a shape: exact for primitives, and the table of all shapes that a scene holds.

:func:`shape_functions` builds the Warp functions for one float type and for the kinds of shape in the scene, so that a
kernel for a ball contains nothing about meshes. They work in the frame of the shape's body. Distances are negative
inside. A normal is the gradient of the distance, a unit vector out of the shape, and *zero* where there is none (the
centre of a ball, the axis of a capsule): whoever uses it falls back to the taxel's own normal.

Formulas: Inigo Quilez' exact distances for the box, the capped cylinder and the capsule.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.physics.shapes.mesh_query import mesh_functions
from tactemu.physics.shapes.voxel import voxel_functions

SPHERE, BOX, CAPSULE, CYLINDER, PLANE, MESH, OPEN_MESH, VOXEL = range(8)
FAR = 1.0e18
"""Stands for 'no surface anywhere' [m]; its square still fits float32."""


class ShapeFunctions(NamedTuple):
    """Warp functions of one float type. ``shapes`` is the scene's table, ``b`` the index of a body in it."""

    distance: Any
    """``distance(shapes, b, p) -> (signed distance, normal)`` of the point ``p`` in the body's frame."""
    distance_in_link: Any
    """``distance_in_link(shapes, b, pose, r) -> (signed distance, normal)``: the same for a point ``r`` in a link's
    frame, where ``pose`` is the body's pose in that frame; the normal is in the link's frame."""
    reaches: Any
    """``reaches(shapes, b, pose, r, margin) -> bool``: may the shape be nearer to ``r`` than ``margin``? Cheap, by a
    ball around the shape and for meshes a coarse grid; true for what it cannot decide and for poses not finite."""


@functools.cache
def table_type(real):
    """The Warp struct that holds all shapes of a scene, one row per body."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Shapes:
        kind: wp.array(dtype=wp.int32)  # -1: a body without geometry
        size: wp.array(dtype=vec3)  # box: half extents; others: radius, half length
        bound: wp.array(dtype=real)  # radius of a ball around the origin that holds the shape
        mesh: wp.array(dtype=wp.uint64)
        mesh_unit: wp.array(dtype=real)  # meshes are stored with unit size: metres per stored unit
        grid_start: wp.array(dtype=wp.int64)  # first node in grid_values; a mesh has a coarse grid
        grid_nodes: wp.array(dtype=wp.vec3i)
        grid_origin: wp.array(dtype=vec3)
        grid_cell: wp.array(dtype=vec3)
        grid_values: wp.array(dtype=real)
        grid_gradients: wp.array(dtype=vec3)
        grid_has_gradients: wp.array(dtype=wp.int32)

    return Shapes


@functools.cache
def primitive_functions(real):
    """Exact distance and normal of ball, box, capsule, cylinder and half-space, each ``f(p, size)``."""
    vec3 = wp.types.vector(3, real)
    vec2 = wp.types.vector(2, real)

    @wp.func
    def sign(x: real):
        return wp.where(x < real(0.0), real(-1.0), real(1.0))

    @wp.func
    def sphere(p: vec3, size: vec3):
        return wp.length(p) - size[0], wp.normalize(p)

    @wp.func
    def box(p: vec3, size: vec3):
        q = wp.abs(p) - size
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

    @wp.func
    def capsule(p: vec3, size: vec3):
        d = vec3(p[0], p[1], p[2] - wp.clamp(p[2], -size[1], size[1]))
        return wp.length(d) - size[0], wp.normalize(d)

    @wp.func
    def cylinder(p: vec3, size: vec3):
        across = wp.length(vec2(p[0], p[1]))
        q = vec2(across - size[0], wp.abs(p[2]) - size[1])
        out = vec2(wp.max(q[0], real(0.0)), wp.max(q[1], real(0.0)))
        far = wp.length(out)
        inverse = real(0.0)
        if across > real(0.0):
            inverse = real(1.0) / across
        radial = vec3(p[0] * inverse, p[1] * inverse, real(0.0))
        axial = vec3(real(0.0), real(0.0), sign(p[2]))
        if far > real(0.0):
            return far, (out[0] * radial + out[1] * axial) / far
        if q[0] > q[1]:
            return q[0], radial
        return q[1], axial

    @wp.func
    def plane(p: vec3, size: vec3):
        return p[2], vec3(real(0.0), real(0.0), real(1.0))

    return {SPHERE: sphere, BOX: box, CAPSULE: capsule, CYLINDER: cylinder, PLANE: plane}


@functools.cache
def shape_functions(real, kinds: frozenset) -> ShapeFunctions:
    """The distance functions of a scene that holds these kinds of shape, for ``wp.float32`` or ``wp.float64``."""
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    primitives = primitive_functions(real)
    sphere, box, capsule = primitives[SPHERE], primitives[BOX], primitives[CAPSULE]
    cylinder, plane = primitives[CYLINDER], primitives[PLANE]
    mesh, mesh_bound = mesh_functions(real, shapes_type, True)
    open_mesh, _no_bound = mesh_functions(real, shapes_type, False)
    voxel = voxel_functions(real, shapes_type)

    @wp.func
    def distance(shapes: shapes_type, b: int, p: vec3):
        kind = shapes.kind[b]
        size = shapes.size[b]
        d = real(FAR)
        n = vec3(real(0.0))
        if wp.static(SPHERE in kinds):
            if kind == wp.static(SPHERE):
                d, n = sphere(p, size)
        if wp.static(BOX in kinds):
            if kind == wp.static(BOX):
                d, n = box(p, size)
        if wp.static(CAPSULE in kinds):
            if kind == wp.static(CAPSULE):
                d, n = capsule(p, size)
        if wp.static(CYLINDER in kinds):
            if kind == wp.static(CYLINDER):
                d, n = cylinder(p, size)
        if wp.static(PLANE in kinds):
            if kind == wp.static(PLANE):
                d, n = plane(p, size)
        if wp.static(MESH in kinds):
            if kind == wp.static(MESH):
                d, n = mesh(shapes, b, p)
        if wp.static(OPEN_MESH in kinds):
            if kind == wp.static(OPEN_MESH):
                d, n = open_mesh(shapes, b, p)
        if wp.static(VOXEL in kinds):
            if kind == wp.static(VOXEL):
                d, n = voxel(shapes, b, p)
        return d, n

    @wp.func
    def distance_in_link(shapes: shapes_type, b: int, pose: transform, r: vec3):
        away = r - wp.transform_get_translation(pose)
        if wp.static(SPHERE in kinds):
            if shapes.kind[b] == wp.static(SPHERE):  # a turned ball is the same ball
                far = wp.length(away)
                return far - shapes.size[b][0], wp.normalize(away)
        q = wp.transform_get_rotation(pose)
        d, n = distance(shapes, b, wp.quat_rotate_inv(q, away))
        return d, wp.quat_rotate(q, n)

    @wp.func
    def reaches(shapes: shapes_type, b: int, pose: transform, r: vec3, margin: real):
        reach = shapes.bound[b] + margin
        d = r - wp.transform_get_translation(pose)
        near = not (wp.dot(d, d) > reach * reach)
        if wp.static(MESH in kinds):
            if near and shapes.kind[b] == wp.static(MESH):
                p = wp.quat_rotate_inv(wp.transform_get_rotation(pose), d)
                near = not (mesh_bound(shapes, b, p) > margin)
        return near

    return ShapeFunctions(distance, distance_in_link, reaches)
