"""Files of CAN frames alone: candump's text, and the formats of python-can.

``tx`` is towards the driver, as everywhere; in a recording made at a driver's end, frames that it received are ``tx``.
Entries of files have no device.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from firmware_protocols import CanFrame
from tactemu.base.frame_text import checked, parse
from tactemu.truth.entries import End, Entry, Header, Passage

_CANDUMP_LINE = re.compile(r"\(([\d.]+)\) +\S+ +(\S+)(?: +([RT]))?")
_MAX_TIME_S = 9e9
"""Latest time of a frame [s]: later ones do not fit 64 bits in nanoseconds."""


def read_candump(path: Path) -> Iterator[Passage]:
    """Yield the frames of ``candump -L``: ``(time) interface frame``, and ``T`` for frames sent by its machine.

    python-can's reader takes most error frames for frames with data.

    Raises:
        OSError, ValueError: the file cannot be read, or is damaged.
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
                yield Passage(_nanoseconds(float(match[1])), "", "rx" if match[3] == "T" else "tx", frame)


def read_can(path: Path) -> Iterator[Passage]:
    """Yield the frames of a file in one of python-can's formats.

    Raises:
        Exception: the file cannot be read, or is damaged; python-can's readers, and their libraries, raise any error.
    """
    import can

    from tactemu.transports.can_messages import frame_of

    size = path.stat().st_size
    reader: Any = can.LogReader(path)
    with reader as messages:
        if size < getattr(messages, "file_size", 0):
            raise ValueError(f"cut off: {size} of {messages.file_size} bytes")
        for message in messages:
            if not message.is_error_frame:
                kind = "tx" if message.is_rx else "rx"
                yield Passage(_nanoseconds(message.timestamp), "", kind, checked(frame_of(message)))


def _nanoseconds(time_s: float) -> int:
    """Return a time in seconds as integer nanoseconds.

    Raises:
        ValueError: it is not finite, or does not fit 64 bits.
    """
    if not math.isfinite(time_s) or abs(time_s) > _MAX_TIME_S:
        raise ValueError(f"a frame at {time_s} s")
    return round(time_s * 1e9)


class CandumpFile:
    """A writer of ``candump -L``'s lines; python-can's own changes the class of every error frame."""

    def __init__(self, target: Path):
        self._file = target.open("w", encoding="ascii")

    def begin(self, header: Header) -> None:
        """Do nothing: there is no head, or python-can has written it."""

    def add(self, entry: Entry) -> bool:
        """Write a frame; return False for another entry."""
        if not isinstance(entry, Passage) or entry.kind == "drop" or not isinstance(entry.frame, CanFrame):
            return False
        self._write(entry, entry.frame)
        return True

    def _write(self, entry: Passage, frame: CanFrame) -> None:
        time = f"{entry.t_ns // 10**9}.{entry.t_ns // 1000 % 10**6:06d}"
        self._file.write(f"({time}) can0 {entry.text} {'R' if entry.kind == 'tx' else 'T'}\n")

    def finish(self, end: End) -> None:
        """Close the file."""
        self._file.close()


class PythonCanFile(CandumpFile):
    """A writer of the formats of python-can."""

    def __init__(self, target: Path):
        import can

        self._logger = can.Logger(target)

    def _write(self, entry: Passage, frame: CanFrame) -> None:
        from tactemu.transports.can_messages import message_of

        self._logger.on_message_received(message_of(frame, entry.t_ns / 1e9, received=entry.kind == "tx"))

    def finish(self, end: End) -> None:
        """Finish the file."""
        self._logger.stop()
