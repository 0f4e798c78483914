"""A block's own memory: on a GPU, skins of up to 32 x 32 cells are solved without leaving the multiprocessor.

The spectra, the scratch of the transforms and the vectors of the solvers lie in shared memory; solvers see arrays as
ever. A transform of 32 or 64 points is one of 4 or 8 and one of 8, each in the registers of a thread; what it reads is
in the scratch before it writes, so that a spectrum is transformed in place.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

CELLS = 32
"""Along the longer side of the largest skin that is solved so."""
_LONGEST = 2 * CELLS
_SCRATCH = _LONGEST * CELLS
_ROW = _LONGEST + 1
"""Numbers from one row of a spectrum to the next: odd, lest those of a column crowd one bank of the memory."""


def fits(cells: tuple[int, int], lanes: int) -> bool:
    """Whether a skin is solved on the chip."""
    return lanes == 1 and max(cells) <= CELLS


def chip_numbers(spectra: int, windows: int) -> int:
    """How many numbers of shared memory a block needs for so many spectra and windows."""
    return 2 * _SCRATCH + spectra * _LONGEST * _ROW + windows * CELLS * CELLS


@functools.cache
def chip_functions(real, workspace, spectra: int, windows: int):
    """``(move_in, window)``: the workspace ``move_in(ws, memory)`` and the ``k``-th window ``window(memory, k)`` in the
    tile ``memory``, the same for every slot: a block's own."""
    tile = wp.tile(dtype=real, shape=(chip_numbers(spectra, windows),))

    @wp.func_native(f"""
    wp::array_t<wp::{real.__name__}> found(memory.data.ptr + first, 0x7fffffff, rows, columns);
    found.strides[0] = 0;
    return found;
    """)
    def part(memory: tile, first: int, rows: int, columns: int) -> wp.array3d(dtype=real): ...

    @wp.func
    def window(memory: tile, k: int):
        first = wp.static(chip_numbers(spectra, 0)) + k * wp.static(CELLS * CELLS)
        return part(memory, first, wp.static(CELLS), wp.static(CELLS))

    @wp.func
    def spectrum(memory: tile, k: int):
        first = wp.static(2 * _SCRATCH) + k * wp.static(_LONGEST * _ROW)
        return part(memory, first, wp.static(_LONGEST), wp.static(_ROW))

    @wp.func
    def move_in(ws: workspace, memory: tile):
        here = ws
        here.re = part(memory, 0, wp.static(_LONGEST), wp.static(CELLS))
        here.im = part(memory, wp.static(_SCRATCH), wp.static(_LONGEST), wp.static(CELLS))
        here.spectrum = spectrum(memory, 0)
        here.spectrum_lanes = here.spectrum
        if wp.static(spectra > 1):
            here.second = spectrum(memory, 1)
            here.second_lanes = here.second
        if wp.static(spectra > 2):
            here.third = spectrum(memory, 2)
            here.third_lanes = here.third
        return here

    return move_in, window


@functools.cache
def short_hartley(real):
    """``hartley(ws, slot, field, rows, columns, n, first, rows_out, out, thread)`` as that of :mod:`.convolution`, for
    ``n`` of 32 or 64 and columns that are a power of two."""
    field_type, turns_type = wp.array2d(dtype=real), wp.array(dtype=wp.types.vector(2, real))

    @wp.func_native("return reinterpret_cast<uint64_t>(a.data);")
    def address(a: field_type) -> wp.uint64: ...

    @wp.func_native("return reinterpret_cast<uint64_t>(a.data);")
    def address_of_turns(a: turns_type) -> wp.uint64: ...

    @wp.func_native(_TRANSFORM.replace("NUMBER", real.__name__))
    def transform(
        field: wp.uint64,
        from_row: int,
        rows: int,
        half: int,
        n: int,
        first: int,
        rows_out: int,
        out: wp.uint64,
        to_row: int,
        re: wp.uint64,
        im: wp.uint64,
        turns: wp.uint64,
        n_turns: int,
        thread: int,
        threads: int,
    ): ...

    @wp.func(inline=False)  # one copy of it: a solver calls it dozens of times
    def shared_by_all(
        field: wp.uint64,
        from_row: int,
        rows: int,
        half: int,
        n: int,
        first: int,
        rows_out: int,
        out: wp.uint64,
        to_row: int,
        re: wp.uint64,
        im: wp.uint64,
        turns: wp.uint64,
        n_turns: int,
        thread: int,
    ):
        transform(
            field, from_row, rows, half, n, first, rows_out, out, to_row, re, im, turns, n_turns, thread, wp.block_dim()
        )

    @wp.func
    def hartley(
        re: wp.array3d(dtype=real),
        im: wp.array3d(dtype=real),
        twiddle: turns_type,
        slot: int,
        field: field_type,
        rows: int,
        columns: int,
        n: int,
        first: int,
        rows_out: int,
        out: field_type,
        thread: int,
    ):
        shared_by_all(
            address(field),
            field.shape[1],
            rows,
            columns // 2,
            n,
            first,
            rows_out,
            address(out),
            out.shape[1],
            address(re[slot]),
            address(im[slot]),
            address_of_turns(twiddle),
            twiddle.shape[0],
            thread,
        )

    return hartley


