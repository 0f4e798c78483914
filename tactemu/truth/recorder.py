"""Recording of frames with their times to files."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import check_overwriting
from tactemu.base.formats import LOGS, RECORDABLE, format_of, names
from tactemu.truth.conversion import Converter
from tactemu.truth.entries import End, Header, Passage, PortEvent
from tactemu.truth.memory import size_of_frame
from tactemu.truth.writer import LogWriter


class Recorder:
    """A writer of recorded frames to a file, whose suffix decides the format.

    An existing file is unchanged until the first entry; a new one without entries is removed.

    Args:
        path: the file, in one of the formats in :data:`tactemu.base.formats.RECORDABLE`.
        device: the device name of all entries of a truth log.
        line: the first event of a truth log: ``baud 9600``, or ``usb`` where the line has no speed.

    Raises:
        TactemuError: another suffix, a file of another program, or one that cannot be written.
    """

    def __init__(self, path: str | Path, *, device: str = "recorded", line: str = ""):
        self.path, self.device = Path(path), device
        self.count = 0
        self._line = line
        self._can: Converter | None = None
        self._log: LogWriter | None = None
        self._made = self._refused = False
        self._format = format_of(self.path, RECORDABLE, f"cannot record to {self.path.suffix!r}")
        check_overwriting(self.path, self._format.sign)
        try:
            if self._format in LOGS:
                self._log = LogWriter(self.path, report=lambda _: None)  # raised here instead
            else:
                self._made = not self.path.exists()
                self.path.open("ab").close()
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
            self._can = can = self._format.load("converter")(self.path)
            can.begin(Header(origin_ns))

    def add(self, entry: Passage) -> None:
        """Write one entry.

        Raises:
            TactemuError: bytes for a CAN format, or the file cannot be written any more.
        """
        if self._log is None and not isinstance(entry.frame, CanFrame):
            raise TactemuError(
                f"{self.path}: {self.path.suffix} holds CAN frames; record bytes to {names(LOGS, dot='.')}"
            )
        if self._can is None and not (self._log is not None and self._log.has_begun):
            self.start()
        self.count += 1
        if self._log is not None:
            self._log.put(entry._replace(device=self.device), size_of_frame(entry.frame))
            if self._log.error is not None:
                raise self._cannot(self._log.error)
        elif self._can is not None:
            try:
                self._can.add(entry)
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
                can.finish(End())
            except OSError as error:
                raise self._cannot(error) from None
        if self._made:
            self.path.unlink(missing_ok=True)
            self._made = False

    def _cannot(self, error: Exception) -> TactemuError:
        self._refused = True
        why = reason_of(error) if isinstance(error, OSError) else repr(error)
        return TactemuError(f"{self.path}: cannot write the recording: {why}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        self.close()
