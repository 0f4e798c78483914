"""What every way out of the emulator offers. A transport moves bytes or CAN frames; it knows no sensor and no pace."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from firmware_protocols import CanFrame, Frame


@dataclass(frozen=True, slots=True)
class Opened:
    """The driver opened the port."""


@dataclass(frozen=True, slots=True)
class Closed:
    """The driver closed the port."""


@dataclass(frozen=True, slots=True)
class Received:
    """Bytes in a chunk of any size, or one CAN frame, from the driver."""

    data: Frame


@dataclass(frozen=True, slots=True)
class BaudChanged:
    """The driver set another line speed [bit/s]."""

    baud: int


@dataclass(frozen=True, slots=True)
class LinesChanged:
    """The driver set the modem lines (only where the transport can see them)."""

    dtr: bool
    rts: bool


Event = Opened | Closed | Received | BaudChanged | LinesChanged


class Transport(ABC):
    """One port. The constructor only parses; :meth:`open` makes the port and is undone by :meth:`close`."""

    scheme: ClassVar[str]
    kinds: ClassVar[tuple[str, ...]]
    """Kinds of wire that it can stand for (``serial``, ``can``, ``tcp``), best first; empty: any."""

    address: str = ""
    """What a driver opens: a path, a URL, ``interface:channel``. Valid once open."""

    @abstractmethod
    def open(self) -> None:
        """Make the port.

        Raises:
            TransportError: it cannot be made; the message says what to do. Nothing is left behind.
        """

    @abstractmethod
    def close(self) -> None:
        """Remove the port and everything made for it. Safe to call twice, and on a port never opened."""

    @abstractmethod
    def filenos(self) -> list[int]:
        """File descriptors to ``select`` for reading; where there are none, :meth:`poll` is called often."""

    @abstractmethod
    def poll(self) -> list[Event]:
        """What happened since the last call, oldest first. Never blocks."""

    @abstractmethod
    def write(self, frame: Frame) -> bool:
        """Write one frame whole, or not at all (``False``: nobody listens or reads). Never blocks."""

    @property
    @abstractmethod
    def listening(self) -> bool:
        """Whether a driver holds the port (always true on a bus)."""

    @property
    def baud(self) -> int | None:
        """The speed that the driver set [bit/s]; ``None`` where the transport has no such notion."""
        return None

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *_):
        self.close()


__all__ = [
    "BaudChanged", "CanFrame", "Closed", "Event", "Frame", "LinesChanged", "Opened", "Received", "Transport",
]  # fmt: skip
