"""The protocol of Feetech's SCS and STS servos (also Dynamixel 1) on one half-duplex line, each with a memory.

    host    FF FF id length instruction parameters sum      length: parameters + 2
    servo   FF FF id length status      data       sum      length: data + 2

The sum is the inverted sum of id to the last parameter; id FE means all servos.

    01 ping        -                       every servo answers, one after another
    02 read        address n               status and n bytes; zeros where a read is refused
    03 write       address data            status; none to FE, none where a servo answers only ping and read
    04 reg write   address data            as a write, but executed at the next action
    05 action      -                       as a write
    82 sync read   address n id ...        each listed servo, in the order of the list
    83 sync write  address n (id data) ... none

After lerobot 0.4.4 motors/feetech, feetech-servo-sdk 1.0.0 protocol_packet_handler.py, and the vendor's memory table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from firmware_protocols.framing import MORE, NO_PACKET, SOUND, Packets
from firmware_protocols.protocols import Answer
from firmware_protocols.registers import Memory, Refused
from firmware_protocols.sums import inv8

__all__ = ["ALL", "Servo", "ServoLine", "packet"]

HEAD = b"\xff\xff"
ALL = 0xFE
"""The id of a broadcast."""
PING, READ, WRITE, REG_WRITE, ACTION, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x04, 0x05, 0x82, 0x83
MAX_DATA_BYTES = 250
"""The largest number of data bytes in a packet."""


class Servo(Memory, Protocol):
    """The attributes of a servo that the line uses, besides its memory."""

    @property
    def id(self) -> int:
        """The id, 0..253."""
        ...

    @property
    def status(self) -> int:
        """The error bits in every answer."""
        ...

    @property
    def delay_ns(self) -> int:
        """The return delay."""
        ...

    @property
    def confirms(self) -> bool:
        """True if it answers writes, too, not only ping and read."""
        ...


def _size(data: bytes) -> int | str:
    if len(data) < 4:
        return MORE
    return 4 + data[3] if data[2] <= ALL and 2 <= data[3] <= MAX_DATA_BYTES + 2 else NO_PACKET


def _check(packet: bytes) -> str:
    return SOUND if inv8(packet[2:-1]) == packet[-1] else "bad_checksum"


class ServoLine:
    """The servos of one device on a line that may have others.

    Args:
        counters: the device's; counts what :class:`~firmware_protocols.framing.Packets` counts (packets to other ids
            included), ``unknown_command`` and ``refused``.
    """

    has_checksum = True

    def __init__(self, *, counters: Counter[str]):
        self.pending: dict[int, tuple[int, bytes]] = {}
        """The address and data of reg writes that wait for an action, by id."""
        self._counters = counters
        self._packets = Packets(HEAD, _size, _check, counters=counters)

    def reset(self) -> None:
        """Discard the bytes received so far."""
        self._packets.reset()

    def answers(self, data: bytes, t_ns: int, servos: Sequence[Servo]) -> list[Answer]:
        """Return the answers to the requests that these bytes complete; ``turn`` orders those to one broadcast."""
        return [reply for packet in self._packets.cut(data, t_ns) for reply in self._execute(packet, t_ns, servos)]

    def _execute(self, packet: bytes, t_ns: int, servos: Sequence[Servo]) -> list[Answer]:
        to, instruction, params = packet[2], packet[4], packet[5:-1]
        if to == ALL and instruction == SYNC_READ:
            return self._sync_read(params, t_ns, servos)
        if to == ALL and instruction == SYNC_WRITE:
            self._sync_write(params, t_ns, servos)
            return []
        here = [servo for servo in servos if to in (ALL, servo.id)]
        if to == ALL and instruction == PING:
            return [_status(servo, turn=servo.id) for servo in here]
        answers = [answer for servo in here if (answer := self._one(servo, instruction, params, t_ns)) is not None]
        return answers if to != ALL else []

    def _one(self, servo: Servo, instruction: int, params: bytes, t_ns: int) -> Answer | None:
        """Execute an instruction on one servo and return its answer; a new id is valid from the next request on."""
        ident = servo.id
        if instruction == PING:
            return _status(servo)
        if instruction == READ and len(params) == 2 and params[1] <= MAX_DATA_BYTES:
            return _status(servo, _read(servo, params[0], params[1], t_ns))
        if instruction == WRITE and len(params) >= 2:
            self._write(servo, params[0], params[1:], t_ns)
        elif instruction == REG_WRITE and len(params) >= 2:
            self.pending[ident] = params[0], params[1:]
        elif instruction == ACTION:
            if ident in self.pending:
                self._write(servo, *self.pending.pop(ident), t_ns)
        else:
            self._counters["unknown_command"] += 1
            return None
        return _status(servo, ident=ident) if servo.confirms else None

    def _sync_read(self, params: bytes, t_ns: int, servos: Sequence[Servo]) -> list[Answer]:
        if len(params) < 2 or params[1] > MAX_DATA_BYTES:
            self._counters["unknown_command"] += 1
            return []
        address, n, *ids = params
        return [
            _status(servo, _read(servo, address, n, t_ns), turn=turn)
            for turn, ident in enumerate(ids)
            for servo in servos
            if servo.id == ident
        ]

    def _sync_write(self, params: bytes, t_ns: int, servos: Sequence[Servo]) -> None:
        width = params[1] + 1 if len(params) >= 2 else 0
        if not width or (len(params) - 2) % width:
            self._counters["unknown_command"] += 1
            return
        blocks = [params[at : at + width] for at in range(2, len(params), width)]
        for ident, *data in blocks:
            for servo in servos:
                if servo.id == ident:
                    self._write(servo, params[0], bytes(data), t_ns)

    def _write(self, servo: Servo, address: int, data: bytes, t_ns: int) -> None:
        try:
            servo.write(address, data, t_ns)
        except Refused:
            self._counters["refused"] += 1


def _read(servo: Servo, address: int, n: int, t_ns: int) -> bytes:
    try:
        return servo.read(address, n, t_ns)
    except Refused:
        return bytes(n)


def _status(servo: Servo, data: bytes = b"", *, ident: int | None = None, turn: int = 0) -> Answer:
    frame = packet(servo.id if ident is None else ident, servo.status, data)
    return Answer(frame, delay_ns=servo.delay_ns, turn=turn)


def packet(ident: int, instruction: int, params: bytes = b"") -> bytes:
    """Return a packet, either direction: a servo has its status where the host has the instruction."""
    body = bytes([ident, len(params) + 2, instruction]) + params
    return HEAD + body + bytes([inv8(body)])
