"""The motions of a simulation's bodies, each on its environment's own clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import warp as wp

from tactemu.geometry.bodies import Body
from tactemu.plan.launches import Launches
from tactemu.plan.plan import Context, Stage
from tactemu.sensors.motion_table import drive_again, is_plain, move_bodies, paths_of
from tactemu.sensors.world import World, on_host


class Motions:
    """The motions of bodies: a kernel evaluates plain ones, Python the others.

    A body that you pose is taken from its motion, in the environments in which you pose it, until it is released or
    reset.

    Args:
        bodies: all bodies of the scene.
        world: the poses that the motions write.
        context: the context that counts time, and the beginning of each environment's episode.
        dt_ns: length of the step being taken [ns], on the device.
        ahead: steps by which the time that the kernel reads is behind that of the step being taken.
        batched: Python motions get arrays of times, not a number.
    """

    def __init__(
        self, bodies: Sequence[Body], world: World, context: Context, dt_ns: wp.array, *, ahead: int, batched: bool
    ):
        moving = [body for body in bodies if body.motion is not None]
        self._plain = [body for body in moving if is_plain(body.motion)]
        self._python = [body for body in moving if not is_plain(body.motion)]
        self.has_python = bool(self._python)
        """Does Python move a body?"""
        self._world, self._context, self._batched = world, context, batched
        self._columns = {body.index: k for k, body in enumerate((*self._plain, *self._python))}
        shape, device = (context.n_envs, len(moving)), context.device
        self._driven = context.array(np.ones(shape, np.uint8), wp.uint8)
        self._free = np.ones(len(moving), np.uint8)
        """0 for bodies with bound poses, which no reset gives back."""
        self._device_free = wp.array(self._free, dtype=wp.uint8, device=device)
        self._none = wp.zeros(1, dtype=wp.uint8, device=device)
        # what the host knows; a mask on a GPU, which it does not know, cannot reset what Python moves
        self._host_driven, self._host_began = np.ones(shape, np.uint8), np.zeros(context.n_envs, np.int64)
        if device.is_cpu:
            self._host_driven, self._host_began = self._driven.numpy(), context.began_ns.numpy()
        self._step, self._now = Launches(), Launches()
        if self._plain:
            paths = paths_of(self._plain, world.start_rows, self._driven, device)
            dim, clock, outputs = (context.n_envs, len(self._plain)), [context.clock, dt_ns], [world.device_array]
            self._step = context.record(move_bodies, dim, [*clock, ahead, paths], outputs)
            self._now = context.record(move_bodies, dim, [*clock, 0, paths], outputs)
        self._note()

    # -- stepping ---------------------------------------------------------------------------------------------------

    def stages(self) -> list[Stage]:
        """Return the stage that moves bodies; it also gives them back to their motions at a reset."""
        if not self._columns:
            return []
        plain, python = (", ".join(body.name for body in each) for each in (self._plain, self._python))
        reason = f"motions of {plain} at each environment's own time" if plain else ""
        reason += f"{'; ' if plain and python else ''}Python moves {python}" if python else ""
        return [Stage(name="motions", reason=reason, launch=self._step, reset=self._reset)]

    @property
    def in_python(self) -> list[str]:
        """The names of the bodies that Python moves."""
        return [body.name for body in self._python]

    def times(self, time_ns: int) -> Any:
        """Return the time since the reset [s]; in a batch that of each environment, ``(n_envs,)``."""
        return (time_ns - self._host_began) * 1e-9 if self._batched else (time_ns - int(self._host_began[0])) * 1e-9

    def move(self, time_ns: int) -> None:
        """Set the poses that Python computes for a time."""
        for body in self._python:
            driven = self._host_driven[:, self._columns[body.index]]
            if driven.any():
                pose = body.pose(self.times(time_ns))
                self._world.put(body.index, pose, None if driven.all() else np.flatnonzero(driven))

    # -- taking bodies from their motions ---------------------------------------------------------------------------

    def drives(self, body: Body, envs: Any) -> bool:
        """Return True if a motion moves the body in one of the environments, as far as the host knows."""
        k = self._columns.get(body.index)
        return k is not None and bool(self._host_driven[self._world.env_indices(envs), k].any())

    def take(self, body: Body, envs: Any) -> None:
        """Take a body from its motion in some environments, if it has one."""
        k = self._columns.get(body.index)
        if k is not None:
            self._drive(k, envs, take=True)

    def give_back(self, body: Body, envs: Any) -> None:
        """Give a body back to its motion in some environments."""
        k = self._columns[body.index]
        self._drive(k, envs)

    def _drive(self, k: int, envs: Any, *, take: bool = False) -> None:
        where = self._world.env_indices(envs)
        self._host_driven[where, k] = 0 if take else self._free[k]
        if not self._context.device.is_cpu:
            mask = np.zeros(self._context.n_envs, bool)
            mask[where] = True
            values = self._none if take else self._device_free[k : k + 1]
            self._launch(wp.array(mask, dtype=wp.bool, device=self._context.device), values, k, k + 1)
        self._note()

    def bind(self, bodies: Sequence[Body]) -> None:
        """Take these bodies from their motions for good, and give back those that were taken so before."""
        columns = [self._columns[body.index] for body in bodies if body.index in self._columns]
        freed = np.flatnonzero(self._free == 0)
        self._free[:] = 1
        self._free[columns] = 0
        self._device_free.assign(self._free)
        for k in {*freed.tolist(), *columns}:
            self._drive(k, None)

    def _note(self) -> None:
        """Tell the world which bodies the device moves by itself."""
        moved = [body.index for k, body in enumerate(self._plain) if self._host_driven[:, k].any()]
        self._world.let_device_move(moved)

    # -- resets -----------------------------------------------------------------------------------------------------

    def show_start(self) -> None:
        """Set the poses of bodies to those of their motions at the present."""
        self._now()

    def _reset(self, mask: wp.array) -> None:
        self._launch(mask, self._device_free, 0, len(self._free))
        self._now()

    def _launch(self, mask: wp.array, values: Any, first: int, end: int) -> None:
        driven = cast(wp.array, self._driven[:, first:end])
        wp.launch(drive_again, dim=driven.shape, inputs=[mask, values], outputs=[driven], device=self._context.device)

    def after_reset(self, envs: Any, time_ns: int) -> None:
        """Note a reset at a time, and move the bodies that Python moves to their starts."""
        if not self._context.device.is_cpu and (envs is None or on_host(envs)):
            where = self._world.env_indices(envs)
            self._host_began[where], self._host_driven[where] = time_ns, self._free
        elif not self._context.device.is_cpu:
            self._host_driven[:] = self._free
        self._note()
        self.move(time_ns)

    def after_restore(self) -> None:
        """Read what the host knows from a restored device."""
        if not self._context.device.is_cpu:
            self._host_driven[:], self._host_began[:] = self._driven.numpy(), self._context.began_ns.numpy()
        self._note()
