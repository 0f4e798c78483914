"""The record of one trial from both ends of the wire: samples, frames, faults, rows, notes and resource usage.

The verdicts follow from it alone. What happened on the wire are entries of the truth log, on the machine's monotonic
clock [ns]; what the driver did are :class:`DriverRow`, :class:`Note` and :class:`ResourceUsage`. The file has JSON
lines: a head, then the lines of a truth log among those of the driver.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactemu.base.errors import TactemuError, reason_of
from tactemu.base.files import check_overwriting
from tactemu.truth import Truth
from tactemu.truth.entries import Entry, Injection, Passage, PortEvent, Sample
from tactemu.truth.jsonl_format import entry_of, row_of

VERSION = 2
SIGN = '"kind": "trial"'
"""A text in the head of every record."""
Row = Mapping[str, float]
_NO_READING = np.zeros(0)
"""The readings of a sample in a record, which has the counts of all skins in one array."""


class DriverRow(NamedTuple):
    """A row of numbers that the driver printed."""

    t_ns: int
    row: Row


class Note(NamedTuple):
    """A line without a row that the driver printed."""

    t_ns: int
    text: str
    err: bool = False
    """True if it came on standard error."""


class ResourceUsage(NamedTuple):
    """The memory and processor time of the driver's processes."""

    t_ns: int
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
    """The conversions of the device, each with the counts of all its skins and senses; it has no readings."""
    frames: list[Passage] = field(default_factory=list)
    """The frames that were sent to the driver or received from it; those of answers have the numbers of samples."""
    injected_faults: list[Injection] = field(default_factory=list)
    rows: list[DriverRow] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    resource_usage: list[ResourceUsage] = field(default_factory=list)

    def since(self, t: int) -> TrialRecord:
        """Return a copy with the entries from a time on."""
        return replace(self, **{name: [each for each in getattr(self, name) if each.t_ns >= t] for name in _LISTS})

    # -- as a file -----------------------------------------------------------------------------------------------------

    def write(self, path: str | Path) -> None:
        """Write the record as JSON lines.

        Raises:
            TactemuError: the file cannot be written, or is of another program.
        """
        check_overwriting(path, SIGN)
        try:
            with open(path, "w", encoding="utf-8") as file:
                for line in self.lines():
                    file.write(json.dumps(line, default=_plain) + "\n")
        except OSError as error:
            raise TactemuError(f"{path}: cannot write the recorded trial: {reason_of(error, path)}") from None

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield the head, then all entries sorted by time, as JSON data."""
        yield {"kind": "trial", "version": VERSION, **{name: getattr(self, name) for name in _HEAD}}
        for entry in sorted((each for name in _LISTS for each in getattr(self, name)), key=lambda each: each.t_ns):
            yield _line_of(entry)

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
            raise TactemuError(f"{path}: cannot read the recorded trial: {reason_of(error)}") from None

    @classmethod
    def _of(cls, lines: Any, path: str) -> TrialRecord:
        record, version = None, VERSION
        for number, line in enumerate(lines, 1):
            try:
                row = json.loads(line)
                if record is None:
                    version = row["version"]
                    if row["kind"] != "trial" or version > VERSION:
                        raise ValueError("no head of a trial that this tactemu reads")
                    record = cls(**{name: row[name] for name in _HEAD})
                    continue
                entry = _entry_of(_of_version_1(row) if version == 1 else row)
                getattr(record, _LIST_OF[type(entry)]).append(entry)
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise TactemuError(f"{path}:{number}: not a recorded trial: {error}") from None
        if record is None:
            raise TactemuError(f"{path}: empty: not a recorded trial")
        return record


def sample_of(t_ns: int, number: int, counts: np.ndarray) -> Sample:
    """Return a conversion of the device as a record has it: with the counts of all skins, without readings."""
    return Sample(t_ns, "", _NO_READING, _NO_READING, counts, number)


_OWN = {"row": DriverRow, "note": Note, "usage": ResourceUsage}
"""The kinds of lines that no truth log has."""
_LIST_OF: dict[type, str] = {
    Sample: "samples", Passage: "frames", Injection: "injected_faults", DriverRow: "rows", Note: "notes",
    ResourceUsage: "resource_usage",
}  # fmt: skip
"""The attribute of each type of entry."""
_LISTS = tuple(_LIST_OF.values())
_HEAD = tuple(each.name for each in fields(TrialRecord) if each.name not in _LISTS)


def _line_of(entry: Any) -> dict[str, Any]:
    if isinstance(entry, Passage):
        return row_of(entry) | {"late_ns": entry.late_ns, "is_answer": entry.is_answer}
    if isinstance(entry, Sample | Injection):
        return row_of(entry)
    return {"kind": next(kind for kind, own in _OWN.items() if type(entry) is own), **entry._asdict()}


def _entry_of(row: dict[str, Any]) -> Any:
    """Return the entry of a line.

    Raises:
        ValueError, KeyError, TypeError: it is none.
    """
    if own := _OWN.get(row["kind"]):
        return own(**{name: value for name, value in row.items() if name != "kind"})
    entry = entry_of(row)
    if isinstance(entry, Passage):
        return entry._replace(late_ns=row["late_ns"], is_answer=row["is_answer"])
    return entry


def _of_version_1(row: dict[str, Any]) -> dict[str, Any]:
    """Return a line of version 1, which had other names, as one of this version."""
    kinds = {"samples": "sample", "changes": "inject", "rows": "row", "notes": "note", "weights": "usage"}
    names = {"t": "t_ns", "number": "sample", "fault": "detail", "answer": "is_answer"}
    kind = row["way"] if row["kind"] == "frames" else kinds[row["kind"]]
    more: dict[str, Any] = {"ideal": [], "measured": []} if kind == "sample" else {}
    return {names.get(name, name): value for name, value in row.items() if value is not None} | {"kind": kind, **more}


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
        self.frames: list[Passage] = []
        self.injected_faults: list[Injection] = []
        self.was_opened = False
        """True once the driver has opened a port."""
        self.unread = 0
        self._keep_count = keep
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
            case Sample():
                self._sampled(t, entry)
            case Passage(kind="tx"):
                sample = self._asked if entry.sample is None else entry.sample
                late_ns = entry.late_ns + max(0, time.monotonic_ns() - t)
                is_answer = entry.sample is None
                self._keep(self.frames, entry._replace(t_ns=t, sample=sample, late_ns=late_ns, is_answer=is_answer))
            case Passage(kind="rx"):
                self._asked = self.samples[-1].number if self.samples else None
                self._keep(self.frames, entry._replace(t_ns=t))
            case Passage():
                self.unread += entry.why == "not read"
            case Injection():
                self._keep(self.injected_faults, entry._replace(t_ns=t))
            case PortEvent(what="opened"):
                self.was_opened = True

    def _sampled(self, t: int, entry: Sample) -> None:
        """Record a sample; samples of several senses or skins that were taken together become one."""
        last = self.samples[-1] if self.samples else None
        self._latest_counts[f"{entry.device}/{entry.sense}"] = np.asarray(entry.counts, float).ravel()
        sample = sample_of(t, entry.number, np.concatenate(list(self._latest_counts.values())))
        if last is not None and last.t_ns == t and entry.number == last.number:
            self.samples[-1] = sample
        else:
            self._keep(self.samples, sample)

    def _keep(self, entries: list, entry: Any) -> None:
        entries.append(entry)
        if len(entries) > self._keep_count:
            del entries[: self._keep_count // 4]
