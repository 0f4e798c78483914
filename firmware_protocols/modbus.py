"""A Modbus server without I/O, on pymodbus's PDUs, CRC and MBAP framing: bytes in, answers out.

RTU: a frame ends where its function code and byte count say; its CRC must fit. A silence of 3.5 characters (1.75 ms
above 19200 baud, by the specification) forgets a frame that is not whole. Requests to other units and bad frames are
met with silence; unit 0 is a broadcast, obeyed but not answered.

TCP: MBAP header with the length; a header that cannot be one makes the server forget what it has.

Functions 03, 06 and 16; any other is answered with exception 1. The device says what its registers hold::

    server = ModbusServer(read=self._read, write=self._write, counters=self.counters)
    answers = server.receive(data, t_ns)
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from typing import Literal

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

Framing = Literal["rtu", "tcp"]
RTU_GAP_NS = 1_750_000
LONGEST_RTU_FRAME = 256
MBAP = struct.Struct(">HHHB")
BROADCAST = 0

READ, WRITE_ONE, WRITE_MANY = 3, 6, 16


class Refused(Exception):
    """Raised by a device's ``read`` or ``write``: the exception code to answer with."""

    def __init__(self, code: ExcCodes):
        self.code = code
        super().__init__(code.name)


ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = (
    ExcCodes.ILLEGAL_FUNCTION,
    ExcCodes.ILLEGAL_ADDRESS,
    ExcCodes.ILLEGAL_VALUE,
)


class ModbusServer:
    """One unit.

    Args:
        read: ``read(address, count)`` returns ``count`` registers (0..65535) or raises :class:`Refused`.
        write: ``write(address, registers)`` stores them or raises :class:`Refused`.
        counters: the device's; gets ``requests``, ``refused``, ``bad_checksum``, ``broken_frames``, ``other_unit``.
        unit: the address that it answers to.
    """

    def __init__(
        self,
        *,
        read: Callable[[int, int], list[int]],
        write: Callable[[int, list[int]], None],
        counters: Counter[str],
        unit: int = 1,
    ):
        self.unit = unit
        self.framing: Framing = "rtu"
        self._read, self._write, self._counters = read, write, counters
        self._decoder = DecodePDU(is_server=True)
        self._framers = {"rtu": FramerRTU(self._decoder), "tcp": FramerSocket(self._decoder)}
        self._buffer = bytearray()
        self._heard_ns = 0

    def reset(self) -> None:
        """Forget what has come in: power-up, or a new connection."""
        self._buffer.clear()

    def request(self, pdu: bytes, *, unit: int | None = None, transaction: int = 1) -> bytes:
        """``pdu`` (function code and data) framed as a client sends it."""
        return self._framers[self.framing].encode(pdu, self.unit if unit is None else unit, transaction)

    def receive(self, data: bytes, t_ns: int) -> list[bytes]:
        """Bytes in chunks of any size; answers to every whole request in them."""
        if self.framing == "rtu" and self._buffer and t_ns - self._heard_ns > RTU_GAP_NS:
            self._forget("broken_frames")
        self._heard_ns = t_ns
        self._buffer += data
        take = self._take_rtu if self.framing == "rtu" else self._take_tcp
        answers: list[bytes] = []
        while (frame := take()) is not None:
            answers += self._answer(*frame)
        return answers

    # -- framing: unit, transaction, PDU; or None until more bytes come --------------------------------------------

    def _take_rtu(self) -> tuple[int, int, bytes] | None:
        size = self._rtu_size()
        if size > LONGEST_RTU_FRAME or len(self._buffer) > LONGEST_RTU_FRAME:
            self._forget("broken_frames")
        if not 4 <= size <= len(self._buffer):
            return None
        frame = bytes(self._buffer[:size])
        if not _crc_fits(frame):
            self._forget("bad_checksum")
            return None
        del self._buffer[:size]
        return frame[0], 0, frame[1:-2]

    def _rtu_size(self) -> int:
        """Bytes of the frame that has begun, 0 while they cannot be known."""
        data = bytes(self._buffer)
        if len(data) < 4:
            return 0
        try:
            if data[1] < 0x80 and (kind := self._decoder.lookupPduClass(data)):
                return kind.calculateRtuFrameSize(data)
        except (IndexError, KeyError, struct.error, ModbusException):
            pass
        # A function whose length nobody knows: the CRC tells where it ends.
        return len(data) if _crc_fits(data) else 0

    def _take_tcp(self) -> tuple[int, int, bytes] | None:
        if len(self._buffer) < MBAP.size:
            return None
        _, protocol, length, _ = MBAP.unpack_from(self._buffer)
        if protocol != 0 or not 2 <= length <= 254:
            self._forget("broken_frames")
            return None
        size = MBAP.size - 1 + length
        if len(self._buffer) < size:
            return None
        frame = bytes(self._buffer[:size])
        del self._buffer[:size]
        return frame[6], int.from_bytes(frame[:2], "big"), frame[7:]

    def _forget(self, why: str) -> None:
        self._counters[why] += 1
        self._buffer.clear()

    # -- requests --------------------------------------------------------------------------------------------------

    def _answer(self, unit: int, transaction: int, pdu: bytes) -> list[bytes]:
        broadcast = unit == BROADCAST and self.framing == "rtu"
        if unit != self.unit and not broadcast:
            self._counters["other_unit"] += 1
            return []
        if pdu[0] >= 0x80:  # an exception is an answer, not a request
            self._counters["broken_frames"] += 1
            return []
        self._counters["requests"] += 1
        try:
            answer = self._execute(pdu)
        except Refused as refused:
            self._counters["refused"] += 1
            answer = ExceptionResponse(pdu[0], refused.code)
        answer.dev_id, answer.transaction_id = unit, transaction
        return [] if broadcast else [self._framers[self.framing].buildFrame(answer)]

    def _execute(self, pdu: bytes) -> ModbusPDU:
        if pdu[0] not in (READ, WRITE_ONE, WRITE_MANY):
            raise Refused(ILLEGAL_FUNCTION)
        if not _is_whole(pdu):
            raise Refused(ILLEGAL_VALUE)
        match self._decoder.decode(pdu):
            case ReadHoldingRegistersRequest(address=address, count=count):
                if not 1 <= count <= 125:
                    raise Refused(ILLEGAL_VALUE)
                return ReadHoldingRegistersResponse(registers=self._read(address, count))
            case WriteSingleRegisterRequest(address=address, registers=registers):
                self._write(address, registers)
                return WriteSingleRegisterResponse(address=address, registers=registers)
            case WriteMultipleRegistersRequest(address=address, count=count, registers=registers):
                if not 1 <= count <= 123:
                    raise Refused(ILLEGAL_VALUE)
                self._write(address, registers)
                return WriteMultipleRegistersResponse(address=address, count=count)
        raise Refused(ILLEGAL_FUNCTION)


def _is_whole(pdu: bytes) -> bool:
    """Whether a PDU of functions 3, 6 or 16 has the length that it states."""
    if pdu[0] != WRITE_MANY:
        return len(pdu) == 5
    return len(pdu) >= 6 and len(pdu) == 6 + pdu[5] and pdu[5] == 2 * int.from_bytes(pdu[3:5], "big")


def _crc_fits(frame: bytes) -> bool:
    return FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big"))
