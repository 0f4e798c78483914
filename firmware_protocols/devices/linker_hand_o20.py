"""LinkerHand O20: five fingertips of 12 x 6 taxels and seventeen motors, on CAN-FD.

Wire: CAN-FD, 1 and 5 Mbit/s, extended identifiers: eight bits of the hand (1 right, 2 left), eight of the register, a
bit for a write, twelve zeros. A read without data is answered under its own identifier; a write gets no answer. Numbers
are low byte first, one for each motor: four of the thumb (root, tip, abduction, rotation), three of each finger
(abduction, root, tip), wrist. Frames are padded with zeros.

    register  content
    00, 6E    model 10, serial number 24, software 8, hardware 8 ASCII, hand 1, unique id 12 bytes; 6E is kept
    01        calibration
    02        errors, a byte each; zeros clear them
    03, 04    positions [90/140 deg], speeds [0.732 rpm]
    06 .. 08  goals, speeds and torques, 0 .. 1000, to be set
    09 .. 12  touch: 09 thumb, 0B index ... unasked: 01 and the first 63 values; 0A, 0C ... the last nine; row by row
    13, 15    temperatures [deg C], a byte each; currents [mA]
    16        offsets of the joints, kept
    20, 21    limits of the currents [mA] and their times [ms]

Evidence: the vendor's ROS 2 driver, run over a stand-in for its adapter's library.

Try it: ``tactemu run linker_hand_o20 --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

import struct
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Column, Device, Identifier, Motors, Option, Refused, RegisterMap, Registers, Request,
    Transmissions, command, command_table, fact_table,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_touch import COUNTS_PER_NEWTON, FINGERS, pads

ID = Identifier("hhhhhhhhrrrrrrrrw000000000000", {"hand": "h", "register": "r", "write": "w"})
MAP = RegisterMap("""
    64    u1        calibration                                01
    128   u1 x 17   errors                                     02
    192   <i2 x 17  positions         r                        03
    256   <i2 x 17  speeds            r                        04
    384   <i2 x 17  goals                                      06
    448   <u2 x 17  goal_speeds       = 100                    07
    512   <u2 x 17  torques           0..1000  = 500           08
    1216  u1 x 17   temperatures      = 25  r                  13
    1344  u1 x 34   currents          r                        15: <i2 x 17, 0
    1408  u1 x 34   offsets           flash                    16: <i2 x 17
    2048  <u2 x 17  current_limits    = 220                    20
    2112  <u2 x 17  current_times     = 110                    21
