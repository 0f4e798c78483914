"""Building of a narrow band of distances around a closed mesh: nodes, then cells, by all cores; kept for the next time.

The work grows with the nodes within the band and, slowly, with the faces of the mesh. The time of the whole is said
after the first slab of nodes, and :mod:`tactemu.base.long_work` shows the progress.
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
from tactemu.base.folders import cache_folder
from tactemu.base.long_work import long_work
from tactemu.geometry.shapes.band import BAND, Band, cell_kernel, node_kernel
from tactemu.geometry.shapes.band_files import keep_band, kept_band
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
COMPARISONS = 8
"""Time of comparing all cells, of that of the distances at the nodes; about, for the time that is announced."""
_ANNOUNCED_S = 10.0
"""Time of comparing from which on it is announced."""
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
    if band is None:
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
    nodes = wp.zeros(shape, dtype=wp.types.vector(4, real), device=device)
    smooth = wp.zeros(shape, dtype=wp.uint8, device=device)
    table = pack([row], context).struct
    first_node = wp.types.vector(3, real)(*map(float, band.origin))

    def fill(first: int, count: int) -> None:
        inputs = [table, first_node, band.cell, reach, first]
        wp.launch(node_kernel(real), dim=(count, *shape[1:]), inputs=inputs, outputs=[nodes], device=device)

    title = f"band of {name!r}"
    begin = time.perf_counter()
    for _ in long_work(_in_slabs(fill, shape[0], device), f"{title}: distances", _SLABS):
        pass
    _announce(name, len(row.mesh.indices) // 3, COMPARISONS * (time.perf_counter() - begin))
    with_nodes = replace(band, nodes=nodes.numpy())
    compared = pack([replace(row, band=with_nodes)], context).struct

    def compare(first: int, count: int) -> None:
        inputs = [compared, nodes, first]
        wp.launch(cell_kernel(real), dim=(count, *shape[1:]), inputs=inputs, outputs=[smooth], device=device)

    for _ in long_work(_in_slabs(compare, shape[0], device), f"{title}: comparing", _SLABS):
        pass
    return replace(with_nodes, smooth=smooth.numpy())


def _announce(name: str, faces: int, seconds: float) -> None:
    """Log how long the comparison will take, if it is long."""
    if seconds > _ANNOUNCED_S:
        log.warning(
            "body %r: comparing a band with its %s faces takes about %.0f s here, once: it is kept in %s for the next "
            "time. depth_query='voxel' is built in a tenth of that, and is less exact (docs/contact.md)",
            name, f"{faces:,}", seconds, cache_folder("bands"),
        )  # fmt: skip


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
