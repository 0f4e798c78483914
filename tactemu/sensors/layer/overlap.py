"""The overlap of each cell of the layer with the bodies, and their slide since the last step."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.geometry.shapes.rays import ray_function
from tactemu.geometry.shapes.shape import FAR, table_type
from tactemu.plan.scalars import is_finite, natural
from tactemu.sensors.layer.pressure import NO_SURFACE


@functools.cache
def near_kernel(real, is_bent: bool = False):
    """Return the kernel that finds the rows and columns near bodies from their bounding balls, one environment per
    thread; on a bent skin it takes all."""
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)

    @wp.func
    def cells_within(centre: real, bound: real, start: real, size: real, count: int):
        """Return the first cell of a row of ``count`` that the interval ``centre +- bound`` touches, and the one after
        the last."""
        if not bound < real(1.0e9) * size:
            return wp.vec2i(0, count)
        first = wp.clamp((centre - bound - start) / size, real(0.0), real(count))
        last = wp.clamp((centre + bound - start) / size + real(1.0), real(0.0), real(count))
        return wp.vec2i(int(first), int(last))

    @wp.kernel(module="unique", enable_backward=False)
    def find_near(
        first_env: int,
        # Scene:
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        # Skin:
        corner: vec3,  # corner of the grid, not the centre of its first cell
        u: vec3,
        v: vec3,
        n: vec3,
        cell: wp.types.vector(2, real),
        cells: wp.vec2i,
        horizon: real,
        # State and out:
        near: wp.array(dtype=wp.vec4i),
        active_out: wp.array(dtype=wp.vec4i),
    ):
        env = wp.tid()
        env += first_env
        top = cells[0]
        left = cells[1]
        bottom = int(0)
        right = int(0)
        for t in range(targets.shape[0]):
            b = targets[t]
            at = wp.transform_get_translation(pose[env, b]) - corner
            bound = shapes.bound[b]
            down = wp.vec2i(0, cells[0])
            along = wp.vec2i(0, cells[1])
            if wp.static(not is_bent):
                if is_finite(at[0]):
                    if wp.dot(at, n) - bound > horizon:
                        continue
                    down = cells_within(wp.dot(at, v), bound, real(0.0), cell[0], cells[0])
                    along = cells_within(wp.dot(at, u), bound, real(0.0), cell[1], cells[1])
            if down[0] < down[1] and along[0] < along[1]:
                top = wp.min(top, down[0])
                bottom = wp.max(bottom, down[1])
                left = wp.min(left, along[0])
                right = wp.max(right, along[1])
        now = wp.vec4i(top, left, bottom, right)
        last = near[env]
        near[env] = now
        # Cells that a body has left are visited once more, to be cleared.
        active = now
        if last[2] > last[0]:
            active = wp.vec4i(
                wp.min(now[0], last[0]), wp.min(now[1], last[1]), wp.max(now[2], last[2]), wp.max(now[3], last[3])
            )
        active_out[env] = active

    return find_near


@functools.cache
def overlap_kernel(real, kinds: frozenset, with_slide: bool, is_bent: bool = False):
    """Return the kernel that finds the overlap [pitches] of every cell in reach and, for friction, the body there and
    its slide [pitches] since the last step. One thread takes a row of cells, or several share it."""
    vec3, vec2 = wp.types.vector(3, real), wp.types.vector(2, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    enters = ray_function(real, kinds)

    @wp.func
    def may_touch(shapes: shapes_type, b: int, pose: transform, r: vec3, n: vec3, nearest: real):
        """Return True if the line through ``r`` along ``n`` can meet the ball around the shape, lower than
        ``nearest``."""
        away = wp.transform_get_translation(pose) - r
        height = wp.dot(away, n)
        bound = shapes.bound[b]
        across = away - height * n
        return not (wp.dot(across, across) > bound * bound or height - bound > nearest)

    @wp.func
    def slid(now: transform, before: transform, x: vec3, u: vec3, v: vec3, pitch: real):
        """Return the displacement of the body's material at ``x``, along u and v; exactly 0 where the body is still."""
        still = bool(True)
        for i in range(7):
            still = still and now[i] == before[i]
        if still:
            return vec2(real(0.0))
        material = wp.quat_rotate_inv(wp.transform_get_rotation(now), x - wp.transform_get_translation(now))
        was = wp.quat_rotate(wp.transform_get_rotation(before), material) + wp.transform_get_translation(before)
        return vec2(wp.dot(x - was, u) / pitch, wp.dot(x - was, v) / pitch)

    @wp.func
    def lowest_surface(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        env: int,
        r: vec3,
        n: vec3,
        reach: real,
        horizon: real,
    ):
        """Return the height of the lowest surface from ``reach`` below the point ``r`` to ``horizon`` above it, and its
        body; the body is -1 without a surface."""
        lowest = horizon
        body = int(-1)
        for t in range(targets.shape[0]):
            b = natural(targets[natural(t)])
            place = pose[env, b]
            if may_touch(shapes, b, place, r, n, lowest):
                height = enters(shapes, b, place, r, n, reach, horizon)
                if height < lowest:
                    lowest = height
                    body = b
            if not is_finite(wp.transform_get_translation(place)[0]):
                lowest = real(wp.nan)
        return lowest, body

    @wp.kernel(module="unique", enable_backward=False)
    def find_overlap(
        first_env: int,
        # Scene:
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        last_pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        active: wp.array(dtype=wp.vec4i),
        # Skin:
        centres: wp.array2d(dtype=vec3),
        covered: wp.array2d(dtype=wp.bool),
        reach: wp.array2d(dtype=real),
        u: vec3,
        v: vec3,
        n: vec3,
        axes: wp.array3d(dtype=vec3),  # u, v and n of each cell of a bent skin
        horizon: real,
        pitch: real,
        parts: int,
        # Out:
        overlap_out: wp.array3d(dtype=real),
        body_out: wp.array3d(dtype=wp.int32),
        slide_out: wp.array3d(dtype=vec2),
    ):
        env, y, part = wp.tid()
        env = natural(env + first_env)
        y = natural(y)
        box = active[env]
        if y < box[0] or y >= box[2]:
            return
        for x in range(box[1] + part, box[3], parts):
            x = natural(x)
            lowest = real(FAR)
            body = int(-1)
            r = centres[y, x]
            along_u = u
            along_v = v
            out = n
            if wp.static(is_bent):
                along_u = axes[0, y, x]
                along_v = axes[1, y, x]
                out = axes[2, y, x]
            if covered[y, x]:
                lowest, body = lowest_surface(shapes, pose, targets, env, r, out, reach[y, x], horizon)
            overlap = -lowest / pitch
            if body < 0 and is_finite(lowest):
                overlap = real(NO_SURFACE)
            overlap_out[env, y, x] = overlap
            if wp.static(with_slide):
                body_out[env, y, x] = body
                slide = vec2(real(0.0))
                if body >= 0 and lowest < real(0.0):
                    slide = slid(pose[env, body], last_pose[env, body], r + lowest * out, along_u, along_v, pitch)
                slide_out[env, y, x] = slide

    return find_overlap


@functools.cache
def keep_poses_kernel(real):
    """Return the kernel that keeps the poses of a step for the next."""
    transform = wp.types.transformation(real)

    @wp.kernel(module="unique", enable_backward=False)
    def remember_poses(first_env: int, pose: wp.array2d(dtype=transform), last_pose_out: wp.array2d(dtype=transform)):
        env, b = wp.tid()
        env += first_env
        last_pose_out[env, b] = pose[env, b]

    return remember_poses
