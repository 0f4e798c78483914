"""Many environments of a task, stepped together on one device: the code path of all environments with touch."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from tactemu.base.errors import SceneError
from tactemu.envs.arrays import Array, Arrays
from tactemu.envs.picture import SkinPictures
from tactemu.envs.task import SkinTask, make_task

_is_forked = False


def _mark_as_forked() -> None:
    global _is_forked
    _is_forked = True


os.register_at_fork(after_in_child=_mark_as_forked)


class SkinVectorEnv(VectorEnv):
    """``num_envs`` environments of a task, as a :class:`gymnasium.vector.VectorEnv`.

    They are one simulation: a step is one call for all. The scene is built at the first :meth:`reset`.

    Args:
        num_envs: number of environments.
        task: the task, one for each environment; None: a new one of :attr:`task_class`.
        device: a Warp device, ``cpu`` or ``cuda:0``.
        autoreset_mode: the time at which an environment that has ended begins anew: at its ``NEXT_STEP``, whose action
            is then ignored, in the ``SAME_STEP``, whose ``infos`` have the last observation, or only by
            ``reset(options={"reset_mask": mask})`` (``DISABLED``).
        render_mode: ``rgb_array`` or None.
        arrays: ``numpy``, or ``torch`` for tensors on the device; a step on a GPU then does not wait for it, and
            ``infos["final_obs"]`` has rows for all environments.
        options: options of :attr:`task_class`.

    Raises:
        SceneError: an option is wrong.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}
    task_class: ClassVar[type[SkinTask] | None] = None
    """The class of its task, for a subclass that makes its own."""

    def __init__(
        self,
        num_envs: int = 1,
        task: SkinTask | None = None,
        *,
        device: str = "cpu",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        arrays: str = "numpy",
        **options: Any,
    ):
        self.task = task = make_task(task, self.task_class, options)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SceneError(f"render_mode must be 'rgb_array' or None, got {render_mode!r}")
        self.num_envs, self.render_mode = num_envs, render_mode
        self._mode = AutoresetMode(autoreset_mode)
        self._device, self._library, self._is_open = device, arrays, False
        self.metadata = {
            **type(self).metadata,
            "render_fps": round(1 / task.dt),
            "autoreset_mode": self._mode,
            "units": {field.name: field.unit for field in task.fields},
        }
        self.single_observation_space = Dict(task.observation_space())
        self.single_action_space = task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._pictures = SkinPictures(task)

    # -- the interface of Gymnasium ----------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begin new episodes.

        Args:
            seed: environment i takes ``seed + i``, or its own of a sequence; None: it goes on with its random numbers.
            options: ``{"reset_mask": mask}`` resets the environments where the mask is true, bool, ``(num_envs,)``.

        Raises:
            SceneError: the device is a GPU and this process is a fork, the mask has another shape or type, or the scene
                cannot be built.
        """
        if not self._is_open:
            self._open()
            if seed is None:
                seed = int(self.np_random.integers(2**31))
        seeds = self._seeds(seed)
        super().reset(seed=int(seeds[0]) if seeds[0] >= 0 else None)
        mask = (options or {}).get("reset_mask")
        envs = self._everywhere if mask is None else self._checked(mask)
        has_seed = seeds >= 0
        for chosen, given in ((has_seed, seeds), (~has_seed, None)):
            if chosen.all():
                self._begin(None if mask is None else envs, given)
            elif chosen.any():
                self._begin(envs & self._arrays.asarray(chosen), given)
        self._ended = self._ended & ~envs
        self.task.measure()
        observation = self._copied(self.task.observation())
        return observation, self._masked(self.task.info(), envs)

    def step(self, actions: Array) -> tuple[dict[str, Array], Array, Array, Array, dict[str, Any]]:
        """Step all environments.

        Raises:
            ResetNeeded: it was never reset, or (``DISABLED``, NumPy) an environment has ended and was not reset.
            PoseError: a pose is not finite, for instance because an action is not (on a GPU, with torch: at the next
                ``task.sim.check()``).
        """
        if not self._is_open:
            raise ResetNeeded("step: call reset first")
        task, ended = self.task, self._ended
        if self._mode is AutoresetMode.DISABLED and self._arrays.waits and ended.any():
            first = ", ".join(map(str, np.flatnonzero(ended)[:5]))
            raise ResetNeeded(f"step: environments have ended: {first}; reset them first")
        task.act(self._clipped(actions))
        task.sim.step()
        if self._arrays.waits and not task.sim.device.is_cpu:
            task.sim.check()
        self._age += 1
        return self._finish(ended)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return a picture of the skins of each environment, ``(height, width, 3)``, uint8: the magnitude of the first
        observed field of each taxel, relative to the largest so far. Without a ``render_mode`` return None."""
        if self.render_mode is None:
            return None
        if not self._is_open:
            raise ResetNeeded("render: call reset first")
        return self._pictures.draw()

    def close_extras(self, **_kwargs: Any) -> None:
        """End the simulation's threads."""
        if self._is_open:
            self.task.sim.close()

    # -- parts of a step ---------------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Build the scene."""
        if _is_forked and not self._device.startswith("cpu"):
            raise SceneError(
                f"a forked process cannot use the GPU {self._device!r}: start processes by "
                "AsyncVectorEnv(..., context='spawn'), or use one vector environment of the task, which is faster"
            )
        self.task.open(self.num_envs, self._device, self._library)
        self._arrays: Arrays = self.task.arrays
        zeros = self._arrays.zeros
        self._age, self._ended = zeros(self.num_envs, "int32"), zeros(self.num_envs, "int32") != 0
        self._everywhere = ~self._ended
        self._is_open = True
        space = self.single_action_space
        self._action_range = (
            [self._arrays.asarray(each) for each in (space.low, space.high)] if isinstance(space, Box) else None
        )

    def _seeds(self, seed: int | Sequence[int | None] | None) -> np.ndarray:
        """Return the seed of each environment, int64; -1: it has none."""
        if seed is None or isinstance(seed, int | np.integer):
            given = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            given = list(seed)
        if len(given) != self.num_envs or any(each is not None and each < 0 for each in given):
            raise SceneError(f"reset: seed must be a number >= 0, or {self.num_envs} of them, got {seed!r}")
        return np.array([-1 if each is None else each for each in given], np.int64)

    def _checked(self, mask: Any) -> Array:
        """Return the mask of a reset as an array."""
        shape, kind = getattr(mask, "shape", None), str(getattr(mask, "dtype", type(mask).__name__))
        if tuple(shape or ()) != (self.num_envs,) or not kind.endswith("bool"):
            raise SceneError(f"reset_mask must be bool, of shape ({self.num_envs},), got {kind} of shape {shape}")
        return self._arrays.asarray(mask)

    def _clipped(self, actions: Any) -> Array:
        """Return actions within their space."""
        actions = self._arrays.asarray(actions)
        return actions if self._action_range is None else self._arrays.xp.clip(actions, *self._action_range)

    def _begin(self, envs: Array | None, seeds: np.ndarray | None = None) -> None:
        """Begin episodes where the mask is true, or everywhere; ``seeds`` has one for each environment."""
        self.task.restart(envs, seeds)
        where = self._everywhere if envs is None else envs
        self._arrays.merge(where, 0, self._age)
        self.task.begin(where)

    def _finish(self, ended: Array) -> tuple[dict[str, Array], Array, Array, Array, dict[str, Any]]:
        """Return the result of a step that was taken; begin the episodes that are due."""
        task, arrays, mode = self.task, self._arrays, self._mode
        if mode is AutoresetMode.NEXT_STEP and (not arrays.waits or ended.any()):
            self._begin(ended)
        task.measure()
        reward = self._one_each("reward", task.reward())
        terminated = self._one_each("terminated", task.terminated())
        truncated = self._age >= task.max_episode_steps
        if mode is AutoresetMode.NEXT_STEP:
            reward = arrays.xp.where(ended, 0.0, reward)
            terminated = terminated & ~ended
        observation, about = self._copied(task.observation()), task.info()
        self._ended = terminated | truncated
        if mode is AutoresetMode.SAME_STEP and (not arrays.waits or self._ended.any()):
            infos = self._begin_at_once(observation, about)
        else:
            infos = self._masked(about, self._everywhere)
        if arrays.waits:
            reward = reward.astype(np.float64)
        return observation, reward, terminated, truncated, infos

    def _one_each(self, method: str, values: Array) -> Array:
        """Check that a task's method has returned a number for each environment, and return them."""
        if getattr(values, "shape", ()) != (self.num_envs,):
            kind, got = type(self.task).__name__, tuple(getattr(values, "shape", ()))
            raise SceneError(f"{kind}: {method} must return ({self.num_envs},), got {got}")
        return values

    def _begin_at_once(self, observation: dict[str, Array], about: Mapping[str, Array]) -> dict[str, Any]:
        """Begin the episodes of the environments that have ended, put their first observations in their rows, and
        return the infos, with the last ones."""
        done = self._ended
        final = self._rows(self._copied(observation) if not self._arrays.waits else observation, done)
        final_info = self._masked(about, done)
        self._begin(done)
        self.task.measure()
        for name, values in self.task.observation().items():
            self._arrays.merge(done, values, observation[name])
        infos = self._masked(self.task.info(), self._everywhere)
        return infos | self._marked("final_obs", final, done) | self._marked("final_info", final_info, done)

    # -- copies ------------------------------------------------------------------------------------------------------

    def _copied(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return copies of values, by name: the next step overwrites the simulation's own."""
        return {name: self._arrays.copy(each) for name, each in values.items()}

    def _masked(self, values: Mapping[str, Array], envs: Array) -> dict[str, Any]:
        """Return values as ``infos`` hold them: 0 where the mask ``envs`` is false, and the mask as ``_name``."""
        if envs is self._everywhere:
            every = {f"_{name}": self._arrays.copy(envs) for name in values}
            return self._copied(values) | every
        infos: dict[str, Any] = {}
        for name, each in values.items():
            kept = self._arrays.zeros(tuple(each.shape), str(each.dtype).removeprefix("torch."))
            self._arrays.merge(envs, each, kept)
            infos |= self._marked(name, kept, envs)
        return infos

    def _marked(self, name: str, value: Any, envs: Array) -> dict[str, Any]:
        """Return one entry of ``infos`` and the mask of the environments that have it."""
        return {name: value, f"_{name}": self._arrays.copy(envs)}

    def _rows(self, observation: dict[str, Array], done: Array) -> Any:
        """Return the last observations of the environments that have ended: an array of them, None for all others.

        With torch return all rows, since their number is not known without waiting for the device.
        """
        if not self._arrays.waits:
            return observation
        rows = np.full(self.num_envs, None, object)
        for e in np.flatnonzero(done):
            rows[e] = {name: values[e].copy() for name, values in observation.items()}
        return rows
