"""Units and bounds of the numbers that users write.

Each table of units maps a unit, as in ``16ms`` or ``1.5mm``, to its SI value. A number outside its bounds is a slip,
such as millimetres given as metres, or would overflow during a run; no skin needs it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
SPEEDS_M_S = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3}
MAX_TIME_S = 1e6
"""The longest time that you may give: eleven days."""
DEFAULT_STEP_S = 1e-3
"""The step of the simulation, unless a scene gives another."""
STEP_RANGE_S = (1e-7, 10.0)
"""The shortest and the longest step of the simulation."""
RATE_RANGE_HZ = (1e-3, 1e6)
"""The lowest and the highest sampling rate."""
SPEED_RANGE_M_S = (1e-9, 1e3)
"""The lowest and the highest speed of a motion."""
MAX_TRAVEL_M = 10.0
"""The longest distance that a motion moves a body."""
MAX_ANGLE_RAD = 1e9
"""The largest angle that a motion turns a body by."""
MAX_DEPTH_M = 0.5
"""The largest depth that a body is pressed in."""
MAX_POSITION_M = 100.0
"""The largest coordinate of a body, from the world's origin."""
SIZE_RANGE_M = (1e-6, 3.0)
"""The smallest and the largest dimension of a body."""
MAX_RADIUS_M = 1.0
"""An upper bound of a body's radius, excluded: a ball of 1 m radius is two metres wide."""
LENGTH_UNIT = "m (6 mm is 0.006)"
"""The unit of a length, as messages give it."""

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)([a-z/%]*)", re.ASCII)


def scaled(text: str, units: Mapping[str, float]) -> float | None:
    """Return the number of a text times the value of its unit; ``None`` if it is no number with one of these units."""
    match = _NUMBER.fullmatch(text) if len(text) < 100 else None
    return float(match[1]) * units[match[2]] if match and match[2] in units else None
