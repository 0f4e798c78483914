"""Coulomb friction between a rigid object and an elastic layer: tractions, stick and slip, with their history.

A cell that touches holds on to the object: where the object's surface has moved by ``s`` since the last step, the
skin's surface wants to be at ``a + s``, with ``a`` where it was held (or, for a new contact, where it was). With the
tangential compliance ``A`` and the displacement ``v`` by pressure alone, the tractions ``q`` are those of least energy
``q.A q / 2 - q.(a + s - v)`` among all with ``|q| <= mu p``. Cells at the bound slip: they are dragged along, and are
held from where they end up. ``q`` acts on the skin, so a sliding object drags the skin along.

Solved by conjugate gradients on the circles ``|q| = mu p`` and the discs inside them: the gradient is taken along the
circle where a cell slips, whose curvature adds the stiffness ``|gap| / (mu p)``. The layer's own inverse compliance,
weighted by that stiffness, is the preconditioner. Lengths in pitches, tractions in the unit of the pressures.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from typing import Any

import warp as wp

from tactemu.sensors.layer.convolution import (
    BLOCK,
    Block,
    block_sync,
    convolution_functions,
    spread,
    workspace_type,
)
from tactemu.sensors.layer.friction_simd import FrictionCells, wide_friction_cells
from tactemu.sensors.layer.friction_state import (
    AT_BOUND,
    FAR_OFF,
    friction_state_type,
    friction_windows_type,
    memory_functions,
)
from tactemu.sensors.layer.shared_memory import chip_functions, chip_numbers
from tactemu.sensors.layer.tables import tables_type
from tactemu.sensors.layer.tangential_compliance import tangential_functions
from tactemu.sensors.layer.window import block_functions, publish_function, transform_level, transform_size

CHIP_BLOCK = Block(256, 2)
"""On the chip: 64, 128 and 256 threads take 6.6, 4.5 and 4.1 ms for 4096 environments of 32 x 32 on an H200."""
ON_CHIP = (2, 14)
"""Spectra and windows on the chip, where skins are solved there: all but ``OFF_CHIP``, some of them in one place."""


@wp.func
def square(a: Any, b: Any):
    """Of the length of ``(a, b)``."""
    return wp.float64(a) * wp.float64(a) + wp.float64(b) * wp.float64(b)


@functools.cache
def friction_cells(real, lanes: int) -> FrictionCells:
    """What is done cell by cell between convolutions; on a CPU in its registers (:mod:`.friction_simd`)."""
    if lanes > 1:
        return wide_friction_cells(real)
    windows, vec2 = friction_windows_type(real), wp.types.vector(2, real)
    block_sum, _max = block_functions(lanes)

    @wp.func
    def norm(win: windows, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """From displacement by traction to gap; returns the sum of squared displacements where cells touch."""
        total = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                ux = win.gap_x[slot, y, x] + win.by_pressure_x[slot, y, x]
                uy = win.gap_y[slot, y, x] + win.by_pressure_y[slot, y, x]
                if win.limit[slot, y, x] > real(0.0):
                    total += square(ux, uy)
                win.gap_x[slot, y, x] = ux - win.hold_x[slot, y, x]
                win.gap_y[slot, y, x] = uy - win.hold_y[slot, y, x]
        return block_sum(total)

    @wp.func
    def free_gap(win: windows, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """The part of the gap that tractions can close, and the stiffness of the circles; returns its square."""
        total = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                limit = win.limit[slot, y, x]
                g = vec2(real(0.0))
                stiff = real(0.0)
                if limit > real(0.0):
                    g = vec2(win.gap_x[slot, y, x], win.gap_y[slot, y, x])
                    q = vec2(win.x[slot, y, x], win.y[slot, y, x])
                    outward = wp.dot(g, q) / limit
                    if wp.length(q) >= real(AT_BOUND) * limit and outward < real(0.0):
                        n = q / wp.length(q)
                        g = g - wp.dot(g, n) * n
                        stiff = -outward / limit
                weight = real(1.0) / wp.sqrt(real(1.0) + stiff)
                win.last_x[slot, y, x] = win.free_x[slot, y, x]
                win.last_y[slot, y, x] = win.free_y[slot, y, x]
                win.free_x[slot, y, x] = weight * g[0]
                win.free_y[slot, y, x] = weight * g[1]
                win.stiffness[slot, y, x] = stiff
                total += square(weight * weight * g[0], weight * weight * g[1])
        total = block_sum(total)
        block_sync()
        return total

    @wp.func
    def products(win: windows, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """Of the preconditioned gap with the gap, and with its change since the last iteration."""
        now = wp.float64(0.0)
        change = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                z = vec2(win.softened_x[slot, y, x], win.softened_y[slot, y, x])
                m = vec2(win.free_x[slot, y, x], win.free_y[slot, y, x])
                old = vec2(win.last_x[slot, y, x], win.last_y[slot, y, x])
                now += wp.float64(wp.dot(m, z))
                change += wp.float64(wp.dot(m - old, z))
        return wp.vec2d(block_sum(now), block_sum(change))

    @wp.func
    def direct(win: windows, slot: int, beta: real, fresh: bool, shape: wp.vec2i, mine: wp.vec4i):
        """The search direction, along the circles where cells slip, unless ``fresh`` with a part of the last; returns
        the slope along it."""
        slope = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                d = vec2(real(0.0))
                if win.limit[slot, y, x] > real(0.0):
                    stiff = win.stiffness[slot, y, x]
                    weight = real(1.0) / wp.sqrt(real(1.0) + stiff)
                    d = -weight * vec2(win.softened_x[slot, y, x], win.softened_y[slot, y, x])
                    if not fresh:
                        d += beta * vec2(win.along_x[slot, y, x], win.along_y[slot, y, x])
                    if stiff > real(0.0):
                        n = wp.normalize(vec2(win.x[slot, y, x], win.y[slot, y, x]))
                        d = d - wp.dot(d, n) * n
                    m = vec2(win.free_x[slot, y, x], win.free_y[slot, y, x]) / weight
                    slope += wp.float64(wp.dot(m, d))
                win.along_x[slot, y, x] = d[0]
                win.along_y[slot, y, x] = d[1]
        slope = block_sum(slope)
        block_sync()
        return slope

    @wp.func
    def curvature(win: windows, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        total = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                d = vec2(win.along_x[slot, y, x], win.along_y[slot, y, x])
                a = vec2(win.answer_x[slot, y, x], win.answer_y[slot, y, x])
                total += wp.float64(wp.dot(d, a + win.stiffness[slot, y, x] * d))
        return block_sum(total)

    @wp.func
    def advance(win: windows, slot: int, step: real, shape: wp.vec2i, mine: wp.vec4i):
        """Go along the direction, back to the discs; returns how many cells left them."""
        cut = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                limit = win.limit[slot, y, x]
                if limit > real(0.0):
                    d = vec2(win.along_x[slot, y, x], win.along_y[slot, y, x])
                    q = vec2(win.x[slot, y, x], win.y[slot, y, x]) + step * d
                    length = wp.length(q)
                    if length > limit:
                        q = q * (limit / length)
                        if length > real(1.000001) * limit:
                            cut += wp.float64(1.0)
                    win.x[slot, y, x] = q[0]
                    win.y[slot, y, x] = q[1]
                win.gap_x[slot, y, x] = win.gap_x[slot, y, x] + step * win.answer_x[slot, y, x]
                win.gap_y[slot, y, x] = win.gap_y[slot, y, x] + step * win.answer_y[slot, y, x]
        cut = block_sum(cut)
        block_sync()
        return cut

    return FrictionCells(norm, free_gap, products, direct, curvature, advance)


@functools.cache
def friction_kernel(real, lanes: int, coupled: bool, chip: bool):
    """The kernel that solves every environment; ``coupled``: pressure moves the surface tangential_compliance too;
    ``chip``: a block of threads does in its own memory what iterations need."""
    workspace, tables_struct = workspace_type(real), tables_type(real)
    windows, state_struct = friction_windows_type(real), friction_state_type(real)
    functions = convolution_functions(real, lanes, chip)
    forward, inverse, convolve = functions.forward, functions.inverse, functions.convolve
    tangential_compliance, publish = tangential_functions(real, lanes, chip), publish_function(real)
    settle, mark = memory_functions(real)
    norm, free_gap, products, direct, curvature, advance = friction_cells(real, lanes)
    block_sum, _max = block_functions(lanes)
    move_in, window = chip_functions(real, workspace, *ON_CHIP)
    by_pressure, by_traction = tangential_compliance.by_pressure, tangential_compliance.by_traction
    vec2 = wp.types.vector(2, real)
    grid, vec_grid, int_grid = wp.array2d(dtype=real), wp.array2d(dtype=vec2), wp.array2d(dtype=wp.int32)

    @wp.func
    def windows_in(win: windows, memory: wp.tile(dtype=real, shape=(chip_numbers(*ON_CHIP),))):
        """Those of the iterations move in; the others stay where they are."""
        near = win
        near.limit = window(memory, 0)
        near.stiffness = window(memory, 1)
        near.x = window(memory, 2)
        near.y = window(memory, 3)
        near.gap_x = window(memory, 4)
        near.gap_y = window(memory, 5)
        near.free_x = window(memory, 6)
        near.free_y = window(memory, 7)
        near.last_x = window(memory, 8)
        near.last_y = window(memory, 9)
        near.along_x = window(memory, 10)
        near.along_y = window(memory, 11)
        near.answer_x = window(memory, 12)
        near.answer_y = window(memory, 13)
        near.pressure = near.along_x  # needed one after the other, as the next
        near.softened_x = near.answer_x
        near.softened_y = near.answer_y
        return near

    @wp.func
    def gather(
        win: windows,
        slot: int,
        state: state_struct,
        env: int,
        mu: real,
        pressure: grid,
        slide: vec_grid,
        body: int_grid,
        box: wp.vec4i,
        mine: wp.vec4i,
    ):
        """Fetch the window; returns how far the object has slid over it [pitches squared]."""
        moved = wp.float64(0.0)
        for y in range(mine[0], box[2], mine[1]):
            for x in range(mine[2], box[3], mine[3]):
                gy = box[0] + y
                gx = box[1] + x
                p = real(0.0)
                q = vec2(real(0.0))
                hold = vec2(real(0.0))
                if gy < pressure.shape[0] and gx < pressure.shape[1]:
                    p = pressure[gy, gx]
                    if p > real(0.0):
                        hold = vec2(state.anchor_x[env, gy, gx], state.anchor_y[env, gy, gx])
                        if state.held_by[env, gy, gx] == body[gy, gx] + 1:
                            s = slide[gy, gx]
                            hold += s
                            moved += square(s[0], s[1])
                        q = vec2(state.x[env, gy, gx], state.y[env, gy, gx])
                        length = wp.length(q)
                        if length > mu * p:
                            q = q * (mu * p / length)
                win.pressure[slot, y, x] = p
                win.limit[slot, y, x] = mu * p
                win.hold_x[slot, y, x] = hold[0]
                win.hold_y[slot, y, x] = hold[1]
                win.x[slot, y, x] = q[0]
                win.y[slot, y, x] = q[1]
        moved = block_sum(moved)
        block_sync()
        return moved

    @wp.func
    def press(
        ws: workspace,
        tables: tables_struct,
        win: windows,
        slot: int,
        start: int,
        shape: wp.vec2i,
        size: wp.vec2i,
        mine: wp.vec4i,
        thread: int,
    ):
        """Displacement by pressure alone."""
        moved_x = win.by_pressure_x[slot]
        moved_y = win.by_pressure_y[slot]
        if wp.static(chip):
            moved_x = win.answer_x[slot]
            moved_y = win.answer_y[slot]
        if wp.static(coupled):
            spectrum = ws.spectrum[slot]
            second = ws.second[slot]
            forward(ws, slot, win.pressure[slot], shape, size, spectrum, thread)
            corner = wp.vec2i(0, 0)
            by_pressure(ws, slot, tables, 0, start, size, thread)
            inverse(ws, slot, second, corner, shape, size, moved_x, thread)
            by_pressure(ws, slot, tables, 1, start, size, thread)
            inverse(ws, slot, second, corner, shape, size, moved_y, thread)
        if wp.static(chip or not coupled):
            for y in range(mine[0], shape[0], mine[1]):
                for x in range(mine[2], shape[1], mine[3]):
                    moved = vec2(real(0.0))
                    if wp.static(coupled):
                        moved = vec2(moved_x[y, x], moved_y[y, x])
                    win.by_pressure_x[slot, y, x] = moved[0]
                    win.by_pressure_y[slot, y, x] = moved[1]
            block_sync()

    @wp.func
    def find_gap(
        ws: workspace,
        tables: tables_struct,
        win: windows,
        slot: int,
        start: int,
        shape: wp.vec2i,
        size: wp.vec2i,
        mine: wp.vec4i,
        thread: int,
    ):
        """The gap of the tractions, afresh; returns the sum of squared displacements where cells touch."""
        pull_x = win.x[slot]
        pull_y = win.y[slot]
        gap_x = win.gap_x[slot]
        gap_y = win.gap_y[slot]
        by_traction(ws, slot, tables, start, pull_x, pull_y, shape, size, wp.vec2i(0, 0), shape, gap_x, gap_y, thread)
        return norm(win, slot, shape, mine)

    @wp.func
    def drag(win: windows, slot: int, shape: wp.vec2i, mine: wp.vec4i):
        """Let cells slip whose gap no traction could close, each straight along its gap; returns how many there are."""
        far = wp.float64(0.0)
        for y in range(mine[0], shape[0], mine[1]):
            for x in range(mine[2], shape[1], mine[3]):
                limit = win.limit[slot, y, x]
                g = vec2(win.gap_x[slot, y, x], win.gap_y[slot, y, x])
                size = wp.length(g)
                if limit > real(0.0) and size > real(FAR_OFF) * limit:
                    win.x[slot, y, x] = -limit * g[0] / size
                    win.y[slot, y, x] = -limit * g[1] / size
                    far += wp.float64(1.0)
        far = block_sum(far)
        block_sync()
        return far

    @wp.func
    def turn(win: windows, slot: int, last: wp.float64, fresh: bool, shape: wp.vec2i, mine: wp.vec4i):
        """The next search direction; returns slope and preconditioned square."""
        square = products(win, slot, shape, mine)
        beta = real(0.0)
        if not fresh and last > wp.float64(0.0):
            beta = real(wp.max(square[1] / last, wp.float64(0.0)))
        slope = direct(win, slot, beta, fresh, shape, mine)
        if slope >= wp.float64(0.0) and not fresh:  # uphill: without what the last direction adds
            slope = direct(win, slot, beta, True, shape, mine)
        return slope, square[0]

    @wp.func
    def solve(
        ws: workspace,
        tables: tables_struct,
        win: windows,
        slot: int,
        start: int,
        shape: wp.vec2i,
        size: wp.vec2i,
        cap: int,
        tolerance: wp.float64,
        floor: wp.float64,
        mine: wp.vec4i,
        thread: int,
    ):
        """Conjugate gradients in one window; returns the residual and the iterations taken."""
        reference = wp.float64(0.0)
        residual = wp.float64(0.0)
        last = wp.float64(0.0)
        iteration = int(0)
        begun = bool(False)
        fresh = bool(True)
        moved = bool(True)  # the gap is not that of the tractions
        along_x = win.along_x[slot]
        along_y = win.along_y[slot]
        answer_x = win.answer_x[slot]
        answer_y = win.answer_y[slot]
        corner = wp.vec2i(0, 0)
        while True:
            if moved:
                reference = find_gap(ws, tables, win, slot, start, shape, size, mine, thread) + floor
            if not begun:
                begun = True
                moved = drag(win, slot, shape, mine) > wp.float64(0.0)
                if moved:
                    continue
            residual = wp.sqrt(free_gap(win, slot, shape, mine) / reference)
            if not (residual > tolerance) or iteration >= cap:
                break
            convolve(ws, slot, win.free_x[slot], tables.soften_x, start, shape, size, win.softened_x[slot], thread)
            convolve(ws, slot, win.free_y[slot], tables.soften_y, start, shape, size, win.softened_y[slot], thread)
            slope, now = turn(win, slot, last, fresh, shape, mine)
            by_traction(
                ws, slot, tables, start, along_x, along_y, shape, size, corner, shape, answer_x, answer_y, thread
            )
            curved = curvature(win, slot, shape, mine)
            if curved <= wp.float64(0.0):
                break
            moved = advance(win, slot, real(-slope / curved), shape, mine) > wp.float64(0.0)
            fresh = False
            last = now
            iteration += 1
        return residual, iteration

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=CHIP_BLOCK if chip else BLOCK)
    def solve_friction(
        turns: wp.vec4i,  # first environment, end, first slot, slots that take turns
        # Layer:
        tables: tables_struct,
        mu: real,
        cap: int,
        tolerance: wp.float64,
        # In:
        pressure: wp.array3d(dtype=real),
        boxes: wp.array(dtype=wp.vec4i),
        changed: wp.array(dtype=wp.int32),
        slide: wp.array3d(dtype=vec2),
        body: wp.array3d(dtype=wp.int32),
        # Scratch:
        ws: workspace,
        win: windows,
        # State and out:
        state: state_struct,
        changed_out: wp.array(dtype=wp.int32),
    ):
        place, thread = wp.tid()
        slot = turns[2] + place
        if wp.static(chip):
            memory = wp.tile_empty(shape=(wp.static(chip_numbers(*ON_CHIP)),), dtype=real, storage="shared")
            ws = move_in(ws, memory)
            win = windows_in(win, memory)
        for env in range(turns[0] + place, turns[1], turns[3]):
            box = boxes[env]
            old = state.box[env]
            residual = state.residual[env]
            shape = wp.vec2i(box[2], box[3])
            iteration = int(0)
            work = bool(False)
            if box[3] == 0:
                residual = wp.float64(0.0)
                work = old[3] > 0
            else:
                mine = spread(box[3], thread)
                moved = gather(win, slot, state, env, mu, pressure[env], slide[env], body[env], box, mine)
                work = moved > wp.float64(0.0) or changed[env] > 0 or residual > tolerance
                for i in range(4):
                    work = work or box[i] != old[i]
                if work:
                    level = transform_level(shape)
                    size = transform_size(level)
                    start = tables.start[level[0], level[1]]
                    press(ws, tables, win, slot, start, shape, size, mine, thread)
                    load = wp.float64(0.0)
                    for y in range(mine[0], shape[0], mine[1]):
                        for x in range(mine[2], shape[1], mine[3]):
                            load += square(win.limit[slot, y, x], real(0.0))
                    # A thousandth of what full slip would move a lone cell: less is not worth an iteration.
                    floor = wp.float64(1.0e-6) * block_sum(load)
                    residual, iteration = solve(
                        ws, tables, win, slot, start, shape, size, cap, tolerance, floor, mine, thread
                    )
                    settle(win, slot, shape, mine)
            if work:
                publish(win.x[slot], box, old, state.x[env], thread)
                publish(win.y[slot], box, old, state.y[env], thread)
                publish(win.hold_x[slot], box, old, state.anchor_x[env], thread)
                publish(win.hold_y[slot], box, old, state.anchor_y[env], thread)
                mark(win, slot, body[env], box, old, state.held_by[env], state.slip[env], thread)
            block_sync()
            if thread == 0:
                state.box[env] = box
                state.residual[env] = residual
                state.iterations[env] = iteration
                changed_out[env] = wp.max(changed[env], wp.where(work, 1, 0))
            block_sync()

    return solve_friction
