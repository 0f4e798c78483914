"""The arrays of a task: NumPy's on the host, or torch's on the simulation's device, behind the same few methods."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError

Array = Any
"""A NumPy array or a torch tensor; the first axis is that of the environments."""


class Arrays(ABC):
    """The operations that differ between the two libraries."""

    xp: Any
    """The library, ``numpy`` or ``torch``: its functions of the same name and arguments suit both."""
    waits: ClassVar[bool]
    """True if the values are on the host, so that a step waits for them."""

    @abstractmethod
    def asarray(self, values: Any) -> Array:
        """Return values as an array, float32 unless they are whole numbers."""

    @abstractmethod
    def zeros(self, shape: int | tuple[int, ...], dtype: str = "float32") -> Array:
        """Return an array of zeros."""

    @abstractmethod
    def copy(self, values: Array) -> Array:
        """Return a copy in new memory."""

    @abstractmethod
    def reader(self, array: wp.array) -> Callable[[], Array]:
        """Return a function that returns the present values of an array of the simulation; do not write into them."""

    @abstractmethod
    def write(self, array: wp.array, values: Array) -> None:
        """Write values into an array of the simulation, which may have another shape of the same size."""

    @abstractmethod
    def merge(self, envs: Array, new: Array, old: Array) -> None:
        """Replace the rows of ``old`` where the mask ``envs`` is true by those of ``new``."""


class NumpyArrays(Arrays):
    """NumPy arrays. Those of a simulation on a CPU are read in place."""

    xp = np
    waits = True

    def asarray(self, values: Any) -> np.ndarray:
        array = np.asarray(values)
        return array if array.dtype.kind in "iub" else array.astype(np.float32, copy=False)

    def zeros(self, shape: int | tuple[int, ...], dtype: str = "float32") -> np.ndarray:
        return np.zeros(shape, dtype)

    def copy(self, values: np.ndarray) -> np.ndarray:
        return np.array(values)

    def reader(self, array: wp.array) -> Callable[[], np.ndarray]:
        assert array.device is not None
        if array.device.is_cpu:
            values = array.numpy()
            return lambda: values
        return array.numpy

    def write(self, array: wp.array, values: np.ndarray) -> None:
        assert array.device is not None
        if array.device.is_cpu:
            array.numpy()[...] = values.reshape(array.shape)
        else:
            array.assign(values.reshape(array.shape))

    def merge(self, envs: np.ndarray, new: np.ndarray, old: np.ndarray) -> None:
        old[envs] = np.broadcast_to(new, old.shape)[envs]


class TorchArrays(Arrays):
    """Tensors on the simulation's device, in the simulation's own memory. No method waits for the device.

    Raises:
        SceneError: torch is not installed.
    """

    waits = False

    def __init__(self, device: str):
        try:
            self.xp: Any = importlib.import_module("torch")
        except ImportError as error:
            raise SceneError(f"arrays='torch': torch cannot be imported ({error}): pip install torch") from None
        self._device = device

    def asarray(self, values: Any) -> Array:
        tensor = self.xp.as_tensor(values, device=self._device)
        return tensor.to(self.xp.float32) if tensor.is_floating_point() else tensor

    def zeros(self, shape: int | tuple[int, ...], dtype: str = "float32") -> Array:
        return self.xp.zeros(shape, dtype=getattr(self.xp, dtype), device=self._device)

    def copy(self, values: Array) -> Array:
        return values.clone()

    def reader(self, array: wp.array) -> Callable[[], Array]:
        tensor = self.xp.from_dlpack(array)
        return lambda: tensor

    def write(self, array: wp.array, values: Array) -> None:
        self.xp.from_dlpack(array).copy_(values.reshape(array.shape))

    def merge(self, envs: Array, new: Array, old: Array) -> None:
        wide = envs.reshape(-1, *[1] * (old.ndim - 1))
        old.copy_(self.xp.where(wide, new, old))


def make_arrays(library: str, device: str) -> Arrays:
    """Return the arrays of a library, ``numpy`` or ``torch``.

    Raises:
        SceneError: the library is another, or it is not installed.
    """
    if library == "numpy":
        return NumpyArrays()
    if library == "torch":
        return TorchArrays(device)
    raise SceneError(f"arrays must be 'numpy' or 'torch', got {library!r}")
