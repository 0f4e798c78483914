"""Functions that set the rows of the environments being reset to their start values."""

# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp

from tactemu.base.kernels import warp_kernel


@functools.cache
def _fill_kernel(dtype):
    @warp_kernel
    def fill(mask: wp.array(dtype=wp.bool), value: dtype, state: wp.array2d(dtype=dtype)):
        e, c = wp.tid()
        if mask[e]:
            state[e, c] = value

    return fill


@functools.cache
def _restore_kernel(dtype):
    @warp_kernel
    def restore(mask: wp.array(dtype=wp.bool), start: wp.array2d(dtype=dtype), state: wp.array2d(dtype=dtype)):
        e, c = wp.tid()
        if mask[e]:
            state[e, c] = start[e, c]

    return restore


def restore_rows(array: wp.array, start: wp.array, mask: wp.array) -> None:
    """Set ``array[e, ...]`` to ``start[e, ...]`` where ``mask`` (bool, shape ``(n_envs,)``) is true; both arrays are
    contiguous.

    On a GPU the call does not wait for the device and can be captured in a graph.
    """
    if array.size == 0:
        return
    rows = [each.reshape((mask.shape[0], -1)) for each in (start, array)]
    kernel = _restore_kernel(array.dtype)
    wp.launch(kernel, dim=rows[1].shape, inputs=[mask, rows[0]], outputs=[rows[1]], device=array.device)


def clear_rows(array: wp.array, mask: wp.array, value: float = 0) -> None:
    """Set ``array[e, ...]`` to ``value`` where ``mask`` (bool, shape ``(n_envs,)``) is true. Takes scalars and vectors.

    On a GPU the call does not wait for the device and can be captured in a graph.
    """
    if array.size == 0:
        return
    assert array.device is not None
    if array.device.is_cpu:
        array.numpy()[np.asarray(mask.numpy(), bool)] = value
        return
    flat = array.reshape((array.shape[0], -1))
    inputs = [mask, array.dtype(value)]
    wp.launch(_fill_kernel(array.dtype), dim=flat.shape, inputs=inputs, outputs=[flat], device=array.device)
