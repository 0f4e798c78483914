"""What the threads of a warp find out together about an environment: lists, which come out in order, and extremes.

On a GPU one thread that looks at all of an environment waits for memory at each entry. On a CPU there is one lane.
"""

# pyright: reportInvalidTypeForm=false, reportReturnType=false

import warp as wp

WARP_SIZE = 32


def lanes_per_environment(device: wp.Device) -> int:
    """Threads that share the list of an environment: the last axis of the launch."""
    return WARP_SIZE if device.is_cuda else 1


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, wanted) & ((1u << (threadIdx.x % 32)) - 1u));
#else
    return 0;
#endif
""")
def rank(wanted: bool) -> int:
    """How many lanes before this one want an entry. All lanes call it together."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, wanted));
#else
    return wanted ? 1 : 0;
#endif
""")
def ballot_count(wanted: bool) -> int:
    """How many lanes want one. All lanes call it together."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int far = 16; far > 0; far /= 2)
        value = max(value, __shfl_xor_sync(0xffffffffu, value, far));
#endif
    return value;
""")
def warp_max(value: int) -> int:
    """Return the largest of all lanes. All lanes call it together."""
    ...
