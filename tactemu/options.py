"""Checks of options, all in the same words."""

from __future__ import annotations

import math

import numpy as np

from tactemu.errors import SceneError, shown


def number(
    where: str,
    name: str,
    value,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    whole: bool = False,
    unit: str = "",
) -> float:
    """A finite number, within its bounds.

    Args:
        where: the sensor, the model or the motion, for the message.
        name: of the option.
        value: as given; neither a text nor a truth value is a number.
        above: it must be greater than this.
        at_least: it must not be less than this.
        at_most: it must not be more than this.
        whole: it must be a whole number.
        unit: for the message.

    Raises:
        SceneError: it is not.
    """
    asked = {">": above, ">=": at_least, "<=": at_most}
    bounds = [f"{sign} {bound:g}" for sign, bound in asked.items() if bound is not None]
    try:
        got = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        got = math.nan
    too_low = (above is not None and not got > above) or (at_least is not None and not got >= at_least)
    too_high = at_most is not None and not got <= at_most
    if not math.isfinite(got) or too_low or too_high or (whole and got != int(got)):
        kind = ["a whole number"] if whole else [] if bounds else ["a finite number"]
        expected = " ".join([*kind, " and ".join(bounds), unit])
        raise SceneError(f"{where}: {name} must be {' '.join(expected.split())}, got {shown(value)}")
    return got


def numbers(where: str, name: str, value) -> np.ndarray:
    """A float64 array of finite numbers, of any shape; neither texts nor truth values are numbers.

    Raises:
        SceneError: it is not.
    """
    try:
        given = np.asarray(value)
        array = given.astype(np.float64) if given.dtype.kind in "iuf" or given.size == 0 else None
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is None:
        raise SceneError(f"{where}: {name} must be numbers in a regular shape, got {shown(value)}")
    if not np.isfinite(array).all():
        raise SceneError(f"{where}: {name} must be finite, got {shown(value)}")
    return array


def triple(where: str, name: str, value) -> np.ndarray:
    """Three finite numbers.

    Raises:
        SceneError: it is not.
    """
    array = numbers(where, name, value)
    if array.shape != (3,):
        raise SceneError(f"{where}: {name} must be 3 numbers, got {shown(value)}")
    return array
