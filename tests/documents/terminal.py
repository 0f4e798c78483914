"""A terminal in which a test types the commands of a page.

``tactemu`` runs in forks of one process that has its imports already, so that a command takes a fraction of a second;
all else runs in a shell. A command that runs until Ctrl-C goes on in the background, as in a terminal of its own, and
gets its Ctrl-C when the next one like it begins, or at the end.
"""

import multiprocessing
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from multiprocessing.process import BaseProcess
from pathlib import Path

_IMPORTS = ["tactemu", "tactemu.cli.app", "tactemu.cli.running", "tactemu.session.session", "tactemu.tune.bench"]
_READY = re.compile(r" ready on |^see .*http|listening|http://|records? ")
_START_S, _COMMAND_S = 40.0, 100.0
_LONG, _NIGHTLY_S = ("judge", "sweep"), 1500.0
_RUN_S = 0.4
"""The time for which a command runs, at least, before its Ctrl-C."""
_BESIDE = ("poke", "see")
"""Commands that are typed in another terminal, while one runs."""
_UNTIL_CTRL_C = ("run", "see", "replay", "proxy")
"""Commands that go on until Ctrl-C; ``--seconds`` ends them by themselves."""


class Terminal:
    """A terminal in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.running: list[tuple[str, BaseProcess, Path]] = []
        self._forks = multiprocessing.get_context("forkserver")
        self._forks.set_forkserver_preload(_IMPORTS)
        self._count = 0

    def type(self, command: str) -> str:
        """Run a command, and return its output; one that goes on until Ctrl-C is ready then.

        Raises:
            AssertionError: it fails, or does not end.
        """
        words = words_of(command)
        if words is None:
            return self._shell(command)
        if words[0] not in _BESIDE:
            self.interrupt()
        if words[0] in _UNTIL_CTRL_C and "--seconds" not in words and "--help" not in words:
            return self._begin(command, words)
        process, output = self._fork(words)
        process.join(_NIGHTLY_S if words[0] in _LONG else _COMMAND_S)
        allowed = (0, 1) if words[0] in ("judge", "sweep") else (0,)  # 1: the reader's driver fails
        assert process.exitcode in allowed, f"{command}: {_end(process)}\n{output.read_text()}"
        return output.read_text()

    def interrupt(self) -> None:
        """Press Ctrl-C in all that runs.

        Raises:
            AssertionError: one of them does not end, or ends with an error.
        """
        if self.running:
            time.sleep(_RUN_S)
        while self.running:
            command, process, output = self.running.pop()
            assert process.pid is not None
            if process.is_alive():
                os.kill(process.pid, signal.SIGINT)
            process.join(_COMMAND_S)
            assert process.exitcode == 0, f"{command}, Ctrl-C: {_end(process)}\n{output.read_text()}"

    def kill(self) -> None:
        """End what still runs after a failure."""
        for _, process, _ in self.running:
            process.kill()

    def _begin(self, command: str, words: list[str]) -> str:
        """Start a command, and wait until it is ready."""
        process, output = self._fork(words)
        self.running.append((command, process, output))
        deadline = time.monotonic() + _START_S
        while not _READY.search(text := output.read_text()):
            assert process.is_alive(), f"{command}: {_end(process)}\n{text}"
            assert time.monotonic() < deadline, f"{command}: not ready after {_START_S:.0f} s\n{text}"
            time.sleep(0.02)
        return text

    def _fork(self, words: list[str]) -> tuple[BaseProcess, Path]:
        self._count += 1
        output = self.folder / f".output-{self._count}"
        output.touch()
        process = self._forks.Process(target=_run, args=(words, self.folder, output, dict(_environment())))
        process.start()
        return process, output

    def _shell(self, command: str) -> str:
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, env=_environment(), stdin=subprocess.DEVNULL, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=_COMMAND_S, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{command}: exit code {done.returncode}\n{done.stdout}"
        return done.stdout


def words_of(command: str) -> list[str] | None:
    """Return the words after ``tactemu`` of a command without anything for a shell; None for any other."""
    outside = re.sub(r"'[^']*'|\"[^\"$`]*\"", "", command)
    if not command.startswith("tactemu ") or re.search(r"[|&;<>$`*~]", outside):
        return None
    return shlex.split(command)[1:]


def _environment() -> dict[str, str]:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", "TACTEMU_"))}
    return kept | {"NO_COLOR": "1", "COLUMNS": "100"}


def _end(process: BaseProcess) -> str:
    """Return how a process has ended; one that has not is killed."""
    if process.exitcode is None:
        process.kill()
        return "it does not end"
    return f"exit code {process.exitcode}"


def _run(words: list[str], folder: Path, output: Path, environment: dict[str, str]) -> None:
    """Be the command, in a fork."""
    os.environ.clear()
    os.environ.update(environment)
    file = os.open(output, os.O_WRONLY)
    for number in (1, 2):
        os.dup2(file, number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["tactemu", *words]
    from tactemu.cli import main

    main()
