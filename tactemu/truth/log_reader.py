"""Truth logs read back: entry by entry, or as arrays per skin."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError
from tactemu.truth import jsonl_format, mcap_format
from tactemu.truth.entries import BodyPose, End, Entry, Header, Injection, Passage, PortEvent, Sample
from tactemu.truth.writer import check_suffix

_logger = logging.getLogger(__name__)


def records(path: str | Path) -> Iterator[Header | Entry | End]:
    """The entries of a log, with what stands before and behind them. Memory does not grow with the log.

    A log that was cut off is said to be so in a warning, and ends with an :class:`End` that says it.

    Raises:
        TactemuError: as :func:`entries`.
    """
    path = Path(path)
    check_suffix(path)
    try:
        with path.open("rb") as file:
            is_open, end = False, None
            for record in (jsonl_format if path.suffix == ".jsonl" else mcap_format).read(file):
                is_open = record.ends if isinstance(record, Header) else is_open
                if isinstance(record, End):
                    end = record
                else:
                    yield record
        end = End(is_cut=is_open) if end is None else end
        if end.is_cut:
            _logger.warning("%s: cut off: it ends without its end; what it holds is whole up to there", path)
        yield end
    except OSError as error:
        raise TactemuError(f"{path}: cannot read the truth log: {error.strerror}") from None
    except ValueError as error:
        raise TactemuError(f"{path}: {error if 'damaged' in str(error) else f'not a truth log: {error}'}") from None


def entries(path: str | Path) -> Iterator[Entry]:
    """The entries of a log, in order. A file that was cut off gives those that are whole.

    Raises:
        TactemuError: no such file, or no log; the message says where it is wrong.
    """
    return (record for record in records(path) if not isinstance(record, Header | End))


def read(path: str | Path) -> Iterator[dict[str, Any]]:
    """The entries of a log as the objects of its lines, arrays as arrays, whatever the file's format.

    Raises:
        TactemuError: as :func:`entries`.
    """
    return map(jsonl_format.row_of, entries(path))


@dataclass(frozen=True)
class Samples:
    """The samples of one sense of one skin."""

    t_ns: np.ndarray
    """When they were taken [ns], shape ``(n_samples,)``."""
    sample: np.ndarray
    """Their numbers; one that is missing was lost. Shape ``(n_samples,)``."""
    ideal: np.ndarray
    """Readings without imperfections of values, SI, shape ``(n_samples, n_taxels[, 3])``."""
    measured: np.ndarray
    """Readings with them, same shape."""
    counts: np.ndarray
    """What a perfect driver decodes, shape ``(n_samples, ...)``."""


@dataclass(frozen=True)
class SkinLog(Samples):
    """What a log says of one skin, or of the bus that several share (``left+right``).

    Its own arrays are those of the first of its senses.
    """

    senses: dict[str, Samples]
    """By the senses' names; one without a name is ``""``."""
    frames: list[Passage]
    """Frames to the driver, from it, and those that never left, with the number of the sample that they carry."""
    injects: list[Injection]
    events: list[PortEvent]


@dataclass(frozen=True)
class Poses:
    """Where a body was, whenever it had moved since the sample before."""

    t_ns: np.ndarray
    """[ns], shape ``(n,)``."""
    position: np.ndarray
    """Of its origin, in the world [m], shape ``(n, 3)``."""
    quaternion: np.ndarray
    """(w, x, y, z), shape ``(n, 4)``."""


@dataclass(frozen=True)
class Log(Mapping[str, SkinLog]):
    """A whole log: ``log["thumb"].measured``."""

    skins: dict[str, SkinLog]
    origin_ns: int | None = None
    """The machine's monotonic clock (``time.monotonic_ns()``) at ``t_ns = 0``; ``None`` where time was virtual."""
    lost: int = 0
    """Entries that could not be written."""
    bodies: dict[str, Poses] = field(default_factory=dict)
    """Those of the scene, by name."""
    scene: Mapping[str, Any] | None = None
    """What is where: bodies with their shapes, skins with their taxels (``docs/truth-log.md``)."""
    commands: tuple[PortEvent, ...] = ()
    """What was done to the emulator while it ran."""
    summary: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """What each device did, by skin, as `tactemu run --json` says it at its end; empty where the run was killed."""
    is_cut: bool = False
    """The file stops without its end: its writer was killed, or the disk was full."""

    def __getitem__(self, device: str) -> SkinLog:
        """Return the part of one skin.

        Raises:
            KeyError: there is none; names those that there are.
        """
        if device not in self.skins:
            raise KeyError(f"no {device!r} in this log; it has: {', '.join(self.skins) or 'nothing'}")
        return self.skins[device]

    def __iter__(self) -> Iterator[str]:
        return iter(self.skins)

    def __len__(self) -> int:
        return len(self.skins)


def read_log(path: str | Path) -> Log:
    """Return a truth log (``.mcap`` or ``.jsonl``) as arrays per skin.

    Raises:
        TactemuError: no such file, or no log; the message says where it is wrong.
    """
    found: dict[str, dict[type, list]] = {}
    header, end = Header(), End()
    poses: dict[str, list[BodyPose]] = {}
    commands: list[PortEvent] = []
    for entry in records(path):
        if isinstance(entry, Header):
            header = entry
        elif isinstance(entry, End):
            end = entry
        elif isinstance(entry, BodyPose):
            poses.setdefault(entry.body, []).append(entry)
        elif isinstance(entry, PortEvent) and entry.is_command:
            commands.append(entry)
        else:
            kinds = found.setdefault(entry.device, {Sample: [], Passage: [], Injection: [], PortEvent: []})
            kinds[type(entry)].append(entry)
    skins = {device: _skin(kinds) for device, kinds in found.items()}
    bodies = {body: _poses(those) for body, those in poses.items()}
    summary = {each["skin"]: each for each in end.summary}
    return Log(skins, header.origin_ns, end.lost, bodies, header.scene, tuple(commands), summary, end.is_cut)


def _poses(poses: list[BodyPose]) -> Poses:
    return Poses(
        np.array([each.t_ns for each in poses], np.int64),
        np.array([each.position for each in poses], np.float64),
        np.array([each.quaternion for each in poses], np.float64),
    )


def _skin(entries_by_kind: dict[type, list]) -> SkinLog:
    by_sense: dict[str, list[Sample]] = {}
    for each in entries_by_kind.pop(Sample):
        by_sense.setdefault(each.sense, []).append(each)
    senses = {sense: _samples(those) for sense, those in by_sense.items()}
    first = next(iter(senses.values()), _samples([]))
    return SkinLog(
        **vars(first),
        senses=senses,
        frames=entries_by_kind[Passage],
        injects=entries_by_kind[Injection],
        events=entries_by_kind[PortEvent],
    )


def _samples(samples: list[Sample]) -> Samples:
    return Samples(
        np.array([each.t_ns for each in samples], np.int64),
        np.array([each.number for each in samples], np.int64),
        _stacked([each.ideal for each in samples]),
        _stacked([each.measured for each in samples]),
        _stacked([each.counts for each in samples]),
    )


def _stacked(values: list[np.ndarray]) -> np.ndarray:
    """Return one array of all; of objects where a device changed its shape while it ran."""
    if len({each.shape for each in values}) <= 1:
        return np.stack(values) if values else np.zeros(0)
    stacked = np.empty(len(values), object)
    stacked[:] = values
    return stacked
