"""The memory of the latest samples and frames, bounded in bytes."""

from __future__ import annotations

import re
import threading
import weakref
from collections import deque

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.base.errors import TactemuError
from tactemu.truth.entries import Entry, Injection, Passage, PortEvent, Sample

DEFAULT_KEEP = "256MB"
"""The memory that all runs of a process share by default."""
_SAMPLE_OVERHEAD_BYTES = 800
"""Approximate size of the Python objects around the numbers of a sample [byte]."""
_FRAME_OVERHEAD_BYTES = 250
"""Approximate size of the Python objects around the data of a frame [byte]."""
_MIN_RELEASED_BYTES = 1 << 15
"""Minimum number of bytes that are released together, so that not every entry searches for the largest memory."""
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "ki": 2**10, "mi": 2**20, "gi": 2**30}
_SIZE = re.compile(r"\s*(\d+(?:\.\d*)?)\s*([kmg]i?)?b?\s*", re.IGNORECASE)


def parse_size(size: str | int) -> int:
    """Return a size such as ``"256MB"``, ``"1.5 GB"``, ``"64MiB"`` or a number, in bytes.

    Raises:
        TactemuError: it is no size.
    """
    match = _SIZE.fullmatch(str(size)) if isinstance(size, str | int) and not isinstance(size, bool) else None
    if match is None:
        raise TactemuError(f'keep: expected a size such as "256MB" or a number of bytes, got {size!r}')
    return int(float(match[1]) * _UNITS[(match[2] or "").lower()])


class Budget:
    """A number of bytes that several memories share; when they are used up, the largest drops its oldest entries."""

    def __init__(self, limit: int):
        self.limit = limit
        self.lock = threading.Lock()
        self.spent = 0
        """An upper bound of the bytes in use; deleted memories are subtracted when it reaches the limit."""
        self.memories: weakref.WeakSet[Memory] = weakref.WeakSet()

    def shrink(self) -> None:
        """Drop the oldest entries until the limit is kept; the caller holds the lock."""
        self.spent = sum(memory.bytes for memory in self.memories)
        while self.spent > self.limit:
            most = max(self.memories, key=lambda memory: memory.bytes)
            goal = most.bytes - min(most.bytes, max(self.spent - self.limit, _MIN_RELEASED_BYTES))
            while most.bytes > goal:
                self.spent -= most.forget_oldest()


class Memory:
    """The latest samples and frames of one run.

    Args:
        keep: bytes, as a number or as text; ``None``: a share of the memory of the process.
    """

    def __init__(self, keep: str | int | None = None):
        self.budget = _PROCESS if keep is None else Budget(parse_size(keep))
        self.samples: deque[Sample] = deque()
        self.frames: deque[tuple[int, str, WireFrame | CanFrames]] = deque()
        self.bytes = 0
        self.forgotten = 0
        with self.budget.lock:
            self.budget.memories.add(self)

    def add_sample(self, sample: Sample) -> None:
        """Keep a sample."""
        self._add(self.samples, sample, size_of_sample(sample))

    def add_frame(self, t_ns: int, device: str, frame: WireFrame | CanFrames) -> None:
        """Keep a frame, or several that left together."""
        size = _FRAME_OVERHEAD_BYTES + len(frame) if isinstance(frame, bytes) else size_of_frame(frame)
        self._add(self.frames, (t_ns, device, frame), size)

    def _add(self, entries: deque, entry: object, size: int) -> None:
        budget = self.budget
        with budget.lock:
            entries.append(entry)
            self.bytes += size
            budget.spent += size
            if budget.spent > budget.limit:
                budget.shrink()

    def forget(self) -> None:
        """Drop all entries."""
        with self.budget.lock:
            self.budget.spent -= self.bytes
            self.bytes = 0
            self.samples.clear()
            self.frames.clear()

    def forget_oldest(self) -> int:
        """Drop the oldest entry, and return its size in bytes; the caller holds the budget's lock."""
        samples, frames = self.samples, self.frames
        if samples and (not frames or samples[0].t_ns <= frames[0][0]):
            size, count = size_of_sample(samples.popleft()), 1
        else:
            oldest = frames.popleft()[2]
            size, count = size_of_frame(oldest), len(oldest) if isinstance(oldest, CanFrames) else 1
        self.bytes -= size
        self.forgotten += count
        return size


def size_of_sample(sample: Sample) -> int:
    """Return the approximate size of a sample in memory [byte]."""
    return _SAMPLE_OVERHEAD_BYTES + sample.ideal.nbytes + sample.measured.nbytes + sample.counts.nbytes


def size_of(entry: Entry) -> int:
    """Return the approximate size of any entry in memory [byte]."""
    if isinstance(entry, Sample):
        return size_of_sample(entry)
    if isinstance(entry, Passage):
        return size_of_frame(entry.frame)
    texts = (entry.detail, entry.before, *entry.after) if isinstance(entry, Injection) else ()
    if isinstance(entry, PortEvent) and entry.is_command:
        texts = (entry.what,)
    return _FRAME_OVERHEAD_BYTES + sum(map(len, texts))


def size_of_frame(frame: WireFrame | CanFrames) -> int:
    """Return the approximate size of a frame, or of several, in memory [byte]."""
    if isinstance(frame, bytes):
        return _FRAME_OVERHEAD_BYTES + len(frame)
    return _FRAME_OVERHEAD_BYTES + (len(frame.data) if isinstance(frame, CanFrame) else frame.array.nbytes)


_PROCESS = Budget(parse_size(DEFAULT_KEEP))
"""The budget of all memories of this process that have none of their own."""
