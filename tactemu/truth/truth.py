"""The truth log of a run: the loop adds entries, memory keeps the latest, and a file's writer gets all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from firmware_protocols import WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.base.errors import TactemuError, no_such
from tactemu.base.files import check_overwriting
from tactemu.base.frame_text import text
from tactemu.truth.entries import BodyPose, Entry, Header, Injection, Passage, PortEvent, Sample
from tactemu.truth.memory import Memory, size_of
from tactemu.truth.writer import LogWriter, log_format


class Watcher(Protocol):
    """A receiver of entries as they happen, such as :class:`~tactemu.truth.tap.Tap`."""

    def put(self, entry: Entry) -> None:
        """Take an entry from the loop's thread, without blocking it."""
        ...


class LogContext(Protocol):
    """The surroundings of the skins: the bodies of a scene."""

    names: Sequence[str]
    """The names of the bodies."""

    def poses(self) -> np.ndarray:
        """Return the poses now: position [m] and quaternion (w, x, y, z), shape ``(n_bodies, 7)``."""
        ...

    def description(self) -> Mapping[str, Any]:
        """Return bodies and skins as plain data."""
        ...


class Truth:
    """The truth log of a run: the latest entries in memory, and all of them in a file, if one is named.

    ``injected`` counts every fault by name, so that a test can write
    ``assert driver.bad_frames == truth.injected["flip"]``.

    Args:
        path: the file for all entries, ``.mcap`` or ``.jsonl``. An older log there is overwritten.
        keep: bytes of samples and frames to keep in memory, ``"64MB"`` or a number. Default: 256 MB for the process,
            which all runs with the default share.
        reads: files that the run itself reads, and that must not be overwritten.

    Raises:
        TactemuError: a wrong size, a suffix that is no format, or a file that must not be overwritten.
        OSError: the file cannot be written.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = (
        "_memory",
        "_writers",
        "_taps",
        "_has_sinks",
        "origin_ns",
        "context",
        "skins",
        "buses",
        "_poses",
    )

    def __init__(
        self, path: str | Path | None = None, *, keep: str | int | None = None, reads: Iterable[str | Path] = ()
    ):
        self._memory = Memory(keep)
        if path is not None:
            check_overwriting(path, log_format(Path(path)).sign, reads=reads)
        self._writers = [LogWriter(path)] if path is not None else []
        self._taps: tuple[Watcher, ...] = ()
        self._has_sinks = bool(self._writers)
        """True while a file or a watcher receives entries."""
        self._latest: dict[str, dict[str, Sample]] = {}
        self._latest_frames: dict[str, WireFrame | CanFrames] = {}
        self._numbers: dict[str, int] = {}
        self.injected: Counter[str] = Counter()
        """Injected faults by name."""
        self.injected_by_device: dict[str, Counter[str]] = {}
        """Injected faults by name, separately for every skin, or bus that several share (``left+right``)."""
        self.counts: Counter[str] = Counter()
        """Entries by kind."""
        self.origin_ns: int | None = None
        """The machine's monotonic clock at ``t_ns = 0``, where the run follows it; set it before the first entry."""
        self.context: LogContext | None = None
        """The scene, which the file describes, with the poses of its bodies; set it before the first entry."""
        self.skins: Mapping[str, Sequence[str]] = {}
        """The keys of the senses of each skin that the run logs; empty: unknown, and every name is taken."""
        self.buses: Collection[str] = ()
        """The names of the buses that several skins share (``left+right``)."""
        self._poses = np.zeros((0, 7))
        """The poses that were written last."""

    # -- the latest ---------------------------------------------------------------------------------------------------

    @property
    def samples(self) -> list[Sample]:
        """The latest samples, oldest first; a copy, which a running emulator does not change."""
        return list(self._memory.samples)

    @property
    def frames(self) -> list[tuple[int, str, WireFrame]]:
        """The latest frames that left for the driver, as ``(t_ns, device, frame)``, oldest first; also a copy."""
        found: list[tuple[int, str, WireFrame]] = []
        for t_ns, device, frame in list(self._memory.frames):
            found += [(t_ns, device, each) for each in (frame if isinstance(frame, CanFrames) else [frame])]
        return found

    @property
    def forgotten(self) -> int:
        """The number of samples and frames that were dropped from memory."""
        return self._memory.forgotten

    @property
    def lost(self) -> int:
        """The number of entries that the file lacks, because the disk was full or too slow."""
        return self._writers[0].lost if self._writers else 0

    def latest(self, device: str, sense: str | None = None) -> Sample | None:
        """Return the latest sample of a skin, of the named sense or of the one that was sampled first; None before it.

        Raises:
            TactemuError: the run has no such skin, or the skin no such sense.
        """
        senses = self.latest_of(device)
        if sense is not None and self.skins:
            known = self.skins[device]
            if sense not in known:
                raise TactemuError(f"skin {device!r}: {no_such('sense', sense, known)}")
            if sense == known[0] and sense not in senses:
                return senses.get("")  # counts that are an array are of the first sense, and do not name it
        return senses.get(sense) if sense is not None else next(iter(senses.values()), None)

    def latest_of(self, device: str) -> dict[str, Sample]:
        """Return the latest sample of each sense of a skin, in the order in which they were first sampled.

        Raises:
            TactemuError: the run has no such skin.
        """
        self._check(device)
        return dict(self._latest.get(device, {}))

    def latest_frame(self, device: str) -> WireFrame | None:
        """Return the latest frame of one skin that left for the driver; None before it.

        Raises:
            TactemuError: the run has no such skin.
        """
        self._check(device)
        latest = self._latest_frames.get(device)
        return latest[-1] if isinstance(latest, CanFrames) else latest

    def injected_at(self, device: str) -> Counter[str]:
        """Return the injected faults by name of one skin and of the bus that it is on, or of one bus.

        Raises:
            TactemuError: the run has no such skin or bus.
        """
        self._check(device, self.buses)
        found: Counter[str] = Counter()
        for name, counts in self.injected_by_device.items():
            if device == name or device in name.split("+"):
                found += counts
        return found

    def _check(self, device: str, others: Collection[str] = ()) -> None:
        """Raise if the run has no such skin, and no other source of entries of this name."""
        if self.skins and device not in self.skins and device not in others:
            raise TactemuError(no_such("skin", device, self.skins))

    # -- entries of the loop -------------------------------------------------------------------------------------------

    def sample(
        self,
        t_ns: int,
        device: str,
        ideal: np.ndarray,
        measured: np.ndarray,
        counts: np.ndarray,
        *,
        number: int | None = None,
        sense: str = "",
    ) -> int:
        """Log one sample and return its number; the arrays are copied, so that the caller may reuse them.

        Args:
            t_ns: the time of the sample.
            device: name of the skin.
            ideal: reading without imperfections of values, SI, shape ``(n_taxels[, 3])``.
            measured: reading with imperfections, same shape.
            counts: the values that a perfect driver decodes.
            number: its number; default: one more than the device's last, from 0. Frames that carry it have it too.
            sense: the name of the device's sense.
        """
        self.counts["sample"] += 1
        number = self._numbers.get(device, 0) if number is None else number
        self._numbers[device] = number + 1
        ideal, measured, counts = _copied(ideal, measured, np.asarray(counts))
        entry = Sample(t_ns, device, ideal, measured, counts, number, sense)
        self._latest.setdefault(device, {})[sense] = entry
        self._memory.add_sample(entry)
        if self._has_sinks:
            self._log(entry)
        if self._writers:
            self._log_poses(t_ns)
        return number

    def wrote(self, t_ns: int, device: str, frame: WireFrame, sample: int | None = None, late_ns: int = 0) -> None:
        """Log a frame that left for the driver; ``sample`` is the number of the sample that it carries, if any."""
        self.counts["tx"] += 1
        self._latest_frames[device] = frame
        self._memory.add_frame(t_ns, device, frame)
        if self._has_sinks:
            self._log(Passage(t_ns, device, "tx", frame, sample, late_ns=late_ns))

    def wrote_all(self, t_ns: int, device: str, frames: CanFrames, sample: int | None = None, late_ns: int = 0) -> None:
        """Log several frames of one sample that left together."""
        self.counts["tx"] += len(frames)
        self._latest_frames[device] = frames
        self._memory.add_frame(t_ns, device, frames)
        if self._has_sinks:
            for frame in frames:
                self._log(Passage(t_ns, device, "tx", frame, sample, late_ns=late_ns))

    def received(self, t_ns: int, device: str, frame: WireFrame) -> None:
        """Log a frame that arrived from the driver."""
        self.counts["rx"] += 1
        if self._has_sinks:
            self._log(Passage(t_ns, device, "rx", frame))

    def dropped(self, t_ns: int, device: str, frame: WireFrame, why: str, sample: int | None = None) -> None:
        """Log a frame that never left."""
        self.counts["drop"] += 1
        if self._has_sinks:
            self._log(Passage(t_ns, device, "drop", frame, sample, why))

    def inject(
        self,
        t_ns: int,
        device: str,
        what: str,
        detail: str = "",
        *,
        before: WireFrame | str = "",
        after: Sequence[WireFrame | str] = (),
        frame: int | None = None,
    ) -> None:
        """Log an injected fault with frames or values as text, ``before`` it and ``after`` it, and its number."""
        self.injected[what] += 1
        self.injected_by_device.setdefault(device, Counter())[what] += 1
        self.counts["inject"] += 1
        if self._has_sinks:
            self._log(Injection(t_ns, device, what, detail, _as_text(before), tuple(map(_as_text, after)), frame))

    def event(self, t_ns: int, device: str, what: str) -> None:
        """Log an event, such as an opening of the port or a change of the baud rate."""
        self.counts["event"] += 1
        if self._has_sinks:
            self._log(PortEvent(t_ns, device, what))

    # -- life ----------------------------------------------------------------------------------------------------------

    def begin(self, origin_ns: int | None = None, *, block_when_full: bool = False) -> None:
        """Begin the log and overwrite the file's older content; the first entry does so too.

        Args:
            origin_ns: the machine's monotonic clock at ``t_ns = 0``; ``None`` where time is virtual.
            block_when_full: wait for the disk rather than lose an entry, where time is virtual.
        """
        self.origin_ns = origin_ns
        for writer in self._writers:
            writer.block_when_full = block_when_full
            if not writer.has_begun:
                writer.begin(self._header())

    def write_also(self, path: str | Path, *, flush_s: float | None = None) -> None:
        """Write all entries to one more file too, flushed every ``flush_s`` [s]; call before the first entry.

        Raises:
            TactemuError: a suffix that is no format.
            OSError: the file cannot be written.
        """
        self._writers.append(LogWriter(path, flush_s=flush_s))
        self._has_sinks = True

    def tap(self, tap: Watcher) -> None:
        """Add a watcher that receives samples, frames, faults and events. Safe from any thread."""
        self._taps = (*self._taps, tap)
        self._has_sinks = True

    def untap(self, tap: Watcher) -> None:
        """Remove a watcher. Safe from any thread, and twice."""
        self._taps = tuple(each for each in self._taps if each is not tap)
        self._has_sinks = bool(self._writers or self._taps)

    def prepare_restore(self, state: Mapping[str, Any]) -> Callable[[], None]:
        """Return a callable that drops all entries from memory; counters continue from the state."""
        return self._memory.forget

    def close(self, summary: Sequence[Mapping[str, Any]] = ()) -> None:
        """Finish the file, with a summary of each device if there is one. Safe to call twice."""
        for writer in self._writers:
            writer.close(summary)

    def _log(self, entry: Entry) -> None:
        size = size_of(entry)
        for writer in self._writers:
            if not writer.has_begun:
                writer.begin(self._header())
            writer.put(entry, size)
        for tap in self._taps:
            tap.put(entry)

    def _header(self) -> Header:
        around = self.context
        return Header(self.origin_ns, scene=None if around is None else around.description())

    def _log_poses(self, t_ns: int) -> None:
        """Log the poses that have changed since the last sample."""
        if self.context is None:
            return
        poses = self.context.poses()
        known = self._poses.shape == poses.shape
        moved = np.flatnonzero((poses != self._poses).any(axis=1)) if known else np.arange(len(poses))
        for b in moved.tolist():
            x, y, z, *quaternion = poses[b].tolist()
            self._log(BodyPose(t_ns, self.context.names[b], (x, y, z), tuple(quaternion)))
        self._poses = poses


def _copied(*arrays: np.ndarray) -> list[np.ndarray]:
    """Return read-only copies of arrays in one block of memory."""
    packed = b"".join([(values if values.flags.c_contiguous else values.copy()).data for values in arrays])
    copies, start = [], 0
    for values in arrays:
        copies.append(np.ndarray(values.shape, values.dtype, packed, start))
        start += values.nbytes
    return copies


def _as_text(value: WireFrame | str) -> str:
    return value if isinstance(value, str) else text(value)
