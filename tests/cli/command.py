"""Running the command line: in a process of its own, with a time limit, or quicker in this one."""

import contextlib
import io
import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from unittest import mock

from tactemu.cli import main

ROOT = Path(__file__).parents[2]


def tactemu(*arguments: str, cwd: Path | None = None, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    """Run ``tactemu`` and wait for it."""
    return subprocess.run(
        [sys.executable, "-m", "tactemu", *arguments], capture_output=True, text=True, timeout=timeout, cwd=cwd,
        env=environment(), check=False,
    )  # fmt: skip


def here(*arguments: str, cwd: Path = ROOT, columns: int = 120) -> subprocess.CompletedProcess[str]:
    """As :func:`tactemu`, in this process: without the second and more that Python and its imports take to start."""
    out, errors = io.StringIO(), io.StringIO()
    settings = mock.patch.multiple(sys, argv=["tactemu", *arguments], stdout=out, stderr=errors)
    with settings, mock.patch.dict(os.environ, {"NO_COLOR": "1", "COLUMNS": str(columns)}), contextlib.chdir(cwd):
        try:
            main()
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
    return subprocess.CompletedProcess(["tactemu", *arguments], status, out.getvalue(), errors.getvalue())


def start(*arguments: str, **options) -> subprocess.Popen[str]:
    """Start ``tactemu`` with its output in pipes."""
    return subprocess.Popen(
        [sys.executable, "-m", "tactemu", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(), **options,
    )  # fmt: skip


def environment() -> dict[str, str]:
    """Ours, with the package on the path and no colours."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path, "NO_COLOR": "1", "COLUMNS": "120"}


def plugin_options() -> list[str]:
    """What tells pytest of our plugin where the package is not installed, and so has no entry point."""
    installed = any(point.value == "tactemu.integrations.pytest_plugin" for point in entry_points(group="pytest11"))
    return [] if installed else ["-p", "tactemu.integrations.pytest_plugin"]
