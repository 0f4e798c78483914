"""The time of a step on the device, as kernels read it, and its advance."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportGeneralTypeIssues=false

import warp as wp


@wp.struct
class Clock:
    """The step being taken; :attr:`tactemu.plan.plan.Context.clock` is an instance. Each array holds one number."""

    dt: wp.array(dtype=wp.float64)  # length of the step [s]
    step: wp.array(dtype=wp.int64)  # its number, from 1
    time_ns: wp.array(dtype=wp.int64)  # simulated time at its end [ns]


def clock_of(dt: wp.array, step: wp.array, time_ns: wp.array) -> Clock:
    """Return a clock of these arrays."""
    clock = Clock()
    clock.dt, clock.step, clock.time_ns = dt, step, time_ns
    return clock


@wp.func
def advance(clock: Clock, dt_ns: wp.array(dtype=wp.int64)):
    """Advance the step count and the time."""
    clock.step[0] = clock.step[0] + wp.int64(1)
    clock.time_ns[0] = clock.time_ns[0] + dt_ns[0]


@wp.kernel(module="unique", enable_backward=False)
def tick(clock: Clock, dt_ns: wp.array(dtype=wp.int64)):
    """Advance the step count and the time, before threads that share a step begin."""
    advance(clock, dt_ns)
