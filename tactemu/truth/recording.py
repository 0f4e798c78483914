"""Reading of recorded frames with their times, of real and of emulated sensors.

A truth log is also a recording (``.mcap`` and ``.jsonl``; :mod:`tactemu.truth`); CAN is also read in
python-can's formats, candump's among them. ``tx`` is towards the driver, as everywhere; in a recording made at a
driver's end, frames that it received are ``tx``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from firmware_protocols import CanFrame, WireFrame
from tactemu.base.errors import TactemuError
from tactemu.base.frame_text import checked, parse
from tactemu.truth import Passage, PortEvent, entries
from tactemu.truth.writer import SUFFIXES

CANDUMP_FORMATS = (".log", ".dump", ".candump")
"""Suffixes of candump's text files."""
READABLE_CAN_FORMATS = (*CANDUMP_FORMATS, ".asc", ".blf", ".trc", ".csv", ".mf4")
"""Formats of CAN alone that can be read; :mod:`tactemu.truth.recorder` has those that can be written."""
READABLE_FORMATS = (*SUFFIXES, *READABLE_CAN_FORMATS)
"""Suffixes of all files that can be read."""
_CANDUMP_LINE = re.compile(r"\(([\d.]+)\) +\S+ +(\S+)(?: +([RT]))?")
_MAX_TIME_S = 9e9
"""Latest time of a frame [s]: later ones do not fit 64 bits in nanoseconds."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One frame of a recording."""

    t_ns: int
    frame: WireFrame
    kind: Literal["tx", "rx"] = "tx"
    """The direction, ``tx`` to the driver or ``rx`` from it."""
    device: str = ""


@dataclass(frozen=True)
class Recording:
    """A recording of one serial line, or of one CAN bus."""

    entries: list[Entry]
    """The frames in order of time, from 0 at the first."""
    baud: int | None = None
    """The speed of the serial line [bit/s], or ``None`` if the file does not have it."""

    @property
    def kind(self) -> str:
        """The wire that it needs, ``serial`` or ``can``."""
        return "can" if any(isinstance(entry.frame, CanFrame) for entry in self.entries) else "serial"

    def towards_driver(self) -> list[Entry]:
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
    if path.suffix in SUFFIXES:
        return _load_log(path, skin)
    if path.suffix not in READABLE_CAN_FORMATS:
        raise TactemuError(f"{path}: unknown format {path.suffix!r}; expected one of {', '.join(READABLE_FORMATS)}")
    try:
        found = list(_read_candump(path) if path.suffix in CANDUMP_FORMATS else _read_can(path))
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the recording: {error.strerror}") from None
    except Exception as error:  # python-can's readers, and their libraries, raise any error for a damaged file
        raise TactemuError(f"{path}: not a recording: {str(error) or type(error).__name__}") from None
    if not found:
        raise TactemuError(f"{path}: not a recording: there is no CAN frame in it")
    return Recording(_from_zero(found))


def _load_log(path: Path, skin: str | None) -> Recording:
    found: list[Entry] = []
    bauds: dict[str, int] = {}
    for entry in entries(path):
        if isinstance(entry, Passage) and entry.kind != "drop":
            found.append(Entry(entry.t_ns, entry.frame, entry.kind, entry.device))
        elif isinstance(entry, PortEvent) and entry.what.startswith("baud "):
            bauds.setdefault(entry.device, _baud(path, entry.what))
    if skin is not None:
        found = [entry for entry in found if skin in (entry.device, *entry.device.split("+"))]
    _check_one_line(path, found)
    owners = {entry.device for entry in found} or set(bauds)
    return Recording(_from_zero(found), next((baud for owner, baud in bauds.items() if owner in owners), None))


def _baud(path: Path, what: str) -> int:
    digits = what.removeprefix("baud ")
    if not (digits.isascii() and digits.isdigit() and len(digits) < 10 and int(digits)):
        raise TactemuError(f"{path}: not a recording: expected an event `baud N`, got {what[:40]!r}")
    return int(digits)


def _check_one_line(path: Path, found: list[Entry]) -> None:
    """Raise if the frames cannot be those of a single line.

    Raises:
        TactemuError: frames of several serial lines, or of serial lines and CAN.
    """
    serial = sorted({entry.device for entry in found if not isinstance(entry.frame, CanFrame)})
    bus = sorted({entry.device for entry in found if isinstance(entry.frame, CanFrame)})
    if len(serial) > 1 or (serial and bus):
        kinds = [f"{kind} of {', '.join(map(repr, of))}" for kind, of in (("bytes", serial), ("CAN frames", bus)) if of]
        raise TactemuError(f"{path}: holds {' and '.join(kinds)}; one port carries one of them: choose it with --skin")


def _read_candump(path: Path) -> Iterator[Entry]:
    """Yield the frames of ``candump -L``: ``(time) interface frame``, and ``T`` for frames sent by its machine.

    python-can's reader takes most error frames for frames with data.
    """
    with path.open(encoding="ascii") as lines:
        for number, line in enumerate(lines, 1):
            match = _CANDUMP_LINE.fullmatch(line.strip())
            if match is None:
                raise ValueError(f"line {number}: expected `(time) interface id#data`, got {line[:60].strip()!r}")
            try:
                frame = parse(match[2])
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from None
            if not isinstance(frame, CanFrame):
                raise ValueError(f"line {number}: {match[2]!r:.60} is no CAN frame")
            if not frame.is_error_frame:
                yield Entry(_nanoseconds(float(match[1])), frame, "rx" if match[3] == "T" else "tx")


def _nanoseconds(time_s: float) -> int:
    """Return a time in seconds as integer nanoseconds.

    Raises:
        ValueError: it is not finite, or does not fit 64 bits.
    """
    if not math.isfinite(time_s) or abs(time_s) > _MAX_TIME_S:
        raise ValueError(f"a frame at {time_s} s")
    return round(time_s * 1e9)


def _read_can(path: Path) -> Iterator[Entry]:
    import can

    from tactemu.transports.can_messages import frame_of

    size = path.stat().st_size
    reader: Any = can.LogReader(path)
    with reader as messages:
        if size < getattr(messages, "file_size", 0):
            raise ValueError(f"cut off: {size} of {messages.file_size} bytes")
        for message in messages:
            if message.is_error_frame:
                continue
            yield Entry(_nanoseconds(message.timestamp), checked(frame_of(message)), "tx" if message.is_rx else "rx")


def _from_zero(entries: Iterable[Entry]) -> list[Entry]:
    entries = sorted(entries, key=lambda entry: entry.t_ns)
    start = entries[0].t_ns if entries else 0
    return [Entry(entry.t_ns - start, entry.frame, entry.kind, entry.device) for entry in entries]
