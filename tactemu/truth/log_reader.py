"""Reading of truth logs: entry by entry, or as arrays per skin."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactemu.base.errors import TactemuError, no_such, reason_of
from tactemu.truth import jsonl_format
from tactemu.truth.entries import BodyPose, End, Entry, Header, Injection, Passage, PortEvent, Sample, belongs_to
from tactemu.truth.writer import log_format

_logger = logging.getLogger(__name__)


def records(path: str | Path) -> Iterator[Header | Entry | End]:
    """Yield the head, the entries and the end of a log. Memory does not grow with the log.

    A log that was cut off causes a warning, and its :class:`End` has ``is_cut``.

    Raises:
        TactemuError: as :func:`entries`.
    """
    path = Path(path)
    read = log_format(path).load("reader")
    try:
        is_open, end = False, None
        for record in read(path):
            is_open = record.ends if isinstance(record, Header) else is_open
            if isinstance(record, End):
                end = record
            else:
                yield record
        end = End(is_cut=is_open) if end is None else end
        if end.is_cut:
            _logger.warning("%s: cut off: the end of the log is missing; the entries before it are complete", path)
        yield end
    except OSError as error:
        raise TactemuError(f"{path}: cannot read it: {reason_of(error)}") from None
    except ValueError as error:
        raise TactemuError(f"{path}: {error if 'damaged' in str(error) else f'not a truth log: {error}'}") from None


def entries(path: str | Path) -> Iterator[Entry]:
    """Return an iterator over the entries of a log, in order; of a file that was cut off, the complete ones.

    Raises:
        TactemuError: no such file, or no log; the message says where it is wrong.
    """
    return (record for record in records(path) if not isinstance(record, Header | End))


def read(path: str | Path) -> Iterator[dict[str, Any]]:
    """Return an iterator over the entries as the objects of their lines, with arrays, for both file formats.

    Raises:
        TactemuError: as :func:`entries`.
    """
    return map(jsonl_format.row_of, entries(path))


class SkinChoice:
    """The skin of a log, and its sense, that a user names; the names in the log are gathered for a message.

    Args:
        skin: the skin; ``None``: all.
        sense: one of its senses; ``None``: all.
    """

    def __init__(self, skin: str | None = None, sense: str | None = None):
        self.skin, self.sense = skin, sense
        self._senses: dict[str, set[str]] = {}
        """The senses that have samples, by skin."""

    def takes(self, entry: Entry) -> bool:
        """Return True if an entry belongs to the skin and the sense."""
        if self.skin is None and self.sense is None:
            return True
        if not isinstance(entry, BodyPose):
            for name in entry.device.split("+"):
                self._senses.setdefault(name, set())
        if not isinstance(entry, Sample):
            return belongs_to(entry, self.skin)
        self._senses[entry.device].add(entry.sense)
        return belongs_to(entry, self.skin) and self.sense in (None, entry.sense)

    def check(self, path: str | Path) -> None:
        """Raise if the entries so far have no such skin or sense.

        Raises:
            TactemuError: names those that they have.
        """
        skins = [name for name in self._senses if name]
        if self.skin is not None and self.skin not in skins:
            raise TactemuError(f"{path}: {no_such('skin', self.skin, skins)}")
        known = self._senses.get(self.skin, set()) if self.skin else set().union(*self._senses.values())
        if self.sense is not None and self.sense not in known:
            raise TactemuError(f"{path}: {no_such('sense', self.sense, sorted(filter(None, known)))}")


@dataclass(frozen=True)
class Samples:
    """The samples of one sense of one skin."""

    t_ns: np.ndarray
    """The times of the samples [ns], shape ``(n_samples,)``."""
    sample: np.ndarray
    """The numbers of the samples; a missing one was lost. Shape ``(n_samples,)``."""
    ideal: np.ndarray
    """Readings without imperfections of values, SI, shape ``(n_samples, n_taxels[, 3])``."""
    measured: np.ndarray
    """Readings with imperfections, same shape."""
    counts: np.ndarray
    """The values that a perfect driver decodes, shape ``(n_samples, ...)``."""


@dataclass(frozen=True)
class SkinLog(Samples):
    """The part of a log of one skin, or of the bus that several share (``left+right``).

    Its own arrays are those of its first sense.
    """

    senses: dict[str, Samples]
    """The samples by the names of the senses; one without a name is ``""``."""
    frames: list[Passage]
    """Frames to the driver, from it, and those that never left, with the number of the sample that they carry."""
    injects: list[Injection]
    """The injected faults."""
    events: list[PortEvent]
    """The events of the port."""


@dataclass(frozen=True)
class Poses:
    """The poses of a body, one for each sample before which it had moved."""

    t_ns: np.ndarray
    """The times of the poses [ns], shape ``(n,)``."""
    position: np.ndarray
    """The positions of its origin in the world [m], shape ``(n, 3)``."""
    quaternion: np.ndarray
    """The orientations, (w, x, y, z), shape ``(n, 4)``."""


@dataclass(frozen=True)
class Log(Mapping[str, SkinLog]):
    """A complete log: ``log["thumb"].measured``."""

    skins: dict[str, SkinLog]
    origin_ns: int | None = None
    """The machine's monotonic clock (``time.monotonic_ns()``) at ``t_ns = 0``; ``None`` where time was virtual."""
    lost: int = 0
    """The number of entries that could not be written."""
    bodies: dict[str, Poses] = field(default_factory=dict)
    """The bodies of the scene, by name."""
    scene: Mapping[str, Any] | None = None
    """The scene: bodies with their shapes, skins with their taxels (``docs/truth-log.md``)."""
    commands: tuple[PortEvent, ...] = ()
    """The live commands to the emulator."""
    summary: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """The summary of each device, by skin, as `tactemu run --json` prints it; empty where the run was killed."""
    is_cut: bool = False
    """True if the file stops without its end, because its writer was killed or the disk was full."""

    def __getitem__(self, device: str) -> SkinLog:
        """Return the part of one skin.

        Raises:
            KeyError: the log has no such skin; the message names those that it has.
        """
        if device not in self.skins:
            raise KeyError(f"the log has {no_such('skin', device, self.skins)}")
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
    """Return all values as one array; an array of objects where a device changed its shape while it ran."""
    if len({each.shape for each in values}) <= 1:
        return np.stack(values) if values else np.zeros(0)
    stacked = np.empty(len(values), object)
    stacked[:] = values
    return stacked
