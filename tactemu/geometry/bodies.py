"""The bodies of a scene, which carry shapes and skins.

Lengths in metres. A shape's origin and axes are those of its body; a body's pose is that of this frame in the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from tactemu.base.errors import SceneError, no_such
from tactemu.geometry.motion import Motion, Pose, Times
from tactemu.geometry.shapes.shape import Shape
from tactemu.geometry.shapes.texture import Texture


class WorldMotion(Protocol):
    """A motion that you write yourself: world poses over time, not displacements as those of :class:`Motion`."""

    def pose(self, t_s: Times) -> Pose:
        """Return the world pose and velocities at ``t_s`` [s] since the reset; in a batch ``t_s`` is an array of the
        environments' own times, ``(n_envs,)``, and the pose may have a row for each."""
        ...


@dataclass(frozen=True, eq=False)
class Body:
    """A body of a scene, as :meth:`tactemu.Scene.add_body` returns it. A 'link' of Genesis is a body here."""

    index: int
    """The index in the scene, as ``sense`` and ``ignore`` take it."""
    name: str
    shape: Shape | None
    """The geometry; ``None``: a frame without geometry, such as the link of a skin."""
    fixed: bool
    position: tuple[float, float, float]
    """The world position [m] at the start and after a reset."""
    quaternion: tuple[float, float, float, float]
    """The orientation there, (w, x, y, z)."""
    motion: Motion | WorldMotion | None = None
    """The motion, evaluated at every step from the reset of each environment on; ``None``: the body stays where it is
    put."""
    texture: Texture | None = None
    """The heights of its surface above the shape; ``None``: it is smooth."""
    skeleton: list[list[float]] | None = field(default=None, repr=False)
    """The lines between the joints of a link in its frame, (x, y, z, x, y, z) [m], for drawings; None: no link."""

    def pose(self, t_s: Times) -> Pose:
        """Return the world pose and velocities at ``t_s`` [s], or at an array of times, by the body's motion;
        without one, its start pose.

        Raises:
            SceneError: a motion that you wrote yourself returns no pose.
        """
        if self.motion is None:
            return self._start
        here = self.motion.pose(t_s)
        if not isinstance(here, Pose):
            when = f"{t_s:g}" if np.ndim(t_s) == 0 else "an array of times"
            raise SceneError(f"body {self.name!r}: its motion at {when} s: expected a tactemu.Pose, got {here!r}")
        return self._start.displaced(here) if isinstance(self.motion, Motion) else here

    @cached_property
    def _start(self) -> Pose:
        return Pose(np.array(self.position), np.array(self.quaternion))


def find_body(bodies: Sequence[Body], which: Body | str | int | np.integer) -> Body:
    """Return the body that ``which`` denotes: a body itself, a name or an index.

    Raises:
        SceneError: there is none; the message lists the bodies.
    """
    for body in bodies:
        if which is body or (isinstance(which, str) and which == body.name):
            return body
    if isinstance(which, int | np.integer) and not isinstance(which, bool) and 0 <= which < len(bodies):
        return bodies[int(which)]
    wanted = which.name if isinstance(which, Body) else which
    named = [body.name if isinstance(wanted, str) else f"{body.index}: {body.name}" for body in bodies]
    raise SceneError(f"this scene has {no_such('body', wanted, named, 'bodies')}")
