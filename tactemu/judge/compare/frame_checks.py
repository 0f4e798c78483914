"""Checks of frames of one class against what the model's frames have: constants, sums, counters, byte order, ranges."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_classes import CounterField, FrameClass, NumberField, decode, matrix
from tactemu.judge.compare.sum_rules import HOLDS, find_instead, words

MIN_FRAMES = 3
"""Least number of frames that prove a difference; a damaged one does not."""
MAX_SUMS = 400
"""Number of frames whose sums are checked."""
MIN_ORDER_FRAMES = 12
"""Least number of frames that show a byte order."""
ORDER_GAIN_BITS = 3.0
"""Least gain of the other byte order, in bits of the change from frame to frame, over all values of two bytes."""
MAX_OUTSIDE_SHARE = 0.01
"""Largest share of values outside of the range of their column."""
MAX_NAMED = 4
"""Largest number of places that a text names."""


def check_frames(
    made: FrameClass, contents: Sequence[bytes], bounds: Sequence[tuple[float, float]], verdicts: Verdicts
) -> None:
    """Add the findings on the frames of one class; all have its length."""
    if len(contents) < MIN_FRAMES or made.size is None:
        return
    table = matrix(contents)
    widened = _check_counters(made, table, verdicts)
    _check_constants(made, table, widened, verdicts)
    _check_sum(made, contents, verdicts)
    _check_values(made, table, bounds, verdicts)


def usual(column: np.ndarray) -> tuple[int, float]:
    """Return the most frequent value of a byte and its share."""
    value, count = Counter(column.tolist()).most_common(1)[0]
    return value, count / len(column)


# -- constants and sums ------------------------------------------------------------------------------------------------


def _check_constants(made: FrameClass, table: np.ndarray, widened: set[int], verdicts: Verdicts) -> None:
    differ: dict[str, list[str]] = {"fixed": [], "setting": [], "state": []}
    for at, value in made.const.items():
        found, share = usual(table[:, at])
        if at in widened or (found == value and share >= HOLDS):
            continue
        kind = "fixed" if at in made.fixed else "setting" if at in made.settings else "state"
        if kind == "fixed" and at in made.settings:
            kind = "setting"
        if kind != "state" and share < HOLDS and found == value:
            continue
        name = made.names.get(at, "").removeprefix("constant").strip()
        what = f"byte {at}{f' ({name})' if name else ''} is {found:02X} instead of {value:02X}"
        what = f"byte {at}{f' ({name})' if name else ''} changes" if found == value else what
        differ[kind].append(what if kind != "setting" else f"{what}: option `{made.settings[at]}`")
    if differ["fixed"]:
        verdicts.find("constant", made.label, _listed(differ["fixed"]))
    elif made.fixed:
        verdicts.agrees.append(f"{made.label}: {len(made.fixed)} constant bytes")
    if differ["setting"]:
        verdicts.notes.append(f"a setting of {made.label}: {_listed(differ['setting'])}")
    if differ["state"]:
        verdicts.notes.append(f"bytes of {made.label} that the model never changes: {_listed(differ['state'])}")


def _listed(texts: Sequence[str]) -> str:
    more = f" and {len(texts) - MAX_NAMED} more" if len(texts) > MAX_NAMED else ""
    return ", ".join(texts[:MAX_NAMED]) + more


def _check_sum(made: FrameClass, contents: Sequence[bytes], verdicts: Verdicts) -> None:
    if made.sum is None:
        return
    tried = contents[:: max(1, len(contents) // MAX_SUMS)]
    share = made.sum.share(tried)
    if share >= HOLDS:
        partly = "" if share == 1 else f", in {share:.1%} of {len(tried)} frames"
        verdicts.agrees.append(f"{made.label}: {words(made.sum)}{partly}")
    elif share < 0.5:
        verdicts.find("sum", made.label, sum_text(made, tried))
    else:
        verdicts.notes.append(f"{made.label}: the sum of {1 - share:.0%} of the frames is wrong: noise on the line?")


def sum_text(made: FrameClass, contents: Sequence[bytes]) -> str:
    """Return the difference of the sums in words."""
    assert made.sum is not None
    instead = find_instead(made.sum, contents)
    what = "no known sum holds instead"
    if instead is not None:
        what = f"{words(instead)} holds in {instead.share(contents):.0%}"
    return f"the model's {words(made.sum)} holds in {made.sum.share(contents):.0%} of {len(contents)} frames; {what}"


# -- counters ----------------------------------------------------------------------------------------------------------


def _check_counters(made: FrameClass, table: np.ndarray, verdicts: Verdicts) -> set[int]:
    """Check counters and clocks, and return the places of constants that are part of a wider counter."""
    widened: set[int] = set()
    for counter in made.counters:
        values = decode(table, counter.at, counter.code).astype(np.int64)
        name = f"{counter.rollover.name}, {counter.rollover.bits} bits"
        bits, wraps = width_of(values, counter.rollover.bits)
        if np.all(values == values[0]):
            verdicts.find("counter", made.label, f"{name}: it stands at {values[0]}")
            continue
        if bits is not None and bits < counter.rollover.bits:
            text = f"{name} in the model, starts again after {bits} bits"
            verdicts.find("counter", made.label, text)
            continue
        place = _carry(made, table, counter, values)
        if place is not None:
            widened.add(place)
            text = f"{name} in the model, carries into byte {place}, so that it has {counter.rollover.bits + 8}"
            verdicts.find("counter", made.label, text)
            continue
        _check_step(made, counter, values, name, verdicts)
        if not wraps:
            verdicts.unjudged.append(
                f"{made.label}: the width of {counter.rollover.name}: it did not start again; listen for longer"
            )
    return widened


def width_of(values: np.ndarray, bits: int) -> tuple[int | None, int]:
    """Return the number of bits after which values start again, and how often they did; ``None``: never.

    A counter of fewer bits never reaches its next bit, and falls back by all of them.
    """
    falls = np.flatnonzero(np.diff(values) < 0)
    if not len(falls):
        return None, 0
    for width in range(1, bits):
        modulus = 1 << width
        near = (values[falls] >= modulus * 3 // 4) & (values[falls + 1] < modulus // 4)
        if values.max() < modulus and near.mean() >= HOLDS:
            return width, len(falls)
    return bits, len(falls)


def _carry(made: FrameClass, table: np.ndarray, counter: CounterField, values: np.ndarray) -> int | None:
    """Return the place beside a counter that rises by one whenever the counter starts again, if there is one."""
    width = np.dtype(counter.code).itemsize
    falls = np.diff(values) < 0
    if not falls.any():
        return None
    for place in (counter.at - 1, counter.at + width):
        if 0 <= place < table.shape[1] and place in made.const:
            rises = np.diff(table[:, place].astype(np.int64)) % 256
            if np.array_equal(rises == 1, falls) and not (rises > 1).any():
                return place
    return None


def _check_step(made: FrameClass, counter: CounterField, values: np.ndarray, name: str, verdicts: Verdicts) -> None:
    """Check the increment of a counter of frames; lost frames make multiples of it."""
    if counter.rollover.clock or counter.rollover.name == "":
        return
    rises = np.diff(values) % counter.modulus
    step, share = usual(rises)
    if share >= 0.5 and step != counter.rollover.step:
        verdicts.find("counter", made.label, f"{name}: it rises by {step} instead of {counter.rollover.step}")
    else:
        verdicts.agrees.append(f"{made.label}: {name}, rises by {counter.rollover.step}")


# -- values ------------------------------------------------------------------------------------------------------------


def _check_values(
    made: FrameClass, table: np.ndarray, bounds: Sequence[tuple[float, float]], verdicts: Verdicts
) -> None:
    if not made.numbers:
        return
    wide = [each for each in made.numbers if each.code[0] in "<>"]
    if wide and len(table) >= MIN_ORDER_FRAMES:
        gain, moves = order_gain(wide, table)
        beyond = _outside(wide, table, bounds), _outside(wide, table, bounds, swapped=True)
        if gain >= ORDER_GAIN_BITS or (beyond[0] > 0.5 and beyond[1] < MAX_OUTSIDE_SHARE):
            usual_order = "low" if wide[0].code[0] == "<" else "high"
            other = "high" if usual_order == "low" else "low"
            first, last = min(each.at for each in wide), max(each.at for each in wide)
            where = f"byte {first}" if first == last else f"bytes {first} to {last}"
            why = f"; the values then change by {gain:.1f} bits less" if gain > 0 else ""
            text = f"values from {where} on come {other} byte first, in the model {usual_order} byte first{why}"
            verdicts.find("byte order", made.label, text)
            return
        if moves:
            verdicts.agrees.append(f"{made.label}: byte order of {len(wide)} values")
        else:
            verdicts.unjudged.append(f"{made.label}: the byte order of values: none changed; press, or move the sensor")
    share = _outside(made.numbers, table, bounds)
    if share > MAX_OUTSIDE_SHARE:
        verdicts.find("range", made.label, f"{share:.0%} of the values are outside of the model's range")


def order_gain(numbers: Sequence[NumberField], table: np.ndarray) -> tuple[float, bool]:
    """Return by how many bits values change less in the other byte order, and True if they change at all."""
    costs = [_change_bits(numbers, table, swapped) for swapped in (False, True)]
    return float(np.median(costs[0] - costs[1])), bool((costs[0] > 0).any())


def _change_bits(numbers: Sequence[NumberField], table: np.ndarray, swapped: bool) -> np.ndarray:
    """Return the mean size of the changes of each value [bits]; of a float, of its bits as an integer."""
    costs = []
    for each in numbers:
        code = each.code.replace("f", "i") if "f" in each.code else each.code
        values = NumberField(each.channel, each.at, code).numbers(table, swapped=swapped)
        width = 1 << 8 * int(code[-1])
        apart = np.abs(np.diff(values)) % width
        costs.append(np.log2(1 + np.minimum(apart, width - apart)).mean())
    return np.array(costs)


def _outside(
    numbers: Sequence[NumberField], table: np.ndarray, bounds: Sequence[tuple[float, float]], *, swapped: bool = False
) -> float:
    """Return the share of values outside of their column's range."""
    outside = total = 0
    for each in numbers:
        if each.channel < len(bounds):
            low, high = bounds[each.channel]
            values = each.numbers(table, swapped=swapped)
            with np.errstate(invalid="ignore"):
                outside += int(((values < low - 0.5) | (values > high + 0.5) | ~np.isfinite(values)).sum())
            total += len(values)
    return outside / max(1, total)
