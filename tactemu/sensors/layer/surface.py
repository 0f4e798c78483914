"""The displacement of the layer's surface by pressure and traction, out to where it is negligible."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.sensors.layer.block import BLOCK, Block, Window, block_sync, spread
from tactemu.sensors.layer.compliance import Kernels
from tactemu.sensors.layer.convolution import convolution_functions
from tactemu.sensors.layer.friction_state import friction_state_type
from tactemu.sensors.layer.pair_convolution import pair_functions
from tactemu.sensors.layer.pressure import pressure_state_type, windows_type
from tactemu.sensors.layer.shared_memory import complex_memory, complex_numbers
from tactemu.sensors.layer.single_convolution import single_convolution
from tactemu.sensors.layer.tables import layer_type
from tactemu.sensors.layer.tangential_compliance import tangential_functions
from tactemu.sensors.layer.window import BOX_STEP, around, open_window, wipe_function

SHARED_MEMORY_BLOCK = Block(128, 4)
"""Block of threads for solving in shared memory."""
SHARED_WINDOWS = 4
"""Number of windows in shared memory."""
NEGLIGIBLE = 1e-5
"""Fraction of the response at the load below which a response is left out."""


def response_reach(kernels: Kernels) -> tuple[int, int]:
    """Return the number of cells over which a load moves the surface, along rows and columns; at most the grid's
    size."""
    strength = np.maximum(np.abs(kernels.nn), np.hypot(kernels.nx, kernels.ny)) / kernels.nn[0, 0]
    is_strong = strength > NEGLIGIBLE
    rows, columns = (int(np.flatnonzero(is_strong.any(axis=1 - axis)).max()) + 1 for axis in range(2))
    return rows, columns


@functools.cache
def surface_type(real):
    """Return the Warp struct of the surface's displacement [pitches], ``(n_envs, rows, columns)``."""

    @wp.struct
    class Surface:
        area: wp.array(dtype=wp.vec4i)  # window in which it moves, per environment
        u: wp.array3d(dtype=real)
        v: wp.array3d(dtype=real)
        w: wp.array3d(dtype=real)  # into the skin

    return Surface


