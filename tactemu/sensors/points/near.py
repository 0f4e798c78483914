"""The list of the clusters of points that can come near the skin, per environment: taxels then visit only these."""

# pyright: reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from tactemu.geometry.warp_collectives import ballot_count, lanes_per_environment, rank
from tactemu.sensors.point_cloud import FAR_AWAY_M
from tactemu.sensors.points.table import cloud_type
from tactemu.sensors.sensor_model import Site


@dataclass(frozen=True, kw_only=True)
class NearClusters:
    """The arrays that the stage writes."""

    clusters: wp.array
    """Indices of clusters, cloud by cloud, int32, shape ``(n_envs, n_clusters)``."""
    start: wp.array
    """Start of each cloud in that list, and the list's end, int32, shape ``(n_envs, n_clouds + 1)``."""


@functools.cache
def _kernel(real, lanes: int):
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)

    @wp.kernel(module="unique", enable_backward=False)
    def list_near(
        first_env: int,
        clouds: cloud_type(real),
        pose: wp.array2d(dtype=transform),
        low: vec3,
        high: vec3,
        reach: real,
        # outputs
        clusters: wp.array2d(dtype=wp.int32),
        start: wp.array2d(dtype=wp.int32),
    ):
        env, lane = wp.tid()
        env += first_env
        found = int(0)
        for k in range(clouds.bodies.shape[0]):
            if lane == 0:
                start[env, k] = found
            at = pose[env, clouds.bodies[k]]
            for first in range(clouds.cloud_start[k], clouds.cloud_start[k + 1], wp.static(lanes)):
                c = first + lane
                wanted = bool(False)
                if c < clouds.cloud_start[k + 1]:
                    ball = clouds.ball[c]
                    x = wp.transform_point(at, vec3(ball[0], ball[1], ball[2]))
                    apart = wp.max(wp.max(low - x, x - high), vec3(real(0.0)))
                    limit = ball[3] + reach
                    wanted = not (wp.dot(apart, apart) > limit * limit)
                place = found + rank(wanted)
                found += ballot_count(wanted)
                if wanted:
                    clusters[env, place] = c
        if lane == 0:
            start[env, clouds.bodies.shape[0]] = found

    return list_near


def near_clusters(site: Site, clouds, reach: float | None) -> tuple[NearClusters, Callable[[], None]]:
    """Allocate the list, and return it with the launch that updates it.

    Args:
        site: the site of the sensor; it has at least one probe.
        clouds: the points on the device.
        reach: largest radius of a probe [m]; ``None``: unknown, every cluster is listed.
    """
    context, positions = site.context, site.probes.positions
    n_envs, vec3 = context.n_envs, site.vec3
    near = NearClusters(
        clusters=context.zeros((n_envs, len(clouds.ball)), wp.int32),
        start=context.zeros((n_envs, len(clouds.bodies) + 1), wp.int32),
    )
    limits = [vec3(*positions.min(axis=0)), vec3(*positions.max(axis=0))]
    limits.append(FAR_AWAY_M if reach is None else np.nextafter(reach * (1 + 1e-5), np.inf))
    outputs = [near.clusters, near.start]
    inputs = [clouds, site.view.pose, *limits]
    side = lanes_per_environment(context.device)
    return near, context.record(_kernel(context.real, side), (n_envs, side), inputs, outputs)
