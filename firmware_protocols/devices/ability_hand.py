r"""PSYONIC Ability Hand: thirty touch sensors on five fingertips, and six motors, on one UART.

Wire: 8N1 at one of 18 speeds, 460800 as delivered. The hand transmits only in reply, once per command. Each message
ends in the byte that makes its byte sum 0, and is stuffed as in PPP (7E, 7D and 7E inside as 7D (x ^ 20), 7E). With
stuffing off, as delivered, messages go as they are and a silence ends one.

    header   payload           scale
    1v       six positions     32767 / 150 deg
    2v       six velocities    32767 / 3000 deg/s
    3v       six currents      620.606079 / A
    4v       six duties        3546 = 100 %
    Av       ignored           read only
    DA       int32 register    answered by a register reply
    DE       register, value   answered by a register reply
    1D       grip, speed
    09       none              reset: no reply
    07, 08   none              Bluetooth on, off
    C2, C3   none
    7C       none

v = 0, 1, 2 selects the reply. A message with a good sum that selects none, or whose header is unknown, is answered in
the last format; a control message without its six targets moves nothing and is answered in the format that it selects.
A message with a wrong sum or address gets no reply. After 300 ms without a command the hand leaves API control.

Numbers are int16 little-endian, positions, currents and duties in replies as in commands. A velocity in a reply is the
rotor's: 4 per rad/s, behind gears of 649 (fingers, thumb flexor) and 162.45 (thumb rotator). Joints: index, middle,
ring, pinky, thumb flexor, thumb rotator. Touch: six sites each of index, middle, ring, pinky, thumb, little-endian, two
in three bytes: v0 = b0 | (b1 & 0F) << 8, v1 = b1 >> 4 | b2 << 4.

Force of a touch value D: V = 3.3 D / 4096, R = 33000 / V + 10000, F = 121591 / R + 0.878894 N, and 0 for D = 0. So no
site reads between 0 and 0.88 N, and it saturates at 6.96 N.

Try it: ``tactemu run ability_hand``, then ``AHSerialClient(port=..., baud_rate=460800)``.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Frame, Motors, Option, Ppp, Reading, Request, Restart, Serial, Transmissions, command,
    command_table, fact_table, grid_layout, pack_12_bits, place, ppp, quantize, stack,
)  # fmt: skip

MESSAGE = Frame("""
    command
    0     u1       address       50
    1     u1       header
    2     bytes    payload
    last  lrc8     sum
""")
TOUCH_REPLY = Frame("""
    reply 0 and 1
    0     u1               header        of the command
    1     <i2 x 6 x 2      joints        position and current (0) or velocity (1) of each
    25    bytes x 45       touch         30 values of 12 bits
    70    00               hot_cold      mask
    last  lrc8             sum
""")
JOINT_REPLY = Frame("""
    reply 2
    0     u1               header        of the command
    1     <i2 x 6 x 2      joints        position and current of each
    25    <i2 x 6          velocities
    37    00               hot_cold      mask
    last  lrc8             sum
""")
REGISTER_REPLY = Frame("""
    register reply
    0     <u4              status        4E11FEA4 done, FA17FFFF failed
    4     <i4              value
    last  lrc8             sum
""")

POSITION, CURRENT, READ_ONLY = 0x10, 0x30, 0xA0
DEG_PER_S_PER_AMPERE = 200.0
DEG_PER_S_AT_FULL_DUTY = 300.0
NM_PER_AMPERE = 0.6
STRENGTH_NM = 1.5
COUNTS_PER_AMPERE = 620.606079
DEG_PER_S_PER_COUNT = {
    0x20: 3000 / 32767, 0x30: DEG_PER_S_PER_AMPERE / COUNTS_PER_AMPERE, 0x40: DEG_PER_S_AT_FULL_DUTY / 3546,
}  # fmt: skip
"""Speed per count of a target [deg/s], by the high nibble of the header."""
DONE, FAILED = 0x4E11FEA4, 0xFA17FFFF
API_TIMEOUT_NS = 300_000_000
SILENCE_NS = 1_000_000
LONGEST_MESSAGE_BYTES = 32

JOINTS = ("index", "middle", "ring", "pinky", "thumb flexor", "thumb rotator")
OPEN_DEG = np.array([15.0, 15.0, 15.0, 15.0, 15.0, -15.0])
LOW_STOPS_DEG = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -100.0])
HIGH_STOPS_DEG = np.array([100.0, 100.0, 100.0, 100.0, 100.0, 0.0])
GEAR_RATIOS = np.array([649, 649, 649, 649, 649, 162.45])
COUNTS_PER_DEG = 32767 / 150
VELOCITY_COUNTS_PER_DEG_S = 4 * np.deg2rad(GEAR_RATIOS)
CURRENT_COUNTS_PER_DEG_S = COUNTS_PER_AMPERE / DEG_PER_S_PER_AMPERE

FINGERTIP_CENTRES_M = {
    # name: centre of the pad in the palm's frame [m]
    "index": (0.033, 0.09, 0.0),
    "middle": (0.011, 0.10, 0.0),
    "ring": (-0.011, 0.095, 0.0),
    "pinky": (-0.033, 0.08, 0.0),
    "thumb": (0.06, 0.03, 0.0),
}
GAINS = (3, 4, 1, 21, 0, 10, 1, 1773, 4, 0)
ROTATOR_GAINS = (500, 0, 5, 3, 14, 6, 1, 1773, 8, 0)
UNIQUE_ID_REGISTERS = (0x3D, 0x3E)
READ_ONLY_REGISTERS = {*range(0x0A, UNIQUE_ID_REGISTERS[0], 10), *UNIQUE_ID_REGISTERS}
"""The registers of each joint's output saturation and of the unique id; the host cannot write them."""
Baud = Literal[
    460800, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 31250, 38400, 56000, 57500, 76800, 115200, 230400, 250000,
    921600, 1000000,
]  # fmt: skip


