"""What the friction solver works on and remembers (:mod:`tactemu.sensors.layer.friction`)."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.sensors.layer.convolution import block_sync, spread

FREE, STICK, SLIP = 0, 1, 2
"""State of a cell."""
AT_BOUND = 0.99999
"""A cell slips where its traction is beyond this part of mu p."""
FAR_OFF = 20.0
"""A gap so many times what mu p moves a lone cell is not closed by its neighbours either."""


@functools.cache
def friction_windows_type(real):
    """Vectors of the conjugate gradients, one window per block: ``(n_slots, rows, columns)``."""

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
        last_x: wp.array3d(dtype=real)  # that of the last iteration
        last_y: wp.array3d(dtype=real)
        stiffness: wp.array3d(dtype=real)  # of the circle; 0 where a cell sticks
        softened_x: wp.array3d(dtype=real)
        softened_y: wp.array3d(dtype=real)
        along_x: wp.array3d(dtype=real)  # search direction
        along_y: wp.array3d(dtype=real)
        answer_x: wp.array3d(dtype=real)  # displacement by the direction
        answer_y: wp.array3d(dtype=real)

    return FrictionWindows


_VECTORS = ("hold", "by_pressure", "gap", "free", "last", "softened", "along", "answer")
OFF_CHIP = ("hold_x", "hold_y", "by_pressure_x", "by_pressure_y")
"""Those that iterations hardly need: not on the chip (:mod:`.on_chip`) even where the others are."""
FRICTION_WINDOWS = ("limit", "pressure", "x", "y", "stiffness", *(f"{v}_{axis}" for v in _VECTORS for axis in "xy"))


@functools.cache
def friction_state_type(real):
    """What friction remembers of each cell, ``(n_envs, rows, columns)``."""

    @wp.struct
    class FrictionState:
        x: wp.array3d(dtype=real)  # traction
        y: wp.array3d(dtype=real)
        anchor_x: wp.array3d(dtype=real)  # where the surface is held or, in free cells, where it is
        anchor_y: wp.array3d(dtype=real)
        held_by: wp.array3d(dtype=wp.int32)  # the body that it touches, from 1; 0: none
        slip: wp.array3d(dtype=wp.int32)
        box: wp.array(dtype=wp.vec4i)
        residual: wp.array(dtype=wp.float64)
        iterations: wp.array(dtype=wp.int32)

    return FrictionState


@functools.cache
def memory_functions(real):
    """``(settle, mark)``: what a solved window leaves for the next step."""
    windows = friction_windows_type(real)
    vec2 = wp.types.vector(2, real)
    int_grid = wp.array2d(dtype=wp.int32)

    @wp.func
    def settle(win: windows, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """Where cells are held from now on, into ``hold``: free cells where they are, slipping ones as far as they slip
        against their traction. What else is left of a gap is the solver's error, which the next step closes; kept, it
        would add up over steps."""
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                limit = win.limit[slot, y, x]
                slipped = vec2(win.gap_x[slot, y, x], win.gap_y[slot, y, x])
                if limit > real(0.0):
                    q = vec2(win.x[slot, y, x], win.y[slot, y, x])
                    along = real(0.0)
                    if wp.length(q) >= real(AT_BOUND) * limit:
                        along = wp.min(wp.dot(slipped, q), real(0.0)) / wp.dot(q, q)
                    slipped = along * q
                win.hold_x[slot, y, x] = win.hold_x[slot, y, x] + slipped[0]
                win.hold_y[slot, y, x] = win.hold_y[slot, y, x] + slipped[1]
        block_sync()

    @wp.func
    def mark(
        win: windows,
        slot: int,
        body: int_grid,
        box: wp.vec4i,
        old: wp.vec4i,
        held_by: int_grid,
        slip: int_grid,
        thread: int,
    ):
        """Publish which body holds each cell, and whether it slips."""
        if old[3] > 0:
            mine = spread(old[3], thread)
            for y in range(mine[0], wp.min(old[2], slip.shape[0] - old[0]), mine[1]):
                for x in range(mine[2], wp.min(old[3], slip.shape[1] - old[1]), mine[3]):
                    held_by[old[0] + y, old[1] + x] = 0
                    slip[old[0] + y, old[1] + x] = FREE
        block_sync()
        if box[3] > 0:
            mine = spread(box[3], thread)
            for y in range(mine[0], wp.min(box[2], slip.shape[0] - box[0]), mine[1]):
                for x in range(mine[2], wp.min(box[3], slip.shape[1] - box[1]), mine[3]):
                    limit = win.limit[slot, y, x]
                    if limit > real(0.0):
                        q = wp.length(vec2(win.x[slot, y, x], win.y[slot, y, x]))
                        held_by[box[0] + y, box[1] + x] = body[box[0] + y, box[1] + x] + 1
                        slip[box[0] + y, box[1] + x] = wp.where(q >= real(AT_BOUND) * limit, SLIP, STICK)

    return settle, mark
