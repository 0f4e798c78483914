"""The laws that act on each number of a reading by itself, fused into one kernel.

The kernel is built for the set of laws that a sensor has switched on: the others leave no code, draw nothing and read
no argument. One thread handles four columns of one environment, which share the four words of a draw. The columns lie a
quarter of the row apart, so that neighbouring threads access neighbouring memory.
"""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportPossiblyUnboundVariable=false, reportInvalidTypeForm=false

import functools

import warp as wp

from tactemu.imperfections import coefficients as co
from tactemu.imperfections.material import play, rise
from tactemu.imperfections.random import draw, normals
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


@wp.struct
class Memory:
    """The memory of the load, ``(n_envs, n_columns)`` each; empty for laws that are off."""

    load: wp.array2d(dtype=wp.float64)
    overshoot: wp.array2d(dtype=wp.float64)
    undershoot: wp.array2d(dtype=wp.float64)
    creep_load: wp.array2d(dtype=wp.float64)
    crept: wp.array2d(dtype=wp.float64)
    loop: wp.array2d(dtype=wp.float64)


@functools.cache
def electronics_type(real: type):
    """Return the Warp struct of the electronics' parameters and state; arrays are empty for laws that are off."""
    table = wp.array2d(dtype=real)

    @wp.struct
    class Electronics:
        n_channels: wp.int32
        coefficient: wp.array(dtype=wp.float64)
        walk_key: wp.uint32
        noise_key: wp.uint32
        streams: wp.array(dtype=wp.vec2i)
        gains: table  # (n_envs, n_taxels)
        sensitivity: table  # this and the following: (n_envs, 1 or n_columns)
        drift: table
        walk_each: table
        walk_root: table
        noise_each: table
        noise_root: table
        offset: table
        low: table
        high: table
        quantum: table
        is_filler: wp.array(dtype=wp.uint8)  # (n_taxels,)
        walked: wp.array2d(dtype=wp.float64)  # state, (n_envs, n_columns)
        stuck: table  # likewise

    return Electronics


