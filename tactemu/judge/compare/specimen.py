"""The numbers of one specimen: rest, noise and clock, and the table of them that ``--measured`` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from firmware_protocols import Column, Device
from firmware_protocols.senses import QUANTITY_UNITS
from tactemu.judge.compare.presses import Course

MIN_VALUES = 20
"""Least number of values for the noise of a channel."""


@dataclass(frozen=True, slots=True)
class ChannelNumbers:
    """The numbers of one channel of the counts."""

    name: str
    rest: float
    """The median [counts]."""
    noise: float
    """The standard deviation without drift and touches [counts]."""
    low: float
    high: float
    values: int
    """The number of values."""


@dataclass
class Specimen:
    """The numbers of one specimen."""

    channels: list[ChannelNumbers] = field(default_factory=list)
    clock_ppm: dict[str, float] = field(default_factory=dict)
    """The error of its clock by class of frames [ppm]; positive: it is slow."""
    peaks: dict[int, float] = field(default_factory=dict)
    """The response to each press, by taxel [counts]; the force of the presses is unknown."""

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers as JSON data."""
        return {
            "channels": [asdict(each) for each in self.channels],
            "clock_ppm": self.clock_ppm,
            "press_peaks": {str(taxel): peak for taxel, peak in self.peaks.items()},
        }


def measure(courses: Mapping[int, Sequence[Course]], names: Sequence[str]) -> list[ChannelNumbers]:
    """Return the numbers of each channel, given its courses."""
    found = []
    for channel, of in sorted(courses.items()):
        course = max(of, key=lambda each: len(each.values))
        values = course.values[np.isfinite(course.values)]
        if len(values) < MIN_VALUES:
            continue
        name = names[channel] if channel < len(names) else str(channel)
        found.append(
            ChannelNumbers(name, float(np.median(values)), noise_of(values), float(values.min()), float(values.max()),
                           len(values))
        )  # fmt: skip
    return found


def noise_of(values: np.ndarray) -> float:
    """Return the standard deviation about a straight line, without the values beyond six of it: touches."""
    k = np.arange(len(values)) - (len(values) - 1) / 2
    calm = np.abs(values - np.median(values)) <= 6 * 1.4826 * np.median(np.abs(values - np.median(values)))
    if not calm.sum() > 2 or calm.all() or calm.sum() < len(values) / 2:
        calm = np.ones(len(values), bool)
    slope, offset = np.polyfit(k[calm], values[calm], 1)
    return float(np.std(values[calm] - slope * k[calm] - offset))


def measured_table(device: Device, specimen: Specimen, source: str) -> str:
    """Return the numbers as a TOML file that `tactemu run --measured` reads: keys of a scene's skin."""
    lines = [
        f"# One {device.title}, by `tactemu compare`: {source}.",
        "# Rest and gain are not here: no known force was on it. report.json has the rest of each channel in counts.",
    ]
    if specimen.clock_ppm:
        ppm = float(np.median(list(specimen.clock_ppm.values())))
        lines.append(f"clock = {{ skew_ppm = {ppm:.0f} }}")
    noise = _noise_in_units(device, specimen)
    if noise is not None:
        lines += ["", "[options]", f"noise = {noise[0]:.3g}  # [{noise[1]}], median over the channels"]
    elif specimen.channels:
        median = float(np.median([each.noise for each in specimen.channels]))
        lines.append(f"# noise: {median:.3g} counts, median over the channels; the model states no scale in SI units")
    return "\n".join(lines) + "\n"


def _noise_in_units(device: Device, specimen: Specimen) -> tuple[float, str] | None:
    """Return the median noise of the channels whose column has a scale in the unit of the scene, and the unit."""
    unit = QUANTITY_UNITS[device.contact[0]]
    scales = {c.name: c.counts_per_unit for c in device.columns if c.unit == unit and c.counts_per_unit}
    single = next(iter(scales.values())) if len(scales) == 1 == len(_of_touch(device)) else None
    values = []
    for each in specimen.channels:
        last = each.name.rpartition(" ")[2]
        scale = scales.get(last) or (single if each.name.startswith("taxel") else None)
        if scale:
            values.append(each.noise / abs(scale))
    return (float(np.median(values)), unit) if values and np.median(values) > 0 else None


def _of_touch(device: Device) -> list[Column]:
    return [column for column in device.columns if column.sense in ("", *device.contact)]
