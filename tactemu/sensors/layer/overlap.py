"""The overlap of each cell of the layer with the bodies, and their slide since the last step."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.rays import ray_function
from tactemu.geometry.shapes.shape import FAR, table_type
from tactemu.plan.scalars import is_finite, natural
from tactemu.sensors.layer.overlap_simd import ball_row
from tactemu.sensors.sensed import sensed_type

NO_SURFACE = -1.0e6
"""Overlap of a cell that no object is above [pitches]."""


@functools.cache
def cells_type(real):
    """Return the Warp struct of the cells of a layer, which do not change from step to step; lengths are in metres."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Cells:
        corner: vec3  # corner of the grid, not the centre of its first cell
        u: vec3
        v: vec3
        n: vec3
        size: wp.types.vector(2, real)  # of a cell, along v and u
        shape: wp.vec2i  # rows and columns
        horizon: real  # height above the skin up to which bodies are sensed
        pitch: real  # unit of the overlaps
        centres: wp.array2d(dtype=vec3)
        covered: wp.array2d(dtype=wp.bool)
        reach: wp.array2d(dtype=real)  # depth below each cell to which bodies are sensed
        axes: wp.array3d(dtype=vec3)  # u, v and n of each cell of a bent skin

    return Cells


@functools.cache
def overlap_type(real):
    """Return the Warp struct of the overlaps, and of what they are found with."""

    @wp.struct
    class Overlap:
        last_pose: wp.array2d(dtype=wp.types.transformation(real))  # poses of the last step
        near: wp.array(dtype=wp.vec4i)  # first row and column near bodies, and the ones after the last, per environment
        active: wp.array(dtype=wp.vec4i)  # likewise, with those of the last step: the cells that are visited
        overlap: wp.array3d(dtype=real)  # of each cell [pitches], (n_envs, rows, columns)
        body: wp.array3d(dtype=wp.int32)  # index of the body there
        slide: wp.array3d(dtype=wp.types.vector(2, real))  # its slide since the last step [pitches]

    return Overlap


@functools.cache
def near_kernel(real, is_bent: bool = False):
    """Return the kernel that finds the rows and columns near bodies from their bounding balls, one environment per
    thread; on a bent skin it takes all."""
    sensed_struct, cells_struct, overlap_struct = sensed_type(real), cells_type(real), overlap_type(real)

    @wp.func
    def cells_within(centre: real, bound: real, start: real, size: real, count: int):
        """Return the first cell of a row of ``count`` that the interval ``centre +- bound`` touches, and the one after
        the last."""
        if not bound < real(1.0e9) * size:
            return wp.vec2i(0, count)
        first = wp.clamp((centre - bound - start) / size, real(0.0), real(count))
        last = wp.clamp((centre + bound - start) / size + real(1.0), real(0.0), real(count))
        return wp.vec2i(int(first), int(last))

    @warp_kernel
    def find_near(first_env: int, sensed: sensed_struct, cells: cells_struct, over: overlap_struct):
        env = wp.tid()
        env += first_env
        top = cells.shape[0]
        left = cells.shape[1]
        bottom = int(0)
        right = int(0)
        for t in range(sensed.targets.shape[0]):
            b = sensed.targets[t]
            at = wp.transform_get_translation(sensed.pose[env, b]) - cells.corner
            bound = sensed.shapes.bound[b]
            down = wp.vec2i(0, cells.shape[0])
            along = wp.vec2i(0, cells.shape[1])
            if wp.static(not is_bent):
                if is_finite(at[0]):
                    if wp.dot(at, cells.n) - bound > cells.horizon:
                        continue
                    down = cells_within(wp.dot(at, cells.v), bound, real(0.0), cells.size[0], cells.shape[0])
                    along = cells_within(wp.dot(at, cells.u), bound, real(0.0), cells.size[1], cells.shape[1])
            if down[0] < down[1] and along[0] < along[1]:
                top = wp.min(top, down[0])
                bottom = wp.max(bottom, down[1])
                left = wp.min(left, along[0])
                right = wp.max(right, along[1])
        now = wp.vec4i(top, left, bottom, right)
        last = over.near[env]
        over.near[env] = now
        # Cells that a body has left are visited once more, to be cleared.
        active = now
        if last[2] > last[0]:
            active = wp.vec4i(
                wp.min(now[0], last[0]), wp.min(now[1], last[1]), wp.max(now[2], last[2]), wp.max(now[3], last[3])
            )
        over.active[env] = active

    return find_near


