#!/usr/bin/env python3
"""Write the pages of the devices: docs/judges.md from the client recordings, docs/assumed.md and docs/devices.md from
the device files, and a picture of each layout in docs/pictures/devices.

usage: scripts/device_pages.py [--check]      --check writes nothing; it fails where a page is stale
"""

import math
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import firmware_protocols as fp
from scripts.contents import with_contents
from tactemu.cli import listing
from tests.clients.recording import Recording, recordings

JUDGES = """# Which drivers have read each device

Each driver in this table ran, unmodified, from open to close on a port of tactemu. What it sent, what it received and
what it decoded are kept as a *client recording* in `tests/data/clients/`. Every run of the tests sends the driver's
bytes again, in virtual time, and requires the same answers, byte for byte, and the same decoded values.

| column | meaning |
| --- | --- |
| what it did | the calls of the driver, in order |
| values | the number of values that the driver reported; each of them equalled a value of a sample |
| left over | the counter of bytes that the model did not understand, refused, or took for another device's, and why |

`python -m tests.clients.record -h` explains how to make a recording. To run a driver again: `scripts/judges NAME` if it
is in a package index; `tactemu exec DEVICE -- COMMAND` with a checkout of its repository if it is not. Written by
`scripts/device_pages.py`.

"""
ASSUMED = """# The facts behind each model

A device file declares the facts about its sensor that its byte tables do not contain: sensitivities and places of
taxels (part *touch*), names and versions (*identity*), settings, defaults and refusals (*configuration*), rates and
delays (*timing*). A fact is *stated* by a source (repository, file and line), *measured* on a recording of a real
sensor, or *assumed*: then it is the model's choice, because none of the files that the last column names states it.

Numbers of messages, commands and registers are as in the device's datasheet, mostly in hexadecimal. `tactemu devices
NAME` prints the datasheet with these facts. Written by `scripts/device_pages.py` from the device files.

"""
DEVICES = """# Devices

Each device is a model of a sensor's firmware, in one file. `tactemu devices NAME` prints its datasheet: frames,
commands, taxels, sources, assumptions. The pictures show the taxels along the axis of least extent, a colour for each
patch.

The column "evidence" names the kinds of sources of a device's byte tables, and links to [all its facts](assumed.md),
each with its source or marked as assumed. *Captured* is a recording of a real sensor, *vendor document* a manual or
protocol sheet, *firmware* the code on the sensor, *driver* the code of a program that reads it. Sensitivities that
vendors do not publish (counts per newton, field per newton) are round numbers; every datasheet lists them as assumed.

The column "read by" names the *judges* of a model: the unmodified drivers that have read it from open to close, as
repository and commit or as package and version. The tests send the recorded bytes of each driver again.
[judges.md](judges.md) lists the values that each driver read.

To add a sensor that is missing, write one file: [adding a device](adding-a-device.md). The file can stay outside this
repository (`tactemu run path/to/device.py:Class`), and `tactemu check` checks it. Made by `scripts/device_pages.py`.

"""
PICTURES = Path("pictures/devices")
"""The folder of the pictures, in docs."""
PICTURE_PX = 96
MAX_DOTS = 2500
"""Maximum number of dots in a picture; of more taxels, only every second or third row and column is drawn."""
_CIRCLE = re.compile(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="([\d.]+)" fill="(#\w+)">')


def _cell(text: str) -> str:
    return " ".join(str(text).split()).replace("|", "\\|")


def judges() -> str:
    """Return the page of drivers."""
    found: dict[str, list[Recording]] = {name: [] for name in sorted(fp.DEVICES)}
    for path in recordings():
        recording = Recording.load(path)
        found[recording.about["device"]].append(recording)
    read = sum(map(bool, found.values()))
    lines = [f"{read} of {len(found)} devices have been read by such a driver.", ""]
    lines += [
        "| device | driver | what it did | values | left over | date |",
        "| --- | --- | --- | ---: | --- | --- |",
    ]
    for name, own in found.items():
        for each in own:
            about = each.about
            version = f"@{about['commit']}" if "commit" in about else f" {about['version']}"
            driver = f"{about['repository']}{version}, {about['language']}, {about['licence']}"
            left = "; ".join(f"{counter}: {why}" for counter, why in about.get("expected_counters", {}).items())
            calls = ", ".join(about["calls"]) + (f". {about['note']}" if "note" in about else "")
            lines.append(
                f"| `{name}` | {_cell(driver)} | {_cell(calls)} | {each.compared:,} | {_cell(left) or 'none'} "
                f"| {about['date']} |"
            )
    unread = [f"| `{name}` | {_cell(fp.create(name).judge)} |" for name, own in found.items() if not own]
    if unread:
        lines += ["", "## Without a recording", "", "| device | read by |", "| --- | --- |", *unread]
    return JUDGES + "\n".join(lines) + "\n"


def assumed() -> str:
    """Return the page of facts."""
    facts = {name: fp.create(name).facts for name in sorted(fp.DEVICES)}
    lines = ["| device | stated | measured | assumed |", "| --- | ---: | ---: | ---: |"]
    total = [0, 0, 0]
    for name, own in facts.items():
        numbers = [sum(fact.basis == basis for fact in own) for basis in ("stated", "measured", "assumed")]
        total = [a + b for a, b in zip(total, numbers, strict=True)]
        lines.append(f"| [`{name}`](#{name}) | {' | '.join(map(str, numbers))} |")
    lines.append(f"| all | {' | '.join(map(str, total))} |")
    for name, own in facts.items():
        lines += ["", f"## {name}", "", "| part | basis | fact | source |", "| --- | --- | --- | --- |"]
        order = ("touch", "identity", "configuration", "timing")
        for fact in sorted(own, key=lambda fact: (order.index(fact.part), fact.basis != "stated")):
            where = ("not in " if fact.basis == "assumed" else "") + fact.where
            lines.append(f"| {fact.part} | {fact.basis} | {_cell(fact.what)} | {_cell(where)} |")
    return ASSUMED + "\n".join(lines) + "\n"


def devices() -> str:
    """Return the page of devices: a table for each kind."""
    lines = []
    for heading, found in listing.by_kind([listing.row_or_error(name) for name in sorted(fp.DEVICES)]):
        lines += [f"## {heading}", "", "| taxels | name | sensor | ports | evidence | read by |", "| --- " * 6 + "|"]
        for row in found:
            name, module = row["name"], fp.DEVICES[row["name"]].partition(":")[0]
            picture = f" ![{name}]({PICTURES}/{name}.svg)" if row["taxels"] else ""
            cells = (
                f"{row['taxels']}{picture}", f"[`{name}`](../{module.replace('.', '/')}.py)", row["title"],
                ", ".join(row["ports"]), f"[{', '.join(row['evidence'])}](assumed.md#{name})", row["judge"],
            )  # fmt: skip
            lines.append(f"| {' | '.join(map(_cell, cells))} |")
        lines.append("")
    return with_contents(DEVICES + "\n".join(lines))


def pictures() -> dict[str, str]:
    """Return the picture of each layout by its file's name."""
    layouts = {name: fp.create(name).layout for name in sorted(fp.DEVICES)}
    return {f"{name}.svg": small_picture(layout) for name, layout in layouts.items() if len(layout)}


def small_picture(layout: fp.Layout) -> str:
    """Return the drawing of a layout in few bytes: a path of dots for each colour, without background."""
    drawn = layout.picture()
    view = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawn)
    assert view is not None
    width, height = map(float, view.groups())
    circles = [(float(x), float(y), float(r), colour) for x, y, r, colour in _CIRCLE.findall(drawn)]
    step = math.ceil(math.sqrt(len(circles) / MAX_DOTS))
    columns, rows = ({value: k for k, value in enumerate(sorted({c[axis] for c in circles}))} for axis in (0, 1))
    paths: dict[str, str] = {}
    for x, y, _, colour in circles:
        if columns[x] % step == rows[y] % step == 0:
            paths[colour] = f"{paths.get(colour, '')}M{x:g} {y:g}h0"
    px = PICTURE_PX / max(width, height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * px:.0f}" height="{height * px:.0f}" '
        f'viewBox="0 0 {width:g} {height:g}" stroke-width="{2 * step * circles[0][2]:g}" stroke-linecap="round">'
    ]
    lines += [f'<path stroke="{colour}" d="{path}"/>' for colour, path in paths.items()]
    return "\n".join([*lines, "</svg>", ""])


def main() -> int:
    """Write the pages, or compare them, and return the exit status."""
    stale, docs = [], ROOT / "docs"
    pages = {"judges.md": judges(), "assumed.md": assumed(), "devices.md": devices()}
    pages |= {f"{PICTURES}/{name}": text for name, text in pictures().items()}
    for name, text in pages.items():
        page = docs / name
        if "--check" in sys.argv:
            stale += [name] if not page.exists() or page.read_text() != text else []
        else:
            page.parent.mkdir(parents=True, exist_ok=True)
            page.write_text(text)
    for page in (docs / PICTURES).glob("*"):
        if f"{PICTURES}/{page.name}" in pages:
            continue
        if "--check" in sys.argv:
            stale.append(f"{PICTURES}/{page.name} (of no device)")
        else:
            page.unlink()
    if stale:
        print(f"{', '.join(stale)}: not as the devices and recordings say; run scripts/device_pages.py")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
