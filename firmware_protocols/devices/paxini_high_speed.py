r"""PaXini PX-6AX behind the high-speed board for 28 modules, and ORCA Touch, whose board has the same protocol.

Wire: 921600 8N1; ORCA's board is USB-CDC. Registers are read and written; while register 17 is 1 the board also pushes
its readings.

    register        content
    0000            version, 16 characters
    0010            a bit for each fitted module: 8 x byte + bit; proximal, middle, tip, nail of thumb, index,
                    middle, ring, little (0..19), palm (20..27)
    0016            content of a push: bit 0 resultants, bit 1 taxels
    0017            1: push
    0022            1 restarts the board, 50 ms after the answer
    0030 + 2 m      taxels of module m, two bytes
    0500 + 6 m      resultant: Fx, 0, Fy, 0, Fz, 0; FF instead of 0 after a byte above 7F
    1000 + 200 m    taxels: Fx int8, Fy int8, Fz uint8 each; those of the palm from 3800 + 100 p

0.1 N per count. A push has, of each module in ascending order, the resultant and then the taxels. All other registers
read zero; writes there are confirmed, without effect. Function 17 on register 2 makes the present forces zero.

ORCA's board has more: its version is ``ORCA1.0-`` and a commit; 6100 reads ``OX`` and its features; 6200 + 20 x slot
names the fingertip; 6400 counts requests since power-up; 6110 takes 04 5A 52 and a mask of fingertips to zero,
6120 has the result. A real board also sends its joints' encoders (AA A9) unasked, 466 times a second, all FFFF if
none are wired: they are not in this model. It answers requests for its identity in text:

    ORCA_ID?        ORCA:SENSOR
    ORCA_INFO?      ORCA:SENSOR;SIDE=R;HW=1;FW=1;SN=...;BID=...

Try it: ``tactemu run paxini_high_speed``, then ``HighSpeedHandBoard(port)`` of ``paxini_sdk``; ``tactemu run
orca_touch``, then ``TactileClient(HandSerialLink(port))`` of ``orca_core``.
"""

import re
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    MORE, USB, Frame, Option, Packets, Refused, Request, Restart, Serial, Transmissions, command, command_table,
    fact_table,
)  # fmt: skip
from firmware_protocols.devices.orca_tips import PARTS_BY_FINGER, fingertips
from firmware_protocols.devices.paxini_modules import Model, Px6axDevice

REQUEST = Frame("""
    request
    0     55 AA       head
    2     u1          reserved              00; ignored
    3     u1          function              03 read, 10 write, 17 calibrate
    4     <u2         register
    6     <u2         count                 bytes
    8     bytes       data                  writes
    last  lrc8        check
""")
REPLY = Frame("""
    reply
    0     AA 55       head
    2     00          reserved
    3     u1          function              the request's; or 80 and an error
    4     <u2         register
    6     <u2         count = len(data)
    8     bytes       data                  what is read; of a write or a calibration 00: done
    last  lrc8        check
""")
PUSH = Frame("""
    push
    0     AA 56       head
    2     00          reserved
    3     <u2         count = len(data) + 1
    5     00          error
    6     bytes       data                  module by module
    last  lrc8        check
""")
READ = 0x03
MIN_REQUEST_BYTES = 9
MAX_READ_BYTES = 512
MAX_WRITE_BYTES = 64
MEMORY_BYTES = 0x10000 + MAX_READ_BYTES
GAP_NS = 50_000_000
ERROR = 0x80
BAD_LENGTH = 1
BAD_FUNCTION = 3
DONE = b"\0"
VERSION_REGISTER = 0x0000
FITTED_REGISTER = 0x0010
CONTENT_REGISTER = 0x0016
PUSH_REGISTER = 0x0017
RESET_REGISTER = 0x0022
TAXEL_COUNT_REGISTERS = 0x0030
RESULTANT_REGISTERS = 0x0500
EXTENSION_REGISTER = 0x6100
ZERO_REGISTER = 0x6110
STATUS_REGISTER = 0x6120
NAME_REGISTERS = 0x6200
STATISTICS_REGISTER = 0x6400
ZERO_ORDER = b"\x04ZR"
ZEROED = 3
FINISHED = 2
SLOTS = 28
FIRST_PALM_MODULE = 20
TIP_MODULES = (2, 6, 10, 14, 18)
LEROBOT = "lerobot-camera-paxini 0.1.0"
PLUGIN = "lerobot-robot-so101-paxini 0.1.0 paxini_sensor.py"
QUERY = re.compile(rb"ORCA_(ID|INFO)\?\n")


