"""The common kernel of all probes on a CPU where every sensed body is a ball: eight neighbouring probes in parallel in
vector registers.

Each lane computes what :mod:`.strips` computes for its probe, operation by operation, so that both kernels give equal
readings. One thread handles all probes of an environment.

The SIMD form of a formula is a snippet that defines ``CHANNELS`` and a function ``measure(touch, first, out)``: it
writes the vector of each channel of eight probes, the first of which has the index ``first``, and reads parameters from
``task.numbers``. Where no body is near, all channels are 0.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false, reportOperatorIssue=false

import functools

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.shape import FAR
from tactemu.geometry.shapes.sphere import SPHERE
from tactemu.geometry.simd import WIDTH, vector_prelude
from tactemu.sensors.probes.formula import Formula, task_type
from tactemu.sensors.sensed import near_bits
from tactemu.sensors.sensor_model import Site

_LANE_ROWS = 4
"""Rows of :func:`probe_lanes`: x, y, z and radius."""


def is_ball_formula(formula: Formula) -> bool:
    """Return True if :func:`ball_kernel` computes this formula."""
    return bool(formula.simd) and formula.kinds == {SPHERE} and not formula.along_normal and not formula.at_surface


def probe_lanes(site: Site) -> wp.array:
    """Return the positions and radii of the probes, strip by strip, shape ``(n_strips, 4, WIDTH)``; a surplus lane is a
    filler."""
    probes = site.probes
    count = -(-probes.n // WIDTH)
    rows = np.zeros((count * WIDTH, _LANE_ROWS))
    rows[: probes.n, :3], rows[: probes.n, 3] = probes.positions, probes.radii
    lanes = rows.reshape(count, WIDTH, _LANE_ROWS).swapaxes(1, 2)
    return wp.array(np.ascontiguousarray(lanes), dtype=site.context.real, device=site.context.device)


@functools.cache
def ball_kernel(formula: Formula):
    """Return the kernel of a formula that has a SIMD form, with a thread for each environment."""
    real, task_struct = formula.real, task_type(formula.real, formula.numbers)
    switches = {"SEPARATE": formula.separate, "HAS_GAIN": formula.has_gain, "HAS_RADIUS": formula.has_radius}
    head = "".join(f"    constexpr bool {name} = {str(bool(on)).lower()};\n" for name, on in switches.items())
    snippet = vector_prelude(real) + head + _TOUCH + formula.simd + _STRIPS.replace("FAR", repr(FAR))

    @wp.func_native(snippet)
    def measure_env(e: int, near: wp.int64, task: task_struct, lanes: wp.array3d(dtype=real)): ...

    @warp_kernel
    def measure_balls(first_env: int, task: task_struct, lanes: wp.array3d(dtype=real)):
        e = wp.tid()
        e += first_env
        measure_env(e, near_bits(task.sensed.near, task.sensed.targets, e), task, lanes)

    return measure_balls


_TOUCH = """
    struct Touch {
        Vector depth, gain;
        Vector x, y, z;  // of the probe
        Vector nx, ny, nz;  // normal of the nearest body
        Mask body;  // its index; -1: no body is near
    };
