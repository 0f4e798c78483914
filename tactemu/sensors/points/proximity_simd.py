"""The readings of :mod:`.proximity_taxel` on a CPU: eight neighbouring taxels in parallel in vector registers.

Two tests of eight clusters, then of eight points, skip what is out of reach of all eight taxels; a point out of reach
of one taxel adds zero to its sums, which therefore equal those computed alone. One thread handles all taxels of an
environment, and computes the forces of eight taxels as soon as it has their sums.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false, reportOperatorIssue=false

import functools

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.simd import ROTATION, WIDTH, padded_length, vector_prelude
from tactemu.plan.launches import Launch
from tactemu.sensors.point_cloud import CLUSTER_SIZE, spatial_order
from tactemu.sensors.points.forces import proximity_type
from tactemu.sensors.points.near import near_type
from tactemu.sensors.sensor_model import Site

assert CLUSTER_SIZE == WIDTH


@functools.cache
def strips_type(real):
    """Return the Warp struct of taxels and points in the form in which vectors are loaded."""

    @wp.struct
    class Strips:
        near: near_type(real)
        order: wp.array(dtype=wp.int32)  # taxels, neighbours next to each other; the last strip repeats one
        lanes: wp.array3d(dtype=real)  # x, y, z, normal and radius of the taxels, (n_strips, 7, WIDTH)
        points: wp.array3d(dtype=real)  # x, y, z of the points, (n_clusters, 3, CLUSTER_SIZE)
        balls: wp.array3d(
            dtype=real
        )  # scratch: centre and radius of the near clusters, (n_envs, 4, n_clusters + WIDTH)

    return Strips


def make_strips(site: Site, near):
    """Return a filled :func:`strips_type`; ``near`` lists the clusters that taxels visit."""
    context, probes, strips = site.context, site.probes, strips_type(site.context.real)()
    order = np.concatenate([_central_first(part, probes.positions) for part in _strips(probes.positions)])
    lanes = np.concatenate([probes.positions, probes.normals, probes.radii[:, None]], axis=1)[order]

    def upload(values, dtype):
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=context.device)

    strips.near = near
    strips.order = upload(order, wp.int32)
    strips.lanes = upload(lanes.reshape(-1, WIDTH, lanes.shape[1]).swapaxes(1, 2), context.real)
    points = near.clouds.points.numpy()[:, :3].reshape(-1, CLUSTER_SIZE, 3)
    strips.points = upload(points.swapaxes(1, 2), context.real)
    strips.balls = wp.zeros((context.n_envs, 4, padded_length(len(points)) + WIDTH), dtype=context.real, device="cpu")
    return strips


def _strips(positions: np.ndarray) -> np.ndarray:
    """Return the taxels of each strip, shape ``(n_strips, WIDTH)``; the last strip repeats its last taxel."""
    order = spatial_order(positions, WIDTH)
    return np.pad(order, (0, padded_length(len(order)) - len(order)), mode="edge").reshape(-1, WIDTH)


def _central_first(strip: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return the taxels of a strip, the most central one first: the radius of a ball around it that holds the strip is
    then small. Repeated taxels stay at the end."""
    points = positions[strip]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    best = int(np.argmin(np.linalg.norm(points - middle, axis=1)))
    if best >= len(set(strip.tolist())) - 1:  # the repeated one
        return strip
    swapped = strip.copy()
    swapped[[0, best]] = strip[[best, 0]]
    return swapped


def record_strips(
    site: Site, strips, parameters, moving: bool, *, radius=None, truth=None, raw=None, has_gain: bool = False
) -> Launch:
    """Return the recorded launch that writes the readings of all taxels.

    Args:
        site: the site of the sensor.
        strips: the taxels (:func:`make_strips`).
        parameters: a :func:`~.forces.proximity_type`.
        moving: does shear or twist need velocities?
        radius: radius of each taxel [m], ``(n_envs, n_taxels)``; ``None``: the nominal ones.
        truth: output of readings without gain.
        raw: output of readings with the gain of ``parameters``, if ``has_gain``.
        has_gain: has each taxel a gain?
    """
    context = site.context
    kernel = strips_kernel(context.real, moving, radius is not None, truth is not None, raw is not None, has_gain)
    none = wp.zeros((0, 0), dtype=context.real, device=context.device)
    nothing = wp.zeros((0, 0, 0), dtype=context.real, device=context.device)
    outputs = [nothing if truth is None else truth, nothing if raw is None else raw]
    return context.record(kernel, context.n_envs, [strips, parameters, none if radius is None else radius], outputs)


