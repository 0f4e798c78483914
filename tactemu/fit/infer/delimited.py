"""Streams whose messages end with a byte: escaped ones (PPP, SLIP, COBS) and lines of text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

LEAST_MESSAGES = 12
ESCAPE_SHARE = 1 / 600
"""The least share of escape bytes: random data have one in 256."""
TEXT_SHARE = 0.97
NUMBER = rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Message:
    """One message of a stream."""

    at: int
    """The offset of its first byte in the stream."""
    size: int
    """The number of bytes on the wire, without the byte that ends it."""
    data: bytes
    """The content, escapes undone."""


def unescaped(part: bytes, escape: int, decode: Callable[[int], int | None]) -> bytes | None:
    """Return bytes without escapes; ``None`` if an escape is wrong."""
    if escape not in part:
        return part
    out, k = bytearray(), 0
    while k < len(part):
        byte = part[k]
        if byte == escape:
            k += 1
            decoded = decode(part[k]) if k < len(part) else None
            if decoded is None:
                return None
            byte = decoded
        out.append(byte)
        k += 1
    return bytes(out)


def escaped(data: bytes, end: int, escape: int, encode: Callable[[int], int]) -> bytes:
    """Return bytes with the end byte and the escape byte escaped."""
    out = bytearray()
    for byte in data:
        out += bytes([escape, encode(byte)]) if byte in (end, escape) else bytes([byte])
    return bytes(out)


def uncobs(part: bytes) -> bytes | None:
    """Return the content of a COBS message; ``None`` if a length is wrong."""
    out, k = bytearray(), 0
    while k < len(part):
        code = part[k]
        if code == 0 or k + code > len(part):
            return None
        out += part[k + 1 : k + code]
        k += code
        if code < 255 and k < len(part):
            out.append(0)
    return bytes(out)


@dataclass(frozen=True)
class Coding:
    """A way to end messages with a byte that their content never has."""

    name: str
    end: int
    escape: int | None
    decode: Callable[[bytes], bytes | None]
    encode: Callable[[bytes], bytes]


def _slip_code(byte: int) -> int | None:
    return {0xDC: 0xC0, 0xDD: 0xDB}.get(byte)


def _cobs(data: bytes) -> bytes:
    from firmware_protocols import cobs

    return cobs(data)[:-1]


CODINGS = (
    Coding(
        "PPP",
        0x7E,
        0x7D,
        lambda part: unescaped(part, 0x7D, lambda byte: byte ^ 0x20),
        lambda data: escaped(data, 0x7E, 0x7D, lambda byte: byte ^ 0x20),
    ),
    Coding(
        "SLIP",
        0xC0,
        0xDB,
        lambda part: unescaped(part, 0xDB, _slip_code),
        lambda data: escaped(data, 0xC0, 0xDB, lambda byte: {0xC0: 0xDC, 0xDB: 0xDD}[byte]),
    ),
    Coding("COBS", 0x00, None, uncobs, _cobs),
)


def parts_of(stream: bytes, end: int) -> list[tuple[int, bytes]]:
    """Return offset and bytes of the parts between end bytes, without empty ones and without the cut ones."""
    parts, at = [], 0
    for part in stream.split(bytes([end])):
        parts.append((at, part))
        at += len(part) + 1
    return [(at, part) for at, part in parts[1:-1] if part]


def find_coding(stream: bytes) -> Coding | None:
    """Return the coding whose escapes are right in nearly all of a stream's messages."""
    for coding in CODINGS:
        parts = parts_of(stream, coding.end)
        if len(parts) < LEAST_MESSAGES:
            continue
        body = sum(len(part) for _, part in parts)
        if coding.escape is not None:
            escapes = sum(part.count(coding.escape) for _, part in parts)
            if escapes < max(4, ESCAPE_SHARE * body):
                continue
        decoded = [data for _, part in parts if (data := coding.decode(part)) is not None and len(data) > 1]
        lengths = Counter(map(len, decoded))
        few = sum(count for _, count in lengths.most_common(8))
        if len(decoded) > 0.97 * len(parts) and few > 0.9 * len(decoded) and sum(map(len, decoded)) > 5 * len(decoded):
            return coding
    return None


def is_text(stream: bytes) -> bool:
    """Return True if nearly all bytes are printable."""
    printable = sum(byte in b"\r\n\t" or 32 <= byte < 127 for byte in stream)
    return len(stream) > 0 and printable > TEXT_SHARE * len(stream)


@dataclass(frozen=True)
class LineShape:
    """The lines of one shape: literal text with numbers between."""

    literals: tuple[bytes, ...]
    """The text before, between and behind the numbers."""
    count: int

    @property
    def numbers(self) -> int:
        """The count of numbers in a line."""
        return len(self.literals) - 1

    def __str__(self) -> str:
        text = b"#".join(self.literals).decode("latin-1")
        short = text if len(text) <= 60 else f"{text[:57]}..."
        return f"{short!r} ({self.numbers} numbers)"


def line_end(stream: bytes) -> bytes:
    """Return the bytes that end lines: CR LF, LF or CR."""
    if stream.count(b"\r\n") >= 0.9 * max(1, stream.count(b"\n")) > 0:
        return b"\r\n"
    return b"\n" if b"\n" in stream else b"\r"


def line_shapes(lines: list[bytes]) -> list[LineShape]:
    """Return the shapes of lines, the commonest first."""
    shapes = Counter(tuple(re.split(NUMBER, line)) for line in lines)
    return [LineShape(literals, count) for literals, count in shapes.most_common()]
