"""``tactemu judge --success``: the success rate of a complete task, by the strength of the faults."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from tactemu.base.errors import TactemuError
from tactemu.cli import INTERRUPTED
from tactemu.cli.signals import ended_by_signals, interrupt
from tactemu.cli.words import ports_of
from tactemu.judge.success import as_data, as_text, read_script, success_curve

NOT_JUDGED = 3
"""The exit code if the task never succeeds without a fault."""


def judge_success(
    target: str,
    command: Sequence[str],
    script: Path,
    *,
    ports: Sequence[str],
    only: Sequence[str],
    budget_s: float | None,
    seed: int | None,
    json_file: Path | None,
) -> int:
    """Try a task under faults, print the curve, and return the exit code.

    Raises:
        TactemuError: the request is invalid, or cannot be met on this machine.
    """
    if not command:
        raise TactemuError(f"name the task's command after --, as in `tactemu judge {target} --success ... -- COMMAND`")
    words = [sys.executable if command[0] == "python" else command[0], *command[1:]]
    points, interrupted = {}, False
    with ended_by_signals(interrupt), Console(stderr=True).status("starting") as status:
        trials = success_curve(
            target, words, read_script(script), only=only, port=ports_of(ports), seed=seed or 0, budget_s=budget_s,
            report_progress=status.update,
        )  # fmt: skip
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
