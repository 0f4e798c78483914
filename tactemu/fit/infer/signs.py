"""The sign of integers: unsigned where small steps go through the middle of the range, signed where they go over 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactemu.fit.infer.costs import bits_of
from tactemu.fit.infer.fields import signed
from tactemu.fit.infer.links import Crossings, crossings

LEAST_CROSSINGS = 5
CLEAR_RATIO = 20
LEAST_BITS = 8.0
LEAST_ALIKE = 8
"""The fewest columns of a phase that say something if they have too few crossings together."""
MAX_PERIOD = 6
"""The largest number of columns after which the signs of an array repeat, such as x, y, z."""


@dataclass
class Sign:
    """The sign of an integer: ``u``, ``i`` or ``?`` where the top bit never moved."""

    kind: str
    is_certain: bool


def signs_of(columns: list[np.ndarray], index: Sequence[int], bits: int) -> tuple[list[Sign], list[int]]:
    """Return the sign of each of an array's unsigned readings, and the periods in which they may repeat.

    ``index`` is the number of each in the array. A column whose own crossings are too few is certain if it has some,
    none against, and the columns of its phase have many, in each of these periods.
    """
    seen = [crossings(values, bits) for values in columns]
    own = [_sign(values, bits, each) for values, each in zip(columns, seen)]
    if len(columns) < 4:
        return own, [1]
    periods = _periods(own, seen, index)
    places = np.asarray(index)
    totals = [
        {phase: sum((seen[j] for j in np.nonzero(places % period == phase)[0]), Crossings()) for phase in range(period)}
        for period in periods
    ]
    for k, sign in enumerate(own):
        if sign.is_certain or not periods:
            continue
        first = _kind_of(totals[0][index[k] % periods[0]], 2 * LEAST_CROSSINGS)
        kind = _kind_of(seen[k], 1)
        if first and kind in ("", first):
            others = [_kind_of(each[index[k] % len(each)] - seen[k], 1) for each in totals]
            told = {each for each, period in zip(others, periods) if each or len(columns) >= LEAST_ALIKE * period}
            sign.kind, sign.is_certain = first, told == {first} == {kind}
    return own, periods


def _periods(signs: list[Sign], seen: list[Crossings], index: Sequence[int]) -> list[int]:
    """Return the periods in which the signs of an array never contradict each other."""
    known = [(k, sign.kind if sign.is_certain else _kind_of(each, 2)) for k, sign, each in zip(index, signs, seen)]
    known = [(k, kind) for k, kind in known if kind in ("u", "i")]
    found = []
    for period in range(1, MAX_PERIOD + 1):
        phases = [{kind for k, kind in known if k % period == phase} for phase in range(period)]
        if all(len(kinds) <= 1 for kinds in phases):
            found.append(period)
    return found


def _kind_of(seen: Crossings, least: int = LEAST_CROSSINGS) -> str:
    """Return the sign that crossings prove, or an empty text."""
    if seen.over >= least and seen.over > CLEAR_RATIO * seen.through and 2 * seen.over >= seen.leaps:
        return "i"
    if seen.through >= least and seen.through > CLEAR_RATIO * seen.over and 2 * seen.through >= seen.leaps:
        return "u"
    return ""


def _sign(values: np.ndarray, bits: int, seen: Crossings) -> Sign:
    half = 1 << bits - 1
    high = values >= half
    if high.all() or not high.any():
        return Sign("?", True)
    if kind := _kind_of(seen):
        return Sign(kind, True)
    if (values == 2 * half - 1).sum() > 2 * ((values > 2 * half - 9) & (values < 2 * half - 1)).sum():
        return Sign("u", False)  # it is clipped at the upper end
    unsigned = float(bits_of(values[:, None])[0])
    as_signed = float(bits_of(signed(values, bits)[:, None])[0])
    if abs(unsigned - as_signed) < LEAST_BITS:
        near_zero = (values[high] > 2 * half - half // 8) & (values[high] < 2 * half - 1)
        return Sign("i" if near_zero.mean() > 0.8 else "u", False)
    return Sign("i" if as_signed < unsigned else "u", False)
