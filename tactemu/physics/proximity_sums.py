"""Sums of a taxel over the points within its radius: how much of a surface is near, and where.

With ``P_j = R - |x_j - r|`` for the points of a body nearer than R, the sums are ``sum P_j`` and
``sum P_j (x_j - r)``. All that a ProximityTaxel reads is linear in them, since a body moves rigidly. The taxel is taken
into each body's frame, so that points are never moved, and clusters out of reach are skipped.
"""

import functools

import warp as wp

from tactemu.physics.cloud_table import cloud_type
from tactemu.physics.point_cloud import CLUSTER


@functools.cache
def proximity_function(real):
    """``near_points(clouds, k, listed, first, last, pose, r, radius) -> (sum P_j, sum P_j (x_j - r))``.

    It sums over the points of cloud ``k`` in the clusters ``listed[first:last]``. ``pose`` is the pose of the cloud's
    body in the link's frame; ``r`` and the second sum are in the link's frame. A point at ``r`` counts fully. A pose
    that is not finite gives NaN.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)

    @wp.func
    def near_points(
        clouds: cloud_type(real),
        k: int,
        listed: wp.array(dtype=wp.int32),
        first: int,
        last: int,
        pose: transform,
        r: vec3,
        radius: real,
    ):
        q = wp.transform_get_rotation(pose)
        p = wp.quat_rotate_inv(q, r - wp.transform_get_translation(pose))
        total = real(0.0)
        moment = vec3(real(0.0))
        ball = clouds.cloud_ball[k]
        away = p - vec3(ball[0], ball[1], ball[2])
        reach = ball[3] + radius
        if wp.dot(away, away) > reach * reach:
            return total, moment
        limit = radius * radius
        for n in range(first, last):
            c = listed[n]
            ball = clouds.ball[c]
            away = p - vec3(ball[0], ball[1], ball[2])
            reach = ball[3] + radius
            if wp.dot(away, away) <= reach * reach:
                for j in range(CLUSTER):  # of fixed length: unrolled, so that all points are fetched at once
                    d = clouds.points[c * CLUSTER + j] - p
                    squared = wp.dot(d, d)
                    if squared <= limit:
                        overlap = radius - wp.sqrt(squared)
                        total += overlap
                        moment += overlap * d
        if wp.isnan(p[0]):
            total = real(wp.nan)
        return total, wp.quat_rotate(q, moment)

    return near_points
