"""The table of a scene's shapes on the device: one row per body, meshes and grids packed beside it."""

from dataclasses import dataclass, field

import numpy as np
import warp as wp

from tactemu.physics import shapes as kind
from tactemu.physics.mesh import build_mesh, load_mesh
from tactemu.physics.plan import Context
from tactemu.physics.shapes import ShapeFunctions, shape_functions, table_type
from tactemu.scene import bodies


@dataclass
class Row:
    """One shape as the kernels see it."""

    kind: int = -1
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bound: float = 0.0
    mesh: wp.Mesh | None = None
    mesh_scale: float = 1.0
    grid: bodies.VoxelGrid | None = None


def _row(body: bodies.Body, device) -> Row:
    shape = body.shape
    match shape:
        case None:
            return Row()
        case bodies.Sphere(radius=r):
            return Row(kind.SPHERE, (r, 0.0, 0.0), r)
        case bodies.Box(size=size):
            half = tuple(0.5 * float(extent) for extent in size)
            return Row(kind.BOX, half, float(np.linalg.norm(half)))
        case bodies.Capsule(radius=r, length=length):
            return Row(kind.CAPSULE, (r, length / 2, 0.0), r + length / 2)
        case bodies.Cylinder(radius=r, length=length):
            return Row(kind.CYLINDER, (r, length / 2, 0.0), float(np.hypot(r, length / 2)))
        case bodies.Plane():
            return Row(kind.PLANE, bound=kind.FAR)
        case bodies.VoxelGrid():
            return Row(kind.VOXEL, bound=kind.FAR, grid=shape)
        case bodies.Mesh(source=source, scale=scale):
            triangles = load_mesh(source, scale, name=f"mesh of body {body.name!r}")
            mesh, unit = build_mesh(triangles, device)
            return Row(kind.MESH, bound=triangles.extent, mesh=mesh, mesh_scale=unit)
    raise TypeError(f"body {body.name!r}: not a shape: {shape!r}")


@dataclass
class ShapeTable:
    """What a kernel needs to ask for distances: the struct to pass, and the functions built for its kinds."""

    struct: object
    """Pass it as the kernel's ``shapes`` argument; its type is ``table_type(real)``."""
    kinds: frozenset
    functions: ShapeFunctions
    rows: list[Row] = field(repr=False, default_factory=list)


def build_table(scene_bodies: list[bodies.Body], used: frozenset[int], context: Context) -> ShapeTable:
    """The table of the bodies ``used`` (by index); the others get an empty row and cost nothing.

    Raises:
        MeshError: a mesh cannot be used.
    """
    rows = [_row(body, context.device) if body.index in used else Row() for body in scene_bodies]
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
    table.mesh_scale = upload([row.mesh_scale for row in rows], real)
    table.grid_start = upload(starts, wp.int64)
    table.grid_nodes = upload([(0, 0, 0) if g is None else np.shape(g.values) for g in grids], wp.vec3i)
    table.grid_origin = upload([zero if g is None else np.asarray(g.origin, float) for g in grids], vec3)
    table.grid_cell = upload([one if g is None else np.broadcast_to(np.asarray(g.cell, float), 3) for g in grids], vec3)
    table.grid_values = upload(packed(lambda g: g.values, ()), real)
    table.grid_gradients = upload(packed(gradients_of, (3,)) if with_gradients else np.zeros((1, 3)), vec3)
    table.grid_has_gradients = upload([int(g is not None and g.gradients is not None) for g in grids], wp.int32)
    kinds = frozenset(row.kind for row in rows if row.kind >= 0)
    return ShapeTable(table, kinds, shape_functions(real, kinds), rows)
