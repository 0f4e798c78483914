"""Convolutions of one real field with an even kernel in a GPU's shared memory.

Along rows, the upper half of the window and the lower are the real and the imaginary part of one complex field
(:mod:`.complex_transform`). Then both are taken apart, for wave numbers up to half of all, which are those of a real
field; each column of them is transformed, scaled and transformed back in the registers.
"""

# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.sensors.layer.block import Window
from tactemu.sensors.layer.complex_transform import ComplexPlaces, complex_snippet
from tactemu.sensors.layer.convolution import workspace_type
from tactemu.sensors.layer.shared_memory import address_functions


@functools.cache
def single_convolution(real):
    """Return ``convolve(ws, at, field, table, out, shape)``, like that of :mod:`.convolution`; ``out`` is the window of
    ``shape`` that begins at ``at.first``."""
    grid, workspace = wp.array2d(dtype=real), workspace_type(real)
    place, address, address_of_turns = address_functions(real)

    @wp.func_native(complex_snippet(real, _STEPS))
    def convolve_native(places: ComplexPlaces, at: Window, thread: int, threads: int): ...

    @wp.func(inline=False)  # not inlined: a solver calls it several times
    def convolve_here(places: ComplexPlaces, at: Window):
        convolve_native(places, at, at.thread, wp.block_dim())

    @wp.func
    def convolve(ws: workspace, at: Window, field: grid, table: wp.array(dtype=real), out: grid, shape: wp.vec2i):
        places = ComplexPlaces(
            place(ws.spectrum[at.slot]), place(field), wp.int64(0), place(out), wp.int64(0), field.shape[1],
            shape, False, address_of_turns(ws.twiddle), ws.twiddle.shape[0], address(table), wp.uint64(0),
            wp.uint64(0),
        )  # fmt: skip
        convolve_here(places, at)

    return convolve


