"""The stage before the contact of a layer that relaxes: overlaps less the displacement by memory (:mod:`.memory`)."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.imperfections.material import decay, ramp_share
from tactemu.plan.clock import Clock
from tactemu.sensors.layer.block import BLOCK, Block, block_sync, spread
from tactemu.sensors.layer.convolution import convolution_functions, workspace_type
from tactemu.sensors.layer.friction_state import friction_state_type
from tactemu.sensors.layer.memory import (
    ALONG_X,
    ALONG_Y,
    PRESSURE,
    memory_type,
    share_of_step,
    term,
    window_around,
    within,
)
from tactemu.sensors.layer.overlap import overlap_type
from tactemu.sensors.layer.pressure import windows_type
from tactemu.sensors.layer.shared_memory import shared_functions, shared_numbers
from tactemu.sensors.layer.tables import layer_type
from tactemu.sensors.layer.tangential_compliance import tangential_functions
from tactemu.sensors.layer.window import around, block_functions, open_window

SHARED_MEMORY_BLOCK = Block(128, 2)
"""Block of threads for solving in shared memory."""
SHARED_ARRAYS = (3, 2)
"""Numbers of spectra and of windows in shared memory."""
UNSOLVED = 1e30
"""Residual of a friction whose surface has moved by memory."""


@functools.cache
def recall_kernel(real, lanes: int, with_friction: bool, coupled: bool, is_shared: bool):
    """Return the kernel that computes the overlap less the displacement by memory, and moves the places where friction
    holds the surface against it; one block of threads per slot."""
    layer_struct, overlap_struct, windows = layer_type(real), overlap_type(real), windows_type(real)
    memory_struct, friction_state = memory_type(real), friction_state_type(real)
    functions = convolution_functions(real, lanes, is_shared)
    forward, scale, inverse = functions.forward, functions.scale, functions.inverse
    tangential_compliance = tangential_functions(real, lanes, is_shared)
    displace, mix = tangential_compliance.displace, tangential_compliance.mix
    shared_workspace, window = shared_functions(real, workspace_type(real), *SHARED_ARRAYS)
    block_sum, _max = block_functions(lanes)
    grid, f64 = wp.array2d(dtype=real), wp.float64

    @wp.func
    def weigh(memory: memory_struct, env: int, dt: wp.float64):
        """Compute the weights of this step."""
        for k in range(memory.shares.shape[0]):
            memory.decays[env, k] = decay(dt, memory.times[k])
            memory.growths[env, k] = ramp_share(dt / memory.times[k])
        memory.scale[env] = share_of_step(memory, dt)

    @wp.func
    def fetch(memory: memory_struct, env: int, component: int, box: wp.vec4i, window: grid, mine: wp.vec4i):
        """Fetch ``h`` in a box."""
        n = memory.shares.shape[0]
        for y in range(mine[0], box[2], mine[1]):
            for x in range(mine[2], box[3], mine[3]):
                h = f64(0.0)
                gy = box[0] + y
                gx = box[1] + x
                if gy < memory.whole.shape[2] and gx < memory.whole.shape[3]:
                    before = f64(memory.whole[env, component, gy, gx])
                    for k in range(n):
                        h += term(memory, env, k, before, memory.kept[env, component * n + k, gy, gx])
                window[y, x] = real(h / memory.scale[env])
        block_sync()

    @wp.func
    def lower(overlap: grid, active: wp.vec4i, moved: grid, area: wp.vec4i, out: grid, thread: int):
        """Write the overlaps of the active cells, less the displacement in the area."""
        mine = spread(wp.max(active[3] - active[1], 1), thread)
        for y in range(active[0] + mine[0], active[2], mine[1]):
            for x in range(active[1] + mine[2], active[3], mine[3]):
                o = overlap[y, x]
                if area[3] > 0:
                    o -= moved[y - area[0], x - area[1]]
                out[y, x] = o
        block_sync()

    @wp.func
    def shift(moved: grid, area: wp.vec4i, old: wp.vec4i, out: grid, thread: int):
        """Write a displacement along the surface, 0 outside the area; return the number of cells that it changes."""
        both = around(area, old)
        mine = spread(wp.max(both[3], 1), thread)
        changed = f64(0.0)
        for y in range(both[0] + mine[0], wp.min(both[0] + both[2], out.shape[0]), mine[1]):
            for x in range(both[1] + mine[2], wp.min(both[1] + both[3], out.shape[1]), mine[3]):
                value = real(0.0)
                if within(y, x, area):
                    value = moved[y - area[0], x - area[1]]
                if value != out[y, x]:
                    changed += f64(1.0)
                    out[y, x] = value
        changed = block_sum(changed)
        block_sync()
        return changed

    @wp.func
    def hold(memory: memory_struct, state: friction_state, env: int, thread: int):
        """Give friction the places where it holds the surface, less the displacement by memory."""
        box = state.box[env]
        mine = spread(wp.max(box[3], 1), thread)
        for y in range(box[0] + mine[0], wp.min(box[0] + box[2], memory.u.shape[1]), mine[1]):
            for x in range(box[1] + mine[2], wp.min(box[1] + box[3], memory.u.shape[2]), mine[3]):
                state.anchor_x[env, y, x] = real(memory.held_x[env, y, x] - f64(memory.u[env, y, x]))
                state.anchor_y[env, y, x] = real(memory.held_y[env, y, x] - f64(memory.v[env, y, x]))
        block_sync()

    @warp_kernel(launch_bounds=SHARED_MEMORY_BLOCK if is_shared else BLOCK)
    def recall(
        turns: wp.vec4i,
        layer: layer_struct,
        clock: Clock,
        over: overlap_struct,
        win: windows,
        memory: memory_struct,
        state: friction_state,
    ):
        place, thread = wp.tid()
        slot = turns[2] + place
        if wp.static(is_shared):
            tile = wp.tile_empty(shape=(wp.static(shared_numbers(*SHARED_ARRAYS)),), dtype=real, storage="shared")
            win.ws = shared_workspace(win.ws, tile)
            win.direction = window(tile, 0)
            win.answer = window(tile, 1)
        answer = win.answer[slot]
        direction = win.direction[slot]
        for env in range(turns[0] + place, turns[1], turns[3]):
            if thread == 0:
                weigh(memory, env, clock.dt[0])
            block_sync()
            box = memory.box[env]
            active = over.active[env]
            area = wp.vec4i(0, 0, 0, 0)
            if box[3] > 0:
                area = window_around(
                    active[0], active[1], active[2] - 1, active[3] - 1, memory.whole.shape[2], memory.whole.shape[3]
                )
            changed = f64(0.0)
            if area[3] > 0:
                first = wp.vec2i(area[0] - box[0], area[1] - box[1])
                # Offsets from any kept cell to any cell of the area must not wrap.
                span = wp.vec2i(
                    wp.max(box[2] - first[0], first[0] + area[2]), wp.max(box[3] - first[1], first[1] + area[3])
                )
                at = open_window(wp.vec2i(box[2], box[3]), span, layer.tables.start, slot, thread)
                pressures = win.ws.spectrum[slot]
                along_x = win.ws.second[slot]
                along_y = win.ws.third[slot]
                if wp.static(with_friction and coupled):
                    fetch(memory, env, PRESSURE, box, direction, at.mine)
                    forward(win.ws, at, direction, pressures)
                    fetch(memory, env, ALONG_X, box, direction, at.mine)
                    forward(win.ws, at, direction, along_x)
                    fetch(memory, env, ALONG_Y, box, direction, at.mine)
                    forward(win.ws, at, direction, along_y)
                    displace(win.ws, at, layer.tables, True)
                    at.shape = wp.vec2i(area[2], area[3])
                    at.first = first
                    inverse(win.ws, at, along_x, answer)
                    changed += shift(answer, area, memory.area[env], memory.u[env], thread)
                    inverse(win.ws, at, along_y, answer)
                    changed += shift(answer, area, memory.area[env], memory.v[env], thread)
                elif wp.static(with_friction):
                    fetch(memory, env, ALONG_X, box, direction, at.mine)
                    forward(win.ws, at, direction, pressures)
                    fetch(memory, env, ALONG_Y, box, direction, at.mine)
                    forward(win.ws, at, direction, along_x)
                    mix(win.ws, at, layer.tables)
                    at.shape = wp.vec2i(area[2], area[3])
                    at.first = first
                    inverse(win.ws, at, pressures, answer)
                    changed += shift(answer, area, memory.area[env], memory.u[env], thread)
                    inverse(win.ws, at, along_x, answer)
                    changed += shift(answer, area, memory.area[env], memory.v[env], thread)
                if wp.static(not (with_friction and coupled)):
                    at.shape = wp.vec2i(box[2], box[3])
                    at.first = wp.vec2i(0, 0)
                    fetch(memory, env, PRESSURE, box, direction, at.mine)
                    forward(win.ws, at, direction, pressures)
                    scale(at, pressures, layer.tables.nn)
                    at.shape = wp.vec2i(area[2], area[3])
                    at.first = first
                inverse(win.ws, at, pressures, answer)
            elif wp.static(with_friction):
                changed += shift(answer, area, memory.area[env], memory.u[env], thread)
                changed += shift(answer, area, memory.area[env], memory.v[env], thread)
            lower(over.overlap[env], active, answer, area, memory.overlap[env], thread)
            if wp.static(with_friction):
                hold(memory, state, env, thread)
                if thread == 0:
                    memory.area[env] = area
                    if changed > f64(0.0):
                        state.residual[env] = f64(UNSOLVED)
            block_sync()

    return recall
