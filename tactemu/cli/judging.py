"""``tactemu judge`` and ``tactemu proxy``."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tactemu.base.errors import TactemuError
from tactemu.cli.signals import ended_by_signals
from tactemu.cli.words import options_of
from tactemu.judge import smallest_case
from tactemu.judge.budget import EVERY_POSITION_BUDGET_S
from tactemu.judge.driver import reading_command
from tactemu.judge.html_report import html_report
from tactemu.judge.junit_report import junit_report
from tactemu.judge.outcome import ABOUT, FAILING, Outcome
from tactemu.judge.processes import age_s
from tactemu.judge.report import Report, written
from tactemu.judge.trial_runner import Judge, JudgeOptions
from tactemu.judge.verdicts import judge_record

FAILED = 1
"""The exit code if a trial fails."""
NOT_JUDGED = 3
"""The exit code if there was nothing to judge."""
INTERRUPTED = 130
"""The exit code after Ctrl-C."""
_BUDGET = re.compile(r"(\d+(?:\.\d+)?)\s*(s|m|h|)")


def budget_of(text: str | None) -> float | None:
    """Return ``5m``, ``90s`` or ``90`` in seconds.

    Raises:
        TactemuError: the text is no time.
    """
    if text is None:
        return None
    match = _BUDGET.fullmatch(text.strip())
    if match is None or not float(match[1]):
        raise TactemuError(f"--budget: expected a time such as 90s or 5m, got {text!r}")
    return float(match[1]) * {"": 1, "s": 1, "m": 60, "h": 3600}[match[2]]


def kinds_of(words: Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of finding that fail a run.

    Raises:
        TactemuError: there is no such kind.
    """
    kinds = [word.strip().replace("-", " ") for text in words for word in text.split(",")]
    if not kinds:
        return FAILING
    if unknown := [kind for kind in kinds if kind not in ABOUT and kind not in ("none", "all")]:
        raise TactemuError(f"--fail-on: no finding is called {unknown[0]!r}; expected {', '.join(ABOUT)}, all or none")
    if "all" in kinds:
        return tuple(ABOUT)
    return tuple(kind for kind in kinds if kind != "none")


def judge_driver(
    target: str,
    command: Sequence[str],
    *,
    reads: str | None,
    options: Sequence[str],
    ports: Sequence[str],
    budget: str | None,
    no_contact_s: float,
    seed: int | None,
    only: Sequence[str],
    fail_on: Sequence[str],
    columns: Path | None,
    record: Path | None,
    html: Path | None,
    junit_file: Path | None,
    json_file: Path | None,
    baseline: Path | None,
    cases: Path | None,
    replay: Path | None,
    patience: float,
) -> int:
    """Judge a driver, print and write the report, and return the exit code.

    Raises:
        TactemuError: the request is invalid, or cannot be met on this machine.
    """
    from tactemu.cli.words import ports_of

    if bool(command) == bool(reads):
        raise TactemuError(
            f"name the driver's command after --, as in `tactemu judge {target} -- python driver.py {{port}}`, "
            "or give --reads package.module:function"
        )
    command = (
        reading_command(reads) if reads else [sys.executable if command[0] == "python" else command[0], *command[1:]]
    )
    began, limit = time.monotonic() - age_s(), budget_of(budget)  # imports count: on a busy machine they take seconds
    chosen = JudgeOptions(
        no_contact_s=no_contact_s, seed=seed or 0, budget_s=began + limit - time.monotonic() if limit else None,
        every=(limit or 0.0) >= EVERY_POSITION_BUDGET_S, only=tuple(only), fail_on=kinds_of(fail_on),
        columns=columns, record=record, device_options=options_of(options), port=ports_of(ports), patience_s=patience,
    )  # fmt: skip
    report = Report(target, list(command), chosen.seed, chosen.fail_on)
    if baseline is not None:
        report.compare(baseline)
    case = smallest_case.read(replay) if replay is not None else None
    console = Console(stderr=True)
    interrupted = False
    with ended_by_signals(_interrupt), console.status("starting the driver") as status:
        with Judge(target, command, chosen, lambda text: status.update(f"{text} …")) as judge:
            try:
                for outcome in judge.run() if case is None else _replayed(judge, case):
                    report.outcomes.append(outcome)
                    if len(report.outcomes) == 1:
                        report.columns, report.asks = judge.columns.describe(), judge.known.asks
                        _print_columns(console, report)
                    _print_outcome(console, report, outcome)
            except KeyboardInterrupt:
                interrupted = True
                console.print("interrupted: the other trials were not run")
            judge.end()
            report.left_behind = judge.left_behind
    report.seconds = time.monotonic() - began
    _write(report, html, junit_file, json_file, cases)
    _print_end(console, report)
    if interrupted:
        return INTERRUPTED
    return FAILED if report.failed and report.is_judged else NOT_JUDGED if not report.is_judged else 0