_TRANSFORM = """
#if defined(__CUDA_ARCH__)
#define WAIT __syncthreads()
#else
#define WAIT
#endif
    using Number = wp::NUMBER;
    const Number* const in = reinterpret_cast<const Number*>(field);
    Number* const result = reinterpret_cast<Number*>(out);
    Number* const zr = reinterpret_cast<Number*>(re);
    Number* const zi = reinterpret_cast<Number*>(im);
    const wp::vec_t<2, Number>* const w = reinterpret_cast<const wp::vec_t<2, Number>*>(turns);
    const int parts = n / 8, turn = n_turns / n, parts_bits = parts == 8 ? 3 : 2;
    const int bits = half == 32 ? 5 : half == 16 ? 4 : 3;
    const Number root = Number(0.70710678118654752440);
    // In place and in order, of elements i, i + s, i + 2 s, i + 3 s.
    auto fft4 = [](Number* r, Number* m, const int i, const int s) {
        const Number ar = r[i] + r[i + 2 * s], ai = m[i] + m[i + 2 * s];
        const Number br = r[i] - r[i + 2 * s], bi = m[i] - m[i + 2 * s];
        const Number cr = r[i + s] + r[i + 3 * s], ci = m[i + s] + m[i + 3 * s];
        const Number dr = r[i + s] - r[i + 3 * s], di = m[i + s] - m[i + 3 * s];
        r[i] = ar + cr, m[i] = ai + ci;
        r[i + s] = br + di, m[i + s] = bi - dr;
        r[i + 2 * s] = ar - cr, m[i + 2 * s] = ai - ci;
        r[i + 3 * s] = br - di, m[i + 3 * s] = bi + dr;
    };
    auto fft8 = [&](Number* r, Number* m) {
        fft4(r, m, 0, 2);
        fft4(r, m, 1, 2);
        const Number er[4] = {r[0], r[2], r[4], r[6]}, ei[4] = {m[0], m[2], m[4], m[6]};
        const Number tr[4] = {r[1], root * (r[3] + m[3]), m[5], root * (m[7] - r[7])};
        const Number ti[4] = {m[1], root * (m[3] - r[3]), -r[5], -root * (m[7] + r[7])};
        for (int k = 0; k < 4; ++k) {
            r[k] = er[k] + tr[k], m[k] = ei[k] + ti[k];
            r[k + 4] = er[k] - tr[k], m[k + 4] = ei[k] - ti[k];
        }
    };
    for (int item = thread; item < 8 * half; item += threads) {  // over every eighth point
        const int c = item & (half - 1), j = item >> bits;
        Number r[8], m[8];
        for (int i = 0; i < 8; ++i) {
            const int k = 8 * i + j;
            const bool there = i < parts && k < rows;
            r[i] = there ? in[k * from_row + c] : Number(0);
            m[i] = there ? in[k * from_row + c + half] : Number(0);
        }
        if (parts == 8)
            fft8(r, m);
        else
            fft4(r, m, 0, 1);
        for (int i = 0; i < 8; ++i)
            if (i < parts) {
                const wp::vec_t<2, Number> v = w[turn * i * j];
                const int at = (8 * i + j) * half + c;
                zr[at] = r[i] * v[0] - m[i] * v[1];
                zi[at] = r[i] * v[1] + m[i] * v[0];
            }
    }
    WAIT;
    for (int item = thread; item < parts * half; item += threads) {  // over the eight that are left, in place
        const int at = (item >> bits) * 8 * half + (item & (half - 1));
        Number r[8], m[8];
        for (int i = 0; i < 8; ++i)
            r[i] = zr[at + i * half], m[i] = zi[at + i * half];
        fft8(r, m);
        for (int i = 0; i < 8; ++i)
            zr[at + i * half] = r[i], zi[at + i * half] = m[i];
    }
    WAIT;
    for (int item = thread; item < n / 2 * half; item += threads) {  // Hartley coefficients, transposed
        const int c = item & (half - 1), k = item >> bits, mirror = k ? n - k : n / 2;
        const int at = (8 * (k & (parts - 1)) + (k >> parts_bits)) * half + c;
        const int across = (8 * (mirror & (parts - 1)) + (mirror >> parts_bits)) * half + c;
        const Number xr = zr[at], xi = zi[at], yr = zr[across], yi = zi[across];
        const int near = (k - first) & (n - 1), far = (mirror - first) & (n - 1);
        if (near < rows_out) {
            result[c * to_row + near] = k ? xr + yr - xi + yi : 2 * xr;
            result[(c + half) * to_row + near] = k ? xi + yi + xr - yr : 2 * xi;
        }
        if (far < rows_out) {
            result[c * to_row + far] = k ? xr + yr + xi - yi : 2 * yr;
            result[(c + half) * to_row + far] = k ? xi + yi - xr + yr : 2 * yi;
        }
    }
    WAIT;
#undef WAIT
"""
