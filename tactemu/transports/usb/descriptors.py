"""USB descriptors of a device, as bytes (USB 2.0, chapter 9.6)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

DEVICE, CONFIGURATION, STRING, INTERFACE, ENDPOINT = range(1, 6)
ASSOCIATION = 11
ENGLISH = b"\x09\x04"
_TRANSFER = {"bulk": 2, "interrupt": 3}
_REQUIRED = 0x80
"""The bit of ``bmAttributes`` that USB 2.0 reserves as set."""


def descriptor(kind: int, *fields: bytes) -> bytes:
    """Return a descriptor: its length, its type, its fields."""
    body = b"".join(fields)
    return bytes((len(body) + 2, kind)) + body


@dataclass(frozen=True)
class Endpoint:
    """An endpoint; bit 7 of the address is set if data go to the host."""

    address: int
    transfer: Literal["bulk", "interrupt"]
    packet_bytes: int
    interval: int = 0

    def __bytes__(self) -> bytes:
        fields = struct.pack("<BBHB", self.address, _TRANSFER[self.transfer], self.packet_bytes, self.interval)
        return descriptor(ENDPOINT, fields)


@dataclass(frozen=True)
class Interface:
    """An interface with its endpoints."""

    code: tuple[int, int, int]
    """Class, subclass and protocol."""
    endpoints: Sequence[Endpoint]
    string: int = 0
    """The number of the string that names it; 0: none."""
    extra: bytes = b""
    """Descriptors of the interface's class, between its own and those of the endpoints."""

    def as_bytes(self, number: int) -> bytes:
        """Return the descriptors of the interface."""
        own = struct.pack("<BBB3BB", number, 0, len(self.endpoints), *self.code, self.string)
        return descriptor(INTERFACE, own) + self.extra + b"".join(map(bytes, self.endpoints))


@dataclass(frozen=True)
class Descriptors:
    """All descriptors of a device with one configuration."""

    vid: int
    pid: int
    release: int
    """``bcdDevice``, the release of the device in binary-coded decimal: 0x0600 is 6.00."""
    interfaces: Sequence[Interface]
    strings: Sequence[str] = ("", "", "")
    """Manufacturer, product, serial number; an empty one is left out."""
    more_strings: Mapping[int, str] = field(default_factory=dict)
    """The other strings, by number."""
    code: tuple[int, int, int] = (0, 0, 0)
    """Class, subclass and protocol of the device; 0: each interface has its own."""
    usb: int = 0x0200
    """``bcdUSB``, the version of USB."""
    control_bytes: int = 64
    """The packet size of endpoint 0 [byte]."""
    attributes: int = 0
    """``bmAttributes`` beside the bit that is always set: 0x40 own power, 0x20 remote wake-up."""
    power_ma: int = 100
    """The current that the device may take from the bus [mA]."""
    head: bytes = b""
    """Descriptors between that of the configuration and the first interface."""

    def device(self) -> bytes:
        """Return the device descriptor."""
        names = [number if text else 0 for number, text in enumerate(self.strings, start=1)]
        ids = struct.pack("<HHH", self.vid, self.pid, self.release)
        return descriptor(
            DEVICE, struct.pack("<H3BB", self.usb, *self.code, self.control_bytes), ids, bytes((*names, 1))
        )

    def configuration(self) -> bytes:
        """Return the configuration descriptor and those of its interfaces."""
        body = self.head + b"".join(each.as_bytes(number) for number, each in enumerate(self.interfaces))
        fields = (9 + len(body), len(self.interfaces), 1, 0, _REQUIRED | self.attributes, self.power_ma // 2)
        return descriptor(CONFIGURATION, struct.pack("<HBBBBB", *fields)) + body

    def string(self, number: int) -> bytes | None:
        """Return a string descriptor, or None if there is none of this number; 0 lists the languages."""
        if number == 0:
            return descriptor(STRING, ENGLISH)
        text = dict(enumerate(self.strings, start=1)).get(number) or self.more_strings.get(number)
        return descriptor(STRING, text.encode("utf-16-le")) if text else None
