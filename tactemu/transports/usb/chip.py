"""The behaviour of a USB device beside its data: its descriptors and its answers to control requests."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from typing import NamedTuple

from firmware_protocols import USB
from tactemu.transports.transport import Event, LinesChanged, Noted, SerialSetting, SettingChanged
from tactemu.transports.usb.descriptors import CONFIGURATION, DEVICE, STRING, Descriptors

TO_HOST = 0x80
"""The bit of ``bmRequestType`` that is set if the data of a request go to the host."""
STANDARD, CLASS, VENDOR = 0x00, 0x20, 0x40
MAX_TO_HOST_BYTES = 4096
"""Maximum number of bytes that wait for the host; a frame that finds no room is dropped whole."""
DONE = b""
"""The answer to a request without data that the device carries out."""


class Setup(NamedTuple):
    """A control request (USB 2.0, table 9-2)."""

    kind: int
    """``bmRequestType``: direction, type and recipient."""
    request: int
    value: int
    target: int
    """``wIndex``: the interface or endpoint, or more of the value."""
    length: int

    @property
    def type(self) -> int:
        """:data:`STANDARD`, :data:`CLASS` or :data:`VENDOR`."""
        return self.kind & 0x60


class Chip(ABC):
    """A kind of USB device with one stream of bytes each way."""

    data_in: int = 0x81
    """The address of the endpoint on which data go to the host."""
    data_out: int = 0x02
    listens_when_configured: bool = False
    """True if a driver is there as soon as it has configured the device; else from its first request for data until it
    withdraws them, as a tty's driver does. Programs that read by libusb have none between two reads."""
    is_framed: bool = False
    """True if a transfer to the host carries one frame, or a piece of it."""

    def __init__(self, identity: USB | None = None):
        self.identity = identity
        self.channels: tuple[Chip, ...] = (self,)
        """The parts with a stream of bytes each, in the order of their interfaces; mostly the chip alone."""
        self.setting = SerialSetting()
        self.lines = LinesChanged(False, False)
        self.events: deque[Event] = deque()
        """Events since they were last taken: settings, modem lines, notes."""

    @abstractmethod
    def descriptors(self) -> Descriptors:
        """Return the descriptors of the device."""

    @abstractmethod
    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out a request of a class or the vendor and return its data; None refuses it, as a stall."""

    def answer(self, setup: Setup, data: bytes) -> bytes | None:
        """Carry out any control request and return its data, at most ``setup.length`` bytes; None refuses it."""
        answer = self._standard(setup) if setup.type == STANDARD else self.control(setup, data)
        return None if answer is None else answer[: setup.length]

    def packets_to_host(self, data: bytearray, length: int) -> bytes:
        """Return one transfer of at most ``length`` bytes, and remove from ``data`` what it carries."""
        taken = bytes(data[:length])
        del data[:length]
        return taken

    def takes(self, setup: Setup) -> bool:
        """Return True if the data of a control request are data for the device, as those of its endpoint."""
        return False

    def from_host(self, data: bytes) -> bytes:
        """Return the data of a transfer of the host."""
        return data

    def _standard(self, setup: Setup) -> bytes | None:
        match setup.request:
            case 6 if setup.kind & TO_HOST:  # GET_DESCRIPTOR
                return self.descriptor(setup.value >> 8, setup.value & 0xFF)
            case 0:  # GET_STATUS
                return b"\0\0"
            case 8:  # GET_CONFIGURATION
                return b"\1"
            case 10:  # GET_INTERFACE
                return b"\0"
            case 1 | 3 | 9 | 11:  # features, SET_CONFIGURATION, SET_INTERFACE
                return DONE
        return None

    def descriptor(self, kind: int, number: int) -> bytes | None:
        """Return a descriptor by its type and number, or None if there is none."""
        own = self.descriptors()
        match kind:
            case 1:
                return own.device()
            case 2:
                return own.configuration()
            case 3:
                return own.string(number)
        return None

    # -- for chips with a UART ---------------------------------------------------------------------------------------

    def set(self, **changes: float | str) -> None:
        """Change entries of the serial setting; an event tells the device."""
        new = replace(self.setting, **changes)
        if new != self.setting:
            self.setting = new
            self.events.append(SettingChanged(new))

    def set_lines(self, values: int, mask: int = 3) -> None:
        """Set DTR (bit 0) and RTS (bit 1), as far as ``mask`` names them."""
        bits = (self.lines.dtr | self.lines.rts << 1) & ~mask | values & mask
        new = LinesChanged(bool(bits & 1), bool(bits & 2))
        if new != self.lines:
            self.lines = new
            self.events.append(new)

    def note(self, what: str) -> None:
        """Write something to the truth log."""
        self.events.append(Noted(what))

    def named(self, manufacturer: str, product: str, serial: str = "") -> tuple[str, str, str]:
        """Return the strings of the device: those of the sensor's maker, else those of the chip."""
        own = self.identity
        if own is None:
            return manufacturer, product, serial
        return own.manufacturer or manufacturer, own.product or product, own.serial or serial

    def is_same_device(self, other: Chip) -> bool:
        """Return True if both may be channels of one device: their identities differ in the interface at most."""
        own = self.identity and replace(self.identity, interface=0)
        return own == (other.identity and replace(other.identity, interface=0))

    def ids(self, vid: int, pid: int) -> tuple[int, int]:
        """Return the vendor and product ids: those of the sensor's maker, else those of the chip."""
        return (self.identity.vid, self.identity.pid) if self.identity else (vid, pid)


__all__ = ["CONFIGURATION", "DEVICE", "DONE", "STRING", "Chip", "Setup"]