API = "psyonicinc/ability-hand-api@34c9a93 "
ICD = f"{API}Documentation/ABILITY-HAND-ICD.pdf"
LOOKED = f"{ICD}; all of {API}python"
_SDK, _ICD = "ability-hand 0.2.2 ah_api.py", "ABILITY-HAND-ICD.pdf"


class AbilityHand(Device):
    """An Ability Hand in API mode."""

    name = "ability_hand"
    title = "PSYONIC Ability Hand"
    kind = "hand"
    rate_hz = 250.0
    columns = (Column(name="touch", unit="N", low=0, high=4095, push=1),)
    evidence = ("vendor document", "driver")
    sources = (
        f"{API}Documentation/ABILITY-HAND-ICD.pdf 3.3.3, 3.4.3, 3.4.6, 3.5.3",
        f"{API}python/ah_wrapper (ability-hand 0.2.2): ah_api.py, ah_parser.py, ppp_stuffing.py, serial_connection.py",
        f"{API}python/ah_examples/write_registers.py, send_misc_msg.py",
    )
    judge = "psyonicinc/ability-hand-api@34c9a93, ability-hand 0.2.2"
    documented = command_table(
        f"""
        @ {_SDK}
        position, reply 0    50 10 99 19 99 19 99 19 99 19 99 19 67 E6 D9  10 *
        position, reply 1    50 11 99 19 99 19 99 19 99 19 99 19 67 E6 D8  11 *
        position, reply 2    50 12 99 19 99 19 99 19 99 19 99 19 67 E6 D7  12 *
        velocity, reply 0    50 20 DA 00 DA 00 DA 00 DA 00 DA 00 26 FF 29  20 *
        velocity, reply 1    50 21 DA 00 DA 00 DA 00 DA 00 DA 00 26 FF 28  21 *
        velocity, reply 2    50 22 DA 00 DA 00 DA 00 DA 00 DA 00 26 FF 27  22 *
        current, reply 0     50 30 36 01 36 01 36 01 36 01 36 01 CA FE A5  30 *
        current, reply 1     50 31 36 01 36 01 36 01 36 01 36 01 CA FE A4  31 *
        current, reply 2     50 32 36 01 36 01 36 01 36 01 36 01 CA FE A3  32 *
        duty, reply 0        50 40 ED 06 ED 06 ED 06 ED 06 ED 06 13 F9 A5  40 *
        duty, reply 1        50 41 ED 06 ED 06 ED 06 ED 06 ED 06 13 F9 A4  41 *
        duty, reply 2        50 42 ED 06 ED 06 ED 06 ED 06 ED 06 13 F9 A3  42 *
        ? read only, reply 0  50 A0 10  A0 *
        ? read only, reply 1  50 A1 0F  A1 *
        ? read only, reply 2  50 A2 0E  A2 *
        grip                  50 1D 01 FF 93  .. *
        reset                 50 09 A7
        @ {_ICD}
        two targets of six    50 11 01 02 03 04 95  11 *
        Bluetooth on          50 07 A9  .. *
        Bluetooth off         50 08 A8  .. *
        setting C2            50 C2 EE  .. *
        unknown header        50 99 17  .. *
        ? read register 8     50 DA 08 00 00 00 CE              A4 FE 11 4E ED 06 00 00 0C
        write register 1      50 DE 01 00 00 00 03 00 00 00 CE  A4 FE 11 4E 03 00 00 00 FC
        write the unique id   50 DE 3D 00 00 00 07 00 00 00 8E  FF FF 17 FA 00 00 00 00 F1
        """,
        head="7E",
        tail="7E",
    )
    documented_with = ("baud",)
    facts = fact_table(f"""
        stated touch: each touch site has 12 bits, and two sites share three bytes; the formula that turns counts into
            force @ {API}python/ah_wrapper/ah_parser.py:85, 53
        stated touch: the constants of the formula are placeholders @ {ICD} 3.5.3
        assumed touch: each fingertip has six sites, 3 x 2, row by row, 7 mm apart; all pads lie in one plane with
            normal +z
        stated identity: the unique id is in the two registers after those of the joints @ {ICD};
            {API}python/ah_examples/write_registers.py
        assumed identity: the unique id is 0
        stated configuration: the line speeds, of which the driver tries 460800 first; address 50 @
            {API}python/ah_wrapper/serial_connection.py:44
        stated configuration: the values of the registers as delivered @ {API}python/ah_examples/write_registers.py:27
        assumed configuration: registers have no effect and are lost at power-off; a reply that reports a failure has
            the register's value
        stated configuration: velocities in replies are those of the rotor, 4 counts per rad/s @ {ICD} 3.4.3
        assumed configuration: a control message that lacks some of its six targets moves nothing; commands of the
            Bluetooth interface are answered
        stated configuration: the vendor's program does not wait for a reset to end @
            {API}python/ah_examples/send_misc_msg.py:27
        assumed configuration: a motor follows its target with a time constant of 0.1 s, turns at 200 deg/s per A and at
            300 deg/s at full duty, and stops at 0 and 100 deg
        assumed configuration: in a physics engine a motor has {NM_PER_AMPERE} Nm/A at the joint, at most {STRENGTH_NM}
            Nm
        assumed configuration: grip 0 opens all fingers, every other grip closes them; the hot/cold mask is 0; the reply
            format after power-up is 10
        assumed configuration: commands C2, C3 and 7C have no effect; fast mode is not modelled
        stated timing: the hand leaves API control 300 ms after the last command @ {ICD} 3.3.3
        assumed timing: when it leaves API control, the joints hold their positions; touch is sampled 250 times a second
        assumed timing: without byte stuffing, a silence of 1 ms on the line ends a message
    """, looked=LOOKED)  # fmt: skip

    def __init__(
        self,
        *,
        address: Annotated[int, Option("first byte of the commands for this hand", low=0, high=255)] = 0x50,
        baud: Annotated[Baud, Option("line speed that is set in the hand")] = 460800,
        stuffing: Annotated[
            bool, Option("settings We46 and We47, which the SDK needs; without them a silence ends a message")
        ] = True,
    ):
        self.address, self.stuffing = address, stuffing
        self.ports = (Serial(baud=baud),)
        pads = (grid_layout(3, 2, 0.007, name=name, link=name) for name in FINGERTIP_CENTRES_M)
        self.layout = stack(*(place(pad, centre) for pad, centre in zip(pads, FINGERTIP_CENTRES_M.values())))
        self.motors = Motors(
            OPEN_DEG, low=LOW_STOPS_DEG, high=HIGH_STOPS_DEG, time_constant_s=0.1, names=JOINTS, unit=np.deg2rad(1),
            strength=STRENGTH_NM,
        )  # fmt: skip
        self.currents: np.ndarray | None = None
        """The commanded currents in current mode [counts], even at the stops; None in other modes."""
        self.counts = np.zeros(len(self.layout), np.int64)
        self.registers = dict(enumerate([*GAINS * 5, *ROTATOR_GAINS, *[0] * len(UNIQUE_ID_REGISTERS), 0], 1))
        self.packets = Ppp(MESSAGE, by="header", counters=self.counters, longest=LONGEST_MESSAGE_BYTES)
        self.heard = b""
        """The unfinished message, without stuffing."""
        self.format = POSITION
        """The header of the last message that selected a reply."""
        self.commanded_ns = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return 12-bit touch values, shape ``(30,)``."""
        self.counts = touch_counts(self.layout.push(reading["force"]))
        return self.counts

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angles of the six joints [rad], by name."""
        self._hold_if_left_alone(t_ns)
        return self.motors.joints(t_ns)

    # -- commands --------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey messages, which arrive in chunks of any size."""
        if self.stuffing:
            return super().receive(data, t_ns, port)
        self.heard = (self.heard + data)[: LONGEST_MESSAGE_BYTES + 1]
        self.wake_ns = t_ns + SILENCE_NS
        return ()

    def wake(self, t_ns: int) -> Transmissions:
        """Obey the message that a silence has ended, without stuffing."""
        content, self.heard = self.heard, b""
        return self.obey(content, t_ns)

    def accepts(self, request: Request) -> bool:
        """Return True for the address of this hand."""
        return request.address == self.address

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return a register reply, or one in the last selected format."""
        self._hear(request.t_ns)
        frame = content or self._reply(request.t_ns)
        return [ppp(frame) if self.stuffing else frame]

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return a reply in the last selected format."""
        return self.reply(request, b"")

    def _hear(self, t_ns: int) -> None:
        self._hold_if_left_alone(t_ns)
        self.commanded_ns = t_ns

    def _hold_if_left_alone(self, t_ns: int) -> None:
        """Hold the joints where they were 300 ms after the last command, if none has followed."""
        if t_ns - self.commanded_ns > API_TIMEOUT_NS:
            self.motors.hold(self.commanded_ns + API_TIMEOUT_NS)
            self.currents = None

    @command(on=[kind + reply for kind in (POSITION, *DEG_PER_S_PER_COUNT, READ_ONLY) for reply in range(3)], data="*")
    def control(self, request: Request):
        """Select a reply, and move."""
        self._hear(request.t_ns)
        self.format, kind = request.header, request.header & 0xF0
        if kind != READ_ONLY and len(request.payload) == 12:
            self._move(kind, np.frombuffer(request.payload, "<i2"), request.t_ns)

    @command(on=0xDA, data="<i")
    def read_register(self, request: Request):
        """Return a register."""
        return self._register(request.value)

    @command(on=0xDE, data="<ii")
    def write_register(self, request: Request):
        """Write a register and return it."""
        return self._register(*request.values)

    @command(on=0x1D, data="BB")
    def grip(self, request: Request):
        """Open, or close all fingers."""
        self._hear(request.t_ns)
        self.currents = None
        closed = np.where(HIGH_STOPS_DEG > 0, 0.6 * HIGH_STOPS_DEG, -60.0)
        self.motors.go(closed if request.value else OPEN_DEG, request.t_ns)

    @command(on=(0x07, 0x08, 0xC2, 0xC3, 0x7C), data="*")
    def other(self, request: Request):
        """Change nothing."""

    @command(on=0x09, data="*")
    def reset(self, request: Request):
        """Restart."""
        return [Restart()]

    def _move(self, kind: int, targets: np.ndarray, t_ns: int) -> None:
        if kind == POSITION:
            self.motors.go(targets / COUNTS_PER_DEG, t_ns)
        elif kind == CURRENT and self.motors.is_in_engine:
            self.motors.drive_by_force(targets / COUNTS_PER_AMPERE * NM_PER_AMPERE, t_ns)
        else:
            self.motors.drive(targets * DEG_PER_S_PER_COUNT[kind], t_ns)
        self.currents = targets if kind == CURRENT else None

    def _register(self, register: int, value: int | None = None) -> bytes:
        known = register in self.registers
        done = known and (value is None or register not in READ_ONLY_REGISTERS)
        if done and value is not None:
            self.registers[register] = value
        return REGISTER_REPLY.pack(status=DONE if done else FAILED, value=self.registers.get(register, 0))

    def _reply(self, t_ns: int) -> bytes:
        """Return a reply in the last selected format."""
        variant, speeds = self.format & 0x0F, self.motors.velocities(t_ns)
        velocities = _int16(speeds, VELOCITY_COUNTS_PER_DEG_S)
        joints = np.empty((len(speeds), 2), np.int64)
        joints[:, 0] = _int16(self.motors.positions(t_ns), COUNTS_PER_DEG)
        if variant == 1:
            joints[:, 1] = velocities
        elif self.motors.is_in_engine:
            joints[:, 1] = _int16(self.motors.forces, COUNTS_PER_AMPERE / NM_PER_AMPERE)
        else:
            joints[:, 1] = _int16(speeds, CURRENT_COUNTS_PER_DEG_S) if self.currents is None else self.currents
        if variant == 2:
            return JOINT_REPLY.pack(header=self.format, joints=joints, velocities=velocities)
        touch = pack_12_bits(self.layout.on_wire(self.counts))
        return TOUCH_REPLY.pack(header=self.format, joints=joints, touch=touch)


def touch_counts(force: np.ndarray) -> np.ndarray:
    """Return the touch values that stand for ``force`` [N] in the documented formula, 0..4095."""
    excess = np.maximum(force - 0.878894, 1e-9)
    volts = 33000.0 / np.maximum(121591.0 / excess - 10000.0, 1e-3)
    return np.where(force > 0.878894, quantize(volts, 4096 / 3.3, 0, 4095), 0)


def _int16(values: np.ndarray, counts_per_unit: float | np.ndarray) -> np.ndarray:
    return quantize(values, counts_per_unit, -0x8000, 0x7FFF)