"""

_STRIPS = """
    const auto& sensed = task.sensed;
    const auto& shapes = sensed.shapes;
    const int n = task.probes.radii.shape[0], n_targets = sensed.targets.shape[0];
    const auto* const poses = &wp::index(sensed.pose, e, 0);
    const int64_t start = int64_t(e) * n;
    Number* const truth = task.truth.data + start * CHANNELS;
    Number* const raw = SEPARATE ? task.raw.data + start * CHANNELS : nullptr;
    const Number* const radii = HAS_RADIUS ? task.radius.data + start : nullptr;
    const Number* const gains = HAS_GAIN ? task.gain.data + start : nullptr;
    auto is_near = [&](int t) { return t > 63 || ((near >> t) & 1); };
    auto write = [&](const Touch& touch, Mask wanted, bool all_wanted, int first, int count, Number* to) {
        Vector channels[CHANNELS];
        measure(touch, first, channels);
        if (CHANNELS == 1 && all_wanted) {
            put(to + first, channels[0]);
            return;
        }
        Number values[CHANNELS][wide];
        for (int c = 0; c < CHANNELS; ++c)
            put(values[c], channels[c]);
        Number* const out = to + int64_t(first) * CHANNELS;
        if (all_wanted) {
            for (int l = 0; l < wide; ++l)
                for (int c = 0; c < CHANNELS; ++c)
                    out[l * CHANNELS + c] = values[c][l];
            return;
        }
        for (int l = 0; l < count; ++l)
            for (int c = 0; c < CHANNELS; ++c)
                if (wanted[l])
                    out[l * CHANNELS + c] = values[c][l];
    };
    for (int strip = 0; strip * wide < n; ++strip) {
        const int first = strip * wide, count = n - first < wide ? n - first : wide;
        const Number* const lane = lanes.data + strip * int64_t(4 * wide);
        const Vector x = get(lane), y = get(lane + wide), z = get(lane + 2 * wide), radius = get(lane + 3 * wide);
        Vector measured = radius, margin = radius;
        Number noise = Number(0);
        if (HAS_RADIUS) {
            for (int l = 0; l < count; ++l) {
                measured[l] = radii[first + l];
                margin[l] = wp::max(radius[l], measured[l]);
                noise = wp::max(noise, measured[l] - radius[l]);
            }
        }
        const auto around = task.probes.strip_ball.data[strip];
        bool is_touched = false;
        for (int t = 0; t < n_targets && !is_touched; ++t) {
            if (!is_near(t))
                continue;
            const int b = sensed.targets.data[t];
            const auto& at = poses[b].p;
            const Number dx = around[0] - at[0], dy = around[1] - at[1], dz = around[2] - at[2];
            const Number reach = shapes.bound.data[b] + around[3] + noise;
            is_touched = !(dx * dx + dy * dy + dz * dz > reach * reach);  // NaN needs the exact test
        }
        if (!is_touched) {
            for (int k = 0; k < count * CHANNELS; ++k)
                truth[first * int64_t(CHANNELS) + k] = Number(0);
            if (SEPARATE)
                for (int k = 0; k < count * CHANNELS; ++k)
                    raw[first * int64_t(CHANNELS) + k] = Number(0);
            continue;
        }
        Vector best = Vector{} + Number(FAR), px = {}, py = {}, pz = {}, apart = {};
        Mask body = Mask{} - 1;
        for (int t = 0; t < n_targets; ++t) {
            if (!is_near(t))
                continue;
            const int b = sensed.targets.data[t];
            const auto& at = poses[b].p;
            if (at[0] != at[0]) {  // a pose that is not finite; no distance is less than NaN
                best = Vector{} + at[0];
                body = Mask{} - 1;
                continue;
            }
            const Vector dx = x - at[0], dy = y - at[1], dz = z - at[2];
            const Vector squared = dx * dx + dy * dy + dz * dz, reach = shapes.bound.data[b] + margin;
            const Vector length = __builtin_elementwise_sqrt(squared), distance = length - shapes.size.data[b][0];
            const Mask nearer = ~(squared > reach * reach) & (distance < best);
            best = nearer ? distance : best, body = nearer ? Mask{} + b : body;
            px = nearer ? dx : px, py = nearer ? dy : py, pz = nearer ? dz : pz, apart = nearer ? length : apart;
        }
        const Mask has_normal = apart > 0, wanted = radius > 0;
        const Vector zero = {};
        const bool all_wanted = __builtin_reduce_and(wanted) != 0;
        Touch touch{radius - best, zero + 1, x, y, z, has_normal ? px / apart : zero, has_normal ? py / apart : zero,
                    has_normal ? pz / apart : zero, body};
        write(touch, wanted, all_wanted, first, count, truth);
        if (SEPARATE) {
            touch.depth = measured - best;
            if (HAS_GAIN)
                for (int l = 0; l < count; ++l)
                    touch.gain[l] = gains[first + l];
            write(touch, wanted, all_wanted, first, count, raw);
        }
    }
"""
