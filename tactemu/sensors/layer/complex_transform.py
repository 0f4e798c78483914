"""Arrays and complex transforms, in C++, of the convolutions in a GPU's shared memory.

A transform of 32 or 64 points is one of 4 or 8 and one of 8, each in the registers of a thread and in place: wave
numbers stay in the order in which the first two steps leave them, and the way back begins from it. Nothing is
transposed, and rows have an odd length, so that the threads of a warp use different banks of the memory along both
axes.
"""

import functools

import warp as wp

from tactemu.sensors.layer.shared_memory import ROW
from tactemu.sensors.layer.tables import HARTLEY_GAIN


@wp.struct
class ComplexPlaces:
    """The arrays of a convolution as a GPU addresses them fastest (:func:`~.shared_memory.address_functions`)."""

    z: wp.int64  # the complex field
    x: wp.int64
    y: wp.int64  # not used where there is one field
    out_x: wp.int64
    out_y: wp.int64
    row: wp.int32  # row stride of these windows
    shape_out: wp.vec2i  # rows and columns of the result, which begins at ``at.first``
    adds: wp.bool  # is the result added to what is there?
    turns: wp.uint64  # address of the powers of the root
    n_turns: wp.int32
    one: wp.uint64  # addresses of the spectra
    other: wp.uint64
    cross: wp.uint64  # 0: none


def complex_snippet(real, steps: str) -> str:
    """Return C++ of a convolution ``(places: ComplexPlaces, at: Window, thread, threads)`` with these ``steps``."""
    pair = "double2" if real is wp.float64 else "float2"
    words = {"NUMBER": real.__name__, "ROW": str(ROW), "GAIN": str(HARTLEY_GAIN), "PAIR": pair}
    return functools.reduce(lambda code, word: code.replace(word, words[word]), words, _PRELUDE + steps)


