"""The connectors that a device can have. A connector describes the hardware; its line model describes the timing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal


@dataclass(frozen=True)
class USB:
    """The identity of a USB port in a list of ports; vendor and product ids as the vendor registered them."""

    vid: int
    pid: int
    manufacturer: str = ""
    product: str = ""
    serial: str = ""
    interface: int = 0
    """The number of the interface, for boards with several ports."""
    node: Literal["ttyACM", "ttyUSB"] = "ttyACM"
    """The kernel's name of the port: CDC-ACM, or a USB-serial bridge."""


@dataclass(frozen=True, kw_only=True)
class Connector:
    """A connector of any kind."""

    name: str = ""
    """The port's name; needed where a device has several ports."""
    is_plugged: bool = True
    """True if the connector is in use without the user asking for it. The first connector always is."""
    is_framed: ClassVar[bool] = False
    """True if frames arrive as they were sent, never in pieces; False for a stream of bytes."""


@dataclass(frozen=True, kw_only=True)
class Serial(Connector):
    """A UART, or a USB-CDC port. On a true UART the driver's settings must match and bytes take time."""

    baud: int
    bytesize: int = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = 1
    usb: bool | USB = False
    """True for USB-CDC: the baud rate has no effect, so neither pacing nor mismatch applies. A bridge (``ttyUSB``)
    has a true UART behind it."""

    @property
    def is_cdc(self) -> bool:
        """True if no UART is behind the USB port."""
        return bool(self.usb) and getattr(self.usb, "node", "") != "ttyUSB"

    @property
    def bits_per_byte(self) -> int:
        """The number of start, data, parity and stop bits together."""
        return 1 + self.bytesize + (self.parity != "N") + self.stopbits


@dataclass(frozen=True, kw_only=True)
class Rs485(Serial):
    """A half-duplex line (RS-485, one-wire TTL): one node transmits, all receive. Several devices may share it."""

    turnaround_ns: int = 0
    """The time from the last bit received to the first that this device can send."""
    echo: bool = False
    """True if the host receives its own bytes."""


@dataclass(frozen=True, kw_only=True)
class Can(Connector):
    """A CAN bus; ``data_bitrate`` makes it CAN-FD with bit rate switching."""

    is_framed = True
    bitrate: int = 1_000_000
    data_bitrate: int | None = None
    filters: tuple[tuple[int, int], ...] = ()
    """The controller's acceptance filters, pairs ``(id, mask)``, of 29 bits where either needs them. Empty: it accepts
    every frame of the host."""
    addressed: tuple[tuple[int, int], ...] = ()
    """The device's own address range, also as pairs. A frame in it that no filter accepts is counted as ``ignored``:
    the driver asks for a function that the device does not have."""


@dataclass(frozen=True, kw_only=True)
class Tcp(Connector):
    """A TCP server that speaks a framing of its own (Modbus TCP ...), not a raw serial stream."""

    port: int


@dataclass(frozen=True, kw_only=True)
class Udp(Connector):
    """A UDP port: each frame is one datagram. The device sends to the client from which it last received."""

    is_framed = True
    port: int
    is_of_host: bool = False
    """True if the port is one of the host, where its driver listens: the device sends there unasked."""


@dataclass(frozen=True, kw_only=True)
class WebSocket(Connector):
    """A WebSocket server: each frame is one text message, in UTF-8."""

    is_framed = True
    port: int


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic of DDS, with the name of its type in the IDL."""

    name: str
    type: str


@dataclass(frozen=True, kw_only=True)
class Dds(Connector):
    """A writer and a reader in a DDS domain: each frame is a sample, in CDR, little-endian, from its first member on.

    ``idl`` declares their types, in the part of the language that :mod:`firmware_protocols.idl` supports.
    """

    is_framed = True
    writes: Topic
    reads: Topic | None = None
    idl: str
    domain: int = 0


@dataclass(frozen=True, kw_only=True)
class Hid(Connector):
    """A USB device of the class HID: each frame is a report.

    A device whose reports have numbers begins each frame with the number, in both directions.
    """

    is_framed = True
    usb: USB
    report_descriptor: bytes
    """The format of the reports (HID 1.11, chapter 6.2.2), as the device tells it."""
    input_bytes: int = 64
    """The packet size of the endpoint to the host; a report is at most as long [byte]."""
    output_bytes: int = 64
    """The packet size of the endpoint from the host; 0: none, output reports come as control requests [byte]."""
    interval_ms: int = 1
    """The time between two reports in one direction."""


@dataclass(frozen=True, kw_only=True)
class Bulk(Connector):
    """A USB device of a class of the vendor's own, read by libusb: each frame is a transfer on a bulk endpoint."""

    is_framed = True
    usb: USB
    endpoint_in: int = 0x81
    """The address of the endpoint to the host."""
    endpoint_out: int = 0x02
    packet_bytes: int = 64


@dataclass(frozen=True, kw_only=True)
class I2c(Connector):
    """A target on an I2C bus, which answers to one or several addresses. Several devices may share the bus.

    A frame to the device begins, as on the bus, with the byte of its address and the R/W bit. Behind it stand the bytes
    that the controller writes, or for a read two numbers of 16 bits, high byte first: of the bytes that it has read in
    this transaction already, and of those that it reads now. The device sends as many.
    """

    is_framed = True
    addresses: tuple[int, ...]
    """The addresses of seven bits."""
    clock_hz: int = 100_000
    """The clock of the controller."""

    @staticmethod
    def asked(frame: bytes) -> tuple[int, int] | None:
        """Return the numbers of bytes that were read and that are asked for by a frame; None if it writes."""
        if len(frame) != 5 or not frame[0] & 1:
            return None
        return int.from_bytes(frame[1:3], "big"), int.from_bytes(frame[3:], "big")


def port_error(ports: Any) -> str:
    """Return what is wrong with the ``ports`` of a device, or ``""``."""
    if isinstance(ports, tuple) and ports and all(isinstance(each, Connector) for each in ports):
        return ""
    comma = ", with a comma behind one" if isinstance(ports, Connector) else ""
    return f"ports: expected a tuple of connectors{comma}, got {ports!r}"
