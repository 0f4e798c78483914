"""Reading of recorded frames with their times, of real and of emulated sensors.

A truth log is also a recording; CAN is also read in other formats (:mod:`tactemu.base.formats`). ``tx`` is towards the
driver, as everywhere; in a recording made at a driver's end, frames that it received are ``tx``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.formats import LOGS, READABLE, format_of
from tactemu.truth.entries import Passage, PortEvent
from tactemu.truth.log_reader import SkinChoice, entries


@dataclass(frozen=True)
class Recording:
    """A recording of one serial line, or of one CAN bus."""

    entries: list[Passage]
    """The frames in order of time, from 0 at the first."""
    baud: int | None = None
    """The speed of the serial line [bit/s], or ``None`` if the file does not have it."""

    @property
    def kind(self) -> str:
        """The wire that it needs, ``serial`` or ``can``."""
        return "can" if any(isinstance(entry.frame, CanFrame) for entry in self.entries) else "serial"

    def towards_driver(self) -> list[Passage]:
        """Return the entries that a replay sends."""
        return [entry for entry in self.entries if entry.kind == "tx"]


def load(path: str | Path, skin: str | None = None) -> Recording:
    """Read a recording or a truth log.

    Args:
        path: the file; its suffix says which format it has.
        skin: the skin to read, where a truth log has several; default: the only one, or all on one CAN bus.

    Raises:
        TactemuError: no such file, another format, or frames in it that no line carries; the message names them.
    """
    path = Path(path)
    form = format_of(path, READABLE, f"unknown format {path.suffix!r}")
    if form in LOGS:
        return _load_log(path, skin)
    try:
        found = list(form.load("reader")(path))
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the recording: {reason_of(error)}") from None
    except Exception as error:  # python-can's readers, and their libraries, raise any error for a damaged file
        raise TactemuError(f"{path}: not a recording: {str(error) or type(error).__name__}") from None
    if not found:
        raise TactemuError(f"{path}: not a recording: there is no CAN frame in it")
    return Recording(_from_zero(found))


def _load_log(path: Path, skin: str | None) -> Recording:
    found: list[Passage] = []
    bauds: dict[str, int] = {}
    choice = SkinChoice(skin)
    for entry in entries(path):
        if choice.takes(entry) and isinstance(entry, Passage) and entry.kind != "drop":
            found.append(entry)
        elif isinstance(entry, PortEvent) and entry.what.startswith("baud "):
            bauds.setdefault(entry.device, _baud(path, entry.what))
    choice.check(path)
    _check_one_line(path, found)
    owners = {entry.device for entry in found} or set(bauds)
    return Recording(_from_zero(found), next((baud for owner, baud in bauds.items() if owner in owners), None))


def _baud(path: Path, what: str) -> int:
    digits = what.removeprefix("baud ")
    if not (digits.isascii() and digits.isdigit() and len(digits) < 10 and int(digits)):
        raise TactemuError(f"{path}: not a recording: expected an event `baud N`, got {what[:40]!r}")
    return int(digits)


def _check_one_line(path: Path, found: list[Passage]) -> None:
    """Raise if the frames cannot be those of a single line.

    Raises:
        TactemuError: frames of several serial lines, or of serial lines and CAN.
    """
    serial = sorted({entry.device for entry in found if not isinstance(entry.frame, CanFrame)})
    bus = sorted({entry.device for entry in found if isinstance(entry.frame, CanFrame)})
    if len(serial) > 1 or (serial and bus):
        kinds = [f"{kind} of {', '.join(map(repr, of))}" for kind, of in (("bytes", serial), ("CAN frames", bus)) if of]
        raise TactemuError(f"{path}: holds {' and '.join(kinds)}; one port carries one of them: choose it with --skin")


def _from_zero(found: Iterable[Passage]) -> list[Passage]:
    found = sorted(found, key=lambda entry: entry.t_ns)
    return [entry._replace(t_ns=entry.t_ns - found[0].t_ns) for entry in found]
