"""The touch sensors of LinkerHands: their kinds and sizes, the places of their taxels, and their sums.

The datasheet of the hands is :mod:`firmware_protocols.devices.linker_hand`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from firmware_protocols import Layout, grid_layout, quantize, stack

FINGERS = ("thumb", "index", "middle", "ring", "little")
FINGER_SPACING_M = 0.025
PALM_DISTANCE_M = 0.06
PITCH_M = 0.0015
COUNTS_PER_NEWTON = 500.0


class Touch(NamedTuple):
    """A kind of touch sensor."""

    number: int
    """The number in the answer to B0."""
    letter: str
    """The fifth field of the serial number."""
    finger: tuple[int, int]
    """The rows and columns of a finger."""
    palm: tuple[int, int] = (0, 0)
    finger_parts: tuple[int, ...] = ()
    """The rows of each part with a sum; two bytes request such a finger."""
    palm_parts: tuple[int, ...] = ()

    def part(self, part: int) -> tuple[tuple[int, int], tuple[int, ...]]:
        """Return rows and columns of a finger, or of the palm behind them, and the rows of its parts with a sum."""
        return (self.finger, self.finger_parts) if part < len(FINGERS) else (self.palm, self.palm_parts)


QUANTITIES = ("normal forces", "tangential forces", "directions", "approach")
SENSORS = {"quantities": Touch(1, "A", (12, 6)), "12x6": Touch(2, "B", (12, 6)), "10x4": Touch(4, "F", (10, 4))}
"""The sensors without a palm."""
PALM_SENSORS = {"12x6": Touch(2, "B1", (12, 6), (14, 15)), "10x4": Touch(4, "F1", (10, 4), (10, 10))}
"""The sensors with a palm, of other hands."""
TABLE_SENSORS = {
    "12x6": Touch(7, "B", (12, 6), (14, 16), (12,), (14,)),
    "23x9": Touch(5, "B", (23, 9), (28, 20), (11, 6, 6), (14, 14)),
}
"""The sensors with a palm, of the hands in the vendor's table."""


def sums(matrix: np.ndarray, rows: Sequence[int]) -> bytes:
    """Return the sums of successive parts of the matrix, by their numbers of rows, as u16 LE."""
    parts = np.split(matrix, np.cumsum(rows)[:-1])
    return b"".join(min(int(part.sum()), 0xFFFF).to_bytes(2, "little") for part in parts)


def four_quantities(force: np.ndarray) -> np.ndarray:
    """Return normal, tangential, direction, approach for ``force`` [N] of shape ``(5, 3)``; uint8 ``(4, 5)``."""
    turn = np.arctan2(force[:, 1], force[:, 0]) / (2 * np.pi) % 1.0
    normal = quantize(-force[:, 2], COUNTS_PER_NEWTON, 0, 255)
    tangential = quantize(np.hypot(force[:, 0], force[:, 1]), COUNTS_PER_NEWTON, 0, 255)
    direction = np.rint(turn * 256).astype(int) % 256
    return np.stack([normal, tangential, direction, np.zeros(5, int)]).astype(np.uint8)


def pads(finger: tuple[int, int], palm: tuple[int, int] = (0, 0)) -> Layout:
    """Return flat pads on links of their names, fingertips side by side along x, thumb first, tips to +y."""
    places = {name: (finger, ((i - 2) * FINGER_SPACING_M, 0.0, 0.0)) for i, name in enumerate(FINGERS)}
    if any(palm):
        places["palm"] = palm, (0.0, -PALM_DISTANCE_M, 0.0)
    return stack(*(grid_layout(*size, PITCH_M, name=f, origin=p, link=f) for f, (size, p) in places.items()))
