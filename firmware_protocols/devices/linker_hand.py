"""LinkerHand L6, L10, L20, L25, G20 (fingertips of 12 x 6 taxels) and O6 (10 x 4): CAN, polled, a matrix row a frame.

Wire: classic CAN, 1 Mbit/s, one standard id per hand in both directions: 0x28 left, 0x27 right. Byte 0 is the command;
an answer repeats id and command. ``f`` = 0 thumb .. 4 little finger.

    request          answer                                             about
    B1+f C6          12 x [B1+f, row << 4, 6 x u8]                      12 x 6 matrix, raw 0..255, row by row
    B1+f A4          10 x [B1+f, row << 4, 4 x u8]                      10 x 4 matrix (O6)
    B6               as a fingertip                                     palm matrix (G20; option palm)
    B1+f             [B1+f, rows, columns]                              touch probe: two data bytes = matrix sensor
    B0               silence                                            sent before the probe
    20 21 22 23      [cmd, 5 x u8]                                      normal, tangential, direction, approach (older)
    C0               4 x [C0, i, 6 ASCII]                               serial number, NUL padded; i = 0, 1, 2, 3
    C1, C2, C4       [cmd, major, minor, patch]                         PCB, firmware, mechanical version; C1 as a ping
    C1 01 (L6, L10)  [C1, 01, major, minor, patch]                      PCB version
    64 (L6 L10 O6)   [64, dof, mech, serial, 'L'|'R', sw, hw, rev]      older identity; versions in nibbles
    01 02 05         [cmd, 6 x u8]                                      joint angles, torques, speeds
    33 35 36         [cmd, 6 x u8]                                      temperatures, faults, currents
    01 02 05 6 x u8  silence                                            set; read back by the request without data

L10: ``i`` of the serial number is 0, 6, 12, 18. Its ten joints come in two parts: angles 01 (6) and 04 (4); torques
02 03, speeds 05 06, temperatures 33 34 and faults 35 36 (5 and 5).

L20, L25 and G20: the four quantities are 90 91 92 93. Joints come by finger, six bytes each (abduction, yaw of the
thumb, root, two reserved, tip): angles 41+f, speeds 49+f, torques 51+f, faults 59+f (six times 01 clears), temperatures
61+f. The G20's records of whole fingers (98..9C) are known by their numbers alone, and get silence.

The fifth field of the serial number is the kind of touch sensor: A four quantities, B 12 x 6, F and J 10 x 4, Z none.
Evidence: both published drivers decode these frames; no firmware source or manual was seen.

Try it: ``tactemu run linker_hand_l6 --port can:udp_multicast:239.74.163.2``, then
``linkerbot.L6("left", "239.74.163.2", "udp_multicast").force_sensor.get_blocking()``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np

from firmware_protocols import (
    Can,
    CanFrame,
    Column,
    Command,
    Counts,
    Device,
    Layout,
    Option,
    Outs,
    Reading,
    grid_layout,
)
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import stack
from firmware_protocols.motors import Motors

FINGERS = ("thumb", "index", "middle", "ring", "little")
FINGER_SPACING, PALM_DISTANCE = 0.025, 0.06
PITCH = 0.0015
COUNTS_PER_NEWTON = 500.0
FIRST_FINGER = 0xB1
JOINTS = {"thumb_flex": 1.2, "thumb_abd": 1.5, "index": 1.6, "middle": 1.6, "ring": 1.6, "pinky": 1.6}
"""Joints of a hand with six, and how far each goes from open (255) to closed (0) [rad]."""
STROKE_S, STRENGTH_NM, OVERLOAD, OVERLOADED = 0.5, 0.8, 0.9, 8
SELECTORS, LETTERS = {"12x6": 0xC6, "10x4": 0xA4}, {"12x6": "B", "10x4": "F", "quantities": "A"}
SERIAL_BYTES = 24

VERSIONS = {0xC1: b"\x01\x00\x04", 0xC2: b"\x01\x02\x03", 0xC4: b"\x02\x00\x01"}
"""Major, minor, patch by command."""


class LinkerHand(Device[CanFrame]):
    """Five fingertips that answer one request each with their matrix."""

    columns = (Column(name="touch", low=0, high=255, push=1),)
    evidence = ("driver",)
    sources = (
        "linkerbot 0.5.4 hand/{l6,o6}/force_sensor.py, version.py, comm/can/can.py",
        "linkerbot 0.5.4 hand/l20lite (ten joints, like the L10), hand/l25 (joints by finger)",
        "linker-bot/linkerhand-python-sdk@b371361 LinkerHand/core/can/linker_hand_{l10,o6,l20,g20}_can.py",
    )
    kind = "hand"
    judge = "linkerbot 0.5.4"
    assumed = (
        f"{COUNTS_PER_NEWTON:.0f} counts/N of normal force per taxel (raw units, no scale published)",
        f"pitch {PITCH * 1e3} mm, fingertips side by side every {FINGER_SPACING * 1e3:.0f} mm, row 0 at the tip",
        "B1..B5 without data answer rows and columns; another size's selector, 20..23 on a matrix hand are ignored",
        "older quantities: sums over the fingertip in the matrix's scale, direction 256 steps a turn, approach 0",
        "joints answer what was last set; 100 Hz conversion; the same versions, whatever the serial number",
        f"six joints in an engine: 255 is open, 0 closed ({', '.join(f'{j} {s} rad' for j, s in JOINTS.items())})",
        f"in an engine a stroke takes {STROKE_S} s at speed 255; torque 255 is {STRENGTH_NM} Nm and 1400 mA; angles "
        f"and currents are as they are; fault bit 3 while a joint is stalled at more than {OVERLOAD:.0%} of that",
    )
    matrix: ClassVar[str] = "12x6"
    """Rows and columns of a fingertip."""
    model: ClassVar[str]
    pcb_echoes: ClassVar[bool] = True
    """Whether C1 01 asks for the PCB version, too."""
    has_palm: ClassVar[bool] = False
    first_quantity: ClassVar[int] = 0x20
    serial_step: ClassVar[int] = 1
    """From one frame of the serial number to the next."""
    degrees_of_freedom: ClassVar[int] = 6
    """In the older identity; 0: has none."""
    joints_at_rest: ClassVar[dict[int, tuple[str, bytes]]] = {
        0x01: ("joint angles", b"\x80" * 6),
        0x02: ("torque limits", b"\xff" * 6),
        0x05: ("speeds", b"\xff" * 6),
        0x33: ("temperatures", b"\x1e" * 6),
        0x35: ("faults", bytes(6)),
        0x36: ("currents", bytes(6)),
    }
    """What they answer at power-up, by command."""
    settable: ClassVar[range] = range(0x10)
    """Commands that set joints when data follow."""
    clearable: ClassVar[range] = range(0)
    """Faults that six times 01 clear."""

    def __init__(
        self,
        *,
        side: Annotated[Literal["left", "right"], Option("which hand; sets the id")] = "left",
        touch: Annotated[
            Literal["matrix", "12x6", "10x4", "quantities"],
            Option("the model's own matrix, another, or the older sensor: four numbers a finger"),
        ] = "matrix",
        palm: Annotated[bool | None, Option("a matrix in the palm, too; default: as the model")] = None,
        serial_number: Annotated[
            str,
            Option(f"at most {SERIAL_BYTES} characters of ASCII; default: as the model, side and touch sensor want it"),
        ] = "",
    ):
        if len(serial_number) > SERIAL_BYTES or not serial_number.isascii():
            raise ValueError(
                f"option serial_number: expected {SERIAL_BYTES} characters of ASCII, got {serial_number!r}"
            )
        self.arbitration_id = 0x28 if side == "left" else 0x27
        self.ports = (Can(hears=((self.arbitration_id, 0x7FF),)),)
        self.side, self.has_matrix = side[0].upper(), touch != "quantities"
        kind = self.matrix if touch == "matrix" else touch
        self.serial_number = serial_number or f"LH{self.model}-03-001-{self.side}-{LETTERS[kind]}-1-A"
        self.selector = SELECTORS.get(kind, 0)
        rows, _, columns = (kind if self.has_matrix else self.matrix).partition("x")
        self.size = int(rows), int(columns)
        self.with_palm = self.has_matrix and (self.has_palm if palm is None else palm)
        self.layout = pads(*self.size, self.with_palm)
        self.joint_values = {code: values for code, (_, values) in self.joints_at_rest.items()}
        self.motors: Motors | None = None
        if self.degrees_of_freedom == len(JOINTS):
            self.motors = Motors(
                [0x80] * len(JOINTS), low=0, high=0xFF, time_constant_s=0.0, speed_limit=0xFF / STROKE_S,
                names=tuple(JOINTS), unit=[-stroke / 0xFF for stroke in JOINTS.values()], zero=0xFF,
                strength=STRENGTH_NM,
            )  # fmt: skip

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Raw counts 0..255 of the normal force of each taxel, uint8, shape ``(n_taxels,)``."""
        tips = self.layout.to_taxel_frame(reading["force"])[: len(FINGERS) * self.size[0] * self.size[1]]
        self.counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 255).astype(np.uint8)
        self.quantities = _four_quantities(tips.reshape(len(FINGERS), -1, 3).sum(axis=1))
        return self.counts

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """How far each joint of a hand with six is closed [rad]."""
        return self.motors.joints(t_ns) if self.motors else {}

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Outs[CanFrame]:
        """Answer one request frame; frames for others, and what is not documented, get silence."""
        if not data.data or data != CanFrame(arbitration_id=self.arbitration_id, data=data.data):
            self.counters["ignored"] += 1
            return ()
        command = data.data[:1]
        answers = self._answers(command[0], data.data[1:], t_ns)
        self.counters["unknown_command" if answers is None else "requests"] += 1
        return [CanFrame(arbitration_id=self.arbitration_id, data=command + answer) for answer in answers or ()]

    def _answers(self, command: int, payload: bytes, t_ns: int) -> list[bytes] | None:
        """What follows the command in each answer. Requests are matched whole: ``None`` if it is none."""
        finger, quantity = command - FIRST_FINGER, command - self.first_quantity
        match command, payload:
            case 0xC0, b"":
                text = self.serial_number.encode("ascii").ljust(SERIAL_BYTES, b"\0")
                return [bytes([k * self.serial_step]) + text[6 * k : 6 * k + 6] for k in range(4)]
            case version, b"" if version in VERSIONS:
                return [VERSIONS[version]]
            case 0xC1, b"\x01" if self.pcb_echoes:
                return [payload + VERSIONS[command]]
            case 0x64, b"" if self.degrees_of_freedom:
                return [bytes([self.degrees_of_freedom, 2, 1, ord(self.side), 0x12, 0x10, ord("A")])]
            case 0xB0, b"":
                return []
            case joint, b"" if joint in self.joint_values:
                return [self._joint(joint, t_ns)]
            case joint, _ if joint in self.settable and len(payload) == len(self.joint_values.get(joint, b"")) > 0:
                self.joint_values[joint] = payload
                self._move(joint, payload, t_ns)
                return []
            case faults, _ if faults in self.clearable and payload == b"\x01" * 6:
                return []
            case _, b"" if 0 <= quantity < 4 and not self.has_matrix:
                return [self.quantities[quantity].tobytes()]
            case 0xB6, b"" if self.with_palm:
                return self._rows(finger)
            case _, b"" if 0 <= finger < 5 and self.has_matrix:
                return [bytes(self.size)]
            case _, selector if 0 <= finger < 5 and self.has_matrix and selector == bytes([self.selector]):
                return self._rows(finger)
        return None

    def _move(self, command: int, payload: bytes, t_ns: int) -> None:
        """What was set acts on the motors."""
        values = np.frombuffer(payload, np.uint8).astype(float)
        match self.motors, command:
            case None, _:
                return
            case motors, 0x01:
                motors.go(values, t_ns)
            case motors, 0x02:
                motors.limit_force(values / 0xFF)
            case motors, 0x05:
                motors.limit_speed(values / STROKE_S, t_ns)

    def _joint(self, command: int, t_ns: int) -> bytes:
        """What joints answer: in an engine as they are, else what was last set."""
        motors = self.motors
        if motors is None or not motors.embodied:
            return self.joint_values[command]
        share = np.abs(motors.forces) / motors.strength
        match command:
            case 0x01:
                values = quantize(motors.positions(t_ns), 1.0, 0, 0xFF)
            case 0x35:
                values = OVERLOADED * (motors.stalled & (share > OVERLOAD))
            case 0x36:
                values = quantize(share, 0xFF, 0, 0xFF)
            case _:
                return self.joint_values[command]
        return values.astype(np.uint8).tobytes()

    def _rows(self, finger: int) -> list[bytes]:
        """The matrix of one sample: rows are never of different age."""
        matrix = self.layout.on_wire(self.counts)[self.layout.patches[finger].taxels].reshape(self.size)
        return [bytes([k << 4]) + row.tobytes() for k, row in enumerate(matrix)]

    # -- datasheet -------------------------------------------------------------------------------------------------

    @property
    def commands(self) -> tuple[Command, ...]:
        """Identity, joints, matrices or quantities."""
        to, (rows, columns) = f"{self.arbitration_id:03X}#", self.size

        def command(name: str, request: str, *replies: str, origin: str = LinkerHand.judge) -> Command:
            answers = [to + reply for reply in replies]
            return Command(name=name, request=to + request, reply=answers or None, origin=origin)

        listed = [
            command("serial number", "C0", *(f"C0 {k * self.serial_step:02X} ..{{6}}" for k in range(4))),
            command("ping", "C1", "C1 01 00 04", origin=_SDK),
            command("firmware version", "C2", "C2 01 02 03"),
            command("mechanical version", "C4", "C4 02 00 01"),
            command("touch probe, first part", "B0", origin=_SDK),
        ]
        if self.degrees_of_freedom:
            identity = f"64 {self.degrees_of_freedom:02X} 02 01 .. 12 10 41"
            listed.append(command("identity (older)", "64", identity, origin=_SDK))
        if self.pcb_echoes:
            listed.append(command("PCB version", "C1 01", "C1 01 01 00 04"))
        for code, (joints, values) in self.joints_at_rest.items():
            listed.append(command(joints, f"{code:02X}", f"{code:02X} ..{{{len(values)}}}"))
            if code in self.settable:
                listed.append(command(f"set {joints}", f"{code:02X}" + " 40" * len(values)))
            if code in self.clearable:
                listed.append(command(f"clear {joints}", f"{code:02X}" + " 01" * 6))
        if not self.has_matrix:
            older = ((f"{self.first_quantity + k:02X}", each) for k, each in enumerate(_OLDER))
            return (*listed, *(command(each, code, f"{code} ..{{5}}") for code, each in older))
        if self.with_palm:
            listed.append(command("palm", "B6", *(f"B6 {row:X}0 ..{{{columns}}}" for row in range(rows)), origin=_SDK))
        for k, finger in enumerate(FINGERS, 1):
            answers = [f"B{k} {row:X}0 ..{{{columns}}}" for row in range(rows)]
            listed.append(command(f"touch probe {finger}", f"B{k}", f"B{k} {rows:02X} {columns:02X}", origin=_SDK))
            listed.append(command(f"matrix {finger}", f"B{k} {self.selector:02X}", *answers))
        return tuple(listed)


