"""The driver's process: its printed rows and messages with their times, its resource usage, and its end."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import select
import shutil
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from tactemu.base.errors import TactemuError, nearest, reason_of
from tactemu.judge import processes
from tactemu.judge.lateness import SchedulingDelay
from tactemu.judge.row_parser import MAX_LINE_LENGTH, RowParser
from tactemu.judge.trial_record import DriverRow, Note, ResourceUsage

MAX_OTHER_BYTES = 8_000_000
"""Maximum size of output other than rows within :data:`FLOOD_WINDOW_S`; a driver that prints more is ended [byte]."""
FLOOD_WINDOW_S = 5.0
"""Time window in which that output is counted [s]."""
MAX_KEPT_LINES = 200_000
"""Maximum number of rows and notes together; bounds the memory."""
MAX_NOTE_LENGTH = 300
"""Maximum length of a kept note [characters]."""
RESOURCE_PERIOD_S = 0.05
"""Time between two measurements of the driver's memory and processor time [s]."""
MAX_SEARCHED_BYTES = 1 << 20
"""Maximum number of bytes of a file in which the name of the variable is looked for."""
_PLACEHOLDER = re.compile(r"\{([A-Za-z]\w*)\}")
_VARIABLE = "TACTEMU_PORT"
"""The environment variable with the port."""
_BUS = re.compile(r"(?!dds:|memory:)(?P<interface>[A-Za-z]\w*):(?!//)(?P<channel>.+)")
"""A pattern of the port of a CAN device, as python-can names it."""


def command_of(command: Sequence[str], ports: Mapping[str, str]) -> list[str]:
    """Return the command with its placeholders replaced.

    They are ``{port}``, on CAN ``{interface}`` and ``{channel}``, and with several ports the ``{NAME}`` of each.

    Raises:
        TactemuError: there are several ports, and the command has ``{port}``; or it has unknown placeholders only.
    """
    values = {}
    if len(set(ports.values())) == 1:
        values["port"] = next(iter(ports.values()))
        bus = _BUS.fullmatch(values["port"])
        values |= bus.groupdict() if bus else {}
    offered = ", ".join(f"{{{name}}}" for name in values or ports)
    values |= ports
    found = [name for word in command for name in _PLACEHOLDER.findall(word)]
    if found and not {*found} & {*values, "port"} and not _names_variable(command):
        raise TactemuError(
            f"{{{found[0]}}} in the driver's command is no placeholder{nearest(found[0], values)}; expected {offered}"
        )
    words = []
    for word in command:
        if "{port}" in word and "port" not in values:
            raise TactemuError(f"{{port}} is ambiguous, there are several; name one of {offered}")
        for name, value in values.items():
            word = word.replace(f"{{{name}}}", value)
        words.append(word)
    return words


def check_finds_port(command: Sequence[str]) -> None:
    """Raise TactemuError if nothing in a command tells its program the port.

    A placeholder does, or the name of the environment variable in a word of the command or in a file that it names.
    """
    if not any(map(_PLACEHOLDER.search, command)) and not _names_variable(command):
        raise TactemuError(
            "the driver's command does not have {port}: where the port belongs, write {port}, as in "
            f"`-- python driver.py {{port}}`; for a program that reads {_VARIABLE} in a file that the command does not "
            f"name, write `-- env {_VARIABLE}={{port}} COMMAND`; an address of your own needs --port pty:PATH"
        )


def _names_variable(command: Sequence[str]) -> bool:
    """Return True if a word of a command, or a file that a word names, has the name of the environment variable."""
    return any(_VARIABLE in word or _has(word, _VARIABLE.encode()) for word in command)


def _has(path: str, text: bytes) -> bool:
    try:
        file = Path(shutil.which(path) or path)
        if not file.is_file():
            return False
        with file.open("rb") as source:
            return text in source.read(MAX_SEARCHED_BYTES)
    except (OSError, ValueError):
        return False


def reading_command(callable_name: str) -> list[str]:
    """Return the command that calls ``package.module:function`` in a loop."""
    return [sys.executable, "-u", "-m", "tactemu.judge.reader_loop", callable_name, "{port}"]


