"""Distance from a regular grid of signed distances, trilinear between nodes.

Beyond the grid the nearest surface is taken to be the one seen from the nearest point of the grid, so that the
distance is continuous across its border and goes on growing.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import warp as wp


@functools.cache
def voxel_functions(real, shapes_type):
    """``voxel_distance(shapes, b, p) -> (signed distance, normal)`` of a point in the body's frame."""
    vec3 = wp.types.vector(3, real)

    @wp.func
    def node(shapes: shapes_type, start: wp.int64, n: wp.vec3i, i: int, j: int, k: int):
        return start + (wp.int64(i) * wp.int64(n[1]) + wp.int64(j)) * wp.int64(n[2]) + wp.int64(k)

    @wp.func
    def voxel_distance(shapes: shapes_type, b: int, p: vec3):
        start = shapes.grid_start[b]
        n = shapes.grid_nodes[b]
        cell = shapes.grid_cell[b]
        g = wp.cw_div(p - shapes.grid_origin[b], cell)
        top = vec3(real(n[0] - 1), real(n[1] - 1), real(n[2] - 1))
        c = wp.min(wp.max(g, vec3(real(0.0))), top)
        i = wp.min(int(wp.floor(c[0])), n[0] - 2)
        j = wp.min(int(wp.floor(c[1])), n[1] - 2)
        k = wp.min(int(wp.floor(c[2])), n[2] - 2)
        x = c[0] - real(i)
        y = c[1] - real(j)
        z = c[2] - real(k)
        d = real(0.0)
        slope = vec3(real(0.0))
        given = vec3(real(0.0))
        for corner in range(8):
            u = corner >> 2
            v = (corner >> 1) & 1
            w = corner & 1
            wx = wp.where(u == 1, x, real(1.0) - x)
            wy = wp.where(v == 1, y, real(1.0) - y)
            wz = wp.where(w == 1, z, real(1.0) - z)
            at = node(shapes, start, n, i + u, j + v, k + w)
            value = shapes.grid_values[at]
            d += wx * wy * wz * value
            slope += value * vec3(
                wp.where(u == 1, wy * wz, -wy * wz),
                wp.where(v == 1, wx * wz, -wx * wz),
                wp.where(w == 1, wx * wy, -wx * wy),
            )
            if shapes.grid_has_gradients[b] == 1:
                given += wx * wy * wz * shapes.grid_gradients[at]
        normal = wp.normalize(wp.cw_div(slope, cell))
        if shapes.grid_has_gradients[b] == 1:
            normal = wp.normalize(given)
        beyond = wp.cw_mul(g - c, cell)
        if wp.dot(beyond, beyond) > real(0.0):
            away = beyond + d * normal
            far = wp.length(away)
            if far > real(0.0):
                normal = away / far
                d = far
        return d, normal

    return voxel_distance
