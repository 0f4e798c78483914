r"""PaXini PX-6AX behind the GEN3 serial converter board.

Wire: 921600 8N1. One request, one reply; the board never speaks unasked.

    request  offset  bytes  field                    reply  offset  bytes  field
             0       2      55 AA                           0       2      AA 55
             2       2      LEN, LE: total - 5              2       2      LEN, LE: total - 5
             4       1      device id                       4       1      device id
             5       1      00                              5       1      00
             6       1      function                        6       1      function
             7       4      address, LE                     7       4      address, LE
             11      2      count, LE                       11      2      count, LE
             13      n      data (writes)                   13      1      status, 0 = ok
             last    1      LRC                             14      n      data (reads)
                                                            last    1      LRC

LRC makes the sum of all bytes 0.

    action       function  address  count        data in the reply
    resultant    FB        0x3F0    3            Fx int8, Fy int8, Fz uint8, 0.1 N each
    taxels       FB        0x40E    3 n          the same per taxel
    both         FB        0x3F0    30 + 3 n     taxels start at +30
    version      FB        6100     100          ASCII, padded with 00
    zero         79        3        1 (data 01)  none

The requests of version and zero and the reply to zero are captured frames. One note in fengjh97/paxini says that an
official example takes data from offset 13; the vendor's viewer takes 14.

Try it: ``tactemu run paxini_px6ax``, then any driver of the board at 921600.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from firmware_protocols.device import Command, Outgoing, SerialWire
from firmware_protocols.devices.paxini_modules import GAP_NS, RESULTANT, TAXEL_DATA, Px6axDevice

REQUEST, REPLY = b"\x55\xaa", b"\xaa\x55"
HEAD = struct.Struct("<HBBBIH")
READ, WRITE = 0xFB, 0x79
VERSION, VERSION_BYTES = 6100, 100
ZERO = 3
LONGEST_DATA = 64

OK, BAD_LRC, BAD_LENGTH, BAD_FUNCTION, BAD_ADDRESS = 0, 1, 2, 3, 4


class PaxiniPx6ax(Px6axDevice):
    """Modules behind a GEN3 converter board, which answers requests.

    Args:
        models: model name or names; see :data:`firmware_protocols.devices.paxini_modules.TAXELS`.
        places: device id of each module; by default a single module answers to every id, several to 0, 1, 2 ...
        version: text at address 6100.
    """

    name = "paxini_px6ax"
    title = "PaXini PX-6AX, GEN3 serial converter board"
    wires = (SerialWire(baud=921600),)
    rate_hz = 100.0
    evidence = ("captured", "driver")
    sources = (
        "yknxh/paxini-toolkit@1596843 tests/test_codec.py (captured frames), codec.py SENSOR_TYPES",
        "fengjh97/paxini@e8e6bcc paxini_sensor.py l.16-29",
        "adnan-saood/paxini_ros2@25009ba",
    )
    judge = "captured frames"
    assumed = (
        "places of the taxels: even rows on a flat pad of the size in the model's name",
        "Fx, Fy along the pad's x, y; the resultant is the sum over the pad",
        "status codes: 1 LRC, 2 length, 3 function, 4 address; a module that is not there is silent",
        "a half request is forgotten after 50 ms",
    )

    def __init__(
        self,
        *,
        models: str | Sequence[str] = "S1813E",
        places: Sequence[int] | None = None,
        version: str = "PX-6AX-GEN3 V1.0.0",
    ):
        super().__init__(models=models, places=places)
        self.version = version.encode("ascii")[:VERSION_BYTES].ljust(VERSION_BYTES, b"\0")
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Zero as delivered."""
        self._buffer = bytearray()
        self._heard_ns = t_ns
        self._reset_modules()
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """The five actions on the first module."""
        device = 0 if self.places is None else self.places[0]
        taxels = 3 * self.taxel_counts[self.models[0]]

        def reading(count: int):
            return lambda frames: (
                len(frames) == 1 and len(frames[0]) == 15 + count and frames[0][13] == OK and lrc(frames[0]) == 0
            )

        def read(address: int, count: int) -> bytes:
            return request(device, READ, address, count)

        return (
            Command(
                name="version",
                request=request(0, READ, VERSION, VERSION_BYTES),
                reply=[reply(0, READ, VERSION, VERSION_BYTES, OK, self.version)],
            ),
            Command(name="resultant", request=read(RESULTANT, 3), reply=reading(3)),
            Command(name="taxels", request=read(TAXEL_DATA, taxels), reply=reading(taxels)),
            Command(name="resultant and taxels", request=read(RESULTANT, 30 + taxels), reply=reading(30 + taxels)),
            Command(
                name="zero",
                request=request(device, WRITE, ZERO, 1, b"\x01"),
                reply=[reply(device, WRITE, ZERO, 1, OK)],
                about="what the module feels now is zero from now on",
            ),
        )

    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Requests in chunks of any size."""
        if t_ns - self._heard_ns > GAP_NS:
            self._buffer.clear()
        self._heard_ns = t_ns
        self._buffer += data
        answers: list[Outgoing] = []
        while (answer := self._next()) is not None:
            answers += answer
        return answers

    def _next(self) -> list[bytes] | None:
        """Answer to the next thing in the buffer, or ``None`` until more bytes come."""
        buffer = self._buffer
        start = buffer.find(REQUEST)
        junk = start if start >= 0 else len(buffer) - buffer.endswith(REQUEST[:1])
        self.counters["skipped_bytes"] += junk
        del buffer[:junk]
        if start < 0 or len(buffer) < 2 + HEAD.size:
            return None
        length, device, _, function, address, count = HEAD.unpack_from(buffer, 2)
        fields = (device, function, address, count)
        if not 9 <= length <= 9 + LONGEST_DATA:
            return self._refuse(BAD_LENGTH, "bad_length", fields)
        if len(buffer) < length + 5:
            return None
        frame = bytes(buffer[: length + 5])
        if lrc(frame):
            return self._refuse(BAD_LRC, "bad_checksum", fields)
        del buffer[: length + 5]
        self.counters["requests"] += 1
        return self._answer(*fields, frame[13:-1])

    def _refuse(self, status: int, counter: str, fields: tuple[int, int, int, int]) -> list[bytes]:
        """Answer with a status, and look for the next head behind this one."""
        self.counters[counter] += 1
        del self._buffer[:2]
        return [reply(*fields, status)]

    def _answer(self, device: int, function: int, address: int, count: int, data: bytes) -> list[bytes]:
        fields = (device, function, address, count)
        module = self.module_at(device)
        if function == READ and (address, count) == (VERSION, VERSION_BYTES) and (device == 0 or module is not None):
            return [reply(*fields, OK, self.version)]
        if module is None:
            self.counters["other_device"] += 1
            return []
        if function == READ:
            content = self.memory(module, address, count) if not data else None
            if content is None:
                return self._error(BAD_LENGTH if data else BAD_ADDRESS, fields)
            return [reply(*fields, OK, content)]
        if function != WRITE:
            return self._error(BAD_FUNCTION, fields)
        if len(data) != count:
            return self._error(BAD_LENGTH, fields)
        if (address, data) != (ZERO, b"\x01"):
            return self._error(BAD_ADDRESS, fields)
        self.zero(module)
        return [reply(*fields, OK)]

    def _error(self, status: int, fields: tuple[int, int, int, int]) -> list[bytes]:
        self.counters["refused"] += 1
        return [reply(*fields, status)]


def request(device: int, function: int, address: int, count: int, data: bytes = b"") -> bytes:
    """A request as a driver sends it."""
    return _framed(REQUEST, device, function, address, count, data)


def reply(device: int, function: int, address: int, count: int, status: int, data: bytes = b"") -> bytes:
    """The board's answer; it repeats the request's fields."""
    return _framed(REPLY, device, function, address, count, bytes([status]) + data)


def lrc(data: bytes) -> int:
    """Negated byte sum."""
    return -sum(data) & 0xFF


def _framed(head: bytes, device: int, function: int, address: int, count: int, rest: bytes) -> bytes:
    body = head + HEAD.pack(9 + len(rest), device, 0, function, address, count) + rest
    return body + bytes([lrc(body)])
