"""Along the taxel's normal instead of to the nearest surface: where a line enters a shape and where it leaves it.

The distance to the nearest surface stops growing half-way through a thin object and falls again; the distance along
the normal goes on growing. For the line ``o + s d`` (``|d| = 1``) each function gives the first and the last ``s`` in
the solid; without a hit the first is +1e18 and the last -1e18. Convex shapes are exact.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false, reportAttributeAccessIssue=false

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
from tactemu.plan.plan import Context

SEARCHED = (MESH, OPEN_MESH, VOXEL)
"""Shapes that a line is followed through step by step."""
PARALLEL = 1.0e-12
"""Sine of an angle below which a line runs along a face."""


@functools.cache
def line_functions(real):
    """``f(o, d, size) -> (first, last)`` of each primitive."""
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
            half = wp.sqrt((radius - across) * (radius + across))
            first = -b - half
            last = -b + half
        return first, last

    @wp.func
    def slab(o: real, d: real, half: real):
        first = real(-FAR)
        last = real(FAR)
        if wp.abs(d) < real(PARALLEL):
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
        if slope < real(PARALLEL):
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

    @wp.func
    def sphere(o: vec3, d: vec3, size: vec3):
        return ball(o, d, vec3(real(0.0)), size[0])

    @wp.func
    def box(o: vec3, d: vec3, size: vec3):
        first = real(-FAR)
        last = real(FAR)
        for k in range(3):
            a, b = slab(o[k], d[k], size[k])
            first = wp.max(first, a)
            last = wp.min(last, b)
        if first > last:
            first = real(FAR)
            last = real(-FAR)
        return first, last

    @wp.func
    def capsule(o: vec3, d: vec3, size: vec3):
        first, last = tube(o, d, size[0], size[1])
        top = vec3(real(0.0), real(0.0), size[1])
        a, b = ball(o, d, top, size[0])
        e, f = ball(o, d, -top, size[0])
        return wp.min(first, wp.min(a, e)), wp.max(last, wp.max(b, f))

    @wp.func
    def cylinder(o: vec3, d: vec3, size: vec3):
        return tube(o, d, size[0], size[1])

    @wp.func
    def plane(o: vec3, d: vec3, size: vec3):
        first = real(FAR)
        last = real(-FAR)
        if wp.abs(d[2]) < real(PARALLEL):
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

    return {SPHERE: sphere, BOX: box, CAPSULE: capsule, CYLINDER: cylinder, PLANE: plane}


@functools.cache
def ray_function(real, kinds: frozenset):
    """``enters(shapes, b, pose, r, m, reach, margin) -> s``: where the line ``r + s m`` (link frame) enters body ``b``.

    Looks from ``reach`` behind ``r`` on. What comes from behind that and ends before the skin touches the skin's back,
    not its front, and is not seen; what is solid all the way enters at ``-reach``. 1e18 if the line misses the body,
    or (grids) enters it farther out than ``margin``.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    lines = line_functions(real)
    sphere, box, capsule = lines[SPHERE], lines[BOX], lines[CAPSULE]
    cylinder, plane = lines[CYLINDER], lines[PLANE]
    distance = shape_functions(real, kinds).distance

    @wp.func
    def through_mesh(mesh: wp.uint64, unit: real, o: vec3, d: vec3, start: real):
        way = wp.vec3(wp.float32(d[0]), wp.float32(d[1]), wp.float32(d[2]))
        s = -start
        found = real(FAR)
        for _ in range(16):
            q = (o + s * d) / unit
            origin = wp.vec3(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]))
            hit = wp.mesh_query_ray(mesh, origin, way, wp.float32(1.0e6))
            if not hit.result:
                break
            at = s + real(hit.t) * unit
            if hit.sign > 0.0:  # from outside
                found = at
                break
            if at >= real(0.0):  # from inside, and solid up to the skin
                found = -start
                break
            s = at + real(1.0e-5) * unit
        return found

    @wp.func
    def through_grid(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        cell = shapes.grid_cell[b]
        near = real(1.0e-3) * wp.min(cell[0], wp.min(cell[1], cell[2]))
        s = -start
        found = real(FAR)
        gap, _n = distance(shapes, b, o + s * d)
        within = gap < real(0.0)
        for _ in range(1024):
            gap, _m = distance(shapes, b, o + s * d)
            if within:
                if gap > near:
                    within = False
                elif s >= real(0.0):
                    found = -start
                    break
                s += wp.max(-gap, near)
            else:
                if gap <= near:
                    found = s + gap
                    break
                s += gap
            if s > end:
                break
        return found

    @wp.func
    def enters(shapes: shapes_type, b: int, pose: transform, r: vec3, m: vec3, reach: real, margin: real):
        q = wp.transform_get_rotation(pose)
        o = wp.quat_rotate_inv(q, r - wp.transform_get_translation(pose))
        d = wp.quat_rotate_inv(q, m)
        kind = shapes.kind[b]
        size = shapes.size[b]
        first = real(FAR)
        last = real(FAR)
        if wp.static(SPHERE in kinds):
            if kind == wp.static(SPHERE):
                first, last = sphere(o, d, size)
        if wp.static(BOX in kinds):
            if kind == wp.static(BOX):
                first, last = box(o, d, size)
        if wp.static(CAPSULE in kinds):
            if kind == wp.static(CAPSULE):
                first, last = capsule(o, d, size)
        if wp.static(CYLINDER in kinds):
            if kind == wp.static(CYLINDER):
                first, last = cylinder(o, d, size)
        if wp.static(PLANE in kinds):
            if kind == wp.static(PLANE):
                first, last = plane(o, d, size)
        if wp.static(not kinds.isdisjoint(SEARCHED)):
            back = wp.min(reach, wp.length(o) + shapes.bound[b])
            across = o - wp.dot(o, d) * d
            if wp.dot(across, across) <= shapes.bound[b] * shapes.bound[b]:
                if wp.static(VOXEL in kinds):
                    if kind == wp.static(VOXEL):
                        first = through_grid(shapes, b, o, d, back, margin)
                if wp.static(MESH in kinds or OPEN_MESH in kinds):
                    if kind == wp.static(MESH) or kind == wp.static(OPEN_MESH):
                        first = through_mesh(shapes.mesh[b], shapes.mesh_unit[b], o, d, back)
        if first < -reach and last < real(0.0):
            first = real(FAR)
        return wp.max(first, -reach)

    return enters


@functools.cache
def _thickness_kernel(real, kinds: frozenset):
    vec3 = wp.types.vector(3, real)
    quat = wp.types.quaternion(real)
    shapes_type = table_type(real)
    enters = ray_function(real, kinds)

    @wp.kernel(module="unique", enable_backward=False)
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
        if s >= real(0.0):  # the point is not on the body: nothing is behind it
            s = real(-FAR)
        reach_out[i] = -s

    return find_thickness


def thickness_behind(table, b: int, positions: wp.array, normals: wp.array, context: Context) -> wp.array:
    """How far body ``b`` of a table goes on behind points on its surface, against their normals [m], shape ``(n,)``.

    Where a point is not on the body, or the body has no end, it is 1e18. Positions and normals are in its frame.
    """
    reach = wp.zeros(len(positions), dtype=context.real, device=context.device)
    inputs = [table.struct, b, positions, normals]
    kernel = _thickness_kernel(context.real, table.kinds)
    wp.launch(kernel, dim=len(positions), inputs=inputs, outputs=[reach], device=context.device)
    return reach
