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

from tactemu.base.kernels import warp_kernel
from tactemu.plan.scalars import is_nan
from tactemu.sensors.layer.block import BLOCK, Block, Window, block_sync
from tactemu.sensors.layer.convolution import Workspace, convolution_functions, padded_zeros, workspace_type
from tactemu.sensors.layer.overlap import NO_SURFACE, overlap_type
from tactemu.sensors.layer.pressure_cells import pressure_cells
from tactemu.sensors.layer.shared_memory import complex_memory, complex_numbers
from tactemu.sensors.layer.single_convolution import single_convolution
from tactemu.sensors.layer.tables import layer_type
from tactemu.sensors.layer.window import (
    BOX_STEP,
    BROKEN,
    SAME,
    around,
    block_functions,
    open_window,
    publish_function,
    survey_function,
)

SHARED_MEMORY_BLOCK = Block(128, 3)
"""Block of threads for solving in shared memory: 64, 96 and 128 threads take 0.55, 0.52 and 0.44 ms for 4096
environments of 32 x 32 on an H100."""


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
        ws: workspace_type(real)  # scratch of the convolutions

    return Windows


@functools.cache
def pressure_state_type(real):
    """Return the Warp struct of what the solver keeps and writes: of each cell, ``(n_envs, rows, columns)``, or of each
    environment."""

    @wp.struct
    class PressureState:
        solved: wp.array3d(dtype=real)  # overlap of the last step
        pressure: wp.array3d(dtype=real)
        box: wp.array(dtype=wp.vec4i)  # window of the contact: first row, first column, rows, columns
        residual: wp.array(dtype=wp.float64)
        iterations: wp.array(dtype=wp.int32)
        changed: wp.array(dtype=wp.int32)  # 1: the pressures changed in this step
        dirty: wp.array(dtype=wp.vec4i)  # box in which they, or the surface, changed

    return PressureState


NORMAL_WINDOWS = ("overlap", "pressure", "gap", "masked", "softened", "direction", "answer")


