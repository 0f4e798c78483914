"""The input of poses: from Python, through an array on the device, or from arrays of another simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactemu.base.errors import SceneError
from tactemu.base.keywords import takes_words
from tactemu.base.words import Names
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body, find_body
from tactemu.geometry.motion import Pose
from tactemu.plan.array_types import DeviceNumbers, Numbers, WarpArray
from tactemu.plan.plan import Context, Plan, Stage
from tactemu.sensors.bound_poses import BoundPoses, VelocityPoints, make_bound_poses
from tactemu.sensors.motions import Motions
from tactemu.sensors.world import World, on_host


class PoseInput:
    """The methods of a :class:`~tactemu.sensors.simulation.Simulation` that pose its bodies."""

    bodies: tuple[Body, ...]
    context: Context
    plan: Plan
    _world: World
    names: Names = "tactemu"
    """The words that its methods take."""
    _motions: Motions
    _bound: tuple[BoundPoses, Stage] | None = None

    @takes_words
    def set_pose(
        self,
        body: Body | str | int,
        *,
        position: Numbers | None = None,
        quaternion: Numbers | None = None,
        linear_velocity: Numbers | None = None,
        angular_velocity: Numbers | None = None,
        order: rotation.Order = "wxyz",
        envs: Sequence[int] | NDArray[Any] | None = None,
    ) -> None:
        """Set a body's pose and velocities from the next step on. Parts that you do not give stay unchanged.

        A body that has a motion is taken from it, and its velocities are 0 unless you give them, until you
        :meth:`release` the body or reset the environment.

        Args:
            body: the body, its name or its index.
            position: position of its origin, world [m]; ``(3,)`` for all environments or ``(n_envs, 3)``. NumPy, lists,
                Warp arrays or anything with ``__dlpack__``; arrays on the simulation's device are not copied through
                the host.
            quaternion: its orientation, (w, x, y, z), any length; ``(4,)`` or ``(n_envs, 4)``.
            linear_velocity: velocity of its origin, world [m/s].
            angular_velocity: its angular velocity, world [rad/s].
            order: order of the quaternion's numbers, ``wxyz`` or ``xyzw``.
            envs: the environments to set; arrays then have ``len(envs)`` rows.

        Raises:
            SceneError: the body is fixed or unknown, or a shape is wrong.
        """
        body = self._body("set_pose", body)
        if body.fixed:
            raise SceneError(f"set_pose: body {body.name!r} is fixed; add it with fixed=False to move it")
        is_driven = self._motions.drives(body, envs)
        if is_driven:
            linear_velocity = (0.0, 0.0, 0.0) if linear_velocity is None else linear_velocity
            angular_velocity = (0.0, 0.0, 0.0) if angular_velocity is None else angular_velocity
        if on_host(quaternion):
            quaternion, order = rotation.wxyz(quaternion, order, "set_pose"), "wxyz"
        self._world.set(body, (position, quaternion, linear_velocity, angular_velocity), envs, order)
        if is_driven:
            self._motions.take(body, envs)

    @takes_words
    def release(self, body: Body | str | int, *, envs: Sequence[int] | NDArray[Any] | None = None) -> None:
        """Give a body back from :meth:`set_pose` or :meth:`bind_poses` to its motion, from the next step on: where the
        motion would have it at its environment's own time if you had never posed it.

        Args:
            body: the body, its name or its index. One without a motion stays where it is.
            envs: the environments in which to give it back; of a body with bound poses, all.

        Raises:
            SceneError: the body is unknown, or ``envs`` are some of those in which its poses are bound.
        """
        body = self._body("release", body)
        if body.index in self._world.bound:
            if envs is not None:
                raise SceneError(f"release({body.name!r}): its poses are bound in all environments; leave envs out")
            assert self._bound is not None
            self._bind(self._bound[0].without(body))
        elif body.motion is not None:
            self._motions.give_back(body, envs)

    def _body(self, verb: str, which: Body | str | int) -> Body:
        if isinstance(which, Body) and which not in self.bodies:
            raise SceneError(
                f"{verb}: body {which.name!r} was added after the scene was built, or belongs to another scene; "
                "build the scene again"
            )
        return find_body(self.bodies, which)

    @property
    def pose_array(self) -> WarpArray:
        """Poses of all bodies, float64, shape ``(n_envs, n_bodies, 13)``: position [m], quaternion (w, x, y, z),
        velocity of the body's origin [m/s], angular velocity [rad/s], in the world.

        A step reads this memory: a pose written there on the device holds from the next step on, unless a motion moves
        the body; :meth:`set_pose` takes it from its motion.
        ``torch.from_dlpack(sim.pose_array)`` copies nothing.
        """
        return self._world.exposed()

    @takes_words
    def bind_poses(
        self,
        poses: DeviceNumbers | None = None,
        *,
        position: DeviceNumbers | tuple[DeviceNumbers, int] | None = None,
        quaternion: DeviceNumbers | tuple[DeviceNumbers, int] | None = None,
        linear_velocity: DeviceNumbers | tuple[DeviceNumbers, int] | None = None,
        angular_velocity: DeviceNumbers | tuple[DeviceNumbers, int] | None = None,
        order: rotation.Order = "wxyz",
        velocity_at: Any = "origin",
        velocity_at_index: Sequence[int] | NDArray[Any] | None = None,
        com: DeviceNumbers | tuple[DeviceNumbers, int] | None = None,
        index: Mapping[Any, int] | None = None,
        offsets: Mapping[Any, tuple[Any, Any]] | None = None,
    ) -> None:
        """Take poses from arrays of another simulator, now and at each step. Bodies that have a motion are taken from
        it until you :meth:`release` them, also over a reset.

        The arrays stay on the simulation's device: Warp or NumPy arrays, or anything with ``__dlpack__``, float32 or
        float64, with any strides. One launch converts them within the step. A second call replaces the first.

        Args:
            poses: all in one array ``(n_envs, n, 13)``, as :attr:`pose_array`.
            position: positions of the bodies' origins, world [m]: ``(n_envs, n, 3)``, or ``(n_envs * n, 3)`` with the
                bodies of one environment after those of another. A pair ``(array, k)`` stands for its numbers from
                ``k`` on.
            quaternion: their orientations, any length; as wide as 4.
            linear_velocity: their velocities [m/s], world.
            angular_velocity: their angular velocities [rad/s], world. Parts that you do not give stay unchanged.
            order: order of a quaternion's numbers, ``wxyz`` or ``xyzw``.
            velocity_at: the point that moves with the velocity: the ``origin``, the centre of mass (``com``), or the
                body's material at points in the world, an array ``(n_envs, n, 3)``.
            velocity_at_index: index of each body's point, ``(n,)``; default: point k belongs to place k.
            com: centres of mass in the given frames [m], ``(n, 3)`` or as ``position``.
            index: place of each body among the n, ``{body: place}``; default: place k is body k, fixed bodies are left
                out.
            offsets: poses of bodies in the given frames, ``{body: (position, quaternion)}``; default: at their origins.

        Raises:
            SceneError: an array has the wrong shape, type or device, or no memory; or a body is fixed.
        """
        parts = {
            "position": position,
            "quaternion": quaternion,
            "linear_velocity": linear_velocity,
            "angular_velocity": angular_velocity,
        }
        points = VelocityPoints(velocity_at, velocity_at_index, com)
        bound = make_bound_poses(
            self.bodies, self.context, poses=poses, parts=parts, order=order, points=points, index=index,
            offsets=offsets,
        )  # fmt: skip
        self._bind(bound)

    def _bind(self, bound: BoundPoses | None) -> None:
        """Take poses from these arrays from now on, and give other bodies back to their motions."""
        bodies = bound.bodies if bound is not None else ()
        for body in bodies:
            if self._motions.drives(body, None):
                self._world.set(body, (None, None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        self._motions.bind(bodies)
        self._world.bind(frozenset(body.index for body in bodies))
        self._bound = None
        if bound is not None:
            stage = bound.stage(self.context, self._world.device_array)
            self._bound = bound, stage
            self.plan.insert(stage, before="relative poses")
            self._take_bound()
        else:
            self.plan.remove("bound poses")

    def _take_bound(self) -> None:
        """Copy the bound poses from the other simulator's arrays now."""
        if self._bound is not None:
            bound, stage = self._bound
            self._world.bind(frozenset(body.index for body in bound.bodies))
            stage.launch()

    def pose(self, body: Body | str | int, env: int = 0) -> Pose:
        """Return a body's pose and velocities in one environment, as last set or moved, in the world.

        Args:
            body: the body, its name or its index.
            env: the environment.

        Raises:
            SceneError: the body or the environment is unknown.
        """
        (env,) = np.arange(self._world.n_envs)[self._world.env_indices([env])]
        return self._world.pose(self._body("pose", body).index, int(env))
