"""The laws that a sensor has switched on, and the checks of its options."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from firmware_protocols.bounds import Bounds
from tactemu.base.errors import SceneError
from tactemu.base.options import numbers
from tactemu.imperfections.info import ReadingInfo
from tactemu.imperfections.options import ChainOptions

_TYPES = {field.name: str(field.type) for field in fields(ChainOptions)}
_SINGLE = tuple(name for name, kind in _TYPES.items() if kind in ("float", "float | None", "int"))
_PER_COLUMN = tuple(name for name, kind in _TYPES.items() if kind == "Numbers")
_SIGNED = {"gain", "temperature_reference", "temperature_sensitivity", "temperature_offset", "bias"}
_RANGES = ("gain_range", "saturation_range", "dead_taxel_value_range")
MAX_KEPT_TIME_S = 1e6
"""The longest scan time, delay or jitter, for which past readings are kept."""
MAX_HISTORY_LENGTH = 100_000
"""The most past readings that a history delivers."""
BOUNDS = {
    **{option: Bounds(low=None if option in _SIGNED else 0) for option in (*_SINGLE, *_PER_COLUMN)},
    **dict.fromkeys(("scan_time", "delay", "jitter"), Bounds(low=0, high=MAX_KEPT_TIME_S, unit="s")),
    "dead_taxel_probability": Bounds(low=0, high=1),
    "history_length": Bounds(low=0, high=MAX_HISTORY_LENGTH),
}
"""The range of each option that is a number, or one number per column."""


def is_on(value) -> bool:
    """Return True if an option differs from zero anywhere."""
    return value is not None and bool(np.any(np.asarray(value, dtype=np.float64) != 0.0))


def check(options: ChainOptions, info: ReadingInfo) -> None:
    """Check that options are meaningful.

    Raises:
        SceneError: an option is not; the message names the sensor, the option, the given and the expected value.
    """

    def refuse(option: str, expected: str) -> None:
        raise SceneError(f"sensor {info.name!r}: {option} must be {expected}, got {getattr(options, option)!r}")

    where = f"sensor {info.name!r}"
    for option, bounds in BOUNDS.items():
        value = getattr(options, option)
        given = np.zeros(()) if value is None else numbers(where, option, value)
        if option in _SINGLE and given.ndim:
            refuse(option, "one number")
        elif bounds.low is not None and (given < bounds.low).any():
            refuse(option, "zero or positive")
        elif bounds.high is not None and (given > bounds.high).any():
            refuse(option, f"at most {bounds.high:g} {bounds.unit}".rstrip())
    for option in _RANGES:
        value = getattr(options, option)
        limits = np.zeros(2) if value is None else numbers(where, option, value)
        if limits.shape != (2,) or limits[0] > limits[1]:
            refuse(option, "(low, high) with low <= high")
    _check_temperature(options, info)


def _check_temperature(options: ChainOptions, info: ReadingInfo) -> None:
    coefficients = is_on(options.temperature_offset) or is_on(options.temperature_sensitivity)
    course = options.temperature_course
    if course is None:
        if coefficients:
            raise SceneError(
                f"sensor {info.name!r}: temperature_offset and temperature_sensitivity need a temperature_course,"
                f" such as [(0, 25), (600, 40)]: keyframes of time [s] and temperature [degree C]"
            )
        return
    frames = numbers(f"sensor {info.name!r}", "temperature_course", course)
    if frames.ndim != 2 or frames.shape[1:] != (2,) or not len(frames):
        raise SceneError(f"sensor {info.name!r}: temperature_course must be (time, temperature) pairs, got {course!r}")
    if np.any(np.diff(frames[:, 0]) < 0.0):
        raise SceneError(
            f"sensor {info.name!r}: the times of temperature_course must rise, got {frames[:, 0].tolist()}"
        )


def gain_is_on(options: ChainOptions) -> bool:
    """Return True if the options set, draw or may change the gains of taxels."""
    fixed = np.any(np.asarray(options.gain, dtype=np.float64) != 1.0)
    return bool(fixed) or options.gain_range is not None or "gain" in options.adjustable


def material_laws(options: ChainOptions) -> frozenset[str]:
    """Return the laws that are switched on and have a memory of the load."""
    unloading = options.hysteresis_strength_unloading
    hysteresis = is_on(options.hysteresis_strength) or is_on(unloading)
    laws = {
        "hysteresis": hysteresis,
        "unloading": hysteresis and (unloading is not None or options.hysteresis_tau_unloading is not None),
        "creep": is_on(options.creep_strength),
        "backlash": is_on(options.hysteresis_backlash),
    }
    return frozenset(law for law, on in laws.items() if on)


def electronic_laws(options: ChainOptions, info: ReadingInfo) -> frozenset[str]:
    """Return the laws that are switched on and have no memory of the load, and the random walk."""
    adjustable = set(options.adjustable)
    drifts = {"temperature_offset", "temperature_sensitivity"}
    temperature = any(is_on(getattr(options, k)) for k in drifts) or bool(adjustable & drifts)
    walk_density = is_on(options.random_walk_density)
    density = is_on(options.noise_density)
    laws = {
        "gain": gain_is_on(options) and not info.gain_inside,
        "temperature": temperature and options.temperature_course is not None,
        "random_walk": is_on(options.random_walk) or walk_density or "random_walk" in adjustable,
        "random_walk_density": walk_density,
        "noise": is_on(options.noise) or density or "noise" in adjustable,
        "noise_density": density,
        "bias": is_on(options.bias) or "bias" in adjustable,
        "saturation_range": options.saturation_range is not None or "saturation_range" in adjustable,
        "resolution": is_on(options.resolution) or "resolution" in adjustable,
        "dead": options.dead_taxel_probability > 0.0 or "dead" in adjustable,
    }
    chosen = {law for law, on in laws.items() if on}
    # A filler reads 0 already: only laws that add something need an exception for it.
    adds = {"temperature", "random_walk", "noise", "bias", "saturation_range", "dead"}
    if bool(info.filler.any()) and chosen & adds:
        chosen.add("filler")
    return frozenset(chosen)