class Windows:
    """The windows of a Warp struct of arrays: it allocates them and keeps them alive.

    Args:
        struct: the instance whose fields are filled.
        names: names of the fields.
        workspace: the scratch of the convolutions.
        n_slots: number of windows.
        shape: largest window, ``(rows, columns)``.
    """

    def __init__(self, struct, names: tuple[str, ...], workspace: Workspace, n_slots: int, shape: tuple[int, int]):
        rows, columns = (-(-n // BOX_STEP) * BOX_STEP for n in shape)
        self.struct = struct
        struct.ws = workspace.struct
        real, lanes, device = workspace.real, workspace.lanes, workspace.device
        self._arrays = [padded_zeros(n_slots, rows, columns, real, lanes, device) for _ in names]
        for name, array in zip(names, self._arrays):
            setattr(struct, name, array)


@functools.cache
def normal_kernel(real, lanes: int, is_shared: bool):
    """Return the kernel that solves every environment; one block of threads per slot. ``is_shared``: it works in the
    block's shared memory."""
    layer_struct, overlap_struct, state_struct = layer_type(real), overlap_type(real), pressure_state_type(real)
    windows_struct = windows_type(real)
    convolve_any, convolve_single = convolution_functions(real, lanes, False).convolve, single_convolution(real)
    survey, publish = survey_function(real, lanes), publish_function(real)
    mask_gap, products, direct, curvature, advance = pressure_cells(real, windows_struct, lanes, is_shared)
    block_sum, _max = block_functions(lanes)
    complex_field, window = complex_memory(real, len(NORMAL_WINDOWS))
    grid = wp.array2d(dtype=real)

    @wp.func
    def shared_windows(win: windows_struct, memory: wp.tile(dtype=real, shape=(complex_numbers(len(NORMAL_WINDOWS)),))):
        near = win
        near.overlap = window(memory, 0)
        near.pressure = window(memory, 1)
        near.gap = window(memory, 2)
        near.masked = window(memory, 3)
        near.softened = window(memory, 4)
        near.direction = window(memory, 5)
        near.answer = window(memory, 6)
        near.ws.spectrum = complex_field(memory)
        return near

    @wp.func
    def convolve(win: windows_struct, at: Window, field: grid, table: wp.array(dtype=real), out: grid):
        if wp.static(is_shared):
            convolve_single(win.ws, at, field, table, out, at.shape)
        else:
            convolve_any(win.ws, at, field, table, out)

    @wp.func
    def gather(win: windows_struct, at: Window, overlap: grid, pressure: grid, box: wp.vec4i):
        """Fetch overlap and last pressure; without one, start from the overlap. Return the sum of squared overlaps."""
        deep = wp.float64(0.0)
        load = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                o = real(NO_SURFACE)
                p = real(0.0)
                if box[0] + y < overlap.shape[0] and box[1] + x < overlap.shape[1]:
                    o = overlap[box[0] + y, box[1] + x]
                    p = pressure[box[0] + y, box[1] + x]
                win.overlap[at.slot, y, x] = o
                win.pressure[at.slot, y, x] = p
                load += wp.float64(p)
                if o > real(0.0):
                    deep += wp.float64(o) * wp.float64(o)
        if block_sum(load) <= wp.float64(0.0):
            for y in range(at.mine[0], at.shape[0], at.mine[1]):
                for x in range(at.mine[2], at.shape[1], at.mine[3]):
                    win.pressure[at.slot, y, x] = wp.max(win.overlap[at.slot, y, x], real(0.0))
        block_sync()
        return block_sum(deep)

    @wp.func
    def fit_load(win: windows_struct, at: Window):
        """Scale the start to the least energy; ``gap`` holds its displacement and becomes the gap."""
        work = wp.float64(0.0)
        energy = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                p = win.pressure[at.slot, y, x]
                if p > real(0.0):
                    work += wp.float64(p) * wp.float64(win.overlap[at.slot, y, x])
                    energy += wp.float64(p) * wp.float64(win.gap[at.slot, y, x])
        work = block_sum(work)
        energy = block_sum(energy)
        factor = real(0.0)
        if energy > wp.float64(0.0):
            factor = real(wp.max(work / energy, wp.float64(0.0)))
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                win.pressure[at.slot, y, x] = factor * win.pressure[at.slot, y, x]
                win.gap[at.slot, y, x] = factor * win.gap[at.slot, y, x] - win.overlap[at.slot, y, x]

    @wp.func
    def turn(win: windows_struct, at: Window, last: wp.float64, step: wp.float64, fresh: bool):
        """Compute the next search direction, conjugate to the last (Polak-Ribiere); return slope and preconditioned
        square."""
        parts = products(win, at, fresh)
        square = block_sum(parts[0])
        change = block_sum(parts[1])
        beta = real(0.0)
        if not fresh and last > wp.float64(0.0):
            beta = real(wp.max(change * step / last, wp.float64(0.0)))
        slope = block_sum(direct(win, at, beta, fresh))
        if slope >= wp.float64(0.0) and not fresh:  # uphill: restart without the last direction
            slope = block_sum(direct(win, at, beta, True))
        return slope, square

    @wp.func
    def subtract_overlap(win: windows_struct, at: Window):
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                win.gap[at.slot, y, x] = win.gap[at.slot, y, x] - win.overlap[at.slot, y, x]
        block_sync()

    @wp.func
    def solve(layer: layer_struct, win: windows_struct, at: Window, reference: wp.float64):
        """Run conjugate gradients in one window; return the residual and the number of iterations."""
        loads = win.pressure[at.slot]
        masked = win.masked[at.slot]
        direction = win.direction[at.slot]
        convolve(win, at, loads, layer.tables.nn, win.gap[at.slot])
        fit_load(win, at)
        fresh = bool(True)
        last = wp.float64(0.0)
        step = wp.float64(0.0)
        iteration = int(0)
        residual = wp.sqrt(block_sum(mask_gap(win, at)) / reference)
        while residual > layer.tolerance and iteration < layer.cap:
            convolve(win, at, masked, layer.tables.soften, win.softened[at.slot])
            slope, square = turn(win, at, last, step, fresh)
            convolve(win, at, direction, layer.tables.nn, win.answer[at.slot])
            curved = block_sum(curvature(win, at))
            if curved <= wp.float64(0.0):
                break
            step = -slope / curved
            fresh = block_sum(advance(win, at, real(step))) > wp.float64(0.0)
            if fresh:  # clipped pressures change the gap everywhere
                convolve(win, at, loads, layer.tables.nn, win.gap[at.slot])
                subtract_overlap(win, at)
            last = square
            iteration += 1
            residual = wp.sqrt(block_sum(mask_gap(win, at)) / reference)
        return residual, iteration

    @warp_kernel(launch_bounds=SHARED_MEMORY_BLOCK if is_shared else BLOCK)
    def solve_normal(
        turns: wp.vec4i, layer: layer_struct, over: overlap_struct, win: windows_struct, state: state_struct
    ):
        place, thread = wp.tid()
        if wp.static(is_shared):
            memory = wp.tile_empty(
                shape=(wp.static(complex_numbers(len(NORMAL_WINDOWS))),), dtype=real, storage="shared"
            )
            win = shared_windows(win, memory)
        for env in range(turns[0] + place, turns[1], turns[3]):
            overlap = over.overlap[env]
            news, box = survey(overlap, state.solved[env], over.active[env], layer.bulge, thread)
            residual = state.residual[env]
            old = state.box[env]
            shape = wp.vec2i(box[2], box[3])
            at = open_window(shape, shape, layer.tables.start, turns[2] + place, thread)
            iteration = int(0)
            changed = int(0)
            if news == BROKEN or box[3] == 0:
                publish(win.pressure[at.slot], box, old, state.pressure[env], thread)
                if news == BROKEN or is_nan(residual):  # every taxel begins or ceases to read NaN
                    old = wp.vec4i(0, 0, overlap.shape[0], overlap.shape[1])
                changed = wp.min(old[3], 1)
                residual = wp.where(news == BROKEN, wp.float64(wp.nan), wp.float64(0.0))
            elif news != SAME or residual > layer.tolerance:
                changed = 1
                reference = gather(win, at, overlap, state.pressure[env], box)
                residual, iteration = solve(layer, win, at, reference)
                publish(win.pressure[at.slot], box, old, state.pressure[env], thread)
            block_sync()
            if thread == 0:
                state.box[env] = box
                state.residual[env] = residual
                state.iterations[env] = iteration
                state.changed[env] = changed
                state.dirty[env] = around(box, old)
            block_sync()

    return solve_normal
