"""Functions of single numbers for kernels, written so that compilers turn them into few instructions."""

from typing import Any

import warp as wp


@wp.func
def is_nan(x: Any):
    """Return True for NaN.

    A comparison is used because Warp's own function is a call into the C library on a CPU, before which every number
    must leave its register. Do not use it in kernels with ``fast_math``, where it is always False.
    """
    return x != x


@wp.func
def is_finite(x: Any):
    """Return True for a number that is neither infinite nor NaN; see :func:`is_nan` for its limits."""
    return x - x == x - x


@wp.func_native("""
    __builtin_assume(i >= 0);
    return i;
""")
def natural(i: int) -> int:
    """Return ``i``, an index that is never negative, so that compilers leave out Warp's wrap-around of negative indices
    at every access."""
    ...
