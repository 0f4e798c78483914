"""The summary of all cases in one line per setting: medians, ranges, and the settings that others dominate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from tactemu.tune.trade.cases import LIGHT_DEPTH

NARROW = ("thin wedge", "box edge, 0.2 mm", "rim, 0.2 mm")
"""Contacts narrower than a taxel; they count for edges only, because point-sampled levels miss them altogether."""
EDGES = ("box edge", "tilted box", "thin wedge", "rim")
"""Objects that touch with an edge or a rim."""
LIGHT = f", {LIGHT_DEPTH * 1e3:g} mm,"
"""The part of a case's name that tells light presses."""


class Measure(NamedTuple):
    """A figure of the table and the picture: an error over the cases that it is about."""

    metric: str
    """The error of a case, of :func:`~tactemu.tune.trade.errors.errors`."""
    covers: Callable[[str], bool]
    """True for the name of a case that counts."""


def _wide(case: str) -> bool:
    return not case.startswith(NARROW) and LIGHT not in case


def _edge(case: str) -> bool:
    return case.startswith(EDGES) and LIGHT not in case


def _light(case: str) -> bool:
    return LIGHT in case


def _drag(case: str) -> bool:
    return _wide(case) and case.endswith(("slide", "roll"))


MEASURES = {
    "total force": Measure("normal force", _wide),
    "pressure": Measure("pressure", _wide),
    "light press force": Measure("normal force", _light),
    "light press pressure": Measure("pressure", _light),
    "edge force": Measure("normal force", _edge),
    "edge pressure": Measure("pressure", _edge),
    "drag force": Measure("tangential force", _drag),
    "tangential motion": Measure("tangential motion", _wide),
    "normal motion": Measure("normal motion", _wide),
    "contact area": Measure("contact area", _wide),
    "overlap of areas": Measure("overlap of areas", _wide),
    "centre": Measure("centre", _wide),
}
"""All figures, in the order of the table."""
JUDGED = tuple(MEASURES)[:9]
"""Figures of the picture and of the comparison of settings."""
CLOSE = 1.1
"""The factor by which a setting that dominates another is better in error or in speed, being no worse in both."""
SAME = 1.02
"""Errors within this factor count as equal."""


def summarise(settings: list[dict]) -> list[dict]:
    """Return median and range of each setting and measure over the cases not used to calibrate it."""
    rows = []
    for setting in settings:
        row = {"name": setting["name"], "level": setting["level"], **setting["cost"], "metrics": {}}
        for name, measure in MEASURES.items():
            found = [
                errors[measure.metric]
                for case, errors in setting["errors"].items()
                if measure.covers(case) and case not in setting["calibrated_on"] and measure.metric in errors
            ]
            if found:
                row["metrics"][name] = {
                    "median": median(error["rms"] for error in found),
                    "low": min(error["low"] for error in found),
                    "high": max(error["high"] for error in found),
                }
        rows.append(row)
    for row in rows:
        row["dominated_by"] = _dominator(row, rows)
    return rows


def _dominator(row: dict, rows: list[dict]) -> str | None:
    """Return the fastest setting that is no slower, no worse in anything this one offers, and clearly better in
    something.
    """
    mine = {metric: value["median"] for metric, value in row["metrics"].items() if metric in JUDGED}
    if not mine:
        return None
    for other in sorted(rows, key=lambda r: r["step_us"]):
        theirs = {metric: value["median"] for metric, value in other["metrics"].items()}
        if other is row or other["step_us"] > row["step_us"] or not mine.keys() <= theirs.keys():
            continue
        ratios = [theirs[metric] / max(mine[metric], 1e-12) for metric in mine]
        clearly = min(ratios) * CLOSE < 1 or other["step_us"] * CLOSE < row["step_us"]
        if max(ratios) <= SAME and clearly:
            return other["name"]
    return None


def write_table(found: dict, file: Path) -> str:
    """Write the Markdown table to a file, and return it as text."""
    lines = [f"Truth: {found['truth']}.", ""]
    lines += [f"- {check['what']}: {check['error']:+.1e}" for check in found["checks"]]
    calibrated = " and ".join(found["calibration"])
    lines += [
        "",
        f"Gains of the settings below L4 are fitted on: {calibrated}. An error is the RMS over four places less than a "
        "taxel apart. Median (range) over the other cases:",
        "",
    ]
    lines += _figures(found["summary"], [*COSTS, "taxels/s"], tuple(MEASURES))
    slower = [(row["name"], row["dominated_by"]) for row in found["summary"] if row["dominated_by"]]
    lines += ["", "Settings that another one beats in cost and in every error:", ""]
    lines += [f"- {name} (by {by})" for name, by in slower] or ["- none"]
    text = "\n".join(lines) + "\n"
    file.write_text(text, encoding="utf-8")
    return text


COSTS = ("step µs", "still µs", "MB")
"""The columns of costs."""


def _figures(summary: list[dict], costs: Sequence[str], measures: Sequence[str]) -> list[str]:
    """Return the lines of the table of settings."""
    head = ["setting", *costs, *measures]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in summary:
        of_row = {
            "step µs": f"{row['step_us']:.0f}", "still µs": f"{row['still_us']:.0f}",
            "MB": f"{row['memory_bytes'] / 1e6:.1f}", "taxels/s": f"{row['updates_per_s']:.2g}",
        }  # fmt: skip
        cells = [row["name"], *(of_row[name] for name in costs)]
        cells += [_cell(row["metrics"].get(name), name) for name in measures]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def write_page(found: dict, page: Path) -> None:
    """Write the figures into a page, in the place of its table whose first column is "setting"."""
    text = page.read_text(encoding="utf-8")
    start = text.index("| setting |")
    end = text.find("\n\n", start)
    rest = text[end:] if end >= 0 else "\n"
    table = "\n".join(_figures(found["summary"], COSTS, JUDGED))
    page.write_text(text[:start] + table + rest, encoding="utf-8")


def read_costs(text: str) -> dict[str, dict[str, Any]]:
    """Return the costs in the table of a page, by setting: the fields of ``Cost``."""
    head, rows = _cells(text)
    step, still, size = (head.index(name) for name in COSTS)
    return {
        row[0]: {
            "step_us": float(row[step]),
            "still_us": float(row[still]),
            "memory_bytes": round(1e6 * float(row[size])),
        }
        for row in rows
    }


def _cells(text: str) -> tuple[list[str], list[list[str]]]:
    """Return the head and the rows of the first table whose first column is "setting"."""
    lines = text[text.index("| setting |") :].split("\n\n")[0].splitlines()
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return head, rows


def read_table(text: str) -> list[dict]:
    """Return the settings of a table that :func:`write_table` wrote, with cost, level and medians as percentages say.

    Args:
        text: a Markdown page; its first table whose first column is "setting" is read.
    """
    head, rows = _cells(text)
    found = []
    for row in rows:
        medians = {name: float(cell.split(" %")[0]) / 100 for name, cell in zip(head, row) if " %" in cell}
        metrics = {name: {"median": value} for name, value in medians.items()}
        cost = float(row[head.index("step µs")])
        found.append({"name": row[0], "level": int(row[0][1]), "step_us": cost, "metrics": metrics})
    return found


def _cell(value: dict | None, metric: str) -> str:
    if value is None:
        return ""
    if metric == "centre":
        return f"{value['median']:.3f} mm (..{value['high']:.2f})"
    return f"{_percent(value['median'])} ({_percent(value['low'])} … {_percent(value['high'])})"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %" if abs(value) < 0.0995 else f"{100 * value:.0f} %"
