r"""PaXini PX-6AX behind the GEN2 control box.

Wire: 460800 8N1. One request, one reply; the host must wait for it.

    part  host to box                                    box to host
    head  55 AA 7B 7B                                    the same
    body  0E, index, main, sub (2), length LE16, data    0E, index, main, sub (2), error, length LE16, data
    LRC   makes the sum of the body 0                    the same; the error byte counts
    tail  55 AA 7D 7D                                    the same

    command            main  sub    data                           data in the reply
    version            60    A0 01  -                              ASCII
    set mode           70    C0 0C  5 most GEN2, 2 GEN1,           - (may take 2 s)
                                    1 GEN2-DP-S2716
    get mode           70    C0 0D  -                              mode
    select port        70    B1 0A  (CON - 1) * 3 + offset         -
    read               70    C0 06  7B, start LE16, count LE16     finger status, 7B, start LE16, count LE16, content
    write user config  70    B0 02  address, value (03 01: zero)   status

Memory of a module: :mod:`firmware_protocols.devices.paxini_modules`. The index comes back as it was sent.

Quirks kept: the box answers the zero command with error 06 although it obeys (the driver takes it for success), and
the driver looks for the version 10 ms after asking and never again. The vendor's example of a set mode reply shows sub
command C0 09; here the reply repeats the request's.

Try it: ``tactemu run paxini_gen2``, then the driver of Gabriel-Ning/paxini_driver at 460800.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from firmware_protocols.device import Command, Delayed, Outgoing, SerialWire
from firmware_protocols.devices.paxini_modules import GAP_NS, TAXEL_DATA, TAXELS, Px6axDevice
from firmware_protocols.devices.paxini_px6ax import lrc

HEAD, TAIL = b"\x55\xaa\x7b\x7b", b"\x55\xaa\x7d\x7d"
FIXED = 0x0E
REGION = 0x7B
VERSION, SET_MODE, GET_MODE = (0x60, 0xA001), (0x70, 0xC00C), (0x70, 0xC00D)
SELECT_PORT, READ, WRITE_CONFIG = (0x70, 0xB10A), (0x70, 0xC006), (0x70, 0xB002)
ZERO = b"\x03\x01"
MODES = (1, 2, 5)
LONGEST_DATA = 64

OK, BAD_LRC, BAD_LENGTH, BAD_COMMAND, BAD_VALUE, NO_MODULE, ZERO_ANSWER = 0, 1, 2, 3, 4, 5, 6


class PaxiniGen2(Px6axDevice):
    """Modules on the ports of a GEN2 control box, which answers requests.

    Args:
        models: model name or names.
        places: port of each module, ``(CON - 1) * 3 + offset``; by default a single module sits on every port.
        version: the answer to the version command.
        mode_time_s: how long a change of mode takes [s].
        zero_error: error byte in the answer to the zero command.
    """

    name = "paxini_gen2"
    title = "PaXini PX-6AX, GEN2 control box"
    wires = (SerialWire(baud=460800),)
    rate_hz = 100.0
    taxel_counts = {**TAXELS, "L5325": 120}
    evidence = ("vendor document", "driver")
    sources = (
        "vendor PDF 'control box protocol V1.5 (simplified)' in Gabriel-Ning/paxini_driver@113ab44",
        "Gabriel-Ning/paxini_driver@113ab44 paxini_driver.py l.94-96, 165",
    )
    judge = "none on the package index"
    assumed = (
        "places of the taxels: even rows on a flat pad of the size in the model's name; 0.1 N per count as on GEN3",
        "L5325 has the 120 taxels that the driver reads; other models as on GEN3",
        "which error code means what: 1 LRC, 2 length or tail, 3 command, 4 value or address, 5 no module",
        "a change of mode takes 0.5 s; a half request is forgotten after 50 ms",
    )

    def __init__(
        self,
        *,
        models: str | Sequence[str] = "L5325",
        places: Sequence[int] | None = None,
        version: str = "PX-6AX-GEN2 V1.5",
        mode_time_s: float = 0.5,
        zero_error: int = ZERO_ANSWER,
    ):
        super().__init__(models=models, places=places)
        self.version = version.encode("ascii")
        self.mode_time_ns = round(mode_time_s * 1e9)
        self.zero_error = zero_error
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Mode 5, the first module's port."""
        self._buffer = bytearray()
        self._heard_ns = t_ns
        self.mode = 5
        self.port = self.places[0] if self.places else 0
        self._reset_modules()
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """Every command of the vendor's table."""
        taxels = 3 * self.taxel_counts[self.models[0]]
        port = bytes([self.places[0] if self.places else 0])
        where = struct.pack("<BHH", REGION, TAXEL_DATA, taxels)

        def reading(frames: list) -> bool:
            return len(frames) == 1 and len(frames[0]) == 17 + 6 + taxels and frames[0][9] == OK

        return (
            Command(name="version", request=request(VERSION), reply=[reply(1, VERSION, OK, self.version)]),
            Command(name="set mode", request=request(SET_MODE, b"\x05"), reply=[reply(1, SET_MODE, OK)]),
            Command(name="get mode", request=request(GET_MODE), reply=[reply(1, GET_MODE, OK, bytes([self.mode]))]),
            Command(name="select port", request=request(SELECT_PORT, port), reply=[reply(1, SELECT_PORT, OK)]),
            Command(name="read taxels", request=request(READ, where), reply=reading),
            Command(
                name="zero",
                request=request(WRITE_CONFIG, ZERO),
                reply=[reply(1, WRITE_CONFIG, self.zero_error, b"\0")],
                about="write user config 03 = 01; the error byte is wrong on the real box, too",
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

    def _next(self) -> list[Outgoing] | None:
        """Answer to the next thing in the buffer, or ``None`` until more bytes come."""
        buffer = self._buffer
        start = buffer.find(HEAD)
        junk = start if start >= 0 else max(0, len(buffer) - len(HEAD) + 1)
        self.counters["skipped_bytes"] += junk
        del buffer[:junk]
        if start < 0 or len(buffer) < 11:
            return None
        _, index, main, sub, length = struct.unpack_from(">BBBH", buffer, 4) + struct.unpack_from("<H", buffer, 9)
        if length > LONGEST_DATA or buffer[4] != FIXED:
            return self._refuse(BAD_LENGTH, "bad_length", index, (main, sub))
        if len(buffer) < 16 + length:
            return None
        body, tail = bytes(buffer[4 : 12 + length]), bytes(buffer[12 + length : 16 + length])
        if lrc(body):
            return self._refuse(BAD_LRC, "bad_checksum", index, (main, sub))
        if tail != TAIL:
            return self._refuse(BAD_LENGTH, "bad_tail", index, (main, sub))
        del buffer[: 16 + length]
        self.counters["requests"] += 1
        return self._answer(index, (main, sub), body[7:-1])

    def _refuse(self, error: int, counter: str, index: int, command: tuple[int, int]) -> list[Outgoing]:
        """Answer with an error, and look for the next head behind this one."""
        self.counters[counter] += 1
        del self._buffer[: len(HEAD)]
        return [reply(index, command, error)]

    def _answer(self, index: int, command: tuple[int, int], data: bytes) -> list[Outgoing]:
        answers = {
            VERSION: (0, self._version),
            GET_MODE: (0, self._get_mode),
            SET_MODE: (1, self._set_mode),
            SELECT_PORT: (1, self._select_port),
            READ: (5, self._read),
            WRITE_CONFIG: (2, self._write_config),
        }
        length, act = answers.get(command, (0, None))
        if act is None:
            error, content, delay_ns = BAD_COMMAND, b"", 0
        elif len(data) != length:
            error, content, delay_ns = BAD_LENGTH, b"", 0
        else:
            error, content, delay_ns = act(data)
        self.counters["refused"] += error != OK
        frame = reply(index, command, error, content)
        return [Delayed(frame, delay_ns) if delay_ns else frame]

    # -- commands: error, content, delay [ns] ----------------------------------------------------------------------

    def _version(self, _data: bytes) -> tuple[int, bytes, int]:
        return OK, self.version, 0

    def _get_mode(self, _data: bytes) -> tuple[int, bytes, int]:
        return OK, bytes([self.mode]), 0

    def _set_mode(self, data: bytes) -> tuple[int, bytes, int]:
        if data[0] not in MODES:
            return BAD_VALUE, b"", 0
        delay_ns = self.mode_time_ns if data[0] != self.mode else 0
        self.mode = data[0]
        return OK, b"", delay_ns

    def _select_port(self, data: bytes) -> tuple[int, bytes, int]:
        self.port = data[0]
        return OK, b"", 0

    def _read(self, data: bytes) -> tuple[int, bytes, int]:
        region, start, count = struct.unpack("<BHH", data)
        module = self.module_at(self.port)
        if module is None:
            return NO_MODULE, b"\x01" + data, 0
        content = self.memory(module, start, count) if region == REGION else None
        return (BAD_VALUE, b"", 0) if content is None else (OK, b"\0" + data + content, 0)

    def _write_config(self, data: bytes) -> tuple[int, bytes, int]:
        module = self.module_at(self.port)
        if module is None:
            return NO_MODULE, b"\x01", 0
        if data != ZERO:
            return BAD_VALUE, b"\x01", 0
        self.zero(module)
        return self.zero_error, b"\0", 0


def request(command: tuple[int, int], data: bytes = b"", *, index: int = 1) -> bytes:
    """A request as a driver sends it; ``command`` is (main, sub)."""
    return _framed(struct.pack(">BBBH", FIXED, index, *command), data)


def reply(index: int, command: tuple[int, int], error: int, data: bytes = b"") -> bytes:
    """The box's answer."""
    return _framed(struct.pack(">BBBHB", FIXED, index, *command, error), data)


def _framed(start: bytes, data: bytes) -> bytes:
    body = start + struct.pack("<H", len(data)) + data
    return HEAD + body + bytes([lrc(body)]) + TAIL
