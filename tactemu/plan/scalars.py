"""What kernels ask and say of a single number, in words that compilers turn into few instructions."""

# pyright: reportReturnType=false

from typing import Any

import warp as wp


@wp.func
def is_nan(x: Any):
    """Not a number? A comparison, where Warp's own question is a call into the C library on a CPU, before which every
    number must leave its register. Not for kernels with ``fast_math``, in which every number is one."""
    return x != x


@wp.func
def is_finite(x: Any):
    """Neither infinite nor not a number? As :func:`is_nan`."""
    return x - x == x - x


@wp.func_native("""
    __builtin_assume(i >= 0);
    return i;
""")
def natural(i: int) -> int:
    """``i``, an index that never counts from the end of an array: told so, compilers leave out what Warp adds to every
    access for those that do."""
    ...
