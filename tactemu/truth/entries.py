"""The entries of a truth log: samples, frames, injected faults and events of the port, in the order of their times.

``t_ns`` is emulation time in integer nanoseconds, ``device`` the name of the skin in the scene; received data and
faults of a bus that several skins share have all their names (``left+right``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from firmware_protocols import WireFrame
from tactemu.base import frame_text

VERSION = 2
"""The version of the log's format, in both encodings."""
MAX_TIME_NS = 2**63 - 1
"""Latest time of an entry [ns]: times are integers of 64 bits."""

COMMAND = "command "
"""The prefix of an event that is a live command; JSON follows it."""

Direction = Literal["tx", "rx", "drop"]


@dataclass(slots=True, eq=False)
class Sample:
    """One sample of one device. Arrays in layout order, read-only."""

    t_ns: int
    device: str
    ideal: np.ndarray
    """The reading without imperfections of values, SI, shape ``(n_taxels[, 3])``."""
    measured: np.ndarray
    """The reading with imperfections, same shape."""
    counts: np.ndarray
    """The values that a perfect driver decodes from the frames."""
    number: int = 0
    """The number of the device's sample, from 0; senses that were converted together have the same number."""
    sense: str = ""
    """The name of the device's sense, where the device names them."""


class Passage(NamedTuple):
    """A frame on its way: ``tx`` left for the driver, ``rx`` arrived from it, ``drop`` never left."""

    t_ns: int
    device: str
    kind: Direction
    frame: WireFrame
    sample: int | None = None
    """The number of the sample that it carries; ``None``: none, or unknown."""
    why: str = ""
    """The reason why it never left."""
    late_ns: int = 0
    """The delay of the emulator's loop after the frame's last bit had left the line [ns]; not written to logs."""
    is_answer: bool = False
    """True where the judge has found the number: the frame carries no sample of its own, and ``sample`` is the latest
    one at the driver's last question. Not written to logs."""

    @property
    def text(self) -> str:
        """The frame as text: hex for bytes, ``candump`` notation for CAN."""
        return frame_text.text(self.frame)


class Injection(NamedTuple):
    """A fault of values, time or bytes that was injected."""

    t_ns: int
    device: str
    what: str
    detail: str = ""
    before: str = ""
    """The frame or value before the fault, as text; empty if there is none."""
    after: tuple[str, ...] = ()
    """The frames or values after the fault; a frame may become none, or two."""
    frame: int | None = None
    """The number of the frame, from 1 at the first after the fault was switched on; ``None``: none, or unknown."""

    @property
    def fault(self) -> str:
        """The fault in the language of ``--fault``, where a wire injected it."""
        return self.detail.partition(" [")[0]


class PortEvent(NamedTuple):
    """An event: ``opened``, ``closed``, ``baud 9600`` ...; without a device: a live ``command``, in JSON."""

    t_ns: int
    device: str
    what: str

    @property
    def is_command(self) -> bool:
        """True for a live command to the emulator."""
        return not self.device and self.what.startswith(COMMAND)


class BodyPose(NamedTuple):
    """The pose of a body of the scene when a sample was taken; logged only when it has changed."""

    t_ns: int
    body: str
    position: tuple[float, float, float]
    """The position of its origin in the world [m]."""
    quaternion: tuple[float, float, float, float]
    """The orientation, (w, x, y, z)."""


class Header(NamedTuple):
    """The head of a log."""

    origin_ns: int | None = None
    """The machine's monotonic clock at ``t_ns = 0``; ``None``: time was virtual, or unknown."""
    version: int = VERSION
    scene: Mapping[str, Any] | None = None
    """The bodies and skins of the scene, as plain data (``docs/truth-log.md``); ``None``: unknown."""
    ends: bool = False
    """True if a complete log has an :class:`End`, so that one without was cut off; older logs have False."""


class End(NamedTuple):
    """The end of a log."""

    lost: int = 0
    """The number of entries that could not be written."""
    summary: Sequence[Mapping[str, Any]] = ()
    """The summary of each device, as `tactemu run --json` prints it at its end; may be empty."""
    is_cut: bool = False
    """True if the file stops without its end, because its writer was killed or the disk was full."""


Entry = Sample | Passage | Injection | PortEvent | BodyPose


def belongs_to(entry: Entry, skin: str | None) -> bool:
    """Return True if an entry is of a skin, or of its bus; ``None`` is any skin, and bodies belong to all."""
    return skin is None or isinstance(entry, BodyPose) or skin == entry.device or skin in entry.device.split("+")


class Sink(Protocol):
    """The file that a format writes to."""

    def write(self, data: bytes) -> int:
        """Write all of ``data``."""
        ...

    def tell(self) -> int:
        """Return the number of bytes written."""
        ...

    def flush(self) -> None:
        """Write what is buffered."""
        ...


def checked_header(version: Any, origin_ns: Any, scene: Any = None, ends: Any = False) -> Header:
    """Return the head of a log, if this program can read what follows.

    Raises:
        ValueError: it cannot.
    """
    if not _is_integer(version) or version < 1:
        raise ValueError(f"version: expected a number from 1, got {version!r:.60}")
    if version > VERSION:
        raise ValueError(f"the log has version {version}, this tactemu reads up to {VERSION}: update it")
    if origin_ns is not None and not (_is_integer(origin_ns) and abs(origin_ns) <= MAX_TIME_NS):
        raise ValueError(f"origin_ns: expected an integer of 64 bits, got {origin_ns!r:.60}")
    if not isinstance(scene, dict | None):
        raise ValueError(f"scene: expected an object, got {scene!r:.60}")
    return Header(origin_ns, version, scene, bool(ends))


def checked_end(lost: Any, summary: Any) -> End:
    """Return the end of a log after checking its fields.

    Raises:
        ValueError: a field has a wrong type or value.
    """
    if not _is_integer(lost) or not 0 <= lost <= MAX_TIME_NS:
        raise ValueError(f"lost: expected a number, got {lost!r:.60}")
    if not isinstance(summary, list) or not all(isinstance(each, dict) and "skin" in each for each in summary):
        raise ValueError(f"summary: expected a list of objects with a skin, got {summary!r:.60}")
    return End(lost, summary)


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