@functools.cache
def surface_kernel(real, lanes: int, with_friction: bool, is_shared: bool):
    """Return the kernel that computes the displacement [pitches] of every cell in reach: along u, along v, and into the
    skin."""
    layer_struct, pressed_struct, surface_struct = layer_type(real), pressure_state_type(real), surface_type(real)
    windows, friction_state = windows_type(real), friction_state_type(real)
    functions = convolution_functions(real, lanes, False)
    tangential_compliance = tangential_functions(real, lanes, False)
    forward, inverse, displace = functions.forward, functions.inverse, tangential_compliance.displace
    complex_field, window = complex_memory(real, SHARED_WINDOWS)
    convolve, pairs = single_convolution(real), pair_functions(real)
    by_pressure, by_traction = pairs.by_pressure, pairs.by_traction
    grid, wipe = wp.array2d(dtype=real), wipe_function(real)

    @wp.func
    def fetch(source: grid, box: wp.vec4i, window: grid, mine: wp.vec4i):
        for y in range(mine[0], box[2], mine[1]):
            for x in range(mine[2], box[3], mine[3]):
                value = real(0.0)
                if box[0] + y < source.shape[0] and box[1] + x < source.shape[1]:
                    value = source[box[0] + y, box[1] + x]
                window[y, x] = value
        block_sync()

    @wp.func
    def deposit(window: grid, area: wp.vec4i, out: grid, thread: int):
        mine = spread(area[3], thread)
        for y in range(mine[0], wp.min(area[2], out.shape[0] - area[0]), mine[1]):
            for x in range(mine[2], wp.min(area[3], out.shape[1] - area[1]), mine[3]):
                out[area[0] + y, area[1] + x] = window[y, x]
        block_sync()

    @wp.func
    def widen(first: int, length: int, reach: int, cells: int):
        """Return the first cell and length of a box with its reach, within the grid; lengths are multiples of
        ``BOX_STEP``."""
        begin = wp.max(0, first - reach)
        end = wp.min(cells, first + length + reach)
        steps = (end - begin + wp.static(BOX_STEP - 1)) // wp.static(BOX_STEP)
        return wp.vec2i(begin, steps * wp.static(BOX_STEP))

    @wp.func
    def displace_global(
        layer: layer_struct,
        pressed: pressed_struct,
        friction: friction_state,
        win: windows,
        at: Window,
        env: int,
        area: wp.vec4i,
        first: wp.vec2i,
        state: surface_struct,
    ):
        """Compute the displacement of an area, by the transforms of three fields."""
        box = pressed.box[env]
        answer = win.answer[at.slot]
        direction = win.direction[at.slot]
        first_numbers = win.ws.spectrum[at.slot]
        second_numbers = win.ws.second[at.slot]
        third_numbers = win.ws.third[at.slot]
        fetch(pressed.pressure[env], box, direction, at.mine)
        forward(win.ws, at, direction, first_numbers)
        if wp.static(with_friction):
            fetch(friction.x[env], box, direction, at.mine)
            forward(win.ws, at, direction, second_numbers)
            fetch(friction.y[env], box, direction, at.mine)
            forward(win.ws, at, direction, third_numbers)
        displace(win.ws, at, layer.tables, wp.static(with_friction))
        at.shape = wp.vec2i(area[2], area[3])
        at.first = first
        inverse(win.ws, at, second_numbers, answer)
        deposit(answer, area, state.u[env], at.thread)
        inverse(win.ws, at, third_numbers, answer)
        deposit(answer, area, state.v[env], at.thread)
        inverse(win.ws, at, first_numbers, answer)
        deposit(answer, area, state.w[env], at.thread)

    @wp.func
    def displace_shared(
        layer: layer_struct,
        pressed: pressed_struct,
        friction: friction_state,
        win: windows,
        at: Window,
        env: int,
        area: wp.vec4i,
        first: wp.vec2i,
        state: surface_struct,
    ):
        """Compute the displacement of an area in the block's shared memory."""
        box = pressed.box[env]
        shape = wp.vec2i(area[2], area[3])
        x = win.direction[at.slot]
        y = win.answer[at.slot]
        out_x = win.masked[at.slot]
        out_y = win.softened[at.slot]
        at.first = first
        fetch(pressed.pressure[env], box, x, at.mine)
        convolve(win.ws, at, x, layer.tables.nn, out_x, shape)
        deposit(out_x, area, state.w[env], at.thread)
        by_pressure(win.ws, at, layer.tables, x, out_x, out_y, shape)
        if wp.static(with_friction):
            fetch(friction.x[env], box, x, at.mine)
            fetch(friction.y[env], box, y, at.mine)
            by_traction(win.ws, at, layer.tables, x, y, out_x, out_y, shape, True)
        deposit(out_x, area, state.u[env], at.thread)
        deposit(out_y, area, state.v[env], at.thread)

    @warp_kernel(launch_bounds=SHARED_MEMORY_BLOCK if is_shared else BLOCK)
    def find_surface(
        turns: wp.vec4i,
        layer: layer_struct,
        pressed: pressed_struct,
        friction: friction_state,
        win: windows,
        state: surface_struct,
    ):
        place, thread = wp.tid()
        slot = turns[2] + place
        if wp.static(is_shared):
            memory = wp.tile_empty(shape=(wp.static(complex_numbers(SHARED_WINDOWS)),), dtype=real, storage="shared")
            win.ws.spectrum = complex_field(memory)
            win.direction = window(memory, 0)
            win.answer = window(memory, 1)
            win.masked = window(memory, 2)
            win.softened = window(memory, 3)
        for env in range(turns[0] + place, turns[1], turns[3]):
            changed = pressed.changed[env]
            if wp.static(with_friction):
                changed = friction.changed[env]
            if changed > 0:
                box = pressed.box[env]
                old = state.area[env]
                wipe(old, state.u[env], thread)
                wipe(old, state.v[env], thread)
                wipe(old, state.w[env], thread)
                area = wp.vec4i(0, 0, 0, 0)
                if box[3] > 0:
                    down = widen(box[0], box[2], layer.reach[0], pressed.pressure.shape[1])
                    along = widen(box[1], box[3], layer.reach[1], pressed.pressure.shape[2])
                    area = wp.vec4i(down[0], along[0], down[1], along[1])
                    first = wp.vec2i(area[0] - box[0], area[1] - box[1])
                    # Offsets from any loaded cell to any cell of the area must not wrap.
                    span = wp.vec2i(
                        wp.max(box[2] - first[0], first[0] + area[2]), wp.max(box[3] - first[1], first[1] + area[3])
                    )
                    at = open_window(wp.vec2i(box[2], box[3]), span, layer.tables.start, slot, thread)
                    if wp.static(is_shared):
                        displace_shared(layer, pressed, friction, win, at, env, area, first, state)
                    else:
                        displace_global(layer, pressed, friction, win, at, env, area, first, state)
                block_sync()
                if thread == 0:
                    pressed.dirty[env] = around(pressed.dirty[env], around(area, old))
                    state.area[env] = area
                block_sync()

    return find_surface
