"""What every way out of the emulator offers. A transport moves bytes or CAN frames; it knows no sensor and no pace."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from firmware_protocols import CanFrame, Connector, WireFrame
from firmware_protocols.can_frames import CanFrames

MAX_CHUNK_BYTES = 512
"""Bytes of a driver that one :meth:`Transport.poll` takes at most: as many requests as can be answered in some
milliseconds, so that a flood of them leaves time for the rest."""
MAX_LEFTOVER_BYTES = 65_536
"""Bytes that are taken at once of a driver that has gone while its line was full, so that it keeps nobody waiting."""


@dataclass(frozen=True, slots=True)
class SerialSetting:
    """How one end of a serial line is set; ``None`` where it cannot be seen."""

    baud: int | None = None
    """[bit/s]."""
    bytesize: int | None = None
    """Data bits, 5 to 8."""
    parity: str | None = None
    """``N``, ``E``, ``O``, ``M`` or ``S``, as in pyserial."""
    stopbits: float | None = None
    """1, 1.5 or 2."""


@dataclass(frozen=True, slots=True)
class Opened:
    """The driver opened the port."""


@dataclass(frozen=True, slots=True)
class Closed:
    """The driver closed the port."""


@dataclass(frozen=True, slots=True)
class Received:
    """Bytes in a chunk of any size up to :data:`MAX_CHUNK_BYTES`, or one CAN frame, from the driver."""

    data: WireFrame


@dataclass(frozen=True, slots=True)
class SettingChanged:
    """The driver set its end of the line otherwise."""

    setting: SerialSetting


@dataclass(frozen=True, slots=True)
class LinesChanged:
    """The driver set the modem lines; where they cannot be seen, they follow :class:`Opened` and :class:`Closed`."""

    dtr: bool
    rts: bool


@dataclass(frozen=True, slots=True)
class Noted:
    """Something that befell the port and that no device sees; it goes into the truth log."""

    what: str


@dataclass(frozen=True, slots=True)
class Overflowed:
    """The kernel dropped frames because its receive queue was full: the loop was too late to take them."""

    count: int

    def __str__(self) -> str:
        return f"overflow: {self.count} frames"


class Part(bytes):
    """The beginning of a frame; what is written next goes on with it. To a stream of bytes it is like any other."""


Event = Opened | Closed | Received | SettingChanged | LinesChanged | Noted | Overflowed

RAISED, DROPPED = LinesChanged(True, True), LinesChanged(False, False)
"""What the kernel does to the modem lines of a port when it is opened, and when it is closed."""


@dataclass(frozen=True, slots=True)
class CanFilter:
    """Identifiers that a node listens to: those that agree with ``ident`` in the bits of ``mask``."""

    ident: int
    mask: int = 0x1FFF_FFFF
    extended: bool = False

    def passes(self, ident: int, extended: bool) -> bool:
        """Whether a frame with this identifier is one of them."""
        return (ident ^ self.ident) & self.mask == 0 and extended == self.extended


class Transport(ABC):
    """One port. The constructor only parses; :meth:`open` makes the port and is undone by :meth:`close`."""

    scheme: ClassVar[str]

    address: str = ""
    """What a driver opens: a path, a URL of pyserial (``socket://``, ``rfc2217://``), ``interface:channel``. Valid once
    open."""

    @abstractmethod
    def open(self) -> None:
        """Make the port.

        Raises:
            TransportError: it cannot be made; the message says what to do. Nothing is left behind.
        """

    def set_filters(self, filters: Sequence[CanFilter]) -> None:
        """Let frames that nobody on this side listens to cost little, where the port can; empty: hear all.

        Call before :meth:`open`.
        """

    def set_connector(self, connector: Connector) -> None:
        """What the device has there, for ports that must say so: topics and their types. Call before :meth:`open`."""

    @abstractmethod
    def close(self) -> None:
        """Remove the port and everything made for it. Safe to call twice, and on a port never opened."""

    @abstractmethod
    def filenos(self, reading: bool = True) -> list[int]:
        """File descriptors to ``select`` for reading; where there are none, :meth:`poll` is called often.

        Args:
            reading: as the next :meth:`poll` will be called. What nobody will read must not wake anybody.
        """

    @abstractmethod
    def poll(self, reading: bool = True) -> list[Event]:
        """What happened since the last call, oldest first. Never blocks, and takes a bounded time whatever is sent.

        Args:
            reading: whether the driver's data are taken. Those that are not stay where they are, and in the end hold
                the driver up, as a line does that is slower than it.
        """

    @abstractmethod
    def write(self, frame: WireFrame) -> bool:
        """Write one frame whole, or not at all (``False``: nobody listens or reads). Never blocks."""

    def write_all(self, frames: CanFrames) -> int:
        """Write CAN frames one after another, until one is not taken; returns how many were."""
        for count, frame in enumerate(frames):
            if not self.write(frame):
                return count
        return len(frames)

    def hang_up(self, code: int) -> None:
        """Close the connection, where there is one; the driver may open it again.

        Args:
            code: the reason, where the protocol has one (WebSocket: 1000 to 4999).
        """

    def rename(self, name: str) -> None:
        """Be called ``name`` from the next :meth:`open` on, where the port has a name in a folder."""

    def hold(self, held: bool) -> None:
        """While held the connection stays, but nothing is read, answered, or noticed of it."""

    @property
    @abstractmethod
    def has_reader(self) -> bool:
        """Whether a driver holds the port (always true on a bus)."""

    @property
    def setting(self) -> SerialSetting | None:
        """How the driver's end of a serial line is set; ``None`` where the transport has no such notion."""
        return None

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()


__all__ = [
    "DROPPED",
    "MAX_CHUNK_BYTES",
    "MAX_LEFTOVER_BYTES",
    "RAISED",
    "CanFilter",
    "CanFrame",
    "Closed",
    "Event",
    "LinesChanged",
    "Noted",
    "Opened",
    "Part",
    "Received",
    "SerialSetting",
    "SettingChanged",
    "Transport",
    "WireFrame",
]  # fmt: skip
