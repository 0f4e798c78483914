"""The sums of :mod:`.proximity_sums` on a CPU: eight neighbouring taxels in parallel in vector registers.

One test skips a cluster out of reach of all eight; a point out of reach of one taxel adds zero to its sums, which
therefore equal those computed alone.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.geometry.simd import WIDTH, vector_prelude
from tactemu.sensors.point_cloud import CLUSTER_SIZE
from tactemu.sensors.points.near import near_type


@functools.cache
def sums_type(real):
    """Return the Warp struct of the sums of taxels over the points around them, on any device."""

    @wp.struct
    class Sums:
        near: near_type(real)
        order: wp.array(dtype=wp.int32)  # taxels, neighbours next to each other
        positions: wp.array(dtype=wp.types.vector(3, real))
        radius: wp.array2d(dtype=real)  # of each taxel, (1 or n_envs, n_taxels)
        sums: wp.array3d(dtype=wp.types.vector(4, real))  # written, (n_envs, n_clouds, n_taxels)

    return Sums


@functools.cache
def strip_sums_kernel(real):
    """Return the kernel of :mod:`.proximity_sums` for a CPU, with a thread for each ``WIDTH`` places."""
    transform, sums_struct = wp.types.transformation(real), sums_type(real)

    @wp.func_native(vector_prelude(real) + _SUM.replace("CLUSTER_SIZE", str(CLUSTER_SIZE)))
    def add_up(env: int, k: int, first: int, at: transform, sums: sums_struct): ...

    @wp.kernel(module="unique", enable_backward=False)
    def sum_strips(first_env: int, sums: sums_struct):
        env, k, strip = wp.tid()
        env += first_env
        add_up(env, k, strip * wp.static(WIDTH), sums.near.pose[env, sums.near.clouds.bodies[k]], sums)

    return sum_strips


_SUM = """
    typedef wp::vec_t<3, Number> Point;
    const auto& clouds = sums.near.clouds;
    const auto& order = sums.order;
    const Number* const radius = &wp::index(sums.radius, wp::min(env, sums.radius.shape[0] - 1), 0);
    const int n = order.shape[0] - first < wide ? order.shape[0] - first : wide;
    const auto turn = wp::transform_get_rotation(at);
    const Point origin = wp::transform_get_translation(at);
    Vector x, y, z, limit;
    Point low, high;
    Number farthest = Number(0);
    for (int l = 0; l < wide; ++l) {  // a surplus lane repeats the last
        const int i = order.data[first + (l < n ? l : n - 1)];
        const Point p = wp::quat_rotate_inv(turn, wp::sub(sums.positions.data[i], origin));
        x[l] = p[0], y[l] = p[1], z[l] = p[2], limit[l] = radius[i];
        low = l ? wp::min(low, p) : p, high = l ? wp::max(high, p) : p;
        farthest = radius[i] > farthest ? radius[i] : farthest;
    }
    const Point middle = wp::mul(wp::add(low, high), Number(0.5));
    const Number around = farthest + wp::length(wp::sub(high, middle));
    Vector total = {}, along_x = {}, along_y = {}, along_z = {};
    const int end = wp::index(sums.near.start, env, k + 1);
    for (int m = wp::index(sums.near.start, env, k); m < end; ++m) {
        const int c = wp::index(sums.near.clusters, env, m);
        const wp::vec_t<4, Number> ball = clouds.ball.data[c];
        const Point away = wp::sub(middle, Point(ball[0], ball[1], ball[2]));
        const Number reach = (ball[3] + around) * Number(1.0001);  // rounding never hides a point
        if (wp::dot(away, away) > reach * reach)
            continue;
        for (int j = c * CLUSTER_SIZE; j < c * CLUSTER_SIZE + clouds.counts.data[c]; ++j) {
            const auto& point = clouds.points.data[j];
            const Vector dx = point[0] - x, dy = point[1] - y, dz = point[2] - z;
            const Vector apart = limit - __builtin_elementwise_sqrt(dx * dx + dy * dy + dz * dz);
            const Vector overlap = apart > 0 ? apart : Vector{};
            total += overlap, along_x += overlap * dx, along_y += overlap * dy, along_z += overlap * dz;
        }
    }
    for (int l = 0; l < n; ++l) {
        const Point moment = wp::quat_rotate(turn, Point(along_x[l], along_y[l], along_z[l]));
        const Number sum = x[l] == x[l] ? total[l] : x[l];  // a pose that is not finite
        wp::index(sums.sums, env, k, first + l) = wp::vec_t<4, Number>(moment[0], moment[1], moment[2], sum);
    }
"""
