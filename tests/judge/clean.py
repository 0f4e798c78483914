"""Judges of correct drivers on a busy machine, of which none may fail: ``python -m tests.judge.clean``.

Each plan is a complete run of the judge, with a new seed, on the correct driver of a kind of line: serial stream,
polled serial, Modbus RTU, CAN and UDP in turn. Meanwhile 4 to 10 busy processes, another number for each plan, take
processor time; they end with this program. The command prints a table, and fails if the judge fails a driver.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.judge.planted import DRIVERS, end_on_signals, judge_words, run

LINES = ("stream", "polled", "modbus", "can", "udp")
BUSY_PROCESSES = range(4, 11)
"""Numbers of busy processes, in turn."""
PLAN_TIMEOUT_S = 1200.0
"""Longest time for a whole plan on a busy machine."""
BUSY = f"import os\nwhile os.getppid() == {os.getpid()}:\n    for _ in range(100_000): pass"
"""Program of a busy process: it ends when this process has ended."""


@contextlib.contextmanager
def busy_processes(processes: int) -> Iterator[None]:
    """Keep some processes busy inside the block."""
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
        for process in busy:
            process.wait()


@dataclass(frozen=True)
class Plan:
    """The result of one complete run of the judge."""

    line: str
    seed: int
    load: int
    average: float
    """Load average of the machine at the end."""
    trials: int
    accused: tuple[str, ...]
    """Verdicts of the trials that fail."""
    seconds: float


def judge_record(line: str, seed: int, processes: int) -> Plan:
    """Judge the correct driver of a line by a complete plan, beside some busy processes."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, busy_processes(processes):
        report = Path(folder) / "report.json"
        last = run(judge_words(DRIVERS[line], "clean", report, f"--seed={seed}"), PLAN_TIMEOUT_S)
        average = os.getloadavg()[0]
        data = json.loads(report.read_text()) if report.exists() else None
    if data is None:
        return Plan(line, seed, processes, average, 0, (f"no report: {last}",), time.monotonic() - began)
    failed = [f"{each['name']}: {each['verdict']}" for each in data["trials"] if each["name"] in data["failed"]]
    tried = sum(not each["skipped"] for each in data["trials"])
    return Plan(line, seed, processes, average, tried, tuple(failed), time.monotonic() - began)


def show(plans: list[Plan], total: int) -> bool:
    """Print the table; return True if all plans were run and no driver is accused."""
    print(f"\n{'line':8} {'plans':>5} {'trials':>6} {'load average':>14} {'time':>8} accused")
    for line in LINES:
        mine = [plan for plan in plans if plan.line == line]
        if not mine:
            continue
        averages = [plan.average for plan in mine]
        span = f"{min(averages):.1f} to {max(averages):.1f}"
        took, trials = sum(plan.seconds for plan in mine), sum(plan.trials for plan in mine)
        print(f"{line:8} {len(mine):5} {trials:6} {span:>14} {took:6.0f} s {sum(bool(p.accused) for p in mine)}")
    for plan in plans:
        for verdict in plan.accused:
            print(f"  {plan.line}, seed {plan.seed}, {plan.load} busy processes: {verdict}")
    accused = sum(bool(plan.accused) for plan in plans)
    print(f"{accused} of {len(plans)} clean drivers are accused; {len(plans)} of {total} plans were run")
    return not accused and len(plans) == total


def main() -> int:
    """Judge as many correct drivers as the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m tests.judge.clean", description=__doc__)
    parser.add_argument("--plans", type=int, default=100, help="how many plans in all (default 100)")
    parser.add_argument("--load", type=int, help="busy processes (default: 4 to 10, in turn)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first plan of each line")
    given = parser.parse_args()
    plans: list[Plan] = []
    end_on_signals()
    try:
        for number in range(given.plans):
            line, seed = LINES[number % len(LINES)], given.seed + number // len(LINES)
            processes = BUSY_PROCESSES[number % len(BUSY_PROCESSES)] if given.load is None else given.load
            plans.append(plan := judge_record(line, seed, processes))
            found = "; ".join(plan.accused) or "not accused"
            place = f"{number + 1:3}/{given.plans} {line:8} seed {seed:3}, {processes:2} busy processes"
            figures = f"load {plan.average:4.1f}, {plan.trials} trials in {plan.seconds:.0f} s"
            print(f"{place}, {figures}: {found}", flush=True)
    except KeyboardInterrupt:
        show(plans, given.plans)
        return 130
    return 0 if show(plans, given.plans) else 1


if __name__ == "__main__":
    sys.exit(main())
