"""The block of threads that solves an environment, and each thread's share of a window of cells."""

from typing import NamedTuple

import warp as wp

SMALLEST_TRANSFORM = 32
"""Length of the shortest transform used; a window has at most half its length."""


class Block(NamedTuple):
    """The block of threads that solve an environment together on a GPU; on a CPU a block is one thread."""

    threads: int
    resident: int
    """Number of blocks that a multiprocessor holds at once; it limits the registers of a thread."""


BLOCK = Block(64, 8)
"""Block of solvers that work in the device's global memory; those in shared memory have their own."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def block_sync():
    """Wait for the other threads of the block, and make their writes visible."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int threads = WP_TILE_BLOCK_DIM;
    const int across = columns < 1 ? 1 : columns < threads ? columns : threads, down = threads / across;
    const int row = thread / across;
    return wp::vec_t<4, wp::int32>(row < down ? row : 1 << 30, down, thread % across, across);
#else
    return wp::vec_t<4, wp::int32>(0, 1, 0, 1);
#endif
""")
def spread(columns: int, thread: int) -> wp.vec4i:
    """Return a thread's share of a window: first row, step of rows, first column, step of columns; a surplus thread is
    idle. On a CPU compilers see that one thread takes all cells, and leave out the code for others."""
    ...


@wp.struct
class Window:
    """The window of cells that a block solves, and the calling thread's part in it."""

    slot: wp.int32  # the block's slot of scratch
    thread: wp.int32
    mine: wp.vec4i  # the thread's share of the cells (:func:`spread`)
    shape: wp.vec2i  # rows and columns
    size: wp.vec2i  # lengths of the transforms along rows and columns
    start: wp.int32  # first number of spectra of this size in the layer's tables
    first: wp.vec2i  # row and column at which an inverse transform begins; may be negative


@wp.struct
class Pass:
    """One pass of a transform: along the rows of a field; its result is written transposed."""

    rows: wp.int32  # of the field
    columns: wp.int32
    n: wp.int32  # length of the transform
    first: wp.int32  # first row of the result that is written
    rows_out: wp.int32  # number of them
