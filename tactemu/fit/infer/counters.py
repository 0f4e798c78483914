"""Counters and clocks: numbers that step regularly, whose upper bytes step when the lower ones wrap."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tactemu.fit.infer.fields import Field, integers

LEAST_ROWS = 12
SEED_SHARE = 0.97
"""The least share of a byte's steps that are one number or the next."""
LEAST_STEPS = 3
LEAST_WRAPS = 3
LEAST_VALUES = 8
MAX_SIZE = 8
REGULAR = (0.2, 5.0)
"""Steps that are regular, as multiples of the usual step: some messages are lost."""
REGULAR_SHARE = 0.97
SAME_SHARE = 0.9
LONG_STEP = 256
"""The least usual step whose multiples, if all steps are such, show lost messages, however many at once."""
LEAST_ALIKE, ALIKE_SHARE = 8, 0.5
"""The fewest equal steps with a wrap, and without, that say something, and the least share of such steps."""
TOLERANCE = 0.15
"""The largest difference of the mean steps with and without a wrap, as a share of a carry."""


def find_counters(rows: np.ndarray, taken: Iterable[Field]) -> list[Field]:
    """Return the counters and clocks in the bytes that no field of ``taken`` has."""
    if len(rows) < LEAST_ROWS:
        return []
    used = {k for each in taken for k in range(each.at, each.end)}
    found: list[Field] = []
    for at in _seeds(rows):
        if at in used:
            continue
        options = [_grown(rows, at, order, used) for order in "<>"]
        best = max((each for each in options if each is not None), key=lambda each: each.size, default=None)
        if best is None or (best.size == 1 and all(each is not None and each.size > 1 for each in options)):
            continue
        found.append(_field(rows, best, used))
        used.update(range(best.at, best.at + best.size))
    return found


def _seeds(rows: np.ndarray) -> list[int]:
    """Return the bytes that step by one number or the next nearly always."""
    steps = np.diff(rows.astype(np.int16), axis=0) % 256
    found = []
    for at in np.nonzero((steps != 0).sum(axis=0) >= LEAST_STEPS)[0]:
        counts = np.bincount(steps[:, at], minlength=257)
        pairs = counts[:256] + np.append(counts[1:256], counts[0])
        first = int(pairs.argmax())
        if first < 255 and pairs[first] >= SEED_SHARE * len(steps):
            found.append(int(at))
    return found


@dataclass(frozen=True)
class _Number:
    at: int
    size: int
    order: str


def _grown(rows: np.ndarray, seed: int, order: str, used: set[int]) -> _Number | None:
    """Return the number around a byte, grown by neighbours whose steps agree with its wraps; ``None`` if irregular."""
    number = _Number(seed, 1, order)
    while number.size < MAX_SIZE - 1:
        below = number.at - 1 if order == "<" else number.at + number.size
        if not _is_free(rows, below, used) or _carry(rows, _Number(below, 1, order), number) is not True:
            break
        number = _Number(min(below, number.at), number.size + 1, order)
    while number.size < MAX_SIZE:
        above = _above(number)
        if not _is_free(rows, above, used):
            break
        upper = _Number(above, 1, order)
        if _carry(rows, number, upper) is not True and not _steps_at_wraps(rows, number, upper):
            break
        number = _Number(min(above, number.at), number.size + 1, order)
    top = rows[:, number.at + number.size - 1 if number.order == "<" else number.at]
    is_counting = len(np.unique(_values(rows, number))) >= LEAST_VALUES and (
        number.size == 1 or len(np.unique(top)) != 2 or (np.diff(top.astype(int)) != 0).sum() < 3
    )
    return number if is_counting and _is_regular(rows, number) else None


def _above(number: _Number) -> int:
    return number.at + number.size if number.order == "<" else number.at - 1


def _is_free(rows: np.ndarray, at: int, used: set[int]) -> bool:
    return 0 <= at < rows.shape[1] and at not in used and bool((rows[:, at] != rows[0, at]).any())


def _values(rows: np.ndarray, number: _Number) -> np.ndarray:
    return integers(rows, number.at, number.size, number.order)


