"""The picture of the trade-off: error against cost, one panel per metric, the Pareto front as a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib  # noqa: TID253  this module is imported only to draw

from tactemu.base.style import LIGHT, SERIES, plot_style

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: TID253

PANELS = ("total force", "pressure", "light press force", "drag force")
PANELS += ("edge force", "edge pressure", "tangential motion", "normal motion")
COLOURS = (LIGHT["muted"], *SERIES)
"""The colours of the levels."""
MARKERS = "dvs^o"
"""The marks of the levels."""
LINE, DOT = 7, 2.5
"""Height of a name and radius of a point on the page [pt]."""
CHARACTER = 3.4
"""Width of a character of a name on the page, at most [pt]."""
FLOOR = 1e-4
"""Errors below this value are drawn at it."""


def draw(
    found: dict,
    file: Path,
    panels: Sequence[str] = PANELS,
    command: str = "tactemu bench trade",
    size: tuple[float, float] = (5.0, 3.5),
) -> None:
    """Write the picture as SVG or, by the file's suffix, another format.

    Args:
        found: the figures, as in ``trade.json``.
        file: the file to write.
        panels: the metrics that are drawn, a panel each.
        command: the command that makes the picture, which stands below it.
        size: width and height of a panel [in].
    """
    with matplotlib.rc_context(plot_style() | {"font.size": 8, "axes.titlesize": 9}):
        rows, columns = (len(panels) + 1) // 2, min(len(panels), 2)
        whole = (size[0] * columns, size[1] * rows + 0.2)
        figure, grid = plt.subplots(rows, columns, figsize=whole, sharex=True, squeeze=False)
        named = []
        for axis, metric in zip(grid.flat, panels):
            points = [
                (row["step_us"], max(row["metrics"][metric]["median"], FLOOR), row)
                for row in found["summary"]
                if metric in row["metrics"]
            ]
            if points:
                points.sort(key=lambda point: point[0])
                named.append((axis, points, _panel(axis, metric, points)))
            else:  # no setting has this metric
                axis.set_axis_off()
        for axis in grid[-1]:
            axis.set_xlabel("one step of 1024 taxels [µs]")
        figure.text(0.01, 0.008, command, fontsize=6, color=LIGHT["muted"])
        figure.tight_layout(rect=(0, 0.03, 1, 1))
        for each in named:  # once the panels have their places
            _name(*each)
        figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)
        plt.close(figure)


def _panel(axis, metric: str, points: list) -> list:
    """Draw the points of a metric, and return the Pareto front, which is a line below them."""
    best, front = float("inf"), []
    for x, y, _row in points:
        if y < best:
            best = y
            front.append((x, y))
    axis.plot(*zip(*front), color=LIGHT["line"], linewidth=4, zorder=0, solid_capstyle="round")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.margins(x=0.25, y=0.25)
    for x, y, row in points:
        axis.scatter(x, y, color=COLOURS[row["level"]], marker=MARKERS[row["level"]], s=18, zorder=2)
    axis.set_title(f"error of the {metric}")
    axis.xaxis.set_major_formatter(lambda value, _at: f"{value:g}")
    axis.yaxis.set_major_formatter(lambda value, _at: f"{100 * value:g} %")
    return front


def _name(axis, points: list, front: list) -> None:
    """Write each setting's name beside its point, clear of other names, of points and of the front."""
    axis.autoscale_view()
    scale = 72 / axis.figure.dpi
    at = [tuple(axis.transData.transform((x, y)) * scale) for x, y, _row in points]
    widths = [CHARACTER * len(row["name"]) for *_xy, row in points]
    line = _sampled([tuple(axis.transData.transform(each) * scale) for each in front])
    box = axis.get_window_extent()
    within = (box.x0 * scale, box.y0 * scale + LINE / 2, box.x1 * scale, box.y1 * scale - LINE / 2)
    for (x, y, row), (right, up) in zip(points, places(at, widths, avoid=line, within=within)):
        near = (0.0 if right > 0 else 1.0, 0.5)
        leader = {"arrowstyle": "-", "color": LIGHT["muted"], "linewidth": 0.4, "relpos": near}
        axis.annotate(
            row["name"], (x, y), xytext=(right, up - 2), textcoords="offset points", fontsize=6,
            arrowprops=leader if abs(up) > LINE else None,
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
    within: tuple[float, float, float, float] = (-math.inf, -math.inf, math.inf, math.inf),
) -> list[tuple[float, float]]:
    """Return the offset from each point to the left end and the middle of its name, as near as there is room.

    Args:
        points: the points on the page.
        widths: the widths of the names.
        avoid: other points that no name may cover.
        within: left, bottom, right and top of the space for names.
    """
    found: list[tuple[float, float]] = []
    leaders: list[tuple[float, float]] = []
    for (x, y), width in zip(points, widths):
        beside = (5.0, -5.0 - width)
        tried = sorted(((right, up + 1.5) for up in range(-84, 85, LINE) for right in beside), key=lambda d: abs(d[1]))
        taken = [(a + right, b + up, other) for (a, b), (right, up), other in zip(points, found, widths)]
        free = [
            way
            for way in tried
            if within[0] < x + way[0] < within[2] - width
            and within[1] < y + way[1] < within[3]
            and _is_free(x + way[0], y + way[1], width, [*points, *avoid], taken)
        ]
        clear = (
            way
            for way in free
            if _is_free(x + way[0], y + way[1], width, leaders, [])
            and not any(_is_on(at, taken) for at in _leader((x, y), way, width))
        )
        found.append(next(clear, (free or tried)[0]))
        leaders += _leader((x, y), found[-1], width)
    return found


def _leader(point: tuple[float, float], way: tuple[float, float], width: float) -> list[tuple[float, float]]:
    """Return points along the line from a point to its name; none to a name beside it."""
    right, up = way
    end = (point[0] + (right if right > 0 else right + width), point[1] + up)
    return _sampled([point, end])[2:-2] if abs(up) > LINE else []


def _is_on(point: tuple[float, float], taken: list) -> bool:
    """Return True if a point lies on a name."""
    return any(left <= point[0] <= left + width and abs(middle - point[1]) < LINE / 2 for left, middle, width in taken)


def _is_free(left: float, middle: float, width: float, points: list, taken: list) -> bool:
    """Return True if a name at this place would cover neither a point nor another name."""
    on_point = any(left - DOT < a < left + width + DOT and abs(middle - b) < 0.5 * LINE + DOT for a, b in points)
    return not on_point and not any(
        abs(middle - b) < LINE and left < a + other + DOT and a < left + width + DOT for a, b, other in taken
    )
