"""Sums of each taxel over the points within its radius, on a GPU: how much of a surface is near, and where.

With ``P_j = R - |x_j - r|`` for the points of a body nearer than R, the sums are ``sum P_j`` and ``sum P_j (x_j - r)``.
All readings of a ProximityTaxel are linear in them, since a body moves rigidly. The taxel is transformed into each
body's frame, so that points are never moved, and clusters out of reach are skipped. On a CPU :mod:`.proximity_simd`
computes them.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.vector_io import vector_readers
from tactemu.sensors.point_cloud import CLUSTER_SIZE, spatial_order
from tactemu.sensors.points.near import near_type
from tactemu.sensors.sensor_model import Site

_TAXELS_PER_WARP = 32
"""Taxels that one warp of a GPU computes: they should be near each other, so that they visit the same points."""
MAX_THREADS_PER_BLOCK = 256
"""Maximum number of threads of a block on a GPU."""
MIN_BLOCKS_PER_MULTIPROCESSOR = 6
"""Number of blocks that a multiprocessor holds at once; it limits the registers of a thread."""
LAUNCH_BOUNDS = MAX_THREADS_PER_BLOCK, MIN_BLOCKS_PER_MULTIPROCESSOR
_POINTS_PER_FETCH = 4
"""Number of points that a thread fetches at once."""


@functools.cache
def sums_type(real):
    """Return the Warp struct of the sums of taxels over the points around them."""

    @wp.struct
    class Sums:
        near: near_type(real)
        order: wp.array(dtype=wp.int32)  # taxels, neighbours next to each other
        positions: wp.array(dtype=wp.types.vector(3, real))
        radius: wp.array2d(dtype=real)  # of each taxel, (1 or n_envs, n_taxels)
        sums: wp.array3d(dtype=wp.types.vector(4, real))  # written, (n_envs, n_clouds, n_taxels)

    return Sums


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffs(bits) - 1;
#else
    return __builtin_ctz(bits);
#endif
""")
def first_bit(bits: int) -> int:
    """Return the index of the lowest bit that is set; one must be."""
    ...


@functools.cache
def _kernel(real):
    """Return the kernel, whose threads run in step: points out of reach add zeros, with fast square roots."""
    vec3, vec4, sums_struct = wp.types.vector(3, real), wp.types.vector(4, real), sums_type(real)
    fetch, _, _ = vector_readers(real, 4)

    @warp_kernel(module_options={"fast_math": True}, launch_bounds=LAUNCH_BOUNDS)
    def sum_points(first_env: int, sums: sums_struct):
        env, k, place = wp.tid()
        env += first_env
        i = sums.order[place]
        at = sums.near.pose[env, sums.near.clouds.bodies[k]]
        limit = sums.radius[wp.min(env, sums.radius.shape[0] - 1), i]
        q = wp.transform_get_rotation(at)
        p = wp.quat_rotate_inv(q, sums.positions[i] - wp.transform_get_translation(at))
        total = real(0.0)
        moment = vec3(real(0.0))
        ball = sums.near.clouds.cloud_ball[k]
        away = p - vec3(ball[0], ball[1], ball[2])
        reach = ball[3] + limit
        if wp.dot(away, away) <= reach * reach:
            end = sums.near.start[env, k + 1]
            for base in range(sums.near.start[env, k], end, 32):
                found = int(0)
                for n in range(base, wp.min(base + 32, end)):
                    ball = fetch(sums.near.clouds.ball, sums.near.clusters[env, n])
                    away = p - vec3(ball[0], ball[1], ball[2])
                    reach = ball[3] + limit
                    if wp.dot(away, away) <= reach * reach:
                        found |= 1 << (n - base)
                while found != 0:  # each thread of a warp visits its own clusters
                    c = sums.near.clusters[env, base + first_bit(found)]
                    found &= found - 1
                    for j in range(c * CLUSTER_SIZE, c * CLUSTER_SIZE + CLUSTER_SIZE, _POINTS_PER_FETCH):
                        for m in range(_POINTS_PER_FETCH):
                            x = fetch(sums.near.clouds.points, j + m)
                            d = vec3(x[0], x[1], x[2]) - p
                            overlap = wp.max(limit - wp.sqrt(wp.dot(d, d)), real(0.0))
                            total += overlap
                            moment += overlap * d
        if wp.isnan(p[0]):
            total = real(wp.nan)
        moment = wp.quat_rotate(q, moment)
        sums.sums[env, k, place] = vec4(moment[0], moment[1], moment[2], total)

    return sum_points


class ProximitySums:
    """The sums over one sensor's clouds, for any number of sets of radii.

    Args:
        site: the site of the sensor.
        near: the clusters that taxels visit (:func:`~.near.near_type`).
    """

    def __init__(self, site: Site, near):
        self._site, self._near = site, near
        order = spatial_order(site.probes.positions, _TAXELS_PER_WARP)
        self._order = wp.array(order, dtype=wp.int32, device=site.context.device)
        self.place = wp.array(np.argsort(order), dtype=wp.int32, device=site.context.device)
        """Index of each taxel in the sums, shape ``(n_taxels,)``."""

    def record(self, radius: wp.array) -> tuple[wp.array, Callable[[], None]]:
        """Allocate sums, and return them with the launch that updates them.

        Args:
            radius: radius of each taxel [m], shape ``(1 or n_envs, n_taxels)``.

        Returns:
            vec4 (``sum P_j (x_j - r)`` in the link's frame [m^2], ``sum P_j`` [m]), shape
            ``(n_envs, n_clouds, n_taxels)``; a point at ``r`` counts fully, a pose that is not finite gives NaN.
        """
        site, context, sums = self._site, self._site.context, sums_type(self._site.context.real)()
        shape = (context.n_envs, len(self._near.clouds.bodies), site.probes.n)
        sums.near, sums.order, sums.positions, sums.radius = self._near, self._order, site.positions, radius
        found = sums.sums = context.zeros(shape, wp.types.vector(4, context.real))
        return found, context.record(_kernel(context.real), shape, [sums], [])
