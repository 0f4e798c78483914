"""``tactemu devices``: the table of all devices. Rows of this package come from a file, so that none is imported.

``devices.json`` beside this module has these rows; ``python tests/test_readme.py --write`` writes it, and a test
compares it. Other devices are imported: those of other packages, and those registered since it was written.
"""

from __future__ import annotations

import json as json_module
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from firmware_protocols.registry import DEVICES, names
from tactemu.cli.fitting import cell_lines, output_width

FILE = Path(__file__).with_name("devices.json")

KINDS = {
    # firmware_protocols.device.DeviceKind: the heading
    "hand": "Hands, grippers and their servos",
    "fingertip": "Fingertips and pads",
    "glove": "Gloves",
    "force-torque sensor": "Force-torque sensors",
    "skin": "Skins and gateways",
    "": "Others",
}
ALL_COLUMNS_WIDTH = 120
"""Minimum width of the table with all columns; a narrower one has name, what, ports and taxels [characters]."""


def print_table(*, json: bool = False) -> None:
    """Print name, ports, taxels, rate, evidence and judge of every device, or the error of one that cannot be made."""
    if json:
        print(json_module.dumps(rows()))
        return
    width = output_width()
    print("\n".join(table(rows(), width)))
    if width < ALL_COLUMNS_WIDTH:
        print("\n`tactemu devices NAME` also prints rates, evidence and drivers.")


def rows() -> list[dict[str, Any]]:
    """Return the row of every device, as ``tactemu devices --json`` prints it; for a broken one, name and error."""
    written = {row["name"]: row for row in json_module.loads(FILE.read_text())}
    return [written[name] if name in DEVICES and name in written else row_or_error(name) for name in names()]


def row_or_error(name: str) -> dict[str, Any]:
    """Make a device and return its row. A device of another package may fail in any way; then the row has its error."""
    try:
        from tactemu.cli.datasheet import make_device, row_of

        return row_of(name, make_device(name, {}))
    except Exception as error:
        return {"name": name, "error": f"{type(error).__name__}: {error}"}


def by_kind(rows: Sequence[dict[str, Any]]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield each heading that has rows, with its rows; broken devices are among the others."""
    for kind, heading in KINDS.items():
        if found := [row for row in rows if row.get("kind", "") == kind]:
            yield heading, found


def table(rows: Sequence[dict[str, Any]], width: int) -> list[str]:
    """Return the lines of the table, at most ``width`` characters each unless words are longer."""
    name_width = max(len(row["name"]) for row in rows)
    widths = _widths(name_width, width)
    lines = list(_cells(("name", "what", "ports", "taxels", "rate", "evidence", "read by"), widths))
    for heading, found in by_kind(rows):
        lines += ["", heading]
        for row in found:
            if "error" in row:
                lines.append(f"{row['name']:<{name_width}}  cannot be made: {row['error']}")
                continue
            rates = dict.fromkeys(re.findall(r"[\d.]+ Hz|when asked", row["rate"]))
            texts = (row["name"], row["title"], ", ".join(row["ports"]), str(row["taxels"]), ", ".join(rates))
            lines += _cells((*texts, ", ".join(row["evidence"]), row["judge"]), widths)
    return lines


def _widths(name_width: int, width: int) -> list[int]:
    """Return the widths of the columns that fit [characters]."""
    if width < ALL_COLUMNS_WIDTH:
        remaining = width - name_width - 6 - 2 * 3
        return [name_width, remaining // 2, remaining - remaining // 2, 6]
    remaining = width - name_width - 6 - 12 - 2 * 6
    what, ports, evidence, judge = (int(remaining * share) for share in (0.28, 0.28, 0.18, 0.26))
    return [name_width, what, ports, 6, 12, evidence, judge]


def _cells(texts: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    """Yield the lines of a row, as many as its longest text needs; texts beyond the last column are left out."""
    columns = [cell_lines(text, width) for text, width in zip(texts, widths, strict=False)]
    for k in range(max(map(len, columns))):
        parts = (column[k] if k < len(column) else "" for column in columns)
        aligned = (
            f"{part:{'>' if part.isdecimal() else '<'}{width}}" for part, width in zip(parts, widths, strict=True)
        )
        yield "  ".join(aligned).rstrip()
