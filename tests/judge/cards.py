"""``python -m tests.judge.cards``: ten published drivers, judged by ``tactemu judge``, and the page of it.

``--driver NAME`` judges only one (repeatable), ``--page FILE`` writes the page from all that were judged so far.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

from tactemu.judge import smallest_case
from tactemu.judge.outcome import FAILING

PAGE = Path("docs/drivers-under-faults.md")
FOLDER = Path("build/cards")
ROOT = Path(__file__).parents[2]
SCRIPT = Path(__file__).with_name("published.py")


@dataclass(frozen=True, kw_only=True)
class Card:
    """One driver, and the device that it reads."""

    device: str
    port: str = ""
    wrong_baud: int | None = None
    """Another rate than the device's; ``None``: USB, TCP and CAN do not care."""
    notes: Sequence[str] = ()
    """What its code says to the verdicts."""

    def options(self) -> list[str]:
        """Of ``tactemu judge``."""
        return ["--port", self.port] if self.port else []


MODBUS = "An RTU answer has no number: one that comes late or unasked is taken for the answer to the next request."
MAGNETIC = (
    "No checksum: 82 bytes are a frame if they end in `0D 0A`. A flipped bit is a wrong field, and one in an exponent "
    "an absurd one; a frame that is too short or too long costs itself and, as a rule, the next.",
    "No time-out: it waits for ever, in a loop that takes a whole core. A pulled cable raises at once.",
)
CARDS = {
    "anyskin": Card(device="anyskin", notes=MAGNETIC),
    "reskin-sensor": Card(device="anyskin", notes=MAGNETIC),
    "pyrobotiqtactile": Card(
        device="robotiq_tsf85",
        notes=(
            "The checksum in the header is used by nobody: flipped bits become pressures.",
            "`read_frame()` returns on any bytes at all, so that every other reading is the one before; when its "
            "time-out passes it returns the last reading once more and raises nothing.",
            "A sensor that restarts has forgotten to stream. The driver has asked once and does not ask again.",
        ),
    ),
    "flexitac": Card(
        device="flexitac", wrong_baud=1_000_000,
        notes=(
            "It waits for 1024 bytes and takes one image of 386 from them: it falls behind, and then drops images "
            "itself, faults or not. `read_latest()` does not.",
            "No checksum, no length: an image that lacks bytes is filled up with the next one.",
        ),
    ),
    "optoforce": Card(
        device="optoforce",
        notes=(
            "Every fault shows: in `valid_checksum`, which the driver leaves to its user, and in `count`, where lost, "
            "repeated and old packets show.",
            "No time-out: `read()` waits for ever.",
        ),
    ),
    "ability-hand": Card(
        device="ability_hand", wrong_baud=921_600,
        notes=(
            "When the port goes, its read thread logs the exception and goes on with the dead handle, for ever. "
            "Nothing is raised: the hand's last state stays.",
        ),
    ),
    "pymodbus": Card(
        device="inspire_rh56dftp", wrong_baud=57_600,
        notes=(
            "The CRC lets no wrong register through; each bad or missing answer is one exception, after the time-out.",
            MODBUS,
        ),
    ),
    "modbus_tk": Card(device="inspire_rh56dftp", wrong_baud=57_600, notes=(MODBUS,)),
    "plusml-rh56dftp": Card(
        device="inspire_rh56dftp", port="tcp:127.0.0.1:0",
        notes=("A lost answer raises nothing: the driver waits 3 s, which cannot be set, and asks up to three times.",),
    ),
    "linkerbot": Card(
        device="linker_hand_l6",
        notes=(
            "A row says which row it is but not of which sample: one that is late, repeated or old can end up in "
            "another matrix, which then mixes two moments.",
            "A lost row costs the whole hand's reading, after the time-out (here 0.5 s): one `TimeoutError` each.",
        ),
    ),
}  # fmt: skip

