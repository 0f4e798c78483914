"""How latched points drag the markers: each by its pull, falling off as a Gaussian with the distance in the plane.

``u_i = scale sum_o exp(-lambda_s |P_i (r_i - y_o)|^2) P_i pull_o`` with ``P_i`` the projection onto the tangent plane
of marker i. On a CPU the Gaussians of a flat grid are tabulated per row and column; otherwise they are evaluated.
"""

import functools
from collections.abc import Callable

import numpy as np
import warp as wp

from tactemu.physics.plan import Context, record
from tactemu.physics.point_cloud import CLUSTER
from tactemu.physics.probe_grid import RegularGrid
from tactemu.physics.shear_anchors import Anchors

WIDTH = 8
_NEGLIGIBLE = 1.0e-30


@functools.cache
def _direct_kernel(real, add: bool):
    vec3 = wp.types.vector(3, real)

    @wp.kernel(module="unique", enable_backward=False)
    def add_shear(
        n_pulling: wp.array2d(dtype=wp.int32),
        place: wp.array2d(dtype=vec3),
        pull: wp.array2d(dtype=vec3),
        positions: wp.array(dtype=vec3),
        normals: wp.array(dtype=vec3),
        is_sensing: wp.array(dtype=wp.bool),
        scale: real,
        lambda_s: real,
        # outputs
        motion: wp.array3d(dtype=real),
    ):
        env, taxel = wp.tid()
        if not is_sensing[taxel]:
            return
        r = positions[taxel]
        n = normals[taxel]
        total = vec3(real(0.0))
        for c in range(n_pulling.shape[1]):
            first = c * CLUSTER
            for o in range(first, first + n_pulling[env, c]):
                apart = r - place[env, o]
                off_plane = wp.dot(apart, n)
                in_plane = wp.dot(apart, apart) - off_plane * off_plane
                total += wp.exp(-lambda_s * in_plane) * pull[env, o]
        total = scale * (total - wp.dot(total, n) * n)
        for k in range(3):
            if wp.static(add):
                total[k] += motion[env, taxel, k]
            motion[env, taxel, k] = total[k]

    return add_shear


@functools.cache
def _grid_kernels(real, add: bool):
    vec3 = wp.types.vector(3, real)
    block = wp.types.vector(WIDTH, real)

    @wp.kernel(module="unique", enable_backward=False)
    def tabulate(
        n_pulling: wp.array2d(dtype=wp.int32),
        place: wp.array2d(dtype=vec3),
        corner: vec3,
        u_axis: vec3,
        v_axis: vec3,
        du: real,
        dv: real,
        lambda_s: real,
        # outputs
        by_row: wp.array3d(dtype=real),
        by_col: wp.array3d(dtype=block),
    ):
        env, c = wp.tid()
        first = c * CLUSTER
        for o in range(first, first + n_pulling[env, c]):
            y = place[env, o] - corner
            u = wp.dot(y, u_axis)
            v = wp.dot(y, v_axis)
            for i in range(by_row.shape[2]):
                d = real(i) * dv - v
                by_row[env, o, i] = wp.exp(-lambda_s * d * d)
            for b in range(by_col.shape[2]):
                g = block()
                for m in range(WIDTH):
                    d = real(b * WIDTH + m) * du - u
                    g[m] = wp.exp(-lambda_s * d * d)
                by_col[env, o, b] = g

    @wp.kernel(module="unique", enable_backward=False)
    def add_shear(
        n_pulling: wp.array2d(dtype=wp.int32),
        pull: wp.array2d(dtype=vec3),
        by_row: wp.array3d(dtype=real),
        by_col: wp.array3d(dtype=block),
        normal: vec3,
        is_sensing: wp.array(dtype=wp.bool),
        scale: real,
        cols: int,
        # outputs
        motion: wp.array3d(dtype=real),
    ):
        env, i, j_block = wp.tid()
        x = block()
        y = block()
        z = block()
        for c in range(n_pulling.shape[1]):
            first = c * CLUSTER
            for o in range(first, first + n_pulling[env, c]):
                p = scale * by_row[env, o, i] * pull[env, o]
                if wp.dot(p, p) > real(_NEGLIGIBLE * _NEGLIGIBLE):
                    g = by_col[env, o, j_block]
                    x += p[0] * g
                    y += p[1] * g
                    z += p[2] * g
        for m in range(WIDTH):
            j = j_block * WIDTH + m
            if j < cols:
                taxel = i * cols + j
                if is_sensing[taxel]:
                    total = vec3(x[m], y[m], z[m])
                    total -= wp.dot(total, normal) * normal
                    for k in range(3):
                        if wp.static(add):
                            total[k] += motion[env, taxel, k]
                        motion[env, taxel, k] = total[k]

    return tabulate, add_shear


def direct_shear_motion(
    context: Context,
    anchors: Anchors,
    *,
    positions: wp.array,
    normals: wp.array,
    is_sensing: wp.array,
    scale: float,
    lambda_s: float,
    motion: wp.array,
    add: bool,
) -> Callable[[], None]:
    """Record the sum for taxels anywhere, each with its own normal; see :func:`grid_shear_motion`."""
    inputs = [anchors.n_pulling, anchors.place, anchors.pull, positions, normals, is_sensing, scale, lambda_s]
    dim = (context.n_envs, len(is_sensing))
    return record(_direct_kernel(context.real, add), dim, inputs, [motion], context.device)


def grid_shear_motion(
    context: Context,
    anchors: Anchors,
    grid: RegularGrid,
    corner: np.ndarray,
    *,
    is_sensing: wp.array,
    scale: float,
    lambda_s: float,
    motion: wp.array,
    add: bool,
) -> Callable[[], None]:
    """Record the sum for a grid whose first taxel is at ``corner``.

    It adds to ``motion``, shape ``(n_envs, n_taxels, 3)``, or writes it if ``add`` is false; fillers are left alone.
    """
    real, device, n_envs = context.real, context.device, context.n_envs
    vec3 = wp.types.vector(3, real)
    n_slots, n_blocks = anchors.place.shape[1], -(-grid.cols // WIDTH)
    by_row = wp.zeros((n_envs, n_slots, grid.rows), dtype=real, device=device)
    by_col = wp.zeros((n_envs, n_slots, n_blocks), dtype=wp.types.vector(WIDTH, real), device=device)
    tabulate, add_shear = _grid_kernels(real, add)
    geometry = [vec3(*corner), vec3(*grid.u), vec3(*grid.v), grid.du, grid.dv, lambda_s]
    first = record(
        tabulate,
        anchors.n_pulling.shape,
        [anchors.n_pulling, anchors.place, *geometry],
        [by_row, by_col],
        device,
    )
    second = record(
        add_shear,
        (n_envs, grid.rows, n_blocks),
        [anchors.n_pulling, anchors.pull, by_row, by_col, vec3(*grid.normal), is_sensing, scale, grid.cols],
        [motion],
        device,
    )

    def launch():
        first()
        second()

    return launch
