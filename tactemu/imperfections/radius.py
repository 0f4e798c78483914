"""Noise on the probe radius, as an array that the sensor's kernel reads in place of the nominal radii."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections.elementwise import threads
from tactemu.imperfections.random import draw, step_of, unit_f64
from tactemu.plan.clock import Clock


@functools.cache
def radius_kernel(real: type):
    """Return the kernel of noisy radii ``max(0, R + U(-s, s))``, drawn each step for each taxel of each environment.

    The radius of a filler stays 0.
    """

    @warp_kernel
    def noisy_radius(
        first_env: int,
        nominal: wp.array(dtype=real),
        clock: Clock,
        keys: wp.vec2ui,
        half_width: wp.array2d(dtype=real),
        out: wp.array2d(dtype=real),
    ):
        e, group = wp.tid()
        e += first_env
        stream = clock.streams[e]
        words = draw(keys, stream, step_of(clock, stream, e), group)
        lane = int(-1)
        for i in range(group, nominal.shape[0], threads(nominal.shape[0])):
            lane += 1
            r = nominal[i]
            if r > real(0.0):
                u = real(unit_f64(words[lane]))
                r = wp.max(real(0.0), r + half_width[e, 0] * (real(2.0) * u - real(1.0)))
            out[e, i] = r

    return noisy_radius