INTRO = """\
# Drivers under faults

How ten published drivers of tactile skins cope with what goes wrong on a wire: the report cards that
[`tactemu judge`](judge.md) gives them. Each driver is unmodified and runs in a process of its own, in a loop that
prints each reading and each exception, and opens the port again when the driver says that it is gone (`{script}`).

This page is written by the run that it describes; verdicts and bytes are the judge's, the notes under a driver's name
say what its code does:

```sh
python -m tests.judge.cards --page {page}    # all of it, about twenty minutes
python -m tests.judge.cards --driver optoforce                      # one of it
```

Run on {machine}. What the words mean: [verdicts](judge.md#how-it-is-judged). Bold ones fail a run. *Noticed*: the
driver raised or said something new, or marked the reading; every reading that it handed out as good was right. An empty
cell: the trial makes no sense there, for the reason that stands below.

## At a glance

"""


def judge(name: str) -> None:
    """Judge one driver; its report is kept in :data:`FOLDER`."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    card = CARDS[name]
    command = [sys.executable, "-m", "tactemu", "judge", card.device, *card.options(), "--json", str(report_of(name))]
    subprocess.run([*command, "--", sys.executable, str(SCRIPT), name, "{port}"], check=False)


def report_of(name: str) -> Path:
    """Where a driver's report is kept."""
    return FOLDER / f"{name}.json"


def word(trial: Mapping[str, Any]) -> str:
    """The worst that happened, in a word or two."""
    if trial["skipped"]:
        return ""
    if trial["findings"] and trial["confirmed"] is not False:
        kind = trial["findings"][0]["kind"]
        return f"**{kind}**" if kind in FAILING else kind
    return "noticed" if trial["verdict"].startswith("noticed") else "right"


def page(reports: Mapping[str, Mapping[str, Any]]) -> str:
    """The whole page."""
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    trials = list(dict.fromkeys(trial["name"] for report in reports.values() for trial in report["trials"]))
    cells = {name: {trial["name"]: word(trial) for trial in report["trials"]} for name, report in reports.items()}
    tried = [trial for trial in trials if any(cells[name].get(trial) for name in cells)]
    rows = [[f"`{trial}`", *(cells[name].get(trial, "") for name in reports)] for trial in tried]
    parts = [
        INTRO.format(machine=machine, page=PAGE, script=SCRIPT.relative_to(ROOT)),
        table(["trial", *reports], rows),
    ]
    return "".join([*parts, "\n## Driver by driver\n", *(driver(name, report) for name, report in reports.items())])


def driver(name: str, report: Mapping[str, Any]) -> str:
    """A driver's part of the page."""
    card = CARDS[name]
    notes = "".join(
        f"{fill(f'* {note}', 120, subsequent_indent='  ', break_on_hyphens=False)}\n" for note in card.notes
    )
    tried = [trial for trial in report["trials"] if not trial["skipped"]]
    rows = [[f"`{trial['name']}`", trial["why"], cell(trial["verdict"])] for trial in tried]
    skipped = [f"`{trial['name']}` ({trial['skipped']})" for trial in report["trials"] if trial["skipped"]]
    not_tried = f"\nNot tried: {'; '.join(skipped)}.\n" if skipped else ""
    cases = "".join(
        f"\n`{trial['name']}`, smallest case:\n\n```\n{case(trial['case'])}\n```\n" for trial in tried if trial["case"]
    )
    head = f"\n### {name} {importlib.metadata.version(name)} on `{card.device}`\n\n{''.join(notes)}\n"
    return f"{head}{table(['trial', 'what happens', 'verdict'], rows)}{not_tried}{cases}"


def cell(text: str) -> str:
    """A verdict, as it goes into a table: without the places of this machine."""
    return text.replace("|", "\\|").replace(f"{ROOT}/", "")[:300]


def case(found: Mapping[str, Any]) -> str:
    """The smallest case in words, without the command's place on this machine."""
    return smallest_case.in_words({**found, "command": ["python", *found["command"][1:]]}).replace(f"{ROOT}/", "")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """As Markdown."""
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rows))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.judge.cards", description=__doc__)
    parser.add_argument("--driver", action="append", choices=CARDS, help="only this one; repeatable")
    parser.add_argument("--page", type=Path, help=f"write the page from all reports, such as {PAGE}")
    parser.add_argument("--no-run", action="store_true", help="only write the page")
    options = parser.parse_args()
    for name in [] if options.no_run else options.driver or CARDS:
        judge(name)
    if options.page:
        reports = {name: json.loads(report_of(name).read_text()) for name in CARDS if report_of(name).exists()}
        options.page.write_text(page(reports), encoding="utf-8")


if __name__ == "__main__":
    main()
