"""The transforms for a CPU: eight complex columns in parallel in vector registers, from the field to the transposed
result; sixteen where registers are that wide (AVX-512).

A group of columns stays in the caches of a core from its first butterfly to its last; results leave through the
registers as transposed blocks. It is C++, since the compiler's vector types make it fast: Warp's code
for vectors of eight is three times as slow.
"""

# pyright: reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.geometry.simd import WIDTH, vector_prelude
from tactemu.sensors.layer.block import Pass, Window
from tactemu.sensors.layer.tables import tables_type

SCRATCH = 8 * WIDTH
"""Numbers of scratch for each point of a transform: a group of up to sixteen complex columns, before and after a
stage."""


@functools.cache
def simd_hartley(real):
    """Return ``hartley(scratch, twiddle, field, given, out)``, like that of :mod:`.convolution`, for complete groups of
    columns and, in ``given.rows_out``, of rows; ``out`` must not be the memory of ``field``."""
    numbers, turns = wp.array2d(dtype=real), wp.array(dtype=wp.types.vector(2, real))

    @wp.func_native(vector_prelude(real) + _TRANSFORM)
    def transform(scratch: numbers, twiddle: turns, field: numbers, given: Pass, out: numbers): ...

    @wp.func(inline=False)  # not inlined: a solver calls it dozens of times
    def hartley(scratch: numbers, twiddle: turns, field: numbers, given: Pass, out: numbers):
        transform(scratch, twiddle, field, given, out)

    return hartley


@functools.cache
def simd_scale(real):
    """Return ``scale(spectrum, table, start, rows, columns)``, which multiplies a spectrum by the table from ``start``
    on."""
    grid_type, table_type = wp.array2d(dtype=real), wp.array(dtype=real)

    @wp.func_native(vector_prelude(real) + _SCALE)
    def scale(spectrum: grid_type, table: table_type, start: int, rows: int, columns: int): ...

    return scale


@functools.cache
def simd_mix(real):
    """Return ``mix(at, x, y, tables)`` of :mod:`.tangential_compliance`, for spectra whose rows are longer than the
    transforms."""
    grid_type, tables_struct = wp.array2d(dtype=real), tables_type(real)

    @wp.func_native(vector_prelude(real) + _MIX)
    def mix(at: Window, x: grid_type, y: grid_type, tables: tables_struct): ...

    return mix


@functools.cache
def simd_by_pressure(real):
    """Return ``by_pressure(p, u, table, axis, start, rows, columns)`` of :mod:`.tangential_compliance`, for spectra
    whose rows are longer than ``columns``."""
    grid_type, table_type = wp.array2d(dtype=real), wp.array(dtype=real)

    @wp.func_native(vector_prelude(real) + _BY_PRESSURE)
    def by_pressure(p: grid_type, u: grid_type, table: table_type, axis: int, start: int, rows: int, columns: int): ...

    return by_pressure


_SCALE = """
    for (int k = 0; k < rows; ++k) {
        Number* const row = spectrum.data + k * (spectrum.strides[0] / sizeof(Number));
        const Number* const factors = table.data + start + k * columns;
        for (int c = 0; c < columns; c += wide)
            put(row + c, get(row + c) * get(factors + c));
    }
"""

_TURNED = """
    auto turned = [](const Vector& v) { return __builtin_shufflevector(v, v, 7, 6, 5, 4, 3, 2, 1, 0); };
"""

_BY_PRESSURE = (
    _TURNED
    + """
    const int64_t stride = p.strides[0] / sizeof(Number);
    for (int k = 0; k < rows; ++k) {
        Number* const from = p.data + (axis ? -k & (rows - 1) : k) * stride;
        Number* const to = u.data + k * stride;
        const Number* const factors = table.data + start + k * columns;
        from[columns] = from[0];  // so that a mirrored row is columns in the opposite order
        for (int c = 0; c < columns; c += wide)
            put(to + c, get(factors + c) * (axis ? get(from + c) : turned(get(from + columns - c - wide + 1))));
    }
"""
)

