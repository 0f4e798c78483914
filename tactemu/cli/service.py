"""``tactemu service``: a machine that is the sensor as soon as it has power, by a service of systemd."""

from __future__ import annotations

import grp
import os
import pwd
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from tactemu.base.errors import TactemuError, nearest, no_such, reason_of

UNITS = Path("/etc/systemd/system")
PREFIX = "tactemu-"

service = typer.Typer(help="Emulate a device from power-up on, as a service of systemd.", rich_markup_mode=None)

UnitName = Annotated[
    str | None, typer.Option("--unit", metavar="NAME", help="The service is tactemu-NAME. Default: after the target.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Print the steps as a shell script, and do nothing.")]


@service.command(context_settings={"ignore_unknown_options": True})
def install(
    arguments: Annotated[list[str], typer.Argument(metavar="TARGET [OPTION]...", help="As for `tactemu run`.")],
    unit: UnitName = None,
    user: Annotated[
        str | None, typer.Option("--user", help="Whom the service runs as. Default: who calls sudo.")
    ] = None,
    dry_run: DryRun = False,
) -> None:
    """Install and start a service that runs a device from power-up on.

    It runs `tactemu run TARGET ...`. It prints each step, and undoes them all if one fails. It needs root. A CAN
    interface gets the bit rates of the device first. Paths are relative to the present folder.

    \b
      tactemu service install anyskin --port serial:/dev/ttyUSB0 --dry-run
      sudo $(which tactemu) service install anyskin --port serial:ttyUSB0
      journalctl -u tactemu-anyskin            # what it says
      sudo $(which tactemu) service remove anyskin
    """
    name = _name(unit or Path(arguments[0].partition(":")[0]).stem)
    path = UNITS / f"{name}.service"
    user = user or os.environ.get("SUDO_USER") or pwd.getpwuid(os.getuid()).pw_name
    _check(arguments, user)
    steps = [
        Write(path, unit_text(arguments, user=user, folder=Path.cwd())),
        Run("systemctl", "daemon-reload"),
        Run("systemctl", "enable", "--now", path.name),
    ]
    _carry_out(steps, dry_run=dry_run, undo=_removal(path))


@service.command()
def remove(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="The name of the service, with or without tactemu- before it.")
    ],
    dry_run: DryRun = False,
) -> None:
    """Stop a service and remove all that `install` made.

    \b
      sudo $(which tactemu) service remove anyskin
      tactemu service remove anyskin --dry-run
    """
    path = UNITS / f"{_name(name.removeprefix(PREFIX))}.service"
    if not path.exists():
        there = sorted(each.stem.removeprefix(PREFIX) for each in UNITS.glob(f"{PREFIX}*.service"))
        raise TactemuError(no_such("service", path.stem.removeprefix(PREFIX), there))
    _carry_out(_removal(path), dry_run=dry_run)


def _name(word: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", word):
        raise TactemuError(
            f"a service cannot be called {word!r}; name it with --unit, in letters, digits, '_', '-', '.'"
        )
    return f"{PREFIX}{word}"


def _check(arguments: Sequence[str], user: str) -> None:
    """Raise if the service could not start.

    Raises:
        TactemuError: there is no such user, or no port.
    """
    try:
        pwd.getpwnam(user)
    except KeyError:
        near = nearest(user, (each.pw_name for each in pwd.getpwall()))
        raise TactemuError(f"there is no user {user!r}{near}") from None
    has_port = any(each == "--port" or each.startswith("--port=") for each in arguments)
    if not has_port and not arguments[0].endswith(".toml"):  # a scene file may have its ports
        raise TactemuError("a service needs its port, such as --port serial:/dev/ttyUSB0")


# -- the unit ----------------------------------------------------------------------------------------------------------


def unit_text(arguments: Sequence[str], *, user: str, folder: Path) -> str:
    """Return the unit of a service that runs ``tactemu run`` with these arguments."""
    command = [sys.executable, "-m", "tactemu", "run", *arguments]
    group = "SupplementaryGroups=dialout\n" if any(each.gr_name == "dialout" for each in grp.getgrall()) else ""
    before = "".join(f"ExecStartPre=+/bin/sh -c {_quoted(line)}\n" for line in _can_lines(arguments))
    return f"""# Made by `tactemu service install`; `tactemu service remove` undoes it.
[Unit]
Description=tactemu {_escaped(" ".join(arguments))}
After=network.target systemd-udevd.service
StartLimitIntervalSec=0

[Service]
{before}ExecStart={" ".join(map(_quoted, command))}
WorkingDirectory={_escaped(str(folder))}
User={user}
{group}Environment=PYTHONUNBUFFERED=1
LimitRTPRIO=1
Restart=always
RestartSec=2

[Install]
WantedBy=multi-user.target
"""


def _escaped(text: str) -> str:
    return text.replace("%", "%%")


def _quoted(text: str) -> str:
    """Return an argument as systemd reads it: quoted, without its specifiers and variables."""
    text = _escaped(text).replace("\\", "\\\\").replace('"', '\\"').replace("$", "$$")
    return text if re.fullmatch(r"[\w@%+=:,./-]+", text) else f'"{text}"'


def _can_lines(arguments: Sequence[str]) -> list[str]:
    """Return the commands that set up the CAN interfaces of the ports for a device from the list."""
    from firmware_protocols import DEVICES, Can, create
    from tactemu.transports import can_link

    names = [match[1] for each in arguments if (match := re.search(r"can:socketcan:([\w.-]+)$", each))]
    if not names or arguments[0] not in DEVICES:
        return []
    device = next((port for port in create(arguments[0]).ports if isinstance(port, Can)), Can())
    links = {name: can_link.can_link(name) for name in names}
    return [
        f"ip link set {name} down; {can_link.set_up(name, device).removeprefix('sudo ')} && "
        f"ip link set {name} txqueuelen 1000"
        for name, link in links.items()
        if link is None or link.is_real
    ]


# -- the steps ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Write:
    """A step that writes a file."""

    path: Path
    text: str

    def __str__(self) -> str:
        return f"cat >{shlex.quote(str(self.path))} <<'END'\n{self.text}END"

    def do(self) -> None:
        """Write it."""
        self.path.write_text(self.text)


class Run:
    """A step that runs a program."""

    def __init__(self, *command: str):
        self.command = command

    def __str__(self) -> str:
        return shlex.join(self.command)

    def do(self) -> None:
        """Run it."""
        subprocess.run(self.command, check=True)


def _removal(path: Path) -> list[Run]:
    commands = (("systemctl", "disable", "--now", path.name), ("rm", "-f", str(path)), ("systemctl", "daemon-reload"))
    return [Run(*each) for each in commands]


def _carry_out(steps: Sequence[Write | Run], *, dry_run: bool, undo: Sequence[Run] = ()) -> None:
    """Print and do each step, or print them as a script.

    Raises:
        TactemuError: one failed; those before it are undone.
    """
    if dry_run:
        typer.echo("\n".join(["#!/bin/sh", "set -e", *map(str, steps)]))
        return
    if not shutil.which("systemctl"):
        raise TactemuError("this machine has no systemd; --dry-run prints what to adapt")
    if not os.access(UNITS, os.W_OK):
        raise TactemuError(f"{UNITS} belongs to root: sudo $(which tactemu) service ...")
    for step in steps:
        typer.echo(str(step))
        try:
            step.do()
        except (OSError, subprocess.CalledProcessError) as error:
            for each in undo:
                typer.echo(str(each))
                subprocess.run(each.command, check=False, stderr=subprocess.DEVNULL)
            raise TactemuError(f"{step}: {reason_of(error)}; nothing of it is left") from None
