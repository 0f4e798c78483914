"""Arrays of other libraries on the simulation's device: used in place, strided or not, and checked."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import warp as wp

from tactemu.base.errors import SceneError

MASK_TYPES = (wp.bool, wp.uint8, wp.int8)
"""Number types that a mask may have."""


def as_warp_array(value: Any, what: str) -> wp.array:
    """Return a Warp array over the memory of ``value``: a Warp or NumPy array, or anything with ``__dlpack__``.

    Raises:
        SceneError: ``value`` is none of them, or has no memory (any more).
    """
    if isinstance(value, wp.array):
        array = value
    elif isinstance(value, np.ndarray):
        array = _over_numpy(value, what)
    elif hasattr(value, "__dlpack__"):
        try:
            array = cast(wp.array, wp.from_dlpack(value))
        except Exception as error:
            raise SceneError(f"{what}: Warp cannot read what its __dlpack__ returns ({error})") from error
    else:
        raise SceneError(f"{what}: expected a Warp or NumPy array, or one with __dlpack__, got {type(value).__name__}")
    if array.size and not array.ptr:
        raise SceneError(f"{what}: the array has no memory; it was freed or never allocated")
    return array


def _over_numpy(value: np.ndarray, what: str) -> wp.array:
    try:
        dtype = wp.dtype_from_numpy(value.dtype)
    except (TypeError, KeyError) as error:
        raise SceneError(f"{what}: numbers of type {value.dtype} cannot be read") from error
    array = wp.array(ptr=value.ctypes.data, shape=value.shape, strides=value.strides, dtype=dtype, device="cpu")
    array._ref = value  # so that the memory is not freed
    return array


def scalar_view(array: wp.array) -> wp.array:
    """Return a view of an array of vectors, quaternions or transforms as numbers, with one more axis for each axis of
    the type.
    """
    dtype = array.dtype
    if not hasattr(dtype, "_wp_scalar_type_"):
        return array
    scalar = dtype._wp_scalar_type_
    size = wp.types.type_size_in_bytes(scalar)
    lengths = dtype._shape_
    inner = [size]
    for length in reversed(lengths[1:]):
        inner.insert(0, inner[0] * length)
    return view(array, (*array.shape, *lengths), (*array.strides, *inner), scalar)


def view(array: wp.array, shape, strides, dtype, offset: int = 0) -> wp.array:
    """Return another view of the memory of an array, from ``offset`` bytes on."""
    ptr = array.ptr + offset if array.ptr else array.ptr
    seen = wp.array(ptr=ptr, shape=tuple(shape), strides=tuple(strides), dtype=dtype, device=array.device)
    seen._ref = array  # so that the memory is not freed
    return seen


def check_device(array: wp.array, device: wp.Device, what: str) -> None:
    """Raise :class:`SceneError` if an array is not on the device."""
    if array.device != device:
        raise SceneError(f"{what}: the array is on {array.device}, the simulation on {device}; move it there first")


def environment_mask(value: Any, n_envs: int, device: wp.Device) -> wp.array:
    """Return a mask of environments on the device, as ``wp.bool``.

    Raises:
        SceneError: the mask has another type, length or device.
    """
    what = "envs"
    array = as_warp_array(value, what)
    check_device(array, device, what)
    if array.dtype not in MASK_TYPES:
        raise SceneError(
            f"envs: an array on the device must be a mask (bool or uint8) of {n_envs} environments, got "
            f"{array.dtype.__name__}; give indices from the host, as a list or a NumPy array"
        )
    if array.shape != (n_envs,):
        raise SceneError(f"envs: a mask must have shape ({n_envs},), one entry for each environment, got {array.shape}")
    return view(array, array.shape, array.strides, wp.bool)
