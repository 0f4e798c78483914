"""The table of a scene's shapes on the device: one row per body, meshes and grids packed beside it."""

from dataclasses import dataclass, field

import numpy as np
import warp as wp

from tactemu.errors import SceneError
from tactemu.physics.shapes import distance as kind
from tactemu.physics.shapes.distance import ShapeFunctions, shape_functions, table_type
from tactemu.physics.shapes.mesh import load_mesh
from tactemu.physics.shapes.mesh_query import build_query
from tactemu.physics.shapes.voxel_grid import grid_bound, voxelise
from tactemu.plan.plan import Context
from tactemu.scene import bodies


@dataclass
class Row:
    """One shape as the kernels see it."""

    kind: int = -1
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bound: float = 0.0
    mesh: wp.Mesh | None = None
    mesh_unit: float = 1.0
    grid: bodies.VoxelGrid | None = None
    middle: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of the box around the shape, body frame [m]."""
    half: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Half its extents [m]."""


def _row(body: bodies.Body, device) -> Row:
    shape = body.shape
    match shape:
        case bodies.Sphere(radius=r):
            return Row(kind.SPHERE, (r, 0.0, 0.0), r, half=(r, r, r))
        case bodies.Box(size=size):
            half = (0.5 * float(size[0]), 0.5 * float(size[1]), 0.5 * float(size[2]))
            return Row(kind.BOX, half, float(np.linalg.norm(half)), half=half)
        case bodies.Capsule(radius=r, length=length):
            top = r + length / 2
            return Row(kind.CAPSULE, (r, length / 2, 0.0), top, half=(r, r, top))
        case bodies.Cylinder(radius=r, length=length):
            top = length / 2
            return Row(kind.CYLINDER, (r, top, 0.0), float(np.hypot(r, top)), half=(r, r, top))
        case bodies.Plane():
            return Row(kind.PLANE, bound=kind.FAR)
        case bodies.VoxelGrid():
            return Row(kind.VOXEL, bound=grid_bound(shape), grid=shape)
        case bodies.Mesh(source=source, scale=scale):
            triangles = load_mesh(source, scale, name=f"mesh of body {body.name!r}")
            query = build_query(triangles, device)
            grid = bodies.VoxelGrid(values=query.values, origin=tuple(map(float, query.origin)), cell=query.cell)
            which = kind.MESH if triangles.closed else kind.OPEN_MESH
            used = triangles.vertices[triangles.faces].reshape(-1, 3)
            middle, half = 0.5 * (used.min(0) + used.max(0)), 0.5 * np.ptp(used, axis=0)
            row = Row(which, bound=triangles.bound, mesh=query.mesh, mesh_unit=query.unit, grid=grid)
            row.middle, row.half = tuple(middle), tuple(half)
            return row
    raise SceneError(
        f"body {body.name!r}: not a shape: {shape!r}; there are Sphere, Box, Capsule, Cylinder, Plane, Mesh"
    )


@dataclass
class ShapeTable:
    """What a kernel needs to ask for distances: the struct to pass, and the functions built for its kinds."""

    struct: object
    """Pass it as the kernel's ``shapes`` argument; its type is ``table_type(real)``."""
    kinds: frozenset
    functions: ShapeFunctions
    rows: list[Row] = field(repr=False, default_factory=list)


class ShapeTables:
    """The tables of one scene: one per set of bodies and per kind of query, each shape prepared once.

    Raises:
        MeshError: a mesh cannot be used.
    """

    def __init__(self, scene_bodies: list[bodies.Body], context: Context):
        self._bodies, self._context = scene_bodies, context
        self._rows: dict[int, Row] = {}
        self._grids: dict[tuple[int, float | None], Row] = {}
        self._tables: dict = {}

    def table(self, used: tuple[bodies.Body, ...], query: str | None = None, cell: float | None = None) -> ShapeTable:
        """The table of the bodies ``used``; the others get an empty row and cost nothing."""
        chosen = frozenset(body.index for body in used)
        voxels = query == "voxel"
        key = (chosen, voxels, cell if voxels else None)
        if key not in self._tables:
            rows = [self._row(body, voxels, cell) if body.index in chosen else Row() for body in self._bodies]
            self._tables[key] = pack(rows, self._context)
        return self._tables[key]

    def _row(self, body: bodies.Body, voxels: bool, cell: float | None) -> Row:
        shape = id(body.shape)  # bodies may share one
        if shape not in self._rows:
            self._rows[shape] = _row(body, self._context.device)
        row = self._rows[shape]
        if not voxels or row.kind in (kind.SPHERE, kind.PLANE, kind.VOXEL):  # exact at no cost, or a grid already
            return row
        if (shape, cell) not in self._grids:
            grid = voxelise(pack([row], self._context), row.middle, row.half, cell, body.name, self._context)
            self._grids[shape, cell] = Row(kind.VOXEL, bound=row.bound, grid=grid)
        return self._grids[shape, cell]


def pack(rows: list[Row], context: Context) -> ShapeTable:
    """Upload rows as one table."""
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

    table = table_type(real)()
    table.kind = upload([row.kind for row in rows], wp.int32)
    table.size = upload([row.size for row in rows], vec3)
    table.bound = upload([row.bound for row in rows], real)
    table.mesh = upload([0 if row.mesh is None else row.mesh.id for row in rows], wp.uint64)
    table.mesh_unit = upload([row.mesh_unit for row in rows], real)
    table.grid_start = upload(starts, wp.int64)
    table.grid_nodes = upload([(0, 0, 0) if g is None else np.shape(g.values) for g in grids], wp.vec3i)
    table.grid_origin = upload([zero if g is None else np.asarray(g.origin, float) for g in grids], vec3)
    table.grid_cell = upload([one if g is None else np.broadcast_to(np.asarray(g.cell, float), 3) for g in grids], vec3)
    table.grid_values = upload(packed(lambda g: g.values, ()), real)
    table.grid_gradients = upload(packed(gradients_of, (3,)) if with_gradients else np.zeros((1, 3)), vec3)
    table.grid_has_gradients = upload([int(g is not None and g.gradients is not None) for g in grids], wp.int32)
    kinds = frozenset(row.kind for row in rows if row.kind >= 0)
    return ShapeTable(table, kinds, shape_functions(real, kinds), rows)
