"""The operations of :mod:`.pressure` on each cell between convolutions, on a CPU, eight cells at a time."""

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.layer.block import Window
from tactemu.sensors.layer.cells_simd import over_cells


class PressureCells(NamedTuple):
    """The Warp functions on all cells of a window. Sums are over all of them, whichever thread calls."""

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
def simd_pressure_cells(real, windows) -> PressureCells:
    """Return the functions for one float type and the struct of its windows, whose rows are multiples of a register."""

    @wp.func_native(over_cells(real, "pressure", _MASK_GAP))
    def mask_gap(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(over_cells(real, "pressure", _PRODUCTS))
    def products(win: windows, at: Window, fresh: bool) -> wp.vec2d: ...

    @wp.func_native(over_cells(real, "pressure", _DIRECT))
    def direct(win: windows, at: Window, beta: real, fresh: bool) -> wp.float64: ...

    @wp.func_native(over_cells(real, "pressure", _CURVATURE))
    def curvature(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(over_cells(real, "pressure", _ADVANCE))
    def advance(win: windows, at: Window, step: real) -> wp.float64: ...

    return PressureCells(mask_gap, products, direct, curvature, advance)


_MASK_GAP = """
    Doubles total = {};
    all([&](int64_t at) {
        const Vector g = get(win.gap.data + at), p = get(win.pressure.data + at);
        const Vector m = ((p > 0) | (g < 0)) ? g : Vector{};
        put(win.masked.data + at, m);
        total += doubles(m) * doubles(m);
    });
    return sum(total);
"""

_PRODUCTS = """
    Doubles square = {}, change = {};
    all([&](int64_t at) {
        const Vector m = get(win.masked.data + at), answer = get(win.answer.data + at);
        const Doubles z = doubles(get(win.softened.data + at));
        square += doubles(m) * z;
        if (!fresh)
            change += z * doubles(m != 0 ? answer : Vector{});
    });
    return wp::vec_t<2, double>(sum(square), sum(change));
"""

_DIRECT = """
    Doubles slope = {};
    all([&](int64_t at) {
        const Vector m = get(win.masked.data + at);
        Vector d = -get(win.softened.data + at);
        if (!fresh)
            d += beta * get(win.direction.data + at);
        d = m != 0 ? d : Vector{};
        put(win.direction.data + at, d);
        slope += doubles(m) * doubles(d);
    });
    return sum(slope);
"""

_CURVATURE = """
    Doubles total = {};
    all([&](int64_t at) {
        total += doubles(get(win.direction.data + at)) * doubles(get(win.answer.data + at));
    });
    return sum(total);
"""

_ADVANCE = """
    Doubles pulled = {};
    all([&](int64_t at) {
        const Vector p = get(win.pressure.data + at) + step * get(win.direction.data + at);
        put(win.pressure.data + at, p < 0 ? Vector{} : p);
        put(win.gap.data + at, get(win.gap.data + at) + step * get(win.answer.data + at));
        pulled += doubles(p < 0 ? Vector{} + 1 : Vector{});
    });
    return sum(pulled);
"""