@functools.cache
def material_kernel(real: type, laws: frozenset[str]):
    """Return the kernel of the laws with a memory of the load: hysteresis, creep and backlash (float64 state)."""
    hysteresis, two_sided = "hysteresis" in laws, "unloading" in laws
    creep, backlash = "creep" in laws, "backlash" in laws

    @wp.kernel(module="unique", enable_backward=False)
    def material_memory(
        first_env: int,
        x: wp.array2d(dtype=real),
        coefficient: wp.array(dtype=wp.float64),
        strengths: wp.vec3d,
        half_width: wp.float64,
        memory: Memory,
        out: wp.array2d(dtype=real),
    ):
        e, group = wp.tid()
        e = natural(e + first_env)
        group = natural(group)
        for c in range(group, x.shape[1], threads(x.shape[1])):
            v = wp.float64(x[e, c])
            if is_finite(v):
                if wp.static(hysteresis):
                    change = v - memory.load[e, c]
                    up = change
                    if wp.static(two_sided):
                        up = rise(v, memory.load[e, c])
                        under = coefficient[co.UNDERSHOOT] * memory.undershoot[e, c] + (change - up)
                        memory.undershoot[e, c] = under
                    over = coefficient[co.OVERSHOOT] * memory.overshoot[e, c] + up
                    memory.overshoot[e, c] = over
                    memory.load[e, c] = v
                    v = v + strengths[0] * over
                    if wp.static(two_sided):
                        v = v + strengths[1] * memory.undershoot[e, c]
                if wp.static(creep):
                    before = memory.creep_load[e, c]
                    z = memory.crept[e, c]
                    z = z + coefficient[co.CREEP] * (before - z) + coefficient[co.CREEP_RAMP] * (v - before)
                    memory.creep_load[e, c] = v
                    memory.crept[e, c] = z
                    v = v + strengths[2] * z
                if wp.static(backlash):
                    v = play(v, memory.loop[e, c], half_width)
                    memory.loop[e, c] = v
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
    gain, temperature, walk, noise = (k in laws for k in ("probe_gain", "temperature", "random_walk", "noise"))
    density, walk_density = "noise_density" in laws, "random_walk_density" in laws
    bias, saturation, resolution = (k in laws for k in ("bias", "saturation_range", "resolution"))
    dead, filler = "dead" in laws, "filler" in laws
    exact = real(2.0**24) if real is wp.float32 else real(2.0**53)
    normals4, electronics_struct, readings = normals(real), electronics_type(real), wp.array2d(dtype=real)

    @wp.func
    def sigma(e: int, c: int, each: wp.array2d(dtype=real), per_root: wp.array2d(dtype=real), scale: real) -> real:
        a = each[e, wp.min(c, each.shape[1] - 1)]
        b = per_root[e, wp.min(c, per_root.shape[1] - 1)] * scale
        return wp.sqrt(a * a + b * b)

    @wp.kernel(module="unique", enable_backward=False)
    def electronics(first_env: int, clock: Clock, x: readings, given: electronics_struct, out: readings):
        e, group = wp.tid()
        e = natural(e + first_env)
        group = natural(group)
        lane = int(-1)
        if wp.static(walk):
            walk_normal = normals4(draw(given.walk_key, given.streams, e, group, clock.step[0]))
        if wp.static(noise):
            noise_normal = normals4(draw(given.noise_key, given.streams, e, group, clock.step[0]))
        for c in range(group, x.shape[1], threads(x.shape[1])):
            lane += 1
            v = x[e, c]
            if is_finite(v):
                if wp.static(gain):
                    v = v * given.gains[e, c // given.n_channels]
                if wp.static(temperature):
                    warm = real(given.coefficient[co.TEMPERATURE])
                    v = v * (real(1.0) + given.sensitivity[e, wp.min(c, given.sensitivity.shape[1] - 1)] * warm)
                    v = v + given.drift[e, wp.min(c, given.drift.shape[1] - 1)] * warm
                if wp.static(walk):
                    if wp.static(walk_density):
                        s = sigma(e, c, given.walk_each, given.walk_root, real(given.coefficient[co.WALK_STEP]))
                    else:
                        s = given.walk_each[e, wp.min(c, given.walk_each.shape[1] - 1)]
                    w = given.coefficient[co.WALK] * given.walked[e, c] + wp.float64(s * walk_normal[lane])
                    given.walked[e, c] = w
                    v = real(wp.float64(v) + w)
                if wp.static(noise):
                    if wp.static(density):
                        s = sigma(e, c, given.noise_each, given.noise_root, real(given.coefficient[co.NOISE]))
                    else:
                        s = given.noise_each[e, wp.min(c, given.noise_each.shape[1] - 1)]
                    v = v + s * noise_normal[lane]
                if wp.static(bias):
                    v = v + given.offset[e, wp.min(c, given.offset.shape[1] - 1)]
                if wp.static(saturation):
                    v = wp.clamp(v, given.low[e, 0], given.high[e, 0])
                if wp.static(resolution):
                    q = given.quantum[e, wp.min(c, given.quantum.shape[1] - 1)]
                    steps = v / q
                    # Beyond the mantissa a float has no digits finer than the quantiser's step; q = 0 is also skipped.
                    if q > real(0.0) and wp.abs(steps) < exact:
                        v = wp.rint(steps) * q
                if wp.static(dead):
                    hold = given.stuck[e, c]
                    if is_nan(hold):
                        hold = out[e, c]
                        given.stuck[e, c] = hold
                    elif wp.isinf(hold) and hold < real(0.0):
                        hold = v
                        given.stuck[e, c] = v
                    if is_finite(hold):
                        v = hold
                if wp.static(filler):
                    if given.is_filler[c // given.n_channels] != wp.uint8(0):
                        v = real(0.0)
            out[e, c] = v

    return electronics
