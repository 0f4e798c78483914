"""A triangle mesh: :mod:`triangles` reads and checks it, :mod:`mesh_query` finds distances to it."""

# pyright: reportArgumentType=false, reportOperatorIssue=false, reportAttributeAccessIssue=false

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tactemu.base.errors import MeshError, SceneError
from tactemu.base.units import MAX_SIZE_M, Length
from tactemu.geometry.shapes.rays import bound_function
from tactemu.geometry.shapes.shape import FAR, Row, Shape, ShapeKind, box_outline, table_type
from tactemu.geometry.shapes.surface import sample_triangles
from tactemu.geometry.shapes.triangles import Triangles, extent_of_file, load_mesh
from tactemu.geometry.shapes.voxel_grid import VoxelGrid

MAX_CROSSINGS = 16
"""Most surfaces behind the skin that a line is followed through."""
MAX_DRAWN_TRIANGLES = 20_000
"""Most triangles of a mesh that viewers receive; of a larger mesh they receive the box around it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh(Shape):
    """A triangle mesh: a file that trimesh reads, a ``trimesh.Trimesh``, or ``(vertices, faces)`` arrays.

    Raises:
        MeshError: when the scene is built; the message names the mesh and its defect.
    """

    source: str | Path | Any
    """The file, the ``trimesh.Trimesh`` or the pair of arrays."""
    scale: float | Sequence[float] = 1.0
    """Factor from the file's unit to metres (0.001 for millimetres), one number or one per axis."""

    other_words = {
        **dict.fromkeys(("vertices", "points", "faces", "indices", "triangles"), "source=(vertices, faces)"),
        **dict.fromkeys(("file", "filename", "path"), "source=, the file"),
    }

    def row(self, name: str, device) -> Row:
        from tactemu.geometry.shapes.mesh_query import build_query

        triangles = self._triangles(name)
        query = build_query(triangles, device)
        return Row(
            OPEN_MESH if query.tree is None else MESH,
            bound=triangles.bound,
            middle=tuple(query.middle),
            half=tuple(query.half),
            mesh=query.mesh,
            tree=query.tree,
            mesh_unit=query.unit,
            features=query.features,
            grid=VoxelGrid(values=query.values, origin=query.origin, cell=query.cell),
        )

    def reach(self, name: str, direction: np.ndarray) -> float:
        return float((self._triangles(name).vertices @ direction).max())

    def sample(self, name: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        triangles = self._triangles(name)
        return sample_triangles(triangles.vertices, triangles.faces, count, rng)

    def outline(self, name: str) -> dict[str, Any]:
        triangles = self._triangles(name)
        vertices, faces = triangles.vertices, triangles.faces
        if len(faces) > MAX_DRAWN_TRIANGLES:
            return box_outline(vertices.min(0), vertices.max(0))
        return {"vertices": np.round(vertices, 7).tolist(), "faces": faces.tolist()}

    @classmethod
    def from_file(  # pyright: ignore[reportIncompatibleMethodOverride]
        cls,
        folder: Path,
        *,
        path: Annotated[str, "of a file that trimesh reads (STL, OBJ, PLY, GLB ...); relative to the scene file"],
        scale: Annotated[Length, "metres per unit of the file"] = 1.0,
    ) -> "Mesh":
        if not (folder / path).is_file():
            raise SceneError(f"path: no such mesh file: {str(folder / path)!r}")
        try:
            extent = extent_of_file(folder / path, scale, "path")
        except MeshError as error:
            raise SceneError(str(error)) from None
        if not extent <= MAX_SIZE_M:
            raise SceneError(
                f"path: {path} is {extent:g} m long; a body may be at most {MAX_SIZE_M:g} m long. "
                "If the file is in millimetres, give scale = 0.001"
            )
        return cls(source=folder / path, scale=scale)

    def _triangles(self, name: str) -> Triangles:
        return load_mesh(self.source, self.scale, name=f"mesh of body {name!r}")


def _distance(closed: bool, real):
    from tactemu.geometry.shapes.mesh_query import mesh_functions

    return mesh_functions(real, closed).distance


def _lower_bound(real):
    from tactemu.geometry.shapes.mesh_query import mesh_functions

    return mesh_functions(real, True).lower_bound


@functools.cache
def _ray(real):
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)
    begin = bound_function(real)

    @wp.func
    def through_mesh(shapes: shapes_type, b: int, o: vec3, d: vec3, start: real, end: real):
        back = begin(shapes, b, o, d, start)
        if back == real(FAR):
            return real(FAR), real(-FAR)
        unit = shapes.mesh_unit[b]
        middle = shapes.mesh_middle[b]
        way = wp.vec3(wp.float32(d[0]), wp.float32(d[1]), wp.float32(d[2]))
        s = -back
        for _ in range(wp.static(MAX_CROSSINGS)):
            q = (o - middle + s * d) / unit
            origin = wp.vec3(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]))
            hit = wp.mesh_query_ray(shapes.mesh[b], origin, way, wp.float32(1.0e6))
            if not hit.result:
                break
            at = s + real(hit.t) * unit
            if hit.sign > 0.0:  # from outside
                return at, real(FAR)
            if at >= real(0.0):  # from inside, and solid up to the skin
                return -back, real(FAR)
            s = at + real(1.0e-5) * unit
        return real(FAR), real(-FAR)

    return through_mesh


MESH = ShapeKind("mesh", functools.partial(_distance, True), _ray, _lower_bound, is_searched=True)
OPEN_MESH = ShapeKind("open mesh", functools.partial(_distance, False), _ray, is_searched=True)
"""The kind of a mesh with holes, or with faces within its solid."""
