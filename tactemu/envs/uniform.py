"""Uniform random numbers of each environment's episode, drawn on the device.

Their stream is one of the simulation's (:mod:`tactemu.base.random_streams`), beside those of the imperfections: goals
and start places do not change when noise is switched on.
"""

# pyright: reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections.random import draw, stream_keys, unit_f64
from tactemu.plan.clock import Clock
from tactemu.plan.plan import Context


@warp_kernel
def _fill(keys: wp.vec2ui, clock: Clock, first: int, out: wp.array2d(dtype=wp.float32)):
    e, k = wp.tid()
    out[e, k] = wp.float32(unit_f64(draw(keys, clock.streams[e], wp.int64(0), first + k)[0]))


def uniform(context: Context, first: int, width: int) -> wp.array:
    """Return an array ``(n_envs, width)`` of numbers in (0, 1), a function of each environment's seed and the number of
    its resets; those from ``first`` on differ from those before.

    On a GPU the call does not wait for the device.
    """
    out = wp.empty((context.n_envs, width), dtype=wp.float32, device=context.device)
    inputs = [stream_keys(context.seed, "envs: uniform"), context.clock, first]
    wp.launch(_fill, dim=out.shape, inputs=inputs, outputs=[out], device=out.device)
    return out
