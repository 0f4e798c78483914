"""The picture of the trade: error against cost, one panel per metric, the Pareto front as a line."""

from __future__ import annotations

from pathlib import Path

import matplotlib  # noqa: TID253  this module is imported only to draw

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: TID253

PANELS = ("normal force", "pressure", "tangential motion", "normal motion")
COLOURS = {0: "#888888", 1: "#b07d2b", 2: "#2b7bb0", 3: "#8a3fa0", 4: "#c0392b"}
FLOOR = 1e-4
"""Errors below this are drawn at it."""


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
        _panel(axis, metric, sorted(points, key=lambda point: point[0]))
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
    _name(axis, points)
    axis.set_title(f"error of the {metric}", loc="left", fontsize=9)
    axis.grid(alpha=0.25, which="major")
    axis.yaxis.set_major_formatter(lambda value, _at: f"{100 * value:g} %")
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def _is_free(left: float, low: float, width: float, taken: list[tuple[float, float, float]]) -> bool:
    """Whether a line of text there [points] would overlap none of those that are written."""
    return not any(abs(low - b) < 7 and left < a + w and a < left + width for a, b, w in taken)


def _name(axis, points: list) -> None:
    """Write each rung's name beside its point, above or below others where they would overlap."""
    axis.autoscale_view()
    taken: list[tuple[float, float, float]] = []
    for x, y, row in points:
        px, py = axis.transData.transform((x, y)) * 72 / axis.figure.dpi
        width = 3.1 * len(row["name"])
        left = px + 5
        offsets = sorted(range(-60, 61, 7), key=abs)
        up = next((up for up in offsets if _is_free(left, py + up + 1.5, width, taken)), offsets[-1])
        taken.append((left, py + up + 1.5, width))
        line = {"arrowstyle": "-", "color": "#bbbbbb", "linewidth": 0.5} if abs(up) > 7 else None
        axis.annotate(
            row["name"], (x, y), xytext=(5, up + 1.5 - 2), textcoords="offset points", fontsize=6, color="#333333",
            arrowprops=line,
        )  # fmt: skip