_STEPS = """
    const int half_rows = rows / 2, half = n_columns / 2, across = n_columns / 8;
    auto conjugate = [](const Complex& a) { return Complex{a.re, -a.im}; };
    // The two groups of eight wave numbers in one item: each its own opposite, or each the other's
    auto partner = [](const int m, const int parts) { return m ? parts - m : parts / 2; };
    auto opposite = [&](const bool own, const Complex* a, const Complex* b, const int i) {
        return choose(own, a[(8 - i) & 7], b[7 - i]);
    };

    // Forward along rows of cells, the upper and the lower half of the window as one complex field
    by_length(n_columns, [&](auto kind) {
        constexpr int parts = decltype(kind)::parts;
        const int bits = bits_of(half_rows), step = places.n_turns / n_columns;
        each(8 * half_rows, [&](const int item) {
            const int r = item & (half_rows - 1), j = item >> bits;
            Complex v[parts];
            for (int i = 0; i < parts; ++i) {
                const int c = 8 * i + j;
                const bool there = i < parts / 2 && c < columns;
                const Number upper = there ? x[r * row + c] : Number(0);
                v[i] = Complex{upper, there ? x[(r + half_rows) * row + c] : Number(0)};
            }
            put_row(kind, v, r, j, step);
        });
        each(parts / 2 * half_rows, [&](const int item) {  // and apart: wave numbers up to half of all
            const int r = item & (half_rows - 1), m = item >> bits, n = partner(m, parts);
            const bool own = m == 0;
            Complex* const one_row = z + r * ROW;
            Complex* const other_row = one_row + half_rows * ROW;
            Complex a[8], b[8];
            for (int i = 0; i < 8; ++i)
                a[i] = one_row[8 * m + i], b[i] = one_row[8 * n + i];
            fft8(false, a);
            fft8(false, b);
            auto put = [&](const int place, const Complex& f, const Complex& g) {  // twice the transforms
                const Complex d = sub(f, conjugate(g));
                one_row[place] = add(f, conjugate(g));
                other_row[place] = Complex{d.im, -d.re};
            };
            const Complex first = a[0], middle = a[4];
            for (int i = 0; i < 4; ++i) {
                put(8 * m + i, a[i], opposite(own, a, b, i));
                put(8 * n + i, b[i], choose(own, b[7 - i], a[7 - i]));
            }
            if (own) {  // the mean and the highest wave number are real: one place for both
                one_row[0] = Complex{2 * first.re, 2 * middle.re};
                other_row[0] = Complex{2 * first.im, 2 * middle.im};
            }
        });
    });
    // Along columns, forth and back
    by_length(n_rows, [&](auto kind) {
        constexpr int parts = decltype(kind)::parts;
        const int bits = bits_of(half), step = places.n_turns / n_rows;
        auto column = [&](const int item) {
            const int h = item & (half - 1);
            return z + 8 * (h >> 2) + (h & 3);
        };
        each(8 * half, [&](const int item) { ahead_in_column(kind, column(item), item >> bits, step); });
        each(parts / 2 * half, [&](const int item) {
            const int h = item & (half - 1), m = item >> bits, n = partner(m, parts), k = (h >> 2) + across * (h & 3);
            const bool own = m == 0, is_packed = h == 0;
            Complex* const here = column(item) + 8 * m * ROW;
            Complex* const there = column(item) + 8 * n * ROW;
            Complex a[8], b[8], c[8], d[8];
            for (int i = 0; i < 8; ++i)
                a[i] = here[i * ROW], b[i] = there[i * ROW];
            fft8(false, a);
            fft8(false, b);
            auto scale = [&](const int at, const Complex& f, const Complex& g) {
                const Number first = Number(0.25 * GAIN) * fetch(one + at);
                const Number second = is_packed ? Number(0.25 * GAIN) * fetch(one + at + half) : first;
                const Number along = first + second, turned = first - second;
                return Complex{along * f.re + turned * g.re, along * f.im - turned * g.im};
            };
            for (int i = 0; i < 8; ++i) {
                c[i] = scale((m + parts * i) * n_columns + k, a[i], opposite(own, a, b, i));
                d[i] = scale((n + parts * i) * n_columns + k, b[i], choose(own, b[7 - i], a[7 - i]));
            }
            fft8(true, c);
            fft8(true, d);
            turn(true, c, 8, m * step);
            turn(true, d, 8, n * step);
            for (int i = 0; i < 8; ++i)
                here[i * ROW] = c[i], there[i * ROW] = d[i];
        });
        each(8 * half, [&](const int item) { back_in_column(kind, column(item), item >> bits); });
    });
    // Together again, and back along rows of cells
    by_length(n_columns, [&](auto kind) {
        constexpr int parts = decltype(kind)::parts;
        const int half_out = rows_out / 2, bits = bits_of(half_out), step = places.n_turns / n_columns;
        each(parts / 2 * half_out, [&](const int item) {
            const int r = item & (half_out - 1), m = item >> bits, n = partner(m, parts);
            const bool own = m == 0;
            Complex* const one_row = z + row_out(r);
            Complex* const other_row = z + row_out(r + half_out);
            Complex a[8], b[8];
            auto join = [](const Complex& f, const Complex& g) { return Complex{f.re - g.im, f.im + g.re}; };
            for (int i = 0; i < 4; ++i) {
                a[i] = join(one_row[8 * m + i], other_row[8 * m + i]);
                b[i] = join(one_row[8 * n + i], other_row[8 * n + i]);
                const Complex f = join(conjugate(one_row[8 * m + i]), conjugate(other_row[8 * m + i]));
                const Complex g = join(conjugate(one_row[8 * n + i]), conjugate(other_row[8 * n + i]));
                const int above = 8 * m + (i + 1) % 4;
                const Complex next = join(conjugate(one_row[above]), conjugate(other_row[above]));
                a[7 - i] = choose(own, next, g);
                b[7 - i] = choose(own, g, f);
            }
            if (own) {
                a[0] = Complex{one_row[0].re, other_row[0].re};
                a[4] = Complex{one_row[0].im, other_row[0].im};
            }
            fft8(true, a);
            fft8(true, b);
            turn(true, a, 8, m * step);
            turn(true, b, 8, n * step);
            for (int i = 0; i < 8; ++i)
                one_row[8 * m + i] = a[i], one_row[8 * n + i] = b[i];
        });
        each(8 * half_out, [&](const int item) {
            const int r = item & (half_out - 1), j = item >> bits;
            Complex v[parts];
            take_row(kind, v, r, j);
            for (int i = 0; i < parts; ++i) {
                const int c = 8 * i + j - at.first[1] & n_columns - 1;
                if (c < columns_out)
                    out_x[r * row + c] = v[i].re, out_x[(r + half_out) * row + c] = v[i].im;
            }
        });
    });
#undef WAIT
"""
