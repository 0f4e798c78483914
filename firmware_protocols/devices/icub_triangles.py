"""Geometry of the iCub skin: the triangle of ten taxels and two thermal pads, surfaces tiled with it, a fingertip.

A triangle is a flexible board of 12 pads: ten taxels on a triangular lattice of pitch 6.533 mm (rows of 4, 3, 2, 1) and
two thermal pads, 6 and 10, in the gaps. Pads are numbered as they are sent; x, y in mm from the triangle's centroid:

                       9                        9   ( 0.000, 11.317)
                      10                       10   ( 0.000,  7.507)  thermal
                   8      11                    8   (-3.267,  5.658)     11 ( 3.267,  5.658)
               7       3       0                7   (-6.533,  0.000)      3 ( 0.000,  0.000)    0 ( 6.533,  0.000)
                6                               6   (-6.510, -3.750)  thermal
            5      4       2       1            5   (-9.800, -5.658)      4 (-3.267, -5.658)    2, 1 to +x

Triangles join side to side, every other one upside down, and bend with the surface that carries them. The twelve pads
of a fingertip all feel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from firmware_protocols import Layout, Patch

PADS = 12
THERMAL = (6, 10)
TAXELS = tuple(pad for pad in range(PADS) if pad not in THERMAL)
"""Pads that feel, in the order sent."""

PITCH = 6.533e-3
_ROW = PITCH * np.sqrt(3) / 2
_LATTICE = np.array([PITCH, _ROW])
PAD_PLACES = np.array([
    (1, 0), (1.5, -1), (0.5, -1), (0, 0), (-0.5, -1), (-1.5, -1), (0, 0), (-1, 0), (-0.5, 1), (0, 2), (0, 0), (0.5, 1),
]) * _LATTICE  # fmt: skip
PAD_PLACES[list(THERMAL)] = (-6.510e-3, -3.750e-3), (0.0, 7.507e-3)
"""Pads of one triangle [m], shape ``(12, 2)``, centroid at the origin, tip to +y."""

SIDE = 0.030
"""Edge of a triangle [m]."""
HEIGHT = SIDE * np.sqrt(3) / 2

FOREARM_RADIUS = 0.040
TIP_PITCH = 0.004
TIP_RADIUS = 0.007


class Sheet(NamedTuple):
    """Strips of triangles, around a cylinder or flat."""

    strips: int
    per_strip: int
    radius: float = 0.0
    """[m]; 0: flat."""


SHEETS = {"forearm": Sheet(3, 8, FOREARM_RADIUS), "upper_arm": Sheet(5, 7, 0.045), "torso": Sheet(4, 11)}
PALM = Sheet(1, 4)


class TrianglePlace(NamedTuple):
    """Where a triangle's centroid lies on the unrolled surface [m], and whether its tip points to -y."""

    u: float
    w: float
    upside_down: bool


def flat(places: list[TrianglePlace], names: list[str], link: str = "") -> Layout:
    """Triangles on the plane z = 0, normal +z; patches named ``names``."""
    uw = _unrolled(places)
    return Layout(
        positions=np.column_stack([uw, np.zeros(len(uw))]),
        normals=np.array([0.0, 0.0, 1.0]),
        patches=_patches(names, link),
    )


def wrapped(places: list[TrianglePlace], names: list[str], radius: float) -> Layout:
    """Triangles around a cylinder about the link's z axis, ``u`` = 0 at +x, ``w`` along z; normals point outwards."""
    u, w = _unrolled(places).T
    cos, sin, zero = np.cos(u / radius), np.sin(u / radius), np.zeros_like(u)
    return Layout(
        positions=np.column_stack([radius * cos, radius * sin, w]),
        normals=np.column_stack([cos, sin, zero]),
        x_axes=np.column_stack([-sin, cos, zero]),
        patches=_patches(names),
    )


def places_of(surface: Sheet) -> list[TrianglePlace]:
    """Strip by strip; of a forearm 24 triangles, 240 taxels over about 150 degrees and 78 mm."""
    places = []
    for strip in range(surface.strips):
        base = (strip - surface.strips / 2) * HEIGHT
        for k in range(surface.per_strip):
            upside_down = (k + strip) % 2 == 1
            u = (k - (surface.per_strip - 1) / 2) * SIDE / 2
            places.append(TrianglePlace(u, base + HEIGHT * (2 / 3 if upside_down else 1 / 3), upside_down))
    return places


def fingertip(name: str, link: str, x: float) -> Layout:
    """Twelve pads, 4 x 3 row by row, the tip to +y, bent across around the finger's axis; centred at ``x`` [m]."""
    rows, cols = 4, 3
    y, angle = np.meshgrid(
        ((rows - 1) / 2 - np.arange(rows)) * TIP_PITCH, (np.arange(cols) - 1) * TIP_PITCH / TIP_RADIUS, indexing="ij"
    )
    sin, cos, zero = np.sin(angle).ravel(), np.cos(angle).ravel(), np.zeros(rows * cols)
    return Layout(
        positions=np.column_stack([x + TIP_RADIUS * sin, y.ravel(), TIP_RADIUS * (cos - 1)]),
        normals=np.column_stack([sin, zero, cos]),
        x_axes=np.column_stack([cos, zero, -sin]),
        patches=(Patch(name=name, start=0, rows=rows, cols=cols, pitch=TIP_PITCH, link=link),),
    )


def _unrolled(places: list[TrianglePlace]) -> np.ndarray:
    """Return taxels of all triangles on the unrolled surface [m], shape ``(10 * n, 2)``, in wire order."""
    taxels = PAD_PLACES[list(TAXELS)]
    return np.concatenate([(-taxels if p.upside_down else taxels) + (p.u, p.w) for p in places])


def _patches(names: list[str], link: str = "") -> tuple[Patch, ...]:
    n = len(TAXELS)
    return tuple(
        Patch(name=name, start=k * n, rows=0, cols=n, pitch=PITCH, area=PITCH * _ROW, link=link)
        for k, name in enumerate(names)
    )
