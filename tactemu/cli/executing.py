"""``tactemu exec``: a driver in a view of the machine in which the emulated sensors are hardware."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError
from tactemu.base.gc_tuning import enable_collections
from tactemu.cli.forwarding import FORWARDING
from tactemu.cli.reports import not_understood, unreached_hint
from tactemu.exec.enter import FAILED, NOT_EXECUTABLE, NOT_FOUND
from tactemu.exec.environment import ExecEnvironment, exec_environment
from tactemu.exec.reach import out_of_reach
from tactemu.session.serving import Served
from tactemu.session.session import Session

_POLL_S = 0.1
"""The interval of checks of the emulator while the driver runs."""


def before_start(target: str, command: Sequence[str], way: str) -> int:
    """Check the program before anything is built; return the exit status of one that cannot be started, or 0.

    Raises:
        TactemuError: there is no program, or no kernel with CAN for ``way`` guest.
    """
    if way == "guest":
        _go_into_guest()
    if not command:
        raise TactemuError(f"name the program after --, as in `tactemu exec {target} -- python driver.py`")
    return _unfit(command[0])


def run_driver(command: Sequence[str], session: Session, view: Mapping[str, Any], *, quiet: bool) -> int:
    """Run ``command`` with the session's devices plugged in, and return its exit status, 128 + n after signal n.

    ``view`` has the arguments of :func:`~tactemu.exec.environment.exec_environment`.

    Raises:
        TactemuError: tactemu itself fails.
    """
    dev, signals = Served(session), FORWARDING[-1]
    env = exec_environment(dev, **view)
    enable_collections()
    with env:
        if not quiet:
            _announce(env, command[0])
        driver = signals.start(partial(env.popen, command))
        failure = _watch(driver, dev, env)
    status = driver.returncode
    if failure is not None:
        _say(str(failure))
        return FAILED
    signals.say_what_ended(status)
    if not quiet:
        _sum_up(dev)
    return status if status >= 0 else 128 - status


_RUNNERS = tuple(Path(__file__).parents[up] / "scripts" / "vcan-run" for up in (1, 2))
"""The script that boots a kernel with CAN, in the installed package and in a source tree."""


def _go_into_guest() -> None:
    """Restart this command, emulator and driver, in a kernel with CAN; it does not return.

    Raises:
        TactemuError: the script that boots the kernel is missing.
    """
    runner = next((path for path in _RUNNERS if path.exists()), None)
    if runner is None:
        raise TactemuError(f"--way guest needs {_RUNNERS[0]}, which is missing; install tactemu again")
    at = next(k for k, word in enumerate(sys.argv) if word in ("--way", "--way=guest"))
    words = [*sys.argv[1:at], "--way", "native", *sys.argv[at + (1 if sys.argv[at] == "--way=guest" else 2) :]]
    os.execvp("bash", ["bash", str(runner), "-u", "--", sys.executable, "-m", "tactemu", *words])


def _watch(driver: subprocess.Popen[bytes], dev: Served, env: ExecEnvironment) -> BaseException | None:
    """Wait until the driver has ended; unplug the emulator if it fails meanwhile, and return its error, or None."""
    failure = None
    while True:
        try:
            driver.wait(_POLL_S)
            return failure
        except subprocess.TimeoutExpired:
            if failure is None and not dev.running:
                try:
                    env.stop()
                except Exception as error:
                    failure = error
                failure = failure or TactemuError("the emulator has stopped")


def _unfit(program: str) -> int:
    """Return the exit status of a program that cannot be started, or 0; it is checked before anything is built."""
    if shutil.which(program):
        return 0
    if os.sep in program and Path(program).exists():
        _say(f"{program}: not executable")
        return NOT_EXECUTABLE
    _say(f"{program}: not found")
    return NOT_FOUND


def _announce(env: ExecEnvironment, program: str) -> None:
    for title, node in env.nodes.items():
        _say(f"{title} is {node}")
    if env.network:
        _say(env.network)
    missed = "modem lines, break, parity, low latency and udev's events"
    if env.missing:
        _say(f"{env.missing}. Names, sysfs, reading and writing work; there are no {missed}")
    elif why := out_of_reach(program):
        _say(f"{why}: it finds the ports, reads and writes, but has no {missed}")


def _sum_up(dev: Served) -> None:
    """Print what devices did not understand, and which of them no driver has reached."""
    for channel, entry in zip(dev.emulator.channels, dev.emulator.summary()):
        if text := not_understood(entry):
            _say(f"{channel.name} did not understand all that it was sent: {text}")
        if text := unreached_hint(channel):
            _say(f"{channel.name}: {text}")


def _say(text: str) -> None:
    print(f"tactemu: {text}", file=sys.stderr, flush=True)
