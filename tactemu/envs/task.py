"""The base of a task: its scene, its actions, and what it observes, rewards and ends, written once for any number of
environments."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Space

from tactemu.base.errors import SceneError, no_such
from tactemu.envs.arrays import Array, Arrays, make_arrays
from tactemu.envs.observations import SkinField, skin_fields
from tactemu.envs.uniform import uniform
from tactemu.scene.scene import Scene
from tactemu.sensors.sensor import Sensor
from tactemu.sensors.simulation import Simulation


class SkinTask(ABC):
    """A task with touch, the part of an environment that you write.

    All arrays have a first axis for the environments, of length 1 in a :class:`SkinEnv`. They are NumPy arrays, or
    torch tensors in a ``SkinVectorEnv(arrays="torch")``; ``self.xp`` is that library.

    Args:
        max_episode_steps: number of steps after which an episode is truncated.

    Raises:
        SceneError: ``max_episode_steps`` is less than 1, or an observed skin or field does not exist.
    """

    dt: ClassVar[float] = 0.01
    """Length of a step [s]."""
    observed: ClassVar[Mapping[str, Sequence[str]] | None] = None
    """The fields of each skin's reading that are observed, by the skin's name; ``None``: the first of each. They are in
    the observation as ``{skin}_{field}``."""

    def __init__(self, *, max_episode_steps: int = 200):
        if max_episode_steps < 1:
            raise SceneError(f"max_episode_steps must be >= 1, got {max_episode_steps!r}")
        self.max_episode_steps = max_episode_steps
        self.scene = Scene(dt=self.dt)
        self.action_space: Space = self.build(self.scene)
        self.fields: list[SkinField] = skin_fields(self.scene.sensors, self.observed)
        """The observed fields of the skins."""

    # -- what you write ----------------------------------------------------------------------------------------------

    @abstractmethod
    def build(self, scene: Scene) -> Space:
        """Add bodies and named skins to the scene, and return the space of one environment's actions."""

    @abstractmethod
    def begin(self, envs: Array) -> None:
        """Begin an episode where the mask ``envs`` is true: place bodies, draw goals (:meth:`uniform`,
        :meth:`merge`)."""

    @abstractmethod
    def act(self, actions: Array) -> None:
        """Apply actions, clipped to their space: pose bodies (:meth:`place`) or command an engine, before the step."""

    def measure(self) -> None:
        """Compute what the methods below share, after each step and each reset; default: nothing."""

    @abstractmethod
    def reward(self) -> Array:
        """Return the reward of the last step, ``(n_envs,)``."""

    def terminated(self) -> Array:
        """Return which environments have reached an end, bool, ``(n_envs,)``; default: none."""
        return self.zeros(self.num_envs, "int32") != 0

    def connect(self) -> None:
        """Prepare arrays once the scene is built, before the first episode; default: nothing."""

    def more_spaces(self) -> Mapping[str, Box]:
        """Return the spaces of what is observed beside the skins, by name; default: nothing."""
        return {}

    def more_observations(self) -> Mapping[str, Array]:
        """Return the values of :meth:`more_spaces`."""
        return {}

    def info(self) -> Mapping[str, Array]:
        """Return further values of the last step, ``(n_envs, ...)`` each, for the environment's ``info``."""
        return {}

    # -- what you use ------------------------------------------------------------------------------------------------

    sim: Simulation
    """The simulation, once the scene is built."""
    num_envs: int = 0
    arrays: Arrays

    @property
    def xp(self) -> Any:
        """The library of the arrays: ``numpy`` or ``torch``."""
        return self.arrays.xp

    def skin(self, name: str) -> Sensor:
        """Return a skin by its name.

        Raises:
            SceneError: there is none.
        """
        for sensor in self.scene.sensors:
            if sensor.name == name:
                return sensor
        raise SceneError(no_such("skin", name, [each.name for each in self.scene.sensors]))

    def read(self, skin: str, field: str, ground_truth: bool = False) -> Array:
        """Return a field of the last step's reading, ``(n_envs, *layout[, 3])``. Do not write into it."""
        key = skin, field, ground_truth
        if key not in self._readers:
            sensor = self.skin(skin)
            arrays = sensor.ground_truth_arrays if ground_truth else sensor.arrays
            self._readers[key] = self.arrays.reader(getattr(arrays, field))
        return self._readers[key]()

    def place(self, body: Any, **pose: Array) -> None:
        """Set the pose of a body in all environments (:meth:`tactemu.Simulation.set_pose`)."""
        self.sim.set_pose(body, **pose)

    def uniform(self, low: Any, high: Any, width: int) -> Array:
        """Return new random numbers, float32, ``(n_envs, width)``. Call it in :meth:`begin` only.

        They depend on each environment's seed and the number of its episode alone.
        """
        share = self.arrays.reader(uniform(self.sim.context, self._drawn, width))()
        self._drawn += width
        low, high = self.arrays.asarray(low), self.arrays.asarray(high)
        return low + (high - low) * share

    def zeros(self, shape: int | tuple[int, ...], dtype: str = "float32") -> Array:
        """Return an array of zeros."""
        return self.arrays.zeros(shape, dtype)

    def merge(self, envs: Array, new: Array, old: Array) -> None:
        """Replace the rows of ``old`` where the mask ``envs`` is true by those of ``new``."""
        self.arrays.merge(envs, new, old)

    # -- what the environment uses -----------------------------------------------------------------------------------

    def open(self, num_envs: int, device: str, library: str) -> None:
        """Build the scene. An environment calls it once.

        Raises:
            SceneError: another environment has this task, or the scene cannot be built.
        """
        if self.num_envs:
            raise SceneError(f"{type(self).__name__}: an environment has this task already; make one for each")
        self.arrays = make_arrays(library, device)
        self.sim = self.scene.build(num_envs, device=device)
        self.num_envs = num_envs
        self._readers: dict[tuple[str, str, bool], Any] = {}
        self._drawn = 0
        self.connect()

    def restart(self, envs: Array | None, seeds: np.ndarray | None = None) -> None:
        """Reset the simulation where the mask is true, or everywhere; ``seeds`` has one for each environment."""
        if seeds is not None and envs is not None and self.arrays.waits:
            seeds = seeds[envs]
        self.sim.reset(envs, seed=seeds)
        self._drawn = 0

    def observation_space(self) -> dict[str, Space]:
        """Return the spaces of one environment's observation, by name."""
        return {**{field.name: field.space for field in self.fields}, **self.more_spaces()}

    def observation(self) -> dict[str, Array]:
        """Return the observation of all environments; parts of it may be the simulation's own memory."""
        touch = {field.name: self.read(field.skin, field.field) for field in self.fields}
        return touch | dict(self.more_observations())


def make_task(task: SkinTask | None, kind: type[SkinTask] | None, options: Mapping[str, Any]) -> SkinTask:
    """Return the task of an environment: the given one, or a new one of a class.

    Raises:
        SceneError: there is neither, or there are options beside a task.
    """
    if task is None and kind is not None:
        return kind(**options)
    if task is None:
        raise SceneError("an environment needs a task: give one, or set task_class in a subclass")
    if options:
        raise SceneError(f"options of a task that is made already: {', '.join(options)}; give them to the task")
    return task
