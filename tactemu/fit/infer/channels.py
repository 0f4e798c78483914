"""The channels that answer together, and their order: a picture of their correlation, and the presses one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.style import BLUE, LIGHT
from tactemu.fit.infer.analysis import Draft
from tactemu.fit.infer.fields import Field, Group

LEAST_ROWS = 30
MAX_CHANNELS = 400
MAX_ROWS = 4000
TOUCH_SIGMAS = 8.0
"""A channel answers where it leaves its median by so many of its usual deviations."""
SMALLEST_PICTURE = 3


@dataclass(frozen=True)
class Channel:
    """A field that changes, by group and place."""

    group: Group
    field: Field

    def __str__(self) -> str:
        return f"{self.group.key} @{self.field.at}"


@dataclass(frozen=True)
class Answers:
    """The channels of the largest group with values, and how they answer."""

    channels: list[Channel]
    correlation: np.ndarray
    """Shape (n, n)."""
    order: list[int]
    """The channels by the time of their first answer; those that never answer are left out."""
    together: list[list[int]]
    """The channels that answer at the same times, the largest set first."""


def answers_of(draft: Draft) -> Answers | None:
    """Return which channels answer together, ``None`` if too little moves."""
    groups = [group for group in draft.groups if len(group.rows) >= LEAST_ROWS and _values(group)]
    if not groups:
        return None
    group = max(groups, key=lambda group: len(_values(group)) * min(len(group.rows), MAX_ROWS))
    fields = _values(group)[:MAX_CHANNELS]
    rows = group.rows[:MAX_ROWS]
    signals = np.array([each.values(rows) for each in fields], float)
    rest = np.median(signals, axis=1, keepdims=True)
    noise = np.median(np.abs(np.diff(signals, axis=1)), axis=1, keepdims=True) + 1e-9
    moved = np.abs(signals - rest)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.nan_to_num(np.corrcoef(moved)) if len(fields) > 1 else np.ones((1, 1))
    peaks = moved.max(axis=1, keepdims=True)
    is_touched = (moved > TOUCH_SIGMAS * noise) & (moved > 0.3 * peaks)
    first = [(int(np.argmax(touched)), k) for k, touched in enumerate(is_touched) if touched.any()]
    return Answers(
        [Channel(group, each) for each in fields], correlation, [k for _, k in sorted(first)], _sets(correlation)
    )


def _values(group: Group) -> list[Field]:
    return [each for each in group.fields if each.kind in ("u", "i", "f", "?")]


def _sets(correlation: np.ndarray, least: float = 0.8) -> list[list[int]]:
    """Return sets of channels, each of which is alike to the first of its set."""
    left, found = list(range(len(correlation))), []
    while left:
        first = left[0]
        alike = [k for k in left if k == first or correlation[first, k] >= least]
        found.append(alike)
        left = [k for k in left if k not in alike]
    return sorted((each for each in found if len(each) > 1), key=len, reverse=True)


PICTURE_SIGN = 'shape-rendering="crispEdges"'
"""A text in the first line of each picture."""


def svg(answers: Answers, command: str = "", cell: int = 10) -> str:
    """Return a picture of the correlation: darker cells answer together more; below it, the command that made it."""
    n = len(answers.channels)
    size = max(n * cell, SMALLEST_PICTURE * cell)
    letter = min(10.0, 1.6 * size / max(len(command), 1))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size}" height="{size + 16}" {PICTURE_SIGN}>',
        f'<rect width="{size}" height="{size + 16}" fill="{LIGHT["page"]}"/><text y="{size + 12}" '
        f'fill="{LIGHT["muted"]}" font-family="monospace" font-size="{letter:.1f}">{escape(command)}</text>',
    ]
    for i in range(n):
        for k in range(n):
            share = max(0.0, float(answers.correlation[i, k]))
            if share > 0.02:
                title = f"<title>{answers.channels[i]} / {answers.channels[k]}: {answers.correlation[i, k]:.2f}</title>"
                parts.append(
                    f'<rect x="{k * cell}" y="{i * cell}" width="{cell}" height="{cell}" '
                    f'fill="{BLUE}" fill-opacity="{share:.2f}">{title}</rect>'
                )
    return "\n".join([*parts, "</svg>"]) + "\n"


def read_shown(path: Path) -> tuple[list[str], np.ndarray]:
    """Read what a vendor's program showed: a CSV with one line of names, then numbers.

    Raises:
        TactemuError: the file cannot be read, or is no such table.
    """
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
        names = [word.strip() for word in lines[0].split(",")]
        rows = np.array([[float(word) for word in line.split(",")] for line in lines[1:]])
    except OSError as error:
        raise TactemuError(f"{path}: cannot read it: {reason_of(error)}") from None
    except (ValueError, IndexError):
        raise TactemuError(f"{path}: expected a CSV: a line of names, then lines of as many numbers") from None
    if rows.ndim != 2 or rows.shape[1] != len(names) or len(rows) < LEAST_ROWS:
        raise TactemuError(f"{path}: expected at least {LEAST_ROWS} lines of {len(names)} numbers")
    return names, rows


def shown_fields(draft: Draft, names: Sequence[str], rows: np.ndarray) -> list[str]:
    """Return for each column that a vendor's program showed the field that moves with it, and the scale, in words."""
    found = []
    for name, column in zip(names, rows.T):
        if np.ptp(column) == 0 or name.lower() in ("t", "time", "time_s"):
            continue
        best: tuple[float, str] | None = None
        for group in draft.groups:
            if len(group.rows) < LEAST_ROWS:
                continue
            index = np.linspace(0, len(group.rows) - 1, len(column)).round().astype(int)
            for each in _values(group):
                values = each.values(group.rows)[index].astype(float)
                if np.ptp(values) == 0:
                    continue
                share = float(np.corrcoef(values, column)[0, 1])
                scale = np.polyfit(values, column, 1)
                text = f"{name}: byte {each.at} of {group.key}, {name} = {scale[0]:.6g} * value + {scale[1]:.6g}"
                if best is None or abs(share) > best[0]:
                    best = abs(share), f"{text} (correlation {share:.3f})"
        found.append(best[1] if best and best[0] > 0.9 else f"{name}: no field moves with it")
    return found
