"""Presses in known places: only they show whether two taxels are exchanged."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_protocols import Device
from tactemu.base.errors import TactemuError, reason_of
from tactemu.judge.compare.findings import Verdicts

MAX_PRESSED = 24
"""Largest number of taxels that the user is asked to press."""
MIN_RESPONSE = 8.0
"""Least response to a press, in standard deviations of the noise."""
HEAD = "taxel,begin_s,end_s"
"""The first line of a file of presses."""
CLEAR_RATIO = 1.3
"""Least ratio of the greatest response to that of the taxel that was pressed, for a verdict."""


@dataclass(frozen=True, slots=True)
class Press:
    """A press of one taxel."""

    taxel: int
    begin_s: float
    """The time at which it may begin, from the start of the capture [s]."""
    end_s: float


@dataclass(frozen=True)
class Course:
    """The course of one channel."""

    times_s: np.ndarray
    values: np.ndarray


def place_of(device: Device, taxel: int) -> str:
    """Return the place of a taxel in words."""
    x, y, z = device.layout.positions[taxel] * 1e3
    patch = next(each for each in device.layout.patches if taxel in range(each.start, each.start + len(each)))
    within = taxel - patch.start
    grid = f", row {within // patch.cols}, column {within % patch.cols}" if patch.rows else ""
    return f"taxel {taxel} ({patch.name}{grid}; x {x:.1f}, y {y:.1f}, z {z:.1f} mm)"


def to_press(device: Device) -> list[int]:
    """Return the taxels to press: all if they are few, else some of each patch, spread evenly."""
    n = len(device.layout)
    if n <= MAX_PRESSED:
        return list(range(n))
    chosen: set[int] = set()
    per_patch = max(2, MAX_PRESSED // len(device.layout.patches))
    for patch in device.layout.patches:
        count = min(per_patch, len(patch))
        chosen |= {patch.start + round(k * (len(patch) - 1) / max(1, count - 1)) for k in range(count)}
    return sorted(chosen)[:MAX_PRESSED]


def read(path: Path) -> list[Press]:
    """Return the presses of a file with the columns taxel, begin_s, end_s.

    Raises:
        TactemuError: the file cannot be read.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            return [Press(int(row["taxel"]), float(row["begin_s"]), float(row["end_s"])) for row in rows]
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the presses: {reason_of(error)}") from None
    except (KeyError, ValueError, TypeError) as error:
        raise TactemuError(f"{path}: expected the columns {HEAD}: {error}") from None


def write(path: Path, presses: Sequence[Press]) -> None:
    """Write presses as :func:`read` reads them."""
    lines = [HEAD, *(f"{each.taxel},{each.begin_s:.3f},{each.end_s:.3f}" for each in presses)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def check_presses(
    presses: Sequence[Press], courses: Mapping[int, Sequence[Course]], verdicts: Verdicts
) -> dict[int, float]:
    """Compare the taxel that answers each press with the one that was pressed, and return the peaks [counts].

    Args:
        presses: the presses.
        courses: the channels of each taxel.
        verdicts: receives the findings.
    """
    answered: dict[int, int] = {}
    peaks: dict[int, float] = {}
    for press in presses:
        responses = {taxel: _response(of, press) for taxel, of in courses.items()}
        best = max(responses, key=lambda taxel: responses[taxel], default=None)
        if best is None or not responses[best]:
            verdicts.unjudged.append(f"taxel {press.taxel}: nothing answered the press; press harder, or for longer")
            continue
        own = responses.get(press.taxel, 0.0)
        clear = best == press.taxel or responses[best] >= CLEAR_RATIO * own
        if clear:
            answered[press.taxel] = best
            peaks[press.taxel] = responses[best]
        else:
            verdicts.unjudged.append(f"taxel {press.taxel}: taxel {best} answers as much; press a smaller spot")
    wrong = {pressed: found for pressed, found in answered.items() if pressed != found}
    exchanged = {tuple(sorted((a, b))) for a, b in wrong.items() if wrong.get(b) == a}
    for a, b in sorted(exchanged):
        verdicts.find("taxel order", "", f"taxels {a} and {b} are exchanged")
    others = [(a, b) for a, b in sorted(wrong.items()) if tuple(sorted((a, b))) not in exchanged]
    if others:
        text = ", ".join(f"a press on {a} shows as {b}" for a, b in others[:6])
        verdicts.find("taxel order", "", text + (" …" if len(others) > 6 else ""))
    if answered and not wrong:
        verdicts.agrees.append(f"the places of {len(answered)} pressed taxels")
    return peaks


def _response(courses: Sequence[Course], press: Press) -> float:
    """Return the greatest change of a taxel during a press [counts]; 0 if none is above the noise."""
    peaks = [(_peak(each, press), _noise(each)) for each in courses]
    return max((peak for peak, noise in peaks if peak >= MIN_RESPONSE * noise), default=0.0)


def _peak(course: Course, press: Press) -> float:
    during = course.values[(course.times_s >= press.begin_s) & (course.times_s < press.end_s)]
    rest = float(np.median(course.values))
    return float(np.quantile(np.abs(during - rest), 0.9)) if len(during) else 0.0


def _noise(course: Course) -> float:
    """Return the noise of a channel, a third of a count at least."""
    apart = np.abs(np.diff(course.values))
    return max(1.4826 * float(np.median(apart)) / np.sqrt(2), 1 / 3) if len(apart) else 1.0
