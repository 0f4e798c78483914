"""The commands of a truth log, read and repeated at the same times.

On ports in memory, which no driver opens, the driver's bytes are repeated, too: in lockstep, and without jitter, the
devices then answer with the same bytes.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from tactemu.base.errors import SceneError, TactemuError, shown
from tactemu.control.control import Control
from tactemu.control.control_commands import CONTROL_COMMANDS
from tactemu.transports.memory import MemoryTransport
from tactemu.truth import COMMAND, Passage, PortEvent, entries


class Command(NamedTuple):
    """One command of a log."""

    t_ns: int
    """Emulation time at which it was carried out."""
    verb: str
    args: dict[str, Any]
    by: str = ""
    """The client that sent it; "" for the program itself."""


def commands_of(path: str | Path) -> list[Command]:
    """Return the commands in a truth log, in their order.

    Raises:
        TactemuError: the file is missing or no log, or this version lacks one of its commands.
    """
    found = []
    for entry in entries(path):
        if isinstance(entry, PortEvent) and entry.is_command:
            try:
                found.append(_command(entry))
            except SceneError as error:
                raise TactemuError(f"{path}: command at {entry.t_ns / 1e9:g} s: {error}") from None
    return found


def _command(entry: PortEvent) -> Command:
    try:
        said = json.loads(entry.what.removeprefix(COMMAND))
    except (ValueError, RecursionError):
        said = None
    said = said if isinstance(said, dict) else {}
    verb, args = said.get("verb"), said.get("args")
    if verb == "restore":
        raise SceneError("the run was set back to an earlier state here, so its commands cannot be repeated")
    command = CONTROL_COMMANDS.get(verb) if isinstance(verb, str) else None
    if command is None or not command.changes or not isinstance(args, dict):
        raise SceneError(f"expected a verb and its arguments, got {shown(entry.what)}")
    return Command(entry.t_ns, command.name, command.checked(args), str(said.get("by", "")))


def replay_commands(control: Control, path: str | Path) -> int:
    """Schedule the commands of a log in the loop at their times; return their number. Call before the loop runs.

    Raises:
        TactemuError: as :func:`commands_of`.
    """
    commands, emulator = commands_of(path), control.emulator
    for command in commands:
        emulator.call(partial(_do, control, command), command.t_ns)
    wires = {wire.name: wire for wire in emulator.wires if isinstance(wire.transport, MemoryTransport)}
    for entry in entries(path) if wires else ():
        if isinstance(entry, Passage) and entry.kind == "rx" and entry.device in wires:
            emulator.at(entry.t_ns, partial(wires[entry.device].deliver, entry.frame, entry.t_ns))
    return len(commands)


def _do(control: Control, command: Command) -> None:
    control.do(command.verb, command.args, command.by)
