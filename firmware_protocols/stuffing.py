"""Cutters of pieces that end with a byte: lines of text, and packets whose content is stuffed.

A stuffed packet has bytes that occur nowhere in its content: where they do, an escape and a code replace them::

    STUFFING = Stuffing(head=b"[", tail=b"]", escape=b"\\\\", codes={b"[": b"{", b"]": b"}", b"\\\\": b"|"})
    STUFFING.wrap(content)                                             # a frame
    self.packets = Stuffed(STUFFING, counters=self.counters)           # in the device's __init__
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from firmware_protocols.framing import MORE, SOUND, Broken, Cutter, Packets
from firmware_protocols.sums import xor8
from firmware_protocols.tables import Frame


class Lines(Cutter):
    """A cutter of pieces that end with one byte, such as lines of text. It drops empty ones.

    Args:
        ends: each of these bytes ends a line, so CR, LF and CR LF all do.
        counters: the device's; counts ``bad_length`` for each piece above ``longest`` bytes, which is dropped.
        longest: the largest number of bytes in a piece as it is sent.
    """

    misfit = "bad_checksum"

    def __init__(self, ends: bytes = b"\r\n", *, counters: Counter[str], longest: int = 256):
        self.ends, self._counters, self._longest = ends, counters, longest
        self._buffer = b""

    def reset(self) -> None:
        """Discard the bytes received so far, for a new connection."""
        self._buffer = b""

    def cut(self, data: bytes, t_ns: int = 0) -> list[bytes]:
        """Return the lines that these bytes complete, without their ends."""
        *complete, partial = re.split(b"[" + re.escape(self.ends) + b"]", self._buffer + data)
        # One byte beyond the longest is kept, so that the end of a line that is too long is not taken for another.
        self._buffer = partial[: self._longest + 1]
        lines = [line for line in complete if line]
        fitting = [line for line in lines if len(line) <= self._longest]
        if len(fitting) < len(lines):
            self._counters["bad_length"] += len(lines) - len(fitting)
        return fitting

    def content(self, frame: bytes) -> Any:
        """Return the line without its end."""
        return frame.rstrip(self.ends)

    @property
    def has_partial(self) -> bool:
        """True while a piece has begun that has not ended."""
        return bool(self._buffer)

    def end(self) -> list[bytes]:
        """End the piece that has begun, after a silence, and return it."""
        return self.cut(self.ends[:1])


class Ppp(Lines):
    """A cutter of frames between flags 7E, with 7D before an escaped byte, as in HDLC-like framing (RFC 1662).

    Args:
        table, by: the table of a content, and the field that tells requests apart, as for ``Packets``.
        counters: the device's.
        longest: the largest number of bytes in a content.
    """

    def __init__(self, table: Frame | None = None, *, by: str = "", counters: Counter[str], longest: int = 256):
        super().__init__(b"\x7e", counters=counters, longest=2 * longest)
        self.table, self.by = table, by

    def cut(self, data: bytes, t_ns: int = 0) -> list[bytes]:
        """Return the contents of the frames that these bytes complete, unescaped."""
        return [re.sub(b"\x7d+(.?)", _unescaped, frame, flags=re.DOTALL) for frame in super().cut(data)]

    def content(self, frame: bytes) -> Any:
        """Return the content of one frame."""
        return next(iter(Ppp(counters=Counter(), longest=len(frame)).cut(frame)), b"")


def _unescaped(found: re.Match[bytes]) -> bytes:
    return bytes(byte ^ 0x20 for byte in found[1])


def ppp(content: bytes) -> bytes:
    """Return ``content`` escaped, with a flag at either end."""
    return b"\x7e" + content.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e") + b"\x7e"


class Cobs(Lines):
    """A cutter of frames that end with 00 and contain none (Cheshire and Baker, Consistent Overhead Byte Stuffing,
    1999)."""

    def __init__(self, *, counters: Counter[str], longest: int = 256):
        super().__init__(b"\0", counters=counters, longest=longest + longest // 254 + 1)

    def cut(self, data: bytes, t_ns: int = 0) -> list[bytes]:
        """Return the contents of the frames that these bytes complete; an invalid one counts as ``broken_frames``."""
        contents = []
        for frame in super().cut(data):
            if (content := uncobs(frame)) is None:
                self._counters["broken_frames"] += 1
            else:
                contents.append(content)
        return contents


def uncobs(frame: bytes) -> bytes | None:
    """Return the content of a frame, ``None`` if a block reaches beyond the end."""
    content, at, code = bytearray(), 0, 0xFF
    while at < len(frame):
        if code != 0xFF:
            content += b"\0"
        code = frame[at]
        if at + code > len(frame):
            return None
        content += frame[at + 1 : at + code]
        at += code
    return bytes(content)


def cobs(content: bytes) -> bytes:
    """Return ``content`` encoded without zeros, with the zero that ends it."""
    out = bytearray()
    for block in content.split(b"\0"):
        while len(block) >= 254:
            out += b"\xff" + block[:254]
            block = block[254:]
        out += bytes([len(block) + 1]) + block
    return bytes(out) + b"\0"


class Dle(Packets):
    """A cutter of frames DLE STX, content, DLE ETX, check, as in JIS X 5002: a DLE in the content is sent twice.

    The check is the exclusive or of content and ETX.

    Args:
        table, by, broken: the table of a content, and further arguments of ``Packets``.
        counters: the device's.
    """

    has_checksum = True

    def __init__(self, table: Frame | None = None, *, by: str = "", counters: Counter[str], broken: bool = False):
        super().__init__(b"\x10\x02", _dle_size, _dle_check, by=by, counters=counters, broken=broken, longest=512)
        self.table = table

    def requests(self, data: bytes, t_ns: int = 0) -> Iterator[tuple[bytes, dict[str, Any] | None]]:
        """Yield the contents of the packets that these bytes complete."""
        for packet, fields in super().requests(data, t_ns):
            yield packet if isinstance(packet, Broken) else self.content(packet), fields

    def content(self, frame: bytes) -> bytes:
        """Return the content of a frame."""
        return frame[2:-3].replace(b"\x10\x10", b"\x10")


def _dle_size(data: bytes) -> int | str:
    """Return the length of a frame: up to the first DLE that is not doubled, ETX and check."""
    inside = re.match(rb"\x10\x02(?:[^\x10]|\x10\x10)*", data, re.DOTALL)
    size = (inside.end() if inside else 0) + 3
    if not b"\x10\x03".startswith(data[size - 3 : size - 1]):
        return "broken_frames"
    return size if len(data) >= size else MORE


def _dle_check(packet: bytes) -> str:
    return SOUND if xor8(packet[2:-3].replace(b"\x10\x10", b"\x10") + b"\x03") == packet[-1] else "bad_checksum"


def dle(content: bytes) -> bytes:
    """Return ``content`` as a frame of :class:`Dle`."""
    doubled = content.replace(b"\x10", b"\x10\x10")
    return b"\x10\x02" + doubled + b"\x10\x03" + bytes([xor8(content + b"\x03")])


@dataclass(frozen=True)
class Stuffing:
    """The bytes of a stuffed packet.

    Raises:
        ValueError: the tail, the escape or a byte of the head has no code, or codes are not single bytes that differ.
    """

    tail: bytes
    """The byte that ends a packet."""
    escape: bytes
    """The byte before a code."""
    codes: Mapping[bytes, bytes]
    """The code of each byte that does not occur in the content."""
    head: bytes = b""
    """The byte that begins a packet, if there is one."""

    def __post_init__(self):
        bare = [byte for byte in (self.head, self.tail, self.escape) if byte and byte not in self.codes]
        single = all(len(byte) == 1 for pair in self.codes.items() for byte in pair)
        if bare or not single or len(set(self.codes.values())) < len(self.codes):
            raise ValueError(f"stuffing: give each of head, tail and escape a code of one byte, got {self.codes}")

    @cached_property
    def _plain(self) -> dict[bytes, bytes]:
        return {code: byte for byte, code in self.codes.items()}

    def wrap(self, content: bytes) -> bytes:
        """Return a packet with this content."""
        pattern = b"[" + b"".join(map(re.escape, self.codes)) + b"]"
        stuffed = re.sub(pattern, lambda found: self.escape + self.codes[found[0]], content, flags=re.DOTALL)
        return self.head + stuffed + self.tail

    def unwrap(self, stuffed: bytes) -> bytes | None:
        """Return the content between head and tail; ``None`` if an escape has no code behind it."""
        pieces = stuffed.split(self.escape)
        if any(piece[:1] not in self._plain for piece in pieces[1:]):
            return None
        return pieces[0] + b"".join(self._plain[piece[:1]] + piece[1:] for piece in pieces[1:])


class Stuffed(Lines):
    """A cutter of stuffed packets.

    Args:
        stuffing: the bytes of a packet.
        counters: the device's; counts ``requests``, ``bad_length`` and ``skipped_bytes`` as other cutters, and
            ``broken_frames`` for an escape without a code.
        longest: the largest number of bytes in a content.
    """

    counts_requests = True

    def __init__(self, stuffing: Stuffing, *, counters: Counter[str], longest: int = 4096):
        super().__init__(stuffing.tail, counters=counters, longest=2 * longest + 1)
        self._stuffing = stuffing

    def cut(self, data: bytes, t_ns: int = 0) -> list[bytes]:
        """Return the contents of the packets that these bytes complete; bytes before a head are skipped."""
        contents, head = [], self._stuffing.head
        for piece in super().cut(data):
            start = piece.rfind(head) if head else 0
            self._counters["skipped_bytes"] += len(piece) if start < 0 else start
            content = None if start < 0 else self._stuffing.unwrap(piece[start + len(head) :])
            if start >= 0:
                self._counters["broken_frames" if content is None else "requests"] += 1
            if content is not None:
                contents.append(content)
        return contents
