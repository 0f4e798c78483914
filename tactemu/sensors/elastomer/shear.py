"""The shear of markers by latched points: each drags them by its pull, falling off as a Gaussian with the distance in
the plane.

``u_i = scale sum_o exp(-lambda_s |P_i (r_i - y_o)|^2) P_i pull_o`` with ``P_i`` the projection onto the tangent plane
of marker i. Three implementations give the same numbers: taxels one by one; a block of rows of a flat grid in one
thread; and, on a CPU, tables of the Gaussians of each row and column. ``quick`` selects a GPU's short exponential,
accurate to 1e-6.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.simd import padded_length, vector_prelude
from tactemu.plan.plan import Context
from tactemu.sensors.elastomer.anchors import anchors_type
from tactemu.sensors.point_cloud import CLUSTER_SIZE
from tactemu.sensors.probe_grid import Grid


@dataclass(frozen=True, kw_only=True)
class Drag:
    """The arguments of all three implementations."""

    context: Context
    anchors: Any
    """The state of the points that stick, a Warp struct (:func:`~.anchors.anchors_type`)."""
    is_sensing: wp.array
    """False for fillers, whose motion is not changed; bool, shape ``(n_taxels,)``."""
    scale: float
    lambda_s: float
    """Fall-off of the shear [1/m^2]."""
    motion: wp.array
    """Motion of the markers [m], vec3, shape ``(n_envs, n_taxels)``: added to, or written if ``add`` is false."""
    add: bool

    def on_plane(self, grid: Grid):
        """Return the plane of a grid of taxels, as kernels take it."""
        vec3, plane = wp.types.vector(3, self.context.real), plane_type(self.context.real)()
        plane.corner, plane.u, plane.v = vec3(*grid.corner), vec3(*grid.u), vec3(*grid.v)
        plane.du, plane.dv, plane.scale, plane.lambda_s = grid.du, grid.dv, self.scale, self.lambda_s
        plane.is_sensing = self.is_sensing.reshape((grid.rows, grid.cols))
        plane.motion = self.motion.reshape((self.context.n_envs, grid.rows, grid.cols))
        return plane


@functools.cache
def plane_type(real):
    """Return the Warp struct of the plane of a flat grid of taxels, whose markers the points drag."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Plane:
        corner: vec3  # position of the first taxel
        u: vec3
        v: vec3
        du: real  # distance of columns, along u
        dv: real  # distance of rows, along v
        scale: real
        lambda_s: real
        is_sensing: wp.array2d(dtype=wp.bool)
        motion: wp.array3d(dtype=vec3)  # written

    return Plane


WIDTH = 8
"""Number of rows of a grid that one thread computes."""
_NEGLIGIBLE = 1.0e-30
"""Smaller Gaussians count as 0: numbers below the normal range of floats are slow."""


