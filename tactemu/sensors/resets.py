"""Resets of some environments: on a GPU by a mask on the device, in one graph, without waiting."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.geometry.device_arrays import MASK_TYPES, as_warp_array, environment_mask
from tactemu.plan.clearing import clear_rows
from tactemu.plan.plan import Context, Plan
from tactemu.sensors.seeds import Seeds
from tactemu.sensors.world import World, on_host


class Resets:
    """Resets of the stages, readings and poses of a simulation.

    Args:
        plan: the plan whose stages are reset.
        context: the context that counts steps and time.
        world: the world whose poses are reset.
        arrays: readings, which are set to 0.
    """

    def __init__(self, plan: Plan, context: Context, world: World, arrays: list[wp.array]):
        self._plan, self._context, self._world, self._arrays = plan, context, world, arrays
        self._device = device = context.device
        self._mask = wp.zeros(world.n_envs, dtype=wp.bool, device=device)
        self._seeds = Seeds(world, device)
        self._graphs: dict[bool, wp.Graph] = {}
        self._warm = False

    def reset(self, envs: Any, seed: Any) -> None:
        """Reset environments; see :meth:`tactemu.sensors.simulation.Simulation.reset`."""
        envs = self._choose(envs)
        seeds = None if seed is None else self._seeds.fill(seed, envs, self._mask)
        if envs is None:
            self._context.step.fill_(0)
            self._context.time_ns.fill_(0)
        if self._device.is_cpu:
            self._world.reset(self._mask.numpy())
            self._clear(seeds)
        elif envs is None:  # the host writes the poses, so its copy stays valid
            self._world.reset(None)
            self._world.upload()
            self._clear(seeds)
        else:
            self._on_gpu(seeds)

    def _choose(self, envs: Any) -> Any:
        """Fill the mask with the environments to reset, and return them: on the host, or as a mask on the device."""
        n_envs = self._world.n_envs
        if envs is not None and not on_host(envs):
            array = as_warp_array(envs, "envs")
            if array.dtype in MASK_TYPES or not self._device.is_cpu:
                wp.copy(self._mask, environment_mask(array, n_envs, self._device))
                return array
            envs = array.numpy()
        if self._device.is_cuda and wp.get_stream(self._device).is_capturing:
            raise SceneError(
                "reset: a graph would reset the same environments in each launch; give a mask on the device, which you"
                " may change between launches"
            )
        mask = np.zeros(n_envs, bool)
        mask[self._world.env_indices(envs)] = True
        self._mask.assign(mask)
        return envs

    def _clear(self, seeds: wp.array | None) -> None:
        self._context.begin(self._mask, seeds)
        self._plan.reset(self._mask)
        for array in self._arrays:
            clear_rows(array, self._mask)

    def _all(self, seeds: wp.array | None) -> None:
        self._world.reset_rows(self._mask)
        self._clear(seeds)  # which puts bodies to the start of their motions

    def _on_gpu(self, seeds: wp.array | None) -> None:
        is_seeded = seeds is not None
        capturing = wp.get_stream(self._device).is_capturing
        if capturing and (self._world.has_unsent or not self._warm):
            raise SceneError(
                "reset: take one step and one reset before you capture a reset; they load what a graph cannot load"
            )
        self._world.upload()
        if capturing:
            self._all(seeds)
        elif is_seeded in self._graphs:
            wp.capture_launch(self._graphs[is_seeded])
        elif self._warm:
            with wp.ScopedCapture(self._device, force_module_load=False) as capture:
                self._all(seeds)
            assert capture.graph is not None
            self._graphs[is_seeded] = capture.graph
            wp.capture_launch(capture.graph)
        else:  # the first reset loads the modules, which a capture must not do
            self._all(seeds)
            self._warm = True
        self._world.changed_on_device()
