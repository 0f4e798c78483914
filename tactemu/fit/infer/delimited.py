"""Streams whose messages end with a byte: escaped ones (PPP, SLIP, COBS, and others) and lines of text."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

from firmware_protocols import Stuffing
from firmware_protocols.stuffing import uncobs
from tactemu.fit.infer.stuffings import find_stuffing

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


@dataclass(frozen=True)
class Coding:
    """A way to end messages with a byte that their content never has."""

    name: str
    stuffing: Stuffing | None = None
    """The bytes of its packets, ``None`` for COBS."""

    @property
    def head(self) -> bytes:
        """The byte that begins a message, if there is one."""
        return self.stuffing.head if self.stuffing is not None else b""

    @property
    def end(self) -> bytes:
        """The byte that ends a message."""
        return self.stuffing.tail if self.stuffing is not None else b"\0"

    def decode(self, part: bytes) -> bytes | None:
        """Return the content between head and end; ``None`` if an escape is wrong."""
        return uncobs(part) if self.stuffing is None else self.stuffing.unwrap(part)

    def messages(self, stream: bytes) -> list[Message]:
        """Return the messages whose escapes are right."""
        found = []
        for at, part in parts_of(stream, self.end):
            if self.head:
                begin = part.rfind(self.head)
                at, part = at + begin, part[begin + 1 :] if begin >= 0 else b""
            data = self.decode(part)
            if data:
                found.append(Message(at, len(part) + len(self.head), data))
        return found


PPP = Stuffing(tail=b"\x7e", escape=b"\x7d", codes={bytes([k]): bytes([k ^ 0x20]) for k in range(256)})
SLIP = Stuffing(tail=b"\xc0", escape=b"\xdb", codes={b"\xc0": b"\xdc", b"\xdb": b"\xdd"})
ESCAPED = (Coding("PPP", PPP), Coding("SLIP", SLIP))


def parts_of(stream: bytes, end: bytes) -> list[tuple[int, bytes]]:
    """Return offset and bytes of the parts between end bytes, without empty ones and without the cut ones."""
    parts, at = [], 0
    for part in stream.split(end):
        parts.append((at, part))
        at += len(part) + 1
    return [(at, part) for at, part in parts[1:-1] if part]


def find_coding(stream: bytes) -> Coding | None:
    """Return the coding whose escapes are right in nearly all of a stream's messages."""
    for coding in (*ESCAPED, Coding("COBS")):
        parts = parts_of(stream, coding.end)
        if len(parts) < LEAST_MESSAGES:
            continue
        body = sum(len(part) for _, part in parts)
        if coding.stuffing is not None:
            escapes = sum(part.count(coding.stuffing.escape) for _, part in parts)
            if escapes < max(4, ESCAPE_SHARE * body):
                continue
        decoded = [data for _, part in parts if (data := coding.decode(part)) is not None and len(data) > 1]
        lengths = Counter(map(len, decoded))
        few = sum(count for _, count in lengths.most_common(8))
        if len(decoded) > 0.97 * len(parts) and few > 0.9 * len(decoded) and sum(map(len, decoded)) > 5 * len(decoded):
            return coding
    found = find_stuffing(stream)
    return None if found is None else Coding("stuffed", found)


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
