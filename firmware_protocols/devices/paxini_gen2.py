r"""PaXini PX-6AX tactile modules behind the GEN2 control box.

Wire: USB, opened at 460800 8N1. Each request gets one reply, for which the host must wait.

    command            main  sub    data                           data in the reply
    version            60    A0 01  -                              ASCII
    set mode           70    C0 0C  5 most GEN2, 2 GEN1,           - (may take 2 s)
                                    1 GEN2-DP-S2716
    get mode           70    C0 0D  -                              mode
    select port        70    B1 0A  (CON - 1) * 3 + offset         -
    read               70    C0 06  7B, start LE16, count LE16     finger status, 7B, start LE16, count LE16, content
    write user config  70    B0 02  address, value (03 01: zero)   status

Memory of a module: ``paxini_modules.py``. The reply repeats the index.

Quirks of the hardware that the model keeps: the box answers the zero command with error 06 although it obeys (the
driver takes that for success). The driver looks for the version once, 10 ms after its request. The vendor's example of
a set mode reply shows sub command C0 09; here the reply repeats the request's.

Try it: ``tactemu run paxini_gen2``, then the driver of Gabriel-Ning/paxini_driver at 460800.
"""

import struct
from typing import Annotated

from firmware_protocols import (
    MORE, SOUND, Broken, Frame, Option, Packets, Sent, Serial, Transmissions, command_table, fact_table,
)  # fmt: skip
from firmware_protocols.devices.paxini_modules import GAP_NS, TAXELS_BY_MODEL, Model, Px6axDevice
from firmware_protocols.sums import lrc8

REQUEST = Frame("""
    request
    0     55 AA 7B 7B     head
    4     0E              fixed
    5     u1              index
    6     u1              main
    7     >u2             sub
    9     <u2             length = len(data)
    11    bytes           data
    ..    lrc8 from 4     check
    ..    55 AA 7D 7D     tail
""")
REPLY = Frame("""
    reply
    0     55 AA 7B 7B     head
    4     0E              fixed
    5     u1              index         as in the request
    6     u1              main
    7     >u2             sub
    9     u1              error
    10    <u2             length = len(data)
    12    bytes           data
    ..    lrc8 from 4     check
    ..    55 AA 7D 7D     tail
""")
PDF = "vendor PDF V1.5"
DRIVER = "Gabriel-Ning/paxini_driver@113ab44"
HEAD = b"\x55\xaa\x7b\x7b"
TAIL = b"\x55\xaa\x7d\x7d"
FIXED_BYTE = 0x0E
TAXEL_REGION = 0x7B
READ_VERSION = (0x60, 0xA001)
SET_MODE = (0x70, 0xC00C)
GET_MODE = (0x70, 0xC00D)
SELECT_PORT = (0x70, 0xB10A)
READ = (0x70, 0xC006)
WRITE_CONFIG = (0x70, 0xB002)
DATA_BYTES = {READ_VERSION: 0, GET_MODE: 0, SET_MODE: 1, SELECT_PORT: 1, READ: 5, WRITE_CONFIG: 2}
MAIN_COMMANDS = {main for main, _ in DATA_BYTES}
ZERO_CONFIG = b"\x03\x01"
MODES = (1, 2, 5)
MAX_DATA_BYTES = 64
STATUS_DONE = b"\0"
"""The state of the module in the answer to a zero, beside any error byte."""

OK = 0
BAD_LENGTH = 1
BAD_LRC = 2
BAD_MAIN = 3
BAD_SUB = 4
TOO_LONG = 5
BAD_PARAMETER = 6
NO_DATA = 7


