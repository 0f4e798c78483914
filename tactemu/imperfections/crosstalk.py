"""Crosstalk between the taxels of a grid: each reading leaks into its neighbours'."""

import functools
import math

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.laws import is_on
from tactemu.imperfections.options import ImperfectionOptions
from tactemu.physics.plan import Context, Stage, record

_PLANES = {
    # channels: {planes in the kernel: (plane of the normal part or of a scalar, plane of the shear part)}
    "scalar": {1: (0, 0), 2: (0, 0), 3: (0, 0)},
    "force": {1: (0, 0), 2: (0, 1), 3: (0, 1)},
    "displacement": {1: (0, 0), 2: (0, 1), 3: (0, 1)},
    "torque": {1: (0, 0), 2: (1, 1), 3: (2, 2)},
}


@functools.cache
def _kernel(real: type, conserving: bool):
    """Zero-padded cross-correlation of each group of channels with its planes; one thread per taxel and group."""
    vec3 = wp.types.vector(3, real)

    @wp.func
    def triple(x: wp.array3d(dtype=real), e: int, i: int, first: int) -> vec3:
        return vec3(x[e, i, first], x[e, i, first + 1], x[e, i, first + 2])

    @wp.kernel(module="unique", enable_backward=False)
    def crosstalk(
        x: wp.array3d(dtype=real),
        columns: int,
        planes: wp.array3d(dtype=real),
        kept: wp.array2d(dtype=real),
        groups: wp.array2d(dtype=wp.int32),
        normal: vec3,
        is_filler: wp.array(dtype=wp.uint8),
        out: wp.array3d(dtype=real),
    ):
        e, i, g = wp.tid()
        first, width, p, q = groups[g, 0], groups[g, 1], groups[g, 2], groups[g, 3]
        row, col, rows = i // columns, i % columns, x.shape[1] // columns
        up, left = planes.shape[1] // 2, planes.shape[2] // 2
        scalar, pushed, sheared = real(0.0), real(0.0), vec3()
        for a in range(wp.max(0, up - row), wp.min(planes.shape[1], rows - row + up)):
            for b in range(wp.max(0, left - col), wp.min(planes.shape[2], columns - col + left)):
                j = (row + a - up) * columns + col + b - left
                if width == 1:
                    scalar += planes[p, a, b] * x[e, j, first]
                else:
                    f = triple(x, e, j, first)
                    if p != q:
                        n = wp.dot(f, normal)
                        pushed += planes[p, a, b] * n
                        f -= n * normal
                    sheared += planes[q, a, b] * f
        if wp.static(conserving):
            if width == 1:
                scalar += kept[p, i] * x[e, i, first]
            else:
                f = triple(x, e, i, first)
                if p != q:
                    n = wp.dot(f, normal)
                    pushed += kept[p, i] * n
                    f -= n * normal
                sheared += kept[q, i] * f
        if is_filler[i] != wp.uint8(0):
            scalar, pushed, sheared = real(0.0), real(0.0), vec3()
        if width == 1:
            out[e, i, first] = scalar
        else:
            sheared += pushed * normal
            for k in range(3):
                out[e, i, first + k] = sheared[k]

    return crosstalk


