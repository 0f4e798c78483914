"""Dilation on a regular grid on a CPU: the two passes of :mod:`.dilation_grid` as products of small matrices, of which
eight rows by eight columns stay in vector registers."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.geometry.simd import padded_length, vector_prelude


def scratch_numbers(rows: int, cols: int, n_all: int) -> int:
    """Return the number of scratch values of a thread for a grid: depth, its power, and the sums over rows of all
    terms."""
    return (2 + n_all) * padded_length(rows) * padded_length(cols)


@functools.cache
def dilation_kernel(real):
    """Return the kernel that gives a thread a share of the environments; ``row_terms`` and ``col_terms`` are one
    register longer than needed."""
    vec3 = wp.types.vector(3, real)
    numbers, table = wp.array2d(dtype=real), wp.array(dtype=real)

    @wp.func_native(vector_prelude(real) + _DILATE)
    def dilate(
        depth: numbers,
        power: numbers,
        box: wp.array(dtype=wp.int32),
        row_terms: numbers,
        col_terms: numbers,
        n_terms: int,
        scratch: table,
        u_axis: vec3,
        v_axis: vec3,
        normal: vec3,
        is_sensing: wp.array2d(dtype=wp.bool),
        motion: wp.array2d(dtype=vec3),
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def dilate_grids(
        turns: wp.vec4i,  # first environment, end, first slot, slots that take turns
        depth: wp.array3d(dtype=real),
        power: wp.array3d(dtype=real),
        box: wp.array2d(dtype=wp.int32),
        row_terms: numbers,
        col_terms: numbers,
        n_terms: int,
        u_axis: vec3,
        v_axis: vec3,
        normal: vec3,
        is_sensing: wp.array2d(dtype=wp.bool),
        scratch: numbers,
        # outputs
        motion: wp.array3d(dtype=vec3),
    ):
        place, _thread = wp.tid()
        for env in range(turns[0] + place, turns[1], turns[3]):
            dilate(
                depth[env],
                power[env],
                box[env],
                row_terms,
                col_terms,
                n_terms,
                scratch[turns[2] + place],
                u_axis,
                v_axis,
                normal,
                is_sensing,
                motion[env],
            )

    return dilate_grids


_DILATE = """
    const int rows = depth.shape[0], cols = depth.shape[1], all_rows = (rows + wide - 1) / wide * wide;
    const bool touched = box.data[0] <= box.data[1];
    const int top = touched ? box.data[0] : 0, deep = touched ? box.data[1] + 1 - top : 0;
    const int left = touched ? box.data[2] : 0, across = touched ? box.data[3] + 1 - left : 0;
    const int stride = (across + wide - 1) / wide * wide;  // of the box
    Number* const pressed = scratch.data;
    Number* const raised = pressed + deep * stride;
    Number* const partial = raised + deep * stride;
    for (int k = 0; k < deep; ++k)
        for (int c = 0; c < stride; ++c) {
            const int64_t at = (k + top) * int64_t(cols) + left + c;
            pressed[k * stride + c] = c < across ? depth.data[at] : Number(0);
            raised[k * stride + c] = c < across ? power.data[at] : Number(0);
        }
    // An eight-by-eight block of a matrix product: factors have the row stride ``apart``, lines the stride ``to_next``.
    auto gather = [&](Vector* sums, const Number* factors, const int64_t apart, const int step,
                      const Number* lines, const int64_t to_next, const int count) {
        Vector a = sums[0], b = sums[1], c = sums[2], d = sums[3], e = sums[4], f = sums[5], g = sums[6], h = sums[7];
        for (int k = 0; k < count; ++k) {
            const Vector line = get(lines + k * to_next);
            const Number* const x = factors + k * step;
            a += line * x[0], b += line * x[apart], c += line * x[2 * apart], d += line * x[3 * apart];
            e += line * x[4 * apart], f += line * x[5 * apart], g += line * x[6 * apart], h += line * x[7 * apart];
        }
        sums[0] = a, sums[1] = b, sums[2] = c, sums[3] = d, sums[4] = e, sums[5] = f, sums[6] = g, sums[7] = h;
    };
    for (int term = 0; term <= 2 * n_terms; ++term) {
        const Number* const source = term < 2 * n_terms ? pressed : raised;
        const Number* const factors = row_terms.data + term * int64_t(row_terms.shape[1]) + rows - 1 - top;
        for (int i = 0; i < all_rows; i += wide)
            for (int c = 0; c < stride; c += wide) {
                Vector sums[wide] = {};
                gather(sums, factors + i, 1, -1, source + c, stride, deep);
                for (int m = 0; m < wide; ++m)
                    put(partial + (term * int64_t(all_rows) + i + m) * stride + c, sums[m]);
            }
    }
    for (int i = 0; i < all_rows; i += wide)
        for (int c = 0; c < cols; c += wide) {
            Vector sums[3][wide] = {};
            for (int term = 0; term <= 2 * n_terms; ++term) {
                const Number* const lines = col_terms.data + term * int64_t(col_terms.shape[1]) + cols - 1 - left + c;
                const Number* const factors = partial + (term * int64_t(all_rows) + i) * stride;
                gather(sums[term / n_terms], factors, stride, 1, lines, -1, across);
            }
            for (int m = 0; m < wide && i + m < rows; ++m) {
                Number moved[3][wide];
                for (int axis = 0; axis < 3; ++axis)
                    put(moved[axis], sums[0][m] * u_axis[axis] + sums[1][m] * v_axis[axis] + sums[2][m] * normal[axis]);
                for (int l = 0; l < wide && c + l < cols; ++l) {
                    const int64_t at = (i + m) * int64_t(cols) + c + l;
                    for (int axis = 0; axis < 3; ++axis)
                        motion.data[at][axis] = is_sensing.data[at] ? moved[axis][l] : Number(0);
                }
            }
        }
"""