class PaxiniGen2(Px6axDevice):
    """Modules on the ports of a GEN2 control box, which answers requests."""

    name = "paxini_gen2"
    title = "PaXini PX-6AX, GEN2 control box"
    kind = "fingertip"
    ports = (Serial(baud=460800, usb=True),)
    taxel_counts = {**TAXELS_BY_MODEL, "L5325": 120}
    evidence = ("vendor document", "driver")
    sources = (
        "vendor PDF 'control box protocol V1.5 (simplified)' in Gabriel-Ning/paxini_driver@113ab44, with error codes",
        "Gabriel-Ning/paxini_driver@113ab44 paxini_driver.py l.94-96, 165",
    )
    judge = DRIVER
    documented = command_table(
        """
        @ vendor PDF V1.5
        ? version    01 60 A0 01 00 00 F0                 01 60 A0 01 00 *
        set mode     01 70 C0 0C 01 00 05 AF              01 70 C0 0C 00 00 00 B5
        ? get mode   01 70 C0 0D 00 00 B4                 01 70 C0 0D 00 01 00 05 AE
        select port  01 70 B1 0A 01 00 00 C5              01 70 B1 0A 00 00 00 C6
        ? read taxels  00 70 C0 06 05 00 7B 0E 04 1E 00 0C  00 70 C0 06 00 24 00 00 7B 0E 04 1E 00 ..{30} ..
        @ Gabriel-Ning/paxini_driver@113ab44 l.165
        zero         01 70 B0 02 02 00 03 01 C9
            01 70 B0 02 06 01 00 00 C8  write user config 03 = 01; the error byte is wrong on the real box, too
        """,
        head="55 AA 7B 7B 0E",
        tail="55 AA 7D 7D",
    )
    documented_with = ("version", "mode_time_s", "zero_error")
    facts = fact_table(f"""
        stated configuration: error codes 0 to 7 @ {PDF} appendix
        stated configuration: modes and ports of each model @ {PDF} table 1-0
        stated configuration: the answer to the zero has error 06 @ {DRIVER} l.165
        stated identity: the version is a text of 29 bytes @ {PDF} (1d 00)
        stated identity: its port is /dev/ttyACM0 @ {DRIVER} paxini.yaml, README
        stated touch: an L5325 is read as 120 taxels from 1038, x and y int8, z uint8 @ {DRIVER} l.181-208
        assumed identity: the text of the version; USB ids @ {PDF}; {DRIVER} whole
        assumed touch: places: rows on a flat pad of the size in the model's name; 0.1 N @ {PDF}; {DRIVER} whole
        assumed touch: other models have as many taxels as on GEN3 @ {PDF} (names a protocol of the module)
        assumed configuration: a wrong tail or first byte is a wrong length; an empty port has no data @ {PDF}
        assumed configuration: mode 5 at power-up; one module sits on every port @ {PDF}; {DRIVER} whole
        assumed timing: a change of mode takes 0.5 s (2 s at most is stated) @ {PDF}
        assumed timing: a half request is forgotten after 50 ms @ {PDF}
    """)

    def __init__(
        self,
        *,
        models: Annotated[Model | tuple[Model, ...], Option("one model name, or several")] = "L5325",
        places: Annotated[
            tuple[int, ...] | None,
            Option("port of each module, (CON - 1) * 3 + offset; default: one sits on every port"),
        ] = None,
        version: Annotated[str, Option("answer to the version command")] = "PX-6AX-GEN2-CONTROL-BOX V1.05",
        mode_time_s: Annotated[float, Option("duration of a change of mode", unit="s", low=0.0)] = 0.5,
        zero_error: Annotated[
            int, Option("error byte in the answer to the zero command", low=0, high=255)
        ] = BAD_PARAMETER,
    ):
        self._power_up(models, places)
        self.version = version.encode("ascii")
        self.mode_time_ns = round(mode_time_s * 1e9)
        self.zero_error = zero_error
        self.mode, self.selected = 5, self.places[0] if self.places else 0
        self.packets = Packets(HEAD, _size, _check, counters=self.counters, gap_ns=GAP_NS, broken=True)

    def _refuse(self, packet: Broken) -> Transmissions:
        """Return an error reply with the fields of the broken request."""
        error = BAD_LRC if packet.why == "bad_checksum" else TOO_LONG if packet.why == "too_long" else BAD_LENGTH
        index, main, sub = struct.unpack_from(">BBH", packet, 5)
        return [REPLY.pack(index=index, main=main, sub=sub, error=error, data=b"")]

    def _answer(self, packet: bytes) -> Transmissions:
        request = REQUEST.unpack(packet)
        assert request is not None, "the cutter has checked it"
        command, data = (request["main"], request["sub"]), request["data"]
        delay_ns = self.mode_time_ns if command == SET_MODE and data and data[0] != self.mode else 0
        error, content = self._obey(command, data)
        self.counters["refused"] += error != OK and content != STATUS_DONE
        frame = REPLY.pack(index=request["index"], main=command[0], sub=command[1], error=error, data=content)
        return [Sent(frame, delay_ns=delay_ns if error == OK else 0)]

    def _obey(self, command: tuple[int, int], data: bytes) -> tuple[int, bytes]:
        """Return the error and the content of the answer."""
        if command not in DATA_BYTES:
            return BAD_SUB if command[0] in MAIN_COMMANDS else BAD_MAIN, b""
        if len(data) != DATA_BYTES[command]:
            return BAD_LENGTH, b""
        if command == READ_VERSION:
            return OK, self.version
        if command == GET_MODE:
            return OK, bytes([self.mode])
        if command == SET_MODE:
            if data[0] not in MODES:
                return BAD_PARAMETER, b""
            self.mode = data[0]
        elif command == SELECT_PORT:
            self.selected = data[0]
        elif command == READ:
            return self._read(data)
        else:
            return self._write_config(data)
        return OK, b""

    def _read(self, data: bytes) -> tuple[int, bytes]:
        region, start, count = struct.unpack("<BHH", data)
        module = self.module_at(self.selected)
        if module is None:
            return NO_DATA, b""
        content = self.memory(module, start, count) if region == TAXEL_REGION else None
        return (BAD_PARAMETER, b"") if content is None else (OK, b"\0" + data + content)

    def _write_config(self, data: bytes) -> tuple[int, bytes]:
        module = self.module_at(self.selected)
        if module is None:
            return NO_DATA, b"\x01"
        if data != ZERO_CONFIG:
            return BAD_PARAMETER, b"\x01"
        self.set_zero(module)
        return self.zero_error, STATUS_DONE


def _size(data: bytes) -> int | str:
    if len(data) < 11:
        return MORE
    length = int.from_bytes(data[9:11], "little")
    if data[4] != FIXED_BYTE:
        return "bad_length"
    return 16 + length if length <= MAX_DATA_BYTES else "too_long"


def _check(packet: bytes) -> str:
    if lrc8(packet[4:-4]):
        return "bad_checksum"
    return SOUND if packet.endswith(TAIL) else "bad_tail"
