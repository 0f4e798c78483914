"""Crosstalk between the taxels of a grid: each reading leaks into those of its neighbours.

A kernel that is the product of a column and a row except in its middle, such as the Gaussian, is applied along the rows
and then along the columns: a kernel of 33 x 33 taxels then takes 66 products for each taxel instead of 1089.
"""

# pyright: reportArgumentType=false, reportAssignmentType=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools
import math
from collections.abc import Iterator

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.base.options import numbers
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.laws import is_on
from tactemu.imperfections.options import ChainOptions
from tactemu.plan.launches import Launch, in_turn
from tactemu.plan.plan import Context, Stage
from tactemu.plan.scalars import natural

MAX_SIGMA_PITCHES = 100
"""Widest Gaussian, in pitches of the taxels; bounds the size of its kernel."""
Lines = tuple[np.ndarray, np.ndarray, float]
"""The weights of a kernel along a column and along a row, and the excess of its middle over their product."""
_PLANES = {
    # channels: {planes in the kernel: (plane of the normal part or of a scalar, plane of the shear part)}
    "scalar": {1: (0, 0), 2: (0, 0), 3: (0, 0)},
    "force": {1: (0, 0), 2: (0, 1), 3: (0, 1)},
    "displacement": {1: (0, 0), 2: (0, 1), 3: (0, 1)},
    "torque": {1: (0, 0), 2: (1, 1), 3: (2, 2)},
}


@functools.cache
def _part_function(real: type, width: int):
    """Return the Warp function ``part(x, e, i, first) -> vector``: ``width`` channels of a taxel from ``first`` on."""
    vector = wp.types.vector(width, real)

    @wp.func
    def part(x: wp.array3d(dtype=real), e: int, i: int, first: int) -> vector:
        v = vector()
        for k in range(width):
            v[k] = x[e, i, first + k]
        return v

    return part


@functools.cache
def _kernel(real: type, width: int, split: bool, conserving: bool):
    """Return the kernel of the zero-padded cross-correlation of groups of ``width`` channels.

    It has one thread per taxel and group. ``split``: normal and shear part of a vector have planes of their own.
    """
    vector, part = wp.types.vector(width, real), _part_function(real, width)

    @warp_kernel
    def crosstalk(
        first_env: int,
        x: wp.array3d(dtype=real),
        columns: int,
        planes: wp.array3d(dtype=real),
        kept: wp.array2d(dtype=real),
        groups: wp.array2d(dtype=wp.int32),
        normal: vector,
        is_filler: wp.array(dtype=wp.uint8),
        out: wp.array3d(dtype=real),
    ):
        e, i, g = wp.tid()
        e += first_env
        first, p, q = groups[g, 0], groups[g, 1], groups[g, 2]
        row, col, rows = i // columns, i % columns, x.shape[1] // columns
        up, left = planes.shape[1] // 2, planes.shape[2] // 2
        pushed, total = real(0.0), vector()
        if is_filler[i] == wp.uint8(0):
            for a in range(wp.max(0, up - row), wp.min(planes.shape[1], rows - row + up)):
                start = (row + a - up) * columns + col - left
                for b in range(wp.max(0, left - col), wp.min(planes.shape[2], columns - col + left)):
                    v = part(x, e, start + b, first)
                    if wp.static(split):
                        n = wp.dot(v, normal)
                        pushed += planes[p, a, b] * n
                        v -= n * normal
                    total += planes[q, a, b] * v
            if wp.static(conserving):
                v = part(x, e, i, first)
                if wp.static(split):
                    n = wp.dot(v, normal)
                    pushed += kept[p, i] * n
                    v -= n * normal
                total += kept[q, i] * v
            if wp.static(split):
                total += pushed * normal
        for k in range(width):
            out[e, i, first + k] = total[k]

    return crosstalk