class PaxiniHighSpeed(Px6axDevice):
    """Modules behind the high-speed board."""

    name = "paxini_high_speed"
    kind = "hand"
    title = "PaXini PX-6AX, high-speed board"
    ports = (Serial(baud=921_600),)
    rate_hz = 1000 / 11
    boot_s = 0.02
    evidence = ("driver",)
    sources = (
        "paxini-sdk 0.1.0 boards/high_speed.py, protocol.py, registers.py",
        "lerobot-robot-so101-paxini 0.1.0 and lerobot-camera-paxini 0.1.0 (requests, 91 pushes a second)",
        "orca-core 0.12.0 hardware/sensing/constants.py, tactile_protocol.py (taxel registers)",
    )
    judge = "paxini-sdk 0.1.0, lerobot-robot-so101-paxini 0.1.0"
    documented = command_table("""
        @ frames of paxini-sdk 0.1.0
        ? fitted modules       55 AA 00 03 10 00 04 00 EA     AA 55 00 03 10 00 04 00 44 44 04 00 5E
        ? taxels of each       55 AA 00 03 30 00 38 00 96     AA 55 00 03 30 00 38 00 ..{56} ..
        ? resultant of module 2  55 AA 00 03 0C 05 06 00 E7     AA 55 00 03 0C 05 06 00 ..{6} ..
        ? taxels of module 18  55 AA 00 03 00 34 5D 00 6D     AA 55 00 03 00 34 5D 00 ..{93} ..
        resultants only        55 AA 00 10 16 00 01 00 01 D9  AA 55 00 10 16 00 01 00 00 DA
        push                   55 AA 00 10 17 00 01 00 01 D8  AA 55 00 10 17 00 01 00 00 D9
        push no more           55 AA 00 10 17 00 01 00 00 D9  AA 55 00 10 17 00 01 00 00 D9
        calibrate              55 AA 00 17 02 00 01 00 01 E6  AA 55 00 17 02 00 01 00 00 E7
        restart                55 AA 00 10 22 00 01 00 01 CD  AA 55 00 10 22 00 01 00 00 CE
    """)
    facts = fact_table(f"""
        stated timing: 91 push messages a second @ {LEROBOT} METADATA, configuration_paxini.py l.30
        stated identity: the version is a text (15 bytes are read) @ paxini-sdk 0.1.0 registers.py l.13
        stated identity: which modules are fitted, and the taxels of each @ paxini-sdk 0.1.0 registers.py l.17-43,
            108-132
        stated touch: forces are in 0.1 N; x and y are int8, z is uint8 @ paxini-sdk 0.1.0 high_speed.py l.36-59 (after
            the vendor's viewer)
        stated configuration: the zero command is function 17, register 2; 00 means success @ paxini-sdk 0.1.0
            high_speed.py l.288-320
        stated touch: in some push messages all taxels are 0 although the resultant is not (the model does not do this)
            @ {PLUGIN} l.717-723
        assumed identity: the text of the version @ paxini-sdk 0.1.0, orca-core 0.12.0, both whole
        assumed identity: USB ids (a 28E9 in orca-core constants.py l.36, /dev/ttyUSB0 in others) @ {LEROBOT}
        assumed touch: taxels lie in rows on flat pads, side by side; the true places are in paxini-sdk data/ and are
            not used yet @ paxini-sdk 0.1.0
        assumed touch: x, y along the pad; the resultant is the sum over the pad @ paxini-sdk 0.1.0 high_speed.py
        assumed configuration: errors are 3 for the function and 1 for the length; a request with a wrong sum gets no
            answer @ paxini-sdk 0.1.0 protocol.py
        assumed configuration: resultants and taxels are pushed once they have been requested @ paxini-sdk 0.1.0
            registers.py
        assumed timing: it answers again 70 ms after its reply to a restart; an incomplete request is discarded after 50
            ms @ paxini-sdk 0.1.0
    """)

    def __init__(
        self,
        *,
        models: Annotated[Model | tuple[Model, ...], Option("one model name, or several")] = ("S1813E",) * 5,
        places: Annotated[tuple[int, ...], Option("number of each module, ascending")] = TIP_MODULES,
        version: Annotated[str, Option("version of at most 16 characters of ASCII")] = "PX-HS V1.0",
    ):
        self._power_up(models, places)
        self._power_up_board(version)

    def _power_up_board(self, version: str) -> None:
        if self.places is None or list(self.places) != sorted(set(self.places)) or self.places[-1] >= SLOTS:
            raise ValueError(f"{self.name}: places must ascend within 0..{SLOTS - 1}, got {self.places}")
        self.version = version.encode("ascii")[:16]
        self.packets = Packets(REQUEST, _size, by="function", counters=self.counters, gap_ns=GAP_NS)
        self.content, self.pushes = 3, False

    # -- registers -------------------------------------------------------------------------------------------------

    def _blocks(self) -> Iterator[tuple[int, bytes]]:
        """Yield the parts of memory that are not zero: first register and content."""
        places = self.places or ()
        fitted = sum(1 << module for module in places)
        yield VERSION_REGISTER, self.version
        yield FITTED_REGISTER, fitted.to_bytes(4, "little")
        yield CONTENT_REGISTER, bytes([self.content, self.pushes])
        for index, module in enumerate(places):
            taxels, palm = self.taxels(index), module - FIRST_PALM_MODULE
            yield TAXEL_COUNT_REGISTERS + 2 * module, (len(taxels) // 3).to_bytes(2, "little")
            yield RESULTANT_REGISTERS + 6 * module, self._resultant(index)
            yield 0x3800 + 0x100 * palm if palm >= 0 else 0x1000 + 0x200 * module, taxels

    def _resultant(self, module: int) -> bytes:
        """Return the resultant of a module, six bytes."""
        sums = self.resultant(module)
        return (sums & 0xFF | np.where(sums & 0x80, 0xFF00, 0)).astype("<u2").tobytes()

    def _write(self, register: int, data: bytes) -> Transmissions:
        """Carry out a write; return a restart if it orders one."""
        for at, value in enumerate(data, register):
            if at == CONTENT_REGISTER:
                self.content = value & 3
            elif at == PUSH_REGISTER:
                self.pushes = value == 1
            elif at == RESET_REGISTER and value == 1:
                return [Restart(delay_ns=50_000_000)]
        return ()

    # -- what the runner asks --------------------------------------------------------------------------------------

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one push, while pushes are on."""
        if not self.pushes:
            return ()
        resultants, taxels = self.content & 1, self.content >> 1
        modules = range(len(self.models))
        parts = (self._resultant(k) * resultants + self.taxels(k) * taxels for k in modules)
        return [PUSH.pack(data=b"".join(parts))]

    @command(on=READ)
    def read(self, request: Request):
        """Return registers."""
        if not 0 < request.count <= MAX_READ_BYTES:
            raise Refused("value")
        memory = bytearray(MEMORY_BYTES)
        for start, content in self._blocks():
            memory[start : start + len(content)] = content
        return bytes(memory[request.register : request.register + request.count])

    @command(on=0x10)
    def write(self, request: Request):
        """Write registers."""
        if not request.data:
            raise Refused("value")
        return [*self.reply(request, DONE), *self._write(request.register, request.data)]

    @command(on=0x17)
    def calibrate(self, request: Request):
        """Make the present forces zero."""
        if request.register != 2:
            raise Refused("function")
        for module in range(len(self.models)):
            self.set_zero(module)
        return DONE

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the reply to a request."""
        return [REPLY.pack(function=request.function, register=request.register, data=content)]

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return a reply with an error."""
        error = ERROR | (BAD_LENGTH if request.why == "value" else BAD_FUNCTION)
        return [REPLY.pack(function=error, register=request.register, data=b"")]


_ORCA = "orca-core 0.12.0 hardware/sensing"
_READ = "orca-core 0.12.0 constants.py, hardware/ (whole); orcahand/orca_core@c783006 scripts/, docs/"
_ORCA_FACTS = fact_table(f"""
    stated touch: 0.1 N per count; Fz of a resultant saturates at 255 @ {_ORCA}/constants.py:152, 158
    stated touch: the taxels of each fingertip, their order and places @ {_ORCA}/models/touch-sensor-*/config.yaml
    assumed touch: fingertips lie side by side, 25 mm apart; the resultant is the sum over the taxels, in the frame of
        the fingertip, with Fz along its -z @ {_READ}
    stated identity: USB 2F5D:2202, CDC @ orca-core 0.12.0 constants.py:94
    stated identity: the line with side, hardware, firmware, serial number and board; CFG is not modelled @ orca-core
        0.12.0 constants.py:110, hardware/sensing/serial_discovery.py:113
    assumed identity: hardware 1, firmware 1, board id 0, the commit in the version, USB texts; a board of firmware 1.0
        that supports names @ {_READ}
    stated configuration: the answers for each fingertip whose zero succeeded @ {_ORCA}/constants.py:136
    assumed configuration: a zero is done at once, and a restart clears it (a real fingertip that keeps its power does
        not lose it); errors are as on PaXini's board; error counters are 0 @ {_READ}
    stated timing: a push message every 20 ms (firmware 1.0; an older sentence and the repository's check_sensors.py say
        about 1 kHz) @ {_ORCA}/constants.py:364
    stated timing: encoders are sent at 466 Hz, and FFFF where none is wired; the model sends none @
        {_ORCA}/constants.py:351, serial_discovery.py:448
    stated timing: the board restarts 50 ms after its answer, and answers again 70 ms later @ {_ORCA}/constants.py:101
""")


class OrcaTouch(PaxiniHighSpeed):
    """The five fingertips of an ORCA Touch hand behind ORCA's connector board."""

    name = "orca_touch"
    title = "ORCA Touch, five fingertips"
    rate_hz = 50.0
    evidence = ("driver",)
    sources = (
        "orca-core 0.12.0 hardware/tactile_client.py, sensing/constants.py, tactile_protocol.py, serial_discovery.py",
        "orca-core 0.12.0 sensing/models/touch-sensor-{thumb,finger,pinky}/config.yaml (taxels)",
    )
    judge = "orca-core 0.12.0"
    documented = command_table("""
        @ frames of orca-core 0.12.0
        ? who              4F 52 43 41 5F 49 44 3F 0A              4F 52 43 41 3A 53 45 4E 53 4F 52 0A
        ? who, in full     4F 52 43 41 5F 49 4E 46 4F 3F 0A        4F 52 43 41 3A 53 45 4E 53 4F 52 3B * 0A
        ? fitted tips      55 AA 00 03 10 00 04 00 EA              AA 55 00 03 10 00 04 00 44 44 04 00 5E
        ? extension        55 AA 00 03 00 61 04 00 99              AA 55 00 03 00 61 04 00 4F 58 00 02 F0
        ? name of the thumb  55 AA 00 03 00 62 20 00 7C              AA 55 00 03 00 62 20 00 50 58 53 52 * ..
        zero of all        55 AA 00 10 10 61 04 00 04 5A 52 1F AD  AA 55 00 10 10 61 01 00 00 7F
        how that went      55 AA 00 10 10 61 04 00 04 5A 52 1F AD; 55 AA 00 03 20 61 10 00 6D
            AA 55 00 03 20 61 10 00 02 03 01 *
        push               55 AA 00 10 17 00 01 00 01 D8           AA 55 00 10 17 00 01 00 00 D9
    """)
    facts = _ORCA_FACTS

    def __init__(
        self,
        *,
        side: Literal["right", "left"] = "right",
        serial: Annotated[str, Option("serial number of the hand, ASCII")] = "ORCA-0001",
    ):
        self._power_up(tuple(PARTS_BY_FINGER.values()), TIP_MODULES, fingertips())
        self._power_up_board("ORCA1.0-0abc")
        self.words: dict[bytes, str] = {b"ID": "", b"INFO": f";SIDE={side[0].upper()};HW=1;FW=1;SN={serial};BID=0"}
        self.ports = (Serial(baud=2_000_000, usb=USB(0x2F5D, 0x2202, serial=serial)),)
        self.heard, self.zeros, self.requests = b"", 0, 0

    def _blocks(self) -> Iterator[tuple[int, bytes]]:
        yield from super()._blocks()
        yield EXTENSION_REGISTER, b"OX\0\2"
        if self.zeros:
            yield STATUS_REGISTER, bytes([FINISHED, ZEROED, self.zeros])
        for slot, part in enumerate(self.models):
            yield NAME_REGISTERS + 0x20 * slot, f"PXSR-CMD{part}".encode("ascii")
        yield STATISTICS_REGISTER, (self.requests & 0xFFFFFFFF).to_bytes(4, "little")

    def accepts(self, request: Request) -> bool:
        """Count the request."""
        self.requests += 1
        return True

    def _write(self, register: int, data: bytes) -> Transmissions:
        if register == ZERO_REGISTER and len(data) == 4 and data.startswith(ZERO_ORDER):
            self.zeros = self.zeros % 0xFF + 1
            for slot in range(len(self.models)):
                if data[3] >> slot & 1:
                    self.set_zero(slot)
        return super()._write(register, data)

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer requests, which arrive in chunks of any size, and lines that ask for the identity."""
        outs, text, end = [], self.heard + data, 0
        for found in QUERY.finditer(text):
            outs.append(f"ORCA:SENSOR{self.words[found[1]]}\n".encode("ascii"))
            end = found.end()
        self.heard = text[end:][-10:]
        replies = super().receive(data, t_ns, port)
        self.counters["skipped_bytes"] -= sum(len(found[0]) for found in QUERY.finditer(text))
        return [*outs, *replies]


def _size(data: bytes) -> int | str:
    if len(data) < 8:
        return MORE
    count = 0 if data[3] == READ else int.from_bytes(data[6:8], "little")
    return MIN_REQUEST_BYTES + count if count <= MAX_WRITE_BYTES else "bad_length"
