"""The time of a step on the device, as kernels read it."""

import warp as wp


@wp.struct
class Clock:
    """The step being taken; :attr:`tactemu.plan.plan.Context.clock` is an instance. Each array holds one number."""

    dt: wp.array(dtype=wp.float64)  # pyright: ignore[reportInvalidTypeForm] - length of the step [s]
    step: wp.array(dtype=wp.int64)  # pyright: ignore[reportInvalidTypeForm] - its number, from 1
    time_ns: wp.array(dtype=wp.int64)  # pyright: ignore[reportInvalidTypeForm] - simulated time at its end [ns]