def gaussian_plane(strength: float, sigma: float, spacing: tuple[float, float], layout: tuple[int, ...]) -> np.ndarray:
    """``strength * G + (1 - strength) * delta``, G a Gaussian of sum 1 out to 3 sigma; shape ``(kh, kw)``.

    Args:
        spacing: distance between columns and between rows [m].
    """
    axes = []
    for pitch, n in zip(reversed(spacing), layout):
        # A quotient that is whole up to rounding must not grow the kernel by one.
        radius = 0 if n == 1 else max(1, math.ceil(3.0 * sigma / pitch - 1e-9))
        axes.append(np.exp(-0.5 * (np.arange(-radius, radius + 1) * (pitch if n > 1 else 0.0) / sigma) ** 2))
    plane = np.outer(*axes)
    plane *= strength / plane.sum()
    plane[tuple(s // 2 for s in plane.shape)] += 1.0 - strength
    return plane


def planes(options: ImperfectionOptions, info: ReadingInfo) -> np.ndarray | None:
    """The kernel's planes, float64, shape ``(1, 2 or 3, kh, kw)``; ``None`` without crosstalk.

    Raises:
        SceneError: a layout that is no grid, an even-sized kernel, a Gaussian without sigma or pitch.
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
        return gaussian_plane(options.crosstalk_strength, options.crosstalk_sigma, info.spacing, info.layout)[None]
    if strength:
        raise SceneError(f"{where}give crosstalk_strength or crosstalk_kernel, not both")
    kernel = np.asarray(explicit, dtype=np.float64)
    kernel = kernel[None] if kernel.ndim == 2 else kernel
    if kernel.ndim != 3 or not 1 <= len(kernel) <= 3 or any(s % 2 == 0 for s in kernel.shape[1:]):
        raise SceneError(f"{where}crosstalk_kernel must be 1 to 3 planes of odd size, got shape {kernel.shape}")
    if not np.all(np.isfinite(kernel)):
        raise SceneError(f"{where}crosstalk_kernel must be finite")
    if len(kernel) > 1 and info.normal is None and set(info.channels) != {"scalar"}:
        raise SceneError(f"{where}a crosstalk_kernel with {len(kernel)} planes needs a plane grid, for its normal")
    return kernel


def kept_at_home(kernel: np.ndarray, layout: tuple[int, int], filler: np.ndarray) -> np.ndarray:
    """Share of each taxel's reading that would leave the grid or fall on a filler, shape ``(planes, n_taxels)``."""
    rows, cols = layout
    up, left = kernel.shape[1] // 2, kernel.shape[2] // 2
    present = np.pad(~filler.reshape(layout), ((up, up), (left, left)))
    kept = np.repeat(kernel.sum(axis=(1, 2)), rows * cols).reshape(len(kernel), rows, cols)
    for a, b in np.ndindex(*kernel.shape[1:]):
        # The taxel at j feeds the one at j - (a, b) from the centre.
        landed = present[2 * up - a : 2 * up - a + rows, 2 * left - b : 2 * left - b + cols]
        kept -= kernel[:, a, b, None, None] * landed
    return kept.reshape(len(kernel), -1)


def compile_crosstalk(
    options: ImperfectionOptions, x: wp.array, info: ReadingInfo, context: Context
) -> tuple[wp.array, list[Stage]]:
    """Readings ``(n_envs, n_taxels, n_channels)`` with crosstalk, and the stage; ``x`` itself without."""
    kernel = planes(options, info)
    if kernel is None:
        return x, []
    real, device = context.real, context.device
    groups, first = [], 0
    for kind in info.channels:
        width = 1 if kind == "scalar" else 3
        groups.append((first, width, *_PLANES[kind][len(kernel)]))
        first += width
    kept = kept_at_home(kernel, info.layout, info.filler) if options.crosstalk_conserving else np.zeros((1, 1))
    normal = wp.types.vector(3, real)(*(info.normal or (0.0, 0.0, 1.0)))
    out = wp.zeros(x.shape, dtype=real, device=device)
    launch = record(
        _kernel(real, options.crosstalk_conserving),
        (context.n_envs, info.n_taxels, len(groups)),
        [
            x,
            info.layout[1],
            wp.array(kernel, dtype=real, device=device),
            wp.array(kept, dtype=real, device=device),
            wp.array(np.array(groups), dtype=wp.int32, device=device),
            normal,
            wp.array(info.filler.astype(np.uint8), dtype=wp.uint8, device=device),
        ],
        [out],
        device,
    )
    reason = f"crosstalk over {kernel.shape[1]} x {kernel.shape[2]} taxels, {len(kernel)} plane(s)"
    return out, [Stage(name=f"{info.name}: crosstalk", reason=reason, launch=launch)]
