"""Building a skin from pieces: put a flat pad somewhere, join pads into one layout, fill a pad with n taxels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from firmware_protocols.device import Layout, Patch


def place(layout: Layout, origin: Sequence[float], *, x_axis=(1.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)) -> Layout:
    """``layout`` moved rigidly: its origin to ``origin`` [m], its x and z axes to ``x_axis`` and ``normal`` (unit)."""
    turn = np.stack([x_axis, np.cross(normal, x_axis), normal], axis=-1)
    return Layout(
        positions=layout.positions @ turn.T + np.asarray(origin, float),
        normals=layout.normals @ turn.T,
        x_axes=layout.x_axes @ turn.T,
        wire_order=layout.wire_order,
        patches=layout.patches,
        pitch=layout.pitch,
        area=layout.area,
    )


def stack(*layouts: Layout) -> Layout:
    """One layout of all the taxels, in this order on the skin and on the wire; pitch and area are the first one's."""
    starts = np.cumsum([0, *map(len, layouts)])
    patches = [
        Patch(name=patch.name, start=patch.start + int(start), rows=patch.rows, cols=patch.cols)
        for layout, start in zip(layouts, starts)
        for patch in layout.patches
    ]
    return Layout(
        positions=np.concatenate([layout.positions for layout in layouts]),
        normals=np.concatenate([layout.normals for layout in layouts]),
        x_axes=np.concatenate([layout.x_axes for layout in layouts]),
        wire_order=np.concatenate([layout.wire_order + start for layout, start in zip(layouts, starts)]),
        patches=tuple(patches),
        pitch=layouts[0].pitch,
        area=layouts[0].area,
    )


def filled(n_taxels: int, width: float, height: float, *, name: str) -> Layout:
    """``n_taxels`` spread evenly over a flat pad of ``width`` x ``height`` [m] (x, y), normal +z, in centred rows.

    For sensors whose taxel positions no source gives: the number of taxels is right, their places are an assumption.
    """
    rows = max(1, round(math.sqrt(n_taxels * height / width)))
    per_row = [n_taxels // rows + (row < n_taxels % rows) for row in range(rows)]
    step_x, step_y = width / max(per_row), height / rows
    positions = [
        ((col - (cols - 1) / 2) * step_x, ((rows - 1) / 2 - row) * step_y, 0.0)
        for row, cols in enumerate(per_row)
        for col in range(cols)
    ]
    return Layout(
        positions=np.array(positions),
        normals=np.array([0.0, 0.0, 1.0]),
        patches=(Patch(name=name, start=0, rows=0, cols=n_taxels),),
        pitch=min(step_x, step_y),
        area=step_x * step_y,
    )
