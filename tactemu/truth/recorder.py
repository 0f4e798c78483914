"""Recording of frames with their times to files."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from firmware_protocols import CanFrame, WireFrame
from tactemu.base.errors import TactemuError
from tactemu.base.frame_text import text
from tactemu.truth.entries import Header, Passage, PortEvent
from tactemu.truth.memory import size_of_frame
from tactemu.truth.recording import Entry
from tactemu.truth.writer import SUFFIXES, LogWriter

WRITABLE_CAN_FORMATS = (".log", ".asc", ".blf")
"""Formats of CAN alone that can be written."""
_FORMATS = ", ".join((*SUFFIXES, *WRITABLE_CAN_FORMATS))


class Recorder:
    """A writer of recorded frames to a file, whose suffix decides the format.

    An existing file is unchanged until the first entry; a new one without entries is removed.

    Args:
        path: ``.mcap`` or ``.jsonl`` for bytes or CAN, ``.log``, ``.asc`` or ``.blf`` for CAN.
        device: the device name of all entries of a ``.mcap`` or ``.jsonl`` file.
        line: the first event of such a file: ``baud 9600``, or ``usb`` where the line has no speed.

    Raises:
        TactemuError: another suffix, or the file cannot be written.
    """

    def __init__(self, path: str | Path, *, device: str = "recorded", line: str = ""):
        self.path, self.device = Path(path), device
        self.count = 0
        self._line = line
        self._can: _Candump | _PythonCan | None = None
        self._log: LogWriter | None = None
        self._made = self._refused = False
        try:
            if self.path.suffix in SUFFIXES:
                self._log = LogWriter(self.path, report=lambda _: None)  # raised here instead
            elif self.path.suffix in WRITABLE_CAN_FORMATS:
                self._made = not self.path.exists()
                self.path.open("ab").close()
            else:
                raise TactemuError(f"{path}: cannot record to {self.path.suffix!r}; expected one of {_FORMATS}")
        except OSError as error:
            raise self._cannot(error) from None

    def start(self, origin_ns: int | None = None) -> None:
        """Begin the file and overwrite its older content; the first :meth:`add` does so too.

        Args:
            origin_ns: the machine's monotonic clock at the entries' time 0.
        """
        if self._log is not None:
            self._log.begin(Header(origin_ns))
            if self._line:
                self._log.put(PortEvent(0, self.device, self._line), 0)
        else:
            self._made = False
            self._can = _Candump(self.path) if self.path.suffix == ".log" else _PythonCan(self.path)

    def add(self, entry: Entry) -> None:
        """Write one entry.

        Raises:
            TactemuError: bytes for a CAN format, or the file cannot be written any more.
        """
        if self._log is None and not isinstance(entry.frame, CanFrame):
            raise TactemuError(f"{self.path}: {self.path.suffix} holds CAN frames; record bytes to .mcap or .jsonl")
        if self._can is None and not (self._log is not None and self._log.has_begun):
            self.start()
        self.count += 1
        if self._log is not None:
            self._log.put(Passage(entry.t_ns, self.device, entry.kind, entry.frame), size_of_frame(entry.frame))
            if self._log.error is not None:
                raise self._cannot(self._log.error)
        elif self._can is not None:
            try:
                self._can.add(entry.frame, entry.t_ns, to_driver=entry.kind == "tx")
            except OSError as error:
                raise self._cannot(error) from None

    def close(self) -> None:
        """Finish the file. Safe to call twice.

        Raises:
            TactemuError: it cannot be written to its end.
        """
        can, self._can = self._can, None
        log, self._log = self._log, None
        if log is not None:
            log.close()
            if log.error is not None and not self._refused:
                raise self._cannot(log.error)
        elif can is not None:
            try:
                can.close()
            except OSError as error:
                raise self._cannot(error) from None
        if self._made:
            self.path.unlink(missing_ok=True)
            self._made = False

    def _cannot(self, error: Exception) -> TactemuError:
        self._refused = True
        why = error.strerror if isinstance(error, OSError) else repr(error)
        return TactemuError(f"{self.path}: cannot write the recording: {why}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        self.close()


class _Candump:
    """A writer of ``candump -L``'s lines; python-can's own changes the class of every error frame."""

    def __init__(self, path: Path):
        self._file = path.open("w", encoding="ascii")

    def add(self, frame: WireFrame, t_ns: int, *, to_driver: bool) -> None:
        """Write one frame; ``T`` marks those that the driver sent."""
        time = f"{t_ns // 10**9}.{t_ns // 1000 % 10**6:06d}"
        self._file.write(f"({time}) can0 {text(frame)} {'R' if to_driver else 'T'}\n")

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


class _PythonCan:
    """A writer of python-can's formats."""

    def __init__(self, path: Path):
        import can

        self._logger = can.Logger(path)

    def add(self, frame: WireFrame, t_ns: int, *, to_driver: bool) -> None:
        """Write one frame."""
        from tactemu.transports.can_messages import message_of

        assert isinstance(frame, CanFrame)
        self._logger.on_message_received(message_of(frame, t_ns / 1e9, received=to_driver))

    def close(self) -> None:
        """Finish the file."""
        self._logger.stop()
