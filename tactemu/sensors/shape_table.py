"""The table of a scene's shapes on the device: one row per body, meshes and grids packed beside it."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from tactemu.geometry.bodies import Body
from tactemu.geometry.shapes.band_building import band_row
from tactemu.geometry.shapes.distance import ShapeFunctions, shape_functions
from tactemu.geometry.shapes.face_tree import upload_trees
from tactemu.geometry.shapes.mesh import MESH
from tactemu.geometry.shapes.nearest_feature import upload_surfaces
from tactemu.geometry.shapes.shape import FAR, Row, ShapeKind, kind_codes, table_type, textures_type
from tactemu.geometry.shapes.textured import textured
from tactemu.geometry.shapes.voxel_grid import VOXELS
from tactemu.geometry.shapes.voxelise import voxelise
from tactemu.plan.plan import Context

log = logging.getLogger(__name__)

LARGE_BODY_M = 100.0
"""Reach of a body from which on a scene in float32 logs a warning [m]: the resolution there is 8 µm."""


@dataclass
class ShapeTable:
    """The table that a kernel needs for distances: the struct to pass, and the functions built for its kinds of
    shape."""

    struct: object
    """The kernel's ``shapes`` argument; its type is ``table_type(real)``."""
    kinds: frozenset[ShapeKind]
    functions: ShapeFunctions
    rows: list[Row] = field(repr=False, default_factory=list)


class ShapeTables:
    """The tables of one scene: one per set of bodies and per kind of query, each shape prepared once.

    Raises:
        MeshError: a mesh cannot be used.
    """

    def __init__(self, scene_bodies: Sequence[Body], context: Context):
        self._bodies, self._context = scene_bodies, context
        self._rows: dict[int, Row] = {}
        self._grids: dict[tuple[int, str, float | None], Row] = {}
        self._tables: dict = {}

    def table(self, used: tuple[Body, ...], query: str | None = None, cell: float | None = None) -> ShapeTable:
        """Return the table of the bodies ``used``; the others get an empty row and cost nothing."""
        chosen = frozenset(body.index for body in used)
        gridded = query if query in ("voxel", "band") else None
        key = (chosen, gridded, cell if gridded else None)
        if key not in self._tables:
            rows = [
                textured(self._row(body, gridded, cell), body.texture) if body.index in chosen else Row()
                for body in self._bodies
            ]
            self._tables[key] = pack(rows, self._context)
        return self._tables[key]

    def _row(self, body: Body, gridded: str | None, cell: float | None) -> Row:
        assert body.shape is not None  # sensed bodies have geometry
        shape = id(body.shape)  # bodies may share one
        if shape not in self._rows:
            self._rows[shape] = body.shape.row(body.name, self._context.device)
            _warn_if_large(body.name, self._rows[shape].bound, self._context)
        row = self._rows[shape]
        of_use = row.kind is MESH if gridded == "band" else row.kind is not None and row.kind.is_voxelised
        if gridded is None or not of_use:
            return row
        key = shape, gridded, cell
        if key not in self._grids:
            if gridded == "band":
                self._grids[key] = band_row(row, pack, cell, body.name, self._context)
            else:
                grid = voxelise(pack([row], self._context), row.middle, row.half, cell, body.name, self._context)
                self._grids[key] = Row(VOXELS, bound=row.bound, grid=grid)
        return self._grids[key]


def _warn_if_large(name: str, bound: float, context: Context) -> None:
    """Log a warning about the resolution of float32 if a body reaches beyond :data:`LARGE_BODY_M`."""
    if context.real is wp.float32 and LARGE_BODY_M <= bound < FAR:
        step = float(np.spacing(np.float32(bound)))
        log.warning(
            "body %r reaches %g m from its origin, where float32 resolves %.1g m: contacts smaller than that are lost; "
            'build the scene with dtype="float64"', name, bound, step,
        )  # fmt: skip


