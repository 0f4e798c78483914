"""The pressure on a taxel, from a model's force or pressure, for transducers that respond to it."""

import functools

import numpy as np
import warp as wp

from tactemu.transducers.transducer import SignalType, TransducerSite

TAKES = ("force", "pressure")
"""The quantities from which a pressure is computed, best first."""


@functools.cache
def pressure_function(real, vector: bool):
    """Return the Warp function ``pressure(x, normals, areas, e, i)``: pressure on a taxel [Pa], 0 where it is pulled.

    NaN stays NaN. ``vector``: ``x`` holds forces, else pressures.
    """
    vec3 = wp.types.vector(3, real)

    @wp.func
    def pressure(
        x: wp.array3d(dtype=real), normals: wp.array(dtype=vec3), areas: wp.array(dtype=real), e: int, i: int
    ) -> real:
        p = x[e, i, 0]
        if wp.static(vector):
            n = normals[i]
            p = -(x[e, i, 0] * n[0] + x[e, i, 1] * n[1] + x[e, i, 2] * n[2]) / areas[i]
        return wp.where(p < real(0.0), real(0.0), p)  # not max(), which would hide a NaN

    return pressure


def skin_arrays(site: TransducerSite) -> list[wp.array]:
    """Return the taxels' normals and areas on the device, as :func:`pressure_function` takes them."""
    vec3 = wp.types.vector(3, site.context.real)
    return [site.constant(site.normals, vec3), site.constant(np.broadcast_to(site.areas, len(site.normals)))]


def output_type(taken: SignalType, own: SignalType, rated: float | None) -> SignalType:
    """Return the type of a transducer's signal: its own, or with a rated force that of its input."""
    return own if rated is None else taken
