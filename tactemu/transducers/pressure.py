"""The pressure on a taxel, from a model's force or pressure, for transducers that respond to it."""

import functools

import numpy as np
import warp as wp

from tactemu.transducers.transducer import SignalType, TransducerSite

TAKES = ("force", "pressure")
"""The quantities from which a pressure is computed, best first."""


@functools.cache
def skin_type(real):
    """Return the Warp struct of the taxels of a skin."""

    @wp.struct
    class Skin:
        normals: wp.array(dtype=wp.types.vector(3, real))
        areas: wp.array(dtype=real)

    return Skin


@functools.cache
def pressure_function(real, vector: bool):
    """Return the Warp function ``pressure(x, skin, e, i)``: pressure on a taxel [Pa], 0 where it is pulled.

    NaN stays NaN. ``vector``: ``x`` holds forces, else pressures.
    """

    @wp.func
    def pressure(x: wp.array3d(dtype=real), skin: skin_type(real), e: int, i: int) -> real:
        p = x[e, i, 0]
        if wp.static(vector):
            n = skin.normals[i]
            p = -(x[e, i, 0] * n[0] + x[e, i, 1] * n[1] + x[e, i, 2] * n[2]) / skin.areas[i]
        return wp.where(p < real(0.0), real(0.0), p)  # not max(), which would hide a NaN

    return pressure


def skin_arrays(site: TransducerSite):
    """Return the taxels of a skin as :func:`pressure_function` takes them."""
    skin = skin_type(site.context.real)()
    skin.normals = site.constant(site.normals, wp.types.vector(3, site.context.real))
    skin.areas = site.constant(np.broadcast_to(site.areas, len(site.normals)))
    return skin


def output_type(taken: SignalType, own: SignalType, rated: float | None) -> SignalType:
    """Return the type of a transducer's signal: its own, or with a rated force that of its input."""
    return own if rated is None else taken