_MIX = (
    _TURNED
    + """
    const int rows = at.size[0], columns = at.size[1], start = at.start;
    const int64_t stride = x.strides[0] / sizeof(Number);
    for (int k = 0; k <= rows / 2; ++k) {
        const int mirror = (rows - k) % rows;
        Number* const px = x.data + k * stride;
        Number* const py = y.data + k * stride;
        Number* const qx = x.data + mirror * stride;
        Number* const qy = y.data + mirror * stride;
        const Number* const txx = tables.xx.data + start + k * columns;
        const Number* const txy = tables.xy.data + start + k * columns;
        const Number* const tyy = tables.yy.data + start + k * columns;
        if (k == mirror) {
            for (int c = 0; c <= columns / 2; ++c) {
                const int m = (columns - c) % columns;
                const Number ax = px[c], ay = py[c], bx = px[m], by = py[m];
                px[c] = txx[c] * ax + txy[c] * by, py[c] = tyy[c] * ay + txy[c] * bx;
                px[m] = txx[c] * bx + txy[c] * ay, py[m] = tyy[c] * by + txy[c] * ax;
            }
            continue;
        }
        qx[columns] = qx[0], qy[columns] = qy[0];  // so that a mirrored row is columns in the opposite order
        for (int c = 0; c < columns; c += wide) {
            const int m = columns - c - wide + 1;
            const Vector ax = get(px + c), ay = get(py + c), bx = turned(get(qx + m)), by = turned(get(qy + m));
            const Vector fx = get(txx + c), fxy = get(txy + c), fy = get(tyy + c);
            put(px + c, fx * ax + fxy * by), put(py + c, fy * ay + fxy * bx);
            put(qx + m, turned(fx * bx + fxy * ay)), put(qy + m, turned(fy * by + fxy * ax));
        }
        qx[0] = qx[columns], qy[0] = qy[columns];
    }
"""
)