""")
"""Registers, by 64 times their number."""
REGISTER_BYTES = 64
BY_NUMBER = {reg.address // REGISTER_BYTES: reg for reg in MAP.rows}
FIRST_TOUCH_REGISTER = 0x09
HANDS = {"right": 1, "left": 2}
LOWS = [0, 0, 0, 0, *[-30, 0, 0] * 2, *[-20, 0, 0] * 2, -1000]
HIGHS = [120, 150, 180, 130, *[30, 180, 180] * 2, *[20, 180, 180] * 2, 1000]
COUNTS_PER_S_PER_SPEED = 0.732 * 6 / (90 / 140)
DRIVER = "linker-bot/linkerhand-o20-ros2@a243428 core/canfd/linker_hand_o20_canfd.py"


class LinkerHandO20(Device[CanFrame]):
    """An O20, which transmits its touch unasked."""

    name = "linker_hand_o20"
    title = "LinkerHand O20, 5 fingertips 12x6"
    kind = "hand"
    rate_hz = 50.0
    columns = (Column(name="touch", low=0, high=255, assumed_per_unit=COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    sources = (DRIVER,)
    judge = "linker-bot/linkerhand-o20-ros2@a243428"
    documented = command_table(
        f"""
        ? information     00200000##1                       00200000##1 4C 48 4F 32 30 00 00 00 00 00 ..{{54}}
        ? errors          00204000##1                       00204000##1 {"00" * 20}
        ? positions       00206000##1                       00206000##1 {"00" * 48}
        ? speeds          00208000##1                       00208000##1 {"00" * 48}
        ? temperatures    00226000##1                       00226000##1 {"19" * 17} 00 00 00
        ? currents        0022A000##1                       0022A000##1 {"00" * 48}
        ? current limits  00240000##1                       00240000##1 {"DC 00" * 17} {"00" * 14}
        ? thumb's touch   00212000##1                       00212000##1 01 ..{{63}}
        ? the rest of it  00214000##1                       00214000##1 ..{{9}} 00 00 00
        torques           00211000##1 {"F4 01" * 17} {"00" * 14}
        goal speeds       0020F000##1 {"32 00" * 17} {"00" * 14}
        goals             0020D000##1 {"0A 00" * 17} {"00" * 14}
        clear errors      00205000##1 {"00" * 20}
        calibrate         00203000##1 01
        """,
        origin=DRIVER,
    )
    facts = fact_table(f"""
        stated touch: registers 09 to 12; each has a state, then 72 bytes in two frames: 12 rows of 6 @ {DRIVER}:87-96,
            1042-1108
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N; places as on other LinkerHands; the state 01 means that the
            sensor is fitted
        stated identity: the identity has six fields in 63 bytes; the side is 1 right, 2 left @ {DRIVER}:1690, 1825
        assumed identity: the contents of these fields
        stated configuration: the bits of the identifier; bit rates 1 and 5 Mbit/s @ {DRIVER}:257, 466-476
        stated configuration: registers, units and limits of the joints @ {DRIVER}:73-108, 130-163
        stated configuration: registers 16 and 6E survive power-off @ {DRIVER}:101, 105
        assumed configuration: writes get no answer; values out of range are refused; after power-up positions are 0,
            the speed 100, the torque 500; torques, calibration, offsets and limits have no effect; errors and currents
            are 0, temperatures 25 deg C
        assumed timing: touch is sent 50 times a second from power-up on; the hand answers at once
    """, looked="linker-bot/linkerhand-o20-ros2@a243428, all files")  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["right", "left"], Option("which hand; a part of the identifiers")] = "right",
        serial_number: Annotated[str, Option("serial number of at most 24 characters of ASCII")] = "LHO20-001-R-0001",
    ):
        self.hand = HANDS[side]
        ident, mask = ID.filter(hand=self.hand)
        self.ports = (Can(data_bitrate=5_000_000, filters=((ident, mask),)),)
        self.layout = pads((12, 6))
        texts = (text.encode("ascii") for text in ("LHO20", serial_number, "V1.0.0", "V1.0.0"))
        delivered = struct.pack("<10s24s8s8sB12s", *texts, self.hand, bytes(range(12)))
        self.information = self.flash.get("information", delivered)
        kept = {name: values for name, values in self.flash.items() if name in MAP.by_name}
        self.registers = Registers(MAP, kept=kept)
        self.packets = CanRequests(ID, by="register write", is_fd=True)
        self.motors = Motors(np.zeros(17), low=LOWS, high=HIGHS, time_constant_s=0.0, speed_limit=self._speeds())
        self.counts = np.zeros(len(self.layout), np.int64)

    def _speeds(self) -> np.ndarray:
        return np.array(self.registers.all("goal_speeds")) * COUNTS_PER_S_PER_SPEED

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return two frames for each finger."""
        registers = range(FIRST_TOUCH_REGISTER, FIRST_TOUCH_REGISTER + 2 * len(FINGERS))
        return [self.packets.frame(ID.of(hand=self.hand, register=k, write=0), self._touch(k)) for k in registers]

    def _touch(self, register: int) -> bytes:
        finger, part = divmod(register - FIRST_TOUCH_REGISTER, 2)
        taxels = self.layout.on_wire(self.counts)[self.layout.patches[finger].taxels]
        content = b"\x01" + taxels.astype(np.uint8).tobytes()
        return content[REGISTER_BYTES:] if part else content[:REGISTER_BYTES]

    def accepts(self, request: Request) -> bool:
        """Return True for a request to this hand."""
        return request.hand == self.hand

    @command(on=[(k, 0) for k in range(FIRST_TOUCH_REGISTER, FIRST_TOUCH_REGISTER + 2 * len(FINGERS))], data="")
    def read_touch(self, request: Request):
        """Return a part of a matrix."""
        return self._touch(request.register)

    @command(on=[(0x00, 0), (0x6E, 0)], data="")
    def read_information(self, request: Request):
        """Return what the hand is."""
        return self.information

    @command(on=[(0x6E, 1)], data="63s*")
    def write_information(self, request: Request):
        """Keep what the hand is."""
        self.information = self.flash["information"] = request.value
        return ()

    @command(on=[(k, 0) for k in BY_NUMBER], data="")
    def read_register(self, request: Request):
        """Return a register."""
        self.registers["positions"] = self.motors.positions(request.t_ns)
        self.registers["speeds"] = self.motors.velocities(request.t_ns) / COUNTS_PER_S_PER_SPEED
        reg = BY_NUMBER[request.register]
        return self.registers.read(reg.address, reg.end - reg.address)

    @command(on=[(k, 1) for k in BY_NUMBER], data="*")
    def write_register(self, request: Request):
        """Set a register."""
        reg = BY_NUMBER[request.register]
        if len(request.data) < reg.end - reg.address:
            raise Refused("value")
        written = self.registers.write(reg.address, request.data[: reg.end - reg.address])
        if "goals" in written:
            self.motors.go(np.array(self.registers.all("goals"), float), request.t_ns)
        if "goal_speeds" in written:
            self.motors.limit_speed(self._speeds(), request.t_ns)
        self.flash.update({name: self.registers.all(name) for name in written if MAP.by_name[name].flash})
        return ()
