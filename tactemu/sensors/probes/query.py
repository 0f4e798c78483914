"""The depth of each probe in the bodies that it touches: the query of ContactProbe, ContactDepthProbe and
KinematicTaxel.

``d = max(0, R - distance)`` over the sensed bodies: a probe at the surface of a body reads its radius ``R``, and one in
free space within ``R`` reads ``R`` minus the distance. There is no gate: two fixed bodies touch like any others. The
distance is that to the nearest surface, or with ``depth_query="ray"`` that along the taxel's normal.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false

import functools
from typing import Any

import warp as wp

from tactemu.geometry.shapes.distance import shape_functions
from tactemu.geometry.shapes.rays import ray_function
from tactemu.geometry.shapes.shape import FAR
from tactemu.plan.scalars import is_nan, natural
from tactemu.sensors.sensed import ALL_NEAR, is_near, sensed_type
from tactemu.sensors.sensor_model import Setting


@functools.cache
def probes_struct(real):
    """Return the Warp struct of a sensor's probes, which do not change from step to step."""
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)

    @wp.struct
    class ProbeArrays:
        positions: wp.array(dtype=vec3)
        normals: wp.array(dtype=vec3)
        radii: wp.array(dtype=real)
        reach: wp.array(dtype=real)  # distance behind a probe at which the ray query begins; empty for other queries
        strip: wp.int32  # probes that one thread handles
        strip_ball: wp.array(dtype=vec4)  # per strip: centre and radius of a ball that holds its probes

    return ProbeArrays


@functools.cache
def touch_type(real):
    """Return the Warp struct of what a query finds out about a probe."""

    @wp.struct
    class Touch:
        depth: real  # the probe's radius minus its distance, not clipped at 0; NaN for a pose that is not finite
        gain: real  # of the taxel; 1 where no imperfection sets one
        normal: wp.types.vector(3, real)  # of the nearest body
        body: wp.int32  # its index; -1: no body is near

    return Touch


@functools.cache
def nearest_of_function(real, kinds: frozenset):
    """Return ``nearest(sensed, near, e, r, margin) -> (distance, normal, body)``: like
    :func:`nearest_function`, over those sensed bodies that may be ``near`` (:func:`near_bits`)."""
    vec3 = wp.types.vector(3, real)
    sensed_struct = sensed_type(real)
    functions = shape_functions(real, kinds)
    distance_in_link, reaches = functions.distance_in_link, functions.reaches

    @wp.func
    def nearest(sensed: sensed_struct, near: wp.int64, e: int, r: vec3, margin: real):
        best = real(FAR)
        normal = vec3(real(0.0))
        body = int(-1)
        t = int(0)  # a while loop: Warp's ranges would take a third of the time on a CPU
        while t < sensed.targets.shape[0]:
            if is_near(near, t):
                b = natural(sensed.targets[natural(t)])
                x = sensed.pose[e, b]
                if is_nan(wp.transform_get_translation(x)[0]):
                    best = real(wp.nan)  # and no d is less than NaN
                    body = -1
                elif reaches(sensed.shapes, b, x, r, margin):
                    d, n = distance_in_link(sensed.shapes, b, x, r)
                    if d < best:
                        best = d
                        normal = n
                        body = b
            t += 1
        return best, normal, body

    return nearest


@functools.cache
def nearest_function(real: Any, kinds: frozenset[Any]) -> Any:
    """Return ``nearest(sensed, e, r, margin) -> (distance, normal, body)``.

    It finds the sensed body in environment ``e`` nearest to the point ``r`` of the link's frame, and its normal there
    in that frame. Bodies farther than ``margin`` may be skipped: then the distance is 1e18 m and the body -1. A pose
    that is not finite gives a NaN distance.
    """
    nearest_of = nearest_of_function(real, kinds)

    @wp.func
    def nearest(sensed: sensed_type(real), e: int, r: wp.types.vector(3, real), margin: real):
        return nearest_of(sensed, ALL_NEAR, e, r, margin)

    return nearest


@functools.cache
def first_function(real, kinds: frozenset):
    """Return ``first(sensed, near, e, r, m, reach, margin) -> (distance, normal, body)``.

    It works like :func:`nearest_function`, along the taxel's normal ``m`` starting ``reach`` behind ``r``; the normal
    is ``-m``.
    """
    vec3 = wp.types.vector(3, real)
    sensed_struct = sensed_type(real)
    enters = ray_function(real, kinds)

    @wp.func
    def first(sensed: sensed_struct, near: wp.int64, e: int, r: vec3, m: vec3, reach: real, margin: real):
        best = real(FAR)
        body = int(-1)
        for t in range(sensed.targets.shape[0]):
            if not is_near(near, t):
                continue
            b = natural(sensed.targets[natural(t)])
            x = sensed.pose[e, b]
            if is_nan(wp.transform_get_translation(x)[0]):
                best = real(wp.nan)
                body = -1
            else:
                d = enters(sensed.shapes, b, x, r, m, reach, margin)
                if d < best:
                    best = d
                    body = b
        return best, -m, body

    return first


@functools.cache
def contact_function(real, kinds: frozenset, along_normal: bool):
    """Return ``contact(sensed, near, probes, e, i, margin) -> (distance, normal, body)`` of probe ``i``."""
    sensed_struct = sensed_type(real)
    probes_type = probes_struct(real)
    nearest = nearest_of_function(real, kinds)
    first = first_function(real, kinds)

    @wp.func
    def to_surface(sensed: sensed_struct, near: wp.int64, probes: probes_type, e: int, i: int, margin: real):
        return nearest(sensed, near, e, probes.positions[i], margin)

    @wp.func
    def along(sensed: sensed_struct, near: wp.int64, probes: probes_type, e: int, i: int, margin: real):
        return first(sensed, near, e, probes.positions[i], probes.normals[i], probes.reach[i], margin)

    return along if along_normal else to_surface


@functools.cache
def within_function(real, kinds: frozenset, along_normal: bool):
    """Return ``within(sensed, probes, e, i, margin) -> bool``: may any body touch probe ``i``? It is cheap."""
    vec3 = wp.types.vector(3, real)
    sensed_struct = sensed_type(real)
    probes_type = probes_struct(real)
    reaches = shape_functions(real, kinds).reaches

    @wp.func
    def within(sensed: sensed_struct, probes: probes_type, e: int, i: int, margin: real):
        for t in range(sensed.targets.shape[0]):
            b = natural(sensed.targets[natural(t)])
            if wp.static(along_normal):
                o = probes.positions[i] - wp.transform_get_translation(sensed.pose[e, b])
                across = vec3(wp.cross(o, probes.normals[i]))
                bound = sensed.shapes.bound[b]
                if not (wp.dot(across, across) > bound * bound):  # NaN needs the exact test
                    return True
            elif reaches(sensed.shapes, b, sensed.pose[e, b], probes.positions[i], margin):
                return True
        return False

    return within


CHEAPER_QUERY = 'set `depth_query = "sdf"`'
"""The advice to make a query cost less, for the plan."""


def query_trials() -> list[Setting]:
    """Return the ways to find depth, cheapest first."""
    return [
        Setting("nearest surface"),
        Setting("band", {"depth_query": "band"}),
        Setting("voxels", {"depth_query": "voxel"}),
        Setting("along the normal", {"depth_query": "ray"}),
    ]
