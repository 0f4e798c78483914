"""The output of ``tactemu judge``: each outcome when it is known, the end, and the files of the report."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.text import Text

from tactemu.base.errors import TactemuError, no_such
from tactemu.base.files import check_folder, check_writable
from tactemu.base.style import PAGE_SIGN
from tactemu.cli import INTERRUPTED
from tactemu.cli.consoles import message_console, print_row
from tactemu.cli.signals import ended_by_signals, interrupt
from tactemu.judge import smallest_case
from tactemu.judge.budget import EVERY_POSITION_BUDGET_S
from tactemu.judge.driver import check_finds_port, reading_command
from tactemu.judge.html_report import html_report
from tactemu.judge.junit_report import junit_report
from tactemu.judge.outcome import ABOUT, FAILING, Outcome
from tactemu.judge.processes import age_s
from tactemu.judge.report import Report, written
from tactemu.judge.success import as_data, as_text, read_script, success_curve
from tactemu.judge.trial_choice import check_names, planned_names
from tactemu.judge.trial_runner import Judge, JudgeOptions
from tactemu.judge.verdicts import judge_record

FAILED = 1
"""The exit code if a trial fails."""
WRONG_COMMAND = 2
"""The exit code if the driver ends at its first start before it reads anything."""
NOT_JUDGED = 3
"""The exit code if there was nothing to judge, or a task never succeeds without a fault."""

MAX_PRINTED_COLUMNS = 40
"""Largest number of the driver's columns that are printed; the report has all."""


def words_of(texts: Sequence[str]) -> tuple[str, ...]:
    """Return the words of an option that may be repeated, and takes several with commas."""
    return tuple(word.strip() for text in texts for word in text.split(",") if word.strip())


