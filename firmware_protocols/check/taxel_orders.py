"""The orders of taxels on the wire: their names in words, and devices whose order is changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from firmware_protocols.device import Device
from firmware_protocols.layouts import Layout, Patch

ORDERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "row by row": lambda grid: grid,
    "row by row from the right": lambda grid: grid[:, ::-1],
    "row by row from the bottom": lambda grid: grid[::-1],
    "row by row from the bottom right": lambda grid: grid[::-1, ::-1],
    "column by column": lambda grid: grid.T,
    "column by column from the bottom": lambda grid: grid[::-1].T,
    "column by column from the right": lambda grid: grid[:, ::-1].T,
    "there and back": lambda grid: np.array([row[:: 1 - 2 * (k % 2)] for k, row in enumerate(grid)]),
    "last patch first": lambda grid: grid,
}
"""The orders in which the taxels of a patch can be sent, by their names in words."""


def wire_order_of(layout: Layout, name: str) -> np.ndarray:
    """Return ``wire_order`` for taxels sent in the order of this name, patch by patch."""
    patches = sorted(layout.patches, key=lambda patch: patch.start)
    runs = [patch_order(patch, name) for patch in patches]
    return np.concatenate(runs[::-1] if name == "last patch first" else runs)


def patch_order(patch: Patch, name: str) -> np.ndarray:
    """Return the taxels of a patch in the order of this name; those of a free patch form one row."""
    return ORDERS[name](np.arange(patch.start, patch.start + len(patch)).reshape(max(patch.rows, 1), -1)).ravel()


def matching_names(layout: Layout, found: np.ndarray) -> list[str]:
    """Return the names of the orders that equal ``found``."""
    return [name for name in ORDERS if np.array_equal(wire_order_of(layout, name), found)]


def names_in(text: str) -> list[str]:
    """Return the names of orders in a text; of names that contain each other the longer one."""
    found = [name for name in ORDERS if name in text]
    return [name for name in found if not any(name != other and name in other for other in found)]


@contextmanager
def reordered(cls: type[Device], new_order: Callable[[Layout], np.ndarray]) -> Iterator[Callable[[], bool]]:
    """Give devices of the class another ``wire_order``; yield a function that returns True if one has changed."""
    changed: list[np.ndarray] = []

    def put(device: Device, layout: Layout) -> None:
        other = new_order(layout)
        if not np.array_equal(other, layout.wire_order) and not any(np.array_equal(other, each) for each in changed):
            changed.append(other)
        vars(device)["layout"] = replace(layout, wire_order=other)

    cls.layout = property(lambda device: vars(device)["layout"], put)  # type: ignore[assignment]
    try:
        yield lambda: bool(changed)
    finally:
        del cls.layout
