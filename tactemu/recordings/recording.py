"""Streams with their timing, to files and back: from a real sensor or from an emulated one, to a driver again.

CAN is kept in python-can's formats (``.log`` as of candump, ``.asc``, ``.blf``), serial streams in JSON lines with the
schema of the truth log (``.jsonl``; :mod:`tactemu.truth`), so that a truth log is a recording as it stands. ``tx`` is
towards the driver, as everywhere; a recording made at a driver's end has what it received as ``tx``.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Literal, Self

import numpy as np

from firmware_protocols import CanFrame, Frame
from tactemu.errors import TactemuError
from tactemu.scene.placement import Surroundings
from tactemu.truth import read, text

CAN_FORMATS = (".log", ".asc", ".blf")
SERIAL_FORMAT = ".jsonl"
_FORMATS = ", ".join((SERIAL_FORMAT, *CAN_FORMATS))


@dataclass(frozen=True, slots=True)
class Entry:
    """One frame of a recording."""

    t_ns: int
    frame: Frame
    kind: Literal["tx", "rx"] = "tx"
    """``tx``: to the driver; ``rx``: from it."""
    device: str = ""


@dataclass(frozen=True)
class Recording:
    """A whole recording."""

    entries: list[Entry]
    """In order of time, from 0 at the first."""
    baud: int | None = None
    """Speed of the serial line, where the file says [bit/s]."""

    @property
    def kind(self) -> str:
        """``serial`` or ``can``: the wire that it needs."""
        return "can" if any(isinstance(entry.frame, CanFrame) for entry in self.entries) else "serial"

    def towards_driver(self) -> list[Entry]:
        """The entries that a replay sends."""
        return [entry for entry in self.entries if entry.kind == "tx"]


class Recorder:
    """Writes entries to a file; the format follows the suffix.

    Args:
        path: ``.jsonl`` for bytes or CAN, ``.log``, ``.asc`` or ``.blf`` for CAN.
        device: name that goes with every entry of a ``.jsonl`` file.
        baud: noted at the head of a ``.jsonl`` file.

    Raises:
        TactemuError: another suffix, or the file cannot be written.
    """

    def __init__(self, path: str | Path, *, device: str = "recorded", baud: int | None = None):
        self.path, self.device = Path(path), device
        self.count = 0
        self._baud = baud
        self._lines: IO[str] | None = None
        self._log: Any = None
        self._made = not self.path.exists()
        if self.path.suffix not in (SERIAL_FORMAT, *CAN_FORMATS):
            raise TactemuError(f"{path}: cannot record to {self.path.suffix!r}; expected one of {_FORMATS}")
        try:
            self.path.open("ab").close()  # an older recording is kept until there is something to record
        except OSError as error:
            raise TactemuError(f"{path}: cannot write the recording: {error.strerror}") from None

    def start(self) -> None:
        """Begin the file, in place of what was there. The first entry does it, too."""
        self._made = False
        if self.path.suffix == SERIAL_FORMAT:
            self._lines = self.path.open("w", encoding="utf-8")
            if self._baud is not None:
                self._line(0, "event", what=f"baud {self._baud}")
        else:
            import can

            self._log = can.Logger(self.path)

    def add(self, entry: Entry) -> None:
        """Write one entry.

        Raises:
            TactemuError: bytes for a CAN format.
        """
        if self._lines is None and self._log is None:
            self.start()
        self.count += 1
        if self._lines is not None:
            self._line(entry.t_ns, entry.kind, data=text(entry.frame))
        elif not isinstance(entry.frame, CanFrame):
            raise TactemuError(f"{self.path}: {self.path.suffix} holds CAN frames; record bytes to {SERIAL_FORMAT}")
        elif self._log is not None:
            self._log.on_message_received(_message(entry))

    def close(self) -> None:
        """Finish the file; one that was never begun is not left behind. Safe to call twice."""
        if self._lines is not None:
            self._lines.close()
        if self._log is not None:
            self._log.stop()
        self._lines = self._log = None
        if self._made:
            self.path.unlink(missing_ok=True)
            self._made = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        self.close()

    def _line(self, t_ns: int, kind: str, **more: Any) -> None:
        assert self._lines is not None
        self._lines.write(json.dumps({"t_ns": t_ns, "device": self.device, "kind": kind, **more}) + "\n")


def load(path: str | Path) -> Recording:
    """Read a recording or a truth log.

    Raises:
        TactemuError: no such file, another format, or a line that is none; the message says which.
    """
    path = Path(path)
    try:
        if path.suffix == SERIAL_FORMAT:
            return _load_lines(path)
        if path.suffix in CAN_FORMATS:
            return Recording(_from_zero(_read_can(path)))
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the recording: {error.strerror}") from None
    except (ValueError, KeyError, IndexError, AssertionError) as error:
        raise TactemuError(f"{path}: not a recording: {error}") from None
    raise TactemuError(f"{path}: unknown format {path.suffix!r}; expected one of {_FORMATS}")


def parse_frame(data: str) -> Frame:
    """A frame from the log's text: hex for bytes, candump notation for CAN.

    Raises:
        ValueError: neither.
    """
    ident, mark, rest = data.partition("#")
    if not mark:
        return bytes.fromhex(data)
    known = {"arbitration_id": int(ident, 16), "is_extended_id": len(ident) == 8}
    if rest == "ERROR":
        return CanFrame(**known, is_error_frame=True)
    if rest == "R":
        return CanFrame(**known, is_remote_frame=True)
    if rest.startswith("#"):
        return CanFrame(**known, is_fd=True, bitrate_switch=bool(int(rest[1], 16) & 1), data=bytes.fromhex(rest[2:]))
    return CanFrame(**known, data=bytes.fromhex(rest))


def _load_lines(path: Path) -> Recording:
    entries, baud = [], None
    for row in read(path):
        if row["kind"] in ("tx", "rx"):
            entries.append(Entry(int(row["t_ns"]), parse_frame(row["data"]), row["kind"], row.get("device", "")))
        elif row["kind"] == "event" and row["what"].startswith("baud "):
            baud = baud or int(row["what"].removeprefix("baud "))
    return Recording(_from_zero(entries), baud)


def _read_can(path: Path) -> Iterator[Entry]:
    import can

    with can.LogReader(path) as messages:
        for message in messages:
            if message.is_error_frame:
                continue
            frame = CanFrame(
                arbitration_id=message.arbitration_id,
                data=b"" if message.is_remote_frame else bytes(message.data),
                is_extended_id=message.is_extended_id,
                is_remote_frame=message.is_remote_frame,
                is_fd=message.is_fd,
                bitrate_switch=message.bitrate_switch,
            )
            yield Entry(round(message.timestamp * 1e9), frame, "tx" if message.is_rx else "rx")


def _from_zero(entries: Iterable[Entry]) -> list[Entry]:
    entries = sorted(entries, key=lambda entry: entry.t_ns)
    start = entries[0].t_ns if entries else 0
    return [Entry(entry.t_ns - start, entry.frame, entry.kind, entry.device) for entry in entries]


def _message(entry: Entry) -> Any:
    import can

    frame = entry.frame
    assert isinstance(frame, CanFrame)
    return can.Message(
        timestamp=entry.t_ns / 1e9,
        arbitration_id=frame.arbitration_id,
        data=frame.data,
        is_extended_id=frame.is_extended_id,
        is_remote_frame=frame.is_remote_frame,
        is_fd=frame.is_fd,
        bitrate_switch=frame.bitrate_switch,
        is_error_frame=frame.is_error_frame,
        is_rx=entry.kind == "tx",
        channel=0,
    )


class RecordedReadings:
    """Readings from a truth log in place of physics: a source and, for the loop, the simulation that goes with it.

    Between two samples the earlier one holds; before the first, the first does.

    Args:
        path: a truth log (``tactemu run --truth FILE``).
        device: whose samples; may be left out where the log has one device only.

    Raises:
        TactemuError: the file is no truth log, or has no samples of this device.
    """

    imperfections = None
    """They are in the recording, or in the sensor that it was made of."""

    def __init__(self, path: str | Path, device: str = ""):
        try:
            rows = [row for row in read(path) if row["kind"] == "sample"]
        except OSError as error:
            raise TactemuError(f"{path}: cannot read the truth log: {error.strerror}") from None
        except (ValueError, KeyError) as error:
            raise TactemuError(f"{path}: not a truth log: {error}") from None
        names = sorted({row["device"] for row in rows})
        if not device and len(names) == 1:
            device = names[0]
        rows = [row for row in rows if row["device"] == device]
        if not rows:
            raise TactemuError(
                f"{path}: no samples of {device or 'one device'!r}; it has: {', '.join(names) or 'none'}"
            )
        self.times_ns = np.array([row["t_ns"] for row in rows], np.int64)
        self._measured = np.array([row["measured"] for row in rows], float)
        self._ideal = np.array([row["ideal"] for row in rows], float)
        self._now = 0

    def advance_to(self, t_ns: int) -> None:
        """Move to this time."""
        self._now = max(0, int(np.searchsorted(self.times_ns, t_ns, side="right")) - 1)

    def surroundings(self, t_ns: int) -> Surroundings:
        """Not recorded: room temperature, at rest."""
        return Surroundings()

    def quantity(self, name: str, ground_truth: bool = False) -> np.ndarray:
        """The recorded reading at the present time, whatever quantity it was; shape ``(n_taxels[, 3])``."""
        return (self._ideal if ground_truth else self._measured)[self._now]
