"""``tactemu judge --success``: how often a whole task succeeds, by the strength of what goes wrong."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from tactemu.base.errors import TactemuError
from tactemu.cli.signals import ended_by_signals
from tactemu.judge.success import as_data, as_text, read_script, success_curve

NOT_JUDGED, INTERRUPTED = 3, 130
"""Exit codes: it never succeeds, not even without a fault; Ctrl-C."""


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
    """Try a task under faults, and print the curve; returns the exit code.

    Raises:
        TactemuError: something asked for cannot be had.
    """
    from tactemu.cli.running import ports_of

    if not command:
        raise TactemuError(f"which task? its command after --, as in `tactemu judge {target} --success ... -- COMMAND`")
    words = [sys.executable if command[0] == "python" else command[0], *command[1:]]
    points, interrupted = {}, False
    with ended_by_signals(_interrupt), Console(stderr=True).status("starting") as status:
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


def _interrupt() -> None:
    raise KeyboardInterrupt
