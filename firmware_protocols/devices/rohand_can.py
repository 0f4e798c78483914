"""OYMotion ROHand over CAN, or over a UART with the same packets: dots in its fingers and palm, and six motors.

Wire: classic CAN, 1 Mbit/s (250 and 500 kbit/s, too). A ``PACKET`` is cut into frames of eight bytes, under the number
of the receiver as a standard id: the hand is 2, the host 1. Option ``line=uart``: 115200 8N1, the packets as they are.

    command  data                     answer
    00       -                        minor and major version of the protocol
    01       -                        firmware: revision, ``<u2``, minor, major
    02       -                        hardware: type, version, boot loader's version
    08       part                     part, number of dots, a byte each; parts 0 thumb to 4 little finger, 5 palm
    06       finger                   finger, current [mA]
    0A 0B    finger                   finger, goal and position, 0 open .. 65535 closed; finger 5 is the thumb's root
    0C       finger                   finger, goal and angle, int16 [0.01 deg]
    0E 0F 10 -                        the same of all motors: six goals, six positions or angles
    4B 4C 4D finger, goal, speed      -; a speed of 255 is the fastest
    4F 50 51 six times goal, speed    -
    49 4A    bits of fingers          -; start, stop
    54       -                        -; the present forces become zero
    40       mode                     -; restart
    42       number                   -; another number, from the next packet on; kept
    43 62 64 ..                       -; calibrate the motors, beep, initialise: without effect

    setting          get, set  of a finger, number first
    gains            04 45     yes  P, I, D, G, float
    current limit    05 46     yes  [mA]
    force target     07 47     yes
    position limits  09 48     yes  lowest, highest
    stops            11 52     yes  speed, current, time, retry
    force gains      12 53     yes  P, I, D, G, float
    self-test        20 60     no
    beeps            21 61     no
    button           22 63     no
    speed control    3D 66     no   brake and accelerate distances, ``<u2``, ratio, float

Dots follow row by row. All numbers are little-endian. An error is the command with bit 7, and a byte: 11 unknown, 12
length, 13 value.

Evidence: the vendor's Python SDK, run. Registers and Modbus: ``rohand``.

Try it: ``tactemu exec rohand_can --nodes can1 -- python PROGRAM``, with ``socet_can_interface`` of the SDK.
"""

import struct
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Column, Device, Frame, Motors, Option, Packets, Request, Restart, Serial, Transmissions, command,
    command_table, fact_table, one_of,
)  # fmt: skip
from firmware_protocols.devices.rohand import (
    DOT_COUNTS_PER_NEWTON, FULL_SCALE, FULL_STROKE_S, JOINT_NAMES, MOVING_MA, OPEN_CENTIDEG, RESTART_NS,
    STROKES_CENTIDEG, hand_layout,
)  # fmt: skip

PACKET = Frame("""
    packet, either direction
    0     55 AA        head
    2     u1           to
    3     u1           sender
    4     u1           command
    5     u1           size = len(data)
    6     bytes        data
    last  xor8 from 2  sum
""")
EVERY = 0xFF
OF_FINGERS = {0x04: "<4f", 0x05: "<H", 0x07: "<H", 0x09: "<2H", 0x11: "<4H", 0x12: "<4f"}
OF_HAND = {0x20: "<B", 0x21: "<B", 0x22: "<B", 0x3D: "<2Hf"}
DELIVERED: dict[int, tuple[float, ...]] = {
    0x04: (250.0, 2.0, 250.0, 1.0), 0x05: (1178,), 0x07: (15000,), 0x09: (0, FULL_SCALE),
    0x11: (FULL_SCALE, 200, 300, 500), 0x12: (1.0, 0.0, 0.0, 1.0), 0x20: (1,), 0x21: (1,), 0x22: (0,),
    0x3D: (0, 0, 1.0),
}  # fmt: skip
SETS = {0x45: 0x04, 0x46: 0x05, 0x47: 0x07, 0x48: 0x09, 0x52: 0x11, 0x53: 0x12, 0x60: 0x20, 0x61: 0x21, 0x63: 0x22,
        0x66: 0x3D}  # fmt: skip
"""The command that gets a setting, by the one that sets it."""
ANGLE, ANGLES, GO_TO_ANGLE, GO_TO_ANGLES = 0x0C, 0x10, 0x4D, 0x51
ERRORS = {"unknown_command": 0x11, "bad_length": 0x12, "refused": 0x13}
SDK = "oymotion/ohand_serial_sdk_python@2e95b77"
API = f"{SDK} src/ohand/OHandSerialAPI.py"


_FRAMES = {n: ", ".join(["001#..{8}"] * n) for n in (4, 7)}
"""Frames of dots, by their number."""