_SDK = "linkerhand-python-sdk@b371361"
_OLDER = ("normal forces", "tangential forces", "directions", "approach")


def _four_quantities(force: np.ndarray) -> np.ndarray:
    """Normal, tangential, direction, approach under ``force`` [N] of shape ``(5, 3)``; uint8 ``(4, 5)``."""
    turn = np.arctan2(force[:, 1], force[:, 0]) / (2 * np.pi) % 1.0
    normal = quantize(-force[:, 2], COUNTS_PER_NEWTON, 0, 255)
    tangential = quantize(np.hypot(force[:, 0], force[:, 1]), COUNTS_PER_NEWTON, 0, 255)
    direction = np.rint(turn * 256).astype(int) % 256
    return np.stack([normal, tangential, direction, np.zeros(5, int)]).astype(np.uint8)


def pads(rows: int, columns: int, palm: bool) -> Layout:
    """Flat pads on links of their names, fingertips side by side along x, thumb at the smallest x, tips to +y."""
    places = {finger: ((i - 2) * FINGER_SPACING, 0.0, 0.0) for i, finger in enumerate(FINGERS)}
    if palm:
        places["palm"] = (0.0, -PALM_DISTANCE, 0.0)
    return stack(*(grid_layout(rows, columns, PITCH, name=f, origin=p, link=f) for f, p in places.items()))


