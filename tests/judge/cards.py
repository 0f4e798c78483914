"""Report cards of ten published drivers by ``tactemu judge``, and their page: ``python -m tests.judge.cards``.

``--driver NAME`` judges only one (repeatable), ``--page FILE`` writes the page from all reports so far.
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

from scripts.contents import anchor
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
    """A line speed other than the device's; ``None`` for USB, TCP and CAN, where it has no effect."""
    notes: Sequence[str] = ()
    """Explanations of the verdicts by the driver's code."""

    def options(self) -> list[str]:
        """Return the options of ``tactemu judge``."""
        return ["--port", self.port] if self.port else []


MODBUS = (
    "A Modbus RTU answer carries no transaction number: the driver takes one that arrives late, or that it never "
    "requested, for the answer to its next request."
)
MAGNETIC = (
    "The frame has no checksum: 82 bytes are a frame if they end in `0D 0A`. A flipped bit gives a wrong value of the "
    "magnetic field, and an absurd one if it is in an exponent. A frame that is too short or too long is lost, and "
    "usually the next one with it.",
    "The driver has no timeout: it waits forever, in a loop that uses a whole core. Unplugging raises an exception at "
    "once.",
)
CARDS = {
    "anyskin": Card(device="anyskin", notes=MAGNETIC),
    "reskin-sensor": Card(device="anyskin", notes=MAGNETIC),
    "pyrobotiqtactile": Card(
        device="robotiq_tsf85",
        notes=(
            "The driver ignores the checksum in the header: flipped bits become wrong pressures.",
            "`read_frame()` returns as soon as any bytes arrive, so that every other reading repeats the previous one. "
            "After its timeout it returns the last reading once more and raises nothing.",
            "After a restart the sensor no longer streams: the driver requests the stream only once.",
        ),
    ),
    "flexitac": Card(
        device="flexitac", wrong_baud=1_000_000,
        notes=(
            "The driver waits for 1024 bytes and takes one image of 386 bytes from them: it falls behind, and then "
            "drops images itself, even without faults. `read_latest()` does not.",
            "The frame has neither checksum nor length: an image that lacks bytes is filled up from the next one.",
        ),
    ),
    "optoforce": Card(
        device="optoforce",
        notes=(
            "The user can see every fault: `valid_checksum`, which the user must check, shows damaged packets, and "
            "`count` shows lost, repeated and old ones.",
            "The driver has no timeout: `read()` waits forever.",
        ),
    ),
    "ability-hand": Card(
        device="ability_hand", wrong_baud=921_600,
        notes=(
            "When the port disappears, the driver's read thread logs the exception and continues forever with the dead "
            "handle. Nothing is raised: the user keeps reading the hand's last state.",
        ),
    ),
    "pymodbus": Card(
        device="inspire_rh56dftp", wrong_baud=57_600,
        notes=(
            "The CRC rejects every damaged answer. Each bad or missing answer raises one exception, after the timeout.",
            MODBUS,
        ),
    ),
    "modbus_tk": Card(device="inspire_rh56dftp", wrong_baud=57_600, notes=(MODBUS,)),
    "plusml-rh56dftp": Card(
        device="inspire_rh56dftp", port="tcp:127.0.0.1:0",
        notes=("A lost answer raises nothing: the driver waits 3 s (fixed) and asks again, up to three times.",),
    ),
    "linkerbot": Card(
        device="linker_hand_l6",
        notes=(
            "Each CAN frame holds one row of a taxel matrix, with its row number but no sample number: a row that is "
            "late, repeated or old can end up in a later matrix, which then mixes two samples.",
            "If one row is lost, so is the reading of the whole hand: the driver raises one `TimeoutError`, after its "
            "timeout (0.5 s here).",
        ),
    ),
}  # fmt: skip

INTRO = """\
# Drivers under faults

These are the report cards of [`tactemu judge`](judge.md) for ten published drivers of tactile skins: what each driver
does when the wire or the device fails. Each driver is unmodified and runs in a process of its own: a small program
(`{script}`) calls it in a loop, prints each reading and each exception, and opens the port again when the
driver reports that it is lost.

A program writes this page: verdicts and bytes are the judge's, and the notes under each driver's name explain the
verdicts from the driver's source code. To repeat the run:

<!-- not run: it writes this page, in twenty minutes -->
```sh
python -m tests.judge.cards --page {page}    # all drivers, about twenty minutes
python -m tests.judge.cards --driver optoforce                      # one driver
```

The run was on {machine}. [Verdicts](judge.md#how-it-is-judged) explains the words; those in bold fail a
run. *Noticed* means that the driver raised or printed something new, or marked the reading, and that every reading
which it reported as good was right. An empty cell means that the trial does not apply to the driver or its device; the
line "Not tried" below the driver's table gives reasons.

## At a glance

"""


