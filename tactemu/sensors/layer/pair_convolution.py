"""Convolutions of the two tangential fields of a skin in a GPU's shared memory, as the parts of one complex field.

With ``F`` the Fourier transform of ``x + i y`` and ``F*`` the conjugate of ``F`` at the opposite wave number, a
convolution of both fields with kernels whose transforms are real, as tractions move the surface, is::

    U = (xx + yy) / 2 F + ((xx - yy) / 2 + i xy) F*

One transform each way (:mod:`.complex_transform`) then serves two fields, and needs no step that separates real
columns. Between the ways each thread has sixteen wave numbers and their opposites in its registers.
"""

# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.layer.block import Window
from tactemu.sensors.layer.complex_transform import ComplexPlaces, complex_snippet
from tactemu.sensors.layer.convolution import workspace_type
from tactemu.sensors.layer.shared_memory import address_functions
from tactemu.sensors.layer.tables import tables_type


class PairFunctions(NamedTuple):
    """The Warp functions that all threads of a block call together; ``at`` is the :class:`~.block.Window`, fields have
    its shape."""

    by_traction: Any
    """``by_traction(ws, at, tables, x, y, out_x, out_y, shape, adds)`` computes the displacement by tractions in the
    window of ``shape`` that begins at ``at.first``; ``adds``: it is added to what is there."""
    by_pressure: Any
    """``by_pressure(ws, at, tables, pressure, out_x, out_y, shape)`` computes the tangential displacement by
    pressure."""
    soften: Any
    """``soften(ws, at, tables, x, y, out_x, out_y)`` applies the preconditioner."""


@functools.cache
def pair_functions(real) -> PairFunctions:
    """Return the functions for one float type."""
    field, workspace, tables = wp.array2d(dtype=real), workspace_type(real), tables_type(real)
    place, address, address_of_turns = address_functions(real)

    @wp.func_native(complex_snippet(real, _STEPS))
    def convolve_native(places: ComplexPlaces, at: Window, thread: int, threads: int, pressed: bool): ...

    @wp.func(inline=False)  # not inlined: a solver calls it several times
    def convolve(places: ComplexPlaces, at: Window, pressed: bool):
        convolve_native(places, at, at.thread, wp.block_dim(), pressed)

    @wp.func
    def by_traction(
        ws: workspace,
        at: Window,
        t: tables,
        x: field,
        y: field,
        out_x: field,
        out_y: field,
        shape: wp.vec2i,
        adds: bool,
    ):
        places = ComplexPlaces(
            place(ws.spectrum[at.slot]), place(x), place(y), place(out_x), place(out_y), x.shape[1], shape, adds,
            address_of_turns(ws.twiddle), ws.twiddle.shape[0], address(t.xx), address(t.yy), address(t.xy),
        )  # fmt: skip
        convolve(places, at, False)

    @wp.func
    def by_pressure(ws: workspace, at: Window, t: tables, pressure: field, out_x: field, out_y: field, shape: wp.vec2i):
        places = ComplexPlaces(
            place(ws.spectrum[at.slot]), place(pressure), wp.int64(0), place(out_x), place(out_y), pressure.shape[1],
            shape, False,
            address_of_turns(ws.twiddle), ws.twiddle.shape[0], address(t.ny), wp.uint64(0), address(t.nx),
        )  # fmt: skip
        convolve(places, at, True)

    @wp.func
    def soften(ws: workspace, at: Window, t: tables, x: field, y: field, out_x: field, out_y: field):
        places = ComplexPlaces(
            place(ws.spectrum[at.slot]), place(x), place(y), place(out_x), place(out_y), x.shape[1], at.shape, False,
            address_of_turns(ws.twiddle), ws.twiddle.shape[0], address(t.soften_x), address(t.soften_y), wp.uint64(0),
        )  # fmt: skip
        convolve(places, at, False)

    return PairFunctions(by_traction, by_pressure, soften)


