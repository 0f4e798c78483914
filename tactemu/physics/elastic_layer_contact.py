"""The normal contact of a rigid object with an elastic layer: which cells touch, and with what pressure.

With the compliance ``C`` (:mod:`elastic_layer_compliance`) and the overlap ``o`` of object and undeformed skin::

    p >= 0,   C p - o >= 0,   p (C p - o) = 0        (no pull, no penetration, no pressure across a gap)

solved by projected conjugate gradients (Polonsky and Keer 1999) with the layer's own inverse compliance as the
preconditioner, so that the number of iterations depends neither on the grid nor on the thickness. Each environment is
solved by one block of threads in the smallest window that contact can reach, starts from its last pressure, and is
left alone while its overlap does not change. Lengths are in pitches, pressures scaled (:mod:`elastic_layer_tables`).
"""

import functools

import warp as wp

from tactemu.physics.elastic_layer_fft import (
    SMALLEST_TRANSFORM,
    Pair,
    allocate_pair,
    block_sync,
    convolution_functions,
    lane_type,
    workspace_type,
)
from tactemu.physics.elastic_layer_tables import tables_type

NO_SURFACE = -1.0e6
"""Overlap where no object is above the cell [pitches]."""
BOX_STEP = SMALLEST_TRANSFORM // 2
"""Windows grow in steps of this many cells, so that lanes are full."""
CHANGED, BROKEN = 1, 2


@functools.cache
def windows_type(real, lanes: int):
    """Vectors of the conjugate gradients, one window per block: ``(n_slots, rows, columns)``."""
    lane = lane_type(real, lanes)

    @wp.struct
    class Windows:
        overlap: wp.array3d(dtype=real)
        pressure: wp.array3d(dtype=real)
        pressure_lanes: wp.array3d(dtype=lane)
        gap: wp.array3d(dtype=real)
        masked: wp.array3d(dtype=real)  # the gap where it must close
        masked_lanes: wp.array3d(dtype=lane)
        softened: wp.array3d(dtype=real)  # preconditioned
        direction: wp.array3d(dtype=real)
        direction_lanes: wp.array3d(dtype=lane)
        answer: wp.array3d(dtype=real)  # displacement by the direction

    return Windows