def judge(name: str) -> None:
    """Judge one driver, and write its report to :data:`FOLDER`."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    card = CARDS[name]
    command = [sys.executable, "-m", "tactemu", "judge", card.device, *card.options(), "--json", str(report_of(name))]
    subprocess.run([*command, "--", sys.executable, str(SCRIPT), name, "{port}"], check=False)


def report_of(name: str) -> Path:
    """Return the path of a driver's report."""
    return FOLDER / f"{name}.json"


def word(trial: Mapping[str, Any]) -> str:
    """Return the worst finding of a trial, or its verdict, in a word or two."""
    if trial["skipped"]:
        return ""
    if trial["findings"] and trial["confirmed"] is not False:
        kind = trial["findings"][0]["kind"]
        return f"**{kind}**" if kind in FAILING else kind
    return "noticed" if trial["verdict"].startswith("noticed") else "right"


def page(reports: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page with all report cards."""
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    trials = list(dict.fromkeys(trial["name"] for report in reports.values() for trial in report["trials"]))
    cells = {name: {trial["name"]: word(trial) for trial in report["trials"]} for name, report in reports.items()}
    tried = [trial for trial in trials if any(cells[name].get(trial) for name in cells)]
    rows = [[f"`{trial}`", *(cells[name].get(trial, "") for name in reports)] for trial in tried]
    parts = [
        INTRO.format(machine=machine, page=PAGE, script=SCRIPT.relative_to(ROOT)),
        table(["trial", *(f"[{name}](#{anchor(heading(name))})" for name in reports)], rows),
    ]
    return "".join([*parts, "\n## Driver by driver\n", *(driver(name, report) for name, report in reports.items())])


def heading(name: str) -> str:
    """Return the heading of a driver's section."""
    return f"{name} {importlib.metadata.version(name)} on `{CARDS[name].device}`"


def driver(name: str, report: Mapping[str, Any]) -> str:
    """Return the section of a driver."""
    card = CARDS[name]
    notes = "".join(
        f"{fill(f'* {note}', 120, subsequent_indent='  ', break_on_hyphens=False)}\n" for note in card.notes
    )
    tried = [trial for trial in report["trials"] if not trial["skipped"]]
    rows = [[f"`{trial['name']}`", trial["why"], cell(trial["verdict"])] for trial in tried]
    skipped = [f"`{trial['name']}` ({trial['skipped']})" for trial in report["trials"] if trial["skipped"]]
    not_tried = f"\nNot tried: {'; '.join(skipped)}.\n" if skipped else ""
    cases = "".join(
        f"\n`{trial['name']}`, smallest case:\n\n```text\n{case(trial['case'])}\n```\n"
        for trial in tried
        if trial["case"]
    )
    head = f"\n### {heading(name)}\n\n{''.join(notes)}\n"
    return f"{head}{table(['trial', 'what happens', 'verdict'], rows)}{not_tried}{cases}"


def cell(text: str) -> str:
    """Return a verdict as the cell of a table, without paths of this machine."""
    return text.replace("|", "\\|").replace(f"{ROOT}/", "")[:300]


def case(found: Mapping[str, Any]) -> str:
    """Return a smallest case as text, without paths of this machine."""
    return smallest_case.in_words({**found, "command": ["python", *found["command"][1:]]}).replace(f"{ROOT}/", "")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rows))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.judge.cards", description=__doc__)
    parser.add_argument("--driver", action="append", choices=CARDS, help="judge only this driver; repeatable")
    parser.add_argument("--page", type=Path, help=f"write the page from all reports, such as {PAGE}")
    parser.add_argument("--no-run", action="store_true", help="judge no driver, only write the page")
    options = parser.parse_args()
    for name in [] if options.no_run else options.driver or CARDS:
        judge(name)
    if options.page:
        reports = {name: json.loads(report_of(name).read_text()) for name in CARDS if report_of(name).exists()}
        options.page.write_text(page(reports), encoding="utf-8")


if __name__ == "__main__":
    main()
