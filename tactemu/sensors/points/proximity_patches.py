"""The readings of :mod:`.proximity_taxel` on a GPU: a warp for each patch of 32 neighbouring taxels.

The threads of a warp first test clusters against the box around the patch, each thread its own cluster, then the points
of those in reach, each thread its own point. The points that are left are listed in shared memory, and all threads
visit them together, with fast square roots; points out of a taxel's own reach add zeros. All readings are linear in the
sums over points, since a body moves rigidly, so that forces follow from them in the same launch.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportCallIssue=false

import functools
from typing import Any

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.vector_io import vector_readers
from tactemu.geometry.warp_collectives import (
    ballot_count,
    gathered_function,
    lane_function,
    lanes_per_environment,
    largest_function,
)
from tactemu.plan.launches import Launch
from tactemu.sensors.point_cloud import CLUSTER_SIZE, spatial_order
from tactemu.sensors.points.forces import force_functions, proximity_type, sums_type
from tactemu.sensors.points.table import cloud_type
from tactemu.sensors.sensor_model import Site

THREADS_PER_BLOCK = 128
"""Number of threads of a block."""
MIN_BLOCKS_PER_MULTIPROCESSOR = 8
"""Number of blocks that a multiprocessor holds at once; it limits the registers of a thread."""


@functools.cache
def patches_type(real):
    """Return the Warp struct of taxels in patches, and of the points around them."""

    @wp.struct
    class Patches:
        clouds: cloud_type(real)
        pose: wp.array2d(dtype=wp.types.transformation(real))
        order: wp.array(dtype=wp.int32)  # taxels, patch by patch; the last patch repeats one
        boxes: wp.array(dtype=wp.types.vector(4, real))  # two corners of each patch, and its taxels' largest radius
        radius: wp.array(dtype=real)  # of each taxel
        noised: wp.array2d(dtype=real)  # of each taxel in the measured branch, (n_envs, n_taxels)

    return Patches


@functools.cache
def visit_function(real, width: int):
    """Return ``visit(sums, is_near, x, p, limit, noised)``: the sums with the points ``x`` of all lanes whose
    ``is_near`` is true, in the order of lanes; all lanes must call it together.

    ``sums`` are the total and the moment around ``p`` within ``limit`` and, if ``width`` is 8, both within ``noised``.
    """
    vec3, sums_type = wp.types.vector(3, real), wp.types.vector(width, real)
    code = _VISIT.replace("NUMBER", real.__name__).replace("WIDTH", str(width))

    @wp.func_native(code.replace("THREADS", str(THREADS_PER_BLOCK)))
    def visit(sums: sums_type, is_near: bool, x: vec3, p: vec3, limit: real, noised: real) -> sums_type: ...

    return visit


_VISIT = """
    auto add = [&](const auto& y) {
        const wp::NUMBER dx = y.x - p[0], dy = y.y - p[1], dz = y.z - p[2];
        const wp::NUMBER far = wp::sqrt(dx * dx + dy * dy + dz * dz);
        for (int m = 0; m < WIDTH; m += 4) {
            const wp::NUMBER overlap = wp::max((m ? noised : limit) - far, wp::NUMBER(0));
            sums[m] += overlap;
            sums[m + 1] += overlap * dx;
            sums[m + 2] += overlap * dy;
            sums[m + 3] += overlap * dz;
        }
    };
    struct alignas(16) Point { wp::NUMBER x, y, z; };
#if defined(__CUDA_ARCH__)
    __shared__ Point listed[THREADS];
    const int lane = threadIdx.x % 32;
    Point* const points = listed + (threadIdx.x - lane);
    const unsigned near = __ballot_sync(0xffffffffu, is_near);
    if (is_near)
        points[__popc(near & ((1u << lane) - 1u))] = Point{x[0], x[1], x[2]};
    __syncwarp();
    const int count = __popc(near);
    for (int k = 0; k < count; ++k)
        add(points[k]);
    __syncwarp();
#else
    if (is_near)
        add(Point{x[0], x[1], x[2]});
#endif
    return sums;
