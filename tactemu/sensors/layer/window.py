"""The window of cells that an environment's contact can reach, and its distribution over the threads of a block."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false

import functools

import warp as wp

from tactemu.plan.scalars import is_finite
from tactemu.sensors.layer.block import SMALLEST_TRANSFORM, Window, block_sync, spread

BOX_STEP = SMALLEST_TRANSFORM // 2
"""Step by which windows grow [cells], so that lanes are full."""
SAME = 0
"""State of an overlap that has not changed since the last step."""
CHANGED = 1
"""State of an overlap that has changed."""
BROKEN = 2
"""State of an overlap that is not finite."""


@functools.cache
def block_functions(lanes: int):
    """Return the functions ``(block_sum, block_max)``, which reduce over the threads of the block and return the result
    to all.

    On a CPU (more than one lane) a block is one thread.
    """

    @wp.func
    def own(x: wp.float64):
        return x

    return (_all_sum, _all_max) if lanes == 1 else (own, own)


def _over_block(combine: str) -> str:
    """Return C++ that combines ``x`` of all threads of a block, and returns it to all; it first combines those of each
    warp."""
    snippet = """
#if defined(__CUDA_ARCH__)
    __shared__ double parts[WP_TILE_BLOCK_DIM / 32];
    for (int far = 16; far > 0; far /= 2) {
        const double y = __shfl_xor_sync(0xffffffff, x, far);
        x = COMBINE;
    }
    __syncthreads();
    if (threadIdx.x % 32 == 0)
        parts[threadIdx.x / 32] = x;
    __syncthreads();
    x = parts[0];
    for (int warp = 1; warp < WP_TILE_BLOCK_DIM / 32; ++warp) {
        const double y = parts[warp];
        x = COMBINE;
    }
#endif
    return x;
"""
    return snippet.replace("COMBINE", combine)


@wp.func_native(_over_block("x + y"))
def _native_sum(x: wp.float64) -> wp.float64: ...


@wp.func_native(_over_block("x > y ? x : y"))
def _native_max(x: wp.float64) -> wp.float64: ...


@wp.func(inline=False)
def _all_sum(x: wp.float64):
    return _native_sum(x)


@wp.func(inline=False)
def _all_max(x: wp.float64):
    return _native_max(x)


@wp.func
def open_window(shape: wp.vec2i, span: wp.vec2i, starts: wp.array2d(dtype=wp.int32), slot: int, thread: int):
    """Return the window of ``shape`` with the shortest transforms that hold ``span`` without wrapping; ``starts`` are
    those of the layer's tables."""
    level = wp.vec2i(0, 0)
    for axis in range(2):
        while wp.static(BOX_STEP) << level[axis] < span[axis]:
            level[axis] = level[axis] + 1
    size = wp.vec2i(wp.static(SMALLEST_TRANSFORM) << level[0], wp.static(SMALLEST_TRANSFORM) << level[1])
    start = starts[level[0], level[1]]
    return Window(slot, thread, spread(shape[1], thread), shape, size, start, wp.vec2i(0, 0))


@wp.func
def around(a: wp.vec4i, b: wp.vec4i):
    """Return the box around two boxes ``(first row, first column, rows, columns)``; empty ones do not count."""
    if a[2] == 0:
        return b
    if b[2] == 0:
        return a
    top = wp.min(a[0], b[0])
    left = wp.min(a[1], b[1])
    return wp.vec4i(top, left, wp.max(a[0] + a[2], b[0] + b[2]) - top, wp.max(a[1] + a[3], b[1] + b[3]) - left)


@wp.func
def fit(first: int, last: int, cells: int):
    """Return the first cell and length of a window around ``first..last``, inside ``cells`` where that is possible.

    It includes two more cells on both sides, so that it already holds the cells that contact reaches next.
    """
    first = wp.max(first - 2, 0)
    last = wp.min(last + 2, cells - 1)
    length = (last - first + wp.static(BOX_STEP)) // wp.static(BOX_STEP) * wp.static(BOX_STEP)
    return wp.vec2i(wp.max(0, wp.min(first, cells - length)), length)


