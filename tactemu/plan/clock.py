"""The time of a step on the device, as kernels read it, and its advance."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportGeneralTypeIssues=false

import warp as wp


@wp.struct
class Clock:
    """The step being taken, and the beginning of each environment's episode;
    :attr:`tactemu.plan.plan.Context.clock` is an instance. The first three arrays hold one number each."""

    dt: wp.array(dtype=wp.float64)  # length of the step [s]
    step: wp.array(dtype=wp.int64)  # its number, from 1
    time_ns: wp.array(dtype=wp.int64)  # simulated time at its end [ns]
    began_step: wp.array(dtype=wp.int64)  # the step after which each environment was last reset
    began_ns: wp.array(dtype=wp.int64)  # the simulated time at which it was [ns]


def clock_of(**arrays: wp.array) -> Clock:
    """Return a clock of these arrays."""
    clock = Clock()
    for name, array in arrays.items():
        setattr(clock, name, array)
    return clock


@wp.kernel(module="unique", enable_backward=False)
def begin(mask: wp.array(dtype=wp.bool), clock: Clock):
    """Begin an episode where the mask is true: steps and time of these environments count from here."""
    e = wp.tid()
    if mask[e]:
        clock.began_step[e] = clock.step[0]
        clock.began_ns[e] = clock.time_ns[0]


@wp.func
def advance(clock: Clock, dt_ns: wp.array(dtype=wp.int64)):
    """Advance the step count and the time."""
    clock.step[0] = clock.step[0] + wp.int64(1)
    clock.time_ns[0] = clock.time_ns[0] + dt_ns[0]


@wp.kernel(module="unique", enable_backward=False)
def tick(clock: Clock, dt_ns: wp.array(dtype=wp.int64)):
    """Advance the step count and the time, before threads that share a step begin."""
    advance(clock, dt_ns)
