"""The bodies that a sensor senses, as kernels take them: their shapes, their poses, and which of them are near."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
from typing import Any

import warp as wp

from tactemu.geometry.shapes.shape import table_type


@functools.cache
def sensed_type(real: Any) -> Any:
    """Return the Warp struct of the bodies that a sensor senses; :attr:`~tactemu.sensors.sensor_model.Site.sensed` is
    an instance."""

    @wp.struct
    class Sensed:
        shapes: table_type(real)
        pose: wp.array2d(dtype=wp.types.transformation(real))  # of all bodies in the link's frame, (n_envs, n_bodies)
        targets: wp.array(dtype=wp.int32)  # indices of the bodies to sense
        near: wp.array2d(dtype=wp.uint8)  # may a body reach any probe on the link? (n_envs, n_bodies)

    return Sensed


@wp.func_native("""
    int64_t found = 0;
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x % 32;
    for (int first = 0; first < 64; first += 32) {
        const int t = first + lane;
        bool is_near = true;
        if (t < targets.shape[0])
            is_near = flags.data[int64_t(flags.strides[0]) * e + int64_t(flags.strides[1]) * targets.data[t]] != 0;
        found |= int64_t(uint64_t(__ballot_sync(0xffffffffu, is_near)) << first);
    }
#else
    const int n = targets.shape[0] < 64 ? targets.shape[0] : 64;
    for (int t = 0; t < n; ++t)
        if (flags.data[int64_t(flags.strides[0]) * e + int64_t(flags.strides[1]) * targets.data[t]] != 0)
            found |= int64_t(uint64_t(1) << t);
#endif
    return found;
""")
def near_bits(flags: wp.array2d(dtype=wp.uint8), targets: wp.array(dtype=wp.int32), e: int) -> wp.int64:
    """Return a bit for each of the first 64 sensed bodies: is it near the skin
    (:class:`tactemu.sensors.poses.LinkView`)?

    On a GPU all threads of a warp must call it together, for one environment.
    """
    ...


ALL_NEAR = wp.constant(wp.int64(-1))


@wp.func
def is_near(bits: wp.int64, t: int):
    """Return True if the ``t``-th sensed body may be near."""
    return t > 63 or (bits >> wp.int64(t)) & wp.int64(1) == wp.int64(1)
