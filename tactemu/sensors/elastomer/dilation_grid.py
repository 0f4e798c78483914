"""Dilation on a regular grid: two passes of separable weights over the contact's bounding box.

Pass 1 sums over rows, for every column in contact; pass 2 over columns. On a GPU one thread computes ``WIDTH`` rows of
a column, so that neighbouring threads read neighbouring memory. The version for a CPU is :mod:`.dilation_simd`.
"""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.vector_io import vector_writer
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Context
from tactemu.sensors.elastomer.dilation_kernels import (
    DilationArrays,
    DilationOptions,
    blend,
    gaussian_peak,
    radial_layer,
    spectral_layer,
)
from tactemu.sensors.elastomer.dilation_simd import dilated_grid_type, dilation_kernel, scratch_numbers
from tactemu.sensors.elastomer.separable import overlapping_blocks, separable_terms
from tactemu.sensors.probe_grid import Grid

WIDTH = 8
"""Number of rows of a grid that one thread computes."""
BLOCK = 256
"""Number of threads of a block on a GPU; the number of blocks that a multiprocessor holds at once limits their
registers."""
_TOLERANCE = {wp.float32: 1e-7, wp.float64: 1e-13}
"""Largest error of the separable form, as a fraction of its strongest term."""
_NEGLIGIBLE = 1e-30
"""Smaller weights, as a fraction of the largest, count as 0: subnormal numbers are slow."""


