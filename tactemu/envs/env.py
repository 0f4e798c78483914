"""One environment of a task: a vector environment of length 1 without its first axis."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import Env
from gymnasium.vector import AutoresetMode

from tactemu.envs.task import SkinTask, make_task
from tactemu.envs.vector_env import SkinVectorEnv


class SkinEnv(Env):
    """One environment of a task, as a :class:`gymnasium.Env`.

    Args:
        task: the task, one for each environment; None: a new one of :attr:`task_class`.
        device: a Warp device, ``cpu`` or ``cuda:0``.
        render_mode: ``rgb_array`` or None.
        options: options of :attr:`task_class`.

    Raises:
        SceneError: an option is wrong.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}
    task_class: ClassVar[type[SkinTask] | None] = None
    """The class of its task, for a subclass that makes its own."""

    def __init__(
        self, task: SkinTask | None = None, *, device: str = "cpu", render_mode: str | None = None, **options: Any
    ):
        self.task = make_task(task, self.task_class, options)
        mode = AutoresetMode.DISABLED
        self._envs = SkinVectorEnv(1, self.task, device=device, render_mode=render_mode, autoreset_mode=mode)
        self.render_mode = render_mode
        self.metadata = {name: value for name, value in self._envs.metadata.items() if name != "autoreset_mode"}
        self.observation_space = self._envs.single_observation_space
        self.action_space = self._envs.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin a new episode, with the random numbers of a seed, or with those that follow.

        Raises:
            SceneError: the device is a GPU and this process is a fork, or the scene cannot be built.
        """
        super().reset(seed=seed)
        observation, infos = self._envs.reset(seed=seed)
        return _first(observation), _first(infos)

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Take one step.

        Raises:
            ResetNeeded: the episode has ended, or none has begun.
            PoseError: a pose is not finite, for instance because the action is not.
        """
        observation, reward, terminated, truncated, infos = self._envs.step(np.asarray(action)[None])
        return _first(observation), float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(infos)

    def render(self) -> np.ndarray | None:
        """Return a picture of the skins (:meth:`SkinVectorEnv.render`)."""
        frames = self._envs.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """End the simulation's threads."""
        self._envs.close()


def _first(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the first environment, without the masks of ``infos``."""
    return {name: each[0] for name, each in values.items() if not name.startswith("_")}
