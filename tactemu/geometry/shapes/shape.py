"""The base class of all shapes. Each shape is one file that declares everything about it:

* its **options**, a dataclass: also the keys of a ``[[body]]`` table in a scene file,
* its :class:`Row` in the scene's table on the device, and the :class:`ShapeKind` of that row: the Warp functions that
  compute the distance to the shape and the part of a line that lies in it,
* its **reach** along a direction (for bodies steered by hand), and **points** spread over its surface.

:mod:`tactemu.geometry.shapes.registry` names the file in one line; ``docs/adding-a-shape.md`` adds one. Warp is
imported within the functions that build kernels, so that describing a scene does not load it.
"""

import dataclasses
import functools
import itertools
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from tactemu.base.errors import SceneError
from tactemu.base.option_groups import Options

FAR = 1.0e18
"""The distance that means 'no surface anywhere' [m]; its square still fits float32."""


@dataclass(frozen=True)
class ShapeKind:
    """The Warp functions and properties of one kind of shape. Builders take a float type: ``distance(wp.float32)``.

    ``shapes`` is the scene's table (:func:`table_type`), ``b`` a row of it, points are in the frame of the body.
    """

    name: str
    """Name of the kind; the kinds of a table are numbered in the order of their names."""
    distance: Callable[[Any], Any]
    """A builder of ``f(shapes, b, p) -> (signed distance, normal)``, negative inside. The normal is the gradient of the
    distance, a unit vector out of the shape, or zero where there is none."""
    ray: Callable[[Any], Any]
    """A builder of ``f(shapes, b, o, d, start, end) -> (first, last)``: the first and last ``s`` at which the line
    ``o + s d`` (``|d| = 1``) is in the solid, searched from ``-start`` to ``end``; without a hit +1e18 and -1e18."""
    lower_bound: Callable[[Any], Any] | None = None
    """A builder of ``f(shapes, b, p)``, a bound that is never above the distance and much cheaper."""
    is_oriented: bool = True
    """True if distances depend on the body's orientation."""
    is_searched: bool = False
    """True if the distance needs a search, so that the threads of a warp diverge."""
    without_search: Callable[[Any], Any] | None = None
    """A builder for searched kinds: the distance where it is known without a search, and -1e18 where it is not."""
    is_voxelised: bool = True
    """True if the voxel query replaces it by a grid of distances."""
    max_slope: float = 1.0
    """Largest change of the distance per metre; that of interpolated distances can exceed 1."""


@dataclass
class Row:
    """One body's shape in the form that kernels read."""

    kind: ShapeKind | None = None
    """The kind of shape; ``None``: a body without geometry."""
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Three numbers for the kind's functions."""
    bound: float = 0.0
    """Radius of a ball around the origin that contains the shape [m]."""
    middle: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of the box around the shape, body frame [m]."""
    half: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Half the extents of that box [m]."""
    mesh: Any = None
    """A ``wp.Mesh`` on the device, about its middle and scaled to unit size."""
    tree: Any = None
    """The tree of the mesh's faces (:class:`~tactemu.geometry.shapes.face_tree.FaceTree`)."""
    mesh_unit: float = 1.0
    """Metres that one stored unit of the mesh stands for."""
    features: Any = None
    """Vertices and normals of the mesh (:class:`~tactemu.geometry.shapes.mesh_features.Features`)."""
    grid: Any = None
    """Distances on a grid (:class:`~tactemu.geometry.shapes.voxel_grid.VoxelGrid`)."""
    band: Any = None
    """Distances near the surface (:class:`~tactemu.geometry.shapes.band.Band`)."""
    texture: Any = None
    """Heights above the surface (:class:`~tactemu.geometry.shapes.texture.TextureRow`)."""


@dataclass(frozen=True, kw_only=True)
class Shape(Options):
    """A rigid solid in the frame of its body."""

    mujoco_geom: ClassVar[str | None] = None
    """MuJoCo's name for the shape, if it has one."""

    @abstractmethod
    def row(self, name: str, device: Any) -> Row:
        """Return the shape's row in the table on a Warp ``device``; messages name the body ``name``.

        Raises:
            MeshError: a mesh cannot be used.
        """

    @abstractmethod
    def reach(self, name: str, direction: np.ndarray) -> float:
        """Return the extent from the origin along a unit vector of the body's frame [m] (the support function)."""

    def sample(self, name: str, count: int, rng: "np.random.Generator") -> tuple[np.ndarray, float]:
        """Return ``count`` random points on the surface, uniform by area, ``(count, 3)`` [m], and the area [m^2].

        Raises:
            SceneError: the shape has no surface, or none that can be sampled.
        """
        kind = type(self).__name__
        raise SceneError(f"body {name!r}: a {kind} has no surface to sample points on; give them (points=...)")

    def outline(self, name: str) -> dict[str, Any]:
        """Return plain data by which a viewer draws the shape: its options, or ``vertices`` and ``faces``."""
        return {key: np.asarray(value).tolist() for key, value in dataclasses.asdict(self).items()}

    @classmethod
    def from_file(cls, folder: Path, **keys) -> Self:
        """Make the shape from the keys of a ``[[body]]`` table. The keyword arguments of an override are the keys.

        Args:
            folder: the folder that paths are relative to.
            keys: the values of the keys.

        Raises:
            SceneError: a value is wrong, or a file cannot be read.
        """
        return cls(**keys)

    @classmethod
    def from_mujoco(cls, size: list[float]) -> Self:
        """Make the shape from the three sizes of a MuJoCo geom (half extents or radii) [m]."""
        raise NotImplementedError


