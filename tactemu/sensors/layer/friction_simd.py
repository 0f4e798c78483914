"""The operations of :mod:`.friction_cells` on a CPU, eight cells at a time.

The formulas are those of :mod:`.friction_cells`, which explains them. Values that a cell does not need (a circle, where
it sticks) are computed for all eight and discarded.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.layer.block import Window
from tactemu.sensors.layer.cells_simd import over_cells
from tactemu.sensors.layer.friction_state import SLIP_FRACTION, friction_windows_type


class FrictionCells(NamedTuple):
    """The Warp functions on all cells of a window. Sums are over all of them, whichever thread calls."""

    norm: Any
    """``norm(win, at) -> float64``"""
    free_gap: Any
    """``free_gap(win, at) -> float64``"""
    products: Any
    """``products(win, at) -> vec2d``"""
    direct: Any
    """``direct(win, at, beta, fresh) -> float64``"""
    curvature: Any
    """``curvature(win, at) -> float64``"""
    advance: Any
    """``advance(win, at, step) -> float64``"""


@functools.cache
def simd_friction_cells(real) -> FrictionCells:
    """Return the functions for one float type; rows of windows are multiples of a register."""
    windows = friction_windows_type(real)

    @wp.func_native(_cells(real, _NORM))
    def norm(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(_cells(real, _FREE_GAP))
    def free_gap(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(_cells(real, _PRODUCTS))
    def products(win: windows, at: Window) -> wp.vec2d: ...

    @wp.func_native(_cells(real, _DIRECT))
    def direct(win: windows, at: Window, beta: real, fresh: bool) -> wp.float64: ...

    @wp.func_native(_cells(real, _CURVATURE))
    def curvature(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(_cells(real, _ADVANCE))
    def advance(win: windows, at: Window, step: real) -> wp.float64: ...

    return FrictionCells(norm, free_gap, products, direct, curvature, advance)


def _cells(real, each: str) -> str:
    return over_cells(real, "limit", _PAIRS + each.replace("SLIP_FRACTION", f"Number({SLIP_FRACTION})"))


_PAIRS = """
    struct Pair { Vector x, y; };
    auto pair = [&](const auto& x, const auto& y, int64_t at) { return Pair{get(x.data + at), get(y.data + at)}; };
    auto dot = [](const Pair& a, const Pair& b) { return a.x * b.x + a.y * b.y; };
    auto root = [](const Vector& v) { return __builtin_elementwise_sqrt(v); };
"""

_NORM = """
    Doubles total = {};
    all([&](int64_t at) {
        const Pair pulled = pair(win.gap_x, win.gap_y, at), pressed = pair(win.by_pressure_x, win.by_pressure_y, at);
        const Pair u = {pulled.x + pressed.x, pulled.y + pressed.y}, hold = pair(win.hold_x, win.hold_y, at);
        put(win.gap_x.data + at, u.x - hold.x);
        put(win.gap_y.data + at, u.y - hold.y);
        const auto touches = get(win.limit.data + at) > 0;
        const Doubles x = doubles(touches ? u.x : Vector{}), y = doubles(touches ? u.y : Vector{});
        total += x * x + y * y;
    });
    return sum(total);
"""

_FREE_GAP = """
    Doubles total = {};
    all([&](int64_t at) {
        const Vector limit = get(win.limit.data + at);
        const auto touches = limit > 0;
        Pair g = pair(win.gap_x, win.gap_y, at);
        g.x = touches ? g.x : Vector{}, g.y = touches ? g.y : Vector{};
        const Pair q = pair(win.x, win.y, at);
        const Vector length = root(dot(q, q)), outward = dot(g, q) / limit;
        const auto slips = touches & (length >= SLIP_FRACTION * limit) & (outward < 0);
        const Pair n = {q.x / length, q.y / length};
        const Vector along = dot(g, n);
        g.x = slips ? g.x - along * n.x : g.x, g.y = slips ? g.y - along * n.y : g.y;
        const Vector stiff = slips ? -outward / limit : Vector{};
        const Vector weight = 1 / root(1 + stiff);
        put(win.last_x.data + at, get(win.free_x.data + at));
        put(win.last_y.data + at, get(win.free_y.data + at));
        put(win.free_x.data + at, weight * g.x);
        put(win.free_y.data + at, weight * g.y);
        put(win.stiffness.data + at, stiff);
        const Doubles x = doubles(weight * weight * g.x), y = doubles(weight * weight * g.y);
        total += x * x + y * y;
    });
    return sum(total);
"""

_PRODUCTS = """
    Doubles now = {}, change = {};
    all([&](int64_t at) {
        const Pair z = pair(win.softened_x, win.softened_y, at);
        const Pair m = pair(win.free_x, win.free_y, at), old = pair(win.last_x, win.last_y, at);
        now += doubles(dot(m, z));
        change += doubles(dot(Pair{m.x - old.x, m.y - old.y}, z));
    });
    return wp::vec_t<2, double>(sum(now), sum(change));
"""

_DIRECT = """
    Doubles slope = {};
    all([&](int64_t at) {
        const auto touches = get(win.limit.data + at) > 0;
        const Vector stiff = get(win.stiffness.data + at), weight = 1 / root(1 + stiff);
        const Pair z = pair(win.softened_x, win.softened_y, at);
        Pair d = {-weight * z.x, -weight * z.y};
        if (!fresh) {
            const Pair last = pair(win.along_x, win.along_y, at);
            d.x += beta * last.x, d.y += beta * last.y;
        }
        const Pair q = pair(win.x, win.y, at);
        const Vector length = root(dot(q, q));
        const Pair n = {q.x / length, q.y / length};
        const Vector across = dot(d, n);
        const auto slips = stiff > 0;
        d.x = slips ? d.x - across * n.x : d.x, d.y = slips ? d.y - across * n.y : d.y;
        d.x = touches ? d.x : Vector{}, d.y = touches ? d.y : Vector{};
        const Pair m = pair(win.free_x, win.free_y, at);
        slope += doubles(dot(Pair{m.x / weight, m.y / weight}, d));
        put(win.along_x.data + at, d.x);
        put(win.along_y.data + at, d.y);
    });
    return sum(slope);
"""

_CURVATURE = """
    Doubles total = {};
    all([&](int64_t at) {
        const Pair d = pair(win.along_x, win.along_y, at), a = pair(win.answer_x, win.answer_y, at);
        const Vector stiff = get(win.stiffness.data + at);
        total += doubles(dot(d, Pair{a.x + stiff * d.x, a.y + stiff * d.y}));
    });
    return sum(total);
"""

_ADVANCE = """
    Doubles cut = {};
    all([&](int64_t at) {
        const Vector limit = get(win.limit.data + at);
        const Pair d = pair(win.along_x, win.along_y, at), a = pair(win.answer_x, win.answer_y, at);
        const Pair q = pair(win.x, win.y, at), g = pair(win.gap_x, win.gap_y, at);
        Pair next = {q.x + step * d.x, q.y + step * d.y};
        const Vector length = root(dot(next, next)), back = limit / length;
        const auto touches = limit > 0, leaves = touches & (length > limit);
        next.x = leaves ? next.x * back : next.x, next.y = leaves ? next.y * back : next.y;
        put(win.x.data + at, touches ? next.x : q.x);
        put(win.y.data + at, touches ? next.y : q.y);
        put(win.gap_x.data + at, g.x + step * a.x);
        put(win.gap_y.data + at, g.y + step * a.y);
        const auto far = leaves & (length > Number(1.000001) * limit);
        cut += doubles(far ? Vector{} + 1 : Vector{});
    });
    return sum(cut);
"""