_STEPS = """
    // Forward along rows of cells: lanes are rows
    by_length(n_columns, [&](auto kind) {
        constexpr int parts = decltype(kind)::parts;
        const int bits = bits_of(rows), step = places.n_turns / n_columns;
        each(8 * rows, [&](const int item) {
            const int r = item & (rows - 1), j = item >> bits;
            Complex v[parts];
            for (int i = 0; i < parts; ++i) {
                const int c = 8 * i + j;
                const bool there = i < parts / 2 && c < columns;
                v[i] = Complex{there ? x[r * row + c] : Number(0), there && !pressed ? y[r * row + c] : Number(0)};
            }
            put_row(kind, v, r, j, step);
        });
        each(parts * rows, [&](const int item) {
            Complex* const from = z + (item & (rows - 1)) * ROW + 8 * (item >> bits);
            Complex v[8];
            for (int i = 0; i < 8; ++i)
                v[i] = from[i];
            fft8(false, v);
            for (int i = 0; i < 8; ++i)
                from[i] = v[i];
        });
    });
    // Along columns, forth and back: lanes are wave numbers along rows
    by_length(n_rows, [&](auto kind) {
        constexpr int parts = decltype(kind)::parts;
        const int bits = bits_of(n_columns), step = places.n_turns / n_rows, across = n_columns / 8;
        auto column = [&](const int item) { return z + (item & (n_columns - 1)); };
        each(8 * n_columns, [&](const int item) { ahead_in_column(kind, column(item), item >> bits, step); });
        each(parts / 2 * n_columns, [&](const int item) {
            // Two groups of eight wave numbers that are each other's opposites, or each its own
            const int lane = item & (n_columns - 1), half = n_columns / 2;
            int m = item >> bits, place = lane;
            const bool is_first = m == 0;
            if (is_first) {
                m = lane < half ? 0 : parts / 2;
                const int h = lane & (half - 1);
                place = 8 * (h >> 2) + (h & 3);
            }
            const bool own = is_first && place == 0, straight = m == 0;
            const int p = place >> 3, q = place & 7;
            const int mirror_p = p ? across - p : 0, mirror_q = p ? 7 - q : (8 - q) & 7;
            const int mirror = own ? 4 : 8 * mirror_p + mirror_q, mirror_m = is_first ? m : parts - m;
            Complex* const here = z + place + 8 * m * ROW;
            Complex* const there = z + mirror + 8 * mirror_m * ROW;
            Complex a[8], b[8];
            for (int i = 0; i < 8; ++i)
                a[i] = here[i * ROW], b[i] = there[i * ROW];
            fft8(false, a);
            fft8(false, b);
            const int number = p + across * q, mirror_number = (mirror >> 3) + across * (mirror & 7);
            auto mix = [&](const int k, const Complex& f, const Complex& g) {
                const Number first = fetch(one + k), second = pressed ? Number(0) : fetch(other + k);
                const Number along = pressed ? Number(GAIN) * first : Number(0.5 * GAIN) * (first + second);
                const Number turned = pressed ? Number(0) : Number(0.5 * GAIN) * (first - second);
                const Number s = has_cross ? -Number(GAIN) * fetch(cross + k) : Number(0);
                return Complex{
                    along * f.re + turned * g.re + s * g.im, along * f.im + s * g.re - turned * g.im
                };
            };
            Complex c[8], d[8];
            for (int i = 0; i < 8; ++i) {
                const Complex s = choose(straight, a[(8 - i) & 7], a[7 - i]);
                const Complex t = choose(straight, b[(8 - i) & 7], b[7 - i]);
                c[i] = mix((m + parts * i) * n_columns + number, a[i], choose(own, s, t));
                d[i] = mix((mirror_m + parts * i) * n_columns + mirror_number, b[i], choose(own, t, s));
            }
            fft8(true, c);
            fft8(true, d);
            turn(true, c, 8, m * step);
            turn(true, d, 8, mirror_m * step);
            for (int i = 0; i < 8; ++i)
                here[i * ROW] = c[i], there[i * ROW] = d[i];
        });
        each(8 * n_columns, [&](const int item) { back_in_column(kind, column(item), item >> bits); });
    });
    // Back along rows of cells
    by_length(n_columns, [&](auto kind) {
        constexpr int parts = decltype(kind)::parts;
        const int bits = bits_of(rows_out), step = places.n_turns / n_columns;
        each(parts * rows_out, [&](const int item) {
            const int m = item >> bits;
            Complex* const from = z + row_out(item & (rows_out - 1)) + 8 * m;
            Complex v[8];
            for (int i = 0; i < 8; ++i)
                v[i] = from[i];
            fft8(true, v);
            turn(true, v, 8, m * step);
            for (int i = 0; i < 8; ++i)
                from[i] = v[i];
        });
        each(8 * rows_out, [&](const int item) {
            const int r = item & (rows_out - 1), j = item >> bits;
            Complex v[parts];
            take_row(kind, v, r, j);
            for (int i = 0; i < parts; ++i) {
                const int c = 8 * i + j - at.first[1] & n_columns - 1;
                if (c < columns_out) {
                    Number* const to_x = out_x + r * row + c;
                    Number* const to_y = out_y + r * row + c;
                    *to_x = places.adds ? *to_x + v[i].re : v[i].re;
                    *to_y = places.adds ? *to_y + v[i].im : v[i].im;
                }
            }
        });
    });
#undef WAIT
"""
