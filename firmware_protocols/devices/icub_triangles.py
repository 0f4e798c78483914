"""Geometry of the iCub skin: the triangle of ten taxels and two thermal pads, surfaces tiled with it, a fingertip.

A triangle is a flexible board of 12 pads: ten taxels on a triangular lattice of pitch 6.533 mm (rows of 4, 3, 2, 1) and
two thermal pads, 6 and 10, in the gaps. Pads are numbered as they are sent; x, y in mm from the triangle's centroid:

                       9                        9   ( 0.000, 11.317)
                      10                       10   ( 0.000,  7.507)  thermal
                   8      11                    8   (-3.267,  5.658)     11 ( 3.267,  5.658)
               7       3       0                7   (-6.533,  0.000)      3 ( 0.000,  0.000)    0 ( 6.533,  0.000)
                6                               6   (-6.510, -3.750)  thermal
            5      4       2       1            5   (-9.800, -5.658)      4 (-3.267, -5.658)    2, 1 to +x

Triangles join side to side, every other one upside down, and bend with the surface that carries them. All twelve pads
of a fingertip are taxels.
"""

from typing import NamedTuple

import numpy as np

from firmware_protocols import Layout, Patch

PADS_PER_TRIANGLE = 12
THERMAL_PADS = (6, 10)
TAXEL_PADS = tuple(pad for pad in range(PADS_PER_TRIANGLE) if pad not in THERMAL_PADS)
"""The pads that are taxels, in the order on the wire."""

PITCH_M = 6.533e-3
_ROW_PITCH_M = PITCH_M * np.sqrt(3) / 2
_LATTICE_M = np.array([PITCH_M, _ROW_PITCH_M])
PAD_PLACES_M = np.array([
    (1, 0), (1.5, -1), (0.5, -1), (0, 0), (-0.5, -1), (-1.5, -1), (0, 0), (-1, 0), (-0.5, 1), (0, 2), (0, 0), (0.5, 1),
]) * _LATTICE_M  # fmt: skip
PAD_PLACES_M[list(THERMAL_PADS)] = (-6.510e-3, -3.750e-3), (0.0, 7.507e-3)
"""The pads of one triangle, shape ``(12, 2)``, centroid at the origin, tip to +y."""

SIDE_M = 0.030
"""The edge of a triangle."""
HEIGHT_M = SIDE_M * np.sqrt(3) / 2

FOREARM_RADIUS_M = 0.040
TIP_PITCH_M = 0.004
TIP_RADIUS_M = 0.007


class Sheet(NamedTuple):
    """Strips of triangles, around a cylinder or flat."""

    strips: int
    per_strip: int
    radius: float = 0.0
    """The radius of the cylinder [m]; 0 if flat."""


SHEETS = {"forearm": Sheet(3, 8, FOREARM_RADIUS_M), "upper_arm": Sheet(5, 7, 0.045), "torso": Sheet(4, 11)}
PALM = Sheet(1, 4)


class TrianglePlace(NamedTuple):
    """The place of a triangle's centroid on the unrolled surface [m], and whether its tip points to -y."""

    u: float
    w: float
    upside_down: bool


def flat(places: list[TrianglePlace], names: list[str], link: str = "") -> Layout:
    """Return triangles on the plane z = 0, normal +z; patches named ``names``."""
    uw = _unrolled(places)
    return Layout(
        positions=np.column_stack([uw, np.zeros(len(uw))]),
        normals=np.array([0.0, 0.0, 1.0]),
        patches=_patches(names, link),
    )


def wrapped(places: list[TrianglePlace], names: list[str], radius: float) -> Layout:
    """Return triangles around the link's z axis, ``u`` = 0 at +x, ``w`` along z; normals point outwards."""
    u, w = _unrolled(places).T
    cos, sin, zero = np.cos(u / radius), np.sin(u / radius), np.zeros_like(u)
    return Layout(
        positions=np.column_stack([radius * cos, radius * sin, w]),
        normals=np.column_stack([cos, sin, zero]),
        x_axes=np.column_stack([-sin, cos, zero]),
        patches=_patches(names),
    )


def places_of(surface: Sheet) -> list[TrianglePlace]:
    """Return triangles strip by strip; of a forearm 24, with 240 taxels over about 150 degrees and 78 mm."""
    places = []
    for strip in range(surface.strips):
        base = (strip - surface.strips / 2) * HEIGHT_M
        for k in range(surface.per_strip):
            upside_down = (k + strip) % 2 == 1
            u = (k - (surface.per_strip - 1) / 2) * SIDE_M / 2
            places.append(TrianglePlace(u, base + HEIGHT_M * (2 / 3 if upside_down else 1 / 3), upside_down))
    return places


def fingertip(name: str, link: str, x: float) -> Layout:
    """Return 4 x 3 pads row by row, tip to +y, bent around the finger's axis; centred at ``x`` [m]."""
    rows, cols = 4, 3
    y, angle = np.meshgrid(
        ((rows - 1) / 2 - np.arange(rows)) * TIP_PITCH_M,
        (np.arange(cols) - 1) * TIP_PITCH_M / TIP_RADIUS_M,
        indexing="ij",
    )
    sin, cos, zero = np.sin(angle).ravel(), np.cos(angle).ravel(), np.zeros(rows * cols)
    return Layout(
        positions=np.column_stack([x + TIP_RADIUS_M * sin, y.ravel(), TIP_RADIUS_M * (cos - 1)]),
        normals=np.column_stack([sin, zero, cos]),
        x_axes=np.column_stack([cos, zero, -sin]),
        patches=(Patch(name=name, start=0, rows=rows, cols=cols, pitch=TIP_PITCH_M, link=link),),
    )


def _unrolled(places: list[TrianglePlace]) -> np.ndarray:
    """Return the taxels of all triangles on the unrolled surface [m], shape ``(10 * n, 2)``, in wire order."""
    taxels = PAD_PLACES_M[list(TAXEL_PADS)]
    return np.concatenate([(-taxels if p.upside_down else taxels) + (p.u, p.w) for p in places])


def _patches(names: list[str], link: str = "") -> tuple[Patch, ...]:
    n = len(TAXEL_PADS)
    return tuple(
        Patch(name=name, start=k * n, rows=0, cols=n, pitch=PITCH_M, area=PITCH_M * _ROW_PITCH_M, link=link)
        for k, name in enumerate(names)
    )
