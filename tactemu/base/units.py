"""The units of numbers that users write, such as ``16ms``, ``1.5mm``: each table maps a unit to its SI value."""

from __future__ import annotations

import re
from collections.abc import Mapping

TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
SPEEDS_M_S = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3}
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)([a-z/%]*)", re.ASCII)


def scaled(text: str, units: Mapping[str, float]) -> float | None:
    """Return the number of a text times the value of its unit; ``None`` if it is no number with one of these units."""
    match = _NUMBER.fullmatch(text) if len(text) < 100 else None
    return float(match[1]) * units[match[2]] if match and match[2] in units else None