_PRELUDE = """
    using Number = wp::NUMBER;
#if defined(__CUDA_ARCH__)
    struct alignas(2 * sizeof(Number)) Complex { Number re, im; };
    using Pair = PAIR;  // CUDA's, which it fetches at once
    extern __shared__ char dynamic_smem_base[];
    Number* const memory = reinterpret_cast<Number*>(dynamic_smem_base);
    auto at_place = [&](const int64_t place) { return memory + static_cast<int>(place); };
    auto fetch = [](const auto* const from) { return __ldg(from); };
#define WAIT __syncthreads()
#else
    struct Complex { Number re, im; };
    auto fetch = [](const auto* const from) { return *from; };
    auto at_place = [](const int64_t place) { return reinterpret_cast<Number*>(place); };
#define WAIT
#endif
    Complex* const z = reinterpret_cast<Complex*>(at_place(places.z));
    const Number* const x = at_place(places.x);
    const Number* const y = at_place(places.y);
    Number* const out_x = at_place(places.out_x);
    Number* const out_y = at_place(places.out_y);
    const Complex* const turns = reinterpret_cast<const Complex*>(places.turns);
    const Number* const one = reinterpret_cast<const Number*>(places.one) + at.start;
    const Number* const other = reinterpret_cast<const Number*>(places.other) + at.start;
    const Number* const cross = reinterpret_cast<const Number*>(places.cross) + at.start;
    const bool has_cross = places.cross != 0;
    const int rows = at.shape[0], columns = at.shape[1], n_rows = at.size[0], n_columns = at.size[1], row = places.row;
    const int rows_out = places.shape_out[0], columns_out = places.shape_out[1];
    auto row_out = [&](const int r) { return (at.first[0] + r & n_rows - 1) * ROW; };
    const Number root = Number(0.70710678118654752440);
    auto bits_of = [](const int n) { return n == 64 ? 6 : n == 32 ? 5 : n == 16 ? 4 : 3; };

    // Transforms in registers; ``back``: with the conjugate root
    auto add = [](const Complex& a, const Complex& b) { return Complex{a.re + b.re, a.im + b.im}; };
    auto sub = [](const Complex& a, const Complex& b) { return Complex{a.re - b.re, a.im - b.im}; };
    auto quarter = [](const bool back, const Complex& a) { return back ? Complex{-a.im, a.re} : Complex{a.im, -a.re}; };
    auto times = [](const bool back, const Complex& a, const Complex& w) {
        return back ? Complex{a.re * w.re + a.im * w.im, a.im * w.re - a.re * w.im}
                    : Complex{a.re * w.re - a.im * w.im, a.re * w.im + a.im * w.re};
    };
    auto fft4 = [&](const bool back, Complex* v) {
        const Complex e = add(v[0], v[2]), f = sub(v[0], v[2]), g = add(v[1], v[3]);
        const Complex h = quarter(back, sub(v[1], v[3]));
        v[0] = add(e, g), v[1] = add(f, h), v[2] = sub(e, g), v[3] = sub(f, h);
    };
    auto fft8 = [&](const bool back, Complex* v) {
        Complex even[4], odd[4];
        for (int i = 0; i < 4; ++i)
            even[i] = add(v[i], v[i + 4]), odd[i] = sub(v[i], v[i + 4]);
        const Complex t = odd[1], u = odd[3];
        odd[1] = back ? Complex{root * (t.re - t.im), root * (t.im + t.re)}
                      : Complex{root * (t.re + t.im), root * (t.im - t.re)};
        odd[2] = quarter(back, odd[2]);
        odd[3] = back ? Complex{-root * (u.re + u.im), root * (u.re - u.im)}
                      : Complex{root * (u.im - u.re), -root * (u.re + u.im)};
        fft4(back, even);
        fft4(back, odd);
        for (int i = 0; i < 4; ++i)
            v[2 * i] = even[i], v[2 * i + 1] = odd[i];
    };
    struct Four { enum { parts = 4 }; };
    struct Eight { enum { parts = 8 }; };
    auto by_length = [&](const int n, auto visit) {
        if (n == 32)
            visit(Four{});
        else
            visit(Eight{});
    };
    auto each = [&](const int count, auto visit) {
#pragma unroll 1
        for (int item = thread; item < count; item += threads)
            visit(item);
        WAIT;
    };
    // Over every eighth point: forward before, backward after the transforms of eight points
    auto wide = [&](auto kind, const bool back, Complex* v) {
        if (decltype(kind)::parts == 8)
            fft8(back, v);
        else
            fft4(back, v);
    };
    auto turn = [&](const bool back, Complex* v, const int count, const int step) {
        for (int i = 1; i < count; ++i) {
#if defined(__CUDA_ARCH__)
            const auto w = __ldg(reinterpret_cast<const Pair*>(turns + i * step));
            v[i] = times(back, v[i], Complex{w.x, w.y});
#else
            v[i] = times(back, v[i], turns[i * step]);
#endif
        }
    };
    // The steps that both convolutions have; ``j``: the first of the points, eight apart, that a thread takes
    auto put_row = [&](auto kind, Complex* v, const int r, const int j, const int step) {  // along rows, forward
        constexpr int parts = decltype(kind)::parts;
        wide(kind, false, v);
        turn(false, v, parts, j * step);
        for (int i = 0; i < parts; ++i)
            z[r * ROW + 8 * i + j] = v[i];
    };
    auto ahead_in_column = [&](auto kind, Complex* const column, const int j, const int step) {
        constexpr int parts = decltype(kind)::parts;
        Complex* const from = column + j * ROW;
        Complex v[parts];
        for (int i = 0; i < parts; ++i)
            v[i] = i < parts / 2 && 8 * i + j < rows ? from[8 * i * ROW] : Complex{0, 0};
        wide(kind, false, v);
        turn(false, v, parts, j * step);
        for (int i = 0; i < parts; ++i)
            from[8 * i * ROW] = v[i];
    };
    auto back_in_column = [&](auto kind, Complex* const column, const int j) {
        constexpr int parts = decltype(kind)::parts;
        Complex* const from = column + j * ROW;
        Complex v[parts];
        for (int i = 0; i < parts; ++i)
            v[i] = from[8 * i * ROW];
        wide(kind, true, v);
        for (int i = 0; i < parts; ++i)
            if ((8 * i + j - at.first[0] & n_rows - 1) < rows_out)
                from[8 * i * ROW] = v[i];
    };
    auto take_row = [&](auto kind, Complex* v, const int r, const int j) {  // along rows, back
        constexpr int parts = decltype(kind)::parts;
        for (int i = 0; i < parts; ++i)
            v[i] = z[row_out(r) + 8 * i + j];
        wide(kind, true, v);
    };
    // By value: an address that depends on the condition would keep arrays out of the registers
    auto choose = [](const bool first, const Complex a, const Complex b) {
        return Complex{first ? a.re : b.re, first ? a.im : b.im};
    };
"""
