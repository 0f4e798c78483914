"""The sums of :mod:`.proximity_sums` on a CPU: eight neighbouring taxels in parallel in vector registers.

One test skips a cluster out of reach of all eight; a point out of reach of one taxel adds zero to its sums, which
therefore equal those computed alone.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.geometry.simd import WIDTH, vector_prelude
from tactemu.sensors.point_cloud import CLUSTER_SIZE
from tactemu.sensors.points.table import cloud_type


@functools.cache
def strip_sums_kernel(real):
    """Return the kernel of :mod:`.proximity_sums` for a CPU, with a thread for each ``WIDTH`` places."""
    vec3, vec4 = wp.types.vector(3, real), wp.types.vector(4, real)
    transform = wp.types.transformation(real)

    @wp.func_native(vector_prelude(real) + _SUM.replace("CLUSTER_SIZE", str(CLUSTER_SIZE)))
    def add_up(
        points: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        balls: wp.array(dtype=vec4),
        near: wp.array(dtype=wp.int32),
        begin: int,
        end: int,
        at: transform,
        order: wp.array(dtype=wp.int32),
        first: int,
        positions: wp.array(dtype=vec3),
        radius: wp.array(dtype=real),
        sums: wp.array(dtype=vec4),
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def sum_strips(
        first_env: int,
        clouds: cloud_type(real),
        near: wp.array2d(dtype=wp.int32),
        near_start: wp.array2d(dtype=wp.int32),
        pose: wp.array2d(dtype=transform),
        order: wp.array(dtype=wp.int32),
        positions: wp.array(dtype=vec3),
        radius: wp.array2d(dtype=real),
        # outputs
        sums: wp.array3d(dtype=vec4),
    ):
        env, k, strip = wp.tid()
        env += first_env
        at = pose[env, clouds.bodies[k]]
        own = radius[wp.min(env, radius.shape[0] - 1)]
        begin = near_start[env, k]
        end = near_start[env, k + 1]
        first = strip * wp.static(WIDTH)
        add_up(
            clouds.points, clouds.counts, clouds.ball, near[env], begin, end, at, order, first, positions, own,
            sums[env, k],
        )  # fmt: skip

    return sum_strips


_SUM = """
    typedef wp::vec_t<3, Number> Point;
    const int n = order.shape[0] - first < wide ? order.shape[0] - first : wide;
    const auto turn = wp::transform_get_rotation(at);
    const Point origin = wp::transform_get_translation(at);
    Vector x, y, z, limit;
    Point low, high;
    Number farthest = Number(0);
    for (int l = 0; l < wide; ++l) {  // a surplus lane repeats the last
        const int i = order.data[first + (l < n ? l : n - 1)];
        const Point p = wp::quat_rotate_inv(turn, wp::sub(positions.data[i], origin));
        x[l] = p[0], y[l] = p[1], z[l] = p[2], limit[l] = radius.data[i];
        low = l ? wp::min(low, p) : p, high = l ? wp::max(high, p) : p;
        farthest = radius.data[i] > farthest ? radius.data[i] : farthest;
    }
    const Point middle = wp::mul(wp::add(low, high), Number(0.5));
    const Number around = farthest + wp::length(wp::sub(high, middle));
    Vector total = {}, along_x = {}, along_y = {}, along_z = {};
    for (int k = begin; k < end; ++k) {
        const int c = near.data[k];
        const wp::vec_t<4, Number> ball = balls.data[c];
        const Point away = wp::sub(middle, Point(ball[0], ball[1], ball[2]));
        const Number reach = (ball[3] + around) * Number(1.0001);  // rounding never hides a point
        if (wp::dot(away, away) > reach * reach)
            continue;
        for (int j = c * CLUSTER_SIZE; j < c * CLUSTER_SIZE + counts.data[c]; ++j) {
            const auto& point = points.data[j];
            const Vector dx = point[0] - x, dy = point[1] - y, dz = point[2] - z;
            const Vector apart = limit - __builtin_elementwise_sqrt(dx * dx + dy * dy + dz * dz);
            const Vector overlap = apart > 0 ? apart : Vector{};
            total += overlap, along_x += overlap * dx, along_y += overlap * dy, along_z += overlap * dz;
        }
    }
    for (int l = 0; l < n; ++l) {
        const Point moment = wp::quat_rotate(turn, Point(along_x[l], along_y[l], along_z[l]));
        const Number sum = x[l] == x[l] ? total[l] : x[l];  // a pose that is not finite
        sums.data[first + l] = wp::vec_t<4, Number>(moment[0], moment[1], moment[2], sum);
    }
"""
