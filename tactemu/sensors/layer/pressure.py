"""The normal contact of a rigid object with an elastic layer: the cells that touch, and their pressures.

With the compliance ``C`` (:mod:`.compliance`) and the overlap ``o`` of object and undeformed skin::

    p >= 0,   C p - o >= 0,   p (C p - o) = 0        (no pull, no penetration, no pressure across a gap)

This is solved by projected conjugate gradients (Polonsky and Keer 1999) with the layer's own inverse compliance as the
preconditioner, so that the number of iterations depends neither on the grid nor on the thickness. One block of threads
solves each environment in the smallest window that contact can reach, starting from its last pressure, and skips it
while its overlap does not change. Lengths are in pitches, pressures scaled (:mod:`.tables`).

The residual is the root of the sum of the squared gaps where there is pressure or penetration, relative to that of
the overlap.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.plan.scalars import is_nan
from tactemu.sensors.layer.convolution import (
    BLOCK,
    Block,
    block_sync,
    convolution_functions,
    padded_zeros,
    spread,
    workspace_type,
)
from tactemu.sensors.layer.pressure_simd import PressureCells, simd_pressure_cells
from tactemu.sensors.layer.shared_memory import shared_functions, shared_numbers
from tactemu.sensors.layer.tables import tables_type
from tactemu.sensors.layer.window import (
    BOX_STEP,
    BROKEN,
    SAME,
    around,
    block_functions,
    publish_function,
    survey_function,
    transform_level,
    transform_size,
)

SHARED_MEMORY_BLOCK = Block(128, 3)
"""Block of threads for solving in shared memory: 64, 128 and 256 threads take 1.16, 0.81 and 0.86 ms for 4096
environments of 32 x 32 on an H200."""
NO_SURFACE = -1.0e6
"""Overlap of a cell that no object is above [pitches]."""


@functools.cache
def windows_type(real):
    """Return the Warp struct of the vectors of the conjugate gradients, one window per block: ``(n_slots, rows,
    columns)``."""

    @wp.struct
    class Windows:
        overlap: wp.array3d(dtype=real)
        pressure: wp.array3d(dtype=real)
        gap: wp.array3d(dtype=real)
        masked: wp.array3d(dtype=real)  # the gap where it must close
        softened: wp.array3d(dtype=real)  # preconditioned
        direction: wp.array3d(dtype=real)
        answer: wp.array3d(dtype=real)  # displacement by the direction

    return Windows


NORMAL_WINDOWS = ("overlap", "pressure", "gap", "masked", "softened", "direction", "answer")
SHARED_ARRAYS = (1, len(NORMAL_WINDOWS))
"""Numbers of spectra and of windows of a block that works in shared memory (:mod:`.shared_memory`)."""


class Windows:
    """The windows of a Warp struct of arrays: it allocates them and keeps them alive.

    Args:
        struct: the instance whose fields are filled.
        names: names of the fields.
        shape: largest window, ``(rows, columns)``.
    """

    def __init__(self, struct, names: tuple[str, ...], n_slots: int, shape: tuple[int, int], real, lanes: int, device):
        rows, columns = (-(-n // BOX_STEP) * BOX_STEP for n in shape)
        self.struct = struct
        self._arrays = [padded_zeros(n_slots, rows, columns, real, lanes, device) for _ in names]
        for name, array in zip(names, self._arrays):
            setattr(struct, name, array)


@functools.cache
def pressure_cells(real, lanes: int) -> PressureCells:
    """Return the operations on each cell between convolutions; on a CPU those in vector registers
    (:mod:`.pressure_simd`)."""
    windows_struct = windows_type(real)
    if lanes > 1:
        return simd_pressure_cells(real, windows_struct)
    block_sum, _max = block_functions(lanes)

    @wp.func
    def mask_gap(win: windows_struct, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """Keep the gap where cells touch or would penetrate; return the sum of its squares."""
        total = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                g = win.gap[slot, y, x]
                m = wp.where(win.pressure[slot, y, x] > real(0.0) or g < real(0.0), g, real(0.0))
                win.masked[slot, y, x] = m
                total += wp.float64(m) * wp.float64(m)
        total = block_sum(total)
        block_sync()
        return total

    @wp.func
    def products(win: windows_struct, slot: int, fresh: bool, shape: wp.vec2i, mine: wp.vec4i):
        """Return the products of the preconditioned gap with the gap and, unless ``fresh``, with the change by the last
        direction."""
        square = wp.float64(0.0)
        change = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                m = win.masked[slot, y, x]
                if m != real(0.0):
                    z = wp.float64(win.softened[slot, y, x])
                    square += wp.float64(m) * z
                    if not fresh:
                        change += z * wp.float64(win.answer[slot, y, x])
        return wp.vec2d(block_sum(square), block_sum(change))

    @wp.func
    def direct(win: windows_struct, slot: int, beta: real, fresh: bool, shape: wp.vec2i, mine: wp.vec4i):
        """Compute the search direction, and add a part of the last unless ``fresh``; return the slope along it."""
        slope = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                m = win.masked[slot, y, x]
                d = real(0.0)
                if m != real(0.0):
                    d = -win.softened[slot, y, x]
                    if not fresh:
                        d += beta * win.direction[slot, y, x]
                win.direction[slot, y, x] = d
                slope += wp.float64(m) * wp.float64(d)
        slope = block_sum(slope)
        block_sync()
        return slope

    @wp.func
    def curvature(win: windows_struct, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        total = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                total += wp.float64(win.direction[slot, y, x]) * wp.float64(win.answer[slot, y, x])
        return block_sum(total)

    @wp.func
    def advance(win: windows_struct, slot: int, step: real, shape: wp.vec2i, mine: wp.vec4i):
        """Take a step along the direction, and set pressures that would pull to 0; return their number."""
        pulled = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                p = win.pressure[slot, y, x] + step * win.direction[slot, y, x]
                if p < real(0.0):
                    pulled += wp.float64(1.0)
                    p = real(0.0)
                win.pressure[slot, y, x] = p
                win.gap[slot, y, x] = win.gap[slot, y, x] + step * win.answer[slot, y, x]
        pulled = block_sum(pulled)
        block_sync()
        return pulled

    return PressureCells(mask_gap, products, direct, curvature, advance)


@functools.cache
def normal_kernel(real, lanes: int, is_shared: bool):
    """Return the kernel that solves every environment; one block of threads per slot. ``is_shared``: it works in the
    block's shared memory."""
    workspace = workspace_type(real)
    tables_struct = tables_type(real)
    windows_struct = windows_type(real)
    convolve = convolution_functions(real, lanes, is_shared).convolve
    survey, publish = survey_function(real, lanes), publish_function(real)
    mask_gap, products, direct, curvature, advance = pressure_cells(real, lanes)
    block_sum, _max = block_functions(lanes)
    shared_workspace, window = shared_functions(real, workspace, *SHARED_ARRAYS)
    grid = wp.array2d(dtype=real)

    @wp.func
    def shared_windows(win: windows_struct, memory: wp.tile(dtype=real, shape=(shared_numbers(*SHARED_ARRAYS),))):
        near = win
        near.overlap = window(memory, 0)
        near.pressure = window(memory, 1)
        near.gap = window(memory, 2)
        near.masked = window(memory, 3)
        near.softened = window(memory, 4)
        near.direction = window(memory, 5)
        near.answer = window(memory, 6)
        return near

    @wp.func
    def gather(win: windows_struct, slot: int, overlap: grid, pressure: grid, box: wp.vec4i, mine: wp.vec4i):
        """Fetch overlap and last pressure; without one, start from the overlap. Return the sum of squared overlaps."""
        deep = wp.float64(0.0)
        load = wp.float64(0.0)
        for y in range(mine[0], box[2], mine[1]):
            for x in range(mine[2], box[3], mine[3]):
                o = real(NO_SURFACE)
                p = real(0.0)
                if box[0] + y < overlap.shape[0] and box[1] + x < overlap.shape[1]:
                    o = overlap[box[0] + y, box[1] + x]
                    p = pressure[box[0] + y, box[1] + x]
                win.overlap[slot, y, x] = o
                win.pressure[slot, y, x] = p
                load += wp.float64(p)
                if o > real(0.0):
                    deep += wp.float64(o) * wp.float64(o)
        if block_sum(load) <= wp.float64(0.0):
            for y in range(mine[0], box[2], mine[1]):
                for x in range(mine[2], box[3], mine[3]):
                    win.pressure[slot, y, x] = wp.max(win.overlap[slot, y, x], real(0.0))
        block_sync()
        return block_sum(deep)

    @wp.func
    def fit_load(win: windows_struct, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """Scale the start to the least energy; ``gap`` holds its displacement and becomes the gap."""
        work = wp.float64(0.0)
        energy = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                p = win.pressure[slot, y, x]
                if p > real(0.0):
                    work += wp.float64(p) * wp.float64(win.overlap[slot, y, x])
                    energy += wp.float64(p) * wp.float64(win.gap[slot, y, x])
        work = block_sum(work)
        energy = block_sum(energy)
        factor = real(0.0)
        if energy > wp.float64(0.0):
            factor = real(wp.max(work / energy, wp.float64(0.0)))
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                win.pressure[slot, y, x] = factor * win.pressure[slot, y, x]
                win.gap[slot, y, x] = factor * win.gap[slot, y, x] - win.overlap[slot, y, x]

    @wp.func
    def turn(
        win: windows_struct,
        slot: int,
        last: wp.float64,
        step: wp.float64,
        fresh: bool,
        shape: wp.vec2i,
        mine: wp.vec4i,
    ):
        """Compute the next search direction, conjugate to the last (Polak-Ribiere); return slope and preconditioned
        square."""
        square = products(win, slot, fresh, shape, mine)
        beta = real(0.0)
        if not fresh and last > wp.float64(0.0):
            beta = real(wp.max(square[1] * step / last, wp.float64(0.0)))
        slope = direct(win, slot, beta, fresh, shape, mine)
        if slope >= wp.float64(0.0) and not fresh:  # uphill: restart without the last direction
            slope = direct(win, slot, beta, True, shape, mine)
        return slope, square[0]

    @wp.func
    def subtract_overlap(win: windows_struct, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                win.gap[slot, y, x] = win.gap[slot, y, x] - win.overlap[slot, y, x]
        block_sync()

    @wp.func
    def solve(
        tables: tables_struct,
        ws: workspace,
        win: windows_struct,
        slot: int,
        start: int,
        shape: wp.vec2i,
        size: wp.vec2i,
        reference: wp.float64,
        cap: int,
        tolerance: wp.float64,
        mine: wp.vec4i,
        thread: int,
    ):
        """Run conjugate gradients in one window; return the residual and the number of iterations."""
        loads = win.pressure[slot]
        masked = win.masked[slot]
        direction = win.direction[slot]
        convolve(ws, slot, loads, tables.nn, start, shape, size, win.gap[slot], thread)
        fit_load(win, slot, shape, mine)
        fresh = bool(True)
        last = wp.float64(0.0)
        step = wp.float64(0.0)
        iteration = int(0)
        residual = wp.sqrt(mask_gap(win, slot, shape, mine) / reference)
        while residual > tolerance and iteration < cap:
            convolve(ws, slot, masked, tables.soften, start, shape, size, win.softened[slot], thread)
            slope, square = turn(win, slot, last, step, fresh, shape, mine)
            convolve(ws, slot, direction, tables.nn, start, shape, size, win.answer[slot], thread)
            curved = curvature(win, slot, shape, mine)
            if curved <= wp.float64(0.0):
                break
            step = -slope / curved
            fresh = advance(win, slot, real(step), shape, mine) > wp.float64(0.0)
            if fresh:  # clipped pressures change the gap everywhere
                convolve(ws, slot, loads, tables.nn, start, shape, size, win.gap[slot], thread)
                subtract_overlap(win, slot, shape, mine)
            last = square
            iteration += 1
            residual = wp.sqrt(mask_gap(win, slot, shape, mine) / reference)
        return residual, iteration

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=SHARED_MEMORY_BLOCK if is_shared else BLOCK)
    def solve_normal(
        turns: wp.vec4i,  # first environment, end, first slot, slots that take turns
        # Layer:
        tables: tables_struct,
        bulge: real,
        cap: int,
        tolerance: wp.float64,
        # In:
        overlap: wp.array3d(dtype=real),
        active: wp.array(dtype=wp.vec4i),
        # Scratch:
        ws: workspace,
        win: windows_struct,
        # State and out:
        solved_overlap: wp.array3d(dtype=real),
        pressure_out: wp.array3d(dtype=real),
        box_out: wp.array(dtype=wp.vec4i),
        residual_out: wp.array(dtype=wp.float64),
        iterations_out: wp.array(dtype=wp.int32),
        changed_out: wp.array(dtype=wp.int32),  # 1: the pressures changed in this step
        dirty_out: wp.array(dtype=wp.vec4i),  # box in which they changed
    ):
        place, thread = wp.tid()
        slot = turns[2] + place
        if wp.static(is_shared):
            memory = wp.tile_empty(shape=(wp.static(shared_numbers(*SHARED_ARRAYS)),), dtype=real, storage="shared")
            ws = shared_workspace(ws, memory)
            win = shared_windows(win, memory)
        for env in range(turns[0] + place, turns[1], turns[3]):
            state, box = survey(overlap[env], solved_overlap[env], active[env], bulge, thread)
            residual = residual_out[env]
            old = box_out[env]
            iteration = int(0)
            changed = int(0)
            if state == BROKEN or box[3] == 0:
                publish(win.pressure[slot], box, old, pressure_out[env], thread)
                if state == BROKEN or is_nan(residual):  # every taxel begins or ceases to read NaN
                    old = wp.vec4i(0, 0, overlap.shape[1], overlap.shape[2])
                changed = wp.min(old[3], 1)
                residual = wp.where(state == BROKEN, wp.float64(wp.nan), wp.float64(0.0))
            elif state != SAME or residual > tolerance:
                changed = 1
                mine = spread(box[3], thread)
                reference = gather(win, slot, overlap[env], pressure_out[env], box, mine)
                shape = wp.vec2i(box[2], box[3])
                level = transform_level(shape)
                size = transform_size(level)
                start = tables.start[level[0], level[1]]
                residual, iteration = solve(
                    tables, ws, win, slot, start, shape, size, reference, cap, tolerance, mine, thread
                )
                publish(win.pressure[slot], box, old, pressure_out[env], thread)
            block_sync()
            if thread == 0:
                box_out[env] = box
                residual_out[env] = residual
                iterations_out[env] = iteration
                changed_out[env] = changed
                dirty_out[env] = around(box, old)
            block_sync()

    return solve_normal
