"""What a truth log consists of: samples, frames, injected faults and events of the port, in the order they happened.

``t_ns`` is emulation time in integer nanoseconds, ``device`` the name of the skin in the scene; what arrives on a bus
that several skins share, or befalls it, has all their names (``left+right``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from firmware_protocols import WireFrame

VERSION = 2
"""Of the log's format, in both encodings."""
MAX_TIME_NS = 2**63 - 1
"""Times are integers of 64 bits [ns]."""

COMMAND = "command "
"""What the text of an event begins with that is a command; the rest of it is JSON."""

Direction = Literal["tx", "rx", "drop"]


@dataclass(slots=True, eq=False)
class Sample:
    """One sample of one device. Arrays in layout order, read-only."""

    t_ns: int
    device: str
    ideal: np.ndarray
    """Reading without imperfections of values, SI, shape ``(n_taxels[, 3])``."""
    measured: np.ndarray
    """Reading with them, same shape."""
    counts: np.ndarray
    """What a perfect driver decodes from the frames."""
    number: int = 0
    """Which sample of this device it is, from 0; the senses that were converted together have one number."""
    sense: str = ""
    """Which of the device's senses it is of, where the device names them."""


class Passage(NamedTuple):
    """A frame on its way: ``tx`` left for the driver, ``rx`` arrived from it, ``drop`` never left."""

    t_ns: int
    device: str
    kind: Direction
    frame: WireFrame
    sample: int | None = None
    """Number of the sample that it carries; ``None``: of none, or nobody said."""
    why: str = ""
    """Why it never left."""
    late_ns: int = 0
    """Time by which the emulator's loop was late with it, after its last bit had left the line; in no file."""


class Injection(NamedTuple):
    """A fault of values, time or bytes that was injected."""

    t_ns: int
    device: str
    what: str
    detail: str = ""
    before: str = ""
    """What it befell, a frame as text or a value; empty: nothing that could be named."""
    after: tuple[str, ...] = ()
    """What became of it; a frame may become none, or two."""


class PortEvent(NamedTuple):
    """``opened``, ``closed``, ``baud 9600`` ...; of no device: ``command`` and what was done to it live, in JSON."""

    t_ns: int
    device: str
    what: str

    @property
    def is_command(self) -> bool:
        """Whether it is something that was done to the emulator while it ran."""
        return not self.device and self.what.startswith(COMMAND)


class BodyPose(NamedTuple):
    """Where a body of the scene was when a sample was taken; told when it has changed."""

    t_ns: int
    body: str
    position: tuple[float, float, float]
    """Of its origin, in the world [m]."""
    quaternion: tuple[float, float, float, float]
    """(w, x, y, z)."""


class Header(NamedTuple):
    """How a log begins."""

    origin_ns: int | None = None
    """The machine's monotonic clock at ``t_ns = 0``; ``None``: time was virtual, or nobody said."""
    version: int = VERSION
    scene: Mapping[str, Any] | None = None
    """What is where, as plain data (``docs/truth-log.md``); ``None``: nobody said."""
    ends: bool = False
    """The log closes with its end; without it, it was cut off. Logs of before this was written do not say."""


class End(NamedTuple):
    """How a log ends."""

    lost: int = 0
    """Entries that could not be written."""
    summary: Sequence[Mapping[str, Any]] = ()
    """What each device did, as `tactemu run --json` says it at its end; empty: nobody said."""
    is_cut: bool = False
    """The file stops without its end: its writer was killed, or the disk was full."""


Entry = Sample | Passage | Injection | PortEvent | BodyPose


def belongs_to(entry: Entry, skin: str | None) -> bool:
    """Whether an entry is of this skin, or of the bus that it is on; ``None``: of any. Bodies are everybody's."""
    return skin is None or isinstance(entry, BodyPose) or skin == entry.device or skin in entry.device.split("+")


class Sink(Protocol):
    """A file that a format writes to."""

    def write(self, data: bytes) -> int:
        """Write all of it."""
        ...

    def tell(self) -> int:
        """Return bytes written."""
        ...

    def flush(self) -> None:
        """Hand over what waits."""
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
    """The end of a log.

    Raises:
        ValueError: it is none.
    """
    if not _is_integer(lost) or not 0 <= lost <= MAX_TIME_NS:
        raise ValueError(f"lost: expected a number, got {lost!r:.60}")
    if not isinstance(summary, list) or not all(isinstance(each, dict) and "skin" in each for each in summary):
        raise ValueError(f"summary: expected a list of objects with a skin, got {summary!r:.60}")
    return End(lost, summary)


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