_TRANSFORM = """
    struct Eight { typedef Vector V; typedef Unaligned U; };
    typedef Number Broad __attribute__((vector_size(2 * wide * sizeof(Number))));
    typedef Number UnalignedBroad __attribute__((vector_size(2 * wide * sizeof(Number)), aligned(alignof(Number))));
    struct Sixteen { typedef Broad V; typedef UnalignedBroad U; };
    const int64_t from_row = field.strides[0] / sizeof(Number), to_row = out.strides[0] / sizeof(Number);
    const int rows = given.rows, columns = given.columns, n = given.n, first = given.first, rows_out = given.rows_out;
    const int half = columns / 2, quarter = n / 4;
    const wp::vec_t<2, Number>* const turns = twiddle.data;
    // Transform as many complex columns as a vector has lanes, from the column ``group`` on. A lane's result does not
    // depend on their number.
    auto transform_group = [&](const auto kind, const int group) {
        typedef typename decltype(kind)::V V;
        typedef typename decltype(kind)::U U;
        constexpr int lanes = sizeof(V) / sizeof(Number);
        struct Complex { V re, im; };
        struct Four { Complex z[4]; };
        auto get = [](const Number* p) -> V { return *reinterpret_cast<const U*>(p); };
        auto put = [](Number* p, const V& v) { *reinterpret_cast<U*>(p) = v; };
        auto at = [](Number* z, const int k) { return z + 2 * lanes * k; };
        auto load = [&](Number* z, const int k) { return Complex{get(at(z, k)), get(at(z, k) + lanes)}; };
        auto store = [&](Number* z, const int k, const Complex& v) {
            put(at(z, k), v.re), put(at(z, k) + lanes, v.im);
        };
        auto add = [](const Complex& a, const Complex& b) { return Complex{a.re + b.re, a.im + b.im}; };
        auto sub = [](const Complex& a, const Complex& b) { return Complex{a.re - b.re, a.im - b.im}; };
        auto turned = [](const Complex& a) { return Complex{a.im, -a.re}; };  // by -i
        auto times = [](const Complex& a, const wp::vec_t<2, Number>& w) {
            return Complex{a.re * w[0] - a.im * w[1], a.re * w[1] + a.im * w[0]};
        };
        auto fft4 = [&](const Complex& a, const Complex& b, const Complex& c, const Complex& d) {
            const Complex e = add(a, c), f = sub(a, c), g = add(b, d), h = turned(sub(b, d));
            return Four{{add(e, g), add(f, h), sub(e, g), sub(f, h)}};
        };
        Number* here = scratch.data;
        Number* there = here + 2 * lanes * n;
        auto row = [&](const int k) {
            const Number* const p = field.data + k * from_row + group;
            return Complex{get(p), get(p + half)};
        };
        const int turn = twiddle.shape[0] / n;
        const Complex none = {V{}, V{}};
        auto row_or_none = [&](const int k) { return k < rows ? row(k) : none; };
        const bool is_half = rows <= n / 2;  // the other rows are zeros
        auto begin = [&](const int k) -> Four {
            const Complex a = row_or_none(k), b = row_or_none(k + quarter), h = turned(b);
            Four y = is_half ? Four{{add(a, b), add(a, h), sub(a, b), sub(a, h)}}
                             : fft4(a, b, row_or_none(k + 2 * quarter), row_or_none(k + 3 * quarter));
            for (int m = 1; m < 4; ++m)
                y.z[m] = times(y.z[m], turns[m * k * turn]);
            return y;
        };
        int length = quarter, stride = 4;
        if (length > 8) {  // two stages of radix 4 at once
            length /= 4, stride *= 4;
            for (int p = 0; p < length; ++p) {
                Four y[4];
                for (int i = 0; i < 4; ++i)
                    y[i] = begin(p + i * length);
                const int step = 4 * p * turn;
                const wp::vec_t<2, Number> w1 = turns[step], w2 = turns[2 * step], w3 = turns[3 * step];
                for (int m = 0; m < 4; ++m) {
                    const Four z = fft4(y[0].z[m], y[1].z[m], y[2].z[m], y[3].z[m]);
                    store(here, 16 * p + m, z.z[0]);
                    store(here, 16 * p + m + 4, times(z.z[1], w1));
                    store(here, 16 * p + m + 8, times(z.z[2], w2));
                    store(here, 16 * p + m + 12, times(z.z[3], w3));
                }
            }
        } else
            for (int k = 0; k < quarter; ++k) {
                const Four y = begin(k);
                for (int m = 0; m < 4; ++m)
                    store(here, 4 * k + m, y.z[m]);
            }
        for (; length > 8; length /= 4, stride *= 4) {
            for (int p = 0; p < length / 4; ++p) {
                const int step = p * stride * turn;
                const wp::vec_t<2, Number> w1 = turns[step], w2 = turns[2 * step], w3 = turns[3 * step];
                for (int k = p * stride; k < (p + 1) * stride; ++k) {
                    const Four y = fft4(
                        load(here, k), load(here, k + quarter), load(here, k + 2 * quarter), load(here, k + 3 * quarter)
                    );
                    const int o = k + 3 * p * stride;
                    store(there, o, y.z[0]);
                    store(there, o + stride, times(y.z[1], w1));
                    store(there, o + 2 * stride, times(y.z[2], w2));
                    store(there, o + 3 * stride, times(y.z[3], w3));
                }
            }
            Number* const other = here;
            here = there, there = other;
        }
        if (length == 4)
            for (int k = 0; k < stride; ++k) {
                const Four y =
                    fft4(load(here, k), load(here, k + stride), load(here, k + 2 * stride), load(here, k + 3 * stride));
                for (int m = 0; m < 4; ++m)
                    store(here, k + m * stride, y.z[m]);
            }
        else
            for (int k = 0; k < stride; ++k) {
                const Number root = Number(0.70710678118654752440);
                Complex even[4], odd[4];
                for (int m = 0; m < 4; ++m) {
                    const Complex a = load(here, k + m * stride), b = load(here, k + (m + 4) * stride);
                    even[m] = add(a, b), odd[m] = sub(a, b);
                }
                odd[1] = Complex{root * (odd[1].re + odd[1].im), root * (odd[1].im - odd[1].re)};
                odd[2] = turned(odd[2]);
                odd[3] = Complex{root * (odd[3].im - odd[3].re), -root * (odd[3].im + odd[3].re)};
                const Four x = fft4(even[0], even[1], even[2], even[3]), y = fft4(odd[0], odd[1], odd[2], odd[3]);
                for (int m = 0; m < 4; ++m)
                    store(here, k + 2 * m * stride, x.z[m]), store(here, k + (2 * m + 1) * stride, y.z[m]);
            }
        // Hartley coefficients of the two columns in each complex one, transposed.
        auto turn_over = [&](V* r, Number* const to) {
            V s[lanes], t[lanes];
            if constexpr (lanes == 8) {
                for (int l = 0; l < 8; l += 2) {
                    s[l] = __builtin_shufflevector(r[l], r[l + 1], 0, 8, 1, 9, 4, 12, 5, 13);
                    s[l + 1] = __builtin_shufflevector(r[l], r[l + 1], 2, 10, 3, 11, 6, 14, 7, 15);
                }
                for (int l = 0; l < 8; l += 4)
                    for (int m = 0; m < 2; ++m) {
                        const V a = s[l + m], b = s[l + m + 2];
                        t[l + 2 * m] = __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
                        t[l + 2 * m + 1] = __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
                    }
                for (int l = 0; l < 4; ++l) {
                    put(to + l * to_row, __builtin_shufflevector(t[l], t[l + 4], 0, 1, 2, 3, 8, 9, 10, 11));
                    put(to + (l + 4) * to_row, __builtin_shufflevector(t[l], t[l + 4], 4, 5, 6, 7, 12, 13, 14, 15));
                }
            } else {
                for (int l = 0; l < 16; l += 2) {
                    const V a = r[l], b = r[l + 1];
                    s[l] = __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
                    s[l + 1] =
                        __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
                }
                for (int l = 0; l < 16; l += 4)
                    for (int m = 0; m < 2; ++m) {
                        const V a = s[l + m], b = s[l + m + 2];
                        t[l + 2 * m] =
                            __builtin_shufflevector(a, b, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
                        t[l + 2 * m + 1] =
                            __builtin_shufflevector(a, b, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
                    }
                auto evens = [](const V& a, const V& b) {
                    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27);
                };
                auto odds = [](const V& a, const V& b) {
                    return __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31);
                };
                for (int m = 0; m < 4; ++m) {
                    const V low = evens(t[m], t[m + 4]), high = evens(t[m + 8], t[m + 12]);
                    const V beside_low = odds(t[m], t[m + 4]), beside_high = odds(t[m + 8], t[m + 12]);
                    put(to + m * to_row, evens(low, high));
                    put(to + (m + 4) * to_row, evens(beside_low, beside_high));
                    put(to + (m + 8) * to_row, odds(low, high));
                    put(to + (m + 12) * to_row, odds(beside_low, beside_high));
                }
            }
        };
        Number* const result = out.data + group * to_row;
        for (int k = 0; k < rows_out; k += lanes) {
            V one[lanes], other[lanes];
            for (int l = 0; l < lanes; ++l) {
                const int place = (k + l + first) & (n - 1);
                const Complex x = load(here, place), y = load(here, (n - place) & (n - 1));
                one[l] = (x.re + y.re) - (x.im - y.im);
                other[l] = (x.im + y.im) + (x.re - y.re);
            }
            turn_over(one, result + k);
            turn_over(other, result + half * to_row + k);
        }
    };
    int group = 0;
#if defined(__AVX512F__)
    if (sizeof(Broad) <= 64 && rows_out % (2 * wide) == 0)
        for (; group + 2 * wide <= half; group += 2 * wide)
            transform_group(Sixteen{}, group);
#endif
    for (; group < half; group += wide)
        transform_group(Eight{}, group);
"""
