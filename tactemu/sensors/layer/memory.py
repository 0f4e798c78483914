"""The memory of a layer that relaxes: what its past does to the contact of this step, and what it keeps of it.

With a modulus that relaxes as ``G(t) = 1 - sum g_k (1 - exp(-t / tau_k))`` (:mod:`.relaxation`) the pressures are ``p =
G * dP``, where ``P`` are those of an elastic layer that is displaced equally, ``w = C P``. Each term keeps, per cell,
what has relaxed of ``P``::

    p = P - sum g_k m_k,     dm_k/dt = (P - m_k) / tau_k

``P`` is straight within a step; then ``m_k = a_k m_k' + b_k P' + c_k P`` exactly, with the values ``'`` of the last
step. So, with ``s = 1 - sum g_k c_k`` and ``h = sum g_k (a_k m_k' + b_k P') / s``, which is known before the contact::

    P = z + h,     p = s z,     z >= 0,  C z >= o - C h,  z (C z - (o - C h)) = 0

This is the contact of an elastic layer with less overlap, which :mod:`.pressure` solves. Tractions are treated alike:
``s`` cancels from ``|q| <= mu p``, and the surface is held where it is, less its displacement by memory. One stage,
:mod:`.recall`, stands before the contact, and one, :mod:`.remember`, after it.

The state ``m_k`` is float64 in both float widths: in float32 it would stall where ``tau_k`` is many steps.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

import functools
from typing import Any

import warp as wp

from tactemu.imperfections.material import grown
from tactemu.sensors.layer.window import fit

PRESSURE, ALONG_X, ALONG_Y = 0, 1, 2
"""The components that are kept: pressure, and the tractions."""


@functools.cache
def memory_type(real):
    """Return the Warp struct of the memory, of each cell or environment; those of tractions are empty without
    friction. ``kept`` has the terms of pressures, then those of tractions along x and y."""

    @wp.struct
    class Memory:
        shares: wp.array(dtype=wp.float64)  # g
        times: wp.array(dtype=wp.float64)  # tau [s]
        rest: wp.float64  # 1 - sum g
        decays: wp.array2d(dtype=wp.float64)  # a of this step, per environment and term
        growths: wp.array2d(dtype=wp.float64)  # c
        scale: wp.array(dtype=wp.float64)  # s, per environment
        kept: wp.array4d(dtype=wp.float64)  # m: (n_envs, components x terms, rows, columns)
        whole: wp.array4d(dtype=real)  # P: (n_envs, components, rows, columns)
        box: wp.array(dtype=wp.vec4i)  # window outside which nothing is kept
        peak: wp.array(dtype=wp.float64)  # largest P so far
        overlap: wp.array3d(dtype=real)  # overlap, less the displacement by memory [pitches]
        u: wp.array3d(dtype=real)  # displacement of the surface by memory [pitches]
        v: wp.array3d(dtype=real)
        area: wp.array(dtype=wp.vec4i)  # window in which u and v are known
        held_x: wp.array3d(dtype=wp.float64)  # anchors, with the displacement by memory [pitches]
        held_y: wp.array3d(dtype=wp.float64)
        held: wp.array(dtype=wp.vec4i)  # window of the friction of the last step
        pressure: wp.array3d(dtype=real)  # p
        x: wp.array3d(dtype=real)  # tractions
        y: wp.array3d(dtype=real)

    return Memory


@wp.func
def share_of_step(memory: Any, dt: wp.float64):
    """Return ``s``, the part of a displacement during a step that has not relaxed at its end; all digits of it."""
    s = memory.rest
    for k in range(memory.shares.shape[0]):
        steps = dt / memory.times[k]
        if steps > wp.float64(0.0):
            s += memory.shares[k] * grown(steps) / steps  # 1 - c
        else:
            s += memory.shares[k]
    return s


@wp.func
def within(y: int, x: int, box: wp.vec4i):
    """Return True if a cell is in a box ``(first row, first column, rows, columns)``."""
    return y >= box[0] and y < box[0] + box[2] and x >= box[1] and x < box[1] + box[3]


@wp.func
def window_around(top: int, left: int, bottom: int, right: int, rows: int, columns: int):
    """Return the window of a solver that holds the cells up to ``bottom`` and ``right``, these included; empty if there
    are none."""
    if top > bottom or left > right:
        return wp.vec4i(0, 0, 0, 0)
    down = fit(top, bottom, rows)
    along = fit(left, right, columns)
    return wp.vec4i(down[0], along[0], down[1], along[1])


@wp.func
def term(memory: Any, env: int, k: int, before: wp.float64, kept: wp.float64):
    """Return the part of a term in ``s h``."""
    a = memory.decays[env, k]
    b = wp.float64(1.0) - a - memory.growths[env, k]
    return memory.shares[k] * (a * kept + b * before)
