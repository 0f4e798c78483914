"""The laws that act on each number of a reading by itself, fused into one kernel.

The kernel is built for the set of laws that a sensor has switched on: the others leave no code, draw nothing and read
no argument. One thread handles four columns of one environment, which share the four words of a draw. The columns lie a
quarter of the row apart, so that neighbouring threads access neighbouring memory.
"""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportPossiblyUnboundVariable=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections import coefficients as co
from tactemu.imperfections.material import play, rise
from tactemu.imperfections.random import draw, normals, step_of
from tactemu.plan.clock import Clock
from tactemu.plan.scalars import is_finite, is_nan, natural

COLUMNS_PER_THREAD = wp.constant(4)
"""Columns that one thread handles: a draw yields four random words."""
ALIVE = float("inf")
"""The value of a live column in the array of stuck readings; a finite number is the reading of a dead column."""
DIES = float("nan")
"""The value of a column that dies in the next step, stuck at the reading before it."""
DIES_AT_FIRST = float("-inf")
"""The value of a column that dies in the next step, stuck at the reading of that step."""


@wp.func
def threads(columns: int) -> int:
    """Return the number of threads per environment, which is also the distance between the columns of one thread."""
    return (columns + COLUMNS_PER_THREAD - 1) // COLUMNS_PER_THREAD


@functools.cache
def material_kernel(real: type, laws: frozenset[str]):
    """Return the kernel of the laws with a memory of the load: hysteresis, creep and backlash (float64 state)."""
    hysteresis, two_sided = "hysteresis" in laws, "unloading" in laws
    creep, backlash = "creep" in laws, "backlash" in laws

    @warp_kernel
    def material_memory(
        first_env: int,
        x: wp.array2d(dtype=real),
        coefficient: wp.array(dtype=wp.float64),
        strengths: wp.vec3d,
        half_width: wp.float64,
        # state, (n_envs, n_columns)
        load: wp.array2d(dtype=wp.float64),
        overshoot: wp.array2d(dtype=wp.float64),
        undershoot: wp.array2d(dtype=wp.float64),
        creep_load: wp.array2d(dtype=wp.float64),
        crept: wp.array2d(dtype=wp.float64),
        loop: wp.array2d(dtype=wp.float64),
        out: wp.array2d(dtype=real),
    ):
        e, group = wp.tid()
        e = natural(e + first_env)
        group = natural(group)
        for c in range(group, x.shape[1], threads(x.shape[1])):
            v = wp.float64(x[e, c])
            if is_finite(v):
                if wp.static(hysteresis):
                    change = v - load[e, c]
                    up = change
                    if wp.static(two_sided):
                        up = rise(v, load[e, c])
                        under = coefficient[co.UNDERSHOOT] * undershoot[e, c] + (change - up)
                        undershoot[e, c] = under
                    over = coefficient[co.OVERSHOOT] * overshoot[e, c] + up
                    overshoot[e, c] = over
                    load[e, c] = v
                    v = v + strengths[0] * over
                    if wp.static(two_sided):
                        v = v + strengths[1] * undershoot[e, c]
                if wp.static(creep):
                    before = creep_load[e, c]
                    z = crept[e, c]
                    z = z + coefficient[co.CREEP] * (before - z) + coefficient[co.CREEP_RAMP] * (v - before)
                    creep_load[e, c] = v
                    crept[e, c] = z
                    v = v + strengths[2] * z
                if wp.static(backlash):
                    v = play(v, loop[e, c], half_width)
                    loop[e, c] = v
                out[e, c] = real(v)
            else:
                out[e, c] = x[e, c]

    return material_memory


