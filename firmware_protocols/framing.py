"""Cutters, which extract packets from a stream of bytes in chunks of any size.

Packets of a frame table, which states head, length and sum; or with functions for what no table can state::

    self.packets = Packets(REQUEST, counters=self.counters)                         # in the device's __init__
    self.packets = Packets(b"\\x55\\xaa", _size, _check, counters=self.counters)
    for packet in self.packets.cut(data, t_ns): ...                                 # in its receive

Packets that end with a byte, some of them stuffed: :mod:`firmware_protocols.stuffing`.

All are plain data, so that a device can be saved: the functions must be functions of a module, which have a name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from firmware_protocols.tables import Frame

MORE = 0
"""The result of ``size`` while there are too few bytes to know the size."""
NO_PACKET = "skipped_bytes"
"""The result of ``size`` where no packet begins; also the counter of such bytes."""
SOUND = ""
"""The result of ``check`` for a packet without fault."""

Size = Callable[[bytes], "int | str"]
Check = Callable[[bytes], str]


class Stage(bytes):
    """The bytes that :meth:`Packets.expect` asked for: a later stage of the request before them."""


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


class Cutter:
    """The table of the requests that a cutter cuts, if they have one, and the field that tells them apart."""

    table: Frame | None = None
    """The table of a request."""
    by: str = ""
    """The field by which the device tells requests apart, or several, as ``"main sub"``; empty: the whole request."""
    misfit: str = ""
    """The counter of requests that do not fit the table; empty: the device refuses them as unknown."""
    unknown: str = "unknown_command"
    """The counter of requests that no method answers."""
    others: str = "other_address"
    """The counter of requests that the device does not accept, as they are for others."""
    counts_requests: bool = False
    """True if it counts ``requests``; else those are counted that a method answers."""

    def requests(self, data: Any, t_ns: int = 0) -> Iterable[tuple[Any, dict[str, Any] | None]]:
        """Yield the requests that these data complete, each with its fields; ``None``: they are not read yet."""
        return [(packet, None) for packet in self.cut(data, t_ns)]

    def cut(self, data: Any, t_ns: int = 0) -> list[Any]:
        """Return the requests that these data complete, in order."""
        raise NotImplementedError

    def content(self, frame: Any) -> Any:
        """Return the request in a frame of the driver, as it is cut."""
        return frame

    def fields(self, content: Any) -> dict[str, Any] | None:
        """Return a request by field, ``None`` if it does not fit the table."""
        return self.table.unpack(content) if self.table else None

    def key(self, fields: Mapping[str, Any]) -> Any:
        """Return the value of the field that tells requests apart, or the values of several."""
        values = tuple(map(fields.get, self.by.split()))
        return values[0] if len(values) == 1 else values

    def data(self, fields: Mapping[str, Any]) -> bytes | None:
        """Return the data of a request: its field of open length; ``None`` for a remote frame on CAN."""
        return fields.get(self.table.open_field or "", b"") if self.table else b""


class Packets(Cutter):
    """A cutter of packets of one protocol, which finds the next packet after garbage.

    It drops and counts bytes that belong to no packet, up to the first at which the next head can begin.

    Args:
        head: the table of a packet, which states its head, its length and its sums; or the bytes that every packet
            begins with, which may be none, and then ``size``, and ``check`` if there is anything to check.
        size: ``size(data)`` returns the length of the packet that begins ``data``, :data:`MORE` while that cannot be
            known, :data:`NO_PACKET` where none begins, or the name of a counter for what is wrong (``"bad_length"``).
        check: ``check(packet)`` returns :data:`SOUND`, or the name of a counter (``"bad_checksum"``, ``"bad_tail"``).
        counters: the device's; also counts ``requests`` (sound packets), ``skipped_bytes`` and ``broken_frames``.
        by: the field of the table by which the device tells requests apart, or several
            (:mod:`firmware_protocols.requests`).
        max_data: the largest length of the table's field of open length; longer ones count as ``bad_length``.
        gap_ns: a longer silence discards an incomplete packet. 0: never.
        broken: return packets that ``size`` or ``check`` refused, too, as :class:`Broken`. One that ``size`` refused
            begins with the bytes that it was given, and may have more.
        longest: the largest number of bytes in a packet.

    Raises:
        TypeError: ``size`` or ``check`` is a lambda, a method or a function inside a function, which a saved device
            could not name; or neither a table nor ``size`` is given.
    """

    counts_requests = True

    def __init__(
        self,
        head: bytes | Frame,
        size: Size | None = None,
        check: Check = sound,
        *,
        counters: Counter[str],
        by: str = "",
        max_data: int | None = None,
        gap_ns: int = 0,
        broken: bool = False,
        longest: int = 4096,
    ):
        self.table = head if isinstance(head, Frame) else None
        """The table of a packet, if it was given."""
        self.by = by
        if self.table is None and size is None:
            raise TypeError("Packets: give the table of a packet, or its head and `size`")
        for function in filter(None, (size, check)):
            _require_name(function)
        head = head.head if isinstance(head, Frame) else head
        self._head, self._size, self._check, self._counters, self._max_data = head, size, check, counters, max_data
        self._gap_ns, self._broken, self._longest = gap_ns, broken, longest
        # The next head can begin so many bytes later at the earliest: FF FF may overlap itself, 55 AA cannot.
        self._step = next(n for n in range(1, len(head) + 2) if head.startswith(head[n:]))
        self._buffer = b""
        self._stage = 0
        """The number of bytes of the next stage that the device expects."""
        self._received_ns = 0

    def reset(self) -> None:
        """Discard the bytes received so far, for a new connection."""
        self._buffer, self._stage = b"", 0

    def expect(self, size: int) -> None:
        """Return the next ``size`` bytes as they come, as one :class:`Stage`: a request that is sent in stages."""
        self._stage = size

    def cut(self, data: bytes, t_ns: int = 0) -> list[bytes]:
        """Return the packets that these bytes complete, in order."""
        return [packet for packet, _ in self.requests(data, t_ns)]

    def requests(self, data: bytes, t_ns: int = 0) -> Iterator[tuple[bytes, dict[str, Any] | None]]:
        """Yield the packets that these bytes complete, one by one, as a request may decide what follows.

        Each comes with its fields where the table has checked it, else with ``None``.
        """
        if self._gap_ns and (self._buffer or self._stage) and t_ns - self._received_ns > self._gap_ns:
            self._counters["broken_frames"] += 1
            self.reset()
        self._received_ns = t_ns
        self._buffer += data
        while self._buffer and (found := self._next()) is not None:
            yield found

    def _next(self) -> tuple[bytes, dict[str, Any] | None] | None:
        """Return the next packet with its fields, ``None`` until it is complete."""
        if self._stage:
            if len(self._buffer) < self._stage:
                return None
            stage, self._buffer, self._stage = self._buffer[: self._stage], self._buffer[self._stage :], 0
            return Stage(stage), None
        buffer, at, found = self._buffer, 0, None
        while found is None and at < len(buffer):
            start = self._find(buffer, at)
            if start > at:
                self._counters[NO_PACKET] += start - at
            at = start
            if (found := self._read(buffer[at : at + self._longest])) is None:
                break
            packet, _ = found
            if isinstance(packet, Broken):
                self._counters[packet.why] += self._step if packet.why == NO_PACKET else 1
                at += self._step
                found = found if self._broken and packet.why != NO_PACKET else None
            else:
                self._counters["requests"] += 1
                at += len(packet)
        self._buffer = buffer[at:]
        return found

    def _find(self, buffer: bytes, at: int) -> int:
        """Return the index of the next head, or of its first bytes at the end of ``buffer``."""
        head = self._head
        if (start := buffer.find(head, at)) >= 0:
            return start
        tails = range(max(at, len(buffer) - len(head) + 1), len(buffer))
        return next((start for start in tails if head.startswith(buffer[start:])), len(buffer))

    def _read(self, data: bytes) -> tuple[bytes, dict[str, Any] | None] | None:
        """Return the packet that begins ``data`` with its fields, ``None`` until it is complete.

        It is :class:`Broken` where there is none.
        """
        if len(data) < len(self._head):
            return None
        size = self._size(data) if self._size is not None else self.table.length_of(data, self._max_data)  # type: ignore[union-attr]
        if isinstance(size, str):
            return Broken(data, size), None
        if size > self._longest or (size == MORE and len(data) >= self._longest):
            return Broken(data, "bad_length"), None
        if size == MORE or len(data) < size:
            return None
        packet, fields = data[:size], None
        if self.table is not None and self._check is sound:
            fields, fault = self.table.read(packet)
        else:
            fault = self._check(packet)
        return (Broken(packet, fault) if fault else packet), fields


def _require_name(function: Callable) -> None:
    if "<" in getattr(function, "__qualname__", "<") or hasattr(function, "__self__"):
        raise TypeError(
            f"expected a function of a module (a saved device names it), got {function!r}: "
            "write it as `def` outside of classes and functions"
        )
