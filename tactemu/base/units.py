"""Units and bounds of the numbers that users write.

Each table of units maps a unit, as in ``16ms`` or ``1.5mm``, to its SI value. A number outside its bounds is a slip,
such as millimetres given as metres, or would overflow during a run; no skin needs it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated

from firmware_protocols.bounds import Bounds

TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
DURATIONS_S = {**TIMES_S, "m": 60.0, "min": 60.0, "h": 3600.0}
"""Units of durations in options, live commands and faults, where no length can be meant."""
RATES_HZ = {"Hz": 1.0, "kHz": 1e3}
LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
SPEEDS_M_S = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3}
DEFAULT_STEP_S = 1e-3
"""The step of the simulation, unless a scene gives another."""
LENGTH_UNIT = "m (6 mm is 0.006)"
"""The unit of a length, as messages give it."""
MAX_TIME_S = 1e6
"""The longest time that you may give: eleven days."""
MAX_POSITION_M = 100.0
"""The largest coordinate of a body, from the world's origin."""
MAX_TRAVEL_M = 10.0
"""The longest distance that a motion moves a body."""
MAX_DEPTH_M = 0.5
"""The largest depth that a body is pressed in."""
MAX_ANGLE_RAD = 1e9
"""The largest angle that a motion turns a body by."""
MAX_SIZE_M = 3.0
"""An upper bound of a body's dimensions, excluded."""

# A type of a number is its quantity, and the range that no skin exceeds. `number` and `check_declared` read it from
# annotations, and so does pydantic.

Seconds = Annotated[float, Bounds(unit="s", low=0, high=MAX_TIME_S)]
"""A time from the start of a run, or a duration: at most eleven days."""
StepSeconds = Annotated[float, Bounds(unit="s", low=1e-7, high=10)]
"""The step of the simulation; times are whole nanoseconds."""
TimeConstant = Annotated[float, Bounds(unit="s", above=0)]
"""The time in which something decays."""
Hertz = Annotated[float, Bounds(unit="Hz", low=1e-3, high=1e6)]
"""A sampling rate."""
Metres = Annotated[float, Bounds(unit="m")]
"""A signed length."""
Length = Annotated[float, Bounds(unit="m", above=0)]
"""A length > 0. In ``radius: Annotated[Length, "of the ring [m]"]`` the text is the key's description."""
Size = Annotated[float, Bounds(unit=LENGTH_UNIT, low=1e-6, below=MAX_SIZE_M)]
"""A dimension of a body in a scene file; most that are larger are meant in millimetres."""
Radius = Annotated[float, Bounds(unit=LENGTH_UNIT, low=1e-6, below=1)]
"""The radius of a body in a scene file: a ball of 1 m radius is two metres wide."""
Coordinate = Annotated[float, Bounds(unit=LENGTH_UNIT, low=-MAX_POSITION_M, high=MAX_POSITION_M)]
"""A coordinate of a body, from the world's origin."""
Distance = Annotated[float, Bounds(unit=LENGTH_UNIT, low=0, high=MAX_TRAVEL_M)]
"""A distance that a motion moves a body by."""
Depth = Annotated[float, Bounds(unit=LENGTH_UNIT, low=-MAX_DEPTH_M, high=MAX_DEPTH_M)]
"""A depth that a body is pressed in by; negative: its distance from the skin."""
DepthAfterTravel = Annotated[float, Bounds(unit=LENGTH_UNIT, low=-MAX_TRAVEL_M, high=MAX_DEPTH_M)]
"""A depth beyond the end of a free travel; negative: the body stops before it."""
MetresPerSecond = Annotated[float, Bounds(unit="m/s", low=1e-9, high=1e3)]
"""The speed of a motion."""
RadiansPerSecond = Annotated[float, Bounds(unit="rad/s", low=-1e4, high=1e4)]
"""The rate of a turn; its sign is the sense of rotation."""
Radians = Annotated[float, Bounds(unit="rad", low=0, high=MAX_ANGLE_RAD)]
"""An angle that a motion turns a body by."""
Newtons = Annotated[float, Bounds(unit="N", above=0)]
"""A force > 0."""
Pascals = Annotated[float, Bounds(unit="Pa", above=0)]
"""A stiffness of a material, or a pressure > 0."""
Celsius = Annotated[float, Bounds(unit="degree C", low=-273.15, high=1000)]
"""A temperature."""
PerKelvin = Annotated[float, Bounds(unit="1/K", low=-1, high=1)]
"""A relative change with temperature."""
Number = Annotated[float, Bounds()]
"""A number in a unit of its own."""
Whole = Annotated[int, Bounds(low=-math.inf, high=math.inf)]
"""A whole number."""
Positive = Annotated[float, Bounds(above=0)]
"""A number > 0, in a unit of its own."""
NonNegative = Annotated[float, Bounds(low=0)]
"""A number >= 0, in a unit of its own."""
Share = Annotated[float, Bounds(low=0, high=1)]
"""A part of a whole, or a probability."""
SignedShare = Annotated[float, Bounds(low=-1, high=1)]
"""A relative change."""
Repeats = Annotated[int, Bounds(low=0, high=1e9)]
"""The number of times that a motion is made."""
MAX_TAXELS = 1_000_000
"""Largest number of taxels, and largest taxel number, that a command takes; bounds the memory that a request takes."""
Taxel = Annotated[int, Bounds(low=0, high=MAX_TAXELS)]
"""The number of a taxel."""

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)([A-Za-z/%]*)", re.ASCII)


def scaled(text: str, units: Mapping[str, float]) -> float | None:
    """Return the number of a text times the value of its unit; ``None`` if it is no number with one of these units."""
    match = _NUMBER.fullmatch(text) if len(text) < 100 else None
    return float(match[1]) * units[match[2]] if match and match[2] in units else None
