"""The file of an emulator's state: its tree and arrays (:mod:`firmware_protocols.state_file`), and a header.

A state of another run is refused, and so is a file that is much larger than a state of this run can be.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_protocols import state_file as plain
from tactemu.base.errors import StateError, reason_of
from tactemu.base.files import check_overwriting, writing
from tactemu.version import __version__

FORMAT = 1
MAX_TIME_NS = 10 * 366 * 86_400_000_000_000
"""Latest time of a state, ten years: times of a run that begins there still fit 64 bits."""
_HEADER = "header"
SIGN = f"{_HEADER}.npy"
"""The name of the first array of a state, which is among its first bytes."""
_MAX_EXTRA_BYTES = 64 << 20
"""Maximum size of the state of devices, queues and the like, beside the simulation."""


def header(recipe: Mapping[str, Any], t_ns: int) -> dict[str, Any]:
    """Return the header of a state: format, version of tactemu, time, and the recipe as texts."""
    return {"format": FORMAT, "tactemu": __version__, "t_ns": t_ns, "made_of": flat(recipe)}


def check_header(found: Any, recipe: Mapping[str, Any], where: str) -> None:
    """Raise if another version wrote the state, or if it is of another scene.

    Raises:
        StateError: names the difference.
    """
    here = header(recipe, 0)
    if not isinstance(found, dict) or found.keys() != here.keys():
        raise StateError(f"{where}: no state of tactemu, or of a much older or newer one")
    for name in ("format", "tactemu"):
        if found[name] != here[name]:
            raise StateError(
                f"{where}: was saved by tactemu {found['tactemu']!s:.40} (format {found['format']!s:.40}), this is "
                f"{here['tactemu']} (format {FORMAT}); a state is for the version that wrote it"
            )
    t_ns = found["t_ns"]
    if type(t_ns) is not int or not 0 <= t_ns <= MAX_TIME_NS:
        raise StateError(f"{where}: its time is {t_ns!r:.40} ns; expected 0 to {MAX_TIME_NS}")
    there = found["made_of"]
    if not isinstance(there, dict):
        raise StateError(f"{where}: its header names no scene")
    differs = [name for name in [*here["made_of"], *there] if here["made_of"].get(name) != there.get(name)]
    if differs:
        lines = [
            f"{name}: saved with {_shown(there, name)}, here {_shown(here['made_of'], name)}"
            for name in dict.fromkeys(differs)
        ]
        more = f"; and {len(lines) - 3} more" if len(lines) > 3 else ""
        raise StateError(f"{where}: is of another run: {'; '.join(lines[:3])}{more}")


def _shown(table: Mapping[str, Any], name: str) -> str:
    return f"{table[name]!s:.60}" if name in table else "nothing"


def flat(tree: Any, name: str = "") -> dict[str, str]:
    """Return a tree of plain data as one table of texts: ``{"skin[0].options.noise": "0.001"}``."""
    if isinstance(tree, Mapping):
        pairs = [(f"{name}.{key}".lstrip("."), value) for key, value in tree.items()]
    elif isinstance(tree, list | tuple):
        pairs = [(f"{name}[{k}]", value) for k, value in enumerate(tree)]
    else:
        return {name: str(tree)}
    found: dict[str, str] = {}
    for key, value in pairs:
        found |= flat(value, key)
    return found


def write(path: str | Path, head: Mapping[str, Any], state: dict[str, Any]) -> int:
    """Write a state; return its size [byte]. An older file of this name stays until the new one is complete.

    Raises:
        StateError: the file cannot be written.
        TactemuError: it is of another program.
    """
    path = Path(path)
    check_overwriting(path, SIGN)
    try:
        with writing(path) as file:
            plain.write(file, state, **{_HEADER: head})
        return path.stat().st_size
    except OSError as error:
        raise StateError(f"{path}: cannot write the state: {reason_of(error, path)}") from None


def read(path: str | Path, recipe: Mapping[str, Any], own_bytes: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header of a file and the state in it.

    Args:
        path: the file.
        recipe: the recipe that the state must have.
        own_bytes: size of the simulation's arrays here; it bounds the size of the file.

    Raises:
        StateError: the file cannot be read, or is no state of such a run; names the reason.
    """
    path = Path(path)
    try:
        size, most = path.stat().st_size, _MAX_EXTRA_BYTES + 4 * own_bytes
        if not path.is_file():
            raise StateError(f"{path}: is no file")
        if size > most:
            raise StateError(f"{path}: has {size} bytes; a state of this run has at most {most}")
        data = path.read_bytes()
    except OSError as error:
        raise StateError(f"{path}: cannot read the state: {reason_of(error)}") from None
    try:
        state, head = plain.read(data, _HEADER)
    except ValueError as error:
        raise StateError(f"{path}: no state, or a damaged one: {error!s:.200}") from None
    check_header(head, recipe, str(path))
    return head, state
