"""The points of an object that stick to the elastomer: latched on touching, anchored there, released on leaving.

A point latches when it is deeper in the skin's body than ``contact_threshold``; its place then, in the link's frame, is
its anchor. It is released when it is farther outside than the release margin. A latched point of depth b at y drags the
markers around it by ``b (y - anchor)``, see :mod:`tactemu.sensors.elastomer.shear`. The anchor never slips.
"""

# pyright: reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from tactemu.geometry.shapes.active_groups import ActiveGroups, active_groups
from tactemu.geometry.shapes.distance import ShapeFunctions
from tactemu.geometry.shapes.shape import table_type
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Context
from tactemu.plan.scalars import is_nan
from tactemu.sensors.point_cloud import CLUSTER_SIZE, Clusters
from tactemu.sensors.points.table import cloud_type, upload_clouds
from tactemu.sensors.poses import LinkView
from tactemu.sensors.shape_table import ShapeTable


@dataclass(frozen=True, kw_only=True)
class Anchors:
    """The state and output of the stage. Points have the places of the clusters."""

    is_latched: wp.array
    """1 for each latched point, uint8, shape ``(n_envs, n_clusters * CLUSTER_SIZE)``."""
    anchor: wp.array
    """Place where each latched point stuck [m], link frame, vec3, same shape."""
    n_latched: wp.array
    """Number of latched points of each cluster, int32, shape ``(n_envs, n_clusters)``."""
    n_pulling: wp.array
    """Number of latched points with depth of each cluster; they are listed from its place ``cluster *
    CLUSTER_SIZE``."""
    groups: ActiveGroups
    """Clusters with such points."""
    place: wp.array
    """Positions of the listed points [m], link frame, vec3, shape ``(n_envs, n_clusters * CLUSTER_SIZE)``."""
    pull: wp.array
    """Depth times displacement from the anchor, times the sample's area if ``area_weighted`` [m^2 or m^4], same
    shape."""


@functools.cache
def _kernels(real, functions: ShapeFunctions, slope: float, area_weighted: bool):
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    distance = functions.distance
    max_slope = wp.constant(real(slope))

    @wp.kernel(module="unique", enable_backward=False)
    def follow_points(
        first_env: int,
        shapes: table_type(real),
        clouds: cloud_type(real),
        pose: wp.array2d(dtype=transform),
        link: int,
        contact_threshold: real,
        release_margin: real,
        # outputs
        is_latched: wp.array2d(dtype=wp.uint8),
        anchor: wp.array2d(dtype=vec3),
        n_latched: wp.array2d(dtype=wp.int32),
        n_pulling: wp.array2d(dtype=wp.int32),
        place: wp.array2d(dtype=vec3),
        pull: wp.array2d(dtype=vec3),
    ):
        env, c = wp.tid()
        env += first_env
        at = pose[env, clouds.cluster_body[c]]
        ball = clouds.ball[c]
        first = c * CLUSTER_SIZE
        last = first + clouds.counts[c]
        centre = wp.transform_point(at, vec3(ball[0], ball[1], ball[2]))
        centre_distance, _normal = distance(shapes, link, centre)
        if centre_distance > max_slope * ball[3] + wp.max(release_margin, real(0.0)):
            if n_latched[env, c] > 0:
                for p in range(first, last):
                    is_latched[env, p] = wp.uint8(0)
                n_latched[env, c] = 0
            n_pulling[env, c] = 0
            return
        latched = int(0)
        pulling = int(0)
        for p in range(first, last):
            y = wp.transform_point(at, vec3(clouds.points[p][0], clouds.points[p][1], clouds.points[p][2]))
            depth, _normal = distance(shapes, link, y)
            depth = -depth
            holds = is_latched[env, p] != wp.uint8(0) and not (depth < -release_margin)
            touches = not holds and depth > contact_threshold
            if is_nan(depth):  # the pose is not finite: output NaN, and keep the state
                place[env, first + pulling] = y
                pull[env, first + pulling] = y
                pulling += 1
                latched += int(is_latched[env, p])
                continue
            if touches:
                anchor[env, p] = y
            stays = holds or touches
            is_latched[env, p] = wp.uint8(stays)
            if stays:
                latched += 1
                if depth > real(0.0) and not touches:  # a point that touches now is at its anchor
                    weight = depth
                    if wp.static(area_weighted):
                        weight *= clouds.areas[p]
                    place[env, first + pulling] = y
                    pull[env, first + pulling] = weight * (y - anchor[env, p])
                    pulling += 1
        n_latched[env, c] = latched
        n_pulling[env, c] = pulling

    @wp.kernel(module="unique", enable_backward=False)
    def release_all(
        envs: wp.array(dtype=wp.bool),
        # outputs
        is_latched: wp.array2d(dtype=wp.uint8),
        n_latched: wp.array2d(dtype=wp.int32),
        n_pulling: wp.array2d(dtype=wp.int32),
    ):
        env, p = wp.tid()
        if envs[env]:
            is_latched[env, p] = wp.uint8(0)
            if p < n_latched.shape[1]:
                n_latched[env, p] = 0
                n_pulling[env, p] = 0

    return follow_points, release_all


def shear_anchors(
    context: Context,
    table: ShapeTable,
    view: LinkView,
    clusters: Clusters,
    *,
    contact_threshold: float,
    release_margin: float,
    area_weighted: bool,
) -> tuple[Anchors, Callable[[], None], Callable[[wp.array], None]]:
    """Allocate the state, and record its update.

    Args:
        clusters: points of the tracked bodies.
        contact_threshold: depth in the link's body beyond which a point latches [m].
        release_margin: distance from the link's body beyond which it is released [m].
        area_weighted: multiply each pull by the surface that the point stands for.

    Returns:
        The state, the launch of its update, and a function that resets it by a mask of environments.
    """
    real, device, n_envs = context.real, context.device, context.n_envs
    vec3 = wp.types.vector(3, real)
    n_clusters = len(clusters.ball)
    places = (n_envs, n_clusters * CLUSTER_SIZE)
    n_pulling = context.zeros((n_envs, n_clusters), wp.int32)
    groups, list_clusters = active_groups(context, n_pulling)
    anchors = Anchors(
        is_latched=context.zeros(places, wp.uint8),
        anchor=context.zeros(places, vec3),
        n_latched=context.zeros((n_envs, n_clusters), wp.int32),
        n_pulling=n_pulling,
        groups=groups,
        place=context.zeros(places, vec3),
        pull=context.zeros(places, vec3),
    )
    slope = max((kind.max_slope for kind in table.kinds), default=1.0)
    follow_points, release_all = _kernels(real, table.functions, slope, area_weighted)
    follow = context.record(
        follow_points,
        (n_envs, n_clusters),
        [
            table.struct,
            upload_clouds(clusters, context),
            view.pose,
            view.link,
            contact_threshold,
            release_margin,
        ],
        [anchors.is_latched, anchors.anchor, anchors.n_latched, anchors.n_pulling, anchors.place, anchors.pull],
    )

    def reset(envs: wp.array) -> None:
        outputs = [anchors.is_latched, anchors.n_latched, anchors.n_pulling]
        wp.launch(release_all, dim=places, inputs=[envs], outputs=outputs, device=device)

    return anchors, in_turn(follow, list_clusters), reset
