"""The declarations of what a device measures: quantities, senses, streams, and the meaning of its counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from firmware_protocols.layouts import Layout

Quantity = Literal[
    "force", "pressure", "depth", "displacement", "touch", "field", "resistance", "capacitance",
    "temperature", "acceleration", "angular_velocity", "wrench", "vibration", "load",
]  # fmt: skip
"""A quantity that transducers measure, at the n points of a layout.

Per taxel: ``force`` [N] (n, 3), ``pressure`` [Pa] (n,), ``depth`` [m] (n,), ``displacement`` [m] (n, 3), ``touch`` bool
(n,); where the scene has a transducer: ``field`` [T] (n, 3), ``resistance`` [Ohm] (n,), ``capacitance`` [F] (n,).
Around it: ``temperature`` [°C] (n,), ``acceleration`` [m/s²] (n, 3), proper, so that it points up when still,
``angular_velocity`` [rad/s] (n, 3). Of taxels together: ``wrench`` [N, Nm] (n, 6) about each
point, of those on its link, or of all if it names none; ``vibration`` [Pa] (n,), the pressure in a common medium.
``load`` [Nm, N] (n,) of each joint, in the order of :meth:`Device.joints`.
"""

QUANTITY_UNITS: Mapping[str, str] = {
    "force": "N", "pressure": "Pa", "depth": "m", "displacement": "m", "touch": "", "field": "T", "resistance": "Ohm",
    "capacitance": "F", "temperature": "°C", "acceleration": "m/s²", "angular_velocity": "rad/s", "wrench": "N, Nm",
    "vibration": "Pa", "load": "Nm",
}  # fmt: skip
"""The SI unit of each quantity; a wrench has two, and the load of a linear joint is in N."""

TOUCH = ("force", "pressure", "depth", "displacement", "touch")
"""The quantities that a sensor model computes for each taxel by itself."""
TRANSDUCED = ("field", "resistance", "capacitance")
"""The quantities that a transducer of the scene derives from them, for a device that reads them (option ``sees``)."""
CONTACT = (*TOUCH, *TRANSDUCED)
"""All quantities of single taxels that contact changes."""
VECTORS = ("force", "displacement", "field")
"""The quantities of three numbers."""
DERIVED = {"wrench": "force", "vibration": "force"}
"""The quantities of all taxels together, with the quantity that they follow from."""

Axis = Literal["", "x", "y", "z"]
AXES: tuple[Axis, Axis, Axis] = ("x", "y", "z")

Counts = np.ndarray | Mapping[str, np.ndarray]
"""The values that a perfect driver would decode, points in layout order; by sense where a stream converts several."""


@dataclass(frozen=True)
class Sense:
    """One quantity at the points of a layout; a quantity alone stands for ``Sense(quantity)`` at ``device.layout``."""

    quantity: Quantity
    at: Layout | None = None
    name: str = ""
    """The key in the reading and in the counts; default: the quantity."""
    burst: int = 1
    """The number of values per conversion, spread evenly over the time since the previous one, oldest first: a last
    axis of this length."""

    @property
    def key(self) -> str:
        """The sense's name in readings and counts."""
        return self.name or self.quantity


@dataclass(frozen=True)
class Stream:
    """Conversions of some of the senses at one rate."""

    rate_hz: float
    """The rate after power-up; 0: no conversion until the firmware sets a period or returns :class:`Convert`."""
    senses: tuple[str, ...] = ()
    """The keys of the senses; default: all."""


