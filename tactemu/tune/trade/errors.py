"""Observations of a contact in one form for all models, and their errors relative to the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np


@dataclass
class Observation:
    """One reading with taxels flat; quantities that a model lacks are None. Forces act on the skin."""

    pressure: np.ndarray | None = None
    """Pressure on each taxel [any unit], shape ``(n,)``."""
    drag: np.ndarray | None = None
    """Total tangential force, shape ``(2,)``."""
    touch: np.ndarray | None = None
    """The taxels in contact, bool, shape ``(n,)``."""
    sink: np.ndarray | None = None
    """Motion of the surface into the skin, shape ``(n,)``; NaN where a truth does not know it."""
    shift: np.ndarray | None = None
    """Motion along the skin, shape ``(n, 2)``; likewise."""

    def scaled(self, gains: dict[str, float]) -> Observation:
        """Return the observation with each quantity multiplied by its gain."""
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        return Observation(**{
            name: value * gains[name] if value is not None and name in gains else value
            for name, value in parts.items()
        })  # fmt: skip


def joined(observations: Sequence[Observation]) -> Observation:
    """Return several observations, such as those of one case at all its offsets, as one."""
    parts = {field.name: [getattr(each, field.name) for each in observations] for field in fields(Observation)}
    return Observation(**{
        name: None if any(value is None for value in values) else np.concatenate(values)
        for name, values in parts.items()
    })  # fmt: skip


def together(found: Sequence[dict[str, float | None]]) -> dict[str, dict[str, float]]:
    """Return the errors of one case at all its offsets as their RMS and range, for each metric that has values."""
    summed = {}
    for metric in found[0]:
        values = [value for each in found if (value := each.get(metric)) is not None]
        if values:
            rms = float(np.sqrt(np.mean(np.square(values))))
            summed[metric] = {"rms": rms, "low": min(values), "high": max(values)}
    return summed


def observe(reading: Any, area: float, threshold: float = 0.0) -> Observation:
    """Return the observation of a reading, by its fields, in a frame whose normal is z.

    Args:
        reading: the result of ``read()`` of any model.
        area: the area of a taxel [m²].
        threshold: depth or displacement above which a taxel counts as in contact [m].
    """
    if hasattr(reading, "residual"):
        force, moved = reading.force.reshape(-1, 3), reading.displacement.reshape(-1, 3)
        pressure = reading.pressure.reshape(-1)
        return Observation(pressure, force[:, :2].sum(0), pressure > 0, -moved[:, 2], moved[:, :2])
    if hasattr(reading, "torque"):
        force = reading.force.reshape(-1, 3)
        in_contact = force[:, 2] < 0
        return Observation(-force[:, 2] / area, force[:, :2].sum(0), in_contact)
    values = np.asarray(reading)
    if values.dtype == bool:
        return Observation(touch=values.reshape(-1))
    if values.shape[-1:] == (3,) and values.ndim > 2:
        moved = values.reshape(-1, 3)
        return Observation(sink=-moved[:, 2], shift=moved[:, :2])
    depth = values.reshape(-1)
    return Observation(touch=depth > threshold, sink=depth)


def _known(got: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both without the values that the truth does not know."""
    known = np.isfinite(truth)
    return got[known], truth[known]


def _relative(got: np.ndarray, truth: np.ndarray) -> float | None:
    got, truth = _known(got, truth)
    size = float(np.linalg.norm(truth))
    return float(np.linalg.norm(got - truth)) / size if size > 0 else None


def fit_gains(got: Observation, truth: Observation, names: tuple[str, ...]) -> dict[str, float]:
    """Return the gain of each quantity that fits the truth best; pressures are fitted to the total force."""
    gains = {}
    for name in names:
        value, wanted = getattr(got, name), getattr(truth, name)
        if value is None or wanted is None:
            continue
        value, wanted = _known(value, wanted)
        if name == "pressure":
            gains[name] = float(wanted.sum() / value.sum()) if value.sum() else 1.0
        elif np.vdot(value, value):
            gains[name] = float(np.vdot(value, wanted) / np.vdot(value, value))
    return gains


def errors(got: Observation, truth: Observation, positions: np.ndarray, area: float, friction: float) -> dict:
    """Return each metric that the model offers, None if the truth has no value to compare with.

    ::

        normal force        total normal force, relative
        tangential force    total tangential force, relative to friction times the normal force
        pressure            pressure, RMSE over the taxels relative to the truth's RMS
        contact area        number of taxels of which any part touches, relative
        overlap of areas    1 - intersection over union of the taxels in contact
        centre              centre of pressure [mm]
        normal motion       motion of the surface along the normal, RMSE relative to the truth's RMS
        tangential motion   motion of the surface along the skin, likewise

    Args:
        got: the calibrated observation of the model.
        truth: the truth of the same contact.
        positions: taxels in the skin's plane [m], ``(n, 2)``.
        area: the area of a taxel [m²].
        friction: the friction coefficient of the truth.
    """
    # a truth has every quantity
    assert truth.pressure is not None and truth.drag is not None and truth.touch is not None
    assert truth.sink is not None and truth.shift is not None
    found: dict[str, float | None] = {}
    truth_total = float(truth.pressure.sum())
    if got.pressure is not None:
        total = float(got.pressure.sum())
        found["normal force"] = total / truth_total - 1
        found["pressure"] = _relative(got.pressure, truth.pressure)
        if total > 0:
            centre = got.pressure @ positions / total - truth.pressure @ positions / truth_total
            found["centre"] = float(np.linalg.norm(centre)) * 1e3
    if got.drag is not None:
        found["tangential force"] = float(np.linalg.norm(got.drag - truth.drag)) / (friction * truth_total * area)
    if got.touch is not None and truth.touch.any():
        both, either = (got.touch & truth.touch).sum(), (got.touch | truth.touch).sum()
        found["contact area"] = float(got.touch.sum() / truth.touch.sum()) - 1
        found["overlap of areas"] = 1 - float(both / either)
    if got.sink is not None:
        found["normal motion"] = _relative(got.sink, truth.sink)
    if got.shift is not None:
        found["tangential motion"] = _relative(got.shift, truth.shift)
    return found
