"""The working arrays and the state of the friction solver (:mod:`tactemu.sensors.layer.friction`)."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.sensors.layer.block import Window, block_sync, spread
from tactemu.sensors.layer.convolution import workspace_type

FREE = 0
"""State of a cell without contact."""
STICK = 1
"""State of a cell that sticks to the body."""
SLIP = 2
"""State of a cell over which the body slips."""
SLIP_FRACTION = 0.99999
"""Fraction of mu p beyond which a cell's traction counts as slipping."""
MAX_CLOSABLE_GAP = 20.0
"""Largest gap that neighbours can help to close, as a multiple of the displacement of a single cell by mu p."""


@functools.cache
def friction_windows_type(real):
    """Return the Warp struct of the vectors of the conjugate gradients, one window per block: ``(n_slots, rows,
    columns)``."""

    @wp.struct
    class FrictionWindows:
        limit: wp.array3d(dtype=real)  # mu p
        hold_x: wp.array3d(dtype=real)  # a + s
        hold_y: wp.array3d(dtype=real)
        pressure: wp.array3d(dtype=real)
        x: wp.array3d(dtype=real)  # traction
        y: wp.array3d(dtype=real)
        by_pressure_x: wp.array3d(dtype=real)  # v
        by_pressure_y: wp.array3d(dtype=real)
        gap_x: wp.array3d(dtype=real)  # displacement - hold
        gap_y: wp.array3d(dtype=real)
        free_x: wp.array3d(dtype=real)  # the part of the gap that can close, weighted
        free_y: wp.array3d(dtype=real)
        last_x: wp.array3d(dtype=real)  # free of the last iteration
        last_y: wp.array3d(dtype=real)
        stiffness: wp.array3d(dtype=real)  # stiffness of the circle; 0 where a cell sticks
        softened_x: wp.array3d(dtype=real)
        softened_y: wp.array3d(dtype=real)
        along_x: wp.array3d(dtype=real)  # search direction
        along_y: wp.array3d(dtype=real)
        answer_x: wp.array3d(dtype=real)  # displacement by the direction
        answer_y: wp.array3d(dtype=real)
        ws: workspace_type(real)  # scratch of the convolutions

    return FrictionWindows


_VECTORS = ("hold", "by_pressure", "gap", "free", "last", "softened", "along", "answer")
FRICTION_WINDOWS = ("limit", "pressure", "x", "y", "stiffness", *(f"{v}_{axis}" for v in _VECTORS for axis in "xy"))


@functools.cache
def friction_state_type(real):
    """Return the Warp struct of the state that friction keeps of each cell, ``(n_envs, rows, columns)``."""

    @wp.struct
    class FrictionState:
        x: wp.array3d(dtype=real)  # traction
        y: wp.array3d(dtype=real)
        anchor_x: wp.array3d(dtype=real)  # place where the surface is held or, in free cells, is
        anchor_y: wp.array3d(dtype=real)
        held_by: wp.array3d(dtype=wp.int32)  # index + 1 of the body that it touches; 0: none
        slip: wp.array3d(dtype=wp.int32)
        slipped: wp.array3d(dtype=real)  # distance that a cell has slipped since it stuck; with two coefficients only
        box: wp.array(dtype=wp.vec4i)
        residual: wp.array(dtype=wp.float64)
        iterations: wp.array(dtype=wp.int32)
        changed: wp.array(dtype=wp.int32)  # 1: pressures or tractions changed in this step

    return FrictionState


@functools.cache
def memory_functions(real, weakens: bool, creeps: bool):
    """Return the functions ``(settle, mark)``, which keep a solved window for the next step; ``weakens``: also how far
    cells have slipped; ``creeps``: without a slip that is less than the solver resolves, where the object rests."""
    windows, state_struct = friction_windows_type(real), friction_state_type(real)
    vec2 = wp.types.vector(2, real)
    int_grid = wp.array2d(dtype=wp.int32)

    @wp.func
    def settle(
        win: windows,
        at: Window,
        box: wp.vec4i,
        slide: wp.array2d(dtype=vec2),
        tolerance: real,
        state: state_struct,
        env: int,
    ):
        """Store into ``hold`` where cells are held from now on: free cells where they are, slipping ones as far as they
        slip against their traction. Any other remaining gap is the solver's error, which the next step closes; if kept,
        it would accumulate."""
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                limit = win.limit[at.slot, y, x]
                slipped = vec2(win.gap_x[at.slot, y, x], win.gap_y[at.slot, y, x])
                if limit > real(0.0):
                    q = vec2(win.x[at.slot, y, x], win.y[at.slot, y, x])
                    along = real(0.0)
                    if wp.length(q) >= real(SLIP_FRACTION) * limit:
                        along = wp.min(wp.dot(slipped, q), real(0.0)) / wp.dot(q, q)
                    slipped = along * q
                    if wp.static(weakens):
                        before = state.slipped[env, box[0] + y, box[1] + x]
                        far = wp.where(along < real(0.0), before + wp.length(slipped), real(0.0))
                        if wp.static(creeps):
                            size = wp.length(vec2(win.hold_x[at.slot, y, x], win.hold_y[at.slot, y, x]))
                            rests = wp.length(slide[box[0] + y, box[1] + x]) == real(0.0)
                            if rests and wp.length(slipped) <= tolerance * size:
                                far = real(0.0)
                        state.slipped[env, box[0] + y, box[1] + x] = far
                win.hold_x[at.slot, y, x] = win.hold_x[at.slot, y, x] + slipped[0]
                win.hold_y[at.slot, y, x] = win.hold_y[at.slot, y, x] + slipped[1]
        block_sync()

    @wp.func
    def mark(win: windows, at: Window, body: int_grid, box: wp.vec4i, old: wp.vec4i, held_by: int_grid, slip: int_grid):
        """Write to the grid which body holds each cell, and whether it slips."""
        if old[3] > 0:
            mine = spread(old[3], at.thread)
            for y in range(mine[0], wp.min(old[2], slip.shape[0] - old[0]), mine[1]):
                for x in range(mine[2], wp.min(old[3], slip.shape[1] - old[1]), mine[3]):
                    held_by[old[0] + y, old[1] + x] = 0
                    slip[old[0] + y, old[1] + x] = FREE
        block_sync()
        if box[3] > 0:
            for y in range(at.mine[0], wp.min(box[2], slip.shape[0] - box[0]), at.mine[1]):
                for x in range(at.mine[2], wp.min(box[3], slip.shape[1] - box[1]), at.mine[3]):
                    limit = win.limit[at.slot, y, x]
                    if limit > real(0.0):
                        q = wp.length(vec2(win.x[at.slot, y, x], win.y[at.slot, y, x]))
                        held_by[box[0] + y, box[1] + x] = body[box[0] + y, box[1] + x] + 1
                        slip[box[0] + y, box[1] + x] = wp.where(q >= real(SLIP_FRACTION) * limit, SLIP, STICK)

    return settle, mark
