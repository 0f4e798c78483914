"""The reading of one probe, as Warp functions made from a model's formula.

A formula is a Warp function ``measure(numbers, probes, touch, e, i, out)``. It writes the reading of probe ``i`` of
environment ``e`` into ``out``:

* ``numbers``: parameters of the model, a Warp struct or one number.
* ``touch``: what the query found (:func:`~tactemu.sensors.probes.query.touch_type`). Its depth is not clipped at 0,
  since NaN (a pose that is not finite) must come out as NaN: test ``not (depth <= 0)``, for ``max(0, NaN)`` is 0.

The formula is called with depth 0 where no body is near a probe.
"""

# pyright: reportCallIssue=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.probes.query import contact_function, probes_struct, touch_type
from tactemu.sensors.sensed import sensed_type


class Formula(NamedTuple):
    """The parameters of a kernel, by which the factories of kernels are cached."""

    real: Any
    """The float type."""
    kinds: frozenset
    """Kinds of shape in the scene."""
    along_normal: bool
    measure: Any
    """The Warp function, from a cached factory."""
    numbers: Any
    """Type of the model's parameters."""
    at_surface: bool
    """Is depth that of the taxel's own position, so that probes have no radius?"""
    separate: bool
    """Is there a measured branch beside the truth, with its own radii and gains?"""
    has_gain: bool
    has_radius: bool
    simd: str
    """The formula on SIMD vectors of probes, a snippet of C++ for :mod:`.balls_simd`; empty where it has none."""


@functools.cache
def task_type(real, numbers_type):
    """Return the Warp struct of all that the kernels of a formula read and write; ``numbers_type`` is that of the
    model's parameters."""

    @wp.struct
    class Task:
        sensed: sensed_type(real)
        probes: probes_struct(real)
        numbers: numbers_type
        gain: wp.array2d(dtype=real)  # of the measured branch, (n_envs, n_probes)
        radius: wp.array2d(dtype=real)  # likewise
        truth: wp.array3d(dtype=real)  # written, (n_envs, n_probes, channels)
        raw: wp.array3d(dtype=real)  # written: the measured branch

    return Task


class ProbeFunctions(NamedTuple):
    """The Warp functions of probe ``i`` in environment ``e``."""

    margin: Any
    """``margin(task, e, i)`` returns its radius, the larger of both branches [m]; negative for a filler."""
    nearest: Any
    """:func:`~tactemu.sensors.probes.query.contact_function`"""
    write: Any
    """``write(task, distance, normal, body, e, i)`` writes its reading."""
    away: Any
    """``away(task, e, i)`` writes its reading where no body is near."""


@functools.cache
def probe_functions(formula: Formula) -> ProbeFunctions:
    """Return the Warp functions that a kernel of this formula calls."""
    real, measure, at_surface = formula.real, formula.measure, formula.at_surface
    separate, has_gain, has_radius = formula.separate, formula.has_gain, formula.has_radius
    vec3 = wp.types.vector(3, real)
    task_struct, touch_struct = task_type(real, formula.numbers), touch_type(real)

    @wp.func
    def margin(task: task_struct, e: int, i: int):
        r = task.probes.radii[i]
        if not (r > real(0.0)):
            return real(-1.0)
        if wp.static(at_surface):
            return real(0.0)
        if wp.static(has_radius):
            r = wp.max(r, task.radius[e, i])
        return r

    @wp.func
    def write(task: task_struct, distance: real, normal: vec3, body: int, e: int, i: int):
        r = real(0.0)
        if wp.static(not at_surface):
            r = task.probes.radii[i]
        measure(task.numbers, task.probes, touch_struct(r - distance, real(1.0), normal, body), e, i, task.truth)
        if wp.static(separate):
            if wp.static(has_radius):
                r = task.radius[e, i]
            g = real(1.0)
            if wp.static(has_gain):
                g = task.gain[e, i]
            measure(task.numbers, task.probes, touch_struct(r - distance, g, normal, body), e, i, task.raw)

    @wp.func
    def away(task: task_struct, e: int, i: int):
        nothing = touch_struct(real(0.0), real(1.0), vec3(real(0.0)), -1)
        measure(task.numbers, task.probes, nothing, e, i, task.truth)
        if wp.static(separate):
            measure(task.numbers, task.probes, nothing, e, i, task.raw)

    return ProbeFunctions(margin, contact_function(real, formula.kinds, formula.along_normal), write, away)
