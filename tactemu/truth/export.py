"""Export of truth logs: samples as CSV, CAN frames in the formats of candump and python-can, or all entries."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from firmware_protocols import CanFrame
from tactemu.base.errors import TactemuError
from tactemu.truth import Passage, Sample, entries
from tactemu.truth.entries import End, Header, belongs_to
from tactemu.truth.log_reader import records
from tactemu.truth.memory import size_of
from tactemu.truth.recorder import WRITABLE_CAN_FORMATS, Recorder
from tactemu.truth.recording import Entry
from tactemu.truth.writer import SUFFIXES, LogWriter

EXPORT_SUFFIXES = (".csv", *WRITABLE_CAN_FORMATS, *SUFFIXES)
_AXES = "xyz"


def export(path: str | Path, target: str | Path, *, skin: str | None = None, sense: str | None = None) -> int:
    """Write a log to another file, whose suffix decides content and format; return the number of rows or frames.

    Args:
        path: the log.
        target: ``.csv`` for samples, ``.log``, ``.asc`` or ``.blf`` for CAN frames, ``.mcap`` or ``.jsonl`` for all.
        skin: the skin to export; ``.csv`` needs it where the log has several.
        sense: the sense of the skin, for ``.csv``; default: the first.

    Raises:
        TactemuError: no log, another suffix, no such entries in it, or the file cannot be written.
    """
    path, target = Path(path), Path(target)
    if target.suffix not in EXPORT_SUFFIXES:
        raise TactemuError(
            f"{target}: cannot export to {target.suffix!r}; expected one of {', '.join(EXPORT_SUFFIXES)}"
        )
    if target.exists() and path.exists() and target.samefile(path):
        raise TactemuError(f"{target}: is the log itself; name another file")
    try:
        if target.suffix == ".csv":
            return _samples(path, target, skin, sense)
        return (
            _can_frames(path, target, skin)
            if target.suffix in WRITABLE_CAN_FORMATS
            else _everything(path, target, skin)
        )
    except OSError as error:
        raise TactemuError(f"{target}: cannot write the export: {error.strerror}") from None


def _samples(path: Path, target: Path, skin: str | None, sense: str | None) -> int:
    """Write a row per sample, with its time, its number and all numbers of its arrays; return the number of rows."""
    found = (entry for entry in entries(path) if isinstance(entry, Sample) and skin in (None, entry.device))
    first = next((sample for sample in found if sense in (None, sample.sense)), None)
    if first is None:
        raise TactemuError(f"{path}: no samples{f' of {skin!r}' if skin else ''}{f' and {sense!r}' if sense else ''}")
    count = 0
    with target.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["t_ns", "sample", *_columns(first)])
        for sample in _prefixed(first, found):
            if sample.device != first.device:
                names = f"{first.device!r}, {sample.device!r}"
                raise TactemuError(f"{path}: samples of {names} have different columns; choose one with --skin")
            if sample.sense == first.sense:
                rows.writerow([sample.t_ns, sample.number, *_numbers(sample)])
                count += 1
    return count


def _prefixed(first: Sample, others: Iterable[Sample]) -> Iterable[Sample]:
    yield first
    yield from others


def _columns(sample: Sample) -> list[str]:
    """Return the names of the columns, taxel by taxel: ``ideal_0_x``, ``ideal_0_y`` ... ``counts_0``, ``counts_1``."""
    names = []
    for name in ("ideal", "measured", "counts"):
        for place in np.ndindex(getattr(sample, name).shape):
            last = _AXES[place[-1]] if name != "counts" and len(place) == 2 and place[-1] < 3 else place[-1]
            names.append("_".join(map(str, (name, *place[:-1], last))))
    return names


def _numbers(sample: Sample) -> list:
    """Return the numbers of a sample as the shortest decimals that read back to the same bits."""
    flat = []
    for values in (sample.ideal, sample.measured, sample.counts):
        flat += [str(x) for x in values.ravel()] if values.dtype == np.float32 else values.ravel().tolist()
    return flat


def _can_frames(path: Path, target: Path, skin: str | None) -> int:
    with Recorder(target) as recorder:
        for entry in entries(path):
            if isinstance(entry, Passage) and entry.kind != "drop" and belongs_to(entry, skin):
                if isinstance(entry.frame, CanFrame):
                    recorder.add(Entry(entry.t_ns, entry.frame, entry.kind))
        if not recorder.count:
            raise TactemuError(
                f"{path}: no CAN frames{f' of {skin!r}' if skin else ''}; .csv and .jsonl take every wire"
            )
    return recorder.count


def _everything(path: Path, target: Path, skin: str | None) -> int:
    log, count, end = LogWriter(target), 0, End()
    log.block_when_full = True
    try:
        for record in records(path):
            if isinstance(record, Header) or not log.has_begun:
                log.begin(record if isinstance(record, Header) else Header())
            if isinstance(record, End):
                end = record
            elif not isinstance(record, Header) and belongs_to(record, skin):
                log.put(record, size_of(record))
                count += 1
    finally:
        log.close([each for each in end.summary if skin in (None, each["skin"])])
    if log.error is not None:
        raise TactemuError(f"{target}: cannot write the export: {log.error}")
    return count
