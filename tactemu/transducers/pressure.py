"""The load of a taxel, one number, from a reading; and that number as a push along the normal."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.transducers.transducer import SignalType, TransducerSite

TAKES = ("force", "pressure")


@functools.cache
def pressure_function(real, vector: bool):
    """``load(x, normals, areas, e, i)``: pressure on a taxel [Pa], 0 where it is pulled; NaN stays NaN."""
    vec3 = wp.types.vector(3, real)

    @wp.func
    def load(
        x: wp.array3d(dtype=real), normals: wp.array(dtype=vec3), areas: wp.array(dtype=real), e: int, i: int
    ) -> real:
        p = x[e, i, 0]
        if wp.static(vector):
            n = normals[i]
            p = -(x[e, i, 0] * n[0] + x[e, i, 1] * n[1] + x[e, i, 2] * n[2]) / areas[i]
        return wp.where(p < real(0.0), real(0.0), p)  # not max(), which would hide a NaN

    return load


def skin_arrays(site: TransducerSite) -> list[wp.array]:
    """Normals and areas, as :func:`pressure_function` wants them."""
    vec3 = wp.types.vector(3, site.context.real)
    return [site.constant(site.normals, vec3), site.constant(np.broadcast_to(site.areas, len(site.normals)))]


def output_type(taken: SignalType, own: SignalType, rated: float | None) -> SignalType:
    """What a transducer gives: its own quantity, or what it takes where it says of which rated load it is a share."""
    return own if rated is None else taken