@functools.cache
def electronics_kernel(real: type, laws: frozenset[str]):
    """Return the kernel of gain, temperature, walk, noise, bias, saturation, rounding, dead taxels and fillers.

    They act in this order. A number that is not finite passes through unchanged and changes no state, so that it never
    becomes a valid reading.
    """
    gain, temperature, walk, noise = (k in laws for k in ("gain", "temperature", "random_walk", "noise"))
    density, walk_density = "noise_density" in laws, "random_walk_density" in laws
    bias, saturation, resolution = (k in laws for k in ("bias", "saturation_range", "resolution"))
    dead, filler = "dead" in laws, "filler" in laws
    exact = real(2.0**24) if real is wp.float32 else real(2.0**53)
    normals4 = normals(real)

    @wp.func
    def sigma(e: int, c: int, each: wp.array2d(dtype=real), per_root: wp.array2d(dtype=real), scale: real) -> real:
        a = each[e, wp.min(c, each.shape[1] - 1)]
        b = per_root[e, wp.min(c, per_root.shape[1] - 1)] * scale
        return wp.sqrt(a * a + b * b)

    @warp_kernel
    def electronics(
        first_env: int,
        x: wp.array2d(dtype=real),
        n_channels: int,
        clock: Clock,
        coefficient: wp.array(dtype=wp.float64),
        warmth: wp.array(dtype=wp.float64),
        walk_keys: wp.vec2ui,
        noise_keys: wp.vec2ui,
        # parameters, (n_envs, 1 or n_columns); gain (n_envs, n_taxels), is_filler (n_taxels,)
        gains: wp.array2d(dtype=real),
        sensitivity: wp.array2d(dtype=real),
        drift: wp.array2d(dtype=real),
        walk_each: wp.array2d(dtype=real),
        walk_root: wp.array2d(dtype=real),
        noise_each: wp.array2d(dtype=real),
        noise_root: wp.array2d(dtype=real),
        offset: wp.array2d(dtype=real),
        low: wp.array2d(dtype=real),
        high: wp.array2d(dtype=real),
        quantum: wp.array2d(dtype=real),
        is_filler: wp.array(dtype=wp.uint8),
        # state, (n_envs, n_columns)
        walked: wp.array2d(dtype=wp.float64),
        stuck: wp.array2d(dtype=real),
        out: wp.array2d(dtype=real),
    ):
        e, group = wp.tid()
        e = natural(e + first_env)
        group = natural(group)
        lane = int(-1)
        if wp.static(walk or noise):
            stream = clock.streams[e]
            step = step_of(clock, stream, e)
        if wp.static(walk):
            walk_normal = normals4(draw(walk_keys, stream, step, group))
        if wp.static(noise):
            noise_normal = normals4(draw(noise_keys, stream, step, group))
        for c in range(group, x.shape[1], threads(x.shape[1])):
            lane += 1
            v = x[e, c]
            if is_finite(v):
                if wp.static(gain):
                    v = v * gains[e, c // n_channels]
                if wp.static(temperature):
                    warm = real(warmth[wp.min(e, warmth.shape[0] - 1)])
                    v = v * (real(1.0) + sensitivity[e, wp.min(c, sensitivity.shape[1] - 1)] * warm)
                    v = v + drift[e, wp.min(c, drift.shape[1] - 1)] * warm
                if wp.static(walk):
                    if wp.static(walk_density):
                        s = sigma(e, c, walk_each, walk_root, real(coefficient[co.WALK_STEP]))
                    else:
                        s = walk_each[e, wp.min(c, walk_each.shape[1] - 1)]
                    w = coefficient[co.WALK] * walked[e, c] + wp.float64(s * walk_normal[lane])
                    walked[e, c] = w
                    v = real(wp.float64(v) + w)
                if wp.static(noise):
                    if wp.static(density):
                        s = sigma(e, c, noise_each, noise_root, real(coefficient[co.NOISE]))
                    else:
                        s = noise_each[e, wp.min(c, noise_each.shape[1] - 1)]
                    v = v + s * noise_normal[lane]
                if wp.static(bias):
                    v = v + offset[e, wp.min(c, offset.shape[1] - 1)]
                if wp.static(saturation):
                    v = wp.clamp(v, low[e, 0], high[e, 0])
                if wp.static(resolution):
                    q = quantum[e, wp.min(c, quantum.shape[1] - 1)]
                    steps = v / q
                    # Beyond the mantissa a float has no digits finer than the quantiser's step; q = 0 is also skipped.
                    if q > real(0.0) and wp.abs(steps) < exact:
                        v = wp.rint(steps) * q
                if wp.static(dead):
                    hold = stuck[e, c]
                    if is_nan(hold):
                        hold = out[e, c]
                        stuck[e, c] = hold
                    elif wp.isinf(hold) and hold < real(0.0):
                        hold = v
                        stuck[e, c] = v
                    if is_finite(hold):
                        v = hold
                if wp.static(filler):
                    if is_filler[c // n_channels] != wp.uint8(0):
                        v = real(0.0)
            out[e, c] = v

    return electronics
