"""The tangential half of the layer's compliance, on spectra: displacement along the surface by tractions and pressures.

Tractions along x and y move the surface along both. With the mirrored wave numbers that an odd kernel needs
(:mod:`.convolution`)::

    U_x(k) = xx(k) T_x(k) + xy(k) T_y(-k)          u_x by pressure: U_x(kx, ky) = nx(k) P(-kx, ky)
    U_y(k) = yy(k) T_y(k) + xy(k) T_x(-k)          u_y by pressure: U_y(kx, ky) = ny(k) P(kx, -ky)

``-k`` mirrors both wave numbers. Lengths of transforms are powers of two, so that masking bits gives a mirrored place.
"""

# pyright: reportIndexIssue=false, reportGeneralTypeIssues=false

import functools
from typing import Any, NamedTuple

import warp as wp

from tactemu.sensors.layer.block import Window, block_sync, spread
from tactemu.sensors.layer.convolution import convolution_functions, workspace_type
from tactemu.sensors.layer.simd import simd_by_pressure, simd_mix
from tactemu.sensors.layer.tables import tables_type


class TangentialFunctions(NamedTuple):
    """The Warp functions that all threads of a block call together; ``at`` is the :class:`~.block.Window`."""

    mix: Any
    """``mix(ws, at, tables)`` turns the tractions in the two spectra into displacements."""
    by_pressure: Any
    """``by_pressure(ws, at, tables, axis)`` writes the displacement along x (axis 0) or y (1) by the pressure in the
    first spectrum to the second, and keeps the first."""
    displace: Any
    """``displace(ws, at, tables, pulled)`` turns the spectra of pressure and, if ``pulled``, of both tractions into
    those of the displacement into the skin, along x and along y, in this order."""
    by_traction: Any
    """``by_traction(ws, at, tables, x, y, out_x, out_y)`` computes the displacement in a window by the tractions ``x,
    y`` in it."""


@functools.cache
def tangential_functions(real, lanes: int, is_shared: bool) -> TangentialFunctions:
    """Return the functions for one float type and lane width; ``is_shared``: the workspace is in shared memory
    (:mod:`.shared_memory`)."""
    workspace = workspace_type(real)
    tables_struct = tables_type(real)
    functions = convolution_functions(real, lanes, is_shared)
    forward, inverse = functions.forward, functions.inverse
    grid = wp.array2d(dtype=real)
    quad = wp.types.vector(4, real)
    mix_simd, by_pressure_simd = simd_mix(real), simd_by_pressure(real)

    @wp.func
    def mix(ws: workspace, at: Window, tables: tables_struct):
        x = ws.spectrum[at.slot]
        y = ws.second[at.slot]
        if wp.static(lanes > 1):
            mix_simd(at, x, y, tables)
            return
        size = at.size
        mine = spread(size[1], at.thread)
        for k in range(mine[0], size[0] // 2 + 1, mine[1]):
            mirror_k = -k & (size[0] - 1)
            for c in range(mine[2], size[1], mine[3]):
                mirror_c = -c & (size[1] - 1)
                if k < mirror_k or c <= mirror_c:
                    entry = at.start + k * size[1] + c
                    xx = tables.xx[entry]
                    xy = tables.xy[entry]
                    yy = tables.yy[entry]
                    tx = x[k, c]
                    ty = y[k, c]
                    tx_mirror = x[mirror_k, mirror_c]
                    ty_mirror = y[mirror_k, mirror_c]
                    x[k, c] = xx * tx + xy * ty_mirror
                    y[k, c] = yy * ty + xy * tx_mirror
                    x[mirror_k, mirror_c] = xx * tx_mirror + xy * ty
                    y[mirror_k, mirror_c] = yy * ty_mirror + xy * tx
        block_sync()

    @wp.func
    def by_pressure(ws: workspace, at: Window, tables: tables_struct, axis: int):
        p = ws.spectrum[at.slot]
        u = ws.second[at.slot]
        size = at.size
        if wp.static(lanes > 1):
            if axis == 0:
                by_pressure_simd(p, u, tables.nx, axis, at.start, size[0], size[1])
            else:
                by_pressure_simd(p, u, tables.ny, axis, at.start, size[0], size[1])
            return
        mine = spread(size[1], at.thread)
        for k in range(mine[0], size[0], mine[1]):
            for c in range(mine[2], size[1], mine[3]):
                entry = at.start + k * size[1] + c
                if axis == 0:
                    u[k, c] = tables.nx[entry] * p[k, -c & (size[1] - 1)]
                else:
                    u[k, c] = tables.ny[entry] * p[-k & (size[0] - 1), c]
        block_sync()

    @wp.func
    def displace(ws: workspace, at: Window, tables: tables_struct, pulled: bool):
        p = ws.spectrum[at.slot]
        x = ws.second[at.slot]
        y = ws.third[at.slot]
        size = at.size
        mine = spread(size[1] // 2 + 1, at.thread)
        for k in range(mine[0], size[0] // 2 + 1, mine[1]):
            rows = wp.vec2i(k, -k & (size[0] - 1))
            for c in range(mine[2], size[1] // 2 + 1, mine[3]):
                columns = wp.vec2i(c, -c & (size[1] - 1))
                entry = at.start + k * size[1] + c
                # All four mirror images at once, since each is computed from the others.
                tx = quad(real(0.0))
                ty = quad(real(0.0))
                pressed = quad(real(0.0))
                for i in range(2):
                    for j in range(2):
                        pressed[2 * i + j] = p[rows[i], columns[j]]
                        if pulled:
                            tx[2 * i + j] = x[rows[i], columns[j]]
                            ty[2 * i + j] = y[rows[i], columns[j]]
                for i in range(2):
                    for j in range(2):
                        down = real(1 - 2 * i)
                        along = real(1 - 2 * j)
                        u = along * tables.nx[entry] * pressed[2 * i + 1 - j]
                        v = down * tables.ny[entry] * pressed[2 - 2 * i + j]
                        if pulled:
                            cross = down * along * tables.xy[entry]
                            u += tables.xx[entry] * tx[2 * i + j] + cross * ty[3 - 2 * i - j]
                            v += tables.yy[entry] * ty[2 * i + j] + cross * tx[3 - 2 * i - j]
                        x[rows[i], columns[j]] = u
                        y[rows[i], columns[j]] = v
                        p[rows[i], columns[j]] = tables.nn[entry] * pressed[2 * i + j]
        block_sync()

    @wp.func
    def by_traction(ws: workspace, at: Window, tables: tables_struct, x: grid, y: grid, out_x: grid, out_y: grid):
        forward(ws, at, x, ws.spectrum[at.slot])
        forward(ws, at, y, ws.second[at.slot])
        mix(ws, at, tables)
        inverse(ws, at, ws.spectrum[at.slot], out_x)
        inverse(ws, at, ws.second[at.slot], out_y)

    return TangentialFunctions(mix, by_pressure, displace, by_traction)
