"""The converter that follows from a device's columns: scale, limits and rest stand there, and nowhere else.

The value of a column is the component of its axis in the taxel's own frame, and of a column without axis the push along
the normal or the quantity itself. Where ``push`` is the opposite of the value's own sign under a push, it is negated:
a force along z falls under a push, and a column ``z`` with ``push=1`` counts ``-z``. The columns of a wrench are Fx,
Fy, Fz, Tx, Ty, Tz in this order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_protocols.adc import quantize
from firmware_protocols.senses import CONTACT, VECTORS, Column, Sense

AMBIENT = {"temperature": 25.0}
"""The value of a quantity at which a column has its count of rest, where that is not 0."""
_AXES = {"x": 0, "y": 1, "z": 2}
_KNOWN: dict[int, tuple[Sequence[Column], dict[str, Conversion]]] = {}
"""The conversions by the identity of the columns, which they keep alive; all are made anew when there are many."""
_MAX_KNOWN = 512


@dataclass(frozen=True)
class Conversion:
    """The conversion of one sense: what its columns declare, as arrays."""

    scale: np.ndarray
    low: np.ndarray
    high: np.ndarray
    rest: np.ndarray
    """The count at the value 0."""
    signs: np.ndarray
    """-1 for columns that count the negated value."""
    components: list[int]
    """The index of each column's component in a vector; -1: the push."""
    is_float: bool

    def values(self, sense: Sense, measured: np.ndarray) -> np.ndarray:
        """Return the values of the columns [SI], shape ``(n,)`` for one column, else ``(n, n_columns)``."""
        assert sense.at is not None
        if sense.quantity in VECTORS:
            if self.components == [-1]:
                return sense.at.push(measured) * self.signs[0]
            vectors = sense.at.to_taxel_frame(measured)
            measured = np.concatenate([vectors, -vectors[:, 2:]], axis=1)[:, self.components]
        elif measured.ndim > 1 and sense.burst == 1:
            measured = measured[:, self.components]
        if len(self.components) == 1:
            measured = measured[:, 0] if measured.ndim > 1 and sense.burst == 1 else measured
            return measured * self.signs[0] if self.signs[0] < 0 else measured
        return measured * self.signs

    def counts(self, values: np.ndarray) -> np.ndarray:
        """Return the counts of values, limited, and rounded unless they are floats."""
        one = len(self.components) == 1
        scale, low, high, rest = (each[0] if one else each for each in (self.scale, self.low, self.high, self.rest))
        if self.is_float:
            return np.clip(values * scale + rest, low, high).astype(np.float32)
        return quantize(values, scale, low, high, rest)


def conversion(columns: Sequence[Column], sense: Sense, is_first: bool) -> Conversion | None:
    """Return the conversion of a sense by its columns; ``None`` if it has none.

    Raises:
        TypeError: a column has no scale.
    """
    kept, made = _KNOWN.get(id(columns), (None, {}))
    if kept is not columns:
        if len(_KNOWN) >= _MAX_KNOWN:
            _KNOWN.clear()
        kept, made = _KNOWN[id(columns)] = columns, {}
    if sense.key not in made:
        keys = (sense.key, "") if is_first else (sense.key,)
        own = [each for each in columns if each.sense in keys and not each.shared]
        if not own:
            return None
        made[sense.key] = _made(own, sense)
    return made[sense.key]


def _made(columns: Sequence[Column], sense: Sense) -> Conversion:
    for column in columns:
        if column.scale is None:
            raise TypeError(
                f"column {column.name!r} has no scale: give counts_per_unit, or assumed_per_unit where none is "
                "published, or write measure()"
            )
    scale = np.array([column.scale for column in columns], float)
    rest = np.array([column.rest for column in columns], float)
    return Conversion(
        scale=scale,
        low=np.array([column.low for column in columns]),
        high=np.array([column.high for column in columns]),
        rest=rest - scale * AMBIENT.get(sense.quantity, 0.0),
        signs=np.array([_sign(column, sense) for column in columns]),
        components=_components(columns, sense),
        is_float=any(column.is_float for column in columns),
    )


def _components(columns: Sequence[Column], sense: Sense) -> list[int]:
    if sense.quantity == "wrench":
        return list(range(len(columns)))
    return [_AXES.get(column.axis, 3 if len(columns) > 1 and sense.quantity in VECTORS else -1) for column in columns]


def _sign(column: Column, sense: Sense) -> int:
    if sense.quantity not in (*CONTACT, "wrench") or not column.push:
        return 1
    falls = column.axis == "z" and sense.quantity in (*VECTORS, "wrench")
    return -column.push if falls else column.push
