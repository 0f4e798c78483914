"""The operations of the pressure solver on each cell of a window, between its convolutions (:mod:`.pressure`)."""

# pyright: reportGeneralTypeIssues=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.layer.block import Window
from tactemu.sensors.layer.cells import over_cells


class PressureCells(NamedTuple):
    """The Warp functions on the calling thread's cells of a window ``at``. A result is that thread's part of a sum: the
    caller adds up the block's (:func:`.window.block_functions`), which also shows all threads what each has written."""

    mask_gap: Any
    """``mask_gap(win, at) -> float64``"""
    products: Any
    """``products(win, at, fresh) -> vec2d``"""
    direct: Any
    """``direct(win, at, beta, fresh) -> float64``"""
    curvature: Any
    """``curvature(win, at) -> float64``"""
    advance: Any
    """``advance(win, at, step) -> float64``"""


@functools.cache
def pressure_cells(real, windows, lanes: int, is_shared: bool) -> PressureCells:
    """Return the functions for one float type and lane width, and the struct of the windows."""

    @wp.func_native(over_cells(real, lanes, is_shared, "pressure", _MASK_GAP))
    def mask_gap(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(over_cells(real, lanes, is_shared, "pressure", _PRODUCTS))
    def products(win: windows, at: Window, fresh: bool) -> wp.vec2d: ...

    @wp.func_native(over_cells(real, lanes, is_shared, "pressure", _DIRECT))
    def direct(win: windows, at: Window, beta: real, fresh: bool) -> wp.float64: ...

    @wp.func_native(over_cells(real, lanes, is_shared, "pressure", _CURVATURE))
    def curvature(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(over_cells(real, lanes, is_shared, "pressure", _ADVANCE))
    def advance(win: windows, at: Window, step: real) -> wp.float64: ...

    return PressureCells(mask_gap, products, direct, curvature, advance)


_MASK_GAP = """
    Doubles total = {};
    all([&](const auto& cell) {
        const Vector g = load(win.gap, cell), p = load(win.pressure, cell);
        const Vector m = ((p > 0) | (g < 0)) ? g : Vector{};
        store(win.masked, cell, m);
        total += doubles(m) * doubles(m);
    });
    return sum(total);
"""

_PRODUCTS = """
    Doubles square = {}, change = {};
    all([&](const auto& cell) {
        const Vector m = load(win.masked, cell), answer = load(win.answer, cell);
        const Doubles z = doubles(load(win.softened, cell));
        square += doubles(m) * z;
        if (!fresh)
            change += z * doubles(m != 0 ? answer : Vector{});
    });
    return wp::vec_t<2, double>(sum(square), sum(change));
"""

_DIRECT = """
    Doubles slope = {};
    all([&](const auto& cell) {
        const Vector m = load(win.masked, cell);
        const Vector z = -load(win.softened, cell);
        const Vector turned = fresh ? z : fused(beta, load(win.direction, cell), z), d = m != 0 ? turned : Vector{};
        store(win.direction, cell, d);
        slope += doubles(m) * doubles(d);
    });
    return sum(slope);
"""

_CURVATURE = """
    Doubles total = {};
    all([&](const auto& cell) {
        total += doubles(load(win.direction, cell)) * doubles(load(win.answer, cell));
    });
    return sum(total);
"""

_ADVANCE = """
    Doubles pulled = {};
    all([&](const auto& cell) {
        const Vector p = load(win.pressure, cell) + step * load(win.direction, cell);
        store(win.pressure, cell, p < 0 ? Vector{} : p);
        store(win.gap, cell, load(win.gap, cell) + step * load(win.answer, cell));
        pulled += doubles(p < 0 ? Vector{} + 1 : Vector{});
    });
    return sum(pulled);
"""
