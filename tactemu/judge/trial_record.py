"""The record of one trial from both ends of the wire: samples, frames, faults, rows, notes and resource usage.

The verdicts follow from it alone. Its file has JSON lines: a head, then one object for each entry. Times are those of
the machine's monotonic clock [ns].
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.base.frame_text import text
from tactemu.truth import Truth
from tactemu.truth.entries import Entry, Injection, Passage, PortEvent
from tactemu.truth.entries import Sample as TrueSample

VERSION = 1
Row = Mapping[str, float]
_NUMBER = re.compile(r", frame (\d+)\]$")


class Sample(NamedTuple):
    """One conversion of the device."""

    t: int
    number: int
    counts: np.ndarray
    """The values that a perfect driver decodes, one for each channel."""


class ReceivedFrame(NamedTuple):
    """A frame that was sent to the driver or received from it."""

    t: int
    way: str
    """``tx``: to the driver; ``rx``: from it."""
    data: str
    """Hex, or ``candump`` notation."""
    sample: int | None = None
    """Number of the sample that it carries; for an answer, of the latest sample when the driver asked."""
    answer: bool = False
    """True if it carries no sample of its own: an answer, or a frame between samples."""
    late_ns: int = 0
    """Time by which our own process handed it over late, after its last bit had left the line."""


class InjectedFault(NamedTuple):
    """A fault that was injected."""

    t: int
    what: str
    """Kind of the fault."""
    fault: str
    """The fault in the language of ``--fault``."""
    frame: int | None
    """Number of the frame, counted from the time at which the fault was switched on."""
    before: str
    """The frame as it was sent."""
    after: tuple[str, ...]
    """The frames that arrived in its place."""


class DriverRow(NamedTuple):
    """A row of numbers that the driver printed."""

    t: int
    row: Row


class Note(NamedTuple):
    """A line without a row that the driver printed."""

    t: int
    text: str
    err: bool = False
    """True if it came on standard error."""


class ResourceUsage(NamedTuple):
    """The memory and processor time of the driver's processes."""

    t: int
    bytes: int
    """Resident memory."""
    cpu: float
    """Total processor time so far [s]."""