def _offsets(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return the signed offsets (u, v) [m], shape ``(2 rows - 1, 2 cols - 1)`` each."""
    v, u = np.meshgrid(
        np.arange(1 - grid.rows, grid.rows) * grid.dv, np.arange(1 - grid.cols, grid.cols) * grid.du, indexing="ij"
    )
    return u, v


def _periodic_layer(grid: Grid, thickness: float) -> tuple[np.ndarray, float]:
    """Return the layer's planes (u, v) at the grid's offsets as Genesis computes them, and their peak."""
    ny, nx = (1 << (2 * n - 2).bit_length() for n in (grid.rows, grid.cols))
    planes = spectral_layer((ny, nx), (grid.du, grid.dv), thickness)
    rows, cols = np.arange(1 - grid.rows, grid.rows), np.arange(1 - grid.cols, grid.cols)
    return planes[:, rows[:, None], cols], float(np.hypot(*planes).max())


def _free_layer(grid: Grid, thickness: float, area: float) -> tuple[np.ndarray, float]:
    """Return the layer's planes in an unbounded plane, per taxel, and their peak per area."""
    u, v = _offsets(grid)
    rho = np.hypot(u, v)
    weight = radial_layer(rho, thickness) / np.where(rho > 0, rho, 1.0)
    peak = float(radial_layer(np.linspace(0.0, 8.0, 512) * thickness, thickness).max())
    return area * np.stack([u * weight, v * weight]), peak


def far_planes(grid: Grid, options: DilationOptions) -> tuple[np.ndarray, float]:
    """Return the far-reaching weight times the offset, planes (u, v) at signed offsets, and the peak for a blend."""
    area = grid.du * grid.dv if options.area_weighted else 1.0
    if options.uses_layer and options.area_weighted:
        return _free_layer(grid, options.elastomer_thickness, area)
    if options.uses_layer:
        return _periodic_layer(grid, options.elastomer_thickness)
    u, v = _offsets(grid)
    eps = 0.5 * (grid.du + grid.dv)
    weight = area / (u * u + v * v + eps * eps)
    return np.stack([u * weight, v * weight]), 1.0 / (2.0 * eps)


def plane_terms(grid: Grid, options: DilationOptions, tolerance: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the separable terms of the planes (u, v, normal): rows and columns each, see :func:`separable_terms`."""
    u, v = _offsets(grid)
    area = grid.du * grid.dv if options.area_weighted else 1.0
    row = np.exp(-options.lambda_d * v[:, 0] ** 2)[None]
    col = np.exp(-options.lambda_d * u[0] ** 2)[None]
    if options.compressibility >= 1.0:
        terms = [(row, col * u[0] * area), (row * v[:, 0], col * area)]
    else:
        planes, peak = far_planes(grid, options)
        local, far = blend(options.compressibility, gaussian_peak(options.lambda_d), peak)
        gaussian = local * area * row.T * col
        terms = [separable_terms(gaussian * o + far * p, tolerance) for o, p in zip((u, v), planes)]
    return [*terms, (row, col * area)]


@functools.cache
def _sum_function(real, number_axes: int, block_axes: int):
    """Return ``add(total, count, numbers, number, number_step, blocks, block, block_step)``.

    It adds ``count`` products of a number and a block. The first are those at the flat indices ``number`` and
    ``block``, the next are so many steps further. The arrays must be contiguous: with their strides, addresses took
    more instructions and registers than the sum.
    """
    block_type = wp.types.vector(WIDTH, real)
    number_array, block_array = wp.array(dtype=real, ndim=number_axes), wp.array(dtype=block_type, ndim=block_axes)

    @wp.func_native(_SUM.replace("NUMBER", real.__name__).replace("WIDTH", str(WIDTH)))
    def add(
        total: block_type,
        count: int,
        numbers: number_array,
        number: wp.int64,
        number_step: int,
        blocks: block_array,
        block: wp.int64,
        block_step: int,
    ) -> block_type: ...

    return add


_SUM = """
    struct alignas(16) Wide { wp::NUMBER numbers[WIDTH]; };
    const wp::NUMBER* factor = numbers.data + number;
    const Wide* from = reinterpret_cast<const Wide*>(blocks.data) + block;
#pragma unroll 4
    for (int k = 0; k < count; ++k, factor += number_step, from += block_step) {
        const wp::NUMBER by = *factor;
        const Wide given = *from;
        for (int m = 0; m < WIDTH; ++m)
            total[m] += by * given.numbers[m];
    }
    return total;
"""


@functools.cache
def _kernels(real):
    vec3, grid_struct = wp.types.vector(3, real), dilated_grid_type(real)
    block, store = wp.types.vector(WIDTH, real), vector_writer(real, WIDTH)
    add_rows, add_columns = _sum_function(real, 3, 2), _sum_function(real, 2, 4)

    @warp_kernel(launch_bounds=(BLOCK, 6))
    def sum_rows(
        first_env: int, grid: grid_struct, row_blocks: wp.array2d(dtype=block), partial: wp.array4d(dtype=block)
    ):
        env, term, i_block, col = wp.tid()
        env += first_env
        if col < grid.box[env, 2] or col > grid.box[env, 3]:
            return
        first = grid.box[env, 0]
        count = grid.box[env, 1] + 1 - first
        rows = grid.depth.shape[1]
        cols = grid.depth.shape[2]
        source = (wp.int64(env) * wp.int64(rows) + wp.int64(first)) * wp.int64(cols) + wp.int64(col)
        weight = wp.int64(term * row_blocks.shape[1] + i_block * WIDTH + rows - 1 - first)
        total = block()
        if term < 2 * grid.n_terms:
            total = add_rows(total, count, grid.depth, source, cols, row_blocks, weight, -1)
        else:
            total = add_rows(total, count, grid.power, source, cols, row_blocks, weight, -1)
        store(partial, env, term, i_block, col, total)

    @warp_kernel(launch_bounds=(BLOCK, 4))
    def sum_columns(
        first_env: int, grid: grid_struct, col_terms: wp.array2d(dtype=real), partial: wp.array4d(dtype=block)
    ):
        env, i_block, col = wp.tid()
        env += first_env
        first = grid.box[env, 2]
        count = grid.box[env, 3] + 1 - first
        n_terms = grid.n_terms
        cols = partial.shape[3]
        weight = wp.int64(col + cols - 1 - first)
        width = wp.int64(col_terms.shape[1])
        source = wp.int64(env) * wp.int64(partial.shape[1])
        source = (source * wp.int64(partial.shape[2]) + wp.int64(i_block)) * wp.int64(cols) + wp.int64(first)
        size = wp.int64(partial.shape[2] * cols)
        u = block()
        v = block()
        w = block()
        for _ in range(n_terms):
            u = add_columns(u, count, col_terms, weight, -1, partial, source, 1)
            weight += width
            source += size
        for _ in range(n_terms):
            v = add_columns(v, count, col_terms, weight, -1, partial, source, 1)
            weight += width
            source += size
        w = add_columns(w, count, col_terms, weight, -1, partial, source, 1)
        for m in range(WIDTH):
            row = i_block * WIDTH + m
            if row < grid.motion.shape[1]:
                marker = u[m] * grid.u + v[m] * grid.v + w[m] * grid.normal
                if not grid.is_sensing[row, col]:
                    marker = vec3(real(0.0))
                grid.motion[env, row, col] = marker

    return sum_rows, sum_columns


def grid_dilation(
    context: Context,
    grid: Grid,
    options: DilationOptions,
    *,
    scale: float,
    arrays: DilationArrays,
    box: wp.array,
) -> Callable[[], None]:
    """Record the two passes.

    Args:
        scale: factor on the motion (``dilate_scale``).
        arrays: the input and the output.
        box: first and last row, first and last column in contact, int32, shape ``(n_envs, 4)``; first > last without
            contact.
    """
    real = context.real
    (row_u, col_u), (row_v, col_v), (row_n, col_n) = plane_terms(grid, options, _TOLERANCE[real])
    n_terms = max(len(row_u), len(row_v))

    def stack(u, v, n):
        padded = [np.pad(part, ((0, n_terms - len(part)), (0, 0))) for part in (u, v)]
        values = np.concatenate([*padded, n])
        values[np.abs(values) < _NEGLIGIBLE * np.abs(values).max()] = 0.0
        return values

    vec3, as_grid = wp.types.vector(3, real), (context.n_envs, grid.rows, grid.cols)
    dilated = dilated_grid_type(real)()
    dilated.depth, dilated.power = arrays.depth.reshape(as_grid), arrays.power.reshape(as_grid)
    dilated.box, dilated.n_terms = box, n_terms
    dilated.u, dilated.v, dilated.normal = (vec3(*(scale * axis)) for axis in (grid.u, grid.v, grid.normal))
    dilated.is_sensing, dilated.motion = arrays.is_sensing.reshape(as_grid[1:]), arrays.motion.reshape(as_grid)
    passes = _simd if context.device.is_cpu else _two_passes
    return passes(context, dilated, stack(row_u, row_v, row_n), stack(col_u, col_v, col_n))


def _two_passes(context: Context, dilated, row_terms: np.ndarray, col_terms: np.ndarray) -> Callable[[], None]:
    """Record the passes on a GPU: a thread for each block of rows and column."""
    real, device = context.real, context.device
    n_envs, rows, cols = dilated.motion.shape
    block, n_blocks = wp.types.vector(WIDTH, real), -(-rows // WIDTH)
    row_blocks = wp.array(overlapping_blocks(row_terms, WIDTH), dtype=block, device=device)
    partial = context.zeros((n_envs, len(row_terms), n_blocks, cols), block)
    sum_rows, sum_columns = _kernels(real)
    first = context.record(sum_rows, partial.shape, [dilated, row_blocks], [partial])
    columns = wp.array(col_terms, dtype=real, device=device)
    return in_turn(first, context.record(sum_columns, (n_envs, n_blocks, cols), [dilated, columns, partial], []))


def _simd(context: Context, dilated, row_terms: np.ndarray, col_terms: np.ndarray) -> Callable[[], None]:
    """Record the passes on a CPU: both passes of an environment in one thread."""
    padded = [np.pad(part, ((0, 0), (0, WIDTH))) for part in (row_terms, col_terms)]
    tables = [wp.array(part, dtype=context.real, device=context.device) for part in padded]
    _, rows, cols = dilated.motion.shape
    size = scratch_numbers(rows, cols, len(row_terms))
    scratch = wp.zeros((context.threads, size), dtype=context.real, device=context.device)
    kernel = dilation_kernel(context.real)
    return context.record_blocks(kernel, context.threads, [dilated, *tables, scratch], [], 1)
