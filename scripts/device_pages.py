#!/usr/bin/env python3
"""Write docs/judges.md from the client recordings and docs/assumed.md from the device files.

usage: scripts/device_pages.py [--check]      --check writes nothing; it fails where a page is stale
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import firmware_protocols as fp
from tests.clients.recording import Recording, recordings

JUDGES = """# Which drivers have read each device

These unmodified drivers ran from open to close on a port of tactemu. What each of them sent, what it got and what it
decoded is kept as a *client recording* in `tests/data/clients/`. Every run of the tests sends the driver's bytes again,
in virtual time, and requires every answer byte for byte and every decoded value to equal the truth. *Values* counts
what the driver reported; each of them equalled a sample. Nothing that a driver sent was left over (not understood,
refused, addressed to another device), except what its own search causes, which is named.

`python -m tests.clients.record -h` says how a recording is made. Drivers from a package index are run again by
`scripts/judges NAME`; one that lives in a repository alone by `tactemu exec DEVICE -- COMMAND` with a checkout of it.
Made by `scripts/device_pages.py`.

"""
ASSUMED = """# What each model rests on

What a model states beside its byte tables, item by item: *stated* by a source (repository, file and line),
*measured* on a recording of a real sensor, or *assumed*, with the files that were read and do not say it.
`tactemu devices NAME` shows the same for one device. Made from the device files by `scripts/device_pages.py`.

"""


def _cell(text: str) -> str:
    return " ".join(str(text).split()).replace("|", "\\|")


def judges() -> str:
    """Return the page of drivers."""
    found: dict[str, list[Recording]] = {name: [] for name in sorted(fp.DEVICES)}
    for path in recordings():
        recording = Recording.load(path)
        found[recording.about["device"]].append(recording)
    read = sum(map(bool, found.values()))
    lines = [f"{read} of {len(found)} devices have been read so.", ""]
    lines += [
        "| device | driver | what it did | values | named counters | date |",
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
    lines += ["", "## Without a recording", "", "| device | read by |", "| --- | --- |"]
    lines += [f"| `{name}` | {_cell(fp.create(name).judge)} |" for name, own in found.items() if not own]
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
        lines += ["", f"## {name}", "", "| part | | fact | where |", "| --- | --- | --- | --- |"]
        order = ("touch", "identity", "configuration", "timing")
        for fact in sorted(own, key=lambda fact: (order.index(fact.part), fact.basis != "stated")):
            where = ("read in vain: " if fact.basis == "assumed" else "") + fact.where
            lines.append(f"| {fact.part} | {fact.basis} | {_cell(fact.what)} | {_cell(where)} |")
    return ASSUMED + "\n".join(lines) + "\n"


def main() -> int:
    """Write the pages, or compare them, and return the exit status."""
    stale = []
    for name, text in (("judges.md", judges()), ("assumed.md", assumed())):
        page = ROOT / "docs" / name
        if "--check" in sys.argv:
            stale += [name] if not page.exists() or page.read_text() != text else []
        else:
            page.write_text(text)
    if stale:
        print(f"{', '.join(stale)}: not as the devices and recordings say; run scripts/device_pages.py")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