@functools.cache
def overlap_kernel(real, kinds: frozenset, with_slide: bool, is_bent: bool = False):
    """Return the kernel that finds the overlap [pitches] of every cell in reach and, for friction, the body there and
    its slide [pitches] since the last step. One thread takes a row of cells, or several share it."""
    vec3, vec2 = wp.types.vector(3, real), wp.types.vector(2, real)
    transform = wp.types.transformation(real)
    sensed_struct, cells_struct, overlap_struct = sensed_type(real), cells_type(real), overlap_type(real)
    enters = ray_function(real, kinds)

    @wp.func
    def may_touch(shapes: table_type(real), b: int, pose: transform, r: vec3, n: vec3, nearest: real):
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
    def lowest_surface(sensed: sensed_struct, env: int, r: vec3, n: vec3, reach: real, horizon: real):
        """Return the height of the lowest surface from ``reach`` below the point ``r`` to ``horizon`` above it, and its
        body; the body is -1 without a surface."""
        lowest = horizon
        body = int(-1)
        t = int(0)  # a while loop, here and below: Warp's ranges take longer on a CPU
        while t < sensed.targets.shape[0]:
            b = natural(sensed.targets[natural(t)])
            place = sensed.pose[env, b]
            if may_touch(sensed.shapes, b, place, r, n, lowest):
                height = enters(sensed.shapes, b, place, r, n, reach, horizon)
                if height < lowest:
                    lowest = height
                    body = b
            if not is_finite(wp.transform_get_translation(place)[0]):
                lowest = real(wp.nan)
            t += 1
        return lowest, body

    @warp_kernel
    def find_overlap(first_env: int, sensed: sensed_struct, cells: cells_struct, over: overlap_struct, parts: int):
        env, y, part = wp.tid()
        env = natural(env + first_env)
        y = natural(y)
        box = over.active[env]
        if y < box[0] or y >= box[2]:
            return
        x = box[1] + part
        while x < box[3]:
            x = natural(x)
            lowest = real(FAR)
            body = int(-1)
            r = cells.centres[y, x]
            u = cells.u
            v = cells.v
            n = cells.n
            if wp.static(is_bent):
                u = cells.axes[0, y, x]
                v = cells.axes[1, y, x]
                n = cells.axes[2, y, x]
            if cells.covered[y, x]:
                lowest, body = lowest_surface(sensed, env, r, n, cells.reach[y, x], cells.horizon)
            overlap = -lowest / cells.pitch
            if body < 0 and is_finite(lowest):
                overlap = real(NO_SURFACE)
            over.overlap[env, y, x] = overlap
            if wp.static(with_slide):
                over.body[env, y, x] = body
                slide = vec2(real(0.0))
                if body >= 0 and lowest < real(0.0):
                    b = natural(body)
                    before = over.last_pose[env, b]
                    slide = slid(sensed.pose[env, b], before, r + lowest * n, u, v, cells.pitch)
                over.slide[env, y, x] = slide
            x += parts

    return find_overlap


@functools.cache
def ball_rows_kernel(real, with_slide: bool):
    """Return the kernel of :mod:`.overlap_simd` for a CPU; one thread takes a row of cells, ``parts`` is 1."""
    cells_struct, overlap_struct = cells_type(real), overlap_type(real)
    find_row = ball_row(real, cells_struct, overlap_struct, with_slide, NO_SURFACE)

    @warp_kernel
    def find_rows(first_env: int, sensed: sensed_type(real), cells: cells_struct, over: overlap_struct, parts: int):
        env, y, _part = wp.tid()
        env = natural(env + first_env)
        y = natural(y)
        box = over.active[env]
        if y >= box[0] and y < box[2]:
            find_row(sensed, cells, over, env, y)

    return find_rows


@functools.cache
def keep_poses_kernel(real):
    """Return the kernel that keeps the poses of a step for the next."""
    transform = wp.types.transformation(real)

    @warp_kernel
    def remember_poses(first_env: int, pose: wp.array2d(dtype=transform), last_pose_out: wp.array2d(dtype=transform)):
        env, b = wp.tid()
        env += first_env
        last_pose_out[env, b] = pose[env, b]

    return remember_poses