def _carry(rows: np.ndarray, low: _Number, high: _Number) -> bool | None:
    """Return True if the steps of ``high`` have a carry at each wrap of ``low``, ``None`` if that cannot be seen."""
    if low.size > 6:
        return None
    unit, full = 1 << 8 * low.size, 1 << 8 * high.size
    low_step = np.diff(_values(rows, low))
    high_step = (np.diff(_values(rows, high)) + full // 2) % full - full // 2
    joined = high_step.astype(float) * unit + low_step
    wraps = low_step < 0
    apart = np.abs(joined - np.median(joined))
    if _carries_alike(low_step % unit, wraps, joined):
        return True
    inside = apart <= max(1.5 * unit, 6 * float(np.median(apart)))  # messages that are lost make longer steps
    if min((wraps & inside).sum(), (~wraps & inside).sum()) < LEAST_WRAPS or inside.mean() < 0.95:
        return None
    over, under = joined[wraps & inside], joined[~wraps & inside]
    alone = low_step[wraps & inside].mean() - low_step[~wraps & inside].mean()  # what it would be without a carry
    error = np.hypot(over.std() / np.sqrt(len(over)), under.std() / np.sqrt(len(under)))
    if error > TOLERANCE / 2 * abs(alone):
        return None
    return bool(abs(over.mean() - under.mean()) < TOLERANCE * abs(alone))


def _carries_alike(low_step: np.ndarray, wraps: np.ndarray, joined: np.ndarray) -> bool:
    """Return True if equal steps of the lower part make equal steps of both, with and without a wrap.

    So it is in a clock of which few steps are usual, each with wraps of its own.
    """
    seen = 0
    for step, count in zip(*np.unique(low_step, return_counts=True)):
        over, under = joined[(low_step == step) & wraps], joined[(low_step == step) & ~wraps]
        if min(len(over), len(under)) >= LEAST_ALIKE:
            seen += int(count)
            usual = np.median(under)
            if min((over == usual).mean(), (under == usual).mean()) < REGULAR_SHARE:
                return False
    return seen > ALIKE_SHARE * len(low_step)


def _steps_at_wraps(rows: np.ndarray, low: _Number, high: _Number) -> bool:
    """Return True if ``high`` stepped by one at each wrap of ``low``, and at no other time, however few they were."""
    high_step = np.diff(_values(rows, high))
    wraps = np.diff(_values(rows, low)) < 0
    return bool(wraps.any() and (high_step[wraps] == 1).all() and not high_step[~wraps].any())


def _steps(rows: np.ndarray, number: _Number) -> np.ndarray:
    steps = np.diff(_values(rows, number)).astype(float)
    full = float(1 << 8 * min(number.size, 7))
    return steps % full if number.size < 8 else steps


def _is_regular(rows: np.ndarray, number: _Number) -> bool:
    steps = _steps(rows, number)
    usual = np.median(steps)
    if not 0 < usual < (1 << 8 * number.size) / 2:
        return False
    low, high = REGULAR
    back = np.diff(_values(rows, number)) < 0
    if number.size == 1 and back.any() and (steps[back] <= high * usual).mean() < 0.6:
        return False  # it starts again before it is full: it counts something else
    regular = (steps >= low * usual) & (steps <= high * usual)
    if usual >= LONG_STEP and (steps == usual).mean() >= SAME_SHARE and not (steps % usual).any():
        regular = steps > 0
    return bool(regular.mean() >= REGULAR_SHARE)


def _may_grow(rows: np.ndarray, number: _Number, used: set[int]) -> bool:
    """Return True if nothing shows that the byte above a number is no part of it."""
    above = _above(number)
    if not 0 <= above < rows.shape[1] or above in used:
        return False
    if (rows[:, above] == rows[0, above]).all():
        top = rows[:, number.at + number.size - 1 if number.order == "<" else number.at].astype(np.int64)
        return int(rows[0, above]) == 0 or (np.diff(top) < 0).sum() < LEAST_WRAPS
    return _carry(rows, number, _Number(above, 1, number.order)) is not False


def _field(rows: np.ndarray, number: _Number, used: set[int]) -> Field:
    steps = _steps(rows, number)
    usual = float(np.median(steps))
    same = float((steps == usual).mean())
    is_clock = same < SAME_SHARE or (usual > 8 and number.size > 1)
    top = rows[:, number.at + number.size - 1 if number.order == "<" else number.at].astype(np.int64)
    top_steps, top_wraps = int((np.diff(top) != 0).sum()), int((np.diff(top) < 0).sum())
    sides = [number] if number.size > 1 else [_Number(number.at, 1, order) for order in "<>"]
    is_open = any(_may_grow(rows, each, used) for each in sides)
    below = number.at - 1 if number.order == "<" else number.at + number.size
    is_low_open = _is_free(rows, below, used) and _carry(rows, _Number(below, 1, number.order), number) is None
    is_proven = not is_open and not is_low_open and (top_wraps >= 2 if number.size == 1 else top_steps >= LEAST_STEPS)
    return Field(
        number.at,
        number.size,
        "clock" if is_clock else "counter",
        number.order if number.size > 1 else "",
        is_certain=is_proven,
        is_width_open=is_open,
        why=f"steps of {usual:g}" + (", its upper bytes step at each wrap" if number.size > 1 else ", it wraps")
        if is_proven
        else f"steps of {usual:g}",
        decide="" if is_proven else "a longer capture: until the byte above steps",
    )