@functools.cache
def _line_kernel(real: type, width: int, last: bool, conserving: bool):
    """Return the kernel of one of the two passes of a separable kernel; the ``last`` adds the taxels' own shares."""
    vector, part = wp.types.vector(width, real), _part_function(real, width)

    @warp_kernel
    def crosstalk_along(
        first_env: int,
        x: wp.array3d(dtype=real),
        step: int,  # from a taxel to its neighbour in the line
        count: int,  # taxels in a line
        weights: wp.array(dtype=real),
        own: wp.array3d(dtype=real),  # each taxel's own reading
        centre: real,
        kept: wp.array2d(dtype=real),
        is_filler: wp.array(dtype=wp.uint8),
        out: wp.array3d(dtype=real),
    ):
        e, i = wp.tid()
        e = natural(e + first_env)
        i = natural(i)
        reach = weights.shape[0] // 2
        place = (i // step) % count
        total = vector()
        a = wp.max(0, reach - place)
        end = wp.min(weights.shape[0], count - place + reach)
        while a < end:  # Warp's ranges are slower on a CPU
            total += weights[natural(a)] * part(x, e, natural(i + (a - reach) * step), 0)
            a += 1
        if wp.static(last):
            if is_filler[i] == wp.uint8(0):
                keeps = centre
                if wp.static(conserving):
                    keeps += kept[0, i]
                total += keeps * part(own, e, i, 0)
            else:
                total = vector()
        for k in range(width):
            out[e, i, k] = total[k]

    return crosstalk_along


def separated(plane: np.ndarray) -> Lines | None:
    """Return ``(down, along, centre)`` if a plane ``(kh, kw)`` is ``outer(down, along)`` plus ``centre`` in its middle.

    Return ``None`` for any other plane, for one whose product is so much larger than the plane that float32 would lose
    digits, and for a single row or column, which needs one pass only.
    """
    middle, largest = tuple(s // 2 for s in plane.shape), np.abs(plane).max()
    beside = np.abs(plane)
    beside[middle[0]] = beside[:, middle[1]] = 0.0
    row, column = np.unravel_index(np.argmax(beside), beside.shape)
    if not beside[row, column]:
        return None
    # The row is scaled before any division, since beside its middle a narrow Gaussian is below 1e-100.
    along = plane[row] / np.abs(plane[row]).max()
    if not along[column]:
        return None
    down = plane[:, column] / along[column]
    product = np.outer(down, along)
    residue = plane - product
    centre, residue[middle] = float(residue[middle]), 0.0
    good = np.abs(product).max() <= 16 * largest and np.abs(residue).max() <= 1e-12 * largest
    return (down, along, centre) if good else None


def gaussian_plane(strength: float, sigma: float, spacing: tuple[float, float], layout: tuple[int, ...]) -> np.ndarray:
    """Return ``strength * G + (1 - strength) * delta``, G a Gaussian of sum 1 out to 3 sigma; shape ``(kh, kw)``.

    Args:
        strength: share of a reading that is spread.
        sigma: standard deviation of the Gaussian [m].
        spacing: distance between columns and between rows [m].
        layout: rows and columns of the taxels.
    """
    axes = []
    for pitch, n in zip(reversed(spacing), layout):
        # A quotient that is an integer up to rounding must not enlarge the kernel by one.
        radius = 0 if n == 1 else max(1, math.ceil(3.0 * sigma / pitch - 1e-9))
        axes.append(np.exp(-0.5 * (np.arange(-radius, radius + 1) * (pitch if n > 1 else 0.0) / sigma) ** 2))
    plane = np.outer(*axes)
    plane *= strength / plane.sum()
    plane[tuple(s // 2 for s in plane.shape)] += 1.0 - strength
    return plane


def planes(options: ChainOptions, info: ReadingInfo) -> np.ndarray | None:
    """Return the kernel's planes, float64, shape ``(1, 2 or 3, kh, kw)``; ``None`` without crosstalk.

    Raises:
        SceneError: the layout is no grid, the kernel has an even size, or a Gaussian lacks sigma or pitch.
    """
    explicit, strength = options.crosstalk_kernel, is_on(options.crosstalk_strength)
    if explicit is None and not strength:
        return None
    where = f"sensor {info.name!r}: "
    if len(info.layout) != 2:
        raise SceneError(f"{where}crosstalk needs a (rows, cols) layout, got {info.layout}")
    if explicit is None:
        if not options.crosstalk_sigma > 0.0 or info.spacing is None:
            raise SceneError(f"{where}crosstalk_strength needs crosstalk_sigma > 0 [m] and a regular grid")
        if options.crosstalk_sigma > MAX_SIGMA_PITCHES * min(info.spacing):
            raise SceneError(
                f"{where}crosstalk_sigma must be at most {MAX_SIGMA_PITCHES} pitches, got {options.crosstalk_sigma:g} m"
            )
        return gaussian_plane(options.crosstalk_strength, options.crosstalk_sigma, info.spacing, info.layout)[None]
    if strength:
        raise SceneError(f"{where}give crosstalk_strength or crosstalk_kernel, not both")
    kernel = numbers(f"sensor {info.name!r}", "crosstalk_kernel", explicit)
    kernel = kernel[None] if kernel.ndim == 2 else kernel
    if kernel.ndim != 3 or not 1 <= len(kernel) <= 3 or any(s % 2 == 0 for s in kernel.shape[1:]):
        raise SceneError(f"{where}crosstalk_kernel must be 1 to 3 planes of odd size, got shape {kernel.shape}")
    if len(kernel) > 1 and info.normal is None and set(info.channels) != {"scalar"}:
        raise SceneError(f"{where}a crosstalk_kernel with {len(kernel)} planes needs a plane grid, for its normal")
    return kernel


def retained_shares(kernel: np.ndarray, layout: tuple[int, int], filler: np.ndarray) -> np.ndarray:
    """Return the share of each taxel's reading that would leave the grid or fall on a filler.

    The shape is ``(planes, n_taxels)``.
    """
    rows, cols = layout
    up, left = kernel.shape[1] // 2, kernel.shape[2] // 2
    present = np.pad(~filler.reshape(layout), ((up, up), (left, left)))
    kept = np.repeat(kernel.sum(axis=(1, 2)), rows * cols).reshape(len(kernel), rows, cols)
    for a, b in np.ndindex(*kernel.shape[1:]):
        # Relative to the centre, the taxel at j adds to the one at j - (a, b).
        landed = present[2 * up - a : 2 * up - a + rows, 2 * left - b : 2 * left - b + cols]
        kept -= kernel[:, a, b, None, None] * landed
    return kept.reshape(len(kernel), -1)


def _groups(channels: tuple[str, ...], n_planes: int) -> dict[int, np.ndarray]:
    """Return the groups of channels by width, as rows (first channel, plane of normal part, plane of shear part)."""
    widths = [1 if kind == "scalar" else 3 for kind in channels]
    if n_planes == 1:
        return {sum(widths): np.array([(0, 0, 0)])}
    groups, first = {}, 0
    for kind, width in zip(channels, widths):
        groups.setdefault(width, []).append((first, *_PLANES[kind][n_planes]))
        first += width
    return {width: np.array(rows) for width, rows in groups.items()}


def compile_crosstalk(
    options: ChainOptions, x: wp.array, info: ReadingInfo, context: Context
) -> tuple[wp.array, list[Stage]]:
    """Return readings ``(n_envs, n_taxels, n_channels)`` with crosstalk, and the stage, or ``x`` without a stage."""
    kernel = planes(options, info)
    if kernel is None:
        return x, []
    real, device = context.real, context.device
    kept = retained_shares(kernel, info.layout, info.filler) if options.crosstalk_conserving else np.zeros((1, 1))
    kept = wp.array(kept, dtype=real, device=device)
    filler = wp.array(info.filler.astype(np.uint8), dtype=wp.uint8, device=device)
    out = context.zeros(x.shape, real)
    lines = separated(kernel[0]) if len(kernel) == 1 else None
    if lines is None:
        launches = _direct(kernel, options, info, context, x, kept, filler, out)
    else:
        launches = _in_lines(lines, options, info, context, x, kept, filler, out)
    reason = f"crosstalk over {kernel.shape[1]} x {kernel.shape[2]} taxels, {len(kernel)} plane(s)"
    return out, [Stage(name=f"{info.name}: crosstalk", reason=reason, launch=in_turn(*launches))]


def _direct(
    kernel: np.ndarray, options: ChainOptions, info: ReadingInfo, context: Context, x, kept, filler, out
) -> Iterator[Launch]:
    """Yield a launch per width of groups, which sums the kernel's taxels for each taxel."""
    real, device = context.real, context.device
    taxels = wp.array(kernel, dtype=real, device=device)
    for width, groups in _groups(info.channels, len(kernel)).items():
        split = bool((groups[:, 1] != groups[:, 2]).any())
        along = info.normal if split and info.normal is not None else np.zeros(width)
        normal = wp.types.vector(width, real)(*along)
        places = wp.array(groups, dtype=wp.int32, device=device)
        made = _kernel(real, width, split, options.crosstalk_conserving)
        dim = (context.n_envs, info.n_taxels, len(groups))
        yield context.record(made, dim, [x, info.layout[1], taxels, kept, places, normal, filler], [out])


def _in_lines(
    lines: Lines, options: ChainOptions, info: ReadingInfo, context: Context, x, kept, filler, out
) -> Iterator[Launch]:
    """Yield the launch along the rows, then the one along the columns."""
    (down, along, centre), (rows, columns), real = lines, info.layout, context.real
    between = context.zeros(x.shape, real)
    for source, step, count, weights, target in ((x, 1, columns, along, between), (between, columns, rows, down, out)):
        weights = wp.array(weights, dtype=real, device=context.device)
        made = _line_kernel(real, x.shape[2], target is out, options.crosstalk_conserving)
        inputs = [source, step, count, weights, x, centre, kept, filler]
        yield context.record(made, (context.n_envs, info.n_taxels), inputs, [target])
