"""Transforms within a multiprocessor: on a GPU, windows of up to 32 cells never leave the block's shared memory.

A transform of 32 or 64 points is one of 4 or 8 and one of 8, each in the registers of a thread. The rest of the solvers
sees arrays as ever: those of the workspace lie in shared memory where the window's transforms fit.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp

LONGEST = 64
"""Length of the longest transform done here."""
_TOGETHER = 8
"""Complex columns at once: eight threads transform one."""
_SCRATCH = 9 * 8 * _TOGETHER
"""Numbers of one part, real or imaginary; every ninth row is skipped, lest threads crowd one bank."""
_ROW = LONGEST + 4
"""Numbers from one row to the next, for the same reason."""
_BACK_ROW = LONGEST // 2 + 4
_BETWEEN = LONGEST * _BACK_ROW
"""Numbers between two passes: ``LONGEST / 2`` whole rows there, ``LONGEST`` half ones back."""


def chip_numbers(spectra: int) -> int:
    """How many numbers of shared memory a block needs that keeps so many spectra."""
    return 2 * _SCRATCH + _BETWEEN + spectra * LONGEST * _ROW


@functools.cache
def chip_functions(real, workspace, spectra: int):
    """``move_in(ws, memory, size)``: the workspace, with its arrays in the tile ``memory`` if transforms of ``size`` fit.

    All slots share these: they are the block's own.
    """
    number = f"wp::{real.__name__}"

    @wp.func_native(f"""
    wp::array_t<{number}> found(memory.data.ptr + first, 0x7fffffff, rows, columns);
    found.strides[0] = 0;
    return found;
    """)
    def within(
        memory: wp.tile(dtype=real, shape=(chip_numbers(spectra),)), first: int, rows: int, columns: int
    ) -> wp.array3d(dtype=real): ...

    @wp.func
    def move_in(ws: workspace, memory: wp.tile(dtype=real, shape=(chip_numbers(spectra),)), size: wp.vec2i):
        near = ws
        if wp.max(size[0], size[1]) <= wp.static(LONGEST):
            near.re = within(memory, 0, 1, wp.static(_SCRATCH))
            near.im = within(memory, wp.static(_SCRATCH), 1, wp.static(_SCRATCH))
            at = wp.static(2 * _SCRATCH)
            near.between = within(memory, at, wp.static(LONGEST // 2), wp.static(_ROW))
            near.between_lanes = near.between
            near.back = within(memory, at, wp.static(LONGEST), wp.static(_BACK_ROW))
            near.back_lanes = near.back
            at += wp.static(_BETWEEN)
            near.spectrum = within(memory, at, wp.static(LONGEST), wp.static(_ROW))
            near.spectrum_lanes = near.spectrum
            if wp.static(spectra > 1):
                at += wp.static(LONGEST * _ROW)
                near.second = within(memory, at, wp.static(LONGEST), wp.static(_ROW))
                near.second_lanes = near.second
        return near

    return move_in


@functools.cache
def short_hartley(real):
    """``pass(field, rows, columns, n, first, rows_out, out, re, im, turns, thread, threads)``, as the long one
    (:mod:`.convolution`), for ``n`` of 32 or 64."""
    number = f"wp::{real.__name__}"
    field_type, turns_type = wp.array2d(dtype=real), wp.array(dtype=wp.types.vector(2, real))

    @wp.func_native(_PASS.replace("NUMBER", number).replace("TOGETHER", str(_TOGETHER)))
    def transform(
        field: field_type,
        rows: int,
        columns: int,
        n: int,
        first: int,
        rows_out: int,
        out: field_type,
        re: field_type,
        im: field_type,
        turns: turns_type,
        thread: int,
        threads: int,
    ): ...

    return transform


_PASS = """
#if defined(__CUDA_ARCH__)
#define WAIT __syncthreads()
#else
#define WAIT
#endif
    using Number = NUMBER;
    const int half = columns / 2, parts = n / 8, turn = turns.shape[0] / n;
    const int from_row = field.strides[0] / sizeof(Number), to_row = out.strides[0] / sizeof(Number);
    Number* const zr = re.data;
    Number* const zi = im.data;
    const Number root = Number(0.70710678118654752440);
    // In place, in order: elements i, i + s, i + 2 s, i + 3 s.
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
        Number tr[4], ti[4];
        tr[0] = r[1], ti[0] = m[1];
        tr[1] = root * (r[3] + m[3]), ti[1] = root * (m[3] - r[3]);
        tr[2] = m[5], ti[2] = -r[5];
        tr[3] = root * (m[7] - r[7]), ti[3] = -root * (m[7] + r[7]);
        const Number er[4] = {r[0], r[2], r[4], r[6]}, ei[4] = {m[0], m[2], m[4], m[6]};
        for (int k = 0; k < 4; ++k) {
            r[k] = er[k] + tr[k], m[k] = ei[k] + ti[k];
            r[k + 4] = er[k] - tr[k], m[k + 4] = ei[k] - ti[k];
        }
    };
    for (int begin = 0; begin < half; begin += TOGETHER) {
        for (int item = thread; item < 8 * TOGETHER; item += threads) {  // over every eighth point
            const int c = item % TOGETHER, j = item / TOGETHER, column = begin + c;
            Number r[8], m[8];
            for (int i = 0; i < 8; ++i) {
                const int k = 8 * i + j;
                const bool there = i < parts && k < rows && column < half;
                r[i] = there ? field.data[k * from_row + column] : Number(0);
                m[i] = there ? field.data[k * from_row + column + half] : Number(0);
            }
            if (parts == 8)
                fft8(r, m);
            else
                fft4(r, m, 0, 1);
            for (int i = 0; i < 8; ++i)
                if (i < parts) {
                    const wp::vec_t<2, Number> w = turns.data[turn * i * j];
                    const int at = (9 * i + j) * TOGETHER + c;
                    zr[at] = r[i] * w[0] - m[i] * w[1];
                    zi[at] = r[i] * w[1] + m[i] * w[0];
                }
        }
        WAIT;
        for (int item = thread; item < parts * TOGETHER; item += threads) {  // over what is left, in place
            const int at = item / TOGETHER * 9 * TOGETHER + item % TOGETHER;
            Number r[8], m[8];
            for (int i = 0; i < 8; ++i)
                r[i] = zr[at + i * TOGETHER], m[i] = zi[at + i * TOGETHER];
            fft8(r, m);
            for (int i = 0; i < 8; ++i)
                zr[at + i * TOGETHER] = r[i], zi[at + i * TOGETHER] = m[i];
        }
        WAIT;
        for (int item = thread; item < n / 2 * TOGETHER; item += threads) {  // Hartley coefficients, transposed
            const int c = item % TOGETHER, k = item / TOGETHER, mirror = k ? n - k : n / 2, column = begin + c;
            const int at = (9 * (k % parts) + k / parts) * TOGETHER + c;
            const int across = (9 * (mirror % parts) + mirror / parts) * TOGETHER + c;
            const Number xr = zr[at], xi = zi[at];
            const Number yr = k ? zr[across] : xr, yi = k ? zi[across] : xi;
            const int near = (k - first + n) % n, far = (mirror - first + n) % n;
            if (column < half && near < rows_out) {
                out.data[column * to_row + near] = xr + yr - xi + yi;
                out.data[(column + half) * to_row + near] = xi + yi + xr - yr;
            }
            if (column < half && far < rows_out) {
                out.data[column * to_row + far] = k ? xr + yr + xi - yi : 2 * zr[across];
                out.data[(column + half) * to_row + far] = k ? xi + yi - xr + yr : 2 * zi[across];
            }
        }
        WAIT;
    }
#undef WAIT
"""
