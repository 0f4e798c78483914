"""One frame for the kernels of all probes: strips of neighbours, what comes near them, the depth of each probe.

A formula is a Warp function ``feel(numbers, probes, depth, gain, normal, body, e, i, out)``. It writes what probe ``i``
of environment ``e`` reads into ``out``:

* ``numbers``: of the model, a Warp struct or one number.
* ``depth``: the probe's radius minus its distance, not cut at 0, since NaN (a pose that is not finite) must come out as
  NaN: ask ``not (depth <= 0)``, for ``max(0, NaN)`` is 0.
* ``gain``: of the taxel; 1 where no imperfection asks for one.
* ``normal``, ``body``: of what is nearest, -1 for none.

Where nothing comes near a strip the formula is asked with depth 0.
"""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from tactemu.physics.probes.query import contact_function, probes_struct
from tactemu.physics.sensor_model import Site
from tactemu.physics.shapes.rays import thickness_behind
from tactemu.physics.shapes.shape import FAR, table_type

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
def strip_kernel(
    real,
    kinds: frozenset,
    along_normal: bool,
    in_strips: bool,
    feel,
    numbers_type,
    at_surface: bool,
    separate: bool,
    has_gain: bool,
    has_radius: bool,
):
    """The kernel of a formula: the truth and, if ``separate``, the measured branch with its own radii and gains.

    ``at_surface``: probes have no radius, depth is that of the taxel's own place.
    """
    vec3 = wp.types.vector(3, real)
    transform = wp.types.transformation(real)
    shapes_type = table_type(real)
    probes_type = probes_struct(real)
    nearest = contact_function(real, kinds, along_normal)
    touches, noise = strip_function(real, kinds), noise_function(real, has_radius)

    @wp.kernel(module="unique", enable_backward=False)
    def feel_strips(
        first_env: int,
        shapes: shapes_type,
        pose: wp.array2d(dtype=transform),
        targets: wp.array(dtype=wp.int32),
        probes: probes_type,
        numbers: numbers_type,
        gain: wp.array2d(dtype=real),
        radius: wp.array2d(dtype=real),
        # outputs
        truth_out: wp.array3d(dtype=real),
        raw_out: wp.array3d(dtype=real),
    ):
        e, strip = wp.tid()
        if wp.static(turned(kinds, in_strips)):
            strip, e = wp.tid()
        e += first_env
        first = strip * probes.strip
        last = wp.min(first + probes.strip, probes.radii.shape[0])
        if wp.static(in_strips):
            if not touches(shapes, pose, targets, probes, e, strip, noise(probes, radius, e, strip)):
                for i in range(first, last):
                    feel(numbers, probes, real(0.0), real(1.0), vec3(real(0.0)), -1, e, i, truth_out)
                    if wp.static(separate):
                        feel(numbers, probes, real(0.0), real(1.0), vec3(real(0.0)), -1, e, i, raw_out)
                return
        for i in range(first, last):
            r_true = probes.radii[i]
            if r_true > real(0.0):
                if wp.static(at_surface):
                    r_true = real(0.0)
                r_measured = r_true
                if wp.static(has_radius):
                    r_measured = radius[e, i]
                distance, n, b = nearest(shapes, pose, targets, probes, e, i, wp.max(r_true, r_measured))
                feel(numbers, probes, r_true - distance, real(1.0), n, b, e, i, truth_out)
                if wp.static(separate):
                    g = real(1.0)
                    if wp.static(has_gain):
                        g = gain[e, i]
                    feel(numbers, probes, r_measured - distance, g, n, b, e, i, raw_out)

    return feel_strips


def record_strips(
    site: Site, feel, numbers_type, numbers: Any, truth: wp.array, raw: wp.array, *, at_surface: bool = False
) -> Callable[[], None]:
    """A recorded launch of :func:`strip_kernel` over all probes of a sensor.

    Args:
        site: of the sensor.
        feel: the formula, from a cached factory.
        numbers_type: type of ``numbers``.
        numbers: of the model.
        truth: written, ``(n_envs, n_taxels, channels)``.
        raw: of the measured branch, of the same shape; the same array unless ``site.separate``.
        at_surface: no radius, and no branch of its own with noised radii and gains.
    """
    context = site.context
    gain, radius = (None, None) if at_surface else (site.gain, site.radius)
    none = wp.zeros((0, 0), dtype=context.real, device=context.device)
    in_strips = context.device.is_cpu
    measured = (raw is not truth, gain is not None, radius is not None)
    how = (site.along_normal, in_strips, feel, numbers_type, at_surface, *measured)
    kernel = strip_kernel(context.real, site.table.kinds, *how)
    inputs = [site.table.struct, site.view.pose, site.targets, probe_arrays(site), numbers]
    inputs += [none if gain is None else gain, none if radius is None else radius]
    threads = context.n_envs, -(-site.probes.n // strip_length(site))
    dim = threads[::-1] if turned(site.table.kinds, in_strips) else threads
    return context.record(kernel, dim, inputs, [truth, raw])


def probe_arrays(site: Site):
    """The probes as kernels take them."""
    real = site.context.real
    probes = probes_struct(real)()
    probes.positions, probes.normals, probes.radii = site.positions, site.normals, site.radii
    probes.strip, probes.strip_ball = strip_length(site), _strip_balls(site)
    probes.reach = _reach(site) if site.along_normal else wp.zeros(0, dtype=real, device=site.context.device)
    return probes


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