@dataclass
class TrialRecord:
    """The record of one trial. Lists are sorted by time.

    ``on`` is the time at which the faults were switched on, ``off`` the time of the last one, ``end`` that of the last
    entry.
    """

    name: str = ""
    trial: dict[str, Any] = field(default_factory=dict)
    """The trial, as the data of a :class:`tactemu.judge.plan.Trial`."""
    known: dict[str, Any] = field(default_factory=dict)
    """The facts from the clean run, as the data of a :class:`tactemu.judge.outcome.CleanRun`."""
    columns: dict[str, Any] = field(default_factory=dict)
    """The driver's columns, as the data of :class:`tactemu.judge.columns.Columns`."""
    on: int = 0
    off: int = 0
    end: int = 0
    exit: int | None = None
    """The driver's exit status; None if it has not ended."""
    late_ms: float = 0.0
    """Delay of a row for which the driver is not to blame [ms]."""
    unread: int = 0
    """Number of frames that were never sent because the driver did not read."""
    trouble: str = ""
    """The reason why the trial could not be run."""
    samples: list[Sample] = field(default_factory=list)
    frames: list[ReceivedFrame] = field(default_factory=list)
    injected_faults: list[InjectedFault] = field(default_factory=list)
    rows: list[DriverRow] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    resource_usage: list[ResourceUsage] = field(default_factory=list)

    def since(self, t: int) -> TrialRecord:
        """Return a copy with the entries from a time on."""
        lists = {name: [each for each in getattr(self, name) if each.t >= t] for name, _ in _LISTS.values()}
        return replace(self, **lists)

    # -- as a file -----------------------------------------------------------------------------------------------------

    def write(self, path: str | Path) -> None:
        """Write the record as JSON lines.

        Raises:
            TactemuError: the file cannot be written.
        """
        try:
            with open(path, "w", encoding="utf-8") as file:
                for line in self.lines():
                    file.write(json.dumps(line, default=_plain) + "\n")
        except OSError as error:
            raise TactemuError(f"{path}: cannot write the recorded trial: {error.strerror}") from None

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield the head, then all entries sorted by time, as JSON data."""
        head = {name: getattr(self, name) for name in _HEAD}
        yield {"kind": "trial", "version": VERSION, **head}
        entries = [(each.t, kind, each) for kind, (name, _) in _LISTS.items() for each in getattr(self, name)]
        for _, kind, each in sorted(entries, key=lambda entry: entry[0]):
            yield {"kind": kind, **each._asdict()}

    @classmethod
    def read(cls, path: str | Path) -> TrialRecord:
        """Return the record in a file.

        Raises:
            TactemuError: the file cannot be read or is no record.
        """
        try:
            with open(path, encoding="utf-8") as file:
                return cls._of(file, str(path))
        except OSError as error:
            raise TactemuError(f"{path}: cannot read the recorded trial: {error.strerror}") from None

    @classmethod
    def _of(cls, lines: Any, path: str) -> TrialRecord:
        record = None
        for number, line in enumerate(lines, 1):
            try:
                entry = json.loads(line)
                kind = entry.pop("kind")
                if record is None:
                    if kind != "trial" or entry.pop("version") > VERSION:
                        raise ValueError("no head of a trial that this tactemu reads")
                    record = cls(**{name: entry[name] for name in _HEAD})
                    continue
                if kind == "samples":
                    entry["counts"] = np.array(entry["counts"], float)
                if kind == "changes":
                    entry["after"] = tuple(entry["after"])
                name, entry_type = _LISTS[kind]
                getattr(record, name).append(entry_type(**entry))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise TactemuError(f"{path}:{number}: not a recorded trial: {error}") from None
        if record is None:
            raise TactemuError(f"{path}: empty: not a recorded trial")
        return record


_LISTS: dict[str, tuple[str, Any]] = {
    "samples": ("samples", Sample), "frames": ("frames", ReceivedFrame), "changes": ("injected_faults", InjectedFault),
    "rows": ("rows", DriverRow), "notes": ("notes", Note), "weights": ("resource_usage", ResourceUsage),
}  # fmt: skip
"""The attribute and the type of each kind of entry in a file."""
_HEAD = (
    "name", "trial", "known", "columns", "on", "off", "end", "exit", "late_ms", "unread", "trouble",
)  # fmt: skip


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} in a recorded trial")


class Recorder:
    """A recorder of all entries of the truth (:meth:`tactemu.truth.Truth.tap`), of all skins, on the machine's clock.

    Only the latest samples, frames and faults are kept, which bounds the memory.
    """

    def __init__(self, keep: int = 200_000):
        self.samples: list[Sample] = []
        self.frames: list[ReceivedFrame] = []
        self.injected_faults: list[InjectedFault] = []
        self.events: list[tuple[int, str]] = []
        self.unread = 0
        self._keep = keep
        self._truth: Truth | None = None
        self._latest_counts: dict[str, np.ndarray] = {}
        """The latest counts by skin and sense."""
        self._asked: int | None = None
        """Number of the latest sample at the driver's last question."""

    @property
    def senses(self) -> list[str]:
        """The keys ``skin/sense`` in the order of the counts."""
        return list(self._latest_counts)

    def listen(self, truth: Truth) -> None:
        """Record the entries of a truth from now on; call it before the run begins."""
        self._truth = truth
        truth.tap(self)

    def put(self, entry: Entry) -> None:
        """Record an entry."""
        origin = self._truth.origin_ns if self._truth is not None else None
        t = entry.t_ns + (origin or 0)
        match entry:
            case TrueSample():
                self._sampled(t, entry)
            case Passage(kind="tx"):
                sample = self._asked if entry.sample is None else entry.sample
                late_ns = entry.late_ns + max(0, time.monotonic_ns() - t)
                self.frames.append(ReceivedFrame(t, "tx", text(entry.frame), sample, entry.sample is None, late_ns))
                self._bound(self.frames)
            case Passage(kind="rx"):
                self._asked = self.samples[-1].number if self.samples else None
                self.frames.append(ReceivedFrame(t, "rx", text(entry.frame)))
                self._bound(self.frames)
            case Passage():
                self.unread += entry.why == "not read"
            case Injection():
                number = _NUMBER.search(entry.detail)
                fault = entry.detail.partition(" [")[0]
                found = int(number[1]) if number else None
                self.injected_faults.append(InjectedFault(t, entry.what, fault, found, entry.before, entry.after))
                self._bound(self.injected_faults)
            case PortEvent():
                self.events.append((t, entry.what))
                self._bound(self.events)

    def _sampled(self, t: int, entry: TrueSample) -> None:
        """Record a sample; samples of several senses or skins that were taken together become one."""
        last = self.samples[-1] if self.samples else None
        self._latest_counts[f"{entry.device}/{entry.sense}"] = np.asarray(entry.counts, float).ravel()
        joined = np.concatenate(list(self._latest_counts.values()))
        if last is not None and last.t == t and entry.number == last.number:
            self.samples[-1] = Sample(t, entry.number, joined)
            return
        self.samples.append(Sample(t, entry.number, joined))
        self._bound(self.samples)

    def _bound(self, entries: list) -> None:
        if len(entries) > self._keep:
            del entries[: self._keep // 4]


__all__ = [
    "DriverRow",
    "InjectedFault",
    "Note",
    "ReceivedFrame",
    "Recorder",
    "ResourceUsage",
    "Row",
    "Sample",
    "TrialRecord",
]
