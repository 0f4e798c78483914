"""Running the command line in a process of its own, with a time limit."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def tactemu(*arguments: str, cwd: Path | None = None, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    """Run ``tactemu`` and wait for it."""
    return subprocess.run(
        [sys.executable, "-m", "tactemu", *arguments], capture_output=True, text=True, timeout=timeout, cwd=cwd,
        env=environment(), check=False,
    )  # fmt: skip


def start(*arguments: str, **options) -> subprocess.Popen[str]:
    """Start ``tactemu`` with its output in pipes."""
    return subprocess.Popen(
        [sys.executable, "-m", "tactemu", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(), **options,
    )  # fmt: skip


def environment() -> dict[str, str]:
    """Ours, with the package on the path and no colours."""
    return os.environ | {"PYTHONPATH": str(ROOT), "NO_COLOR": "1", "COLUMNS": "120", "PYTHONDONTWRITEBYTECODE": "1"}
