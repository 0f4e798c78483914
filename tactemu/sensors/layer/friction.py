"""Coulomb friction between a rigid object and an elastic layer: tractions, stick and slip, with their history.

A touching cell is held by the object: where the object's surface has moved by ``s`` since the last step, the skin's
surface is pulled to ``a + s``, with ``a`` where it was held (or, for a new contact, where it was). With the tangential
compliance ``A`` and the displacement ``v`` by pressure alone, the tractions ``q`` are those of least energy ``q.A q / 2
- q.(a + s - v)`` among all with ``|q| <= mu p``. Cells at the bound slip: they are dragged along, and are held from
where they end up. ``q`` acts on the skin, so a sliding object drags the skin along.

With a kinetic coefficient the bound falls while a cell slips. Its coefficient in a step follows from the distance ``w``
that it had slipped before, since it stuck: ``mu = mu_k + (mu_s - mu_k) max(1 - w / slip_distance, 0)``. A cell sticks
again, with ``w = 0``, where its traction is below the bound, and where nothing moves during a step. A skin that relaxes
may creep under an object that rests; there a slip of less than the tolerance times the displacement is none.

The solver uses conjugate gradients on the circles ``|q| = mu p`` and the discs inside them: where a cell slips, the
gradient is taken along the circle, whose curvature adds the stiffness ``|gap| / (mu p)``. The layer's own inverse
compliance, weighted by that stiffness, is the preconditioner. Lengths are in pitches, tractions in the unit of the
pressures.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

import functools
from typing import Any

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.sensors.layer.block import BLOCK, Block, Window, block_sync
from tactemu.sensors.layer.convolution import convolution_functions
from tactemu.sensors.layer.friction_cells import friction_cells
from tactemu.sensors.layer.friction_state import (
    MAX_CLOSABLE_GAP,
    friction_state_type,
    friction_windows_type,
    memory_functions,
)
from tactemu.sensors.layer.overlap import overlap_type
from tactemu.sensors.layer.pair_convolution import pair_functions
from tactemu.sensors.layer.pressure import pressure_state_type
from tactemu.sensors.layer.shared_memory import complex_memory, complex_numbers
from tactemu.sensors.layer.tables import layer_type
from tactemu.sensors.layer.tangential_compliance import tangential_functions
from tactemu.sensors.layer.window import block_functions, open_window, publish_function

SHARED_MEMORY_BLOCK = Block(128, 2)
"""Block of threads for solving in shared memory: 128 and 160 threads take 1.54 and 1.95 ms for 4096 environments
of 32 x 32 on an H100."""
SHARED_WINDOWS = 18
"""Number of windows in shared memory; some share one place."""


@wp.func
def square(a: Any, b: Any):
    """Return the squared length of ``(a, b)``."""
    return wp.float64(a) * wp.float64(a) + wp.float64(b) * wp.float64(b)


@functools.cache
def friction_kernel(real, lanes: int, coupled: bool, is_shared: bool, weakens: bool = False, creeps: bool = False):
    """Return the kernel that solves every environment; ``coupled``: pressure also moves the surface tangentially;
    ``is_shared``: a block of threads iterates in its shared memory; ``weakens``: the coefficient falls with slip;
    ``creeps``: the surface of a skin that weakens may move while the object rests."""
    layer_struct, overlap_struct, pressed_struct = layer_type(real), overlap_type(real), pressure_state_type(real)
    windows, state_struct = friction_windows_type(real), friction_state_type(real)
    functions = convolution_functions(real, lanes, False)
    forward, inverse, convolve = functions.forward, functions.inverse, functions.convolve
    tangential_compliance, publish = tangential_functions(real, lanes, False), publish_function(real)
    settle, mark = memory_functions(real, weakens, creeps)
    norm, free_gap, products, direct, curvature, advance = friction_cells(real, lanes, is_shared)
    block_sum, _max = block_functions(lanes)
    complex_field, window = complex_memory(real, SHARED_WINDOWS)
    pairs = pair_functions(real)
    by_pressure = tangential_compliance.by_pressure
    by_traction = tangential_compliance.by_traction
    soften_pair, by_pressure_pair, by_traction_pair = pairs.soften, pairs.by_pressure, pairs.by_traction
    vec2, grid = wp.types.vector(2, real), wp.array2d(dtype=real)

    @wp.func
    def shared_windows(win: windows, memory: wp.tile(dtype=real, shape=(complex_numbers(SHARED_WINDOWS),))):
        """Return the windows in shared memory."""
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
        near.hold_x = window(memory, 14)
        near.hold_y = window(memory, 15)
        near.by_pressure_x = window(memory, 16)
        near.by_pressure_y = window(memory, 17)
        near.pressure = near.along_x  # used at different times, like the next two
        near.softened_x = near.answer_x
        near.softened_y = near.answer_y
        near.ws.spectrum = complex_field(memory)
        return near

    @wp.func
    def coefficient(layer: layer_struct, slipped: real):
        """Return the coefficient of friction of a cell that has slipped this far [pitches]."""
        left = wp.max(real(1.0) - slipped / layer.slip_distance, real(0.0))
        return layer.kinetic + (layer.friction - layer.kinetic) * left

    @wp.func
    def heal(state: state_struct, at: Window, box: wp.vec4i, env: int):
        """Let all cells stick again."""
        for y in range(at.mine[0], wp.min(box[2], state.slipped.shape[1] - box[0]), at.mine[1]):
            for x in range(at.mine[2], wp.min(box[3], state.slipped.shape[2] - box[1]), at.mine[3]):
                state.slipped[env, box[0] + y, box[1] + x] = real(0.0)

    @wp.func
    def gather(
        layer: layer_struct,
        win: windows,
        at: Window,
        state: state_struct,
        pressed: pressed_struct,
        over: overlap_struct,
        env: int,
    ):
        """Fetch the window; return the sum of squared slides of the object over it [pitches squared], and of the shares
        by which tractions are above bounds that have fallen with slip."""
        moved = wp.float64(0.0)
        mu = layer.friction
        pressure = pressed.pressure[env]
        slide = over.slide[env]
        body = over.body[env]
        box = pressed.box[env]
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
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
                        if wp.static(weakens):
                            if state.held_by[env, gy, gx] != body[gy, gx] + 1:
                                state.slipped[env, gy, gx] = real(0.0)
                            mu = coefficient(layer, state.slipped[env, gy, gx])
                            if length > real(1.000001) * mu * p:
                                moved += square(length / (mu * p + p * real(1.0e-6)) - real(1.0), real(0.0))
                        if length > mu * p:
                            q = q * (mu * p / length)
                win.pressure[at.slot, y, x] = p
                win.limit[at.slot, y, x] = mu * p
                win.hold_x[at.slot, y, x] = hold[0]
                win.hold_y[at.slot, y, x] = hold[1]
                win.x[at.slot, y, x] = q[0]
                win.y[at.slot, y, x] = q[1]
        moved = block_sum(moved)
        block_sync()
        return moved

    @wp.func
    def press(layer: layer_struct, win: windows, at: Window):
        """Compute the displacement by pressure alone."""
        moved_x = win.by_pressure_x[at.slot]
        moved_y = win.by_pressure_y[at.slot]
        if wp.static(coupled and is_shared):
            by_pressure_pair(win.ws, at, layer.tables, win.pressure[at.slot], moved_x, moved_y, at.shape)
        if wp.static(coupled and not is_shared):
            second = win.ws.second[at.slot]
            forward(win.ws, at, win.pressure[at.slot], win.ws.spectrum[at.slot])
            by_pressure(win.ws, at, layer.tables, 0)
            inverse(win.ws, at, second, moved_x)
            by_pressure(win.ws, at, layer.tables, 1)
            inverse(win.ws, at, second, moved_y)
        if wp.static(not coupled):
            for y in range(at.mine[0], at.shape[0], at.mine[1]):
                for x in range(at.mine[2], at.shape[1], at.mine[3]):
                    moved_x[y, x] = real(0.0)
                    moved_y[y, x] = real(0.0)
            block_sync()

    @wp.func
    def pull(layer: layer_struct, win: windows, at: Window, x: grid, y: grid, out_x: grid, out_y: grid):
        """Compute the displacement by tractions."""
        if wp.static(is_shared):
            by_traction_pair(win.ws, at, layer.tables, x, y, out_x, out_y, at.shape, False)
        else:
            by_traction(win.ws, at, layer.tables, x, y, out_x, out_y)

    @wp.func
    def find_gap(layer: layer_struct, win: windows, at: Window):
        """Compute the gap of the tractions anew; return the sum of squared displacements where cells touch."""
        pull(layer, win, at, win.x[at.slot], win.y[at.slot], win.gap_x[at.slot], win.gap_y[at.slot])
        return block_sum(norm(win, at))

    @wp.func
    def drag(win: windows, at: Window):
        """Let cells slip whose gap no traction could close, each straight along its gap; return their number."""
        far = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                limit = win.limit[at.slot, y, x]
                g = vec2(win.gap_x[at.slot, y, x], win.gap_y[at.slot, y, x])
                size = wp.length(g)
                if limit > real(0.0) and size > real(MAX_CLOSABLE_GAP) * limit:
                    win.x[at.slot, y, x] = -limit * g[0] / size
                    win.y[at.slot, y, x] = -limit * g[1] / size
                    far += wp.float64(1.0)
        far = block_sum(far)
        block_sync()
        return far

    @wp.func
    def soften(layer: layer_struct, win: windows, at: Window):
        """Apply the preconditioner to the gap that can close."""
        free_x = win.free_x[at.slot]
        free_y = win.free_y[at.slot]
        softened_x = win.softened_x[at.slot]
        softened_y = win.softened_y[at.slot]
        if wp.static(is_shared):
            soften_pair(win.ws, at, layer.tables, free_x, free_y, softened_x, softened_y)
        else:
            convolve(win.ws, at, free_x, layer.tables.soften_x, softened_x)
            convolve(win.ws, at, free_y, layer.tables.soften_y, softened_y)

    @wp.func
    def turn(win: windows, at: Window, last: wp.float64, fresh: bool):
        """Compute the next search direction; return slope and preconditioned square."""
        parts = products(win, at)
        now = block_sum(parts[0])
        change = block_sum(parts[1])
        beta = real(0.0)
        if not fresh and last > wp.float64(0.0):
            beta = real(wp.max(change / last, wp.float64(0.0)))
        slope = block_sum(direct(win, at, beta, fresh))
        if slope >= wp.float64(0.0) and not fresh:  # uphill: restart without the last direction
            slope = block_sum(direct(win, at, beta, True))
        return slope, now

    @wp.func
    def solve(layer: layer_struct, win: windows, at: Window, floor: wp.float64):
        """Run conjugate gradients in one window; return the residual and the number of iterations."""
        reference = wp.float64(0.0)
        residual = wp.float64(0.0)
        last = wp.float64(0.0)
        iteration = int(0)
        begun = bool(False)
        fresh = bool(True)
        moved = bool(True)  # the gap is not that of the tractions
        along_x = win.along_x[at.slot]
        along_y = win.along_y[at.slot]
        while True:
            if moved:
                reference = find_gap(layer, win, at) + floor
            if not begun:
                begun = True
                moved = drag(win, at) > wp.float64(0.0)
                if moved:
                    continue
            residual = wp.sqrt(block_sum(free_gap(win, at)) / reference)
            if not (residual > layer.tolerance) or iteration >= layer.cap:
                break
            soften(layer, win, at)
            slope, now = turn(win, at, last, fresh)
            pull(layer, win, at, along_x, along_y, win.answer_x[at.slot], win.answer_y[at.slot])
            curved = block_sum(curvature(win, at))
            if curved <= wp.float64(0.0):
                break
            moved = block_sum(advance(win, at, real(-slope / curved))) > wp.float64(0.0)
            fresh = False
            last = now
            iteration += 1
        return residual, iteration

    # Approximate ratios and roots save a quarter of the time; they are as accurate as sums of float32.
    @warp_kernel(
        launch_bounds=SHARED_MEMORY_BLOCK if is_shared else BLOCK,
        module_options={"fast_math": True} if is_shared else None,
    )
    def solve_friction(
        turns: wp.vec4i,
        layer: layer_struct,
        over: overlap_struct,
        pressed: pressed_struct,
        win: windows,
        state: state_struct,
    ):
        place, thread = wp.tid()
        if wp.static(is_shared):
            memory = wp.tile_empty(shape=(wp.static(complex_numbers(SHARED_WINDOWS)),), dtype=real, storage="shared")
            win = shared_windows(win, memory)
        for env in range(turns[0] + place, turns[1], turns[3]):
            box = pressed.box[env]
            old = state.box[env]
            residual = state.residual[env]
            shape = wp.vec2i(box[2], box[3])
            at = open_window(shape, shape, layer.tables.start, turns[2] + place, thread)
            iteration = int(0)
            work = bool(False)
            if box[3] == 0:
                residual = wp.float64(0.0)
                work = old[3] > 0
            else:
                moved = gather(layer, win, at, state, pressed, over, env)
                work = moved > wp.float64(0.0) or pressed.changed[env] > 0 or residual > layer.tolerance
                for i in range(4):
                    work = work or box[i] != old[i]
                if work:
                    press(layer, win, at)
                    load = wp.float64(0.0)
                    for y in range(at.mine[0], at.shape[0], at.mine[1]):
                        for x in range(at.mine[2], at.shape[1], at.mine[3]):
                            load += square(win.limit[at.slot, y, x], real(0.0))
                    # A thousandth of the displacement that full slip would give a single cell: less is not worth an
                    # iteration.
                    floor = wp.float64(1.0e-6) * block_sum(load)
                    residual, iteration = solve(layer, win, at, floor)
                    settle(win, at, box, over.slide[env], real(layer.tolerance), state, env)
                if wp.static(weakens):
                    if not work:
                        heal(state, at, box, env)
            if work:
                publish(win.x[at.slot], box, old, state.x[env], thread)
                publish(win.y[at.slot], box, old, state.y[env], thread)
                publish(win.hold_x[at.slot], box, old, state.anchor_x[env], thread)
                publish(win.hold_y[at.slot], box, old, state.anchor_y[env], thread)
                mark(win, at, over.body[env], box, old, state.held_by[env], state.slip[env])
            block_sync()
            if thread == 0:
                state.box[env] = box
                state.residual[env] = residual
                state.iterations[env] = iteration
                state.changed[env] = wp.max(pressed.changed[env], wp.where(work, 1, 0))
            block_sync()

    return solve_friction
