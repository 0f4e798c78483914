"""What is pressed into the skin, and what carries it: rigid shapes, each fixed in the frame of its body.

Lengths in metres. A shape's origin and axes are those of its body; a body's pose is that of this frame in the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tactemu.errors import SceneError
from tactemu.scene.motion import Motion, Pose


def _positive(kind: str, **lengths: float) -> None:
    for name, value in lengths.items():
        if not (np.isfinite(value) and value > 0):
            raise SceneError(f"{kind}: {name} must be a finite length > 0 m, got {value!r}")


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """A ball around the origin."""

    radius: float

    def __post_init__(self):
        _positive("Sphere", radius=self.radius)


@dataclass(frozen=True, kw_only=True)
class Box:
    """A cuboid around the origin, edges along the axes."""

    size: Sequence[float]
    """Full extents along x, y, z [m]."""

    def __post_init__(self):
        if len(self.size) != 3:
            raise SceneError(f"Box: size is the full extent along x, y, z; got {self.size!r}")
        _positive("Box", **{f"size[{i}]": value for i, value in enumerate(self.size)})


@dataclass(frozen=True, kw_only=True)
class Capsule:
    """A cylinder with round ends, along z around the origin."""

    radius: float
    length: float
    """Of the straight part [m]; the whole is ``length + 2 * radius`` long."""

    def __post_init__(self):
        _positive("Capsule", radius=self.radius, length=self.length)


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """A cylinder with flat ends, along z around the origin."""

    radius: float
    length: float

    def __post_init__(self):
        _positive("Cylinder", radius=self.radius, length=self.length)


@dataclass(frozen=True, kw_only=True)
class Plane:
    """The half-space z <= 0: solid below, free above."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """A triangle mesh: a file that trimesh reads, a ``trimesh.Trimesh``, or ``(vertices, faces)`` arrays.

    Raises:
        MeshError: when the scene is built; the message says what is wrong with which mesh.
    """

    source: str | Path | Any
    scale: float | Sequence[float] = 1.0
    """Factor from the file's unit to metres (0.001 for millimetres), one number or one per axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VoxelGrid:
    """A signed distance sampled on a regular grid, trilinear between its nodes."""

    values: np.ndarray
    """Signed distances [m], negative inside, shape ``(nx, ny, nz)``, at least 2 nodes per axis."""
    origin: Sequence[float]
    """Position of node (0, 0, 0) in the body's frame [m]."""
    cell: float | Sequence[float]
    """Distance of neighbouring nodes [m], one number or one per axis."""
    gradients: np.ndarray | None = field(default=None)
    """Gradients at the nodes, shape ``(nx, ny, nz, 3)``; ``None``: the gradient of the interpolated distance."""

    def __post_init__(self):
        shape = np.shape(self.values)
        if len(shape) != 3 or min(shape) < 2:
            raise SceneError(f"VoxelGrid: values must have shape (nx, ny, nz), each >= 2, got {shape}")
        if not np.isfinite(self.values).all():
            raise SceneError("VoxelGrid: values must be finite; replace unknown distances by a large number")
        if self.gradients is not None and np.shape(self.gradients) != (*shape, 3):
            raise SceneError(f"VoxelGrid: gradients must have shape {(*shape, 3)}, got {np.shape(self.gradients)}")
        cell = np.broadcast_to(np.asarray(self.cell, float), (3,))
        if not (np.isfinite(cell).all() and (cell > 0).all()):
            raise SceneError(f"VoxelGrid: cell must be > 0 m, got {self.cell!r}")


Shape = Sphere | Box | Capsule | Cylinder | Plane | Mesh | VoxelGrid


class Moved(Protocol):
    """A motion of the user's own: world poses over time, not displacements as those of :class:`Motion`."""

    def pose(self, t_s: float) -> Pose:
        """World pose and velocities at ``t_s`` [s]."""
        ...


@dataclass(frozen=True, eq=False)
class Body:
    """A body of a scene, as :meth:`tactemu.Scene.add_body` returns it. A 'link' of Genesis is a body here."""

    index: int
    """Its place in the scene: what ``track_link_idx`` and ``filter_link_idx`` name."""
    name: str
    shape: Shape | None
    """``None``: a frame without geometry, such as the link of a skin."""
    fixed: bool
    position: tuple[float, float, float]
    """Where it starts (and returns to at reset), world [m]."""
    quaternion: tuple[float, float, float, float]
    """Its orientation there, (w, x, y, z)."""
    motion: Motion | Moved | None = None
    """Moves it at every step; ``None``: it stays where it is put."""

    def pose(self, t_s: float) -> Pose:
        """Where its motion has it at ``t_s`` [s], and how fast, in the world; without one, at rest where it starts.

        Raises:
            SceneError: a motion of the user's own that gives no pose.
        """
        if self.motion is None:
            return self._start
        here = self.motion.pose(t_s)
        if not isinstance(here, Pose):
            raise SceneError(f"body {self.name!r}: its motion at {t_s:g} s: expected a tactemu.Pose, got {here!r}")
        return self._start.displaced(here) if isinstance(self.motion, Motion) else here

    @cached_property
    def _start(self) -> Pose:
        return Pose(np.array(self.position), np.array(self.quaternion))


def find(bodies: Sequence[Body], which: Body | str | int) -> Body:
    """Of these bodies the one that is meant by itself, its name or its index.

    Raises:
        SceneError: there is none; the message lists those there are.
    """
    for body in bodies:
        if which is body or (isinstance(which, str) and which == body.name):
            return body
    if isinstance(which, int | np.integer) and not isinstance(which, bool) and 0 <= which < len(bodies):
        return bodies[int(which)]
    wanted = which.name if isinstance(which, Body) else which
    known = ", ".join(f"{body.index}: {body.name}" for body in bodies) or "none"
    raise SceneError(f"no body {wanted!r} in this scene; bodies: {known}")
