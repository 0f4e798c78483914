"""What a device can be plugged into. A connector says what is soldered on; how its line behaves is the line model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal


@dataclass(frozen=True)
class USB:
    """What a USB port says of itself when it is listed. Vendor and product ids as the vendor registered them."""

    vid: int
    pid: int
    manufacturer: str = ""
    product: str = ""
    serial: str = ""
    interface: int = 0
    """Number of the interface, for boards with several ports."""
    node: Literal["ttyACM", "ttyUSB"] = "ttyACM"
    """The kernel's name for it: CDC-ACM, or a USB-serial bridge."""


@dataclass(frozen=True, kw_only=True)
class Connector:
    """Any connector."""

    name: str = ""
    """Needed where a device has several."""
    plugged: bool = True
    """Whether it is in use unless the user says otherwise. The first connector always is."""
    whole: ClassVar[bool] = False
    """Frames arrive as they were sent, none in pieces: not a stream of bytes."""


@dataclass(frozen=True, kw_only=True)
class Serial(Connector):
    """A UART, or a USB-CDC port. On a true UART the driver's settings must match and bytes take time."""

    baud: int
    bytesize: int = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = 1
    usb: bool | USB = False
    """USB-CDC: the baud rate is a number that nobody uses; neither pacing nor mismatch applies. A bridge (``ttyUSB``)
    has a true UART behind it."""

    @property
    def is_cdc(self) -> bool:
        """USB all the way."""
        return bool(self.usb) and getattr(self.usb, "node", "") != "ttyUSB"

    @property
    def bits_per_byte(self) -> int:
        """Start, data, parity and stop bits."""
        return 1 + self.bytesize + (self.parity != "N") + self.stopbits


@dataclass(frozen=True, kw_only=True)
class Rs485(Serial):
    """A half-duplex line (RS-485, one-wire TTL): one talks, all hear. Several devices may share it."""

    turnaround_ns: int = 0
    """From the last bit heard until the first that this device can send."""
    echo: bool = False
    """The host hears what it sends."""


@dataclass(frozen=True, kw_only=True)
class Can(Connector):
    """A CAN bus; ``data_bitrate`` makes it CAN-FD with bit rate switching."""

    whole = True
    bitrate: int = 1_000_000
    data_bitrate: int | None = None
    hears: tuple[tuple[int, int], ...] = ()
    """``(id, mask)`` pairs that the device's controller takes, of 29 bits where either needs them; empty: all that the
    host sends."""
    addressed: tuple[tuple[int, int], ...] = ()
    """Such pairs of the frames that are meant for this device. One that its controller does not take is counted as
    ``ignored``: the driver wants something of it that it does not have."""


@dataclass(frozen=True, kw_only=True)
class Tcp(Connector):
    """A TCP server that speaks a framing of its own (Modbus TCP ...), not a raw serial stream."""

    port: int


@dataclass(frozen=True, kw_only=True)
class Udp(Connector):
    """A UDP port: each frame is one datagram. What the device sends goes to whoever spoke to it last."""

    whole = True
    port: int


@dataclass(frozen=True, kw_only=True)
class WebSocket(Connector):
    """A WebSocket server: each frame is one text message, in UTF-8."""

    whole = True
    port: int


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic of DDS: its name, and the name of its type in the IDL."""

    name: str
    type: str


@dataclass(frozen=True, kw_only=True)
class Dds(Connector):
    """A writer and a reader in a DDS domain: each frame is a sample, in CDR, little-endian, from its first member on.

    ``idl`` has their types, as :mod:`firmware_protocols.idl` reads them.
    """

    whole = True
    writes: Topic
    reads: Topic | None = None
    idl: str
    domain: int = 0
