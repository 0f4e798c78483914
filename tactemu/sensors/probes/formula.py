"""The reading of one probe, as Warp functions made from a model's formula.

A formula is a Warp function ``measure(numbers, probes, depth, gain, normal, body, e, i, out)``. It writes the reading
of probe ``i`` of environment ``e`` into ``out``:

* ``numbers``: parameters of the model, a Warp struct or one number.
* ``depth``: the probe's radius minus its distance, not clipped at 0, since NaN (a pose that is not finite) must come
  out as NaN: test ``not (depth <= 0)``, for ``max(0, NaN)`` is 0.
* ``gain``: gain of the taxel; 1 where no imperfection sets one.
* ``normal``, ``body``: normal and index of the nearest body; -1 for none.

The formula is called with depth 0 where no body is near a probe.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.probes.query import contact_function, probes_struct


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


class ProbeFunctions(NamedTuple):
    """The Warp functions of probe ``i`` in environment ``e``."""

    margin: Any
    """``margin(probes, radius, e, i)`` returns its radius, the larger of both branches [m]; negative for a filler."""
    nearest: Any
    """:func:`~tactemu.sensors.probes.query.contact_function`"""
    write: Any
    """``write(probes, numbers, gain, radius, distance, normal, body, e, i, truth_out, raw_out)`` writes its reading."""
    away: Any
    """``away(probes, numbers, e, i, truth_out, raw_out)`` writes its reading where no body is near."""


@functools.cache
def probe_functions(formula: Formula) -> ProbeFunctions:
    """Return the Warp functions that a kernel of this formula calls."""
    real, measure, numbers_type = formula.real, formula.measure, formula.numbers
    at_surface, separate, has_gain, has_radius = formula[-4:]
    vec3 = wp.types.vector(3, real)
    probes_type = probes_struct(real)

    @wp.func
    def margin(probes: probes_type, radius: wp.array2d(dtype=real), e: int, i: int):
        r = probes.radii[i]
        if not (r > real(0.0)):
            return real(-1.0)
        if wp.static(at_surface):
            return real(0.0)
        if wp.static(has_radius):
            r = wp.max(r, radius[e, i])
        return r

    @wp.func
    def write(
        probes: probes_type,
        numbers: numbers_type,
        gain: wp.array2d(dtype=real),
        radius: wp.array2d(dtype=real),
        distance: real,
        normal: vec3,
        body: int,
        e: int,
        i: int,
        truth_out: wp.array3d(dtype=real),
        raw_out: wp.array3d(dtype=real),
    ):
        r = real(0.0)
        if wp.static(not at_surface):
            r = probes.radii[i]
        measure(numbers, probes, r - distance, real(1.0), normal, body, e, i, truth_out)
        if wp.static(separate):
            if wp.static(has_radius):
                r = radius[e, i]
            g = real(1.0)
            if wp.static(has_gain):
                g = gain[e, i]
            measure(numbers, probes, r - distance, g, normal, body, e, i, raw_out)

    @wp.func
    def away(
        probes: probes_type,
        numbers: numbers_type,
        e: int,
        i: int,
        truth_out: wp.array3d(dtype=real),
        raw_out: wp.array3d(dtype=real),
    ):
        measure(numbers, probes, real(0.0), real(1.0), vec3(real(0.0)), -1, e, i, truth_out)
        if wp.static(separate):
            measure(numbers, probes, real(0.0), real(1.0), vec3(real(0.0)), -1, e, i, raw_out)

    return ProbeFunctions(margin, contact_function(real, formula.kinds, formula.along_normal), write, away)