"""


@functools.cache
def patches_kernel(real, lanes: int, moving: bool, has_radius: bool, is_separate: bool, has_gain: bool):
    """Return the kernel of the truth and, if ``is_separate``, of the measured branch, with patches of ``lanes`` taxels.
    ``has_radius``: the measured branch has its own radii."""
    vec3, patches, proximity_struct = wp.types.vector(3, real), patches_type(real), proximity_type(real)
    fetch, _, _ = vector_readers(real, 4)
    real_4, transform = wp.types.vector(4, real), wp.types.transformation(real)
    clusters_at_once, turns = max(1, lanes // CLUSTER_SIZE), max(1, CLUSTER_SIZE // lanes)
    sums_struct, readings = sums_type(real), wp.array3d(dtype=real)
    width = 8 if has_radius else 4
    sums_vector, visit = wp.types.vector(width, real), visit_function(real, width)
    largest, of_lane, gathered = largest_function(real), lane_function(wp.int32), gathered_function(THREADS_PER_BLOCK)
    add_body, write = force_functions(real, moving)

    @wp.func
    def reaches(at: transform, ball: real_4, low: vec3, high: vec3, reach: real):
        """Return True if a ball in the body's frame is within reach of the patch's box in the link's."""
        x = wp.transform_point(at, vec3(ball[0], ball[1], ball[2]))
        apart = wp.max(wp.max(low - x, x - high), vec3(real(0.0)))
        limit = reach + ball[3]
        return wp.dot(apart, apart) <= limit * limit

    @warp_kernel(
        module_options={"fast_math": True},
        launch_bounds=(THREADS_PER_BLOCK, MIN_BLOCKS_PER_MULTIPROCESSOR if real is wp.float32 else 1),
        grid_stride=False,
    )
    def measure_patches(first_env: int, s: patches, c: proximity_struct, truth: readings, raw: readings):
        env, place = wp.tid()
        env += first_env
        lane = place & wp.static(lanes - 1)
        i = s.order[place]
        limit = s.radius[i]
        noised = real(limit)
        corner = fetch(s.boxes, 2 * (place // wp.static(lanes)))
        low = vec3(corner[0], corner[1], corner[2])
        reach = corner[3]
        corner = fetch(s.boxes, 2 * (place // wp.static(lanes)) + 1)
        high = vec3(corner[0], corner[1], corner[2])
        if wp.static(has_radius):
            noised = s.noised[env, i]
            reach += largest(wp.max(noised - limit, real(0.0)))
        whole = sums_struct()
        measured = sums_struct()
        for k in range(c.bodies.shape[0]):
            at = s.pose[env, c.bodies[k]]
            q = wp.transform_get_rotation(at)
            p = wp.quat_rotate_inv(q, c.positions[i] - wp.transform_get_translation(at))
            sums = sums_vector()
            end = int(0)
            if reaches(at, fetch(s.clouds.cloud_ball, k), low, high, reach):
                end = s.clouds.cloud_start[k + 1]
            for base in range(s.clouds.cloud_start[k], end, wp.static(lanes)):
                is_near = bool(False)
                if base + lane < end:
                    is_near = reaches(at, fetch(s.clouds.ball, base + lane), low, high, reach)
                n_near = ballot_count(is_near)
                found = gathered(base + lane, is_near)
                for first in range(0, n_near, wp.static(clusters_at_once)):
                    at_once = first + lane // CLUSTER_SIZE
                    mine = of_lane(found, wp.min(at_once, n_near - 1))  # the cluster whose points this thread tests
                    for turn in range(wp.static(turns)):
                        x = fetch(s.clouds.points, mine * CLUSTER_SIZE + lane % CLUSTER_SIZE + turn)
                        is_near = at_once < n_near and reaches(at, x, low, high, reach)
                        sums = visit(sums, is_near, vec3(x[0], x[1], x[2]), p, limit, noised)
            if wp.isnan(p[0]):
                sums = sums_vector(real(wp.nan))
            whole = add_body(whole, c, env, i, k, sums[0], wp.quat_rotate(q, vec3(sums[1], sums[2], sums[3])))
            if wp.static(has_radius):
                moment = vec3(sums[5], sums[6], sums[7])
                measured = add_body(measured, c, env, i, k, sums[4], wp.quat_rotate(q, moment))
        write(c, whole, real(1.0), env, i, truth)
        if wp.static(is_separate):
            gain = real(1.0)
            if wp.static(has_gain):
                gain = c.gain[env, i]
            if wp.static(has_radius):
                write(c, measured, gain, env, i, raw)
            else:
                write(c, whole, gain, env, i, raw)

    return measure_patches


def record_patches(site: Site, clouds, parameters: Any, moving: bool, truth: wp.array, raw: wp.array | None) -> Launch:
    """Return the recorded launch that writes the readings of all taxels.

    Args:
        site: the site of the sensor.
        clouds: the points on the device.
        parameters: a :func:`~.forces.proximity_type`.
        moving: does shear or twist need velocities?
        truth: output of readings without gain.
        raw: output of readings with the site's radii and gains; ``None``: there is no measured branch.
    """
    context, probes, s = site.context, site.probes, patches_type(site.context.real)()
    lanes = lanes_per_environment(context.device)
    order = spatial_order(probes.positions, lanes)
    order = np.pad(order, (0, -len(order) % lanes), mode="edge")
    s.clouds, s.pose, s.radius = clouds, site.view.pose, site.radii
    s.order = wp.array(order, dtype=wp.int32, device=context.device)
    places, radii = probes.positions[order].reshape(-1, lanes, 3), probes.radii[order].reshape(-1, lanes)
    corners = np.stack([places.min(axis=1), places.max(axis=1)], axis=1)
    reach = np.broadcast_to(radii.max(axis=1)[:, None, None], (*corners.shape[:2], 1))
    boxes = np.concatenate([corners, reach * (1 + 1e-5)], axis=2)  # more, so that rounding never hides a point
    s.boxes = wp.array(boxes.reshape(-1, 4), dtype=wp.types.vector(4, context.real), device=context.device)
    has_radius, has_gain = raw is not None and site.radius is not None, raw is not None and site.gain is not None
    if has_radius:
        s.noised = site.radius
    kernel = patches_kernel(context.real, lanes, moving, has_radius, raw is not None, has_gain)
    outputs = [truth, truth if raw is None else raw]
    return context.record(kernel, (context.n_envs, len(order)), [s, parameters], outputs, block_dim=THREADS_PER_BLOCK)
