"""LinkerHand O30: five fingertips of 12 x 6 taxels and twenty joints, by objects on CAN-FD.

Wire: CAN-FD, 1 Mbit/s, standard identifiers: 1 a right hand, 2 a left one (register ``id``), and 400 more in an answer.
A request is object, offset, number of bytes, low byte first, and for a write its bytes, 61 at most. The answer is the
request with the bytes, also to a write. Bit 7 of the object asks for what was set instead of what is. A request that
cannot be obeyed is answered by the object 4F with an error: 01 no such object, 04 not writable, 08 length, 40 value.

    object   content
    01       positions 0 to 255, a byte each: five of roll, yaw, root 1, root 2 and tip, thumb first
    02 06 08 speeds, torques, times of a motion; 04 07 currents and temperatures
    0C 0D    joints that are enabled; what they can, 0B where there is one
    31       touch: type, unit, range, rows, columns, number of bytes; 2D selects a finger, 1 thumb .. 5 little finger
    32       the matrix of that finger, row by row
    35       configuration: 00 id, from the next power-up, 18 mode, 1E with 1 keeps it
    41       product, in texts: 00 model, 39 serial number, 59 protocol, D9 side
    42       45 heartbeat, 49 side, F0 left, 0F right, 4A kind of touch sensor

Evidence: the vendor's driver for protocol 0.0.2, run.

Try it: ``tactemu run linker_hand_o30 --port can:socketcan:vcan0``, then ``cansend vcan0 001##0410004``.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Column, Device, Identifier, Motors, Option, Refused, RegisterMap, Registers, Request,
    Transmissions, command, command_table, fact_table,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_touch import COUNTS_PER_NEWTON, pads

ID = Identifier("0hhhhhhhhhh", {"hand": "h"})
MAP = RegisterMap("""
    256    u1 x 36   positions                                 01
    512    u1 x 36   speeds          = 128                     02
    1024   u1 x 36   currents        r                         04
    1536   u1 x 36   torques         = 255                     06
    1792   u1 x 36   temperatures    = 25  r                   07
    2048   u1 x 36   times                                     08
    3072   u1 x 36   enabled                                   0C
    3328   u1 x 36   abilities       r                         0D
    12544  u1 x 32   type            r                         31
    12576  u1 x 8    unit            r
    12584  u1        range           = 255  r
    12585  u1        rows            = 12  r
    12586  u1        columns         = 6  r
    12587  <u2       length          = 72  r
    12589  u1        finger          1..5  = 1
    12800  u1 x 72   touch           r                         32
    13568  <u2       id              1..1022  = 1  flash       35
    13592  u1        mode            1..9  = 1
    13598  u1        save            0..1
    16640  u1 x 241  product         r                         41
    16965  <u4       heartbeat       r                         42
    16969  u1        side            r
    16970  u1        sensor          = 2  r
    20224  u1        error           r                         4F
