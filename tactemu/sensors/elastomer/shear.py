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

import warp as wp

from tactemu.geometry.simd import padded_length, vector_prelude
from tactemu.plan.plan import Context
from tactemu.sensors.elastomer.anchors import Anchors
from tactemu.sensors.point_cloud import CLUSTER_SIZE
from tactemu.sensors.probe_grid import Grid


@dataclass(frozen=True, kw_only=True)
class Drag:
    """The arguments of all three implementations."""

    context: Context
    anchors: Anchors
    is_sensing: wp.array
    """False for fillers, whose motion is not changed; bool, shape ``(n_taxels,)``."""
    scale: float
    lambda_s: float
    """Fall-off of the shear [1/m^2]."""
    motion: wp.array
    """Motion of the markers [m], vec3, shape ``(n_envs, n_taxels)``: added to, or written if ``add`` is false."""
    add: bool

    @property
    def pulling(self) -> list[wp.array]:
        """The clusters with points that pull, as kernels take them."""
        return [self.anchors.n_pulling, self.anchors.groups.n_active, self.anchors.groups.active]


WIDTH = 8
"""Number of rows of a grid that one thread computes."""
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
            first = c * CLUSTER_SIZE
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
def _tables_kernel(real, add: bool):
    """Return the kernel that gives a thread a share of the environments, with tables for all points of one
    environment."""
    vec3 = wp.types.vector(3, real)
    snippet = _DRAG.replace("CLUSTER_SIZE", str(CLUSTER_SIZE)).replace("NEGLIGIBLE", repr(_NEGLIGIBLE))

    @wp.func_native(vector_prelude(real) + snippet.replace("ADD", str(int(add))))
    def drag(
        n_pulling: wp.array(dtype=wp.int32),
        n_active: int,
        active: wp.array(dtype=wp.int32),
        place: wp.array(dtype=vec3),
        pull: wp.array(dtype=vec3),
        corner: vec3,
        u_axis: vec3,
        v_axis: vec3,
        du: real,
        dv: real,
        lambda_s: real,
        scale: real,
        is_sensing: wp.array2d(dtype=wp.bool),
        tables: wp.array(dtype=real),
        motion: wp.array2d(dtype=vec3),
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def add_shear(
        turns: wp.vec4i,  # first environment, end, first slot, slots that take turns
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
        tables: wp.array2d(dtype=real),
        # outputs
        motion: wp.array3d(dtype=vec3),
    ):
        slot, _thread = wp.tid()
        for env in range(turns[0] + slot, turns[1], turns[3]):
            drag(
                n_pulling[env],
                n_active[env],
                active[env],
                place[env],
                pull[env],
                corner,
                u_axis,
                v_axis,
                du,
                dv,
                lambda_s,
                scale,
                is_sensing,
                tables[turns[2] + slot],
                motion[env],
            )

    return add_shear


_DRAG = """
    const int rows = motion.shape[0], cols = motion.shape[1];
    const int tall = (rows + wide - 1) / wide * wide, broad = (cols + wide - 1) / wide * wide;
    auto gaussian = [&](const Number d) {
        const Number g = wp::exp(-lambda_s * d * d);
        return g < Number(NEGLIGIBLE) ? Number(0) : g;
    };
    // For each point: Gaussians of the rows, times the pull along u and along v, and Gaussians of the columns.
    const int apart = 2 * tall + broad;
    int count = 0;
    for (int a = 0; a < n_active; ++a) {
        const int first = active.data[a] * CLUSTER_SIZE;
        for (int o = first; o < first + n_pulling.data[active.data[a]]; ++o, ++count) {
            Number* const table = tables.data + count * int64_t(apart);
            const auto y = wp::sub(place.data[o], corner);
            const Number u = wp::dot(y, u_axis), v = wp::dot(y, v_axis);
            const Number pu = scale * wp::dot(pull.data[o], u_axis), pv = scale * wp::dot(pull.data[o], v_axis);
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
                    if (!is_sensing.data[at])
                        continue;
                    for (int k = 0; k < 3; ++k) {
                        const Number moved = along_u[m][l] * u_axis[k] + along_v[m][l] * v_axis[k];
                        motion.data[at][k] = ADD ? moved + motion.data[at][k] : moved;
                    }
                }
        }
"""


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
            first = active[env, a] * CLUSTER_SIZE
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
    """Record the sum for taxels in any layout, each with its own normal."""
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
    """Record the sum for a grid on a CPU, with the exponentials in tables, four rows by eight columns in registers."""
    context, anchors = drag.context, drag.anchors
    vec3 = wp.types.vector(3, context.real)
    shape = (context.n_envs, grid.rows, grid.cols)
    each = 2 * padded_length(grid.rows) + padded_length(grid.cols)
    tables = wp.zeros((context.threads, anchors.place.shape[1] * each), dtype=context.real, device=context.device)
    inputs = [*drag.pulling, anchors.place, anchors.pull, vec3(*grid.corner), vec3(*grid.u), vec3(*grid.v)]
    inputs += [grid.du, grid.dv, drag.lambda_s, drag.scale, drag.is_sensing.reshape(shape[1:]), tables]
    kernel = _tables_kernel(context.real, drag.add)
    return context.record_blocks(kernel, context.threads, inputs, [drag.motion.reshape(shape)], 1)


def grid_shear_motion(drag: Drag, grid: Grid) -> Callable[[], None]:
    """Record the sum for a grid, with exponentials computed where they are needed: for many environments."""
    context, anchors = drag.context, drag.anchors
    vec3 = wp.types.vector(3, context.real)
    shape = (context.n_envs, grid.rows, grid.cols)
    inputs = [*drag.pulling, anchors.place, anchors.pull, vec3(*grid.corner), vec3(*grid.u), vec3(*grid.v)]
    inputs += [grid.du, grid.dv, drag.lambda_s, drag.scale, drag.is_sensing.reshape(shape[1:])]
    dim = (context.n_envs, -(-grid.rows // WIDTH), grid.cols)
    kernel = _block_kernel(context.real, drag.add, not context.device.is_cpu)
    return context.record(kernel, dim, inputs, [drag.motion.reshape(shape)])
