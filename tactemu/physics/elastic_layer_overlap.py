"""What the layer is pressed by: the overlap of each cell with the bodies, and how far they slid since the last step."""

import functools

import warp as wp

from tactemu.physics.elastic_layer_column import column_function
from tactemu.physics.elastic_layer_contact import NO_SURFACE
from tactemu.physics.shapes import table_type


@functools.cache
def overlap_kernel(real, kinds: frozenset, with_slide: bool):
    """Overlap [pitches] of every cell and, for friction, the body there and its slide [pitches] since the last step."""
    vec3, vec2 = wp.types.vector(3, real), wp.types.vector(2, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    enter = column_function(real, kinds)

    @wp.func
    def may_touch(shapes: shapes_type, b: int, pose: transform, r: vec3, n: vec3, nearest: real):
        """Can the line through ``r`` along ``n`` meet the ball around the shape, lower than ``nearest``?"""
        away = wp.transform_get_translation(pose) - r
        height = wp.dot(away, n)
        bound = shapes.bound[b]
        across = away - height * n
        return not (wp.dot(across, across) > bound * bound or height - bound > nearest)

    @wp.func
    def slid(now: transform, before: transform, x: vec3, u: vec3, v: vec3, pitch: real):
        """How far the body's material at ``x`` has come, along u and v; exactly nothing where the body is still."""
        still = bool(True)
        for i in range(7):
            still = still and now[i] == before[i]
        if still:
            return vec2(real(0.0))
        material = wp.quat_rotate_inv(wp.transform_get_rotation(now), x - wp.transform_get_translation(now))
        was = wp.quat_rotate(wp.transform_get_rotation(before), material) + wp.transform_get_translation(before)
        return vec2(wp.dot(x - was, u) / pitch, wp.dot(x - was, v) / pitch)

    @wp.kernel(module="unique", enable_backward=False)
    def find_overlap(
        # Scene:
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        last_pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        # Skin:
        centres: wp.array2d(dtype=vec3),
        covered: wp.array2d(dtype=wp.bool),
        u: vec3,
        v: vec3,
        n: vec3,
        depth: real,
        horizon: real,
        pitch: real,
        # Out:
        overlap_out: wp.array3d(dtype=real),
        body_out: wp.array3d(dtype=wp.int32),
        slide_out: wp.array3d(dtype=vec2),
    ):
        env, y, x = wp.tid()
        if not covered[y, x]:
            overlap_out[env, y, x] = real(NO_SURFACE)
            return
        r = centres[y, x]
        lowest = horizon
        body = int(-1)
        for t in range(targets.shape[0]):
            b = targets[t]
            place = pose[env, b]
            if may_touch(shapes, b, place, r, n, lowest):
                q = wp.transform_get_rotation(place)
                p = wp.quat_rotate_inv(q, r - wp.transform_get_translation(place))
                height = enter(shapes, b, p, wp.quat_rotate_inv(q, n), depth)
                if height < lowest:
                    lowest = height
                    body = b
            if not wp.isfinite(wp.transform_get_translation(place)[0]):
                lowest = real(wp.nan)
        if body < 0 and lowest >= horizon:
            overlap_out[env, y, x] = real(NO_SURFACE)
        else:
            overlap_out[env, y, x] = -lowest / pitch
        if wp.static(with_slide):
            body_out[env, y, x] = body
            slide = vec2(real(0.0))
            if body >= 0 and lowest < real(0.0):
                slide = slid(pose[env, body], last_pose[env, body], r + lowest * n, u, v, pitch)
            slide_out[env, y, x] = slide

    return find_overlap


@functools.cache
def remember_kernel(real):
    """Keeps the poses of a step for the next."""
    transform = wp.types.transformation(real)

    @wp.kernel(module="unique", enable_backward=False)
    def remember_poses(pose: wp.array2d(dtype=transform), last_pose_out: wp.array2d(dtype=transform)):
        env, b = wp.tid()
        last_pose_out[env, b] = pose[env, b]

    return remember_poses