@dataclass(frozen=True, slots=True)
class Reading:
    """The values at the senses of one stream at one instant: ``reading["force"]``, SI, points in layout order."""

    values: Mapping[str, np.ndarray]
    stream: str = ""

    def __getitem__(self, key: str) -> np.ndarray:
        if key not in self.values:
            raise KeyError(f"stream {self.stream!r} converts {sorted(self.values)}, not {key!r}: add it to `senses`")
        return self.values[key]


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of the counts: one of the numbers that :meth:`Device.measure` returns for a point."""

    name: str
    axis: Axis = ""
    """The axis of the taxel's own frame; "" for a magnitude. Several columns may have one axis, but not one name."""
    unit: str = ""
    """The SI unit; "" where no scale is published."""
    counts_per_unit: float | None = None
    """The scale; ``None`` where it is not published, or the law is not linear."""
    assumed_per_unit: float | None = None
    """The scale of this model [1/SI unit] where none is published, and the law is linear here."""
    is_float: bool = False
    """True for a number that is sent as float32, in units of its own: limited, but not rounded."""
    low: float
    """The smallest possible count."""
    high: float
    """The largest possible count."""
    rest: float = 0
    """The count without contact, at 25 °C."""
    push: Literal[-1, 0, 1] = 0
    """The sign of the count's change under a push on its taxel; 0: it may stay the same."""
    sense: str = ""
    """The key of the counts, where a device has several senses."""
    shared: bool = False
    """True for one number for all points instead of one each."""

    def __post_init__(self):
        numbers = (self.counts_per_unit, self.assumed_per_unit, self.low, self.high, self.rest)
        if not all(number is None or math.isfinite(number) for number in numbers):
            raise ValueError(f"column {self.name!r}: scales, limits and rest must be finite numbers")

    @property
    def scale(self) -> float | None:
        """The counts per SI unit in this model, published or not; ``None`` where the law is not linear."""
        return self.assumed_per_unit if self.counts_per_unit is None else self.counts_per_unit


def xyz(names: str, *, push: Literal[-1, 0, 1] = 0, **each: Any) -> tuple[Column, Column, Column]:
    """Return the columns of the three axes, with names such as ``"Fx Fy Fz"``.

    Args:
        names: their names, with spaces between them.
        push: that of the z axis.
        each: further fields of :class:`Column`, one value for all or one for each axis.
    """
    listed = [value.tolist() if isinstance(value, np.ndarray) else value for value in each.values()]
    own = [[value[k] if isinstance(value, list | tuple) else value for value in listed] for k in range(3)]
    x, y, z = (
        Column(name=name, axis=axis, push=push if axis == "z" else 0, **dict(zip(each, values)))
        for name, axis, values in zip(names.split(), AXES, own)
    )
    return x, y, z


def wrench(names: str, *, per_unit: tuple[float, float], **each: Any) -> tuple[Column, ...]:
    """Return the columns of a force [N] and a torque [Nm], with names such as ``"Fx Fy Fz Tx Ty Tz"``.

    Args:
        names: their names, with spaces between them.
        per_unit: the counts per newton, and per newton metre.
        each: further fields of :class:`Column`, one value for all or one for each of the six.
    """
    halves = [
        {name: value if np.ndim(value) == 0 else value[k : k + 3] for name, value in each.items()} for k in (0, 3)
    ]
    words = names.split()
    return (
        *xyz(" ".join(words[:3]), unit="N", counts_per_unit=per_unit[0], **halves[0]),
        *xyz(" ".join(words[3:]), unit="Nm", counts_per_unit=per_unit[1], **halves[1]),
    )


@dataclass(frozen=True, kw_only=True)
class Rollover:
    """A counter or clock on the wire that starts again at 0 when it is full."""

    name: str
    bits: int
    step: int = 1
    """The increment per frame; of a clock: per second."""
    clock: bool = False
    """True if it counts time, not frames."""
    state: str = ""
    """The attribute of its value (of a clock: of the offset to the time), which :meth:`Device.preset` sets."""


def quantity_error(sense: Sense) -> str:
    """Return what is wrong with the quantity of a sense, or ``""``."""
    known = get_args(Quantity)
    return "" if sense.quantity in known else f"senses: {sense.quantity!r}: expected one of {', '.join(known)}"