@functools.cache
def strips_kernel(real, moving: bool, has_radius: bool, has_truth: bool, has_raw: bool, has_gain: bool):
    """Return the kernel of :func:`record_strips`, with a thread for each environment."""
    strips_struct, proximity_struct = strips_type(real), proximity_type(real)
    switches = {"MOVING": moving, "HAS_RADIUS": has_radius, "HAS_TRUTH": has_truth, "HAS_RAW": has_raw}
    head = "".join(f"    constexpr bool {name} = {str(on).lower()};\n" for name, on in switches.items())
    head += f"    constexpr bool HAS_GAIN = {str(has_gain).lower()};\n"
    numbers, readings = wp.array2d(dtype=real), wp.array3d(dtype=real)

    @wp.func_native(vector_prelude(real) + head + ROTATION + _BITS + _FORCES + _SUMS)
    def measure_env(
        e: int, strips: strips_struct, c: proximity_struct, radius: numbers, truth: readings, raw: readings
    ): ...

    @warp_kernel
    def measure_proximity(
        first_env: int, strips: strips_struct, c: proximity_struct, radius: numbers, truth: readings, raw: readings
    ):
        e = wp.tid()
        measure_env(e + first_env, strips, c, radius, truth, raw)

    return measure_proximity


_BITS = """
    typedef bool Bits __attribute__((ext_vector_type(wide)));
    auto bits = [](const Mask& mask) -> unsigned {
        return __builtin_bit_cast(unsigned char, __builtin_convertvector(mask, Bits));
    };
"""

_FORCES = """
    const int n = c.positions.shape[0];
    const Vector zero = {};
    const Number normal_factor = -c.normal, shear_factor = c.shear, twist_factor = c.twist;
    // The reading of forces.force_functions, from sums over all clouds
    auto write = [&](const Vectors& r, const Vectors& a, const Vector& total, const Vectors& motion,
                     const Vector& twist, const Vector& gain, const int* taxels, int count, Number* out) {
        const Vector push = normal_factor * gain * total;
        Vector fx = push * a.x, fy = push * a.y, fz = push * a.z;
        if (MOVING) {
            const Vector along = motion.x * a.x + motion.y * a.y + motion.z * a.z, factor = shear_factor * gain;
            fx += factor * (motion.x - along * a.x);
            fy += factor * (motion.y - along * a.y);
            fz += factor * (motion.z - along * a.z);
        }
        Vector tx = r.y * fz - r.z * fy, ty = r.z * fx - r.x * fz, tz = r.x * fy - r.y * fx;
        if (MOVING) {
            const Mask touches = total > 0;
            const Vector spin = twist_factor * twist / (touches ? total : zero + Number(1));
            tx = touches ? tx + spin * a.x : tx;
            ty = touches ? ty + spin * a.y : ty;
            tz = touches ? tz + spin * a.z : tz;
        }
        Number values[6][wide];
        put(values[0], fx), put(values[1], fy), put(values[2], fz);
        put(values[3], tx), put(values[4], ty), put(values[5], tz);
        for (int l = 0; l < count; ++l)
            for (int k = 0; k < 6; ++k)
                out[taxels[l] * int64_t(6) + k] = values[k][l];
    };
"""