@functools.cache
def survey_function(real, lanes: int):
    """Return ``survey(overlap, solved, active, bulge, thread) -> (state, box)`` of one environment.

    ``box`` is ``(first row, first column, rows, columns)`` around the cells that contact can reach: those whose overlap
    is more than ``-bulge`` times the deepest, since a skin that cannot be compressed rises beside a pressing object. It
    is empty without contact. ``solved`` is the overlap of the last step; it is updated. Only the cells from
    ``active[:2]`` to before ``active[2:]`` are visited: no body is, or was at the last step, near the others.
    """
    grid = wp.array2d(dtype=real)
    _sum, block_max = block_functions(lanes)

    @wp.func
    def survey(overlap: grid, solved: grid, active: wp.vec4i, bulge: real, thread: int):
        rows = overlap.shape[0]
        columns = overlap.shape[1]
        mine = spread(wp.max(active[3] - active[1], 1), thread)
        deepest = real(0.0)
        state = int(SAME)
        for y in range(active[0] + mine[0], active[2], mine[1]):
            for x in range(active[1] + mine[2], active[3], mine[3]):
                o = overlap[y, x]
                deepest = wp.max(deepest, o)
                if o != solved[y, x]:
                    state = wp.max(state, CHANGED)
                    solved[y, x] = o
                if not is_finite(o):
                    state = BROKEN
        state = int(block_max(wp.float64(state)))
        deepest = real(block_max(wp.float64(deepest)))
        if state == BROKEN or deepest <= real(0.0):
            return state, wp.vec4i(0, 0, 0, 0)
        top = rows
        bottom = int(-1)
        left = columns
        right = int(-1)
        floor = -bulge * deepest
        for y in range(active[0] + mine[0], active[2], mine[1]):
            for x in range(active[1] + mine[2], active[3], mine[3]):
                if overlap[y, x] > floor:
                    top = wp.min(top, y)
                    bottom = wp.max(bottom, y)
                    left = wp.min(left, x)
                    right = wp.max(right, x)
        top = -int(block_max(wp.float64(-top)))
        bottom = int(block_max(wp.float64(bottom)))
        left = -int(block_max(wp.float64(-left)))
        right = int(block_max(wp.float64(right)))
        down = fit(top, bottom, rows)
        along = fit(left, right, columns)
        return state, wp.vec4i(down[0], along[0], down[1], along[1])

    return survey


@functools.cache
def wipe_function(real):
    """Return ``wipe(area, out, thread)``, which clears an area of a grid."""
    grid = wp.array2d(dtype=real)

    @wp.func
    def wipe(area: wp.vec4i, out: grid, thread: int):
        if area[3] > 0:
            mine = spread(area[3], thread)
            for y in range(mine[0], wp.min(area[2], out.shape[0] - area[0]), mine[1]):
                for x in range(mine[2], wp.min(area[3], out.shape[1] - area[1]), mine[3]):
                    out[area[0] + y, area[1] + x] = real(0.0)
        block_sync()

    return wipe


@functools.cache
def publish_function(real):
    """Return ``publish(window, box, old, out, thread)``, which clears the box ``old`` of a grid and writes the window
    to ``box``."""
    grid, wipe = wp.array2d(dtype=real), wipe_function(real)

    @wp.func
    def publish(window: grid, box: wp.vec4i, old: wp.vec4i, out: grid, thread: int):
        wipe(old, out, thread)
        if box[3] > 0:
            mine = spread(box[3], thread)
            for y in range(mine[0], wp.min(box[2], out.shape[0] - box[0]), mine[1]):
                for x in range(mine[2], wp.min(box[3], out.shape[1] - box[1]), mine[3]):
                    out[box[0] + y, box[1] + x] = window[y, x]

    return publish