def box_outline(low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    """Return the vertices and faces of a box along the axes, for :meth:`Shape.outline`; corners ``(3,)`` [m]."""
    corners = list(itertools.product(*zip(low.tolist(), high.tolist())))  # the bits of k choose low or high in x, y, z
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [[(a, b, c), (a, c, d)] for a, b, c, d in sides]
    return {"vertices": [list(each) for each in corners], "faces": [list(each) for pair in faces for each in pair]}


@functools.cache
def textures_type(real: Any) -> Any:
    """Return the Warp struct of the bodies' textures (:mod:`tactemu.geometry.shapes.texture`)."""
    import warp as wp

    @wp.struct
    class Textures:
        start: wp.array(dtype=wp.int32)  # first number of a body's texture in the values
        shape: wp.array(dtype=wp.vec2i)  # rows and columns of the values: heights of a map, or four of each wave
        step: wp.array(dtype=real)  # distance of the heights of a map
        peak: wp.array(dtype=real)  # largest absolute height
        values: wp.array(dtype=real)

    return Textures


@functools.cache
def table_type(real: Any) -> Any:
    """Return the Warp struct that holds all shapes of a scene, one row per body."""
    import warp as wp

    from tactemu.geometry.shapes.face_tree import trees_type
    from tactemu.geometry.shapes.nearest_feature import surfaces_type

    vec3, vec4 = wp.types.vector(3, real), wp.types.vector(4, real)

    @wp.struct
    class Shapes:
        kind: wp.array(dtype=wp.int32)  # which of the table's kinds; -1: a body without geometry
        turns: wp.array(dtype=wp.int32)  # 0: distances do not depend on the orientation
        size: wp.array(dtype=vec3)  # box: half extents; others: radius, half length
        bound: wp.array(dtype=real)  # radius of a ball around the origin that contains the shape
        mesh: wp.array(dtype=wp.uint64)
        trees: trees_type()  # of closed meshes
        mesh_unit: wp.array(dtype=real)  # meshes are stored with unit size: metres per stored unit
        mesh_middle: wp.array(
            dtype=vec3
        )  # the point of the body's frame that a mesh and its coarse grid are relative to
        mesh_first: wp.array(dtype=wp.vec2i)  # index of its first vertex and its first face in the surfaces
        surfaces: surfaces_type(real)  # of the meshes
        grid_start: wp.array(dtype=wp.int64)  # first node in grid_values; a mesh has a coarse grid
        grid_nodes: wp.array(dtype=wp.vec3i)
        grid_origin: wp.array(dtype=vec3)
        grid_cell: wp.array(dtype=vec3)
        grid_values: wp.array(dtype=real)
        grid_gradients: wp.array(dtype=vec3)
        grid_has_gradients: wp.array(dtype=wp.int32)
        band_start: wp.array(dtype=wp.int64)  # first node in band_values
        band_nodes: wp.array(dtype=wp.vec3i)
        band_origin: wp.array(dtype=vec3)
        band_cell: wp.array(dtype=real)
        band_tolerance: wp.array(dtype=real)  # largest error; nearer to the surface the exact distance is computed
        band_values: wp.array(dtype=vec4)  # distance, gradient
        band_smooth: wp.array(dtype=wp.uint8)  # 1: the cell that begins at the node is interpolated
        textures: textures_type(real)

    return Shapes


@functools.cache
def without_search(kinds: frozenset[ShapeKind]) -> frozenset[ShapeKind]:
    """Return the kinds with distance functions that never search: distances that need a search are -1e18."""

    def without(kind: ShapeKind) -> ShapeKind:
        return dataclasses.replace(kind, distance=kind.without_search or unknown_function) if kind.is_searched else kind

    return frozenset(map(without, kinds))


@functools.cache
def unknown_function(real):
    """Return a distance function for kinds whose distance is never known without a search: always -1e18."""
    import warp as wp

    vec3, shapes_type = wp.types.vector(3, real), table_type(real)

    @wp.func
    def unknown(shapes: shapes_type, b: int, p: vec3):
        return real(-FAR), vec3(real(0.0))

    return unknown


def kind_codes(kinds: frozenset[ShapeKind]) -> list[tuple[int, ShapeKind]]:
    """Return the kinds with their numbers in the column ``kind`` of a table of these kinds."""
    return list(enumerate(sorted(kinds, key=lambda kind: kind.name)))