""")
"""Objects, by 256 times their number."""
OBJECT_BYTES = 256
OBJECTS = {reg.address // OBJECT_BYTES for reg in MAP.rows}
ANSWER, SETTING, ERROR_OBJECT, HEADER_BYTES = 0x400, 0x80, 0x4F, 3
NO_OBJECT, ERRORS = 0x01, {"address": 0x08, "access": 0x04, "value": 0x40}
TOUCH_OBJECT, MATRIX_BYTES = 0x32, 72
SLOTS = 25
MISSING = (1, 2, 3, 4, 15)
PRESENT, ENABLED = 0x0B, 0x04
STROKE_S = 0.5
TEXTS = {0x00: "O30i", 0x10: "12V~24V", 0x59: "HOP", 0x61: "0.0.2", 0x79: "V1.0.0", 0xB9: "CAN"}
DRIVER = "linker-bot/linkerhand-l30-sdk@0103fc5 core/linker_hand_o30i_control.py"


class LinkerHandO30(Device[CanFrame]):
    """An O30, whose host selects a finger and reads its matrix."""

    name = "linker_hand_o30"
    title = "LinkerHand O30, 5 fingertips 12x6"
    kind = "hand"
    columns = (Column(name="touch", low=0, high=255, assumed_per_unit=COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    sources = (DRIVER,)
    judge = "linker-bot/linkerhand-l30-sdk@0103fc5"
    documented = command_table(
        f"""
        ? model         001##0410004       401##1410004 4F333069
        ? side          001##0424901       401##1424901 0F
        ? positions     001##0010019       401##1010019 {"00" * 29}
        ? abilities     001##00D0019       401##10D0019 0B00000000 {"0B" * 10} 00 {"0B" * 9} {"00" * 4}
        ? matrix        001##032003D       401##132003D ..{{61}}
        ? its length    001##0312B02       401##1312B02 4800
        ring finger     001##0312D01 04    401##1312D01 04
        a finger's tip  001##0011501 40    401##1011501 40
        mode 1          001##0351801 01    401##1351801 01
        no object       001##0600001       401##14F0001 01
        """,
        origin=DRIVER,
    )
    facts = fact_table(f"""
        stated touch: object 31 selects a finger and has its rows, columns and length; object 32 is the matrix, row by
            row @ {DRIVER}:1213-1305
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N; matrices are 12 x 6, as on the other hands, one byte per taxel;
            there is no palm; all parts of a matrix show the time of the first one
        stated identity: the texts and their places in protocol 0.0.2; the side is 0F right, F0 left @ {DRIVER}:141-163,
            1371
        assumed identity: all texts except O30i, 12V~24V, HOP and 0.0.2
        stated configuration: the header, the answers, the errors and the objects @ {DRIVER}:8-30, 94-128, 206-215
        stated configuration: twenty joints in 25 places; a write is answered with what was written, as the driver's
            comments say @ {DRIVER}:41-81, 801-825
        assumed configuration: joints move within {STROKE_S} s; speeds, torques, times and modes have no effect; objects
            03, 05, 20 to 30 and 36 to 3A are not modelled; a new id takes effect at the next power-up, if saved
        assumed timing: touch is sampled 100 times a second; the hand answers at once; the heartbeat counts milliseconds
    """, looked="linker-bot/linkerhand-l30-sdk@0103fc5, all files")  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["right", "left"], Option("which hand; its id as delivered")] = "right",
        serial_number: Annotated[str, Option("serial number of at most 32 characters of ASCII")] = "LHO30-001-R-0001",
    ):
        self.layout = pads((12, 6))
        self.registers = Registers(MAP, kept={"id": 1 if side == "right" else 2, **self.flash})
        product = bytearray(241)
        for at, text in {**TEXTS, 0x39: serial_number, 0xD9: side.upper()}.items():
            product[at : at + len(text)] = text.encode("ascii")
        self.registers["product"], self.registers["type"] = bytes(product), b"HUAWEIKE"
        self.registers["side"] = 0x0F if side == "right" else 0xF0
        self.registers["abilities"] = [PRESENT * (k not in MISSING) for k in range(SLOTS)] + [0] * 11
        self.hand = self.registers["id"]
        self.ports = (Can(data_bitrate=1_000_000, filters=(ID.filter(hand=self.hand),)),)
        self.packets = CanRequests(ID, by="hand", is_fd=True)
        self.motors = Motors(np.zeros(SLOTS), low=0, high=255, time_constant_s=0.0, speed_limit=255 / STROKE_S)
        self.counts = np.zeros(len(self.layout), np.int64)
        self.is_read = False
        """True from the first part of a matrix to its last one."""

    def accepts(self, request: Request) -> bool:
        """Return True for a request to this hand."""
        return request.hand == self.hand

    @command(on=range(1, 0x3FF), data="3s*")
    def access(self, request: Request):
        """Read an object, or write to it."""
        number, offset, size = request.data[:HEADER_BYTES]
        wants_setting, number = bool(number & SETTING), number & ~SETTING
        body, address = request.data[HEADER_BYTES : HEADER_BYTES + size], OBJECT_BYTES * number + offset
        if number not in OBJECTS:
            raise Refused("function")
        if size > 61 or (body and len(body) < size):
            raise Refused("address")
        self._update(request.t_ns, wants_setting or bool(body))
        if number == TOUCH_OBJECT:
            self._show(offset, offset + size)
        if body:
            self._apply(self.registers.write(address, body), request.t_ns)
        else:
            body = self.registers.read(address, size)
        return [self._frame(request, request.data[:HEADER_BYTES] + body)]

    def _update(self, t_ns: int, wants_setting: bool) -> None:
        """Set the registers that follow the state: positions, or those that were set, the heartbeat."""
        positions = self.motors.goals if wants_setting else self.motors.positions(t_ns)
        self.registers["positions"] = [*positions, *[0] * 11]
        self.registers["heartbeat"] = t_ns // 1_000_000 & 0xFFFFFFFF

    def _show(self, start: int, end: int) -> None:
        """Show the matrix of the selected finger: parts that are read one after the other are of one time."""
        if start == 0 or not self.is_read:
            patch = self.layout.patches[self.registers["finger"] - 1]
            self.registers["touch"] = self.layout.on_wire(self.counts)[patch.taxels].astype(np.uint8).tobytes()
        self.is_read = end < MATRIX_BYTES

    def _apply(self, written: Sequence[str], t_ns: int) -> None:
        if "positions" in written:
            moves = np.array(self.registers.all("enabled"))[:SLOTS] & ENABLED > 0
            moves[list(MISSING)] = False
            self.motors.go(np.where(moves, self.registers.all("positions")[:SLOTS], np.nan), t_ns)
        if self.registers["save"]:
            self.registers["save"] = 0
            self.flash.update(self.registers.kept())

    def _frame(self, request: Request, data: bytes) -> CanFrame:
        return self.packets.frame(ANSWER | request.id, data)

    def refused(self, request: Request, why: str) -> Transmissions[CanFrame]:
        """Return an answer with an error; a frame without a header gets none."""
        if why == "bad_length":
            return ()
        error = bytes([ERROR_OBJECT, 0, 1, ERRORS.get(request.why, NO_OBJECT)])
        return [self._frame(request, error)]