class Driver:
    """A process of the driver, in a session of its own.

    Its standard output is a terminal, so that every runtime writes line by line; its input is empty.

    Args:
        command: as :func:`command_of` returns it.
        ports: for the environment variables ``TACTEMU_PORT`` and ``TACTEMU_PORT_NAME``.

    Raises:
        TactemuError: the program cannot be started.
    """

    def __init__(self, command: Sequence[str], ports: Mapping[str, str]):
        self.rows: list[DriverRow] = []
        self.notes: list[Note] = []
        self.resource_usage: list[ResourceUsage] = []
        self.delays: list[SchedulingDelay] = []
        """Scheduling delays of our own thread and the driver's processes, at each measurement of their resources."""
        self.flooded = False
        self.dropped = 0
        """Number of rows and notes that were not kept."""
        self.mark = secrets.token_hex(8)
        self.started = time.monotonic_ns()
        out, give = os.openpty()
        err, give_err = os.pipe()
        _set_raw_output(give)
        named = {f"{_VARIABLE}_{_upper(name)}": port for name, port in ports.items()}
        env = os.environ | named | {"PYTHONUNBUFFERED": "1", processes.MARK: self.mark}
        env[_VARIABLE] = next(iter(ports.values()), "")
        try:
            self.process = subprocess.Popen(
                list(command), stdout=give, stderr=give_err, stdin=subprocess.DEVNULL, start_new_session=True, env=env
            )
        except OSError as error:
            os.close(out)
            os.close(err)
            raise TactemuError(f"cannot run the driver: {command[0]}: {reason_of(error)}; give its path") from None
        finally:
            os.close(give)
            os.close(give_err)
        self._streams = {out: (b"", False), err: (b"", True)}
        self._parse = RowParser()
        self._window: tuple[float, int] = (time.monotonic(), 0)
        self._stop, self._stopping = os.pipe()
        self._thread = threading.Thread(target=self._listen, name="tactemu-judge", daemon=True)
        self._thread.start()

    @property
    def exit(self) -> int | None:
        """The exit status of the driver's first process; ``None`` while it runs."""
        return self.process.poll()

    def stop(self, stopped: bool) -> None:
        """Stop all processes of the driver (SIGSTOP), or let them continue (SIGCONT)."""
        for pid in processes.family(self.process.pid):
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGSTOP if stopped else signal.SIGCONT)

    def end(self) -> int:
        """End all processes that the driver started, and return how many had left its session.

        It is safe to call it twice.
        """
        if self._stopping < 0:
            return 0
        with contextlib.suppress(OSError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(5)
        left = processes.end(self.mark)
        os.close(self._stopping)
        self._stopping = -1
        self._thread.join(5)
        return left

    # -- the thread that reads -----------------------------------------------------------------------------------------

    def _listen(self) -> None:
        next_look = time.monotonic()
        while True:
            ready = select.select([*self._streams, self._stop], [], [], max(0.0, next_look - time.monotonic()))[0]
            now = time.monotonic_ns()
            if self._stop in ready:
                break
            for stream in ready:
                self._read(stream)
            if (overslept := time.monotonic() - next_look) >= 0:
                next_look = max(next_look + RESOURCE_PERIOD_S, time.monotonic())
                if self.process.returncode is None:
                    pid = self.process.pid
                    self.resource_usage.append(ResourceUsage(now, *processes.resource_usage(pid)))
                    self.delays.append(SchedulingDelay(now, round(1e9 * overslept), processes.queued_ns(pid)))
        for stream in (*self._streams, self._stop):
            os.close(stream)

    def _read(self, stream: int) -> None:
        try:
            data = os.read(stream, 65_536)
        except OSError:  # the driver has closed its side of the terminal
            data = b""
        now = time.monotonic_ns()  # before the read it could be earlier than what is read
        partial, err = self._streams[stream]
        if not data:
            if partial:
                self._take(partial, now, err)
            os.close(stream)
            del self._streams[stream]
            return
        if b"\n" not in data:
            other_bytes, partial = len(data), (partial + data)[:MAX_LINE_LENGTH]
        else:
            *lines, partial = (partial + data).split(b"\n")
            other_bytes = sum(len(line) for line in lines if not self._take(line, now, err))
        self._streams[stream] = (partial, err)
        self._count(other_bytes)

    def _count(self, size: int) -> None:
        """Count output that is no row, and kill the driver once there is too much of it."""
        begun, seen = self._window
        now = time.monotonic()
        self._window = (now, size) if now - begun > FLOOD_WINDOW_S else (begun, seen + size)
        if self._window[1] > MAX_OTHER_BYTES and not self.flooded:
            self.flooded = True
            with contextlib.suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)

    def _take(self, line: bytes, now: int, err: bool) -> bool:
        """Keep a line as a row or a note, and return whether it is a row."""
        text = line.decode(errors="replace").strip()
        if not text:
            return False
        row = None if err else self._parse.parse(text)
        if len(self.rows) + len(self.notes) > MAX_KEPT_LINES:
            self.dropped += 1
        elif row is not None:
            self.rows.append(DriverRow(now, row))
        else:
            self.notes.append(Note(now, text[:MAX_NOTE_LENGTH], err))
        return row is not None


def _upper(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name.upper())


def _set_raw_output(terminal: int) -> None:
    """Switch off the echo and the conversion of line ends of a terminal."""
    settings = termios.tcgetattr(terminal)
    settings[1] &= ~termios.OPOST
    settings[3] &= ~termios.ECHO
    termios.tcsetattr(terminal, termios.TCSANOW, settings)
