"""How deep each probe is in what it touches: the query that ContactProbe, ContactDepthProbe and KinematicTaxel share.

``d = max(0, R - distance)`` over the bodies felt: a probe at the surface of a body reads its radius ``R``, and one in
free space within ``R`` reads ``R`` minus the distance. There is no gate: two fixed bodies touch as any two do.
The distance is that to the nearest surface, or with ``contact_depth_query="ray"`` that along the taxel's normal.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.physics.sensor import Site, Trial
from tactemu.physics.shapes.distance import shape_functions
from tactemu.physics.shapes.rays import ray_function, thickness_behind
from tactemu.physics.shapes.shape import FAR, table_type


@functools.cache
def probes_struct(real):
    """The Warp struct of a sensor's probes: what does not change from step to step."""
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)

    @wp.struct
    class ProbeArrays:
        positions: wp.array(dtype=vec3)
        normals: wp.array(dtype=vec3)
        radii: wp.array(dtype=real)
        reach: wp.array(dtype=real)  # how far behind a probe the ray query begins; empty for the others
        strip: wp.int32  # probes that one thread handles
        strip_ball: wp.array(dtype=vec4)  # per strip: centre and radius of a ball that holds its probes

    return ProbeArrays


@functools.cache
def nearest_function(real, kinds: frozenset):
    """``nearest(shapes, pose, targets, e, r, margin) -> (distance, normal, body)``.

    Among the bodies felt in environment ``e`` the one nearest to the point ``r`` of the link's frame, and its normal
    there in that frame. Bodies farther than ``margin`` may be skipped: then the distance is 1e18 m and the body -1. A
    pose that is not finite gives a NaN distance.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    functions = shape_functions(real, kinds)
    distance_in_link, reaches = functions.distance_in_link, functions.reaches

    @wp.func
    def nearest(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        e: int,
        r: vec3,
        margin: real,
    ):
        best = real(FAR)
        normal = vec3(real(0.0))
        body = int(-1)
        for t in range(targets.shape[0]):
            b = targets[t]
            x = pose[e, b]
            if wp.isnan(wp.transform_get_translation(x)[0]):
                best = real(wp.nan)  # and no d is less than NaN
                body = -1
            elif reaches(shapes, b, x, r, margin):
                d, n = distance_in_link(shapes, b, x, r)
                if d < best:
                    best = d
                    normal = n
                    body = b
        return best, normal, body

    return nearest


@functools.cache
def first_function(real, kinds: frozenset):
    """``first(shapes, pose, targets, e, r, m, reach, margin) -> (distance, normal, body)``.

    As :func:`nearest_function`, along the taxel's normal ``m`` from ``reach`` behind ``r`` on; the normal is ``-m``.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    enters = ray_function(real, kinds)

    @wp.func
    def first(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        e: int,
        r: vec3,
        m: vec3,
        reach: real,
        margin: real,
    ):
        best = real(FAR)
        body = int(-1)
        for t in range(targets.shape[0]):
            b = targets[t]
            x = pose[e, b]
            if wp.isnan(wp.transform_get_translation(x)[0]):
                best = real(wp.nan)
                body = -1
            else:
                d = enters(shapes, b, x, r, m, reach, margin)
                if d < best:
                    best = d
                    body = b
        return best, -m, body

    return first


