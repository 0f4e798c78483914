"""Building of a narrow band of distances around a closed mesh: nodes, then cells, by all cores; kept for the next time.

The work grows with the nodes within the band and, slowly, with the faces of the mesh. Before it begins, its time is
estimated from some of the nodes; :mod:`tactemu.base.long_work` passes it on, and shows the progress.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.long_work import long_work, notice
from tactemu.geometry.shapes.band import BAND, Band, cell_kernel, node_kernel
from tactemu.geometry.shapes.band_files import keep_band, kept_band, kept_bands
from tactemu.geometry.shapes.shape import Row
from tactemu.geometry.shapes.voxel_grid import MAX_GRID_NODES
from tactemu.plan.plan import Context
from tactemu.plan.thread_pool import cores

log = logging.getLogger(__name__)

NODES_PER_LONGEST_SIDE = 96
"""Nodes along the longest side, if no cell size is given."""
HALF_WIDTH_SHARE = 1 / 8
"""Half the width of the band, as a share of the longest side."""
TOLERANCE_M = 2e-6
"""Largest error of a band of a body between :data:`SMALL_M` and :data:`LARGE_M`."""
SMALL_M, LARGE_M = 2e-3, 2.0
"""Longest sides below and above which the tolerance is a share of the body: 1e-3 and 1e-6 of its longest side."""
_SLABS = 64
"""Number of parts of the work, between which it can be interrupted and shows its progress."""
COMPARISONS = 5
"""Time of comparing all cells, of that of the distances at the nodes, for the time that is estimated.

It is 3 for a ball of 80,000 faces, of which many cells fail at once, and 6 for one of 1.3 million.
"""
_TRIED_EVERY = 16
"""The time is estimated from one of so many rows of nodes."""
_LONG_S = 10.0
"""Estimated time from which on it is logged and ``voxel`` is advised."""
_KEPT_AFTER_S = 1.0
"""Time of building from which on a band is kept for the next time."""


def band_row(row: Row, pack: Callable[..., Any], cell: float | None, name: str, context: Context) -> Row:
    """Return the row of a closed mesh with a band beside it.

    Args:
        row: the row of the mesh.
        pack: makes a table of rows (:func:`tactemu.sensors.shape_table.pack`).
        cell: distance of nodes [m]; ``None``: the longest side / 96.
        name: the body's name, for messages.
        context: the scene's context.

    Raises:
        SceneError: the cell size is not positive, or so small that the grid has too many nodes.
    """
    middle, half = np.asarray(row.middle), np.asarray(row.half)
    longest = 2.0 * float(half.max())
    cell = longest / NODES_PER_LONGEST_SIDE if cell is None else float(cell)
    if not (np.isfinite(cell) and cell > 0):
        raise SceneError(f"voxel_size must be > 0 m, got {cell!r}")
    reach = HALF_WIDTH_SHARE * longest
    shape = tuple(int(n) for n in np.ceil(2.0 * (half + reach) / cell).astype(np.int64) + 1)
    if np.prod(shape) > MAX_GRID_NODES // 4:
        raise SceneError(
            f"voxel_size {cell:g} m makes a band of {' x '.join(map(str, shape))} nodes for body {name!r}; "
            f"at most {MAX_GRID_NODES // 4} are allowed: take a larger cell, or depth_query='sdf'"
        )
    origin = middle - 0.5 * cell * (np.array(shape) - 1)
    empty = Band(np.zeros((0, 0, 0, 4)), np.zeros(shape, np.uint8), origin, cell, tolerance(longest))
    band = kept_band(row, empty, context.real)
    if band is not None:
        notice(f"body {name!r}: its band is kept in {kept_bands()}; nothing is built")
    else:
        begin = time.perf_counter()
        band = _built(row, pack, empty, reach, name, context)
        if time.perf_counter() - begin > _KEPT_AFTER_S:
            keep_band(row, band, context.real)
    return replace(row, kind=BAND, band=band)


def tolerance(longest: float) -> float:
    """Return the largest error [m] of the band of a body with this longest side [m]."""
    return TOLERANCE_M * min(longest / SMALL_M, 1.0) * max(longest / LARGE_M, 1.0)


def _built(row: Row, pack: Callable[..., Any], band: Band, reach: float, name: str, context: Context) -> Band:
    real, device, shape = context.real, context.device, band.smooth.shape
    number = np.float32 if real is wp.float32 else np.float64
    smooth = wp.zeros(shape, dtype=wp.uint8, device=device)
    table = pack([replace(row, band=replace(band, nodes=np.zeros((*shape, 4), number)))], context).struct
    nodes = table.band_values.reshape(shape)  # filled, then read by the comparison
    first_node = wp.types.vector(3, real)(*map(float, band.origin))

    def fill(first: int, count: int) -> None:
        inputs = [table, first_node, band.cell, reach, first]
        wp.launch(node_kernel(real), dim=(count, *shape[1:]), inputs=inputs, outputs=[nodes], device=device)

    _announce(name, row, _estimated_s(fill, shape[0], device))
    title = f"band of {name!r}"
    for _ in long_work(_in_slabs(fill, shape[0], device), f"{title}: distances", _SLABS):
        pass

    def compare(first: int, count: int) -> None:
        inputs = [table, nodes, first]
        wp.launch(cell_kernel(real), dim=(count, *shape[1:]), inputs=inputs, outputs=[smooth], device=device)

    for _ in long_work(_in_slabs(compare, shape[0], device), f"{title}: comparing", _SLABS):
        pass
    return replace(band, nodes=nodes.numpy(), smooth=smooth.numpy())


def _estimated_s(fill: Callable[[int, int], None], rows: int, device: wp.Device) -> float | None:
    """Return the time that building takes here [s], from the distances in some rows of nodes; None on a GPU."""
    if not device.is_cpu:
        return None
    fill(0, 1)  # loads the module
    tried = range(_TRIED_EVERY // 2, rows, _TRIED_EVERY)
    begin = time.thread_time()  # other processes do not count
    for row in tried:
        fill(row, 1)
    return (1 + COMPARISONS) * (time.thread_time() - begin) * rows / max(len(tried), 1) / cores()


def _announce(name: str, row: Row, seconds: float | None) -> None:
    """Say how long building will take; log it if nothing receives notices and it is long."""
    takes = "seconds" if seconds is None else f"about {max(1.0, seconds):.0f} s"
    text = (
        f"body {name!r}: comparing a band with its {len(row.mesh.indices) // 3:,} faces takes {takes} here, once: it "
        f"is kept in {kept_bands()} for the next time"
    )
    is_long = seconds is not None and seconds > _LONG_S
    if is_long:
        text += ". depth_query='voxel' is built in a tenth of that, and is less exact (docs/contact.md)"
    if not notice(text) and is_long:
        log.warning("%s", text)


def _in_slabs(work: Callable[[int, int], None], rows: int, device: wp.Device) -> Iterator[None]:
    """Do the work on rows of nodes, in :data:`_SLABS` parts by all cores; yield after each part."""
    edges = np.unique(np.linspace(0, rows, min(_SLABS, rows) + 1).astype(int))
    parts = [(int(a), int(b - a)) for a, b in pairwise(edges)]
    if not device.is_cpu:
        for part in parts:
            work(*part)
            yield
        return
    work(*parts[0])  # loads the module, which only one thread may do
    yield
    with ThreadPoolExecutor(cores()) as pool:
        try:
            for _ in pool.map(lambda part: work(*part), parts[1:]):
                yield
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
