"""The types of arrays in the annotations of public functions, complete for type checkers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import warp as wp
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    WarpArray: TypeAlias = wp.array[Any, Any]
else:
    WarpArray = wp.array
"""A Warp array of any type of number and any number of axes."""


class DlpackArray(Protocol):
    """An array of another library, such as torch or JAX."""

    @property
    def __dlpack__(self) -> Callable[..., Any]:
        """The function that exports it."""
        ...


DeviceNumbers: TypeAlias = NDArray[Any] | WarpArray | DlpackArray
"""An array that a user gives: of NumPy, Warp or another library."""
Numbers: TypeAlias = ArrayLike | DeviceNumbers
"""Numbers that a user gives: a list or an array."""
