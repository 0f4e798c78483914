"""The clouds of one sensor on the device, as kernels read them."""

import functools

import numpy as np
import warp as wp

from tactemu.plan.plan import Context
from tactemu.sensors.point_cloud import Clusters


@functools.cache
def cloud_type(real):
    """Return the Warp struct of the sorted clouds; see :class:`tactemu.sensors.point_cloud.Clusters`."""
    vec4 = wp.types.vector(4, real)

    @wp.struct
    class Clouds:
        points: wp.array(dtype=vec4)  # x, y, z and 0: 16 bytes are fetched at once
        areas: wp.array(dtype=real)
        counts: wp.array(dtype=wp.int32)  # points of each cluster
        ball: wp.array(dtype=vec4)  # centre and radius of each cluster
        cluster_body: wp.array(dtype=wp.int32)
        bodies: wp.array(dtype=wp.int32)
        cloud_start: wp.array(dtype=wp.int32)  # first cluster of each cloud; one more at the end
        cloud_ball: wp.array(dtype=vec4)

    return Clouds


def upload_clouds(clusters: Clusters, context: Context):
    """Return a filled :func:`cloud_type`. Balls are enlarged slightly, so that rounding never hides a point."""
    real, device = context.real, context.device
    vec4 = wp.types.vector(4, real)
    slack = np.array([1.0, 1.0, 1.0, 1.0 + 1e-5])

    def upload(values, dtype):
        return wp.array(values, dtype=dtype, device=device)

    table = cloud_type(real)()
    table.points = upload(np.pad(clusters.positions, ((0, 0), (0, 1))), vec4)
    table.areas = upload(clusters.areas, real)
    table.counts = upload(clusters.counts, wp.int32)
    table.ball = upload(clusters.ball * slack, vec4)
    table.cluster_body = upload(np.repeat(clusters.bodies, np.diff(clusters.cloud_start)), wp.int32)
    table.bodies = upload(clusters.bodies, wp.int32)
    table.cloud_start = upload(clusters.cloud_start, wp.int32)
    table.cloud_ball = upload(clusters.cloud_ball * slack, vec4)
    return table
