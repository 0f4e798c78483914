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
    MORE, Frame, Option, Packets, Refused, Request, Sent, Serial, Transmissions, command, command_table, fact_table,
)  # fmt: skip
from firmware_protocols.devices.paxini_modules import GAP_NS, TAXELS_BY_MODEL, Model, Px6axDevice

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
FIXED_BYTE = 0x0E
TAXEL_REGION = 0x7B
MAIN_COMMANDS = (0x60, 0x70)
ZERO_CONFIG = b"\x03\x01"
MODES = (1, 2, 5)
MAX_DATA_BYTES = 64
STATUS_DONE = b"\0"
"""The state of the module in the answer to a zero, beside any error byte."""

OK = 0
BAD_LENGTH = 1
BAD_MAIN = 3
BAD_SUB = 4
BAD_PARAMETER = 6
NO_DATA = 7
ERRORS = {"bad_checksum": 2, "too_long": 5, "refused": BAD_PARAMETER}


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
        stated configuration: the modes and ports of each model @ {PDF} table 1-0
        stated configuration: the answer to the zero command has error 06 @ {DRIVER} l.165
        stated identity: the version is a text of 29 bytes @ {PDF} (1d 00)
        stated identity: its port is /dev/ttyACM0 @ {DRIVER} paxini.yaml, README
        stated touch: an L5325 is read as 120 taxels from address 1038 on; x and y are int8, z is uint8 @ {DRIVER}
            l.181-208
        assumed identity: the text of the version; USB ids @ {PDF}; {DRIVER} whole
        assumed touch: places: rows on a flat pad of the size that the model's name states; forces are in 0.1 N @ {PDF};
            {DRIVER} whole
        assumed touch: other models have as many taxels as their GEN3 versions @ {PDF} (names a protocol of the module)
        assumed configuration: a wrong tail or first byte is reported as a wrong length; a port without a module reports
            no data @ {PDF}
        assumed configuration: mode 5 after power-up; every port has one module @ {PDF}; {DRIVER} whole
        assumed timing: a change of mode takes 0.5 s (2 s at most is stated) @ {PDF}
        assumed timing: an incomplete request is discarded after 50 ms @ {PDF}
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
        self.packets = Packets(REQUEST, _size, by="main sub", counters=self.counters, gap_ns=GAP_NS, broken=True)

    @command(on=[(0x60, 0xA001)], data="")
    def read_version(self, request: Request):
        """Return the version."""
        return self.version

    @command(on=[(0x70, 0xC00C)], data="B")
    def set_mode(self, request: Request):
        """Change the mode, which takes a while."""
        if request.value not in MODES:
            raise Refused("value")
        before, self.mode = self.mode, request.value
        return self._answer(request, delay_ns=self.mode_time_ns if self.mode != before else 0)

    @command(on=[(0x70, 0xC00D)], data="")
    def get_mode(self, request: Request):
        """Return the mode."""
        return bytes([self.mode])

    @command(on=[(0x70, 0xB10A)], data="B")
    def select_port(self, request: Request):
        """Select the port that is read and configured."""
        self.selected = request.value

    @command(on=[(0x70, 0xC006)], data="<BHH")
    def read(self, request: Request):
        """Return memory of the selected module."""
        region, start, count = request.values
        if (module := self.module_at(self.selected)) is None:
            raise Refused("failure")
        if region != TAXEL_REGION or (content := self.memory(module, start, count)) is None:
            raise Refused("address")
        return b"\0" + request.data + content

    @command(on=[(0x70, 0xB002)], data="2s")
    def write_config(self, request: Request):
        """Set the zero of the selected module."""
        if (module := self.module_at(self.selected)) is None or request.value != ZERO_CONFIG:
            self.counters["refused"] += 1
            return self._answer(request, b"\x01", error=NO_DATA if module is None else BAD_PARAMETER)
        self.set_zero(module)
        return self._answer(request, STATUS_DONE, error=self.zero_error)

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the answer to a request that was obeyed."""
        return self._answer(request, content)

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return an answer with an error, also to a broken request."""
        error = NO_DATA if request.why == "failure" else ERRORS.get(why, BAD_LENGTH)
        if why == "unknown_command":
            error = BAD_SUB if request.main in MAIN_COMMANDS else BAD_MAIN
        return self._answer(request, error=error)

    def _answer(self, request: Request, content: bytes = b"", *, error: int = OK, delay_ns: int = 0) -> Transmissions:
        index, main, sub = struct.unpack_from(">BBH", request.packet, 5)
        return [Sent(REPLY.pack(index=index, main=main, sub=sub, error=error, data=content), delay_ns=delay_ns)]


def _size(data: bytes) -> int | str:
    if len(data) < 11:
        return MORE
    length = int.from_bytes(data[9:11], "little")
    if data[4] != FIXED_BYTE:
        return "bad_length"
    return 16 + length if length <= MAX_DATA_BYTES else "too_long"