@functools.cache
def strip_function(real, kinds: frozenset):
    """``touches(shapes, pose, targets, probes, e, strip, noise) -> bool``: may any body reach any probe of a strip?

    The broad phase: one look per strip and body at the balls around them. ``noise`` is added to the radii.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    probes_type = probes_struct(real)

    @wp.func
    def touches(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        probes: probes_type,
        e: int,
        strip: int,
        noise: real,
    ):
        ball = probes.strip_ball[strip]
        centre = vec3(ball[0], ball[1], ball[2])
        for t in range(targets.shape[0]):
            b = targets[t]
            d = centre - wp.transform_get_translation(pose[e, b])
            reach = shapes.bound[b] + ball[3] + noise
            if not (wp.dot(d, d) > reach * reach):  # NaN is looked at closely
                return True
        return False

    return touches


@functools.cache
def noise_function(real, has_radius: bool):
    """``noise(probes, radius, e, strip)``: by how much a radius of the measured branch exceeds the nominal, at most."""
    probes_type = probes_struct(real)

    @wp.func
    def noise(probes: probes_type, radius: wp.array2d(dtype=real), e: int, strip: int):
        grown = real(0.0)
        if wp.static(has_radius):
            for i in range(strip * probes.strip, wp.min((strip + 1) * probes.strip, probes.radii.shape[0])):
                grown = wp.max(grown, radius[e, i] - probes.radii[i])
        return grown

    return noise


@functools.cache
def contact_function(real, kinds: frozenset, along_normal: bool):
    """``contact(shapes, pose, targets, probes, e, i, margin) -> (distance, normal, body)`` of probe ``i``."""
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    probes_type = probes_struct(real)
    nearest = nearest_function(real, kinds)
    first = first_function(real, kinds)

    @wp.func
    def to_surface(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        probes: probes_type,
        e: int,
        i: int,
        margin: real,
    ):
        return nearest(shapes, pose, targets, e, probes.positions[i], margin)

    @wp.func
    def along(
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        probes: probes_type,
        e: int,
        i: int,
        margin: real,
    ):
        return first(shapes, pose, targets, e, probes.positions[i], probes.normals[i], probes.reach[i], margin)

    return along if along_normal else to_surface


def probe_arrays(site: Site):
    """The probes as kernels take them."""
    real = site.context.real
    probes = probes_struct(real)()
    probes.positions, probes.normals, probes.radii = site.positions, site.normals, site.radii
    probes.strip, probes.strip_ball = strip_length(site), _strip_balls(site)
    probes.reach = _reach(site) if site.along_normal else wp.zeros(0, dtype=real, device=site.context.device)
    return probes


CHEAPER_QUERY = 'set `contact_depth_query = "sdf"`'
"""What makes a query cost less, for the plan."""


def query_trials() -> list[Trial]:
    """The ways to find depth, cheapest first."""
    return [
        Trial("nearest surface"),
        Trial("voxels", {"contact_depth_query": "voxel"}),
        Trial("along the normal", {"contact_depth_query": "ray"}),
    ]


STRIP = 8
"""Probes that one thread handles on the CPU, where a thread is a call."""


def strip_length(site: Site) -> int:
    """Probes that one thread handles: one on a GPU, a run of neighbours on the CPU."""
    return STRIP if site.context.device.is_cpu else 1


def turned(kinds: frozenset, in_strips: bool) -> bool:
    """Do threads side by side take environments, not probes?

    On a GPU with meshes: searches for one probe in many environments go similar ways, those for neighbouring probes,
    of which some are near the mesh and some are not, do not. Writing is less orderly then, so not without meshes.
    """
    return not in_strips and any(kind.searched for kind in kinds)


def strips(site: Site) -> tuple[int, int]:
    """Threads of a launch over all probes: ``(n_envs, strips)``, or the other way round if :func:`turned`."""
    n_envs, n_strips = site.context.n_envs, -(-site.probes.n // strip_length(site))
    return (n_strips, n_envs) if turned(site.table.kinds, site.context.device.is_cpu) else (n_envs, n_strips)


def _strip_balls(site: Site) -> wp.array:
    """Centre and radius, probe radii and the ray's reach included, of the ball around each strip; none on a GPU."""
    length, probes = strip_length(site), site.probes
    count = -(-probes.n // length) if length > 1 else 0
    balls = np.zeros((count, 4))
    if count:
        missing = count * length - probes.n
        points = np.pad(probes.positions, ((0, missing), (0, 0)), mode="edge").reshape(count, length, 3)
        radii = np.pad(probes.radii, (0, missing)).reshape(count, length)
        centres = 0.5 * points.min(1) + 0.5 * points.max(1)
        away = np.linalg.norm(points - centres[:, None], axis=2).max(1)
        balls[:, :3], balls[:, 3] = centres, FAR if site.along_normal else away + radii.max(1)
    return wp.array(balls, dtype=wp.types.vector(4, site.context.real), device=site.context.device)


def _reach(site: Site) -> wp.array:
    """How far behind each probe the ray query begins [m]: the option, or to the far side of the sensor's link."""
    context, given = site.context, site.model.ray_reach
    if given is not None or site.link.shape is None:
        values = np.full(site.probes.n, FAR if given is None else given)
        return wp.array(values, dtype=context.real, device=context.device)
    return thickness_behind(site.own_table, site.link.index, site.positions, site.normals, context)
