"""The thread that writes a truth log, behind a loop that never waits for a disk.

The loop hands entries over; the thread turns them into the file's format, compresses and writes. It works in slices of
a fraction of a millisecond and rests between them, so that the loop gets the interpreter when its time comes. What
waits is bounded in bytes; where the disk is too slow, or full, entries are lost and counted, and the loop goes on.
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
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tactemu.base.errors import TactemuError
from tactemu.base.files import remove_at_end
from tactemu.truth.entries import End, Entry, Header
from tactemu.truth.jsonl_format import JsonlWriter
from tactemu.truth.mcap_format import McapWriter

SUFFIXES = (".mcap", ".jsonl")
"""Formats of a log, by the suffix of its file."""
MAX_WAITING_BYTES = 64_000_000
"""What may wait for the disk."""
_MAX_UNSAVED_S = 2.0
"""How much time a log may lack when its process is killed."""
_POLL_PERIOD_S = 0.02
"""How often the thread looks for entries."""
_SLICE_S, _PAUSE_S, _MIN_PAUSE_S = 5e-5, 5e-4, 5e-5
_MAX_SLICE_S = 1e-3
_MIN_PAUSE_BYTES = 1_000_000
"""The more waits, the less the thread rests; from here on as little as it can."""

_logger = logging.getLogger(__name__)


def check_suffix(path: Path) -> None:
    """Refuse what is no format of a log.

    Raises:
        TactemuError: another suffix.
    """
    if path.suffix not in SUFFIXES:
        raise TactemuError(f"{path}: the suffix decides the format of a log: expected .mcap or .jsonl")


class LogWriter:
    """One log file and its thread. Only one thread may hand over.

    The file stays as it was until :meth:`begin`, and one that was made for nothing is removed by :meth:`close`.

    Args:
        path: the file; its suffix decides the format. What is there is overwritten.
        report: told once when nothing can be written any more, and once when entries are lost to a slow disk.
        flush_s: how much time a log may lack when its process is killed [s]; default: 2.

    Raises:
        TactemuError: another suffix.
        OSError: it cannot be written.
    """

    def __init__(
        self, path: str | Path, *, report: Callable[[str], None] = _logger.error, flush_s: float | None = None
    ):
        self.path, self._report = Path(path), report
        self._flush_s = _MAX_UNSAVED_S if flush_s is None else flush_s
        check_suffix(self.path)
        self.error: Exception | None = None
        """Why nothing is written any more."""
        self.block_when_full = False
        """Let the loop wait rather than lose entries: where time is virtual."""
        self._made = not self.path.exists()
        self._file = _File(self.path)
        self._format: JsonlWriter | McapWriter | None = None
        self._entries: deque[tuple[Entry, int]] = deque()
        self._handed_over = self._taken = self._refused = 0
        self._unsaved = self._failed = 0
        self._slice_s = _SLICE_S
        """How long the thread works before it rests."""
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._summary: Sequence[Mapping[str, Any]] = ()
        self._owner = os.getpid()
        this = weakref.ref(self)
        remove_at_end(lambda: (writer := this()) and writer._remove_empty())

    @property
    def has_begun(self) -> bool:
        """Whether there is something in the file."""
        return self._thread is not None

    @property
    def lost(self) -> int:
        """Entries that are not in the file: the disk was full, or too slow."""
        return self._refused + self._failed

    @property
    def waiting(self) -> int:
        """Bytes that wait for the disk."""
        return self._handed_over - self._taken

    def begin(self, header: Header) -> None:
        """Overwrite what was there, and start."""
        self._file.truncate()
        begun = self._format = (JsonlWriter if self.path.suffix == ".jsonl" else McapWriter)(self._file)
        self._attempt(lambda: begun.begin(header))
        self._thread = threading.Thread(target=self._work, name="tactemu-log", daemon=True)
        self._thread.start()

    def put(self, entry: Entry, size: int) -> None:
        """Hand over an entry of about ``size`` bytes, which nobody changes any more."""
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
        """Write what waits, and finish the file, with a summary of each device if there is one.

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
        """Remove a file that was made for nothing."""
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
        """Let the loop have the interpreter after a slice of work. It needs none when the run is over.

        On a busy machine a rest lasts longer than it should, and the next slice as much longer: its share stays.
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
        """Do a step of writing, unless the disk has failed; when it fails now, say so and keep what is whole."""
        try:
            if self.error is None:
                step()
        except Exception as error:
            self.error = error
            self._file.cut()
            self._failed += self._unsaved
            why = error.strerror if isinstance(error, OSError) else repr(error)
            self._report(f"{self.path}: cannot write the log: {why}; the run goes on, what is lost is counted")
        while self.error is not None and self._entries:
            self._entries.popleft()
            self._failed += 1


class _File:
    """A file without a buffer of its own, which can be cut back to where it was whole."""

    def __init__(self, path: Path):
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
        self._written_bytes = self._complete_bytes = 0
        self.closed = False

    def write(self, data: bytes) -> int:
        """Write all of it.

        Raises:
            OSError: it does not fit.
        """
        unwritten = memoryview(data)
        while unwritten:
            unwritten = unwritten[os.write(self._fd, unwritten) :]
        self._written_bytes += len(data)
        return len(data)

    def tell(self) -> int:
        """Return bytes written."""
        return self._written_bytes

    def flush(self) -> None:
        """Nothing waits here."""

    def mark(self) -> None:
        """What is written so far is whole."""
        self._complete_bytes = self._written_bytes

    def cut(self) -> None:
        """Leave what is whole."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._fd, self._complete_bytes)

    def truncate(self) -> None:
        """Empty the file; what is none (a device, a pipe) has nothing to lose."""
        if stat.S_ISREG(os.fstat(self._fd).st_mode):
            os.ftruncate(self._fd, 0)

    def close(self) -> None:
        """Close it. Safe to call twice."""
        if not self.closed:
            self.closed = True
            os.close(self._fd)


def check_overwriting(path: Path, reads: Iterable[Path]) -> None:
    """Refuse to overwrite what the run reads, or what is no log.

    Raises:
        TactemuError: with what to do instead.
    """
    if not path.is_file():
        return
    for other in reads:
        if other.exists() and path.samefile(other):
            raise TactemuError(f"{path}: the run reads this file and cannot overwrite it; name another")
    with path.open("rb") as file:
        start = file.read(4096)
    if start and not (start.startswith(b"\x89MCAP0\r\n") or (start.startswith(b"{") and b'"kind"' in start)):
        raise TactemuError(f"{path}: is no log and is not overwritten; remove it first, or name another file")
