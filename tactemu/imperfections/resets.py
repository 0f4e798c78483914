"""Kernels that draw gains and dead taxels at resets."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections.elementwise import ALIVE, DIES_AT_FIRST
from tactemu.imperfections.random import draw, unit_f64
from tactemu.plan.clock import Clock


@wp.func
def between(limits: wp.vec2d, word: wp.uint32):
    """Return a number between two limits."""
    return limits[0] + (limits[1] - limits[0]) * unit_f64(word)


@functools.cache
def gain_kernel(real: type):
    """Return the kernel that draws a gain per taxel, uniform in a range."""
    gains = wp.array2d(dtype=real)

    @warp_kernel
    def resample_gain(mask: wp.array(dtype=wp.bool), clock: Clock, keys: wp.vec2ui, limits: wp.vec2d, gain: gains):
        e, i = wp.tid()
        if mask[e]:
            gain[e, i] = real(between(limits, draw(keys, clock.streams[e], wp.int64(0), i)[0]))

    return resample_gain


@functools.cache
def dead_kernel(real: type):
    """Return the kernel that draws which taxels are dead and their readings.

    :data:`tactemu.imperfections.elementwise.ALIVE` explains the values.
    """

    @warp_kernel
    def redraw_dead(
        mask: wp.array(dtype=wp.bool),
        clock: Clock,
        keys: wp.vec2ui,
        probability: wp.float64,
        limits: wp.vec2d,
        at_first: wp.bool,
        n_channels: int,
        stuck: wp.array2d(dtype=real),
    ):
        e, c = wp.tid()
        if mask[e]:
            words = draw(keys, clock.streams[e], wp.int64(0), c // n_channels)
            value = real(wp.static(ALIVE))
            if unit_f64(words[0]) < probability:
                value = real(between(limits, words[1]))
                if at_first:
                    value = real(wp.static(DIES_AT_FIRST))
            stuck[e, c] = value

    return redraw_dead