@functools.cache
def _direct_kernel(real, add: bool, quick: bool):
    vec3 = wp.types.vector(3, real)

    @warp_kernel(module_options={"fast_math": quick})
    def add_shear(
        first_env: int,
        anchors: anchors_type(real),
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
        for a in range(anchors.n_active[env]):
            c = anchors.active[env, a]
            first = c * CLUSTER_SIZE
            for o in range(first, first + anchors.n_pulling[env, c]):
                apart = r - anchors.place[env, o]
                off_plane = wp.dot(apart, n)
                in_plane = wp.dot(apart, apart) - off_plane * off_plane
                total += wp.exp(-lambda_s * in_plane) * anchors.pull[env, o]
        total = scale * (total - wp.dot(total, n) * n)
        if wp.static(add):
            total += motion[env, taxel]
        motion[env, taxel] = total

    return add_shear


@functools.cache
def _tables_kernel(real, add: bool):
    """Return the kernel that gives a thread a share of the environments, with tables for all points of one
    environment."""
    anchors_struct, plane_struct = anchors_type(real), plane_type(real)
    snippet = _DRAG.replace("CLUSTER_SIZE", str(CLUSTER_SIZE)).replace("NEGLIGIBLE", repr(_NEGLIGIBLE))

    @wp.func_native(vector_prelude(real) + snippet.replace("ADD", str(int(add))))
    def drag(env: int, anchors: anchors_struct, plane: plane_struct, tables: wp.array(dtype=real)): ...

    @warp_kernel
    def add_shear(turns: wp.vec4i, anchors: anchors_struct, plane: plane_struct, tables: wp.array2d(dtype=real)):
        slot, _thread = wp.tid()
        for env in range(turns[0] + slot, turns[1], turns[3]):
            drag(env, anchors, plane, tables[turns[2] + slot])

    return add_shear


_DRAG = """
    const auto* const n_pulling = anchors.n_pulling.data + env * int64_t(anchors.n_pulling.shape[1]);
    const auto* const active = anchors.active.data + env * int64_t(anchors.active.shape[1]);
    const auto* const place = anchors.place.data + env * int64_t(anchors.place.shape[1]);
    const auto* const pull = anchors.pull.data + env * int64_t(anchors.pull.shape[1]);
    const auto corner = plane.corner, u_axis = plane.u, v_axis = plane.v;
    const Number du = plane.du, dv = plane.dv, scale = plane.scale, lambda_s = plane.lambda_s;
    const int rows = plane.motion.shape[1], cols = plane.motion.shape[2];
    auto* const motion = plane.motion.data + env * int64_t(rows) * cols;
    const int tall = (rows + wide - 1) / wide * wide, broad = (cols + wide - 1) / wide * wide;
    auto gaussian = [&](const Number d) {
        const Number g = wp::exp(-lambda_s * d * d);
        return g < Number(NEGLIGIBLE) ? Number(0) : g;
    };
    // For each point: Gaussians of the rows, times the pull along u and along v, and Gaussians of the columns.
    const int apart = 2 * tall + broad;
    int count = 0;
    for (int a = 0; a < anchors.n_active.data[env]; ++a) {
        const int first = active[a] * CLUSTER_SIZE;
        for (int o = first; o < first + n_pulling[active[a]]; ++o, ++count) {
            Number* const table = tables.data + count * int64_t(apart);
            const auto y = wp::sub(place[o], corner);
            const Number u = wp::dot(y, u_axis), v = wp::dot(y, v_axis);
            const Number pu = scale * wp::dot(pull[o], u_axis), pv = scale * wp::dot(pull[o], v_axis);
            for (int i = 0; i < tall; ++i) {
                const Number g = i < rows ? gaussian(Number(i) * dv - v) : Number(0);
                table[i] = g * pu, table[tall + i] = g * pv;
            }
            for (int j = 0; j < broad; ++j)
                table[2 * tall + j] = j < cols ? gaussian(Number(j) * du - u) : Number(0);
        }
    }
    for (int i = 0; i < tall; i += 4)
        for (int j = 0; j < broad; j += wide) {
            Vector a = {}, b = {}, c = {}, d = {}, e = {}, f = {}, g = {}, h = {};  // along u, then v, of four rows
            const Number* table = tables.data + i;
            for (int o = 0; o < count; ++o, table += apart) {
                const Vector line = get(table + 2 * tall - i + j);
                const Number* const v = table + tall;
                a += table[0] * line, b += table[1] * line, c += table[2] * line, d += table[3] * line;
                e += v[0] * line, f += v[1] * line, g += v[2] * line, h += v[3] * line;
            }
            const Vector along_u[4] = {a, b, c, d}, along_v[4] = {e, f, g, h};
            for (int m = 0; m < 4 && i + m < rows; ++m)
                for (int l = 0; l < wide && j + l < cols; ++l) {
                    const int64_t at = (i + m) * int64_t(cols) + j + l;
                    if (!plane.is_sensing.data[at])
                        continue;
                    for (int k = 0; k < 3; ++k) {
                        const Number moved = along_u[m][l] * u_axis[k] + along_v[m][l] * v_axis[k];
                        motion[at][k] = ADD ? moved + motion[at][k] : moved;
                    }
                }
        }
"""


@functools.cache
def _block_kernel(real, add: bool, quick: bool):
    anchors_struct, plane_struct = anchors_type(real), plane_type(real)
    block = wp.types.vector(WIDTH, real)

    @warp_kernel(module_options={"fast_math": quick})
    def add_shear(first_env: int, anchors: anchors_struct, plane: plane_struct):
        env, i_block, col = wp.tid()
        env += first_env
        u = block()
        v = block()
        for a in range(anchors.n_active[env]):
            first = anchors.active[env, a] * CLUSTER_SIZE
            for o in range(first, first + anchors.n_pulling[env, anchors.active[env, a]]):
                y = anchors.place[env, o] - plane.corner
                p = anchors.pull[env, o]
                pu = wp.dot(p, plane.u)
                pv = wp.dot(p, plane.v)
                x = real(col) * plane.du - wp.dot(y, plane.u)
                z = real(i_block * WIDTH) * plane.dv - wp.dot(y, plane.v)
                for m in range(WIDTH):
                    d = z + real(m) * plane.dv
                    g = wp.exp(-plane.lambda_s * (x * x + d * d))
                    u[m] += g * pu
                    v[m] += g * pv
        for m in range(WIDTH):
            row = i_block * WIDTH + m
            if row < plane.motion.shape[1]:
                if plane.is_sensing[row, col]:
                    total = plane.scale * (u[m] * plane.u + v[m] * plane.v)
                    if wp.static(add):
                        total += plane.motion[env, row, col]
                    plane.motion[env, row, col] = total

    return add_shear


def direct_shear_motion(drag: Drag, positions: wp.array, normals: wp.array) -> Callable[[], None]:
    """Record the sum for taxels in any layout, each with its own normal."""
    kernel = _direct_kernel(drag.context.real, drag.add, not drag.context.device.is_cpu)
    inputs = [drag.anchors, positions, normals, drag.is_sensing, drag.scale, drag.lambda_s]
    return drag.context.record(kernel, drag.motion.shape, inputs, [drag.motion])


def tabulated_shear_motion(drag: Drag, grid: Grid) -> Callable[[], None]:
    """Record the sum for a grid on a CPU, with the exponentials in tables, four rows by eight columns in registers."""
    context = drag.context
    each = 2 * padded_length(grid.rows) + padded_length(grid.cols)
    shape = (context.threads, drag.anchors.place.shape[1] * each)
    tables = wp.zeros(shape, dtype=context.real, device=context.device)
    inputs = [drag.anchors, drag.on_plane(grid), tables]
    return context.record_blocks(_tables_kernel(context.real, drag.add), context.threads, inputs, [], 1)


def grid_shear_motion(drag: Drag, grid: Grid) -> Callable[[], None]:
    """Record the sum for a grid, with exponentials computed where they are needed: for many environments."""
    context = drag.context
    dim = (context.n_envs, -(-grid.rows // WIDTH), grid.cols)
    kernel = _block_kernel(context.real, drag.add, not context.device.is_cpu)
    return context.record(kernel, dim, [drag.anchors, drag.on_plane(grid)], [])
