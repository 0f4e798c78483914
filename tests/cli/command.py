"""Running the command line in a process of its own, with a time limit."""

import os
import subprocess
import sys
from importlib.metadata import entry_points
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
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path, "NO_COLOR": "1", "COLUMNS": "120", "PYTHONDONTWRITEBYTECODE": "1"}


def plugin_options() -> list[str]:
    """What tells pytest of our plugin where the package is not installed, and so has no entry point."""
    installed = any(point.value == "tactemu.pytest_plugin" for point in entry_points(group="pytest11"))
    return [] if installed else ["-p", "tactemu.pytest_plugin"]
