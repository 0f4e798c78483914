"""Captures of a real sensor: recordings, candump's logs, hex dumps and raw bytes, read in a stream."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.formats import LOGS, READABLE, Format
from tactemu.truth import Passage, entries

BLOCK_BYTES = 1 << 16
HEX_FORMATS = (".hex", ".txt")
SCREEN_FORMATS = (".log", ".dump", ".candump", ".txt")
_HEX_LINE = re.compile(r"(?:\(?(\d+\.\d+)\)?\s+)?([<>]\s*|rx\s+|tx\s+)?((?:[0-9A-Fa-f]{2}\s*)+)")
_CANDUMP_SCREEN = re.compile(
    r"(?:\(([\d.]+)\)\s+)?(\S+)\s+([0-9A-F]{3,8})\s+\[(\d+)\]\s*((?:[0-9A-F]{2}\s?)*)\s*(?:'.*)?"
)
_CANDUMP_LOG = re.compile(r"\([\d.]+\) +\S+ +\S+#\S*(?: +[RT])?")


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that came at once, or one CAN frame."""

    t_ns: int | None
    """The time, ``None`` if the capture has none."""
    direction: Literal["tx", "rx"]
    """``tx`` from the sensor, ``rx`` to it."""
    data: bytes
    id: int | None = None
    """The identifier of a CAN frame."""
    is_extended: bool = False
    is_fd: bool = False


@dataclass(frozen=True)
class Capture:
    """One or several files of one line or bus, which can be read more than once."""

    paths: tuple[Path, ...]

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of all files in order.

        Raises:
            TactemuError: a file cannot be read, or is no capture.
        """
        for path in self.paths:
            try:
                yield from read(path)
            except OSError as error:
                raise TactemuError(f"{path}: cannot read the capture: {reason_of(error)}") from None
            except UnicodeDecodeError:
                raise TactemuError(
                    f"{path}: not text, as its suffix {path.suffix!r} says; name raw bytes .bin"
                ) from None


def read(path: Path) -> Iterator[Chunk]:
    """Yield the chunks of one file; its suffix says which format it has, any other suffix is raw bytes."""
    form = next((each for each in READABLE if path.name.endswith(each.suffix)), None)
    if path.suffix in SCREEN_FORMATS and _is_screen(path):
        yield from _read_screen(path)
    elif path.suffix in HEX_FORMATS:
        yield from _read_hex(path)
    elif form is None:
        with path.open("rb") as file:
            while block := file.read(BLOCK_BYTES):
                yield Chunk(None, "tx", block)
    else:
        for entry in entries(path) if form in LOGS else _frames(path, form):
            if isinstance(entry, Passage) and entry.kind != "drop":
                yield _chunk(entry.t_ns, entry.kind, entry.frame)


def _frames(path: Path, form: Format) -> Iterator[Passage]:
    try:
        yield from form.load("reader")(path)
    except OSError:
        raise
    except Exception as error:  # python-can's readers raise any error for a damaged file
        raise TactemuError(f"{path}: not a recording: {str(error) or type(error).__name__}") from None


def _chunk(t_ns: int | None, kind: Literal["tx", "rx"], frame: CanFrame | bytes) -> Chunk:
    if isinstance(frame, CanFrame):
        return Chunk(t_ns, kind, bytes(frame.data), frame.arbitration_id, frame.is_extended_id, frame.is_fd)
    return Chunk(t_ns, kind, frame)


def _read_hex(path: Path) -> Iterator[Chunk]:
    """Yield the lines of a hex dump, each ``[time] [< or >] bytes``; ``>`` is towards the sensor."""
    with path.open(encoding="ascii") as lines:
        for number, line in enumerate(lines, 1):
            if not line.strip() or line.startswith("#"):
                continue
            match = _HEX_LINE.fullmatch(line.strip())
            if match is None:
                raise TactemuError(
                    f"{path}: line {number}: expected `[time] [<|>] hex bytes`, got {line.strip()[:40]!r}"
                )
            t_ns = None if match[1] is None else round(float(match[1]) * 1e9)
            is_question = (match[2] or "").strip() in (">", "rx")
            yield Chunk(t_ns, "rx" if is_question else "tx", bytes.fromhex(match[3]))


def _is_screen(path: Path) -> bool:
    """Return True if a file is what candump prints on a screen, not what ``candump -L`` writes."""
    with path.open(encoding="ascii", errors="replace") as lines:
        first = next((line.strip() for line in lines if line.strip()), "")
    return _CANDUMP_LOG.fullmatch(first) is None and _CANDUMP_SCREEN.fullmatch(first) is not None


def _read_screen(path: Path) -> Iterator[Chunk]:
    with path.open(encoding="ascii") as lines:
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            match = _CANDUMP_SCREEN.fullmatch(line.strip())
            data = bytes.fromhex(match[5]) if match else b""
            if match is None or len(data) != int(match[4]):
                raise TactemuError(
                    f"{path}: line {number}: expected `can0  201   [8]  00 ..`, got {line.strip()[:40]!r}"
                )
            t_ns = None if match[1] is None else round(float(match[1]) * 1e9)
            yield Chunk(t_ns, "tx", data, int(match[3], 16), len(match[3]) > 3, len(data) > 8)