def kinds_of(words: Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of finding that fail a run.

    Raises:
        TactemuError: there is no such kind.
    """
    kinds = [word.replace("-", " ") for word in words_of(words)]
    if not kinds:
        return FAILING
    if unknown := [kind for kind in kinds if kind not in ABOUT and kind not in ("none", "all")]:
        raise TactemuError(f"--fail-on: {no_such('finding', unknown[0], [*ABOUT, 'all', 'none'])}")
    if "all" in kinds:
        return tuple(ABOUT)
    return tuple(kind for kind in kinds if kind != "none")


def reading_or_program(target: str, command: Sequence[str], reads: str | None, port: object = None) -> list[str]:
    """Return the driver's command line: the given one, or that of the Python function ``reads``.

    ``port``: the addresses of --port, if there are any; the driver may know them without a placeholder.

    Raises:
        TactemuError: there is neither, or both; or nothing tells the driver the port.
    """
    if bool(command) == bool(reads):
        raise TactemuError(
            f"name the driver's command after --, as in `tactemu judge {target} -- python driver.py {{port}}`, "
            "or give --reads package.module:function"
        )
    if reads:
        return reading_command(reads)
    if not port:
        check_finds_port(command)
    return _program(command)


def _program(command: Sequence[str]) -> list[str]:
    """Return a command line in which ``python`` is the one that runs this."""
    return [sys.executable if command[0] == "python" else command[0], *command[1:]]


@dataclass(frozen=True)
class ReportFiles:
    """The files of a report; None: not wanted."""

    html: Path | None = None
    junit: Path | None = None
    json: Path | None = None
    baseline: Path | None = None
    """An earlier report as JSON; only new findings fail."""
    cases: Path | None = None
    """A folder for the smallest case of each finding."""
    replay: Path | None = None
    """The only case that is run."""
    command: str = ""
    """The command line, which the page shows."""

    def check(self) -> None:
        """Raise TactemuError for a report that could not be written, or would overwrite a file of another program."""
        for path, sign in ((self.html, PAGE_SIGN), (self.junit, '"tactemu judge'), (self.json, '"tactemu":')):
            check_writable(path, "the report", sign)
        names = map(smallest_case.file_name, planned_names() if self.cases is not None else ())
        check_folder(self.cases, "the cases", names, smallest_case.SIGN)


def judge_driver(target: str, command: Sequence[str], options: JudgeOptions, files: ReportFiles) -> int:
    """Judge a driver, print and write the report, and return the exit code.

    Raises:
        TactemuError: the request is invalid, or cannot be met on this machine.
    """
    began, limit = time.monotonic() - age_s(), options.budget_s  # imports count: on a busy machine they take seconds
    options = replace(
        options, budget_s=began + limit - time.monotonic() if limit else None,
        every=(limit or 0.0) >= EVERY_POSITION_BUDGET_S,
    )  # fmt: skip
    files.check()
    check_names(options.only)
    report = Report(target, list(command), options.seed, options.fail_on)
    if files.baseline is not None:
        report.compare(files.baseline)
    case = smallest_case.read(files.replay) if files.replay is not None else None
    console = message_console()
    with ended_by_signals(interrupt), console.status("starting the driver") as status:
        with Judge(target, command, options, lambda text: status.update(f"{text} …")) as judge:
            try:
                for outcome in judge.run() if case is None else _replayed(judge, case):
                    report.outcomes.append(outcome)
                    if len(report.outcomes) == 1:
                        report.columns, report.asks = judge.columns.describe(), judge.known.asks
                        _print_columns(console, report)
                    print_outcome(console, report, outcome)
            except KeyboardInterrupt:
                report.interrupted = True
                report.outcomes += judge.left_out("the run was interrupted")
            judge.end()
            report.left_behind = judge.left_behind
    report.seconds = time.monotonic() - began
    _write(report, files)
    _print_end(console, report)
    if report.interrupted:
        return INTERRUPTED
    if judge.is_command_wrong:
        return WRONG_COMMAND
    if report.is_judged and report.failed:
        return FAILED
    return 0 if report.is_judged and not report.is_only_clean else NOT_JUDGED


def _replayed(judge: Judge, case: dict):
    """Yield the outcomes of the clean run and of the case."""
    yield judge.clean()
    if judge.columns.values:
        yield judge_record(judge.run_trial(smallest_case.trial_of(case)))


def _print_columns(console: Console, report: Report) -> None:
    if not report.columns:
        return
    console.print("Meaning of the driver's columns:")
    width = max(len(name) for name, _ in report.columns[:MAX_PRINTED_COLUMNS])
    for name, holds in report.columns[:MAX_PRINTED_COLUMNS]:
        print_row(console, Text(f"  {name:{width}} "), holds)
    if (left := len(report.columns) - MAX_PRINTED_COLUMNS) > 0:
        console.print(f"  … and {left} more")


def print_outcome(console: Console, report: Report, outcome: Outcome) -> None:
    """Print the outcome of a trial."""
    failing = report.failures(outcome)
    color = "red" if failing else "yellow" if outcome.findings else "dim" if outcome.skipped else "green"
    mark = "✗" if failing else "!" if outcome.findings else "-" if outcome.skipped else "✓"
    known = " (as in the baseline)" if outcome.findings and not failing and report.known else ""
    late = (
        f"  p50 {outcome.p50_ms:.1f} ms, p99 {outcome.p99_ms:.1f} ms"
        if outcome.name == "clean" and outcome.p50_ms
        else ""
    )
    head = Text(f"{mark} {outcome.name:18}", color)
    print_row(console, head, f"{outcome.verdict}{outcome.doubt}{known}{late}")
    if outcome.remark:
        print_row(console, Text(" "), outcome.remark, "dim")
    if outcome.said and outcome.verdict.startswith("noticed"):
        print_row(console, Text(" " * 20), outcome.said[0], "dim")


def _print_end(console: Console, report: Report) -> None:
    for case in report.cases[:3]:
        console.print(f"\n[bold]{case['trial']}, smallest case[/]")
        console.print(smallest_case.in_words(case), markup=False)
    if report.left_behind:
        console.print(f"{report.left_behind} processes of the driver had left its session; tactemu ended them")
    if report.left_for_time:
        console.print(report.left_for_time)
    color = "red" if report.failed else "yellow" if report.interrupted else "green"
    console.print(f"[{color}]{report.verdict}[/]; {report.counts}")


def _write(report: Report, files: ReportFiles) -> None:
    if files.html is not None:
        written(files.html, html_report(report, files.command))
    if files.junit is not None:
        written(files.junit, junit_report(report))
    if files.json is not None:
        report.write_json(files.json)
    if files.cases is not None and report.cases:
        files.cases.mkdir(parents=True, exist_ok=True)
        for case in report.cases:
            smallest_case.write(case, files.cases / smallest_case.file_name(case["trial"]))


def judge_success(
    target: str, command: Sequence[str], script: Path, options: JudgeOptions, json_file: Path | None
) -> int:
    """Try a task under faults, print the success rate by their strength, and return the exit code.

    Raises:
        TactemuError: the request is invalid, or cannot be met on this machine.
    """
    if not command:
        raise TactemuError(f"name the task's command after --, as in `tactemu judge {target} --success ... -- COMMAND`")
    if not options.port:
        check_finds_port(command)
    check_writable(json_file, "the success rates", '"strength":')
    points, interrupted = {}, False
    with ended_by_signals(interrupt), message_console().status("starting") as status:
        trials = success_curve(target, _program(command), read_script(script), options, status.update)
        try:
            for each in trials:
                points = each
        except KeyboardInterrupt:
            interrupted = True
    print("\n".join(as_text(points)))
    if json_file is not None:
        json_file.write_text(json.dumps(as_data(points), indent=2) + "\n", encoding="utf-8")
    if interrupted:
        return INTERRUPTED
    return 0 if points["", 0.0].succeeded else NOT_JUDGED
