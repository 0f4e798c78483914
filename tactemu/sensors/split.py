"""One batch over several devices: each simulates a share of the environments, and they read like one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Self

import numpy as np

from tactemu.base.errors import SceneError, no_such
from tactemu.base.keywords import takes_words
from tactemu.base.words import Names
from tactemu.geometry import rotation
from tactemu.geometry.bodies import Body
from tactemu.geometry.motion import Pose
from tactemu.sensors.build_options import BuildOptions
from tactemu.sensors.seeds import seeds_of
from tactemu.sensors.sensor import Sensor
from tactemu.sensors.simulation import Simulation

POSE = ("position", "quaternion", "linear_velocity", "angular_velocity")


class SplitSimulation:
    """The simulation that :meth:`tactemu.Scene.build_split` returns for several devices.

    All devices step at the same time: a step does not wait, only a reading does. Arrays on a device belong to its part,
    a :class:`~tactemu.sensors.simulation.Simulation` of its own: ``split.parts[k].pose_array``, ``split.sensor(skin,
    k).arrays.force``.
    """

    names: Names = "tactemu"
    """The words that its methods take."""

    def __init__(
        self, bodies: Sequence[Body], sensors: Sequence[Sensor], devices: Sequence[Any], *, n_envs: int, first_env: int,
        seed: int, dtype: str, **options: Any,
    ):  # fmt: skip
        if not devices or n_envs is None or n_envs < len(devices):
            raise SceneError(
                f"build: {len(devices)} devices share the environments; n_envs must be as many or more, got {n_envs!r}"
            )
        self.n_envs = int(n_envs)
        """Number of environments of all parts."""
        self.starts = [self.n_envs * k // len(devices) for k in range(len(devices) + 1)]
        """Part k simulates environments ``starts[k]`` to ``starts[k + 1]``."""
        self._handles = [_handles(sensors) for _ in devices]
        self.parts = tuple(
            Simulation(
                bodies,
                handles,
                BuildOptions(n_envs=b - a, first_env=first_env + a, device=device, seed=seed, dtype=dtype),
                **options,
            )
            for device, handles, (a, b) in zip(devices, self._handles, pairwise(self.starts))
        )
        """The simulation on each device."""
        self._names = [sensor.name for sensor in sensors]

    def sensor(self, which: Sensor | str, part: int) -> Sensor:
        """Return the handle of a skin on one device.

        Raises:
            SceneError: the simulation has no such skin.
        """
        name = which if isinstance(which, str) else which.name
        if name not in self._names:
            raise SceneError(no_such("sensor", name, self._names))
        return self._handles[part][self._names.index(name)]

    def step(self, n: int = 1, *, dt: float | None = None) -> None:
        """Take ``n`` steps of all parts (:meth:`Simulation.step`)."""
        for part in self.parts:
            part.step(n, dt=dt)

    @property
    def time(self) -> float:
        """The simulated time [s]."""
        return self.parts[0].time

    @property
    def env_time(self) -> np.ndarray:
        """The simulated time of each environment since its own reset [s] (:attr:`Simulation.env_time`)."""
        return np.concatenate([part.env_time for part in self.parts])

    @takes_words
    def set_pose(
        self,
        body: Body | str | int,
        *,
        position: Any = None,
        quaternion: Any = None,
        linear_velocity: Any = None,
        angular_velocity: Any = None,
        order: rotation.Order = "wxyz",
        envs: Sequence[int] | np.ndarray | None = None,
    ) -> None:
        """Set a body's pose (:meth:`Simulation.set_pose`); lists and NumPy arrays hold rows for all environments."""
        pose = dict(zip(POSE, (position, quaternion, linear_velocity, angular_velocity)))
        chosen = self._chosen(envs)
        for part, a, b in self._shares():
            mine = np.flatnonzero((chosen >= a) & (chosen < b))
            if not len(mine):
                continue
            rows = {name: _rows(values, len(chosen), mine) for name, values in pose.items() if values is not None}
            part.set_pose(body, envs=None if envs is None else chosen[mine] - a, order=order, **rows)

    def pose(self, body: Body | str | int, env: int = 0) -> Pose:
        """Return a body's pose and velocities in one environment (:meth:`Simulation.pose`)."""
        (env,) = self._chosen([env])
        k = int(np.searchsorted(self.starts, env, side="right")) - 1
        return self.parts[k].pose(body, env - self.starts[k])

    @takes_words
    def release(self, body: Body | str | int, *, envs: Sequence[int] | np.ndarray | None = None) -> None:
        """Give a body back to its motion (:meth:`Simulation.release`)."""
        chosen = self._chosen(envs)
        for part, a, b in self._shares():
            mine = chosen[(chosen >= a) & (chosen < b)] - a
            if len(mine):
                part.release(body, envs=None if envs is None else mine)

    @takes_words
    def reset(
        self, envs: Sequence[int] | np.ndarray | None = None, *, seed: int | Sequence[int] | np.ndarray | None = None
    ) -> None:
        """Reset all environments, or those given by indices or a mask (:meth:`Simulation.reset`)."""
        chosen = self._chosen(envs)
        seeds = None if seed is None else seeds_of(seed, len(chosen))
        for part, a, b in self._shares():
            mine = np.flatnonzero((chosen >= a) & (chosen < b))
            if len(mine):
                own = None if seeds is None else seeds[mine]
                part.reset(None if envs is None else chosen[mine] - a, seed=own)

    def read(self, skin: Sensor | str, ground_truth: bool = False) -> Any:
        """Return the reading of a skin in all environments (:meth:`Sensor.read`)."""
        handles = [self.sensor(skin, k) for k in range(len(self.parts))]
        return _joined([each.read_ground_truth() if ground_truth else each.read() for each in handles])

    def check(self) -> None:
        """Wait for all devices, and raise an error if a pose was not usable (:meth:`Simulation.check`)."""
        for part in self.parts:
            part.check()

    def close(self) -> None:
        """End the threads of all parts."""
        for part in self.parts:
            part.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _shares(self) -> list[tuple[Simulation, int, int]]:
        return [(part, a, b) for part, (a, b) in zip(self.parts, pairwise(self.starts))]

    def _chosen(self, envs: Any) -> np.ndarray:
        """Return the indices of the environments that ``envs`` selects."""
        if envs is None:
            return np.arange(self.n_envs)
        given = np.asarray(envs)
        if given.dtype == bool:
            if given.shape != (self.n_envs,):
                raise SceneError(f"envs: a mask must have shape ({self.n_envs},), got {given.shape}")
            return np.flatnonzero(given)
        if given.ndim != 1 or given.dtype.kind not in "iu" or ((given < 0) | (given >= self.n_envs)).any():
            raise SceneError(f"envs: expected indices in 0..{self.n_envs - 1} or a mask, got {envs!r}")
        return given


def _handles(sensors: Sequence[Sensor]) -> list[Sensor]:
    return [sensor._clone() for sensor in sensors]


def _rows(values: Any, n: int, mine: np.ndarray) -> np.ndarray:
    """Return values for all environments as they are, or only the rows ``mine`` of one part."""
    values = np.asarray(values, np.float64)
    if values.ndim == 2 and len(values) != n:
        raise SceneError(f"set_pose: expected a row for each of {n} environments, got {len(values)}")
    return values[mine] if values.ndim == 2 else values


def _joined(parts: list[Any]) -> Any:
    """Join the readings of all parts: arrays, or the tuples of arrays that some models read."""
    if isinstance(parts[0], tuple):
        return type(parts[0])(*(_joined(list(each)) for each in zip(*parts)))
    return np.concatenate(parts)
