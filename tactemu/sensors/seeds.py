"""Seeds of resets: numbers from the host or from an array on the device, one for each environment that is reset."""

# pyright: reportIndexIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false, reportArgumentType=false

import functools
from typing import Any

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError
from tactemu.base.kernels import warp_kernel
from tactemu.geometry.device_arrays import as_warp_array, check_device
from tactemu.sensors.world import World, on_host

MAX_SEED = 2**63 - 1
SEED_TYPES = (wp.int32, wp.int64, wp.uint32)
"""Number types that an array of seeds on a GPU may have."""


def seeds_of(seed: Any, count: int) -> np.ndarray:
    """Return a seed for each of ``count`` environments, int64: ``seed``, ``seed + 1`` and so on, or those of a list.

    Raises:
        SceneError: ``seed`` is neither a whole number in range nor a list of ``count`` of them.
    """
    wanted = (
        f"reset: seed must be a whole number from 0 to 2**63 - 1, or {count} of them, one for each environment reset"
    )
    try:
        given = np.asarray(seed)
    except (TypeError, ValueError):
        raise SceneError(f"{wanted}; got {seed!r}") from None
    if (given.size and given.dtype.kind not in "iu") or given.ndim > 1:
        raise SceneError(f"{wanted}; got {seed!r}")
    if given.ndim == 1 and len(given) != count:
        raise SceneError(f"{wanted}; got {len(given)}")
    last = int(given) + count - 1 if given.ndim == 0 else int(given.max(initial=0))
    if given.min(initial=0) < 0 or last > MAX_SEED:
        raise SceneError(f"{wanted}; got {seed!r}")
    return given.astype(np.int64) if given.ndim else int(given) + np.arange(count, dtype=np.int64)


class Seeds:
    """The numbers from which environments draw after a reset, in :attr:`array`, int64, shape ``(n_envs,)``."""

    def __init__(self, world: World, device: wp.Device):
        self._world, self._device = world, device
        self.array = wp.zeros(world.n_envs, dtype=wp.int64, device=device)
        self._chosen = wp.zeros(world.n_envs, dtype=wp.int32, device=device)
        self._order = wp.zeros(world.n_envs, dtype=wp.int32, device=device)
        self._first = wp.zeros(1, dtype=wp.int64, device=device)
        self._loaded: set[Any] = set()

    def fill(self, seed: Any, envs: Any, mask: wp.array) -> wp.array:
        """Number the environments that are reset, and return :attr:`array`; the numbers of others are not used.

        Args:
            seed: a number, or one for each environment: see :meth:`tactemu.Simulation.reset`.
            envs: the environments to reset: an array of Warp's is a mask on the device, all others are on the host.
            mask: the same, on the device.

        Raises:
            SceneError: a number is out of range, there are too many or too few, or an environment is given twice; or a
                graph is captured, and the numbers are not on the device.
        """
        by_mask = isinstance(envs, wp.array)
        if self._device.is_cuda:
            if wp.get_stream(self._device).is_capturing and on_host(seed):
                raise SceneError(
                    "reset: a graph would take the same seed in each launch; give it in an array on the device, which"
                    " you may change between launches"
                )
            if by_mask or (envs is None and not on_host(seed)):
                self._fill_on_device(seed, mask)
                return self.array
        if not on_host(seed):
            seed = as_warp_array(seed, "seed").numpy()
            seed = seed[0] if seed.shape == (1,) else seed
        self._fill_from_host(seed, mask.numpy() if by_mask else envs, by_mask)
        return self.array

    def _fill_from_host(self, seed: Any, envs: Any, by_mask: bool) -> None:
        n_envs = self._world.n_envs
        chosen = np.arange(n_envs)[self._world.env_indices(envs)]
        if len(np.unique(chosen)) < len(chosen):
            twice = next(env for env in chosen.tolist() if (chosen == env).sum() > 1)
            raise SceneError(f"reset: environment {twice} is given twice; with a seed each takes one number")
        host = np.zeros(n_envs, np.int64)
        if by_mask and np.ndim(seed):
            host[:] = seeds_of(seed, n_envs)
        else:
            host[chosen] = seeds_of(seed, len(chosen))
        self.array.assign(host)

    def _fill_on_device(self, seed: Any, mask: wp.array) -> None:
        """Number the environments of a mask without waiting for it."""
        n_envs = self._world.n_envs
        if on_host(seed) and np.ndim(seed):
            self.array.assign(seeds_of(seed, n_envs))
            return
        if on_host(seed):
            self._first.fill_(int(seeds_of(seed, n_envs)[0]))
            numbers = self._first
        else:
            numbers = as_warp_array(seed, "seed")
            check_device(numbers, self._device, "seed")
            if numbers.dtype not in SEED_TYPES or numbers.shape not in ((1,), (n_envs,)):
                raise SceneError(
                    f"reset: an array of seeds on the device must have 1 or {n_envs} numbers (int32, int64, uint32),"
                    f" got {numbers.shape} {numbers.dtype.__name__}"
                )
        way = (numbers.dtype, numbers.shape)
        if wp.get_stream(self._device).is_capturing and way not in self._loaded:
            raise SceneError(
                "reset: reset once with such an array of seeds before you capture a reset; it loads what a graph cannot"
            )
        self._loaded.add(way)
        if numbers.shape == (1,):
            self._launch(_count_kernel, [mask, self._chosen])
            wp.utils.array_scan(self._chosen, self._order, inclusive=False)
        self._launch(_number_kernel(numbers.dtype), [numbers, self._order, self.array])

    def _launch(self, kernel: wp.Kernel, inputs: list) -> None:
        wp.launch(kernel, dim=self._world.n_envs, inputs=inputs, device=self._device)


@warp_kernel
def _count_kernel(mask: wp.array(dtype=wp.bool), chosen: wp.array(dtype=wp.int32)):
    e = wp.tid()
    chosen[e] = wp.where(mask[e], 1, 0)


@functools.cache
def _number_kernel(dtype: type):
    """Return the kernel that writes a number for each environment: its own, or the first one plus its place in the
    mask."""

    @warp_kernel
    def number(given: wp.array(dtype=dtype), order: wp.array(dtype=wp.int32), seeds: wp.array(dtype=wp.int64)):
        e = wp.tid()
        if given.shape[0] == 1:
            seeds[e] = wp.int64(given[0]) + wp.int64(order[e])
        else:
            seeds[e] = wp.int64(given[e])

    return number
