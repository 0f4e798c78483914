"""Kernels of :mod:`tactemu.imperfections.delivery`."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections.elementwise import threads
from tactemu.imperfections.random import draw, step_of, unit_f64
from tactemu.imperfections.ring import entries, entry_before, share_of_newer, slot
from tactemu.plan.clock import Clock
from tactemu.plan.scalars import natural

ROUNDING = wp.constant(wp.int64(1))
"""Time by which an entry may be too new and still count [ns], since times are rounded to whole nanoseconds."""
THIS_STEP = wp.constant(-1)
"""A value in place of a slot of the ring: the reading of this step, which is not in the ring yet."""
UNKNOWN = wp.constant(-2)
"""A value in place of a slot of the ring: there is no reading, so that zero is delivered."""


@functools.cache
def select_kernel(jitter: bool, nearest: bool, linear: bool, reorder: bool):
    """Return the kernel that selects the slots of the ring for each environment.

    These are the slot to write, the slot to read, and with ``linear`` the next newer slot with its share.
    """

    @warp_kernel
    def select_entry(
        first_env: int,
        clock: Clock,
        keys: wp.vec2ui,
        lags: wp.array2d(dtype=wp.int64),
        birth: wp.array(dtype=wp.int64),
        times: wp.array(dtype=wp.int64),
        newest: wp.array(dtype=wp.int64),
        chosen: wp.array(dtype=wp.vec3i),
        share: wp.array(dtype=wp.float64),
    ):
        e = wp.tid()
        e += first_env
        now, number = clock.time_ns[0], clock.step[0]
        dt_ns = wp.max(clock.dt[0] * wp.float64(1.0e9), wp.float64(1.0))
        lag = lags[e, 0]
        if wp.static(jitter):
            width = wp.float64(lags[e, 1] + wp.int64(1))
            stream = clock.streams[e]
            lag = lag + wp.int64(unit_f64(draw(keys, stream, step_of(clock, stream, e), 0)[0]) * width)
        if wp.static(nearest):
            lag = wp.int64(wp.rint(wp.float64(lag) / dt_ns) * dt_ns + wp.float64(0.5))
        source = now - lag
        first = birth[e] < wp.int64(0)
        if first:
            birth[e] = number - wp.int64(1)
        if wp.static(not reorder):
            if not first:
                source = wp.max(source, newest[e])
            newest[e] = source
        limit = source
        if wp.static(not linear):
            limit = source + ROUNDING
        count = entries(birth[e], number, times.shape[0])
        age = entry_before(times, now, number, count, int(wp.float64(now - source) / dt_ns), limit)
        write = slot(number, 0, times.shape[0])
        older = THIS_STEP
        if age >= count:
            older = UNKNOWN
        elif age > 0:
            older = slot(number, age, times.shape[0])
        newer = THIS_STEP
        if age > 1:
            newer = slot(number, age - 1, times.shape[0])
        chosen[e] = wp.vec3i(write, older, newer)
        if wp.static(linear):
            share[e] = share_of_newer(times, now, number, count, age, source, wp.int64(dt_ns))
        if e == 0:
            times[write] = now

    return select_entry


@functools.cache
def deliver_kernel(dtype: type, linear: bool):
    """Return the kernel that writes this step's reading into the ring and outputs the reading that is delivered now.

    Each thread handles four columns.
    """

    @warp_kernel
    def deliver(
        first_env: int,
        x: wp.array2d(dtype=dtype),
        chosen: wp.array(dtype=wp.vec3i),
        share: wp.array(dtype=wp.float64),
        ring: wp.array3d(dtype=dtype),
        out: wp.array2d(dtype=dtype),
    ):
        e, group = wp.tid()
        e = natural(e + first_env)
        group = natural(group)
        write, older, newer = chosen[e][0], chosen[e][1], chosen[e][2]
        for c in range(group, x.shape[1], threads(x.shape[1])):
            v = x[e, c]
            a = v
            if older >= 0:
                a = ring[older, e, c]
            if older == UNKNOWN:
                a = dtype(0)
            if wp.static(linear):
                if share[e] > wp.float64(0.0):
                    b = v
                    if newer >= 0:
                        b = ring[newer, e, c]
                    a = a + dtype(share[e]) * (b - a)
            ring[write, e, c] = v
            out[e, c] = a

    return deliver


@functools.cache
def remember_kernel(dtype: type):
    """Return the kernel that shifts the history by one reading: entry 0 is the newest."""

    @warp_kernel
    def remember(first_env: int, x: wp.array2d(dtype=dtype), history: wp.array3d(dtype=dtype)):
        e, c = wp.tid()
        e = natural(e + first_env)
        c = natural(c)
        for k in range(history.shape[1] - 1, 0, -1):
            history[e, k, c] = history[e, k - 1, c]
        history[e, 0, c] = x[e, c]

    return remember
