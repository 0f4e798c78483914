"""How latched points drag the markers: each by its pull, falling off as a Gaussian with the distance in the plane.

``u_i = scale sum_o exp(-lambda_s |P_i (r_i - y_o)|^2) P_i pull_o`` with ``P_i`` the projection onto the tangent plane
of marker i. There are three ways to the same numbers: taxels one by one; a block of rows of a flat grid in one thread;
and, on a CPU, tables of the Gaussians of each row and column. ``quick`` asks for a GPU's short exponential, which is
good to 1e-6.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from tactemu.physics.elastomer.anchors import Anchors
from tactemu.physics.points.point_cloud import CLUSTER
from tactemu.physics.probes.grid import Grid
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Context


@dataclass(frozen=True, kw_only=True)
class Drag:
    """What all three ways are told."""

    context: Context
    anchors: Anchors
    is_sensing: wp.array
    """False for fillers, bool, shape ``(n_taxels,)``; they are left alone."""
    scale: float
    lambda_s: float
    """[1/m^2]"""
    motion: wp.array
    """Of the markers [m], vec3, shape ``(n_envs, n_taxels)``: added to, or written if ``add`` is false."""
    add: bool

    @property
    def pulling(self) -> list[wp.array]:
        """Clusters with points that pull, as kernels take them."""
        return [self.anchors.n_pulling, self.anchors.groups.n_active, self.anchors.groups.active]


WIDTH = 8
_NEGLIGIBLE = 1.0e-30
"""Smaller Gaussians count as 0: numbers below the normal range of floats are slow."""


@functools.cache
def _direct_kernel(real, add: bool, quick: bool):
    vec3 = wp.types.vector(3, real)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": quick})
    def add_shear(
        first_env: int,
        n_pulling: wp.array2d(dtype=wp.int32),
        n_active: wp.array(dtype=wp.int32),
        active: wp.array2d(dtype=wp.int32),
        place: wp.array2d(dtype=vec3),
        pull: wp.array2d(dtype=vec3),
        positions: wp.array(dtype=vec3),
        normals: wp.array(dtype=vec3),
        is_sensing: wp.array(dtype=wp.bool),
        scale: real,
        lambda_s: real,
        # outputs
        motion: wp.array2d(dtype=vec3),
    ):
        env, taxel = wp.tid()
        env += first_env
        if not is_sensing[taxel]:
            return
        r = positions[taxel]
        n = normals[taxel]
        total = vec3(real(0.0))
        for a in range(n_active[env]):
            c = active[env, a]
            first = c * CLUSTER
            for o in range(first, first + n_pulling[env, c]):
                apart = r - place[env, o]
                off_plane = wp.dot(apart, n)
                in_plane = wp.dot(apart, apart) - off_plane * off_plane
                total += wp.exp(-lambda_s * in_plane) * pull[env, o]
        total = scale * (total - wp.dot(total, n) * n)
        if wp.static(add):
            total += motion[env, taxel]
        motion[env, taxel] = total

    return add_shear


@functools.cache
def _grid_kernels(real, add: bool):
    vec3 = wp.types.vector(3, real)
    vec2 = wp.types.vector(2, real)
    block = wp.types.vector(WIDTH, real)

    @wp.func
    def gaussian(lambda_s: real, d: real):
        g = wp.exp(-lambda_s * d * d)
        return wp.where(g < real(_NEGLIGIBLE), real(0.0), g)

    @wp.kernel(module="unique", enable_backward=False)
    def tabulate(
        first_env: int,
        n_pulling: wp.array2d(dtype=wp.int32),
        place: wp.array2d(dtype=vec3),
        pull: wp.array2d(dtype=vec3),
        corner: vec3,
        u_axis: vec3,
        v_axis: vec3,
        du: real,
        dv: real,
        lambda_s: real,
        scale: real,
        # outputs
        in_plane: wp.array2d(dtype=vec2),
        by_row: wp.array3d(dtype=real),
        by_col: wp.array3d(dtype=block),
    ):
        env, c = wp.tid()
        env += first_env
        first = c * CLUSTER
        for o in range(first, first + n_pulling[env, c]):
            y = place[env, o] - corner
            u = wp.dot(y, u_axis)
            v = wp.dot(y, v_axis)
            in_plane[env, o] = scale * vec2(wp.dot(pull[env, o], u_axis), wp.dot(pull[env, o], v_axis))
            for i in range(by_row.shape[2]):
                by_row[env, o, i] = gaussian(lambda_s, real(i) * dv - v)
            for b in range(by_col.shape[2]):
                g = block()
                for m in range(WIDTH):
                    g[m] = gaussian(lambda_s, real(b * WIDTH + m) * du - u)
                by_col[env, o, b] = g

    @wp.kernel(module="unique", enable_backward=False)
    def add_shear(
        first_env: int,
        n_pulling: wp.array2d(dtype=wp.int32),
        n_active: wp.array(dtype=wp.int32),
        active: wp.array2d(dtype=wp.int32),
        in_plane: wp.array2d(dtype=vec2),
        by_row: wp.array3d(dtype=real),
        by_col: wp.array3d(dtype=block),
        u_axis: vec3,
        v_axis: vec3,
        is_sensing: wp.array(dtype=wp.bool),
        cols: int,
        # outputs
        motion: wp.array2d(dtype=vec3),
    ):
        env, i, j_block = wp.tid()
        env += first_env
        u = block()
        v = block()
        for a in range(n_active[env]):
            first = active[env, a] * CLUSTER
            for o in range(first, first + n_pulling[env, active[env, a]]):
                share = by_row[env, o, i]
                p = in_plane[env, o]
                pu = share * p[0]
                pv = share * p[1]
                g = by_col[env, o, j_block]
                u += pu * g
                v += pv * g
        for m in range(WIDTH):
            j = j_block * WIDTH + m
            if j < cols:
                taxel = i * cols + j
                if is_sensing[taxel]:
                    total = u[m] * u_axis + v[m] * v_axis
                    if wp.static(add):
                        total += motion[env, taxel]
                    motion[env, taxel] = total

    return tabulate, add_shear


@functools.cache
def _block_kernel(real, add: bool, quick: bool):
    vec3 = wp.types.vector(3, real)
    block = wp.types.vector(WIDTH, real)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": quick})
    def add_shear(
        first_env: int,
        n_pulling: wp.array2d(dtype=wp.int32),
        n_active: wp.array(dtype=wp.int32),
        active: wp.array2d(dtype=wp.int32),
        place: wp.array2d(dtype=vec3),
        pull: wp.array2d(dtype=vec3),
        corner: vec3,
        u_axis: vec3,
        v_axis: vec3,
        du: real,
        dv: real,
        lambda_s: real,
        scale: real,
        is_sensing: wp.array2d(dtype=wp.bool),
        # outputs
        motion: wp.array3d(dtype=vec3),
    ):
        env, i_block, col = wp.tid()
        env += first_env
        u = block()
        v = block()
        for a in range(n_active[env]):
            first = active[env, a] * CLUSTER
            for o in range(first, first + n_pulling[env, active[env, a]]):
                y = place[env, o] - corner
                p = pull[env, o]
                pu = wp.dot(p, u_axis)
                pv = wp.dot(p, v_axis)
                x = real(col) * du - wp.dot(y, u_axis)
                z = real(i_block * WIDTH) * dv - wp.dot(y, v_axis)
                for m in range(WIDTH):
                    d = z + real(m) * dv
                    g = wp.exp(-lambda_s * (x * x + d * d))
                    u[m] += g * pu
                    v[m] += g * pv
        for m in range(WIDTH):
            row = i_block * WIDTH + m
            if row < motion.shape[1]:
                if is_sensing[row, col]:
                    total = scale * (u[m] * u_axis + v[m] * v_axis)
                    if wp.static(add):
                        total += motion[env, row, col]
                    motion[env, row, col] = total

    return add_shear


def direct_shear_motion(drag: Drag, positions: wp.array, normals: wp.array) -> Callable[[], None]:
    """Record the sum for taxels anywhere, each with its own normal."""
    context, anchors = drag.context, drag.anchors
    kernel = _direct_kernel(context.real, drag.add, not context.device.is_cpu)
    inputs = [
        *drag.pulling,
        anchors.place,
        anchors.pull,
        positions,
        normals,
        drag.is_sensing,
        drag.scale,
        drag.lambda_s,
    ]
    return context.record(kernel, drag.motion.shape, inputs, [drag.motion])


def tabulated_shear_motion(drag: Drag, grid: Grid) -> Callable[[], None]:
    """Record the sum for a grid, with the exponentials in tables: for few environments, where memory is cheap."""
    context, anchors = drag.context, drag.anchors
    real, n_envs = context.real, context.n_envs
    vec2, vec3 = (wp.types.vector(n, real) for n in (2, 3))
    n_slots, n_blocks = anchors.place.shape[1], -(-grid.cols // WIDTH)
    in_plane = context.zeros((n_envs, n_slots), vec2)
    by_row = context.zeros((n_envs, n_slots, grid.rows), real)
    by_col = context.zeros((n_envs, n_slots, n_blocks), wp.types.vector(WIDTH, real))
    tabulate, add_shear = _grid_kernels(real, drag.add)
    axes = [vec3(*grid.u), vec3(*grid.v)]
    inputs = [anchors.n_pulling, anchors.place, anchors.pull, vec3(*grid.corner), *axes, grid.du, grid.dv]
    inputs += [drag.lambda_s, drag.scale]
    first = context.record(tabulate, anchors.n_pulling.shape, inputs, [in_plane, by_row, by_col])
    inputs = [*drag.pulling, in_plane, by_row, by_col, *axes, drag.is_sensing, grid.cols]
    second = context.record(add_shear, (n_envs, grid.rows, n_blocks), inputs, [drag.motion])
    return in_turn(first, second)


def grid_shear_motion(drag: Drag, grid: Grid) -> Callable[[], None]:
    """Record the sum for a grid, each exponential where it is needed: for many environments."""
    context, anchors = drag.context, drag.anchors
    vec3 = wp.types.vector(3, context.real)
    shape = (context.n_envs, grid.rows, grid.cols)
    inputs = [*drag.pulling, anchors.place, anchors.pull, vec3(*grid.corner), vec3(*grid.u), vec3(*grid.v)]
    inputs += [grid.du, grid.dv, drag.lambda_s, drag.scale, drag.is_sensing.reshape(shape[1:])]
    dim = (context.n_envs, -(-grid.rows // WIDTH), grid.cols)
    kernel = _block_kernel(context.real, drag.add, not context.device.is_cpu)
    return context.record(kernel, dim, inputs, [drag.motion.reshape(shape)])
