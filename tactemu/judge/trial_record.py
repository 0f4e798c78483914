"""What one trial saw, from both ends of the wire, on one clock: samples, frames, faults, rows, notes, memory.

It is all that the verdicts are made from, and one file of JSON lines: a head, then an object each. Times are those of
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
    """What a perfect driver decodes, one number for each channel."""


class ReceivedFrame(NamedTuple):
    """A frame that left for the driver, or arrived from it."""

    t: int
    way: str
    """``tx``: to the driver; ``rx``: from it."""
    data: str
    """Hex, or ``candump`` notation."""
    sample: int | None = None
    """Number of the sample that it carries; of an answer, of the latest when the driver asked."""
    answer: bool = False
    """It was sent because the driver had said something, or by itself between samples."""
    late_ns: int = 0
    """Time by which our own process was late in handing it over, after its last bit had left the line."""


class InjectedFault(NamedTuple):
    """A fault that was injected."""

    t: int
    what: str
    """Kind of the fault."""
    fault: str
    """Its words."""
    frame: int | None
    """Number of the frame, counted from when the fault was switched on."""
    before: str
    after: tuple[str, ...]


class DriverRow(NamedTuple):
    """A row of numbers that the driver handed out."""

    t: int
    row: Row


class Note(NamedTuple):
    """Something else that it said."""

    t: int
    text: str
    err: bool = False
    """On its standard error."""


class ResourceUsage(NamedTuple):
    """What the driver's processes take."""

    t: int
    bytes: int
    """Resident memory."""
    cpu: float
    """Processor time so far [s]."""


@dataclass
class TrialRecord:
    """One trial. Lists are in the order of time.

    ``on`` is when the faults were switched on, ``off`` when the last had been, ``end`` when nobody looked any more.
    """

    name: str = ""
    trial: dict[str, Any] = field(default_factory=dict)
    """What was done, as :class:`tactemu.judge.plan.Trial` says it."""
    known: dict[str, Any] = field(default_factory=dict)
    """What the clean run has shown, as :class:`tactemu.judge.outcome.CleanRun` says it."""
    columns: dict[str, Any] = field(default_factory=dict)
    """What the driver's columns hold, as :class:`tactemu.judge.columns.Columns` says it."""
    on: int = 0
    off: int = 0
    end: int = 0
    exit: int | None = None
    """The driver's exit status, if it has ended."""
    late_ms: float = 0.0
    """How late our own loop was at worst [ms]."""
    unread: int = 0
    """Frames that the driver did not read, so that they never left."""
    trouble: str = ""
    """Why nothing could be seen."""
    samples: list[Sample] = field(default_factory=list)
    frames: list[ReceivedFrame] = field(default_factory=list)
    injected_faults: list[InjectedFault] = field(default_factory=list)
    rows: list[DriverRow] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    resource_usage: list[ResourceUsage] = field(default_factory=list)

    def since(self, t: int) -> TrialRecord:
        """Return a copy that begins at a time."""
        lists = {name: [each for each in getattr(self, name) if each.t >= t] for name, _ in _LISTS.values()}
        return replace(self, **lists)

    # -- as a file -----------------------------------------------------------------------------------------------------

    def write(self, path: str | Path) -> None:
        """Write it as JSON lines.

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
        """Head first, then everything by time."""
        head = {name: getattr(self, name) for name in _HEAD}
        yield {"kind": "trial", "version": VERSION, **head}
        entries = [(each.t, kind, each) for kind, (name, _) in _LISTS.items() for each in getattr(self, name)]
        for _, kind, each in sorted(entries, key=lambda entry: entry[0]):
            yield {"kind": kind, **each._asdict()}

    @classmethod
    def read(cls, path: str | Path) -> TrialRecord:
        """Return the trial in a file.

        Raises:
            TactemuError: it cannot be read, or is none.
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
    """Hears everything that the truth is told (:meth:`tactemu.truth.Truth.tap`), of all skins, on the machine's clock.

    Bounded: of samples, frames and changes only the latest are kept.
    """

    def __init__(self, keep: int = 200_000):
        self.samples: list[Sample] = []
        self.frames: list[ReceivedFrame] = []
        self.injected_faults: list[InjectedFault] = []
        self.events: list[tuple[int, str]] = []
        self.unread = 0
        self._keep = keep
        self._truth: Truth | None = None
        self._whole: dict[str, np.ndarray] = {}
        """The latest counts by skin and sense."""
        self._asked: int | None = None
        """Number of the sample that was the latest when the driver asked last."""

    @property
    def senses(self) -> list[str]:
        """``skin/sense`` in the order of the counts."""
        return list(self._whole)

    def listen(self, truth: Truth) -> None:
        """From now on; before the run begins."""
        self._truth = truth
        truth.tap(self)

    def put(self, entry: Entry) -> None:
        """Something happened."""
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
        """Samples of several senses or skins that were taken together are one."""
        last = self.samples[-1] if self.samples else None
        self._whole[f"{entry.device}/{entry.sense}"] = np.asarray(entry.counts, float).ravel()
        joined = np.concatenate(list(self._whole.values()))
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
