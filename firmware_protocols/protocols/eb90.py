"""Inspire's native serial protocol, on a memory.

    read    EB 90 id 04  11 address n    sum    ->  90 EB id n+3 11 address data sum
    write   EB 90 id n+3 12 address data sum    ->  90 EB id 04  12 address 01   sum

Addresses are two bytes, low byte first; the sum is the low byte of the sum of id to the last data byte. Requests with
another id or a wrong sum, or that the memory refuses, get no answer. A write to the save register is answered twice: at
once, and with the result a second later.

After the vendor's manual PRJ-02-TS-U-001 V1.0.0, chapter 2.4 (in NaCl-1374/inspire_hand_ws@fc75490).
"""

from __future__ import annotations

from collections import Counter

from firmware_protocols.framing import MORE, SOUND, Packets
from firmware_protocols.protocols import Answer
from firmware_protocols.registers import Memory, Refused
from firmware_protocols.sums import sum8

__all__ = ["Eb90", "request"]

REQUEST, REPLY = b"\xeb\x90", b"\x90\xeb"
READ, WRITE = 0x11, 0x12
SAVE_ADDRESS = 1005
"""The address of the save register."""
SAVE_DELAY_NS = 1_000_000_000
"""The time from a save to its result."""
MAX_READ_BYTES = 252
"""The largest number of bytes that one request can read."""


def _size(data: bytes) -> int | str:
    if len(data) < 4:
        return MORE
    return 5 + data[3] if data[3] >= 4 else "bad_length"


def _check(packet: bytes) -> str:
    return SOUND if sum8(packet[2:-1]) == packet[-1] else "bad_checksum"


class Eb90:
    """A serial line with one hand on it.

    Args:
        counters: the device's; counts what :class:`~firmware_protocols.framing.Packets` counts, ``other_unit``,
            ``unknown_command`` and ``refused``.
        gap_ns: a silence of this length discards an incomplete request.
    """

    has_checksum = True

    def __init__(self, *, counters: Counter[str], gap_ns: int = 50_000_000):
        self._counters = counters
        self._packets = Packets(REQUEST, _size, _check, counters=counters, gap_ns=gap_ns)

    def reset(self) -> None:
        """Discard the bytes received so far."""
        self._packets.reset()

    def answers(self, data: bytes, t_ns: int, unit: int, memory: Memory) -> list[Answer]:
        """Return the answers of the hand with the id ``unit`` to the requests that these bytes complete."""
        return [
            reply for packet in self._packets.cut(data, t_ns) for reply in self._execute(packet, t_ns, unit, memory)
        ]

    def _execute(self, packet: bytes, t_ns: int, unit: int, memory: Memory) -> list[Answer]:
        kind, address, data = packet[4], int.from_bytes(packet[5:7], "little"), packet[7:-1]
        if packet[2] != unit:
            self._counters["other_unit"] += 1
            return []
        if kind not in (READ, WRITE) or (kind == READ and (len(data) != 1 or data[0] > MAX_READ_BYTES)):
            self._counters["unknown_command"] += 1
            return []
        try:
            if kind == READ:
                return [Answer(_reply(packet, memory.read(address, data[0], t_ns)))]
            memory.write(address, data, t_ns)
        except Refused:
            self._counters["refused"] += 1
            return []
        answers = [Answer(_reply(packet, b"\x01"))]
        if address <= SAVE_ADDRESS < address + len(data) and data[SAVE_ADDRESS - address]:
            answers.append(Answer(_reply(packet, b"\x00"), delay_ns=SAVE_DELAY_NS))
        return answers


def request(unit: int, kind: int, address: int, data: bytes) -> bytes:
    """Return a request of a host; ``data`` of a read is the number of bytes."""
    return _framed(REQUEST, unit, bytes([kind]) + address.to_bytes(2, "little") + data)


def _reply(request: bytes, data: bytes) -> bytes:
    return _framed(REPLY, request[2], request[4:7] + data)


def _framed(head: bytes, unit: int, body: bytes) -> bytes:
    content = bytes([unit, len(body)]) + body
    return head + content + bytes([sum8(content)])