class LinkerHandL6(LinkerHand):
    """L6: 12 x 6 fingertips, six joints."""

    name = "linker_hand_l6"
    title = "LinkerHand L6, 5 fingertips 12x6"
    model = "L6"


class LinkerHandL10(LinkerHand):
    """L10: 12 x 6 fingertips, ten joints."""

    name = "linker_hand_l10"
    title = "LinkerHand L10, 5 fingertips 12x6"
    model = "L10"
    degrees_of_freedom = 10
    serial_step = 6
    joints_at_rest: ClassVar[dict[int, tuple[str, bytes]]] = {
        0x01: ("joint angles 1 to 6", b"\x80" * 6),
        0x04: ("joint angles 7 to 10", b"\x80" * 4),
        0x02: ("torque limits 1 to 5", b"\xff" * 5),
        0x03: ("torque limits 6 to 10", b"\xff" * 5),
        0x05: ("speeds 1 to 5", b"\xff" * 5),
        0x06: ("speeds 6 to 10", b"\xff" * 5),
        0x33: ("temperatures 1 to 5", b"\x1e" * 5),
        0x34: ("temperatures 6 to 10", b"\x1e" * 5),
        0x35: ("faults 1 to 5", bytes(5)),
        0x36: ("faults 6 to 10", bytes(5)),
    }
    judge = "linkerbot 0.5.4, as an L20 Lite, which has the same ten joints"


