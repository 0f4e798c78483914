"""The list of the clusters of points that can come near the skin, per environment: taxels then visit only these."""

# pyright: reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.warp_collectives import ballot_count, lanes_per_environment, rank
from tactemu.sensors.point_cloud import FAR_AWAY_M
from tactemu.sensors.points.table import cloud_type
from tactemu.sensors.sensor_model import Site


@functools.cache
def near_type(real):
    """Return the Warp struct of the clusters near the skin, and of the box in whose reach they are."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Near:
        clouds: cloud_type(real)
        pose: wp.array2d(dtype=wp.types.transformation(real))
        low: vec3  # corners of the box around the probes
        high: vec3
        reach: real  # largest radius of a probe
        clusters: wp.array2d(dtype=wp.int32)  # indices of the clusters, cloud by cloud, (n_envs, n_clusters)
        start: wp.array2d(dtype=wp.int32)  # start of each cloud in that list, and its end, (n_envs, n_clouds + 1)

    return Near


@functools.cache
def _kernel(real, lanes: int):
    vec3 = wp.types.vector(3, real)

    @warp_kernel
    def list_near(first_env: int, near: near_type(real)):
        env, lane = wp.tid()
        env += first_env
        found = int(0)
        for k in range(near.clouds.bodies.shape[0]):
            if lane == 0:
                near.start[env, k] = found
            at = near.pose[env, near.clouds.bodies[k]]
            for first in range(near.clouds.cloud_start[k], near.clouds.cloud_start[k + 1], wp.static(lanes)):
                c = first + lane
                wanted = bool(False)
                if c < near.clouds.cloud_start[k + 1]:
                    ball = near.clouds.ball[c]
                    x = wp.transform_point(at, vec3(ball[0], ball[1], ball[2]))
                    apart = wp.max(wp.max(near.low - x, x - near.high), vec3(real(0.0)))
                    limit = ball[3] + near.reach
                    wanted = not (wp.dot(apart, apart) > limit * limit)
                place = found + rank(wanted)
                found += ballot_count(wanted)
                if wanted:
                    near.clusters[env, place] = c
        if lane == 0:
            near.start[env, near.clouds.bodies.shape[0]] = found

    return list_near


def near_clusters(site: Site, clouds, reach: float | None) -> tuple[Any, Callable[[], None]]:
    """Allocate the list (:func:`near_type`), and return it with the launch that updates it.

    Args:
        site: the site of the sensor; it has at least one probe.
        clouds: the points on the device.
        reach: largest radius of a probe [m]; ``None``: unknown, every cluster is listed.
    """
    context, positions, near = site.context, site.probes.positions, near_type(site.context.real)()
    near.clouds, near.pose = clouds, site.view.pose
    near.clusters = context.zeros((context.n_envs, len(clouds.ball)), wp.int32)
    near.start = context.zeros((context.n_envs, len(clouds.bodies) + 1), wp.int32)
    near.low, near.high = site.vec3(*positions.min(axis=0)), site.vec3(*positions.max(axis=0))
    near.reach = FAR_AWAY_M if reach is None else np.nextafter(reach * (1 + 1e-5), np.inf)
    side = lanes_per_environment(context.device)
    return near, context.record(_kernel(context.real, side), (context.n_envs, side), [near], [])