class RohandCan(Device[Any]):
    """A hand of the second generation with dots, and fingers that follow their commands."""

    name = "rohand_can"
    title = "OYMotion ROHand on CAN or UART"
    kind = "hand"
    columns = (Column(name="touch", low=0, high=255, assumed_per_unit=DOT_COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    sources = (f"{API}; src/ohand/constants.py; src/ohand/interface (the vendor's own)",)
    judge = SDK
    documented = command_table(
        f"""
        ? protocol version   002#55AA0201000003    001#55AA010200020002, 001#03
        ? firmware version   002#55AA0201010002    001#55AA010201040000, 001#010106
        ? hardware version   002#55AA0201020001    001#55AA010202042001, 001#010025
        ? dots of the thumb  002#55AA02010801000A  001#55AA010208260024, {_FRAMES[4]}, 001#..{{5}}
        ? of the index       002#55AA02010801010B  001#55AA0102083E013C, {_FRAMES[7]}, 001#..{{5}}
        ? of the middle      002#55AA020108010208  001#55AA0102083E023C, {_FRAMES[7]}, 001#..{{5}}
        ? of the ring        002#55AA020108010309  001#55AA0102083E033C, {_FRAMES[7]}, 001#..{{5}}
        ? of the little      002#55AA02010801040E  001#55AA010208220420, {_FRAMES[4]}, 001#..{{1}}
        ? of the palm        002#55AA02010801050F  001#55AA0102083A0538, {_FRAMES[7]}, 001#..{{1}}
        ? dots of no part    002#55AA02010801060C  001#55AA010288011399
        ? no command         002#55AA02017F007C    001#55AA0102FF0111EC
        ? beeps              002#55AA0201210022    001#55AA010221010122
        stop all             002#55AA02014A013F77  001#55AA01024A0049
        zero                 002#55AA0201540057    001#55AA0102540057
        restart              002#55AA020140010042  001#55AA0102400043
        """,
        origin=API,
    )
    facts = fact_table(f"""
        stated touch: an answer has the finger, the number of dots, and one byte for each dot, 60 at most @ {API}
            HAND_GetFingerForce, constants.py:6
        assumed touch: the parts have the same dots as over Modbus, with 50 counts/N; part 5 is the palm; a zero holds
            until power-off
        assumed identity: protocol 2.0, firmware 1.1.0, hardware 20 01, boot loader 1.0
        stated configuration: the commands, and the formats of answers and errors @ {API}; constants.py
        stated configuration: the hand is number 2, the host 1; frames of eight bytes have the receiver's number as id;
            250 kbit/s, 500 kbit/s or 1 Mbit/s @ {SDK} examples/simple_control, src/ohand/interface/can
        assumed configuration: settings are stored without effect, and all but the number are lost at power-off;
            absolute positions are treated like others; usage, UID, battery, calibration data and custom commands are
            unknown
        assumed timing: 100 conversions a second; a full stroke takes 1 s; the hand answers at once
    """, looked=f"all of {SDK}")  # fmt: skip

    def __init__(
        self,
        *,
        line: Annotated[Literal["can", "uart"], Option("line that carries the packets")] = "can",
        number: Annotated[int, Option("number as delivered", low=2, high=254)] = 2,
    ):
        self.layout = hand_layout("dots")
        self.number = self.flash.get("number", number)
        self.ports = (self._can() if line == "can" else Serial(baud=115200),)
        self.packets = Packets(PACKET, by="command", counters=self.counters, gap_ns=100_000_000)
        self.settings = {
            **{get: [DELIVERED[get]] * 6 for get in OF_FINGERS},
            **{get: [DELIVERED[get]] for get in OF_HAND},
        }
        speed = FULL_SCALE / FULL_STROKE_S
        self.motors = Motors([0.0] * 6, low=0.0, high=FULL_SCALE, time_constant_s=0.0, speed_limit=speed)
        self.speeds = np.full(6, speed)
        self.present = self.zero = np.zeros(len(self.layout))

    def _can(self) -> Can:
        return Can(filters=((self.number, 0x7FF), (EVERY, 0x7FF)))

    def receive(self, data: Any, t_ns: int, port: str) -> Transmissions[Any]:
        """Answer packets, which arrive in frames on CAN."""
        if isinstance(data, CanFrame):
            ident = data.arbitration_id
            if data != CanFrame(arbitration_id=ident, data=data.data) or ident not in (self.number, EVERY):
                self.counters["ignored"] += 1
                return ()
            data = data.data
        return super().receive(data, t_ns, port)

    def accepts(self, request: Request) -> bool:
        """Return True for the number of this hand, or that of all."""
        return request.to in (self.number, EVERY)

    def reply(self, request: Request, content: bytes) -> Transmissions[Any]:
        """Return the answer."""
        return self._sent(request, request.command, content)

    def refused(self, request: Request, why: str) -> Transmissions[Any]:
        """Return an error."""
        return self._sent(request, request.command | 0x80, bytes([ERRORS[why]]))

    def _sent(self, request: Request, answered: int, content: bytes) -> Transmissions[Any]:
        packet = PACKET.pack(to=request.sender, sender=self.number, command=answered, data=content)
        if isinstance(self.ports[0], Serial):
            return [packet]
        return [CanFrame(arbitration_id=request.sender, data=packet[k : k + 8]) for k in range(0, len(packet), 8)]

    @command(on=(0, 1, 2), data="")
    def identity(self, request: Request):
        """Return the version of protocol, firmware or hardware."""
        return (b"\0\2", b"\0\0\1\1", b"\x20\1\1\0")[request.command]

    @command(on=0x08, data="B")
    def dots(self, request: Request):
        """Return the dots of a part."""
        patch = one_of(self.layout.patches, request.value)
        return bytes([request.value, len(patch), *self.layout.on_wire(self.counts)[patch.taxels].tolist()])

    @command(on=0x06, data="B")
    def current(self, request: Request):
        """Return the current of a finger."""
        moving = one_of(self.motors.moving(request.t_ns), request.value)
        return struct.pack("<BH", request.value, MOVING_MA * moving)

    @command(on=(0x0A, 0x0B, ANGLE), data="B")
    def goal_and_position(self, request: Request):
        """Return goal and position, or angle, of a finger."""
        two = [one_of(each, request.value) for each in self._told(request.command == ANGLE, request.t_ns)]
        return bytes([request.value]) + np.array(two).astype("<i2").tobytes()

    @command(on=(0x0E, 0x0F, ANGLES), data="")
    def goals_and_positions(self, request: Request):
        """Return goals and positions, or angles, of all fingers."""
        return np.array(self._told(request.command == ANGLES, request.t_ns)).astype("<i2").tobytes()

    def _told(self, as_angles: bool, t_ns: int) -> list[np.ndarray]:
        both = np.stack([self.motors.goals, self.motors.positions(t_ns)])
        return [*np.rint(OPEN_CENTIDEG + STROKES_CENTIDEG * both / FULL_SCALE if as_angles else both).astype(int)]

    @command(on=(0x4B, 0x4C, GO_TO_ANGLE), data="<BHB")
    def go(self, request: Request):
        """Move a finger."""
        finger, goal, speed = request.values
        self._go([one_of(range(6), finger)], [goal], [speed], request)

    @command(on=(0x4F, 0x50, GO_TO_ANGLES), data="<" + 6 * "HB")
    def go_all(self, request: Request):
        """Move all fingers."""
        self._go(list(range(6)), request.values[::2], request.values[1::2], request)

    def _go(self, at: list[int], goals: Any, speeds: Any, request: Request) -> None:
        if request.command in (GO_TO_ANGLE, GO_TO_ANGLES):
            goals = (np.array(goals).astype(np.int16) - OPEN_CENTIDEG[at]) / STROKES_CENTIDEG[at] * FULL_SCALE
        self.speeds[at] = np.array(speeds) / 255 * FULL_SCALE / FULL_STROKE_S
        self.motors.limit_speed(self.speeds, request.t_ns)
        self.motors.go(goals, request.t_ns, at=at)

    @command(on=0x4A, data="B")
    def stop(self, request: Request):
        """Stop fingers."""
        at = [k for k in range(len(JOINT_NAMES)) if request.value >> k & 1]
        self.motors.go(self.motors.positions(request.t_ns)[at], request.t_ns, at=at)

    @command(on=tuple(OF_FINGERS), data="B")
    def setting_of_finger(self, request: Request):
        """Return a setting of a finger."""
        numbers = one_of(self.settings[request.command], request.value)
        return bytes([request.value]) + struct.pack(OF_FINGERS[request.command], *numbers)

    @command(on=tuple(OF_HAND), data="")
    def setting(self, request: Request):
        """Return a setting of the hand."""
        return struct.pack(OF_HAND[request.command], *self.settings[request.command][0])

    @command(on=tuple(SETS), data="*")
    def set_setting(self, request: Request):
        """Store a setting."""
        get, data = SETS[request.command], request.data
        form = OF_HAND.get(get) or f"<B{OF_FINGERS[get][1:]}"
        if len(data) != struct.calcsize(form):
            return self.refused(request, "bad_length")
        finger, *numbers = struct.unpack(form, data) if get in OF_FINGERS else (0, *struct.unpack(form, data))
        one_of(self.settings[get], finger)
        self.settings[get][finger] = tuple(numbers)
        return b""

    @command(on=0x54, data="")
    def zero_forces(self, request: Request):
        """Make the present forces zero."""
        self.zero = self.present

    @command(on=0x42, data="B")
    def set_number(self, request: Request):
        """Take another number, from the next packet on."""
        sent = self.reply(request, b"")
        self.number = self.flash["number"] = request.value
        self.ports = (self._can() if isinstance(self.ports[0], Can) else self.ports[0],)
        return sent

    @command(on=0x40, data="B")
    def restart(self, request: Request):
        """Restart."""
        return [*self.reply(request, b""), Restart(delay_ns=RESTART_NS)]

    @command(on=(0x43, 0x49, 0x62, 0x64), data="*")
    def other(self, request: Request):
        """Calibrate, start, beep and initialise, all without effect."""
