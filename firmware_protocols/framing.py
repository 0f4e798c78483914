"""Cutters, which extract packets from a stream of bytes in chunks of any size.

Packets that begin with a head and state their length::

    self.packets = Packets(b"\\x55\\xaa", _size, _check, counters=self.counters)     # in the device's __init__
    for packet in self.packets.cut(data, t_ns): ...                                 # in its receive

Packets that end with a byte: :class:`Ppp` and :class:`Cobs` (escaped content), :class:`Lines` (text).

All are plain data, so that a device can be saved: the functions must be functions of a module, which have a name.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable

MORE = 0
"""The result of ``size`` while there are too few bytes to know the size."""
NO_PACKET = "skipped_bytes"
"""The result of ``size`` where no packet begins; also the counter of such bytes."""
SOUND = ""
"""The result of ``check`` for a packet without fault."""

Size = Callable[[bytes], "int | str"]
Check = Callable[[bytes], str]


class Broken(bytes):
    """A broken packet; ``why`` is the counter that it was counted in. Only some firmwares answer one."""

    why: str

    def __new__(cls, data: bytes, why: str = "") -> Broken:
        """Return bytes with a reason."""
        broken = super().__new__(cls, data)
        broken.why = why
        return broken


def sound(packet: bytes) -> str:
    """Return :data:`SOUND`: the check of packets without a checksum."""
    return SOUND


class Packets:
    """A cutter of packets of one protocol, which finds the next packet after garbage.

    It drops and counts bytes that belong to no packet, up to the first at which the next head can begin.

    Args:
        head: the bytes that every packet begins with; may be empty.
        size: ``size(data)`` returns the length of the packet that begins ``data``, :data:`MORE` while that cannot be
            known, :data:`NO_PACKET` where none begins, or the name of a counter for what is wrong (``"bad_length"``).
        check: ``check(packet)`` returns :data:`SOUND`, or the name of a counter (``"bad_checksum"``, ``"bad_tail"``).
        counters: the device's; also counts ``requests`` (sound packets), ``skipped_bytes`` and ``broken_frames``.
        gap_ns: a longer silence discards an incomplete packet. 0: never.
        broken: return packets that ``size`` or ``check`` refused, too, as :class:`Broken`. One that ``size`` refused
            begins with the bytes that it was given, and may have more.
        longest: the largest number of bytes in a packet.

    Raises:
        TypeError: ``size`` or ``check`` is a lambda, a method or a function inside a function, which a saved device
            could not name.
    """

    def __init__(
        self,
        head: bytes,
        size: Size,
        check: Check = sound,
        *,
        counters: Counter[str],
        gap_ns: int = 0,
        broken: bool = False,
        longest: int = 4096,
    ):
        for function in (size, check):
            _require_name(function)
        self._head, self._size, self._check, self._counters = head, size, check, counters
        self._gap_ns, self._broken, self._longest = gap_ns, broken, longest
        # The next head can begin so many bytes later at the earliest: FF FF may overlap itself, 55 AA cannot.
        self._step = next(n for n in range(1, len(head) + 2) if head.startswith(head[n:]))
        self._buffer = b""
        self._received_ns = 0

    def reset(self) -> None:
        """Discard the bytes received so far, for a new connection."""
        self._buffer = b""

    def cut(self, data: bytes, t_ns: int = 0) -> list[bytes]:
        """Return the packets that these bytes complete, in order."""
        if self._gap_ns and self._buffer and t_ns - self._received_ns > self._gap_ns:
            self._counters["broken_frames"] += 1
            self._buffer = b""
        self._received_ns = t_ns
        buffer, at, packets = self._buffer + data, 0, []
        while at < len(buffer):
            start = self._find(buffer, at)
            if start > at:
                self._counters[NO_PACKET] += start - at
            at = start
            found = self._take(buffer[at : at + self._longest])
            if found is None:
                break
            if isinstance(found, Broken):
                self._counters[found.why] += self._step if found.why == NO_PACKET else 1
                at += self._step
                if self._broken and found.why != NO_PACKET:
                    packets.append(found)
            else:
                self._counters["requests"] += 1
                at += len(found)
                packets.append(found)
        self._buffer = buffer[at:]
        return packets

    def _find(self, buffer: bytes, at: int) -> int:
        """Return the index of the next head, or of its first bytes at the end of ``buffer``."""
        head = self._head
        if (start := buffer.find(head, at)) >= 0:
            return start
        tails = range(max(at, len(buffer) - len(head) + 1), len(buffer))
        return next((start for start in tails if head.startswith(buffer[start:])), len(buffer))

    def _take(self, data: bytes) -> bytes | None:
        """Return the packet that begins ``data``, :class:`Broken` if there is none, ``None`` until it is complete."""
        if len(data) < len(self._head):
            return None
        size = self._size(data)
        if isinstance(size, str):
            return Broken(data, size)
        if size > self._longest or (size == MORE and len(data) >= self._longest):
            return Broken(data, "bad_length")
        if size == MORE or len(data) < size:
            return None
        fault = self._check(data[:size])
        return Broken(data[:size], fault) if fault else data[:size]


def _require_name(function: Callable) -> None:
    if "<" in getattr(function, "__qualname__", "<") or hasattr(function, "__self__"):
        raise TypeError(
            f"expected a function of a module (a saved device names it), got {function!r}: "
            "write it as `def` outside of classes and functions"
        )


class Lines:
    """A cutter of pieces that end with one byte, such as lines of text. It drops empty ones.

    Args:
        ends: each of these bytes ends a line, so CR, LF and CR LF all do.
        counters: the device's; counts ``bad_length`` for each piece above ``longest`` bytes, which is dropped.
        longest: the largest number of bytes in a piece as it is sent.
    """

    def __init__(self, ends: bytes = b"\r\n", *, counters: Counter[str], longest: int = 256):
        self._ends, self._counters, self._longest = ends, counters, longest
        self._buffer = b""

    def reset(self) -> None:
        """Discard the bytes received so far, for a new connection."""
        self._buffer = b""

    def cut(self, data: bytes) -> list[bytes]:
        """Return the lines that these bytes complete, without their ends."""
        *complete, partial = re.split(b"[" + re.escape(self._ends) + b"]", self._buffer + data)
        # One byte beyond the longest is kept, so that the end of a line that is too long is not taken for another.
        self._buffer = partial[: self._longest + 1]
        lines = [line for line in complete if line]
        fitting = [line for line in lines if len(line) <= self._longest]
        if len(fitting) < len(lines):
            self._counters["bad_length"] += len(lines) - len(fitting)
        return fitting

    @property
    def has_partial(self) -> bool:
        """True while a piece has begun that has not ended."""
        return bool(self._buffer)

    def end(self) -> list[bytes]:
        """End the piece that has begun, after a silence, and return it."""
        return self.cut(self._ends[:1])


class Ppp(Lines):
    """A cutter of frames between flags 7E, with 7D before an escaped byte, as in HDLC-like framing (RFC 1662)."""

    def __init__(self, *, counters: Counter[str], longest: int = 256):
        super().__init__(b"\x7e", counters=counters, longest=2 * longest)

    def cut(self, data: bytes) -> list[bytes]:
        """Return the contents of the frames that these bytes complete, unescaped."""
        return [re.sub(b"\x7d+(.?)", _unescaped, frame, flags=re.DOTALL) for frame in super().cut(data)]


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

    def cut(self, data: bytes) -> list[bytes]:
        """Return the contents of the frames that these bytes complete; an invalid one counts as ``broken_frames``."""
        contents = []
        for frame in super().cut(data):
            if (content := _decoded_cobs(frame)) is None:
                self._counters["broken_frames"] += 1
            else:
                contents.append(content)
        return contents


def _decoded_cobs(frame: bytes) -> bytes | None:
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
