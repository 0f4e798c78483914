"""Running the command line: in a process of its own, which is forked, or quicker in this one."""

import contextlib
import functools
import io
import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from unittest import mock

from typer.main import get_command

from tactemu.cli import main
from tests.cli.fork_server import ForkedCommand

ROOT = Path(__file__).parents[2]
get_command_once = functools.lru_cache(maxsize=4)(get_command)
"""Build an application only once: that of all commands takes 90 ms."""


def tactemu(*arguments: str, cwd: Path | None = None, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    """Run ``tactemu`` and wait for it."""
    with start(*arguments, cwd=cwd) as process:
        try:
            out, errors = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, errors)


def here(*arguments: str, cwd: Path = ROOT, columns: int = 120) -> subprocess.CompletedProcess[str]:
    """As :func:`tactemu`, in this process: without the second and more that Python and its imports take to start."""
    out, errors = io.StringIO(), io.StringIO()
    settings = mock.patch.multiple(sys, argv=["tactemu", *arguments], stdout=out, stderr=errors)
    with (
        settings,
        mock.patch("typer.main.get_command", get_command_once),
        mock.patch.dict(os.environ, {"NO_COLOR": "1", "COLUMNS": str(columns)}),
        contextlib.chdir(cwd),
    ):
        try:
            main()
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
    return subprocess.CompletedProcess(["tactemu", *arguments], status, out.getvalue(), errors.getvalue())


def start(*arguments: str, **options) -> subprocess.Popen[str]:
    """Start ``tactemu`` with its output in pipes."""
    options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": environment()}
    if "preexec_fn" in options or sys.platform != "linux":
        return subprocess.Popen([sys.executable, "-m", "tactemu", *arguments], **options)
    return ForkedCommand(arguments, **options)


def environment() -> dict[str, str]:
    """Ours, with the package on the path and no colours."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path, "NO_COLOR": "1", "COLUMNS": "120"}


def plugin_options() -> list[str]:
    """What tells pytest of our plugin where the package is not installed, and so has no entry point."""
    installed = any(point.value == "tactemu.integrations.pytest_plugin" for point in entry_points(group="pytest11"))
    return [] if installed else ["-p", "tactemu.integrations.pytest_plugin"]
