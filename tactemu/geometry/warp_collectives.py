"""Operations that all threads of a GPU's warp execute together: ranks, which keep a list in order, counts and maxima.

On a GPU a single thread that reads all entries of an environment waits for memory at each. On a CPU there is one lane.
"""

import functools

import warp as wp

WARP_SIZE = 32
"""Threads of a warp."""


def lanes_per_environment(device: wp.Device) -> int:
    """Return the number of threads that share the list of an environment: the last axis of the launch."""
    return WARP_SIZE if device.is_cuda else 1


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, wanted) & ((1u << (threadIdx.x % 32)) - 1u));
#else
    return 0;
#endif
""")
def rank(wanted: bool) -> int:
    """Return the number of lanes before this one whose ``wanted`` is true. All lanes must call it together."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, wanted));
#else
    return wanted ? 1 : 0;
#endif
""")
def ballot_count(wanted: bool) -> int:
    """Return the number of lanes whose ``wanted`` is true. All lanes must call it together."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int far = 16; far > 0; far /= 2)
        value = max(value, __shfl_xor_sync(0xffffffffu, value, far));
#endif
    return value;
""")
def warp_max(value: int) -> int:
    """Return the largest value of all lanes. All lanes must call it together."""
    ...


@functools.cache
def largest_function(real):
    """Return ``largest(value)``, the largest value of all lanes, which must call it together."""

    @wp.func_native(_LARGEST)
    def largest(value: real) -> real: ...

    return largest


@functools.cache
def lane_function(real):
    """Return ``of_lane(value, lane)``, the value of a lane; all lanes must call it together."""

    @wp.func_native(_OF_LANE)
    def of_lane(value: real, lane: int) -> real: ...

    return of_lane


@functools.cache
def gathered_function(threads: int):
    """Return ``gathered(value, wanted)``, for blocks of so many ``threads``: the k-th lane gets the value of the k-th
    lane whose ``wanted`` is true, others an undefined one. All lanes must call it together."""

    @wp.func_native(_GATHERED.replace("THREADS", str(threads)))
    def gathered(value: int, wanted: bool) -> int: ...

    return gathered


_OF_LANE = """
#if defined(__CUDA_ARCH__)
    return __shfl_sync(0xffffffffu, value, lane);
#else
    return value;
#endif
"""
_LARGEST = """
#if defined(__CUDA_ARCH__)
    for (int far = 16; far > 0; far /= 2) {
        const auto other = __shfl_xor_sync(0xffffffffu, value, far);
        value = other > value ? other : value;
    }
#endif
    return value;
"""
_GATHERED = """
#if defined(__CUDA_ARCH__)
    __shared__ int listed[THREADS];
    const int lane = threadIdx.x % 32;
    int* const values = listed + (threadIdx.x - lane);
    const unsigned lanes = __ballot_sync(0xffffffffu, wanted);
    __syncwarp();
    if (wanted)
        values[__popc(lanes & ((1u << lane) - 1u))] = value;
    __syncwarp();
    value = values[lane];
#endif
    return value;
"""