def _interrupt() -> None:
    raise KeyboardInterrupt


def _replayed(judge: Judge, case: dict):
    """Yield the outcomes of the clean run and of the case."""
    yield judge.clean()
    if judge.columns.values:
        yield judge_record(judge.run_trial(smallest_case.trial_of(case)))


def _print_columns(console: Console, report: Report) -> None:
    if not report.columns:
        return
    table = Table(title="Meaning of the driver's columns", box=None, title_justify="left", show_header=False)
    for name, holds in report.columns[:40]:
        table.add_row(escape(name), escape(holds))
    if len(report.columns) > 40:
        table.add_row("…", f"{len(report.columns) - 40} more")
    console.print(table)


def _print_outcome(console: Console, report: Report, outcome: Outcome) -> None:
    failing = report.failures(outcome)
    color = "red" if failing else "yellow" if outcome.findings else "dim" if outcome.skipped else "green"
    mark = "✗" if failing else "!" if outcome.findings else "-" if outcome.skipped else "✓"
    known = " (as in the baseline)" if outcome.findings and not failing and report.known else ""
    late = (
        f"  p50 {outcome.p50_ms:.1f} ms, p99 {outcome.p99_ms:.1f} ms"
        if outcome.name == "clean" and outcome.p50_ms
        else ""
    )
    words = escape(outcome.verdict + outcome.doubt)
    console.print(f"[{color}]{mark} {outcome.name:18}[/] {words}{known}{late}", highlight=False)
    if outcome.said and outcome.verdict.startswith("noticed"):
        console.print(f"  {'':18} [dim]{escape(outcome.said[0])}[/]", highlight=False)


def _print_end(console: Console, report: Report) -> None:
    for case in report.cases[:3]:
        console.print(f"\n[bold]{case['trial']}, smallest case[/]")
        console.print(smallest_case.in_words(case), markup=False, highlight=False)
    if report.left_behind:
        console.print(f"{report.left_behind} processes of the driver had left its session; tactemu ended them")
    failed = len(report.failed)
    words = f"[red]{failed} of {len(report.outcomes)} trials fail[/]" if failed else "[green]nothing fails[/]"
    tried = sum(not outcome.skipped for outcome in report.outcomes)
    console.print(f"{words}; {tried} trials in {report.seconds:.1f} s")


def _write(
    report: Report, html: Path | None, junit_file: Path | None, json_file: Path | None, cases: Path | None
) -> None:
    if html is not None:
        written(html, html_report(report))
    if junit_file is not None:
        written(junit_file, junit_report(report))
    if json_file is not None:
        report.write_json(json_file)
    if cases is not None and report.cases:
        cases.mkdir(parents=True, exist_ok=True)
        for case in report.cases:
            smallest_case.write(case, cases / f"{case['trial'].replace(' ', '-')}.json")


def run_proxy(
    real: str,
    port: str,
    *,
    device: str | None,
    options: Sequence[str],
    baud: int | None,
    faults: Sequence[str],
    truth: Path | None,
    record: Path | None,
    seed: int | None,
    seconds: float | None,
) -> None:
    """Pass bytes between a real sensor and its driver until Ctrl-C.

    Raises:
        TactemuError: the request is invalid or cannot be met on this machine, or the sensor's port is lost.
    """
    from contextlib import ExitStack

    from firmware_protocols import Serial
    from tactemu.emulator.replay import DEFAULT_BAUD, line_note
    from tactemu.judge.proxy import Proxy, RealBus, RealSerial
    from tactemu.scene.building import make_device
    from tactemu.truth import Truth
    from tactemu.truth.recorder import Recorder

    model = make_device(device, options_of(options)) if device else None
    own = next((each.baud for each in model.ports if isinstance(each, Serial)), None) if model else None
    with ExitStack() as stack:
        side = RealBus(real) if real.startswith("can:") else RealSerial(real, baud or own or DEFAULT_BAUD)
        stack.callback(side.close)
        recorder = stack.enter_context(Recorder(record, line=line_note(real, baud))) if record is not None else None
        log = Truth(truth) if truth is not None else Truth()
        proxy = Proxy(model, side, port, faults, seed or 0, log, recorder, device or "sensor")
        stack.enter_context(ended_by_signals(proxy.stop))

        def opened(address: str) -> None:
            print(f"{real} is passed on to {address}", flush=True)
            print(f"  {proxy.framing.about if device else 'undecoded: no --device'}", flush=True)

        proxy.run(seconds, opened)
    injected = ", ".join(f"{kind} {n}" for kind, n in log.injected.items()) or "nothing"
    passed = ", ".join(f"{n} {way}" for way, n in proxy.passed.items())
    print(f"passed: {passed}; samples decoded: {proxy.samples}; injected: {injected}")
