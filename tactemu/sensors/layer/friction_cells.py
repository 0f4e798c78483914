"""The operations of the friction solver on each cell of a window, between its convolutions (:mod:`.friction`).

Values that a cell does not need (a circle, where it sticks) are computed too, and discarded.
"""

# pyright: reportGeneralTypeIssues=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.layer.block import Window
from tactemu.sensors.layer.cells import over_cells
from tactemu.sensors.layer.friction_state import SLIP_FRACTION, friction_windows_type


class FrictionCells(NamedTuple):
    """The Warp functions on the calling thread's cells of a window ``at``. A result is that thread's part of a sum: the
    caller adds up the block's (:func:`.window.block_functions`), which also shows all threads what each has written."""

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
def friction_cells(real, lanes: int, is_shared: bool) -> FrictionCells:
    """Return the functions for one float type and lane width; ``is_shared``: the windows are in shared memory."""
    windows = friction_windows_type(real)

    @wp.func_native(_cells(real, lanes, is_shared, _NORM))
    def norm(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(_cells(real, lanes, is_shared, _FREE_GAP))
    def free_gap(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(_cells(real, lanes, is_shared, _PRODUCTS))
    def products(win: windows, at: Window) -> wp.vec2d: ...

    @wp.func_native(_cells(real, lanes, is_shared, _DIRECT))
    def direct(win: windows, at: Window, beta: real, fresh: bool) -> wp.float64: ...

    @wp.func_native(_cells(real, lanes, is_shared, _CURVATURE))
    def curvature(win: windows, at: Window) -> wp.float64: ...

    @wp.func_native(_cells(real, lanes, is_shared, _ADVANCE))
    def advance(win: windows, at: Window, step: real) -> wp.float64: ...

    return FrictionCells(norm, free_gap, products, direct, curvature, advance)


def _cells(real, lanes: int, is_shared: bool, each: str) -> str:
    return over_cells(
        real, lanes, is_shared, "limit", _PAIRS + each.replace("SLIP_FRACTION", f"Number({SLIP_FRACTION})")
    )


_PAIRS = """
    struct Pair { Vector x, y; };
    auto pair = [&](const auto& x, const auto& y, const auto& cell) { return Pair{load(x, cell), load(y, cell)}; };
    auto dot = [](const Pair& a, const Pair& b) { return a.x * b.x + a.y * b.y; };
"""

_NORM = """
    Doubles total = {};
    all([&](const auto& cell) {
        const Pair pulled = pair(win.gap_x, win.gap_y, cell);
        const Pair pressed = pair(win.by_pressure_x, win.by_pressure_y, cell);
        const Pair u = {pulled.x + pressed.x, pulled.y + pressed.y}, hold = pair(win.hold_x, win.hold_y, cell);
        store(win.gap_x, cell, u.x - hold.x);
        store(win.gap_y, cell, u.y - hold.y);
        const auto touches = load(win.limit, cell) > 0;
        const Doubles x = doubles(touches ? u.x : Vector{}), y = doubles(touches ? u.y : Vector{});
        total += x * x + y * y;
    });
    return sum(total);
"""

_FREE_GAP = """
    Doubles total = {};
    all([&](const auto& cell) {
        const Vector limit = load(win.limit, cell);
        const auto touches = limit > 0;
        Pair g = pair(win.gap_x, win.gap_y, cell);
        g.x = touches ? g.x : Vector{}, g.y = touches ? g.y : Vector{};
        const Pair q = pair(win.x, win.y, cell);
        const Vector length = root(dot(q, q)), outward = dot(g, q) / limit;
        const auto slips = touches & (length >= SLIP_FRACTION * limit) & (outward < 0);
        const Pair n = {q.x / length, q.y / length};
        const Vector along = dot(g, n);
        g.x = slips ? g.x - along * n.x : g.x, g.y = slips ? g.y - along * n.y : g.y;
        const Vector stiff = slips ? -outward / limit : Vector{};
        const Vector weight = 1 / root(1 + stiff);
        store(win.last_x, cell, load(win.free_x, cell));
        store(win.last_y, cell, load(win.free_y, cell));
        store(win.free_x, cell, weight * g.x);
        store(win.free_y, cell, weight * g.y);
        store(win.stiffness, cell, stiff);
        const Doubles x = doubles(weight * weight * g.x), y = doubles(weight * weight * g.y);
        total += x * x + y * y;
    });
    return sum(total);
"""

_PRODUCTS = """
    Doubles now = {}, change = {};
    all([&](const auto& cell) {
        const Pair z = pair(win.softened_x, win.softened_y, cell);
        const Pair m = pair(win.free_x, win.free_y, cell), old = pair(win.last_x, win.last_y, cell);
        now += doubles(dot(m, z));
        change += doubles(dot(Pair{m.x - old.x, m.y - old.y}, z));
    });
    return wp::vec_t<2, double>(sum(now), sum(change));
"""

_DIRECT = """
    Doubles slope = {};
    all([&](const auto& cell) {
        const auto touches = load(win.limit, cell) > 0;
        const Vector stiff = load(win.stiffness, cell), weight = 1 / root(1 + stiff);
        const Pair z = pair(win.softened_x, win.softened_y, cell);
        const Pair last = pair(win.along_x, win.along_y, cell), down = {-weight * z.x, -weight * z.y};
        Pair d = {fresh ? down.x : fused(beta, last.x, down.x), fresh ? down.y : fused(beta, last.y, down.y)};
        const Pair q = pair(win.x, win.y, cell);
        const Vector length = root(dot(q, q));
        const Pair n = {q.x / length, q.y / length};
        const Vector across = dot(d, n);
        const auto slips = stiff > 0;
        d.x = slips ? d.x - across * n.x : d.x, d.y = slips ? d.y - across * n.y : d.y;
        d.x = touches ? d.x : Vector{}, d.y = touches ? d.y : Vector{};
        const Pair m = pair(win.free_x, win.free_y, cell);
        slope += doubles(dot(Pair{m.x / weight, m.y / weight}, d));
        store(win.along_x, cell, d.x);
        store(win.along_y, cell, d.y);
    });
    return sum(slope);
"""

_CURVATURE = """
    Doubles total = {};
    all([&](const auto& cell) {
        const Pair d = pair(win.along_x, win.along_y, cell), a = pair(win.answer_x, win.answer_y, cell);
        const Vector stiff = load(win.stiffness, cell);
        total += doubles(dot(d, Pair{a.x + stiff * d.x, a.y + stiff * d.y}));
    });
    return sum(total);
"""

_ADVANCE = """
    Doubles cut = {};
    all([&](const auto& cell) {
        const Vector limit = load(win.limit, cell);
        const Pair d = pair(win.along_x, win.along_y, cell), a = pair(win.answer_x, win.answer_y, cell);
        const Pair q = pair(win.x, win.y, cell), g = pair(win.gap_x, win.gap_y, cell);
        Pair next = {q.x + step * d.x, q.y + step * d.y};
        const Vector length = root(dot(next, next)), back = limit / length;
        const auto touches = limit > 0;
        const auto leaves = touches & (length > limit);
        next.x = leaves ? next.x * back : next.x, next.y = leaves ? next.y * back : next.y;
        store(win.x, cell, touches ? next.x : q.x);
        store(win.y, cell, touches ? next.y : q.y);
        store(win.gap_x, cell, g.x + step * a.x);
        store(win.gap_y, cell, g.y + step * a.y);
        const auto far = leaves & (length > Number(1.000001) * limit);
        cut += doubles(far ? Vector{} + 1 : Vector{});
    });
    return sum(cut);
"""
