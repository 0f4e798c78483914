"""Coalesced writes of all channels of a taxel: on a GPU the 32 taxels of a warp together fill whole lines of memory.

A thread by itself would write numbers that lie one taxel's channels apart, so that each line of memory would be written
as many times: for nine channels, as the elastic layer has, that took twice as long.
"""

import functools

import warp as wp


@functools.cache
def row_writer(real, channels: int):
    """Return the Warp function ``write(out, e, i, values, wanted)``.

    It writes ``values``, a vector of all channels, to ``out[e, i]`` if ``wanted`` is true. It is fast when all threads
    of a warp call it at once for neighbouring taxels, and correct in any case.
    """
    values_type = wp.types.vector(channels, real)
    snippet = _WRITE.replace("NUMBER", real.__name__).replace("CHANNELS", str(channels))

    @wp.func_native(snippet)
    def write(out: wp.array3d(dtype=real), e: int, i: int, values: values_type, wanted: bool): ...

    return write


_WRITE = """
    using Number = wp::NUMBER;
    Number* const mine = reinterpret_cast<Number*>(
        reinterpret_cast<char*>(out.data) + int64_t(out.strides[0]) * e + int64_t(out.strides[1]) * i);
#if defined(__CUDA_ARCH__)
    __shared__ Number staged[WP_TILE_BLOCK_DIM * CHANNELS];
    const unsigned lane = threadIdx.x % 32;
    if (__activemask() == 0xffffffffu) {
        const unsigned writers = __ballot_sync(0xffffffffu, wanted);
        Number* const first = reinterpret_cast<Number*>(__shfl_sync(0xffffffffu, reinterpret_cast<uint64_t>(mine), 0));
        if (__all_sync(0xffffffffu, mine == first + lane * CHANNELS)) {
            Number* const rows = staged + threadIdx.x / 32 * 32 * CHANNELS;
            for (int k = 0; k < CHANNELS; ++k)
                rows[lane * CHANNELS + k] = values[k];
            __syncwarp();
            for (int k = 0; k < CHANNELS; ++k) {
                const unsigned at = k * 32 + lane;
                if (writers >> (at / CHANNELS) & 1)
                    first[at] = rows[at];
            }
            __syncwarp();
            return;
        }
    }
#endif
    if (wanted)
        for (int k = 0; k < CHANNELS; ++k)
            mine[k] = values[k];
"""