class LinkerHandO6(LinkerHand):
    """O6: 10 x 4 fingertips; asks for the PCB version in its own way."""

    name = "linker_hand_o6"
    title = "LinkerHand O6, 5 fingertips 10x4"
    model = "O6"
    matrix = "10x4"
    pcb_echoes = False


_BY_FINGER = {
    0x41: ("angles", 0x80),
    0x49: ("speeds", 0xFF),
    0x51: ("torque limits", 0xFF),
    0x59: ("faults", 0),
    0x61: ("temperatures", 0x1E),
}
"""What the joints of one finger answer at power-up, by the command of the thumb; reserved bytes are 0."""


class LinkerHandL25(LinkerHand):
    """L25: 12 x 6 fingertips, joints by finger."""

    name = "linker_hand_l25"
    title = "LinkerHand L25, 5 fingertips 12x6"
    model = "L25"
    degrees_of_freedom = 0
    pcb_echoes = False
    first_quantity = 0x90
    settable, clearable = range(0x41, 0x59), range(0x59, 0x5E)
    joints_at_rest: ClassVar[dict[int, tuple[str, bytes]]] = {
        first + k: (f"{what} of the {finger}", bytes(rest * used for used in (1, k == 0, 1, 0, 0, 1)))
        for first, (what, rest) in _BY_FINGER.items()
        for k, finger in enumerate(FINGERS)
    }
    assumed = (*LinkerHand.assumed, "quantities 90..93 of an L20 and L25, as the L21 and G20 have them")


class LinkerHandL20(LinkerHandL25):
    """L20: 12 x 6 fingertips."""

    name = "linker_hand_l20"
    title = "LinkerHand L20, 5 fingertips 12x6"
    model = "L20"
    judge = "linkerbot 0.5.4, as an L25, which asks for touch and identity alike"
    assumed = (*LinkerHandL25.assumed, "joints as the L25 has them")


class LinkerHandG20(LinkerHandL20):
    """G20: 12 x 6 fingertips and a palm."""

    name = "linker_hand_g20"
    title = "LinkerHand G20, 5 fingertips 12x6 and a palm"
    model = "G20"
    has_palm = True
    judge = "linkerbot 0.5.4, as an L25, fingertips and identity; nobody the palm"
    assumed = (
        *LinkerHandL20.assumed,
        f"palm: frames and size as a fingertip, {PALM_DISTANCE * 1e3:.0f} mm below them (no driver decodes its answer)",
    )
