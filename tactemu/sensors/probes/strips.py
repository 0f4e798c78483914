"""The common kernel of all probes: strips of neighbours, the bodies near them, and the reading of each probe.

On a GPU each thread has its own probe (:mod:`tactemu.sensors.probes.blocks`); where bodies are searched, the probes
near to any are listed first (:mod:`tactemu.sensors.probes.near_list`).
"""

# pyright: reportArgumentType=false, reportAssignmentType=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools
from typing import Any

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel
from tactemu.geometry.shapes.rays import thickness_behind
from tactemu.geometry.shapes.shape import FAR
from tactemu.geometry.simd import WIDTH
from tactemu.plan.launches import Launch
from tactemu.plan.scalars import natural
from tactemu.sensors.probes.balls_simd import ball_kernel, is_ball_formula, probe_lanes
from tactemu.sensors.probes.blocks import Blocks, block_kernel
from tactemu.sensors.probes.formula import Formula, probe_functions, task_type
from tactemu.sensors.probes.near_list import record_listed
from tactemu.sensors.probes.query import probes_struct
from tactemu.sensors.sensed import is_near, near_bits, sensed_type
from tactemu.sensors.sensor_model import Site

PROBES_PER_STRIP = WIDTH
"""Number of probes that one thread handles on a CPU, where a thread is a function call."""


@functools.cache
def strip_function(real, kinds: frozenset):
    """Return ``touches(sensed, near, probes, e, strip, noise) -> bool``.

    May any body reach any probe of a strip? This is the broad phase: one test per strip and body of the balls around
    them. ``noise`` is added to the radii.
    """
    vec3 = wp.types.vector(3, real)
    sensed_struct, probes_type = sensed_type(real), probes_struct(real)

    @wp.func
    def touches(sensed: sensed_struct, near: wp.int64, probes: probes_type, e: int, strip: int, noise: real):
        ball = probes.strip_ball[strip]
        centre = vec3(ball[0], ball[1], ball[2])
        for t in range(sensed.targets.shape[0]):
            if not is_near(near, t):
                continue
            b = sensed.targets[t]
            d = centre - wp.transform_get_translation(sensed.pose[e, b])
            reach = sensed.shapes.bound[b] + ball[3] + noise
            if not (wp.dot(d, d) > reach * reach):  # NaN needs the exact test
                return True
        return False

    return touches


@functools.cache
def noise_function(real, has_radius: bool):
    """Return ``noise(probes, radius, e, strip)``: the largest excess of a measured radius over the nominal one in a
    strip."""
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
def strip_kernel(formula: Formula):
    """Return the kernel of a formula on a CPU: the truth and, if separate, the measured branch."""
    real, task_struct = formula.real, task_type(formula.real, formula.numbers)
    margin, nearest, write, away = probe_functions(formula)
    touches, noise = strip_function(real, formula.kinds), noise_function(real, formula.has_radius)

    @warp_kernel
    def measure_strips(first_env: int, task: task_struct):
        e, strip = wp.tid()
        e = natural(e + first_env)
        strip = natural(strip)
        first = strip * task.probes.strip
        last = wp.min(first + task.probes.strip, task.probes.radii.shape[0])
        near = near_bits(task.sensed.near, task.sensed.targets, e)
        if not touches(task.sensed, near, task.probes, e, strip, noise(task.probes, task.radius, e, strip)):
            for i in range(first, last):
                away(task, e, i)
            return
        i = int(first)  # a while loop, not a range: see the query
        while i < last:
            i = natural(i)
            reach = margin(task, e, i)
            if reach >= real(0.0):
                distance, normal, b = nearest(task.sensed, near, task.probes, e, i, reach)
                write(task, distance, normal, b, e, i)
            i += 1

    return measure_strips


def record_strips(
    site: Site,
    measure,
    numbers_type,
    numbers: Any,
    truth: wp.array,
    raw: wp.array,
    *,
    at_surface: bool = False,
    simd: str = "",
) -> Launch:
    """Return the recorded launches of a formula over all probes of a sensor.

    Args:
        site: the site of the sensor.
        measure: the formula, from a cached factory.
        numbers_type: type of ``numbers``.
        numbers: parameters of the model.
        truth: the output, ``(n_envs, n_taxels, channels)``.
        raw: output of the measured branch, of the same shape; the same array unless ``site.separate``.
        at_surface: ignore radii, and compute no separate branch with noised radii and gains.
        simd: the formula on vectors of probes (:mod:`.balls_simd`).
    """
    context = site.context
    gain, radius = (None, None) if at_surface else (site.gain, site.radius)
    none = wp.zeros((0, 0), dtype=context.real, device=context.device)
    measured = (raw is not truth, gain is not None, radius is not None)
    formula = Formula(
        context.real, site.table.kinds, site.along_normal, measure, numbers_type, at_surface, *measured, simd
    )
    _watch(site, formula.has_radius)
    task = task_type(context.real, numbers_type)()
    task.sensed, task.probes, task.numbers, task.truth, task.raw = site.sensed, probe_arrays(site), numbers, truth, raw
    task.gain, task.radius = none if gain is None else gain, none if radius is None else radius
    return _record(site, formula, task)


def _record(site: Site, formula: Formula, task) -> Launch:
    """Return the recorded launch of the kernel that is fastest on the device."""
    context = site.context
    if context.device.is_cpu and is_ball_formula(formula):
        return context.record(ball_kernel(formula), context.n_envs, [task, probe_lanes(site)], [])
    if context.device.is_cpu:
        dim = context.n_envs, -(-site.probes.n // PROBES_PER_STRIP)
        return context.record(strip_kernel(formula), dim, [task], [])
    if any(kind.is_searched for kind in formula.kinds):
        return record_listed(site, formula, task)
    blocks = Blocks(context.n_envs, site.probes.n)
    kernel = block_kernel(formula, blocks.shift)
    return context.record(kernel, blocks.n_threads, [task], [], block_dim=blocks.block_dim)


def _watch(site: Site, has_noise: bool) -> None:
    """Register this skin's probes, so that ``site.view.near`` marks the bodies near to them."""
    probes = site.probes
    bounds = np.array([row.bound for row in site.table.rows])
    if site.along_normal or has_noise:  # it may reach beyond its radii
        bounds = np.full(len(bounds), FAR)
    site.view.watch(probes.positions, np.broadcast_to(probes.radii, probes.n), bounds)


def probe_arrays(site: Site):
    """Return the probes as the kernels take them."""
    real = site.context.real
    probes = probes_struct(real)()
    probes.positions, probes.normals, probes.radii = site.positions, site.normals, site.radii
    probes.strip = PROBES_PER_STRIP if site.context.device.is_cpu else 1
    probes.strip_ball = _strip_balls(site, probes.strip)
    probes.reach = ray_reach(site) if site.along_normal else wp.zeros(0, dtype=real, device=site.context.device)
    return probes


def _strip_balls(site: Site, length: int) -> wp.array:
    """Centre and radius, probe radii and the ray's reach included, of the ball around each strip; none on a GPU."""
    probes = site.probes
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


def ray_reach(site: Site) -> wp.array:
    """Return the distance behind each probe at which the ray query begins [m]: the option, or to the far side of the
    link."""
    context, given = site.context, site.model.ray_reach
    if given is not None or site.link.shape is None:
        values = np.full(site.probes.n, FAR if given is None else given)
        return wp.array(values, dtype=context.real, device=context.device)
    return thickness_behind(site.own_table, site.link.index, site.positions, site.normals, context)
