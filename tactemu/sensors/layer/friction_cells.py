"""The operations of the friction solver on each cell of a window, between its convolutions (:mod:`.friction`)."""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
from typing import Any

import warp as wp

from tactemu.sensors.layer.block import Window, block_sync
from tactemu.sensors.layer.friction_simd import FrictionCells, simd_friction_cells
from tactemu.sensors.layer.friction_state import SLIP_FRACTION, friction_windows_type
from tactemu.sensors.layer.window import block_functions


@wp.func
def square(a: Any, b: Any):
    """Return the squared length of ``(a, b)``."""
    return wp.float64(a) * wp.float64(a) + wp.float64(b) * wp.float64(b)


@functools.cache
def friction_cells(real, lanes: int) -> FrictionCells:
    """Return the operations on each cell between convolutions; on a CPU those in vector registers
    (:mod:`.friction_simd`)."""
    if lanes > 1:
        return simd_friction_cells(real)
    windows, vec2 = friction_windows_type(real), wp.types.vector(2, real)
    block_sum, _max = block_functions(lanes)

    @wp.func
    def norm(win: windows, at: Window):
        """Turn the displacement by traction into the gap; return the sum of squared displacements where cells touch."""
        total = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                ux = win.gap_x[at.slot, y, x] + win.by_pressure_x[at.slot, y, x]
                uy = win.gap_y[at.slot, y, x] + win.by_pressure_y[at.slot, y, x]
                if win.limit[at.slot, y, x] > real(0.0):
                    total += square(ux, uy)
                win.gap_x[at.slot, y, x] = ux - win.hold_x[at.slot, y, x]
                win.gap_y[at.slot, y, x] = uy - win.hold_y[at.slot, y, x]
        return block_sum(total)

    @wp.func
    def free_gap(win: windows, at: Window):
        """Compute the part of the gap that tractions can close, and the stiffness of the circles; return its square."""
        total = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                limit = win.limit[at.slot, y, x]
                g = vec2(real(0.0))
                stiff = real(0.0)
                if limit > real(0.0):
                    g = vec2(win.gap_x[at.slot, y, x], win.gap_y[at.slot, y, x])
                    q = vec2(win.x[at.slot, y, x], win.y[at.slot, y, x])
                    outward = wp.dot(g, q) / limit
                    if wp.length(q) >= real(SLIP_FRACTION) * limit and outward < real(0.0):
                        n = q / wp.length(q)
                        g = g - wp.dot(g, n) * n
                        stiff = -outward / limit
                weight = real(1.0) / wp.sqrt(real(1.0) + stiff)
                win.last_x[at.slot, y, x] = win.free_x[at.slot, y, x]
                win.last_y[at.slot, y, x] = win.free_y[at.slot, y, x]
                win.free_x[at.slot, y, x] = weight * g[0]
                win.free_y[at.slot, y, x] = weight * g[1]
                win.stiffness[at.slot, y, x] = stiff
                total += square(weight * weight * g[0], weight * weight * g[1])
        total = block_sum(total)
        block_sync()
        return total

    @wp.func
    def products(win: windows, at: Window):
        """Return the products of the preconditioned gap with the gap, and with its change since the last iteration."""
        now = wp.float64(0.0)
        change = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                z = vec2(win.softened_x[at.slot, y, x], win.softened_y[at.slot, y, x])
                m = vec2(win.free_x[at.slot, y, x], win.free_y[at.slot, y, x])
                old = vec2(win.last_x[at.slot, y, x], win.last_y[at.slot, y, x])
                now += wp.float64(wp.dot(m, z))
                change += wp.float64(wp.dot(m - old, z))
        return wp.vec2d(block_sum(now), block_sum(change))

    @wp.func
    def direct(win: windows, at: Window, beta: real, fresh: bool):
        """Compute the search direction, along the circles where cells slip, and add a part of the last unless
        ``fresh``; return the slope along it."""
        slope = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                d = vec2(real(0.0))
                if win.limit[at.slot, y, x] > real(0.0):
                    stiff = win.stiffness[at.slot, y, x]
                    weight = real(1.0) / wp.sqrt(real(1.0) + stiff)
                    d = -weight * vec2(win.softened_x[at.slot, y, x], win.softened_y[at.slot, y, x])
                    if not fresh:
                        d += beta * vec2(win.along_x[at.slot, y, x], win.along_y[at.slot, y, x])
                    if stiff > real(0.0):
                        n = wp.normalize(vec2(win.x[at.slot, y, x], win.y[at.slot, y, x]))
                        d = d - wp.dot(d, n) * n
                    m = vec2(win.free_x[at.slot, y, x], win.free_y[at.slot, y, x]) / weight
                    slope += wp.float64(wp.dot(m, d))
                win.along_x[at.slot, y, x] = d[0]
                win.along_y[at.slot, y, x] = d[1]
        slope = block_sum(slope)
        block_sync()
        return slope

    @wp.func
    def curvature(win: windows, at: Window):
        total = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                d = vec2(win.along_x[at.slot, y, x], win.along_y[at.slot, y, x])
                a = vec2(win.answer_x[at.slot, y, x], win.answer_y[at.slot, y, x])
                total += wp.float64(wp.dot(d, a + win.stiffness[at.slot, y, x] * d))
        return block_sum(total)

    @wp.func
    def advance(win: windows, at: Window, step: real):
        """Take a step along the direction, and project back to the discs; return the number of cells that left them."""
        cut = wp.float64(0.0)
        for y in range(at.mine[0], at.shape[0], at.mine[1]):
            for x in range(at.mine[2], at.shape[1], at.mine[3]):
                limit = win.limit[at.slot, y, x]
                if limit > real(0.0):
                    d = vec2(win.along_x[at.slot, y, x], win.along_y[at.slot, y, x])
                    q = vec2(win.x[at.slot, y, x], win.y[at.slot, y, x]) + step * d
                    length = wp.length(q)
                    if length > limit:
                        q = q * (limit / length)
                        if length > real(1.000001) * limit:
                            cut += wp.float64(1.0)
                    win.x[at.slot, y, x] = q[0]
                    win.y[at.slot, y, x] = q[1]
                win.gap_x[at.slot, y, x] = win.gap_x[at.slot, y, x] + step * win.answer_x[at.slot, y, x]
                win.gap_y[at.slot, y, x] = win.gap_y[at.slot, y, x] + step * win.answer_y[at.slot, y, x]
        cut = block_sum(cut)
        block_sync()
        return cut

    return FrictionCells(norm, free_gap, products, direct, curvature, advance)