class Windows:
    """Allocates the vectors and keeps them alive."""

    def __init__(self, n_slots: int, rows: int, columns: int, real, lanes: int, device):
        rows, columns = (-(-n // BOX_STEP) * BOX_STEP for n in (rows, columns))
        self.struct = windows_type(real, lanes)()
        self.pairs: dict[str, Pair] = {}
        for name in ("overlap", "pressure", "gap", "masked", "softened", "direction", "answer"):
            pair = self.pairs[name] = allocate_pair(n_slots, rows, columns, real, lanes, device)
            setattr(self.struct, name, pair.numbers)
            if hasattr(self.struct, f"{name}_lanes"):
                setattr(self.struct, f"{name}_lanes", pair.lanes)


@wp.func
def block_sum(x: wp.float64):
    """Sum over the threads of the block, for all of them."""
    return wp.tile_sum(wp.tile(x))[0]


@wp.func
def block_max(x: wp.float64):
    """Largest over the threads of the block, for all of them."""
    return wp.tile_max(wp.tile(x))[0]


@wp.func
def transform_level(cells: int):
    """Which transform holds a window of ``cells``: 0 for the smallest."""
    level = int(0)
    while wp.static(SMALLEST_TRANSFORM // 2) << level < cells:
        level += 1
    return level


@functools.cache
def reach_functions(real):
    """What contact can reach: ``survey(overlap, solved, bulge, thread) -> (deepest, flags, y0, x0, rows, columns)``."""
    grid = wp.array2d(dtype=real)

    @wp.func
    def fit(first: int, last: int, cells: int):
        """First cell and length of a window around ``first..last``, inside the grid where that is possible."""
        length = (last - first + wp.static(BOX_STEP)) // wp.static(BOX_STEP) * wp.static(BOX_STEP)
        return wp.max(0, wp.min(first, cells - length)), length

    @wp.func
    def survey(overlap: grid, solved: grid, bulge: real, thread: int):
        rows = overlap.shape[0]
        columns = overlap.shape[1]
        deepest = real(0.0)
        flags = int(0)
        for y in range(rows):
            for x in range(thread, columns, wp.block_dim()):
                o = overlap[y, x]
                deepest = wp.max(deepest, o)
                if o != solved[y, x]:
                    flags = flags | wp.static(CHANGED)
                    solved[y, x] = o
                if not wp.isfinite(o):
                    flags = flags | wp.static(BROKEN)
        flags = int(block_max(wp.float64(flags)))
        deepest = real(block_max(wp.float64(deepest)))
        y0 = rows
        y1 = int(-1)
        x0 = columns
        x1 = int(-1)
        floor = -bulge * deepest
        for y in range(rows):
            for x in range(thread, columns, wp.block_dim()):
                if overlap[y, x] > floor:
                    y0 = wp.min(y0, y)
                    y1 = wp.max(y1, y)
                    x0 = wp.min(x0, x)
                    x1 = wp.max(x1, x)
        y0 = -int(block_max(wp.float64(-y0)))
        y1 = int(block_max(wp.float64(y1)))
        x0 = -int(block_max(wp.float64(-x0)))
        x1 = int(block_max(wp.float64(x1)))
        y_start, y_length = fit(y0, y1, rows)
        x_start, x_length = fit(x0, x1, columns)
        return deepest, flags, y_start, x_start, y_length, x_length

    return survey


@functools.cache
def normal_kernel(real, lanes: int):
    """The kernel that solves every environment; one block of threads per slot."""
    lane = lane_type(real, lanes)
    workspace = workspace_type(real, lanes)
    tables_struct = tables_type(real, lanes)
    windows_struct = windows_type(real, lanes)
    forward, scale, inverse = convolution_functions(real, lanes)
    survey = reach_functions(real)
    grid = wp.array2d(dtype=real)

    @wp.func
    def convolve(
        ws: workspace,
        slot: int,
        field: wp.array2d(dtype=lane),
        table: wp.array(dtype=lane),
        start: int,
        rows: int,
        columns: int,
        n_rows: int,
        n_columns: int,
        out: grid,
        thread: int,
    ):
        forward(ws, slot, field, rows, columns, n_rows, n_columns, thread)
        scale(ws, slot, table, start, n_rows, n_columns, thread)
        inverse(ws, slot, 0, rows, 0, columns, n_rows, n_columns, out, thread)

    @wp.func
    def gather(win: windows_struct, slot: int, overlap: grid, pressure: grid, y0: int, x0: int, ny: int, nx: int, t: int):
        """Overlap and last pressure of the window; returns sum of overlaps squared and of pressures."""
        deep = wp.float64(0.0)
        load = wp.float64(0.0)
        for y in range(ny):
            for x in range(t, nx, wp.block_dim()):
                o = real(NO_SURFACE)
                p = real(0.0)
                if y0 + y < overlap.shape[0] and x0 + x < overlap.shape[1]:
                    o = overlap[y0 + y, x0 + x]
                    p = pressure[y0 + y, x0 + x]
                win.overlap[slot, y, x] = o
                win.pressure[slot, y, x] = p
                load += wp.float64(p)
                if o > real(0.0):
                    deep += wp.float64(o) * wp.float64(o)
        return block_sum(deep), block_sum(load)

    @wp.func
    def start_from(win: windows_struct, slot: int, cold: bool, ny: int, nx: int, thread: int):
        """Without a last pressure, start from the overlap itself."""
        if cold:
            for y in range(ny):
                for x in range(thread, nx, wp.block_dim()):
                    win.pressure[slot, y, x] = wp.max(win.overlap[slot, y, x], real(0.0))
        block_sync()

    @wp.func
    def fit_load(win: windows_struct, slot: int, ny: int, nx: int, thread: int):
        """Scale the start to the least energy; ``gap`` holds its displacement and becomes the gap."""
        work = wp.float64(0.0)
        energy = wp.float64(0.0)
        for y in range(ny):
            for x in range(thread, nx, wp.block_dim()):
                p = win.pressure[slot, y, x]
                work += wp.float64(p) * wp.float64(wp.max(win.overlap[slot, y, x], real(-1.0e3)))
                energy += wp.float64(p) * wp.float64(win.gap[slot, y, x])
        work = block_sum(work)
        energy = block_sum(energy)
        factor = real(0.0)
        if energy > wp.float64(0.0):
            factor = real(wp.max(work / energy, wp.float64(0.0)))
        for y in range(ny):
            for x in range(thread, nx, wp.block_dim()):
                win.pressure[slot, y, x] = factor * win.pressure[slot, y, x]
                win.gap[slot, y, x] = factor * win.gap[slot, y, x] - win.overlap[slot, y, x]

    @wp.func
    def mask_gap(win: windows_struct, slot: int, ny: int, nx: int, thread: int):
        """Keep the gap where cells touch, or would penetrate; returns the sum of its squares."""
        total = wp.float64(0.0)
        for y in range(ny):
            for x in range(thread, nx, wp.block_dim()):
                g = win.gap[slot, y, x]
                m = wp.where(win.pressure[slot, y, x] > real(0.0) or g < real(0.0), g, real(0.0))
                win.masked[slot, y, x] = m
                total += wp.float64(m) * wp.float64(m)
        return block_sum(total)

    @wp.func
    def turn(win: windows_struct, slot: int, last: wp.float64, step: wp.float64, fresh: bool, ny: int, nx: int, t: int):
        """The next search direction, conjugate to the last (Polak-Ribiere); returns slope and preconditioned square."""
        square = wp.float64(0.0)
        change = wp.float64(0.0)
        for y in range(ny):
            for x in range(t, nx, wp.block_dim()):
                m = win.masked[slot, y, x]
                if m != real(0.0):
                    z = wp.float64(win.softened[slot, y, x])
                    square += wp.float64(m) * z
                    if not fresh:
                        change += z * wp.float64(win.answer[slot, y, x])
        square = block_sum(square)
        change = block_sum(change)
        beta = real(0.0)
        if not fresh and last > wp.float64(0.0):
            beta = real(wp.max(change * step / last, wp.float64(0.0)))
        slope = wp.float64(0.0)
        for y in range(ny):
            for x in range(t, nx, wp.block_dim()):
                m = win.masked[slot, y, x]
                d = real(0.0)
                if m != real(0.0):
                    d = -win.softened[slot, y, x]
                    if not fresh:
                        d += beta * win.direction[slot, y, x]
                win.direction[slot, y, x] = d
                slope += wp.float64(m) * wp.float64(d)
        slope = block_sum(slope)
        return slope, square

    @wp.func
    def curvature(win: windows_struct, slot: int, ny: int, nx: int, thread: int):
        total = wp.float64(0.0)
        for y in range(ny):
            for x in range(thread, nx, wp.block_dim()):
                total += wp.float64(win.direction[slot, y, x]) * wp.float64(win.answer[slot, y, x])
        return block_sum(total)

    @wp.func
    def advance(win: windows_struct, slot: int, step: real, ny: int, nx: int, thread: int):
        """Go along the direction; pressures that would pull become 0. Returns how many did."""
        pulled = wp.float64(0.0)
        for y in range(ny):
            for x in range(thread, nx, wp.block_dim()):
                p = win.pressure[slot, y, x] + step * win.direction[slot, y, x]
                if p < real(0.0):
                    pulled += wp.float64(1.0)
                    p = real(0.0)
                win.pressure[slot, y, x] = p
                win.gap[slot, y, x] = win.gap[slot, y, x] + step * win.answer[slot, y, x]
        return block_sum(pulled)

    @wp.func
    def subtract_overlap(win: windows_struct, slot: int, ny: int, nx: int, thread: int):
        for y in range(ny):
            for x in range(thread, nx, wp.block_dim()):
                win.gap[slot, y, x] = win.gap[slot, y, x] - win.overlap[slot, y, x]
        block_sync()

    @wp.func
    def publish(win: windows_struct, slot: int, box: wp.vec4i, new: wp.vec4i, pressure: grid, thread: int):
        """Clear the last window of the pressure and write the new one."""
        for y in range(box[0], wp.min(box[0] + box[2], pressure.shape[0])):
            for x in range(box[1] + thread, wp.min(box[1] + box[3], pressure.shape[1]), wp.block_dim()):
                pressure[y, x] = real(0.0)
        block_sync()
        for y in range(wp.min(new[2], pressure.shape[0] - new[0])):
            for x in range(thread, wp.min(new[3], pressure.shape[1] - new[1]), wp.block_dim()):
                pressure[new[0] + y, new[1] + x] = win.pressure[slot, y, x]

    @wp.func
    def solve(
        tables: tables_struct,
        ws: workspace,
        win: windows_struct,
        slot: int,
        ny: int,
        nx: int,
        reference: wp.float64,
        cold: bool,
        cap: int,
        tolerance: wp.float64,
        thread: int,
    ):
        """Conjugate gradients in one window; returns the residual and the iterations taken."""
        level_y = transform_level(ny)
        level_x = transform_level(nx)
        my = wp.static(SMALLEST_TRANSFORM) << level_y
        mx = wp.static(SMALLEST_TRANSFORM) << level_x
        start = tables.start[level_y, level_x]
        loads = win.pressure_lanes[slot]
        gap = win.gap[slot]
        start_from(win, slot, cold, ny, nx, thread)
        convolve(ws, slot, loads, tables.nn, start, ny, nx, my, mx, gap, thread)
        fit_load(win, slot, ny, nx, thread)
        fresh = bool(True)
        last = wp.float64(0.0)
        step = wp.float64(0.0)
        iteration = int(0)
        residual = wp.sqrt(mask_gap(win, slot, ny, nx, thread) / reference)
        while residual > tolerance and iteration < cap:
            convolve(
                ws, slot, win.masked_lanes[slot], tables.soften, start, ny, nx, my, mx, win.softened[slot], thread
            )
            slope, square = turn(win, slot, last, step, fresh, ny, nx, thread)
            block_sync()
            convolve(
                ws, slot, win.direction_lanes[slot], tables.nn, start, ny, nx, my, mx, win.answer[slot], thread
            )
            curved = curvature(win, slot, ny, nx, thread)
            if curved <= wp.float64(0.0) or slope >= wp.float64(0.0):
                if fresh:
                    break
                fresh = True
                continue
            step = -slope / curved
            pulled = advance(win, slot, real(step), ny, nx, thread)
            block_sync()
            fresh = pulled > wp.float64(0.0)
            if fresh:
                convolve(ws, slot, loads, tables.nn, start, ny, nx, my, mx, gap, thread)
                subtract_overlap(win, slot, ny, nx, thread)
            last = square
            iteration += 1
            residual = wp.sqrt(mask_gap(win, slot, ny, nx, thread) / reference)
            block_sync()
        return residual, iteration

    @wp.kernel(module="unique", enable_backward=False)
    def solve_normal(
        # Layer:
        tables: tables_struct,
        bulge: real,
        cap: int,
        tolerance: wp.float64,
        n_slots: int,
        # In:
        overlap: wp.array3d(dtype=real),
        # Scratch:
        ws: workspace,
        win: windows_struct,
        # Out:
        solved_overlap: wp.array3d(dtype=real),
        pressure_out: wp.array3d(dtype=real),
        box_out: wp.array(dtype=wp.vec4i),
        residual_out: wp.array(dtype=wp.float64),
        iterations_out: wp.array(dtype=wp.int32),
    ):
        slot, thread = wp.tid()
        for env in range(slot, overlap.shape[0], n_slots):
            deepest, flags, y0, x0, ny, nx = survey(overlap[env], solved_overlap[env], bulge, thread)
            old = box_out[env]
            residual = residual_out[env]
            iteration = int(0)
            if flags >= wp.static(BROKEN) or deepest <= real(0.0):
                publish(win, slot, old, wp.vec4i(0, 0, 0, 0), pressure_out[env], thread)
                old = wp.vec4i(0, 0, 0, 0)
                residual = wp.where(flags >= wp.static(BROKEN), wp.float64(wp.nan), wp.float64(0.0))
            elif flags > 0 or residual > tolerance:
                reference, load = gather(win, slot, overlap[env], pressure_out[env], y0, x0, ny, nx, thread)
                cold = load <= wp.float64(0.0)
                residual, iteration = solve(
                    tables, ws, win, slot, ny, nx, reference, cold, cap, tolerance, thread
                )
                new = wp.vec4i(y0, x0, ny, nx)
                publish(win, slot, old, new, pressure_out[env], thread)
                old = new
            block_sync()
            if thread == 0:
                box_out[env] = old
                residual_out[env] = residual
                iterations_out[env] = iteration

    return solve_normal
