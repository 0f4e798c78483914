"""The driver's program at work: what it prints, in time, bounded in memory; and its end."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import select
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Mapping, Sequence

from tactemu.base.errors import TactemuError
from tactemu.judge import processes
from tactemu.judge.lateness import Delay
from tactemu.judge.rows import LONGEST, Rows
from tactemu.judge.tape import DriverRow, Note, ResourceUsage

FLOOD_BYTES = 8_000_000
"""Of what a driver prints within :data:`FLOOD_S` seconds and is no row: more is a flood, and the driver is ended."""
FLOOD_S = 5.0
KEPT = 200_000
"""Rows and notes that are kept, each."""
NOTE = 300
"""Characters of a note that are kept."""
WEIGH_S = 0.05
_BUS = re.compile(r"(?!dds:|memory:)(?P<interface>[A-Za-z]\w*):(?!//)(?P<channel>.+)")
"""The port of a CAN device, as python-can names it."""


def command_of(command: Sequence[str], ports: Mapping[str, str]) -> list[str]:
    """Return the command with ``{port}`` replaced; on CAN ``{interface}``, ``{channel}``; of several ports ``{NAME}``.

    Raises:
        TactemuError: there are several ports, and none is named.
    """
    values = {}
    if len(set(ports.values())) == 1:
        values["port"] = next(iter(ports.values()))
        bus = _BUS.fullmatch(values["port"])
        values |= bus.groupdict() if bus else {}
    values |= ports
    words = []
    for word in command:
        if "{port}" in word and "port" not in values:
            raise TactemuError(f"which port? there are {', '.join(f'{{{name}}}' for name in ports)}")
        for name, value in values.items():
            word = word.replace(f"{{{name}}}", value)
        words.append(word)
    return words


def reading_command(callable_name: str) -> list[str]:
    """Return the command that calls ``package.module:function`` in a loop."""
    return [sys.executable, "-u", "-m", "tactemu.judge.reading", callable_name, "{port}"]


class Driver:
    """One process of the driver, in a session of its own.

    Its standard output is a terminal, so that every runtime writes line by line; its input is empty.

    Args:
        command: as :func:`command_of` returns it.
        ports: for its environment, ``TACTEMU_PORT`` and ``TACTEMU_PORT_NAME``.

    Raises:
        TactemuError: there is no such program.
    """

    def __init__(self, command: Sequence[str], ports: Mapping[str, str]):
        self.rows: list[DriverRow] = []
        self.notes: list[Note] = []
        self.weights: list[ResourceUsage] = []
        self.delays: list[Delay] = []
        """How late our own thread and the driver's processes were scheduled, at each look at their weight."""
        self.flooded = False
        self.dropped = 0
        """Rows and notes that are not kept."""
        self.mark = secrets.token_hex(8)
        self.started = time.monotonic_ns()
        out, give = os.openpty()
        err, give_err = os.pipe()
        _as_it_is(give)
        named = {f"TACTEMU_PORT_{_upper(name)}": port for name, port in ports.items()}
        env = os.environ | named | {"PYTHONUNBUFFERED": "1", processes.MARK: self.mark}
        env["TACTEMU_PORT"] = next(iter(ports.values()), "")
        try:
            self.process = subprocess.Popen(
                list(command), stdout=give, stderr=give_err, stdin=subprocess.DEVNULL, start_new_session=True, env=env
            )
        except OSError as error:
            os.close(out)
            os.close(err)
            raise TactemuError(f"cannot run the driver: {command[0]}: {error.strerror}") from None
        finally:
            os.close(give)
            os.close(give_err)
        self._streams = {out: (b"", False), err: (b"", True)}
        self._parse = Rows()
        self._window: tuple[float, int] = (time.monotonic(), 0)
        self._stop, self._stopping = os.pipe()
        self._thread = threading.Thread(target=self._listen, name="tactemu-judge", daemon=True)
        self._thread.start()

    @property
    def exit(self) -> int | None:
        """The exit status of its first process; ``None`` while it runs."""
        return self.process.poll()

    def stop(self, stopped: bool) -> None:
        """Have all its processes stand still, or go on: a reader that is slow."""
        for pid in processes.family(self.process.pid):
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGSTOP if stopped else signal.SIGCONT)

    def end(self) -> int:
        """End everything that it started; returns how many processes had left its session. Safe to call twice."""
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

    # -- the thread that listens ---------------------------------------------------------------------------------------

    def _listen(self) -> None:
        weigh = time.monotonic()
        while True:
            ready = select.select([*self._streams, self._stop], [], [], max(0.0, weigh - time.monotonic()))[0]
            now = time.monotonic_ns()
            if self._stop in ready:
                break
            for stream in ready:
                self._read(stream, now)
            if (overslept := time.monotonic() - weigh) >= 0:
                weigh = max(weigh + WEIGH_S, time.monotonic())
                if self.process.returncode is None:
                    pid = self.process.pid
                    self.weights.append(ResourceUsage(now, *processes.weight(pid)))
                    self.delays.append(Delay(now, round(1e9 * overslept), processes.queued_ns(pid)))
        for stream in (*self._streams, self._stop):
            os.close(stream)

    def _read(self, stream: int, now: int) -> None:
        try:
            data = os.read(stream, 65_536)
        except OSError:  # nobody has the terminal's other side any more
            data = b""
        rest, err = self._streams[stream]
        if not data:
            if rest:
                self._take(rest, now, err)
            os.close(stream)
            del self._streams[stream]
            return
        if b"\n" not in data:
            junk, rest = len(data), (rest + data)[:LONGEST]
        else:
            *lines, rest = (rest + data).split(b"\n")
            junk = sum(len(line) for line in lines if not self._take(line, now, err))
        self._streams[stream] = (rest, err)
        self._count(junk)

    def _count(self, size: int) -> None:
        """Of what is no row; too much of it ends the driver."""
        begun, seen = self._window
        now = time.monotonic()
        self._window = (now, size) if now - begun > FLOOD_S else (begun, seen + size)
        if self._window[1] > FLOOD_BYTES and not self.flooded:
            self.flooded = True
            with contextlib.suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)

    def _take(self, line: bytes, now: int, err: bool) -> bool:
        """Keep a line; whether it is a row."""
        said = line.decode(errors="replace").strip()
        if not said:
            return False
        row = None if err else self._parse.parse(said)
        if len(self.rows) + len(self.notes) > KEPT:
            self.dropped += 1
        elif row is not None:
            self.rows.append(DriverRow(now, row))
        else:
            self.notes.append(Note(now, said[:NOTE], err))
        return row is not None


def _upper(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name.upper())


def _as_it_is(terminal: int) -> None:
    """Have a terminal neither echo nor turn line ends."""
    settings = termios.tcgetattr(terminal)
    settings[1] &= ~termios.OPOST
    settings[3] &= ~termios.ECHO
    termios.tcsetattr(terminal, termios.TCSANOW, settings)
