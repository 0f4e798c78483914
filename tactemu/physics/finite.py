"""Is a number finite? A comparison, where Warp's own question is a call into the C library on a CPU, before which every
number must leave its register. Not for kernels with ``fast_math``, in which every number is."""

# pyright: reportReturnType=false

from typing import Any

import warp as wp


@wp.func
def is_nan(x: Any):
    """Not a number?"""
    return x != x


@wp.func
def is_finite(x: Any):
    """Neither infinite nor not a number?"""
    return x - x == x - x
