"""The picture of the trade-off: error against cost, one panel per metric, the Pareto front as a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib  # noqa: TID253  this module is imported only to draw

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: TID253

PANELS = ("normal force", "pressure", "tangential motion", "normal motion")
COLOURS = {0: "#888888", 1: "#b07d2b", 2: "#2b7bb0", 3: "#8a3fa0", 4: "#c0392b"}
LINE, DOT = 7, 2.5
"""Height of a name and radius of a point on the page [pt]."""
FLOOR = 1e-4
"""Errors below this value are drawn at it."""


def draw(found: dict, file: Path) -> None:
    """Write the picture as SVG or, by the file's suffix, another format."""
    plt.rcParams.update({"font.size": 8, "svg.fonttype": "none", "svg.hashsalt": "tactemu"})
    figure, axes = plt.subplots(2, 2, figsize=(10, 7.2), sharex=True)
    for axis, metric in zip(axes.flat, PANELS):
        points = [
            (row["step_us"], max(row["metrics"][metric]["median"], FLOOR), row)
            for row in found["summary"]
            if metric in row["metrics"]
        ]
        if points:
            _panel(axis, metric, sorted(points, key=lambda point: point[0]))
        else:  # no setting has this metric
            axis.set_axis_off()
    for axis in axes[1]:
        axis.set_xlabel("one step of 1024 taxels [µs]")
    figure.suptitle("Speed for accuracy: median error over the cases not calibrated on, warm sliding contact")
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)
    plt.close(figure)


def _panel(axis, metric: str, points: list) -> None:
    best, front = float("inf"), []
    for x, y, _row in points:
        if y < best:
            best = y
            front.append((x, y))
    axis.plot(*zip(*front), color="#cccccc", linewidth=4, zorder=0, solid_capstyle="round")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.margins(x=0.2, y=0.25)
    for x, y, row in points:
        axis.scatter(x, y, color=COLOURS[row["level"]], s=18, zorder=2)
    _name(axis, points, front)
    axis.set_title(f"error of the {metric}", loc="left", fontsize=9)
    axis.grid(alpha=0.25, which="major")
    axis.yaxis.set_major_formatter(lambda value, _at: f"{100 * value:g} %")
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def _name(axis, points: list, front: list) -> None:
    """Write each setting's name beside its point, clear of other names, of points and of the front."""
    axis.autoscale_view()
    scale = 72 / axis.figure.dpi
    at = [tuple(axis.transData.transform((x, y)) * scale) for x, y, _row in points]
    widths = [3.1 * len(row["name"]) for *_xy, row in points]
    line = _sampled([tuple(axis.transData.transform(each) * scale) for each in front])
    edge = axis.get_window_extent().x0 * scale
    for (x, y, row), (right, up) in zip(points, places(at, widths, avoid=line, edge=edge)):
        leader = {"arrowstyle": "-", "color": "#bbbbbb", "linewidth": 0.5} if abs(up) > LINE else None
        axis.annotate(
            row["name"], (x, y), xytext=(right, up - 2), textcoords="offset points", fontsize=6, color="#333333",
            arrowprops=leader,
        )  # fmt: skip


def _sampled(line: list[tuple[float, float]], step: float = 2.0) -> list[tuple[float, float]]:
    """Return points along a line, so close that no name fits between them."""
    found = []
    for (a, b), (c, d) in pairwise(line):
        n = max(1, round(max(abs(c - a), abs(d - b)) / step))
        found += [(a + (c - a) * k / n, b + (d - b) * k / n) for k in range(n + 1)]
    return found


def places(
    points: list[tuple[float, float]],
    widths: list[float],
    *,
    avoid: Sequence[tuple[float, float]] = (),
    edge: float = -math.inf,
) -> list[tuple[float, float]]:
    """Return the offset from each point to the left end and the middle of its name, as near as there is room.

    Args:
        points: the points on the page.
        widths: the widths of the names.
        avoid: other points that no name may cover.
        edge: the leftmost position at which a name may begin.
    """
    found: list[tuple[float, float]] = []
    for (x, y), width in zip(points, widths):
        beside = (5.0, -5.0 - width)
        tried = sorted(((right, up + 1.5) for up in range(-84, 85, LINE) for right in beside), key=lambda d: abs(d[1]))
        taken = [(a + right, b + up, other) for (a, b), (right, up), other in zip(points, found, widths)]
        free = (
            way
            for way in tried
            if x + way[0] > edge and _is_free(x + way[0], y + way[1], width, [*points, *avoid], taken)
        )
        found.append(next(free, tried[0]))
    return found


def _is_free(left: float, middle: float, width: float, points: list, taken: list) -> bool:
    """Return True if a name at this place would cover neither a point nor another name."""
    on_point = any(left - DOT < a < left + width + DOT and abs(middle - b) < 0.5 * LINE + DOT for a, b in points)
    return not on_point and not any(
        abs(middle - b) < LINE and left < a + other + DOT and a < left + width + DOT for a, b, other in taken
    )
