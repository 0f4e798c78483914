"""Charts of reports as SVG, in the colours of the style: curves and a histogram, with the units at their axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from tactemu.base.style import LIGHT, SERIES

WIDTH, HEIGHT = 480, 230
"""Size of a chart [px]; on a page it is as wide as its column."""
LEFT, RIGHT, TOP, BOTTOM = 58, 12, 24, 42
"""Margins around the plotted area [px]."""
MAX_POINTS = 1500
"""Maximum number of points of a curve that are drawn."""
_CHARACTER_PX = 7.0
"""Width of a character, at most."""


@dataclass(frozen=True)
class Curve:
    """Values one after the other, drawn as a line; a chart of several names each."""

    name: str
    values: np.ndarray


@dataclass(frozen=True)
class _Axes:
    """The plotted area: the ranges of its two axes."""

    x: tuple[float, float]
    y: tuple[float, float]

    def across(self, x: np.ndarray | float) -> np.ndarray:
        """Return where values of x are [px]."""
        return LEFT + (WIDTH - LEFT - RIGHT) * (np.asarray(x) - self.x[0]) / (self.x[1] - self.x[0])

    def down(self, y: np.ndarray | float) -> np.ndarray:
        """Return where values of y are [px]."""
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (np.asarray(y) - self.y[0]) / (self.y[1] - self.y[0])

    def svg(self, drawn: str, labels: tuple[str, str], about: str, names: Sequence[str] = ()) -> str:
        """Return a chart: grid, ticks, labels, the names of its curves, and what is drawn."""
        lines, texts = [], []
        for tick in ticks(*self.x):
            texts.append(_text(float(self.across(tick)), HEIGHT - BOTTOM + 16, f"{tick:g}", "middle"))
        for tick in ticks(*self.y):
            at = float(self.down(tick))
            lines.append(f'<path stroke="{LIGHT["line"]}" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
            texts.append(_text(LEFT - 6, at + 4, f"{tick:g}", "end"))
        texts.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, labels[0], "middle"))
        texts.append(_text(2, 14, labels[1], "start"))
        end = WIDTH - RIGHT
        for name, colour in reversed(list(zip(names, SERIES)) if len(names) > 1 else []):
            texts.append(_text(end, 14, name, "end", colour))
            end -= _CHARACTER_PX * len(name) + 12
        return (
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
            f'aria-label="{escape(about)}" font-size="12">{"".join(lines)}{drawn}{"".join(texts)}</svg>'
        )


def curves(shown: Sequence[Curve], labels: tuple[str, str], about: str) -> str:
    """Return a chart of curves over the number of the value.

    Args:
        shown: the curves.
        labels: the quantities of the two axes, with their units.
        about: what the chart shows, for those who hear it.
    """
    every = np.concatenate([curve.values for curve in shown])
    most = max(len(curve.values) for curve in shown)
    axes = _Axes((0.0, max(most - 1.0, 1.0)), _range(float(every.min()), float(every.max())))
    lines = []
    for curve, colour in zip(shown, SERIES):
        at = np.unique(np.linspace(0, len(curve.values) - 1, MAX_POINTS).astype(int))
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(axes.across(at), axes.down(curve.values[at])))
        lines.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.3" points="{points}"/>')
    return axes.svg("".join(lines), labels, about, [curve.name for curve in shown])


def histogram(values: Sequence[float], labels: tuple[str, str], about: str, *, bins: int = 48) -> str:
    """Return a histogram of values from 0 on; those beyond the 99.5th percentile are in the last bar."""
    top = float(np.quantile(values, 0.995)) * 1.1 or 1.0
    counts, edges = np.histogram(np.minimum(values, top), bins=bins, range=(0.0, top))
    axes = _Axes((0.0, top), (0.0, float(counts.max())))
    left, high = axes.across(edges), axes.down(counts)
    bars = "".join(
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(right - x - 1, 0.5):.1f}" height="{HEIGHT - BOTTOM - y:.1f}"/>'
        for x, right, y in zip(left, left[1:], high)
    )
    return axes.svg(f'<g fill="{SERIES[0]}">{bars}</g>', labels, about)


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Return round numbers from ``low`` to ``high``: ``most`` at most, steps of 1, 2 or 5."""
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    step = next(power * k for k in (1, 2, 5, 10, 20) if (high - low) / (power * k) <= most - 1)
    return [float(f"{k * step:.6g}") for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _range(low: float, high: float) -> tuple[float, float]:
    """Return a range with a little room at both ends."""
    room = 0.04 * (high - low) or 0.5
    return low - room, high + room


def _text(x: float, y: float, text: str, anchor: str, colour: str = LIGHT["muted"]) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{escape(text)}</text>'
