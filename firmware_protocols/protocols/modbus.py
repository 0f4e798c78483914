"""Modbus on memories: functions 1 to 6, 15, 16, 22, 23 and exceptions, over RTU and TCP.

    self.rtu = Rtu(counters=self.counters)                                   # in __init__
    self.rtu.answers(data, t_ns, {self.unit: Banks(holding=self)})           # in receive: frames
    self.mbap[client].answers(data, t_ns, Banks(holding=self))               # TCP, whatever the unit

After the Modbus application protocol specification V1.1b3, over serial line V1.02, messaging on TCP/IP V1.0b.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass

from firmware_protocols.registers import Memory, Refused, Why
from firmware_protocols.sums import crc16_modbus

__all__ = ["BROADCAST", "EXCEPTIONS", "Banks", "Mbap", "Rtu", "answer", "mbap", "rtu", "silence_ns"]

BROADCAST = 0
"""The unit of a broadcast."""
MAX_RTU_FRAME_BYTES = 256
"""The largest RTU frame of the specification, unit and CRC included."""
MAX_PDU_BYTES = 253
"""The largest PDU (function and data) of the specification."""
EXCEPTIONS: dict[Why, int] = {"function": 1, "address": 2, "access": 2, "value": 3, "failure": 4, "busy": 6}
MBAP = struct.Struct(">HHHB")


@dataclass(frozen=True, kw_only=True)
class Banks:
    """The four tables of a unit, each a memory or missing (its functions are then unknown), for one call.

    A register is two bytes. Coils and discrete inputs are memories with one byte, 0 or 1, per address.
    """

    holding: Memory | None = None
    """The holding registers, for functions 3, 6, 16, 22, 23."""
    inputs: Memory | None = None
    """The input registers, for function 4."""
    coils: Memory | None = None
    """The coils, for functions 1, 5, 15."""
    discretes: Memory | None = None
    """The discrete inputs, for function 2."""
    step: int = 2
    """The bytes of memory per Modbus address: 1 where a firmware counts its addresses in bytes."""
    low_first: bool = False
    """True if the memory stores numbers low byte first. On the wire the high byte is first."""
    functions: Container[int] | None = None
    """The functions that the firmware supports; default: all of its tables."""
    own: Callable[[bytes], bytes | None] | None = None
    """The firmware's own functions: returns the answer to a PDU, ``None`` for any other. May raise :class:`Refused`."""


def silence_ns(baud: int) -> int:
    """Return the silence that ends an RTU frame: 3.5 characters, 1.75 ms above 19200 baud."""
    return 1_750_000 if baud > 19200 else round(3.5 * 11e9 / baud)


def rtu(unit: int, pdu: bytes) -> bytes:
    """Return the frame of ``pdu`` (function and data) on a serial line."""
    frame = bytes([unit]) + pdu
    return frame + crc16_modbus(frame).to_bytes(2, "little")


def mbap(unit: int, pdu: bytes, *, transaction: int = 1) -> bytes:
    """Return the message of ``pdu`` (function and data) over TCP."""
    return MBAP.pack(transaction, 0, len(pdu) + 1, unit) + pdu


# -- functions -------------------------------------------------------------------------------------------------------


