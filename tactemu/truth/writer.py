"""The thread that writes a truth log, so that the loop never waits for a disk.

The loop queues entries; the thread converts them to the file's format, compresses and writes them. It works in slices
of a fraction of a millisecond and sleeps between them, so that the loop gets the interpreter in time. The queue is
bounded in bytes; where the disk is too slow, or full, entries are lost and counted, and the loop goes on.
"""

from __future__ import annotations

import contextlib
import logging
import os
import stat
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactemu.base.errors import reason_of
from tactemu.base.files import remove_at_end
from tactemu.base.formats import LOGS, Format, format_of
from tactemu.truth.entries import End, Entry, Header

if TYPE_CHECKING:
    from tactemu.truth.jsonl_format import JsonlWriter
    from tactemu.truth.mcap_format import McapWriter

MAX_WAITING_BYTES = 64_000_000
"""Maximum size of the entries that wait for the disk [byte]."""
_MAX_UNSAVED_S = 2.0
"""Maximum time that a log lacks when its process is killed [s]."""
_POLL_PERIOD_S = 0.02
"""Period with which the thread polls the queue [s]."""
_SLICE_S = 5e-5
"""Time for which the thread works before it sleeps [s]."""
_MAX_SLICE_S = 1e-3
"""Maximum of that time after a sleep that lasted too long [s]."""
_PAUSE_S = 5e-4
"""Time for which the thread sleeps while little waits [s]."""
_MIN_PAUSE_S = 5e-5
"""Minimum of that time, while much waits [s]."""
_MIN_PAUSE_BYTES = 1_000_000
"""Size of the waiting entries from which on the thread sleeps for the minimum [byte]."""

_logger = logging.getLogger(__name__)


def log_format(path: Path) -> Format:
    """Return the format of a log by the suffix of its file.

    Raises:
        TactemuError: another suffix.
    """
    return format_of(path, LOGS, "the suffix decides the format of a log")


