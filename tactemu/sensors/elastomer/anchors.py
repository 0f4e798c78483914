"""The points of an object that stick to the elastomer: latched on touching, anchored there, released on leaving.

A point latches when it is deeper in the skin's body than ``contact_threshold``; its place then, in the link's frame, is
its anchor. It is released when it is farther outside than the release margin. A latched point of depth b at y drags the
markers around it by ``b (y - anchor)``, see :mod:`tactemu.sensors.elastomer.shear`. The anchor never slips.
"""

# pyright: reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from typing import Any

import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.active_groups import active_groups
from tactemu.geometry.shapes.distance import ShapeFunctions
from tactemu.geometry.shapes.shape import table_type
from tactemu.plan.launches import in_turn
from tactemu.plan.plan import Context
from tactemu.plan.scalars import is_nan
from tactemu.sensors.point_cloud import CLUSTER_SIZE, Clusters
from tactemu.sensors.points.table import cloud_type, upload_clouds
from tactemu.sensors.poses import LinkView
from tactemu.sensors.shape_table import ShapeTable


@functools.cache
def anchors_type(real):
    """Return the Warp struct of the stage's state and output. Points have the places of the clusters: ``(n_envs,
    n_clusters * CLUSTER_SIZE)``; the others are ``(n_envs, n_clusters)``."""
    vec3 = wp.types.vector(3, real)

    @wp.struct
    class Anchors:
        is_latched: wp.array2d(dtype=wp.uint8)  # 1 for each latched point
        anchor: wp.array2d(dtype=vec3)  # place where each latched point stuck [m], link frame
        n_latched: wp.array2d(dtype=wp.int32)  # latched points of each cluster
        # Points that pull: latched, with depth. Those of a cluster are listed from its place, cluster * CLUSTER_SIZE.
        n_pulling: wp.array2d(dtype=wp.int32)
        n_active: wp.array(dtype=wp.int32)  # number of clusters with such points, per environment
        active: wp.array2d(dtype=wp.int32)  # their indices
        place: wp.array2d(dtype=vec3)  # positions of the listed points [m], link frame
        pull: wp.array2d(dtype=vec3)  # depth times displacement from the anchor [m^2], times the area if area_weighted

    return Anchors


@functools.cache
def _kernels(real, functions: ShapeFunctions, slope: float, area_weighted: bool):
    vec3 = wp.types.vector(3, real)
    anchors_struct, distance = anchors_type(real), functions.distance
    max_slope = wp.constant(real(slope))

    @warp_kernel
    def follow_points(
        first_env: int,
        shapes: table_type(real),
        clouds: cloud_type(real),
        pose: wp.array2d(dtype=wp.types.transformation(real)),
        link: int,
        contact_threshold: real,
        release_margin: real,
        state: anchors_struct,
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
            if state.n_latched[env, c] > 0:
                for p in range(first, last):
                    state.is_latched[env, p] = wp.uint8(0)
                state.n_latched[env, c] = 0
            state.n_pulling[env, c] = 0
            return
        latched = int(0)
        pulling = int(0)
        for p in range(first, last):
            y = wp.transform_point(at, vec3(clouds.points[p][0], clouds.points[p][1], clouds.points[p][2]))
            depth, _normal = distance(shapes, link, y)
            depth = -depth
            holds = state.is_latched[env, p] != wp.uint8(0) and not (depth < -release_margin)
            touches = not holds and depth > contact_threshold
            if is_nan(depth):  # the pose is not finite: output NaN, and keep the state
                state.place[env, first + pulling] = y
                state.pull[env, first + pulling] = y
                pulling += 1
                latched += int(state.is_latched[env, p])
                continue
            if touches:
                state.anchor[env, p] = y
            stays = holds or touches
            state.is_latched[env, p] = wp.uint8(stays)
            if stays:
                latched += 1
                if depth > real(0.0) and not touches:  # a point that touches now is at its anchor
                    weight = depth
                    if wp.static(area_weighted):
                        weight *= clouds.areas[p]
                    state.place[env, first + pulling] = y
                    state.pull[env, first + pulling] = weight * (y - state.anchor[env, p])
                    pulling += 1
        state.n_latched[env, c] = latched
        state.n_pulling[env, c] = pulling

    @warp_kernel
    def release_all(envs: wp.array(dtype=wp.bool), state: anchors_struct):
        env, p = wp.tid()
        if envs[env]:
            state.is_latched[env, p] = wp.uint8(0)
            if p < state.n_latched.shape[1]:
                state.n_latched[env, p] = 0
                state.n_pulling[env, p] = 0

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
) -> tuple[Any, Callable[[], None], Callable[[wp.array], None]]:
    """Allocate the state, and record its update.

    Args:
        clusters: points of the tracked bodies.
        contact_threshold: depth in the link's body beyond which a point latches [m].
        release_margin: distance from the link's body beyond which it is released [m].
        area_weighted: multiply each pull by the surface that the point stands for.

    Returns:
        The state (:func:`anchors_type`), the launch of its update, and a function that resets it by a mask of
        environments.
    """
    real, device, n_envs = context.real, context.device, context.n_envs
    vec3 = wp.types.vector(3, real)
    n_clusters = len(clusters.ball)
    places = (n_envs, n_clusters * CLUSTER_SIZE)
    anchors = anchors_type(real)()
    # A saved state holds these arrays in this order.
    anchors.n_pulling = context.zeros((n_envs, n_clusters), wp.int32)
    groups, list_clusters = active_groups(context, anchors.n_pulling)
    anchors.n_active, anchors.active = groups.n_active, groups.active
    anchors.is_latched, anchors.anchor = context.zeros(places, wp.uint8), context.zeros(places, vec3)
    anchors.n_latched = context.zeros((n_envs, n_clusters), wp.int32)
    anchors.place, anchors.pull = context.zeros(places, vec3), context.zeros(places, vec3)
    slope = max((kind.max_slope for kind in table.kinds), default=1.0)
    follow_points, release_all = _kernels(real, table.functions, slope, area_weighted)
    inputs = [table.struct, upload_clouds(clusters, context), view.pose, view.link, contact_threshold, release_margin]
    follow = context.record(follow_points, (n_envs, n_clusters), inputs, [anchors])

    def reset(envs: wp.array) -> None:
        wp.launch(release_all, dim=places, inputs=[envs], outputs=[anchors], device=device)

    return anchors, in_turn(follow, list_clusters), reset