def answer(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    """Return the PDU that answers a request; an exception if its form is invalid or the memory refuses it."""
    try:
        if banks.own is not None and (reply := banks.own(pdu)) is not None:
            return reply
        act, has_valid_length = _FUNCTIONS.get(pdu[0], (None, None))
        if act is None or has_valid_length is None or not (banks.functions is None or pdu[0] in banks.functions):
            raise Refused("function")
        if not has_valid_length(pdu):
            raise Refused("value")
        return act(pdu, banks, t_ns)
    except Refused as refused:
        return bytes([pdu[0] | 0x80, EXCEPTIONS[refused.why]])


def _read_bits(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    address, count = struct.unpack(">HH", pdu[1:])
    _check_range(address, count, 2000)
    memory = _existing(banks.coils if pdu[0] == 1 else banks.discretes)
    bits = memory.read(address, count, t_ns)
    data = sum((bit != 0) << k for k, bit in enumerate(bits)).to_bytes((count + 7) // 8, "little")
    return bytes([pdu[0], len(data)]) + data


def _read_registers(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    memory = _existing(banks.holding if pdu[0] == 3 else banks.inputs)
    data = _words(memory, banks, *struct.unpack(">HH", pdu[1:]), t_ns)
    return bytes([pdu[0], len(data)]) + data


def _write_coil(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    address, value = struct.unpack(">HH", pdu[1:])
    if value not in (0, 0xFF00):
        raise Refused("value")
    _existing(banks.coils).write(address, bytes([value >> 15]), t_ns)
    return pdu


def _write_register(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    _write_words(banks, int.from_bytes(pdu[1:3], "big"), pdu[3:], t_ns)
    return pdu


def _write_coils(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    address, count = struct.unpack(">HH", pdu[1:5])
    _check_range(address, count, 1968)
    bits = int.from_bytes(pdu[6:], "little")
    _existing(banks.coils).write(address, bytes(bits >> k & 1 for k in range(count)), t_ns)
    return pdu[:5]


def _write_registers(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    address, count = struct.unpack(">HH", pdu[1:5])
    _check_range(address, count, 123)
    _write_words(banks, address, pdu[6:], t_ns)
    return pdu[:5]


def _mask_write(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    address, keep, put = struct.unpack(">HHH", pdu[1:])
    before = int.from_bytes(_words(_existing(banks.holding), banks, address, 1, t_ns), "big")
    _write_words(banks, address, (before & keep | put & ~keep).to_bytes(2, "big"), t_ns)
    return pdu


def _read_and_write(pdu: bytes, banks: Banks, t_ns: int) -> bytes:
    """Write, then read, and return the answer with the data read."""
    address, count, written, n = struct.unpack(">HHHH", pdu[1:9])
    _check_range(address, count, 125)
    _check_range(written, n, 121)
    _write_words(banks, written, pdu[10:], t_ns)
    data = _words(_existing(banks.holding), banks, address, count, t_ns)
    return bytes([pdu[0], len(data)]) + data


def _existing(memory: Memory | None) -> Memory:
    if memory is None:
        raise Refused("function")
    return memory


def _check_range(address: int, count: int, max_count: int) -> None:
    if not 1 <= count <= max_count:
        raise Refused("value")
    if address + count > 1 << 16:
        raise Refused("address")


def _words(memory: Memory, banks: Banks, address: int, count: int, t_ns: int) -> bytes:
    _check_range(address, count, 125)
    data = memory.read(banks.step * address, 2 * count, t_ns)
    return _swapped(data) if banks.low_first else data


def _write_words(banks: Banks, address: int, data: bytes, t_ns: int) -> None:
    _existing(banks.holding).write(banks.step * address, _swapped(data) if banks.low_first else data, t_ns)


def _swapped(data: bytes) -> bytes:
    swapped = bytearray(len(data))
    swapped[0::2], swapped[1::2] = data[1::2], data[0::2]
    return bytes(swapped)


def _is_5_bytes(pdu: bytes) -> bool:
    return len(pdu) == 5


def _is_7_bytes(pdu: bytes) -> bool:
    return len(pdu) == 7


def _has_its_bits(pdu: bytes) -> bool:
    return len(pdu) >= 6 and len(pdu) == 6 + pdu[5] and pdu[5] == (int.from_bytes(pdu[3:5], "big") + 7) // 8


def _has_its_registers(pdu: bytes) -> bool:
    return len(pdu) >= 6 and len(pdu) == 6 + pdu[5] and pdu[5] == 2 * int.from_bytes(pdu[3:5], "big")


def _has_its_written_registers(pdu: bytes) -> bool:
    return len(pdu) >= 10 and len(pdu) == 10 + pdu[9] and pdu[9] == 2 * int.from_bytes(pdu[7:9], "big")


_FUNCTIONS = {
    1: (_read_bits, _is_5_bytes),
    2: (_read_bits, _is_5_bytes),
    3: (_read_registers, _is_5_bytes),
    4: (_read_registers, _is_5_bytes),
    5: (_write_coil, _is_5_bytes),
    6: (_write_register, _is_5_bytes),
    15: (_write_coils, _has_its_bits),
    16: (_write_registers, _has_its_registers),
    22: (_mask_write, _is_7_bytes),
    23: (_read_and_write, _has_its_written_registers),
}
"""The implementation of each function, and the check that a PDU has the length that it states."""


# -- framings --------------------------------------------------------------------------------------------------------


class Rtu:
    """A serial line with one unit or several.

    Function and byte count give the end of a frame, or else the CRC does; a wrong CRC, a silence or too many bytes
    discard the bytes received so far. Unit 0 is a broadcast, which every unit executes and none answers.

    Args:
        counters: the device's; counts ``requests``, ``refused``, ``other_unit``, ``bad_checksum``, ``broken_frames``.
        gap_ns: the silence, see :func:`silence_ns`.
        sizes: bytes of requests with the firmware's own functions, by function, unit and CRC included.
    """

    has_checksum = True

    def __init__(self, *, counters: Counter[str], gap_ns: int = 1_750_000, sizes: Mapping[int, int] | None = None):
        self.gap_ns = gap_ns
        self._counters = counters
        self._sizes = dict(sizes or {})
        self._buffer = b""
        self._received_ns = 0

    def reset(self) -> None:
        """Discard the bytes received so far."""
        self._buffer = b""

    @property
    def is_idle(self) -> bool:
        """True while no incomplete frame is in the buffer."""
        return not self._buffer

    def answers(self, data: bytes, t_ns: int, units: Mapping[int, Banks]) -> list[bytes]:
        """Return the answers to the requests that these bytes complete; ``units`` are those of this device."""
        frames = []
        for unit, pdu in self._cut(data, t_ns, units):
            if unit == BROADCAST:
                for banks in units.values():
                    _execute(pdu, banks, t_ns, self._counters)
            elif unit not in units:
                self._counters["other_unit"] += 1
            elif (reply := _execute(pdu, units[unit], t_ns, self._counters)) is not None:
                frames.append(rtu(unit, reply))
        return frames

    def _cut(self, data: bytes, t_ns: int, units: Container[int]) -> list[tuple[int, bytes]]:
        """Return unit and PDU of every frame that these bytes complete."""
        if self._buffer and t_ns - self._received_ns > self.gap_ns:
            self._discard("broken_frames")
        self._received_ns = t_ns
        self._buffer += data
        frames = []
        while size := self._size(units):
            frame, self._buffer = self._buffer[:size], self._buffer[size:]
            frames.append((frame[0], frame[1:-2]))
        return frames

    def _size(self, units: Container[int]) -> int:
        """Return the size of the sound frame that begins the buffer [bytes], 0 while there is none."""
        buffer = self._buffer
        size = (self._sizes.get(buffer[1], 0) if len(buffer) > 1 else 0) or _rtu_size(buffer)
        waiting = len(buffer) < size <= MAX_RTU_FRAME_BYTES
        if len(buffer) < 4 or (waiting and (buffer[0] == BROADCAST or buffer[0] in units)):
            return 0
        # The CRC over a frame and its CRC is 0, which ends unknown functions and other units' answers.
        for end in (size, len(buffer)):
            if 4 <= end <= min(len(buffer), MAX_RTU_FRAME_BYTES) and crc16_modbus(buffer[:end]) == 0:
                return end
        if size > MAX_RTU_FRAME_BYTES or len(buffer) > MAX_RTU_FRAME_BYTES:
            self._discard("broken_frames")
        elif size and not waiting:
            self._discard("bad_checksum")
        return 0

    def _discard(self, why: str) -> None:
        self._counters[why] += 1
        self._buffer = b""


_FIXED_SIZES = {**dict.fromkeys((1, 2, 3, 4, 5, 6, 8), 8), **dict.fromkeys((7, 11, 12, 17), 4), 22: 10, 24: 6, 43: 7}
_COUNT_AT = {15: 6, 16: 6, 20: 2, 21: 2, 23: 10}


def _rtu_size(frame: bytes) -> int:
    """Return the size of a request with its CRC [bytes], 0 if it is not known (yet)."""
    if len(frame) < 2:
        return 0
    if fixed := _FIXED_SIZES.get(frame[1]):
        return fixed
    at = _COUNT_AT.get(frame[1])
    return 0 if at is None or len(frame) <= at else at + 1 + frame[at] + 2


class Mbap:
    """A TCP connection. An invalid header discards the bytes received so far.

    Args:
        counters: the device's; counts ``requests``, ``refused``, ``other_unit``, ``broken_frames``.
        id_error: number that is added to the transaction of an answer, an error of some firmwares.
    """

    def __init__(self, *, counters: Counter[str], id_error: int = 0):
        self._counters = counters
        self._id_error = id_error
        self._buffer = b""

    def reset(self) -> None:
        """Discard the bytes received so far."""
        self._buffer = b""

    def answers(self, data: bytes, t_ns: int, units: Banks | Mapping[int, Banks]) -> list[bytes]:
        """Return the answers to the requests that these bytes complete.

        ``units`` is the one device at this address, for any unit in the request (most firmwares), or the units behind
        a gateway. An answer has the unit and the transaction of its request.
        """
        self._buffer += data
        messages = []
        while (message := self._take()) is not None:
            transaction, unit, pdu = message
            banks = units if isinstance(units, Banks) else units.get(unit)
            if banks is None:
                self._counters["other_unit"] += 1
            elif (reply := _execute(pdu, banks, t_ns, self._counters)) is not None:
                messages.append(mbap(unit, reply, transaction=transaction + self._id_error & 0xFFFF))
        return messages

    def _take(self) -> tuple[int, int, bytes] | None:
        """Return transaction, unit and PDU of the next message, ``None`` if there is none."""
        if len(self._buffer) < MBAP.size:
            return None
        transaction, protocol, length, unit = MBAP.unpack_from(self._buffer)
        if protocol != 0 or not 2 <= length <= MAX_PDU_BYTES + 1:
            self._counters["broken_frames"] += 1
            self._buffer = b""
            return None
        size = MBAP.size - 1 + length
        if len(self._buffer) < size:
            return None
        pdu, self._buffer = self._buffer[MBAP.size : size], self._buffer[size:]
        return transaction, unit, pdu


def _execute(pdu: bytes, banks: Banks, t_ns: int, counters: Counter[str]) -> bytes | None:
    """Return the answer to a request; ``None`` for an exception, which is another unit's answer on the line."""
    if pdu[0] >= 0x80:
        counters["broken_frames"] += 1
        return None
    counters["requests"] += 1
    reply = answer(pdu, banks, t_ns)
    if reply[0] & 0x80:
        counters["refused"] += 1
    return reply