def pack(rows: list[Row], context: Context) -> ShapeTable:
    """Upload rows to the device as one table."""
    real, device = context.real, context.device
    vec3 = wp.types.vector(3, real)
    grids = [row.grid for row in rows]
    zero, one = np.zeros(3), np.ones(3)
    counts = [0 if grid is None else np.size(grid.values) for grid in grids]
    starts = np.cumsum([0, *counts])[:-1]
    with_gradients = any(grid is not None and grid.gradients is not None for grid in grids)

    def upload(values, dtype):
        return wp.array(np.asarray(values), dtype=dtype, device=device)

    def packed(field_of, width):
        parts = [np.asarray(field_of(grid), float).reshape(-1, *width) for grid in grids if grid is not None]
        return np.concatenate(parts) if parts else np.zeros((1, *width))

    def gradients_of(grid):
        return np.zeros((*np.shape(grid.values), 3)) if grid.gradients is None else grid.gradients

    kinds = frozenset(row.kind for row in rows if row.kind is not None)
    code = {None: -1} | {kind: number for number, kind in kind_codes(kinds)}
    table = table_type(real)()
    table.kind = upload([code[row.kind] for row in rows], wp.int32)
    table.turns = upload([int(row.kind is not None and row.kind.is_oriented) for row in rows], wp.int32)
    table.size = upload([row.size for row in rows], vec3)
    table.bound = upload([row.bound for row in rows], real)
    table.mesh = upload([0 if row.mesh is None else row.mesh.id for row in rows], wp.uint64)
    table.trees = upload_trees([row.tree for row in rows], device)
    table.mesh_unit = upload([row.mesh_unit for row in rows], real)
    table.mesh_middle = upload([row.middle for row in rows], vec3)
    parts = list({id(row.features): row.features for row in rows if row.features is not None}.values())
    points, faces = ([0, *np.cumsum([len(getattr(each, key)) for each in parts])] for key in ("points", "beside"))
    first = {id(each): (points[k], faces[k]) for k, each in enumerate(parts)}
    table.mesh_first = upload([first.get(id(row.features), (0, 0)) for row in rows], wp.vec2i)
    table.surfaces = upload_surfaces(parts, real, device)
    table.grid_start = upload(starts, wp.int64)
    table.grid_nodes = upload([(0, 0, 0) if g is None else np.shape(g.values) for g in grids], wp.vec3i)
    table.grid_origin = upload([zero if g is None else np.asarray(g.origin, float) for g in grids], vec3)
    table.grid_cell = upload([one if g is None else np.broadcast_to(np.asarray(g.cell, float), 3) for g in grids], vec3)
    table.grid_values = upload(packed(lambda g: g.values, ()), real)
    table.grid_gradients = upload(packed(gradients_of, (3,)) if with_gradients else np.zeros((1, 3)), vec3)
    table.grid_has_gradients = upload([int(g is not None and g.gradients is not None) for g in grids], wp.int32)
    bands = [row.band for row in rows]
    sizes = [0 if band is None else band.smooth.size for band in bands]
    nodes = [band.nodes.reshape(-1, 4) for band in bands if band is not None]
    smooth = [band.smooth.reshape(-1) for band in bands if band is not None]
    table.band_start = upload(np.cumsum([0, *sizes])[:-1], wp.int64)
    table.band_nodes = upload([(0, 0, 0) if band is None else band.smooth.shape for band in bands], wp.vec3i)
    table.band_origin = upload([zero if band is None else band.origin for band in bands], vec3)
    table.band_cell = upload([1.0 if band is None else band.cell for band in bands], real)
    table.band_tolerance = upload([0.0 if band is None else band.tolerance for band in bands], real)
    table.band_values = upload(np.concatenate(nodes) if nodes else np.zeros((1, 4)), wp.types.vector(4, real))
    table.band_smooth = upload(np.concatenate(smooth) if smooth else np.zeros(1, np.uint8), wp.uint8)
    table.textures = _upload_textures(rows, context)
    return ShapeTable(table, kinds, shape_functions(real, kinds), rows)


def _upload_textures(rows: Sequence[Row], context: Context):
    """Upload the rows' textures to the device."""
    real = context.real
    own = [row.texture for row in rows]
    parts = [np.ravel(each.values) for each in own if each is not None]
    starts = np.cumsum([0, *(0 if each is None else each.values.size for each in own)])[:-1]
    textures = textures_type(real)()
    for name, values, dtype in (
        ("start", starts, wp.int32),
        ("shape", [(0, 0) if each is None else each.values.shape for each in own], wp.vec2i),
        ("step", [1.0 if each is None else each.step for each in own], real),
        ("peak", [0.0 if each is None else each.peak for each in own], real),
        ("values", np.concatenate(parts) if parts else np.zeros(1), real),
    ):
        setattr(textures, name, wp.array(np.asarray(values), dtype=dtype, device=context.device))
    return textures
