"""The time of a step on the device, as kernels read it, and its advance."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportGeneralTypeIssues=false

import warp as wp

from tactemu.base.kernels import warp_kernel

_HALF = wp.constant(wp.int64(32))
_LOW = wp.constant(wp.int64(0xFFFFFFFF))
_POSITIVE = wp.constant(wp.int64(0x7FFFFFFF))


@wp.struct
class Clock:
    """The step being taken, and the beginning of each environment's episode;
    :attr:`tactemu.plan.plan.Context.clock` is an instance. The first three arrays hold one number each."""

    dt: wp.array(dtype=wp.float64)  # length of the step [s]
    step: wp.array(dtype=wp.int64)  # its number, from 1
    time_ns: wp.array(dtype=wp.int64)  # simulated time at its end [ns]
    began_step: wp.array(dtype=wp.int64)  # the step after which each environment was last reset
    began_ns: wp.array(dtype=wp.int64)  # the simulated time at which it was [ns]
    streams: wp.array(dtype=wp.vec3i)  # the random streams of each environment, see Context.streams


def clock_of(**arrays: wp.array) -> Clock:
    """Return a clock of these arrays."""
    clock = Clock()
    for name, array in arrays.items():
        setattr(clock, name, array)
    return clock


@warp_kernel
def begin(mask: wp.array(dtype=wp.bool), seeds: wp.array(dtype=wp.int64), clock: Clock):
    """Begin an episode where the mask is true: steps and time of these environments count from here, and random numbers
    are drawn from their ``seeds``, or anew if there are none."""
    e = wp.tid()
    if mask[e]:
        clock.began_step[e] = clock.step[0]
        clock.began_ns[e] = clock.time_ns[0]
        stream = clock.streams[e] + wp.vec3i(0, 1, 0)
        if seeds.shape[0] > 0:
            seed = seeds[e]
            stream = wp.vec3i(int(seed & _LOW), 0, int((seed >> _HALF) & _POSITIVE))
        clock.streams[e] = stream


@wp.func
def advance(clock: Clock, dt_ns: wp.array(dtype=wp.int64)):
    """Advance the step count and the time."""
    clock.step[0] = clock.step[0] + wp.int64(1)
    clock.time_ns[0] = clock.time_ns[0] + dt_ns[0]


@warp_kernel
def tick(clock: Clock, dt_ns: wp.array(dtype=wp.int64)):
    """Advance the step count and the time, before threads that share a step begin."""
    advance(clock, dt_ns)
