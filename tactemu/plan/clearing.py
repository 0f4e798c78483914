"""Zeroing the rows of the environments that are reset."""

# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportAssignmentType=false, reportOperatorIssue=false, reportGeneralTypeIssues=false

import functools

import numpy as np
import warp as wp


@functools.cache
def _clear_kernel(dtype):
    @wp.kernel(module="unique", enable_backward=False)
    def clear(mask: wp.array(dtype=wp.bool), state: wp.array2d(dtype=dtype)):
        e, c = wp.tid()
        if mask[e]:
            state[e, c] = dtype(0)

    return clear


def clear_rows(array: wp.array, mask: wp.array) -> None:
    """Set ``array[e, ...]`` to 0 where ``mask`` (bool, shape ``(n_envs,)``) is true. Scalars of any type."""
    if array.size == 0:
        return
    assert array.device is not None
    if array.device.is_cpu:
        array.numpy()[np.asarray(mask.numpy(), bool)] = 0
        return
    flat = array.reshape((array.shape[0], -1))
    wp.launch(_clear_kernel(array.dtype), dim=flat.shape, inputs=[mask], outputs=[flat], device=array.device)
