"""The summary of all cases in one line per setting: medians, ranges, and the settings that others dominate."""

from __future__ import annotations

from pathlib import Path
from statistics import median

from tactemu.tune.trade.errors import METRICS

NARROW = ("thin wedge", "box edge, 0.2 mm")
"""Contacts narrower than a taxel, which are shown apart because point-sampled levels miss them altogether."""
SHOWN = ("normal force", "tangential force", "pressure", "contact area", "overlap of areas", "centre")
SHOWN += ("normal motion", "tangential motion")
JUDGED = ("normal force", "pressure", "normal motion", "tangential motion", "tangential force")
"""Metrics of the picture and of the comparison of settings."""
CLOSE = 1.1
"""The factor by which a setting that dominates another is better in error or in speed, being no worse in both."""
SAME = 1.02
"""Errors within this factor count as equal."""


def summarise(settings: list[dict]) -> list[dict]:
    """Return median and range of each setting and metric over the cases not used to calibrate it, narrow contacts
    apart."""
    rows = []
    for setting in settings:
        row = {"name": setting["name"], "level": setting["level"], **setting["cost"], "metrics": {}}
        for metric in METRICS:
            values = _values(setting, metric, narrow=False)
            if not values:
                continue
            sizes = [abs(value) for value in values]
            row["metrics"][metric] = {
                "median": median(sizes),
                "low": min(values),
                "high": max(values),
                "narrow": max((abs(v) for v in _values(setting, metric, narrow=True)), default=None),
            }
        rows.append(row)
    for row in rows:
        row["dominated_by"] = _dominator(row, rows)
    return rows


def _values(setting: dict, metric: str, *, narrow: bool) -> list[float]:
    """Return the errors of a metric; those of tangential forces only from cases in which the object slides or rolls."""
    values = []
    for name, errors in setting["errors"].items():
        wanted = name.startswith(NARROW) == narrow and name not in setting["calibrated_on"]
        if metric == "tangential force":
            wanted = wanted and name.endswith(("slide", "roll"))
        if wanted and errors.get(metric) is not None:
            values.append(errors[metric])
    return values


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
        f"Gains of the settings below L4 are fitted on: {calibrated}. Median of |error| (range), other cases:",
        "",
    ]
    head = ["setting", "step µs", "still µs", "taxels/s", "MB", *SHOWN]
    lines += ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in found["summary"]:
        cells = [row["name"], f"{row['step_us']:.0f}", f"{row['still_us']:.0f}", f"{row['updates_per_s']:.2g}"]
        cells += [f"{row['memory_bytes'] / 1e6:.1f}"]
        cells += [_cell(row["metrics"].get(metric), metric) for metric in SHOWN]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", f"Worst error where the contact is narrower than a taxel ({', '.join(NARROW)}):", ""]
    lines += ["| setting | normal force | pressure | tangential motion |", "|---|---|---|---|"]
    for row in found["summary"]:
        parts = [row["metrics"].get(metric, {}).get("narrow") for metric in ("normal force", "pressure")]
        parts.append(row["metrics"].get("tangential motion", {}).get("narrow"))
        if any(part is not None for part in parts):
            lines.append(f"| {row['name']} | " + " | ".join("" if p is None else f"{p:.1%}" for p in parts) + " |")
    slower = [(row["name"], row["dominated_by"]) for row in found["summary"] if row["dominated_by"]]
    lines += ["", "Settings that another one beats in cost and in every error:", ""]
    lines += [f"- {name} (by {by})" for name, by in slower] or ["- none"]
    text = "\n".join(lines) + "\n"
    file.write_text(text, encoding="utf-8")
    return text


def read_table(text: str) -> list[dict]:
    """Return the settings of a table that :func:`write_table` wrote, with cost, level and medians as percentages say.

    Args:
        text: a Markdown page; its first table whose first column is "setting" is read.
    """
    lines = text[text.index("| setting |") :].split("\n\n")[0].splitlines()
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
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
    return f"{_percent(value['median'])} ({_percent(value['low'])} .. {_percent(value['high'])})"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %" if abs(value) < 0.0995 else f"{100 * value:.0f} %"
