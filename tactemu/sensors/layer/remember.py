"""The stage after the contact of a layer that relaxes: what each term keeps of a solved step (:mod:`.memory`)."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.sensors.layer.block import BLOCK, block_sync, spread
from tactemu.sensors.layer.friction_state import friction_state_type
from tactemu.sensors.layer.memory import ALONG_X, ALONG_Y, PRESSURE, memory_type, term, window_around, within
from tactemu.sensors.layer.pressure import pressure_state_type
from tactemu.sensors.layer.window import around, block_functions

FORGOTTEN = 1e-9
"""Share of the largest pressure so far below which a cell is forgotten."""


@functools.cache
def remember_kernel(real, lanes: int, with_friction: bool):
    """Return the kernel that keeps a solved step: its true pressures and tractions, what each term keeps of it, and
    where friction holds the surface; one block of threads per slot."""
    memory_struct, pressed_struct = memory_type(real), pressure_state_type(real)
    friction_state = friction_state_type(real)
    block_sum, block_max = block_functions(lanes)
    grid, f64 = wp.array2d(dtype=real), wp.float64

    @wp.func
    def keep(memory: memory_struct, env: int, component: int, y: int, x: int, z: real, out: grid):
        """Advance the terms of a cell; return the largest magnitude in it, and 1 if it has changed."""
        n = memory.shares.shape[0]
        before = f64(memory.whole[env, component, y, x])
        h = f64(0.0)
        for k in range(n):
            h += term(memory, env, k, before, memory.kept[env, component * n + k, y, x])
        whole = f64(z) + h / memory.scale[env]
        largest = wp.abs(whole)
        for k in range(n):
            a = memory.decays[env, k]
            c = memory.growths[env, k]
            m = memory.kept[env, component * n + k, y, x]
            m += (f64(1.0) - a - c) * (before - m) + c * (whole - m)
            memory.kept[env, component * n + k, y, x] = m
            largest = wp.max(largest, wp.abs(m))
        true = real(memory.scale[env] * f64(z))
        changed = f64(0.0)
        if f64(real(whole)) != before or true != out[y, x]:
            changed = f64(1.0)
        memory.whole[env, component, y, x] = real(whole)
        out[y, x] = true
        return wp.vec2d(largest, changed)

    @wp.func
    def forget(memory: memory_struct, env: int, component: int, y: int, x: int):
        n = memory.shares.shape[0]
        memory.whole[env, component, y, x] = real(0.0)
        for k in range(n):
            memory.kept[env, component * n + k, y, x] = f64(0.0)

    @wp.func
    def note_holds(memory: memory_struct, state: friction_state, env: int, thread: int):
        """Keep the places where friction holds the surface, with the displacement by memory; those of cells that stick
        are advanced by their slide alone, so that slow motion of the surface is not lost in rounding."""
        box = state.box[env]
        old = memory.held[env]
        mine = spread(wp.max(box[3], 1), thread)
        for y in range(box[0] + mine[0], wp.min(box[0] + box[2], memory.u.shape[1]), mine[1]):
            for x in range(box[1] + mine[2], wp.min(box[1] + box[3], memory.u.shape[2]), mine[3]):
                u = f64(memory.u[env, y, x])
                v = f64(memory.v[env, y, x])
                to_x = f64(state.anchor_x[env, y, x])
                to_y = f64(state.anchor_y[env, y, x])
                from_x = u
                from_y = v
                if state.held_by[env, y, x] > 0 and within(y, x, old):
                    from_x = memory.held_x[env, y, x]
                    from_y = memory.held_y[env, y, x]
                    to_x -= f64(real(from_x - u))
                    to_y -= f64(real(from_y - v))
                memory.held_x[env, y, x] = from_x + to_x
                memory.held_y[env, y, x] = from_y + to_y
        block_sync()

    @warp_kernel(launch_bounds=BLOCK)
    def remember(turns: wp.vec4i, memory: memory_struct, pressed: pressed_struct, state: friction_state):
        place, thread = wp.tid()
        for env in range(turns[0] + place, turns[1], turns[3]):
            both = around(memory.box[env], pressed.box[env])
            rows = memory.whole.shape[2]
            columns = memory.whole.shape[3]
            floor = f64(FORGOTTEN) * memory.peak[env]
            peak = f64(0.0)
            changed = f64(0.0)
            top = rows
            left = columns
            bottom = int(-1)
            right = int(-1)
            mine = spread(wp.max(both[3], 1), thread)
            for y in range(both[0] + mine[0], wp.min(both[0] + both[2], rows), mine[1]):
                for x in range(both[1] + mine[2], wp.min(both[1] + both[3], columns), mine[3]):
                    z = pressed.pressure[env, y, x]
                    cell = keep(memory, env, PRESSURE, y, x, z, memory.pressure[env])
                    largest = cell[0]
                    changed += cell[1]
                    if wp.static(with_friction):
                        cell = keep(memory, env, ALONG_X, y, x, state.x[env, y, x], memory.x[env])
                        largest = wp.max(largest, cell[0])
                        changed += cell[1]
                        cell = keep(memory, env, ALONG_Y, y, x, state.y[env, y, x], memory.y[env])
                        largest = wp.max(largest, cell[0])
                        changed += cell[1]
                    if z > real(0.0) or largest > floor:
                        peak = wp.max(peak, largest)
                        top = wp.min(top, y)
                        left = wp.min(left, x)
                        bottom = wp.max(bottom, y)
                        right = wp.max(right, x)
                    elif largest > f64(0.0):
                        changed += f64(1.0)
                        for component in range(wp.static(3 if with_friction else 1)):
                            forget(memory, env, component, y, x)
            peak = block_max(peak)
            changed = block_sum(changed)
            top = -int(block_max(f64(-top)))
            left = -int(block_max(f64(-left)))
            bottom = int(block_max(f64(bottom)))
            right = int(block_max(f64(right)))
            if wp.static(with_friction):
                note_holds(memory, state, env, thread)
            if thread == 0:
                memory.box[env] = window_around(top, left, bottom, right, rows, columns)
                memory.peak[env] = wp.max(memory.peak[env], peak)
                if wp.static(with_friction):
                    memory.held[env] = state.box[env]
                if changed > f64(0.0):
                    pressed.changed[env] = 1
                    pressed.dirty[env] = around(pressed.dirty[env], both)
                    if wp.static(with_friction):
                        state.changed[env] = 1
            block_sync()

    return remember