class LogWriter:
    """A log file and its thread. Only one thread may call :meth:`put`.

    An existing file is unchanged until :meth:`begin`; a new one that was never begun is removed by :meth:`close`.

    Args:
        path: the file; its suffix decides the format. Its content is overwritten.
        report: is called once when writing fails, and once when entries are lost to a slow disk.
        flush_s: maximum time that a log lacks when its process is killed [s]; default: 2.

    Raises:
        TactemuError: another suffix.
        OSError: it cannot be written.
    """

    def __init__(
        self, path: str | Path, *, report: Callable[[str], None] = _logger.error, flush_s: float | None = None
    ):
        self.path, self._report = Path(path), report
        self._flush_s = _MAX_UNSAVED_S if flush_s is None else flush_s
        self._maker = log_format(self.path).load("log_writer")
        self.error: Exception | None = None
        """The error that ended the writing."""
        self.block_when_full = False
        """True to block the loop rather than lose entries, where time is virtual."""
        self._made = not self.path.exists()
        self._file = _File(self.path)
        self._format: JsonlWriter | McapWriter | None = None
        self._entries: deque[tuple[Entry, int]] = deque()
        self._handed_over = self._taken = self._refused = 0
        self._unsaved = self._failed = 0
        self._slice_s = _SLICE_S
        """The time for which the thread works before it sleeps [s]."""
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._summary: Sequence[Mapping[str, Any]] = ()
        self._owner = os.getpid()
        this = weakref.ref(self)
        remove_at_end(lambda: (writer := this()) and writer._remove_empty())

    @property
    def has_begun(self) -> bool:
        """True once the file has been begun."""
        return self._thread is not None

    @property
    def lost(self) -> int:
        """The number of entries that are not in the file, because the disk was full or too slow."""
        return self._refused + self._failed

    @property
    def waiting(self) -> int:
        """The size of the entries that wait for the disk [byte]."""
        return self._handed_over - self._taken

    def begin(self, header: Header) -> None:
        """Overwrite the file with the head of a log, and start the thread."""
        self._file.truncate()
        begun = self._format = self._maker(self._file)
        self._attempt(lambda: begun.begin(header))
        self._thread = threading.Thread(target=self._work, name="tactemu-log", daemon=True)
        self._thread.start()

    def put(self, entry: Entry, size: int) -> None:
        """Queue an entry of about ``size`` bytes, which must not change any more."""
        if self.error is not None:
            self._refused += 1
            return
        if self.waiting + size > MAX_WAITING_BYTES and self.waiting:
            if not self.block_when_full:
                self._lose_for_slowness(entry)
                return
            while self.waiting + size > MAX_WAITING_BYTES and self.waiting and self.error is None:
                time.sleep(_PAUSE_S)
        self._handed_over += size
        self._entries.append((entry, size))

    def close(self, summary: Sequence[Mapping[str, Any]] = ()) -> None:
        """Write all queued entries and finish the file, with a summary of each device if there is one.

        Safe to call twice; a forked child leaves its parent's log alone.
        """
        if self._owner != os.getpid() or self._file.closed:
            return
        self._summary = summary
        if self._thread is not None:
            self._closing.set()
            self._thread.join()
        self._remove_empty()
        self._file.close()

    def _remove_empty(self) -> None:
        """Remove a new file that was never begun."""
        if self._owner == os.getpid() and self._made and self._thread is None and not self._file.closed:
            self.path.unlink(missing_ok=True)

    def _lose_for_slowness(self, entry: Entry) -> None:
        if not self._refused:
            hint = "; .mcap is faster" if self.path.suffix == ".jsonl" else ""
            self._report(f"{self.path}: the disk is too slow: entries are lost from {entry.t_ns / 1e9:.3f} s on{hint}")
        self._refused += 1

    # -- in the thread -------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        flushed = time.monotonic()
        while not self._closing.wait(_POLL_PERIOD_S):
            self._attempt(self._write_waiting)
            if self._unsaved and time.monotonic() - flushed > self._flush_s:
                self._attempt(self._save)
                flushed = time.monotonic()
        self._attempt(self._write_waiting)
        self._attempt(self._finish)

    def _write_waiting(self) -> None:
        assert self._format is not None
        since = time.perf_counter()
        self._slice_s = _SLICE_S
        while self._entries:
            entry, size = self._entries.popleft()
            self._unsaved += 1
            for _ in self._format.add(entry):
                since = self._yield_to_loop(since)
            self._taken += size
            if self._format.is_saved:
                self._mark()
            since = self._yield_to_loop(since)

    def _yield_to_loop(self, since: float) -> float:
        """Sleep after a slice of work that began at ``since``, and return when the next one begins; not while closing.

        On a busy machine a sleep lasts longer than requested; the next slice is longer in proportion.
        """
        now = time.perf_counter()
        if now - since < self._slice_s or self._closing.is_set():
            return since
        pause_s = max(_MIN_PAUSE_S, _PAUSE_S * (1 - self.waiting / _MIN_PAUSE_BYTES))
        time.sleep(pause_s)
        rested = time.perf_counter()
        self._slice_s = min(_SLICE_S * (rested - now) / pause_s, _MAX_SLICE_S)
        return rested

    def _save(self) -> None:
        assert self._format is not None
        self._format.flush()
        self._mark()

    def _mark(self) -> None:
        self._file.mark()
        self._unsaved = 0

    def _finish(self) -> None:
        assert self._format is not None
        self._format.finish(End(self.lost, self._summary))
        self._unsaved = 0

    def _attempt(self, step: Callable[[], Any]) -> None:
        """Do a step of writing, unless writing has failed; if it fails now, report it and keep the complete part."""
        try:
            if self.error is None:
                step()
        except Exception as error:
            self.error = error
            self._file.cut()
            self._failed += self._unsaved
            why = reason_of(error) if isinstance(error, OSError) else repr(error)
            self._report(f"{self.path}: cannot write the log: {why}; the run goes on, what is lost is counted")
        while self.error is not None and self._entries:
            self._entries.popleft()
            self._failed += 1


class _File:
    """An unbuffered file that can be cut back to its last complete state."""

    def __init__(self, path: Path):
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
        self._written_bytes = self._complete_bytes = 0
        self.closed = False

    def write(self, data: bytes) -> int:
        """Write all of ``data``.

        Raises:
            OSError: the disk is full, or another error of the file.
        """
        unwritten = memoryview(data)
        while unwritten:
            unwritten = unwritten[os.write(self._fd, unwritten) :]
        self._written_bytes += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._written_bytes

    def flush(self) -> None:
        """Do nothing: the file is unbuffered."""

    def mark(self) -> None:
        """Mark the bytes written so far as a complete state."""
        self._complete_bytes = self._written_bytes

    def cut(self) -> None:
        """Cut the file back to its last complete state."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._fd, self._complete_bytes)

    def truncate(self) -> None:
        """Empty the file, if it is a regular one (no device or pipe)."""
        if stat.S_ISREG(os.fstat(self._fd).st_mode):
            os.ftruncate(self._fd, 0)

    def close(self) -> None:
        """Close the file. Safe to call twice."""
        if not self.closed:
            self.closed = True
            os.close(self._fd)
