"""Checksums by name. CRCs are crcmod's, with names and parameters as in Greg Cook's catalogue.

>>> SUMS["crc16_modbus"].function(b"123456789") == 0x4B37
True
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, reduce
from operator import xor
from typing import NamedTuple

from crcmod.predefined import mkPredefinedCrcFun

__all__ = [
    "SUMS",
    "Sum",
    "crc8",
    "crc8_maxim",
    "crc16_arc",
    "crc16_ati",
    "crc16_ccitt_false",
    "crc16_kermit",
    "crc16_modbus",
    "crc16_umts",
    "crc16_weiss",
    "crc16_x25",
    "crc16_xmodem",
    "crc32",
    "crc32_mpeg",
    "inv8",
    "lrc8",
    "sum8",
    "sum16",
    "xor8",
]


def sum8(data: bytes) -> int:
    """Return the low byte of the sum of the bytes."""
    return sum(data) & 0xFF


def inv8(data: bytes) -> int:
    """Return the low byte of the sum of the bytes, every bit inverted."""
    return ~sum(data) & 0xFF


def lrc8(data: bytes) -> int:
    """Return the negated sum of the bytes: a message and its LRC add up to 0."""
    return -sum(data) & 0xFF


def xor8(data: bytes) -> int:
    """Return the exclusive or of all bytes."""
    return reduce(xor, data, 0)


def sum16(data: bytes) -> int:
    """Return the low two bytes of the sum of the bytes."""
    return sum(data) & 0xFFFF


@cache
def _crc(name: str) -> Callable[..., int]:
    return mkPredefinedCrcFun(name)


def crc8(data: bytes) -> int:
    """Return CRC-8/SMBUS: polynomial 07, start 00."""
    return _crc("crc-8")(data)


def crc8_maxim(data: bytes) -> int:
    """Return CRC-8/MAXIM-DOW: polynomial 31 reflected, start 00."""
    return _crc("crc-8-maxim")(data)


def crc16_modbus(data: bytes) -> int:
    """Return CRC-16/MODBUS: polynomial 8005 reflected, start FFFF; sent low byte first."""
    return _crc("modbus")(data)


def crc16_arc(data: bytes) -> int:
    """Return CRC-16/ARC: polynomial 8005 reflected, start 0000."""
    return _crc("crc-16")(data)


def crc16_umts(data: bytes) -> int:
    """Return CRC-16/UMTS: polynomial 8005, start 0000; Dynamixel 2.0."""
    return _crc("crc-16-buypass")(data)


def crc16_xmodem(data: bytes) -> int:
    """Return CRC-16/XMODEM: polynomial 1021, start 0000."""
    return _crc("xmodem")(data)


def crc16_ati(data: bytes) -> int:
    """Return the CRC of ATI's wireless boxes: polynomial 1021, start 1234."""
    return _crc("xmodem")(data, 0x1234)


def crc16_ccitt_false(data: bytes) -> int:
    """Return CRC-16/IBM-3740, often called CCITT: polynomial 1021, start FFFF."""
    return _crc("crc-ccitt-false")(data)


def crc16_kermit(data: bytes) -> int:
    """Return CRC-16/KERMIT: polynomial 1021 reflected, start 0000."""
    return _crc("kermit")(data)


def crc16_x25(data: bytes) -> int:
    """Return CRC-16/IBM-SDLC: polynomial 1021 reflected, start FFFF, inverted."""
    return _crc("x-25")(data)


@cache
def _weiss_table() -> tuple[int, ...]:
    return tuple(crc16_xmodem(bytes([byte])) for byte in range(256))


def crc16_weiss(data: bytes) -> int:
    """Return the CRC of Weiss Robotics, in no catalogue: the table of 1021, stepped as if reflected; start FFFF."""
    table, crc = _weiss_table(), 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc


def crc32(data: bytes) -> int:
    """Return CRC-32/ISO-HDLC: Ethernet, zlib."""
    return _crc("crc-32")(data)


def crc32_mpeg(data: bytes) -> int:
    """Return CRC-32/MPEG-2: polynomial 04C11DB7, start FFFFFFFF, neither reflected nor inverted; STM32."""
    return _crc("crc-32-mpeg")(data)


class Sum(NamedTuple):
    """A checksum and its size [bytes]."""

    function: Callable[[bytes], int]
    size: int


SUMS: dict[str, Sum] = {
    **{function.__name__: Sum(function, 1) for function in (sum8, inv8, lrc8, xor8, crc8, crc8_maxim)},
    **{
        function.__name__: Sum(function, 2)
        for function in (
            sum16, crc16_modbus, crc16_arc, crc16_umts, crc16_xmodem, crc16_ccitt_false, crc16_kermit, crc16_x25,
            crc16_weiss, crc16_ati,
        )
    },
    **{function.__name__: Sum(function, 4) for function in (crc32, crc32_mpeg)},
}  # fmt: skip
"""The checksums by their names in frame tables."""
