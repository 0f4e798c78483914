"""The interface of all ports. A transport moves bytes or CAN frames; it depends on no sensor and no pace."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from firmware_protocols import Connector, WireFrame
from firmware_protocols.can_frames import CanFrames

MAX_CHUNK_BYTES = 512
"""Maximum number of a driver's bytes that one :meth:`Transport.poll` takes; bounds the delay that a flood can cause.

As many requests as can be answered in some milliseconds."""
MAX_LEFTOVER_BYTES = 65_536
"""Maximum number of bytes taken at once of a driver that closed the port while its line was full."""


@dataclass(frozen=True, slots=True)
class SerialSetting:
    """The settings of one end of a serial line; ``None`` where they are unknown."""

    baud: int | None = None
    """The speed [bit/s]."""
    bytesize: int | None = None
    """The number of data bits, 5 to 8."""
    parity: str | None = None
    """The parity, ``N``, ``E``, ``O``, ``M`` or ``S``, as in pyserial."""
    stopbits: float | None = None
    """The number of stop bits, 1, 1.5 or 2."""


@dataclass(frozen=True, slots=True)
class Opened:
    """An event: the driver opened the port."""


@dataclass(frozen=True, slots=True)
class Closed:
    """An event: the driver closed the port."""


@dataclass(frozen=True, slots=True)
class Received:
    """An event: a chunk of up to :data:`MAX_CHUNK_BYTES` bytes, or one CAN frame, has come from the driver."""

    data: WireFrame


@dataclass(frozen=True, slots=True)
class SettingChanged:
    """An event: the driver changed the settings of its end of the line."""

    setting: SerialSetting


@dataclass(frozen=True, slots=True)
class LinesChanged:
    """An event: the driver set the modem lines. Unknown lines follow :class:`Opened` and :class:`Closed`."""

    dtr: bool
    rts: bool


@dataclass(frozen=True, slots=True)
class Noted:
    """An event of the port that no device sees; it is written to the truth log."""

    what: str


@dataclass(frozen=True, slots=True)
class Counted:
    """An event: the kernel or a UART has counted something, such as frames that it dropped or bytes in error."""

    counter: str
    """The counter of the wire: ``overflow``, ``framing``, ``parity`` ..."""
    count: int

    def __str__(self) -> str:
        return f"{self.counter}: {self.count}"


class Part(bytes):
    """The beginning of a frame, which the next write continues. On a byte stream it is like any other piece."""


Event = Opened | Closed | Received | SettingChanged | LinesChanged | Noted | Counted

RAISED = LinesChanged(True, True)
"""The change of the modem lines when a port is opened."""
DROPPED = LinesChanged(False, False)
"""The change of the modem lines when a port is closed."""


@dataclass(frozen=True, slots=True)
class CanFilter:
    """A filter for identifiers: those that agree with ``ident`` in the bits of ``mask`` pass."""

    ident: int
    mask: int = 0x1FFF_FFFF
    extended: bool = False

    def passes(self, ident: int, extended: bool) -> bool:
        """Return True if a frame with this identifier passes."""
        return (ident ^ self.ident) & self.mask == 0 and extended == self.extended


class Transport(ABC):
    """A port. The constructor only parses; :meth:`open` makes the port, :meth:`close` removes it."""

    scheme: ClassVar[str]
    is_paced: bool = False
    """True where a real line is behind the port: it takes a frame's time itself, so the wire hands the frame over when
    its first bit may leave, and what the driver sends has taken its time when it arrives."""

    address: str = ""
    """The address to open: a path, a URL of pyserial (``socket://``, ``rfc2217://``), ``interface:channel``.

    Valid while the port is open."""

    @abstractmethod
    def open(self) -> None:
        """Make the port.

        Raises:
            TransportError: it cannot be made; the message says what to do. Nothing is left behind.
        """

    def set_filters(self, filters: Sequence[CanFilter]) -> None:
        """Drop frames that no device receives early, where the port can; an empty sequence drops none.

        Call before :meth:`open`.
        """

    def set_connector(self, connector: Connector) -> None:
        """Take over what a port needs of the device's connector, such as topics and types. Call before :meth:`open`."""

    @abstractmethod
    def close(self) -> None:
        """Remove the port and all that was made for it. Safe to call twice, and on a port that was never opened."""

    @abstractmethod
    def filenos(self, reading: bool = True) -> list[int]:
        """Return file descriptors to ``select`` for reading; where there are none, :meth:`poll` is called often.

        Args:
            reading: as in the next :meth:`poll`; data that it will not take must not wake the loop.
        """

    @abstractmethod
    def poll(self, reading: bool = True) -> list[Event]:
        """Return what happened since the last call, oldest first. Never blocks, and takes a bounded time.

        Args:
            reading: whether the driver's data are taken; otherwise they stay queued, and in the end block the driver,
                as a slower line does.
        """

    def is_quiet(self, readable: Sequence[int]) -> bool:
        """Return True if :meth:`poll` need not be called, since only these file descriptors are readable; False where
        it also reports what makes none readable."""
        return False

    @abstractmethod
    def write(self, frame: WireFrame) -> bool:
        """Write one complete frame, or nothing (``False``: no driver is connected or reads). Never blocks."""

    def write_all(self, frames: CanFrames) -> int:
        """Write CAN frames one after another until one is not taken, and return how many were."""
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
        """Change the name from the next :meth:`open` on, where the port has a name in a folder."""

    def hold(self, held: bool) -> None:
        """Keep the connection but stop reading, answering and reporting events while ``held``."""

    @property
    @abstractmethod
    def has_reader(self) -> bool:
        """True while a driver holds the port; on a bus always."""

    @property
    def setting(self) -> SerialSetting | None:
        """The settings of the driver's end of a serial line; ``None`` where the transport has none."""
        return None

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()
