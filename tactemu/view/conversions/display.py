"""The sizes and lines of text by which viewers show the entries of a log."""

from __future__ import annotations

import math

import numpy as np

from tactemu.base.frame_text import text
from tactemu.scene.description import PartDescription
from tactemu.truth.entries import BodyPose, Entry, Injection, Passage, PortEvent, Sample

_PREFIXED = frozenset({"N", "Nm", "Pa", "m", "T", "F", "Ohm", "V", "A"})
"""The SI units that take a prefix."""
_PREFIXES = {-4: "p", -3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M", 3: "G"}
_WRITTEN = {"degC": "°C", "uT": "µT", "m/s^2": "m/s²", "Ohm": "Ω", "um": "µm"}
"""The signs for the units that devices declare in ASCII."""


def in_contact(sample: Sample) -> np.ndarray:
    """Return which taxels are in contact: those whose ideal reading is not 0, shape ``(n,)``."""
    ideal = np.asarray(sample.ideal, float).reshape(len(sample.ideal), -1)
    return (ideal != 0).any(axis=1)


def pitch(part: PartDescription) -> float:
    """Return the distance of a taxel to its nearest neighbour [m], the median of the first 256; alone: 3 mm."""
    positions = part.positions[:256]
    if len(positions) < 2:
        return 3e-3
    gaps = np.linalg.norm(positions[:, None] - positions, axis=-1)
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1))) or 3e-3


def log_text(entry: Entry) -> str:
    """Return the line of a log panel for a frame, a fault or an event."""
    assert not isinstance(entry, Sample | BodyPose)
    if isinstance(entry, PortEvent):
        return entry.what
    if isinstance(entry, Passage):
        words = [entry.kind, text(entry.frame)]
        words += [] if entry.sample is None else [f"sample {entry.sample}"]
        return "  ".join([*words, *([entry.why] if entry.why else [])])
    became = f"{entry.before} -> {', '.join(entry.after) or 'nothing'}" if entry.before or entry.after else ""
    return "  ".join(filter(None, (f"inject {entry.what}", entry.detail, became)))


def is_warning(entry: Entry) -> bool:
    """Return True for a fault, and for a frame that was never sent."""
    return isinstance(entry, Injection) or (isinstance(entry, Passage) and entry.kind == "drop")


def written(unit: str) -> str:
    """Return the sign of a unit as people write it: ``µT`` for ``uT``."""
    return _WRITTEN.get(unit, unit)


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return a factor and a unit in which the largest value lies between about 1 and 1000, such as ``(1e3, "mN")``."""
    if unit not in _PREFIXED or not math.isfinite(largest) or largest <= 0:
        return 1.0, written(unit)
    power = min(max(math.floor(math.log10(1.05 * largest) / 3), min(_PREFIXES)), max(_PREFIXES))
    return 10.0 ** (-3 * power), _PREFIXES[power] + written(unit)
