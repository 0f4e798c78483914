"""Dilation on a regular grid on a CPU: the two passes of :mod:`.dilation_grid` as products of small matrices, of which
eight rows by eight columns stay in vector registers."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.simd import padded_length, vector_prelude


@functools.cache
def dilated_grid_type(real):
    """Return the Warp struct of a grid whose markers are spread by the depth of its taxels."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class DilatedGrid:
        depth: wp.array3d(dtype=real)  # (n_envs, rows, columns)
        power: wp.array3d(dtype=real)  # depth ** normal_exponent
        box: wp.array2d(dtype=wp.int32)  # first and last row, first and last column in contact, per environment
        n_terms: wp.int32  # separable terms of each of the planes along u and v; that along the normal has one
        u: vec3  # axes, times the scale of the motion
        v: vec3
        normal: vec3
        is_sensing: wp.array2d(dtype=wp.bool)
        motion: wp.array3d(dtype=vec3)  # written

    return DilatedGrid


def scratch_numbers(rows: int, cols: int, n_all: int) -> int:
    """Return the number of scratch values of a thread for a grid: depth, its power, and the sums over rows of all
    terms."""
    return (2 + n_all) * padded_length(rows) * padded_length(cols)


@functools.cache
def dilation_kernel(real):
    """Return the kernel that gives a thread a share of the environments; ``row_terms`` and ``col_terms`` are one
    register longer than needed."""
    grid_struct, numbers = dilated_grid_type(real), wp.array2d(dtype=real)

    @wp.func_native(vector_prelude(real) + _DILATE)
    def dilate(env: int, grid: grid_struct, row_terms: numbers, col_terms: numbers, scratch: wp.array(dtype=real)): ...

    @warp_kernel
    def dilate_grids(turns: wp.vec4i, grid: grid_struct, row_terms: numbers, col_terms: numbers, scratch: numbers):
        place, _thread = wp.tid()
        for env in range(turns[0] + place, turns[1], turns[3]):
            dilate(env, grid, row_terms, col_terms, scratch[turns[2] + place])

    return dilate_grids


_DILATE = """
    const int rows = grid.depth.shape[1], cols = grid.depth.shape[2], all_rows = (rows + wide - 1) / wide * wide;
    const int n_terms = grid.n_terms;
    const int64_t taxels = env * int64_t(rows) * cols;
    const Number* const depth = grid.depth.data + taxels;
    const Number* const power = grid.power.data + taxels;
    auto* const motion = grid.motion.data + taxels;
    const auto* const box = grid.box.data + 4 * env;
    const bool touched = box[0] <= box[1];
    const int top = touched ? box[0] : 0, deep = touched ? box[1] + 1 - top : 0;
    const int left = touched ? box[2] : 0, across = touched ? box[3] + 1 - left : 0;
    const int stride = (across + wide - 1) / wide * wide;  // of the box
    Number* const pressed = scratch.data;
    Number* const raised = pressed + deep * stride;
    Number* const partial = raised + deep * stride;
    for (int k = 0; k < deep; ++k)
        for (int c = 0; c < stride; ++c) {
            const int64_t at = (k + top) * int64_t(cols) + left + c;
            pressed[k * stride + c] = c < across ? depth[at] : Number(0);
            raised[k * stride + c] = c < across ? power[at] : Number(0);
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
                for (int axis = 0; axis < 3; ++axis) {
                    const Vector along = sums[0][m] * grid.u[axis] + sums[1][m] * grid.v[axis];
                    put(moved[axis], along + sums[2][m] * grid.normal[axis]);
                }
                for (int l = 0; l < wide && c + l < cols; ++l) {
                    const int64_t at = (i + m) * int64_t(cols) + c + l;
                    for (int axis = 0; axis < 3; ++axis)
                        motion[at][axis] = grid.is_sensing.data[at] ? moved[axis][l] : Number(0);
                }
            }
        }
"""
