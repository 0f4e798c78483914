"""The ROBOTIS Dynamixel protocol 2.0: nodes on a line, each with a memory (its control table).

    host    FF FF FD 00 id length instruction parameters crc16     length: bytes after it, low byte first
    node    FF FF FD 00 id length 55 error data          crc16

The CRC covers all bytes before it. FF FF FD between length and CRC gets one more FD, which counts. Id FE: all nodes.

    01 ping             -                          model, firmware; to FE every node answers, one after another
    02 read             address n                  error and n bytes
    03 write            address data               error; none to FE, nor where a node answers ping and read only
    08 reboot           -                          error, then it powers up again
    82 sync read        address n id ...           each listed node, in the order of the list
    8A fast sync read   address n id ...           one packet of FE: for each node error, id, data, crc16 so far
    83 sync write       address n (id data) ...    none
    92 bulk read        (id address n) ...         as sync read
    9A fast bulk read   (id address n) ...         as fast sync read
    93 bulk write       (id address n data) ...    none

Errors: 2 instruction, 3 CRC, 4 range of addresses, 5 length, 6 value, 7 access; bit 7 is an alert. The answer to a fast
read ends before the first missing node, for which the later ones wait. It contains no additional FD.

After dynamixel-sdk 4.1.0 protocol2_packet_handler.py.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Protocol

from firmware_protocols.framing import MORE, SOUND, Broken, Packets
from firmware_protocols.protocols import Answer
from firmware_protocols.registers import Memory, Refused, Why
from firmware_protocols.sums import crc16_umts

__all__ = ["ALL", "DynamixelLine", "Node", "packet"]

HEAD = b"\xff\xff\xfd\x00"
ALL = 0xFE
"""The id of a broadcast."""
STATUS = 0x55
"""The instruction of an answer."""
PING, READ, WRITE, REBOOT, SYNC_WRITE, BULK_WRITE = 0x01, 0x02, 0x03, 0x08, 0x83, 0x93
SYNC_READ, FAST_SYNC_READ, BULK_READ, FAST_BULK_READ = 0x82, 0x8A, 0x92, 0x9A
BAD_INSTRUCTION, BAD_CRC, BAD_LENGTH = 2, 3, 5
ERRORS: dict[Why, int] = {"address": 4, "value": 6, "access": 7, "function": 2}
FAILED = 1
"""The error of a refusal that has no number of its own."""
MAX_LENGTH = 1024
"""The largest length field of a packet that is accepted [bytes]."""


class Node(Memory, Protocol):
    """The attributes of a node that the line uses, besides its memory."""

    @property
    def id(self) -> int:
        """The id, 0..252."""
        ...

    @property
    def ping(self) -> bytes:
        """The model number, low byte first, and the version of the firmware."""
        ...

    @property
    def alert(self) -> int:
        """The alert bit: 0x80 while the node reports a hardware error, else 0."""
        ...

    @property
    def delay_ns(self) -> int:
        """The return delay."""
        ...

    @property
    def level(self) -> int:
        """The requests that it answers: 0 ping, 1 also reads, 2 all."""
        ...

    def reboot(self, t_ns: int) -> None:
        """Power up again."""
        ...


def _size(data: bytes) -> int | str:
    if len(data) < 7:
        return MORE
    length = int.from_bytes(data[5:7], "little")
    return 7 + length if 3 <= length <= MAX_LENGTH else "bad_length"


def _check(packet: bytes) -> str:
    return SOUND if crc16_umts(packet[:-2]) == int.from_bytes(packet[-2:], "little") else "bad_checksum"


class DynamixelLine:
    """The nodes of one device on a line that may have others.

    Args:
        counters: the device's; counts what :class:`~firmware_protocols.framing.Packets` counts (packets to other ids
            included), ``unknown_command`` and ``refused``.
    """

    has_checksum = True

    def __init__(self, *, counters: Counter[str]):
        self._counters = counters
        self._packets = Packets(HEAD, _size, _check, counters=counters, broken=True)

    def reset(self) -> None:
        """Discard the bytes received so far."""
        self._packets.reset()

    def answers(self, data: bytes, t_ns: int, nodes: Sequence[Node]) -> list[Answer]:
        """Return the answers to the requests that these bytes complete; ``turn`` orders those to one broadcast."""
        return [reply for packet in self._packets.cut(data, t_ns) for reply in self._execute(packet, t_ns, nodes)]

    def _execute(self, packet: bytes, t_ns: int, nodes: Sequence[Node]) -> list[Answer]:
        to, here = packet[4], [node for node in nodes if packet[4] in (ALL, node.id)]
        if isinstance(packet, Broken):
            is_answered = packet.why == "bad_checksum" and to != ALL
            return [_status(node, error=BAD_CRC) for node in here if is_answered and node.level == 2]
        instruction, params = packet[7], packet[8:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        if to == ALL and instruction in (SYNC_READ, FAST_SYNC_READ, BULK_READ, FAST_BULK_READ):
            wanted = _parsed_reads(params, instruction in (BULK_READ, FAST_BULK_READ))
            if wanted is None:
                self._counters["unknown_command"] += 1
                return []
            fast = instruction in (FAST_SYNC_READ, FAST_BULK_READ)
            return (self._fast if fast else self._one_by_one)(wanted, t_ns, nodes)
        if to == ALL and instruction in (SYNC_WRITE, BULK_WRITE):
            for ident, address, data in _parsed_writes(params, instruction == BULK_WRITE):
                for node in nodes:
                    if node.id == ident:
                        self._write(node, address, data, t_ns)
            return []
        if to == ALL and instruction == PING:
            return [_status(node, node.ping, turn=node.id) for node in here]
        answers = [answer for node in here if (answer := self._one(node, instruction, params, t_ns)) is not None]
        return answers if to != ALL else []

    def _one(self, node: Node, instruction: int, params: bytes, t_ns: int) -> Answer | None:
        """Execute an instruction on one node and return its answer; a new id is valid from the next request on."""
        ident, level = node.id, node.level
        if instruction == PING:
            return _status(node, node.ping)
        data, error = b"", BAD_LENGTH
        if instruction == REBOOT and not params:
            node.reboot(t_ns)
            error = 0
        elif instruction == READ and len(params) == 4:
            data, error = self._read(node, *struct.unpack("<HH", params), t_ns)
        elif instruction == WRITE and len(params) > 2:
            error = self._write(node, int.from_bytes(params[:2], "little"), params[2:], t_ns)
        elif instruction not in (READ, WRITE, REBOOT):
            self._counters["unknown_command"] += 1
            error = BAD_INSTRUCTION
        answered = level == 2 or (level == 1 and instruction == READ)
        return _status(node, data, error=error, ident=ident) if answered else None

    def _one_by_one(self, wanted: list[tuple[int, int, int]], t_ns: int, nodes: Sequence[Node]) -> list[Answer]:
        answers = []
        for turn, (ident, address, n) in enumerate(wanted):
            for node in nodes:
                if node.id == ident and node.level:
                    data, error = self._read(node, address, n, t_ns)
                    answers.append(_status(node, data, error=error, turn=turn))
        return answers

    def _fast(self, wanted: list[tuple[int, int, int]], t_ns: int, nodes: Sequence[Node]) -> list[Answer]:
        by_id = {node.id: node for node in nodes if node.level}
        length = 1 + sum(n + 4 for _, _, n in wanted)
        frame, delay_ns = HEAD + struct.pack("<BHB", ALL, length, STATUS), None
        for ident, address, n in wanted:
            node = by_id.get(ident)
            if node is None:
                break
            data, error = self._read(node, address, n, t_ns)
            frame += bytes([error | node.alert, ident]) + data.ljust(n, b"\0")
            frame += crc16_umts(frame).to_bytes(2, "little")
            delay_ns = node.delay_ns if delay_ns is None else delay_ns
        return [] if delay_ns is None else [Answer(frame, delay_ns=delay_ns)]

    def _read(self, node: Node, address: int, n: int, t_ns: int) -> tuple[bytes, int]:
        """Return the data and the error of a read."""
        try:
            return node.read(address, n, t_ns), 0
        except Refused as refused:
            self._counters["refused"] += 1
            return b"", ERRORS.get(refused.why, FAILED)

    def _write(self, node: Node, address: int, data: bytes, t_ns: int) -> int:
        """Return the error of a write."""
        try:
            node.write(address, data, t_ns)
        except Refused as refused:
            self._counters["refused"] += 1
            return ERRORS.get(refused.why, FAILED)
        return 0


def _parsed_reads(params: bytes, bulk: bool) -> list[tuple[int, int, int]] | None:
    """Return id, address and number of bytes of each read; ``None`` if the parameters are invalid."""
    if bulk:
        wanted = None if len(params) % 5 or not params else list(struct.iter_unpack("<BHH", params))
    else:
        wanted = None if len(params) < 5 else [(ident, *struct.unpack_from("<HH", params)) for ident in params[4:]]
    return None if wanted is None or sum(n + 4 for _, _, n in wanted) >= 0xFFFF else wanted


def _parsed_writes(params: bytes, bulk: bool) -> Iterator[tuple[int, int, bytes]]:
    """Yield id, address and data of each write, as far as they are complete."""
    at, address, n = (0, 0, 0) if bulk else (4, *struct.unpack("<HH", params[:4].ljust(4, b"\0")))
    while at < len(params):
        if bulk:
            address, n = struct.unpack("<HH", params[at + 1 : at + 5].ljust(4, b"\0"))
        start = at + (5 if bulk else 1)
        if not n or start + n > len(params):
            return
        yield params[at], address, params[start : start + n]
        at = start + n


def _status(node: Node, data: bytes = b"", *, error: int = 0, ident: int | None = None, turn: int = 0) -> Answer:
    body = bytes([error | node.alert]) + data
    return Answer(packet(node.id if ident is None else ident, STATUS, body), delay_ns=node.delay_ns, turn=turn)


def packet(ident: int, instruction: int, params: bytes = b"") -> bytes:
    """Return a packet, either direction: a node has 55 where the host has the instruction, then its error."""
    body = (bytes([instruction]) + params).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    frame = HEAD + struct.pack("<BH", ident, len(body) + 2) + body
    return frame + crc16_umts(frame).to_bytes(2, "little")
