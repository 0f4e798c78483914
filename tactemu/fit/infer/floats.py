"""The proofs that four or eight bytes are a float: it crosses zero smoothly, or its values lie on one grid.

Without the sign, the code of a float is a number whose bytes carry as those of an integer do. That shows its order, but
not that it is no integer; two things do:

* It crosses zero: the topmost bit flips while all others say that the value is small.
* Its values are multiples of one step, made of counts. As codes their step doubles from binade to binade downwards, so
  the codes of the lower binades lie on a coarser grid than those of the highest. The first half of the capture tells
  step and origin, and the second half has to follow.
"""

from __future__ import annotations

import numpy as np

from tactemu.fit.infer.costs import is_plausible
from tactemu.fit.infer.fields import Field
from tactemu.fit.infer.links import PROOF_BITS, Link

LEAST_CROSSINGS = 5
LEAST_VALUES = 20
NEAR = 0.25
"""The largest step over zero, as a share of the span."""
FLOAT_RUN = 3
"""The fewest floats of an array that prove each other."""
ARRAY_SHARE = 1 / 3
MIRRORED_SHARE = 0.25
"""The largest share of the evidence that the same top byte may have of a float in the other byte order."""
LEAST_ON_TOP = 4
"""The fewest values of the highest binade that show the step."""
MAX_ERROR = 1 / 1024
"""The largest rounding error of a value, as a share of the step."""
MAX_BINADES = 6
"""The most bits that one value adds: its rounding allows no more."""


def prove(fields: list[Field], rows: np.ndarray) -> None:
    """Make the floats of one array certain that are proven, and all of them if many are."""
    for each in fields:
        each.decide = "a capture without damaged messages"
    plausible = [each for each in fields if is_plausible(each.values(rows))]
    proven = 0
    for each in plausible:
        values = each.values(rows)
        if _crosses_zero(values) and _carries(each, rows):
            each.why = "crosses zero smoothly"
        elif is_on_grid(values, each.size):
            each.why = "its values are multiples of one step, those of the half that was held back as well"
        else:
            each.decide = "presses that take it through zero"
            continue
        each.is_certain, each.decide = True, ""
        proven += 1
    if len(fields) < FLOAT_RUN or proven < max(2, ARRAY_SHARE * len(fields)):
        return
    for each in plausible:
        if not each.is_certain:
            each.is_certain, each.decide = True, ""
            each.why = f"in an array of {len(fields)} floats, {proven} of them proven"


def _crosses_zero(values: np.ndarray) -> bool:
    span = np.ptp(values)
    flips = (values[1:] > 0) != (values[:-1] > 0)
    if flips.sum() < LEAST_CROSSINGS or not span or len(np.unique(values)) < LEAST_VALUES:
        return False
    return bool((np.abs(np.diff(values)[flips]) <= NEAR * span).mean() >= 0.8)


def _carries(each: Field, rows: np.ndarray) -> bool:
    """Return True if the byte below the top one carries into it, and the one on its other side does not."""
    top, step = (each.end - 1, -1) if each.order == "<" else (each.at, 1)
    magnitude = rows[:, top].astype(np.int64) & 0x7F
    own = Link(rows[:, top + step].astype(np.int64), magnitude, 8, 7)
    if not own.is_proven:
        return False
    other = top - step
    if not 0 <= other < rows.shape[1]:
        return True
    mirrored = Link(rows[:, other].astype(np.int64), magnitude, 8, 7)
    return not mirrored.is_proven or mirrored.bits < MIRRORED_SHARE * own.bits


def is_on_grid(values: np.ndarray, size: int) -> bool:
    """Return True if the second half of a float's values lies on the grid of the first, in several binades."""
    known = np.unique(values[: len(values) // 2])
    asked = np.setdiff1d(values[len(values) // 2 :], [*known, 0.0])
    if len(known) < LEAST_VALUES or not len(asked):
        return False
    error = 2.0 ** (-23 if size == 4 else -52) * float(np.abs(known).max())
    step = _step(known, error)
    if step is None or not error <= MAX_ERROR * step:
        return False
    top = np.frexp(np.abs(known))[1]
    highest = max((each for each in np.unique(top) if (top == each).sum() >= LEAST_ON_TOP), default=None)
    on_top = None if highest is None else _step(known[top == highest], error)
    if on_top is None or round(on_top / step) != 1 or not _fits(asked, known[0], step, error):
        return False
    below = np.clip(highest - np.frexp(np.abs(asked))[1], 0, MAX_BINADES)
    return bool(below.sum() >= PROOF_BITS)


def _step(values: np.ndarray, error: float) -> float | None:
    """Return the step of which all differences of sorted values are multiples, ``None`` if there is none."""
    apart = np.diff(values)
    apart = apart[apart > 4 * error]
    if len(apart) < LEAST_ON_TOP - 1:
        return None
    step = float(apart.min())
    for span in (8, 64, 512, 4096, 1 << 40):  # the longer a span, the more exact the step that it tells
        far = values[values - values[0] <= span * step][-1] - values[0]
        many = round(far / step)
        if many:
            step = far / many
    return step if _fits(values, values[0], step, error) else None


def _fits(values: np.ndarray, origin: float, step: float, error: float) -> bool:
    many = np.rint((values - origin) / step)
    return bool((np.abs(values - origin - many * step) <= 4 * error).all())