_SUMS = """
    const auto& near = strips.near;
    const auto& clouds = near.clouds;
    const int n_clouds = clouds.bodies.shape[0], n_strips = strips.lanes.shape[0], stride = strips.balls.shape[2];
    const auto* const clusters = &wp::index(near.clusters, e, 0);
    const auto* const start = &wp::index(near.start, e, 0);
    Number* const balls = strips.balls.data + e * int64_t(4) * stride;
    for (int m = 0; m < start[n_clouds]; ++m) {
        const auto ball = clouds.ball.data[clusters[m]];
        for (int k = 0; k < 4; ++k)
            balls[k * stride + m] = ball[k];
    }
    Vector lane_number;
    for (int l = 0; l < wide; ++l)
        lane_number[l] = Number(l);
    for (int strip = 0; strip < n_strips; ++strip) {
        const int* const taxels = strips.order.data + strip * wide;
        const int count = n - strip * wide < wide ? n - strip * wide : wide;
        const Number* const lane = strips.lanes.data + strip * int64_t(7 * wide);
        const Vectors r = {get(lane), get(lane + wide), get(lane + 2 * wide)};
        const Vectors a = {get(lane + 3 * wide), get(lane + 4 * wide), get(lane + 5 * wide)};
        Vector limit = get(lane + 6 * wide), gain = zero + Number(1);
        if (HAS_RADIUS)
            for (int l = 0; l < wide; ++l)
                limit[l] = wp::index(radius, e, taxels[l]);
        Vector all = {}, all_twist = {};
        Vectors motion = {};
        for (int k = 0; k < n_clouds; ++k) {
            const int b = clouds.bodies.data[k];
            const auto at = wp::index(near.pose, e, b);
            const Vectors p = rotate(at.q, {r.x - at.p[0], r.y - at.p[1], r.z - at.p[2]}, -1);
            const Number mx = p.x[0], my = p.y[0], mz = p.z[0];
            const Vector ax = p.x - mx, ay = p.y - my, az = p.z - mz;
            const Number around = __builtin_reduce_max(limit + __builtin_elementwise_sqrt(ax * ax + ay * ay + az * az));
            const Number reach = around * Number(1.0001), squared_reach = reach * reach;  // rounding hides no point
            Vector total = {}, along_x = {}, along_y = {}, along_z = {};
            for (int m = start[k]; m < start[k + 1]; m += wide) {
                const Vector bx = get(balls + m) - mx, by = get(balls + stride + m) - my;
                const Vector bz = get(balls + 2 * stride + m) - mz;
                const Vector far = (get(balls + 3 * stride + m) + around) * Number(1.0001);
                const Mask hit = ~(bx * bx + by * by + bz * bz > far * far) & (lane_number < Number(start[k + 1] - m));
                for (unsigned found = bits(hit); found; found &= found - 1) {
                    const Number* const x = strips.points.data
                        + clusters[m + __builtin_ctz(found)] * int64_t(3 * wide);
                    const Vector px = get(x) - mx, py = get(x + wide) - my, pz = get(x + 2 * wide) - mz;
                    const Mask within = ~(px * px + py * py + pz * pz > squared_reach);
                    for (unsigned points = bits(within); points; points &= points - 1) {
                        const Number* const point = x + __builtin_ctz(points);
                        const Vector dx = point[0] - p.x, dy = point[wide] - p.y, dz = point[2 * wide] - p.z;
                        const Vector apart = limit - __builtin_elementwise_sqrt(dx * dx + dy * dy + dz * dz);
                        const Vector overlap = apart > 0 ? apart : zero;
                        total += overlap, along_x += overlap * dx, along_y += overlap * dy, along_z += overlap * dz;
                    }
                }
            }
            total = p.x == p.x ? total : p.x;  // a pose that is not finite
            all += total;
            if (MOVING) {
                const auto v = wp::index(c.velocity, e, b), w = wp::index(c.spin, e, b);
                const auto u = wp::add(w, c.link_spin.data[e]);
                const Vectors moment = rotate(at.q, {along_x, along_y, along_z}, 1);
                const Vector sx = w[1] * r.z - w[2] * r.y, sy = w[2] * r.x - w[0] * r.z, sz = w[0] * r.y - w[1] * r.x;
                motion.x += total * (v[0] + sx) + (u[1] * moment.z - u[2] * moment.y);
                motion.y += total * (v[1] + sy) + (u[2] * moment.x - u[0] * moment.z);
                motion.z += total * (v[2] + sz) + (u[0] * moment.y - u[1] * moment.x);
                all_twist += total * (w[0] * a.x + w[1] * a.y + w[2] * a.z);
            }
        }
        const int64_t first = e * int64_t(6) * n;
        if (HAS_TRUTH)
            write(r, a, all, motion, all_twist, gain, taxels, count, truth.data + first);
        if (HAS_GAIN)
            for (int l = 0; l < wide; ++l)
                gain[l] = wp::index(c.gain, e, taxels[l]);
        if (HAS_RAW)
            write(r, a, all, motion, all_twist, gain, taxels, count, raw.data + first);
    }
"""
