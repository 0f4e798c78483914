"""The CAN protocol that all LinkerHands share: identity, joints, matrices and their commands.

The datasheet of the hands is :mod:`firmware_protocols.devices.linker_hand`.
"""

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Annotated, ClassVar, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Column, Command, Counts, Device, Motors, Option, Reading, Transmissions, command_table, quantize,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_joints import (
    AT_POWER_UP, MAX_JOINTS, MOTION, SIX_JOINTS, USED_JOINTS, View, Views,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_touch import (
    COUNTS_PER_NEWTON, FINGERS, PALM_SENSORS, QUANTITIES, SENSORS, Touch, four_quantities, pads, sums,
)  # fmt: skip

FIRST_MATRIX_COMMAND = 0xB1
PALM_PART = 5
BROADCAST = 0xFF
JOINT_STROKES_RAD = {"thumb_flex": 1.2, "thumb_abd": 1.5, "index": 1.6, "middle": 1.6, "ring": 1.6, "pinky": 1.6}
"""The joints of a hand with six, and the stroke of each from open (255) to closed (0)."""
STROKE_S = 0.5
STRENGTH_NM = 0.8
OVERLOAD_SHARE = 0.9
OVERLOAD_FAULT = 8
MAX_SERIAL_CHARACTERS = 24
OLDER_IDENTITY = b"\x06\x16"
"""The mechanical version and number in the older identity."""
OLDER_VERSIONS = b"\x24\x11\x00"
"""The versions in the older identity: software 2.4, hardware 1.1, revision."""
VALUES_PER_FRAME = 5
"""The number of matrix values in a frame that gives their start."""
ROS2 = "linkerhand-ros2-sdk@bba0b9d"
PYTHON = "linkerhand-python-sdk@b371361"
LINKERBOT = "linkerbot 0.5.4"
CPP = "linkerhand-cpp-sdk@a0100cf"
TABLE = f"{ROS2} core/can/L20_V10_V11-..._V1.0.5.xlsx"
SDKS = f"{LINKERBOT}, linker-bot/{PYTHON}, linker-bot/{CPP}"
SOURCES = (
    f"{LINKERBOT} hand/{{l6,o6}}/force_sensor.py, version.py, comm/can/can.py",
    f"{LINKERBOT} hand/l20lite (ten joints, like the L10), hand/l25 (joints by finger)",
    f"linker-bot/{PYTHON} LinkerHand/core/can/linker_hand_{{l6,l10,o6,l20,l25,g20}}_can.py",
    f"linker-bot/{ROS2} LinkerHand/core/can/L20_V10_V11-..._V1.0.5.xlsx, linker_hand_*_can.py",
    f"linker-bot/{CPP} docs/API-Reference.md; its library as a driver",
)

Side = Annotated[Literal["left", "right"], Option("which hand; sets the id")]
TouchKind = Annotated[
    Literal["matrix", "12x6", "10x4", "23x9", "quantities"],
    Option("the model's own matrix, another, or the older sensor: four numbers for each finger"),
]
HasPalm = Annotated[bool, Option("a matrix in the palm, too; 23x9 always has one")]
SerialNumber = Annotated[
    str, Option(f"at most {MAX_SERIAL_CHARACTERS} characters of ASCII; default: by model, side and touch sensor")
]


class LinkerHand(Device[CanFrame]):
    """A hand of five fingertips, which each answer a request with their matrix."""

    columns = (Column(name="touch", low=0, high=255, assumed_per_unit=COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    kind = "hand"
    sources = SOURCES
    judge = f"{SDKS}, linker-bot/{ROS2}"
    documented_with = None
    model: ClassVar[str]
    sensor: ClassVar[str] = "12x6"
    """The key of its own touch sensor."""
    palms: Mapping[str, Touch] = PALM_SENSORS
    series: str = "03"
    """The second field of the serial number."""
    versions: Mapping[int, bytes] = {0xC1: b"\x01\x00\x04", 0xC2: b"\x01\x02\x03", 0xC4: b"\x02\x00\x01"}
    """The version by command: major, minor, patch."""
    pcb_echoes: ClassVar[bool] = True
    """True if C1 01 also requests the PCB version."""
    degrees_of_freedom: ClassVar[int] = 6
    """The number of degrees of freedom in the older identity; 0 without that identity."""
    serial_step: ClassVar[int] = 1
    """The step of the index from one frame of the serial number to the next."""
    first_quantity: int = 0x20
    """The command of the first of the four quantities."""
    views: Views = SIX_JOINTS
    """The commands for joints."""
    together: ClassVar[Mapping[int, tuple[int, ...]]] = {}
    """The commands with the answers of several others."""
    has_motors: ClassVar[bool] = True
    """True if an engine can move its joints, which are then six."""
    has_id: ClassVar[bool] = False
    """True if C3 requests the id, and sets it."""
    zero_asks: bool = False
    """True if one byte 00 behind a command is also a query."""
    in_table: bool = False
    """True if it follows the vendor's table."""
    shows_limits: bool = True
    """True if speeds and torques answer the limits set, not the present values."""

    def __init__(
        self,
        *,
        side: Side = "left",
        touch: TouchKind = "matrix",
        palm: HasPalm = False,
        serial_number: SerialNumber = "",
    ):
        if len(serial_number) > MAX_SERIAL_CHARACTERS or not serial_number.isascii():
            raise ValueError(
                f"option serial_number: expected {MAX_SERIAL_CHARACTERS} characters of ASCII, got {serial_number!r}"
            )
        kind = self.sensor if touch == "matrix" else touch
        sensors = self.palms if palm or kind not in SENSORS else SENSORS
        if kind not in sensors:
            known = ", ".join(sensors) or "none"
            raise ValueError(f"option touch: {self.model} has no {kind}{' and palm' * palm}, but {known}")
        self.touch, self.has_matrix = sensors[kind], kind != "quantities"
        self.arbitration_id = self.flash.get("id", 0x28 if side == "left" else 0x27)
        self.heard = (self.arbitration_id, BROADCAST) if self.in_table else (self.arbitration_id,)
        self.ports = (Can(filters=tuple((ident, 0x7FF) for ident in self.heard)),)
        self.side = side[0].upper()
        self.serial_number = serial_number or f"LH{self.model}-{self.series}-001-{self.side}-{self.touch.letter}-1-A"
        self.layout = pads(self.touch.finger, self.touch.palm)
        self.state = {
            view.quantity: bytearray([AT_POWER_UP.get(view.quantity, 0)] * MAX_JOINTS) for view in self.views.values()
        }
        if self.in_table:
            self.state["temperatures"] = bytearray(
                AT_POWER_UP["temperatures"] * (k in USED_JOINTS) for k in range(MAX_JOINTS)
            )
        self.motors: Motors | None = None
        if self.has_motors:
            self.motors = Motors(
                [AT_POWER_UP["angles"]] * len(JOINT_STROKES_RAD), low=0, high=0xFF, time_constant_s=0.0,
                speed_limit=0xFF / STROKE_S, names=tuple(JOINT_STROKES_RAD),
                unit=[-stroke / 0xFF for stroke in JOINT_STROKES_RAD.values()], zero=0xFF, strength=STRENGTH_NM,
            )  # fmt: skip

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return raw counts 0..255 of the normal force on each taxel, shape ``(n_taxels,)``."""
        tips = self.layout.to_taxel_frame(reading["force"])[: len(FINGERS) * np.prod(self.touch.finger)]
        self.tip_forces = tips.reshape(len(FINGERS), -1, 3).sum(axis=1)
        return super().measure(reading, t_ns)

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Answer one request frame; frames for other hands, and undocumented ones, get no answer."""
        ident = data.arbitration_id
        if not data.data or ident not in self.heard or data != CanFrame(arbitration_id=ident, data=data.data):
            self.counters["ignored"] += 1
            return ()
        command, payload = data.data[0], data.data[1:]
        if payload == b"\0" and self.zero_asks:
            payload = b""
        asked = self.together.get(command, ()) if not payload else ()
        answers = [(each, self._answers(each, payload, t_ns)) for each in asked or (command,)]
        self.counters["unknown_command" if answers[0][1] is None else "requests"] += 1
        return [
            CanFrame(arbitration_id=self.arbitration_id, data=bytes([each]) + answer)
            for each, several in answers
            for answer in several or ()
        ]

    def _answers(self, command: int, payload: bytes, t_ns: int) -> list[bytes] | None:
        """Return the bytes behind the command in each answer, or None if the complete request is unknown."""
        part, quantity = command - FIRST_MATRIX_COMMAND, command - self.first_quantity
        match command, payload:
            case _ if command in self.views:
                return self._joints(self.views[command], payload, t_ns)
            case _ if 0 <= part <= PALM_PART:
                return self._matrix(part, payload)
            case _, b"" if 0 <= quantity < len(QUANTITIES):
                return [] if self.has_matrix else [four_quantities(self.tip_forces)[quantity].tobytes()]
            case 0xB0, b"":
                return [bytes([self.touch.number])]
            case 0xC0, b"":
                text = self.serial_number.encode("ascii")
                text = text if self.in_table else text.ljust(MAX_SERIAL_CHARACTERS, b"\0")
                return [bytes([k * self.serial_step]) + text[6 * k : 6 * k + 6] for k in range(4)]
            case _, b"" if command in self.versions:
                return [self.versions[command]]
            case 0xC1, b"\x01" if self.pcb_echoes:
                return [payload + self.versions[command]]
            case 0x64, b"" if self.degrees_of_freedom:
                return [bytes([self.degrees_of_freedom, *OLDER_IDENTITY, ord(self.side), *OLDER_VERSIONS])]
            case 0xC3, _ if self.has_id and len(payload) < 2 and payload != bytes([BROADCAST]):
                self.flash["id"] = payload[0] if payload else self.flash.get("id", self.arbitration_id)
                return [bytes([self.arbitration_id])]
            case 0xCD, b"" if self.in_table:
                return [b"restart"]
            case 0xCF, b"" if self.has_id and not self.in_table:
                return []
        return None

    def _matrix(self, part: int, payload: bytes) -> list[bytes] | None:
        """Return the matrix of one sample, so that all rows are of the same time."""
        (rows, columns), parts = self.touch.part(part)
        if not self.has_matrix or not rows:
            return None
        matrix = self.layout.on_wire(self.counts.astype(np.uint8))[self.layout.patches[part].taxels]
        matrix = matrix.reshape(rows, columns)
        if not payload:
            return [sums(matrix, (rows,))]
        if not parts and part != PALM_PART:
            frames = [bytes([k << 4]) + row.tobytes() for k, row in enumerate(matrix)]
            return frames if payload == bytes([rows << 4 | columns]) else None
        partial = b"\xff" + sums(matrix, parts)
        if payload[:2] == bytes([columns, rows]) and part == PALM_PART and rows != columns:
            matrix, rows, columns = matrix.T, columns, rows
        if payload[:2] != bytes([rows, columns]) or len(payload) > 2 + bool(parts):
            return None
        flat = matrix.tobytes()
        starts = range(0, len(flat), VALUES_PER_FRAME)
        pieces = [bytes(divmod(k, columns)) + flat[k : k + VALUES_PER_FRAME] for k in starts]
        return [*pieces, partial] if len(payload) > 2 else pieces

    def _joints(self, view: View, payload: bytes, t_ns: int) -> list[bytes] | None:
        """Set joints or clear their faults, and return the answer with their values."""
        if payload:
            n, state = len(view.groups), self.state[view.quantity]
            if not view.access or len(payload) not in (n, view.least) or (view.access == "clear" and max(payload) > 1):
                return None
            for group, value in zip(view.groups, payload):
                for k in group:
                    state[k] = value if view.access == "set" else state[k] * (not value)
            self._move(view.quantity, t_ns)
        shown = self._shown(view.quantity, t_ns)
        merged = ([shown[k] for k in group] for group in view.groups)
        if view.quantity == "faults":
            answer = bytes(reduce(or_, values) for values in merged)
        else:
            answer = bytes(round(sum(values) / len(values)) for values in merged)
        return [answer] if view.answers else []

    def _move(self, quantity: str, t_ns: int) -> None:
        """Pass the values that were set to the motors."""
        if self.motors is None:
            return
        values = np.frombuffer(self.state[quantity], np.uint8, len(JOINT_STROKES_RAD)).astype(float)
        match quantity:
            case "angles":
                self.motors.go(values, t_ns)
            case "torques":
                self.motors.limit_force(values / 0xFF)
            case "speeds":
                self.motors.limit_speed(values / STROKE_S, t_ns)

    def _shown(self, quantity: str, t_ns: int) -> Sequence[int]:
        """Return the values of all joints: in an engine the present ones, else those last set."""
        motors = self.motors
        if not self.shows_limits and quantity in MOTION:
            return bytes(MAX_JOINTS)
        if motors is None or not motors.is_in_engine:
            return self.state[quantity]
        share = np.abs(motors.forces) / motors.strength
        match quantity:
            case "angles":
                values = quantize(motors.positions(t_ns), 1.0, 0, 0xFF)
            case "faults":
                values = OVERLOAD_FAULT * (motors.stalled & (share > OVERLOAD_SHARE))
            case "currents":
                values = quantize(share, 0xFF, 0, 0xFF)
            case _:
                return self.state[quantity]
        return values.astype(np.uint8).tobytes()

    # -- datasheet -------------------------------------------------------------------------------------------------

    @property
    def commands(self) -> tuple[Command, ...]:
        """Requests for identity, joints, and matrices or quantities."""
        rows = [f"@ {LINKERBOT}"]
        for code, what in ((0xC1, "PCB"), (0xC2, "firmware"), (0xC4, "mechanical")):
            rows.append(f"? {what} version  {code:02X}  {code:02X} {self.versions[code].hex()}")
        if self.pcb_echoes:
            rows.append("? PCB version with 01  C1 01  C1 01 01 00 04")
        rows += [
            f"@ {TABLE if self.in_table else PYTHON}",
            "? serial number  C0  " + ", ".join(f"C0 {k * self.serial_step:02X} *" for k in range(4)),
            f"? touch sensor  B0  B0 {self.touch.number:02X}",
        ]
        if self.degrees_of_freedom:
            rows.append(f"? identity (older)  64  64 {self.degrees_of_freedom:02X} 06 16 .. 24 11 00")
        if self.has_id:
            rows.append(f"id  C3  C3 {self.arbitration_id:02X}")
        if self.in_table:
            rows.append("forget the calibration  CD  CD 72 65 73 74 61 72 74")
        for code, view in self.views.items():
            rows += view.commands(code)
        for code, others in self.together.items():
            answers = ", ".join(self.views[other].answer(other) for other in others)
            rows.append(f"? all of these  {code:02X}  {answers}")
        for k, quantity in enumerate(QUANTITIES, self.first_quantity):
            rows.append(f"{quantity}  {k:02X}" if self.has_matrix else f"? {quantity}  {k:02X}  {k:02X} ..{{5}}")
        if self.has_matrix:
            for part in range(PALM_PART + any(self.touch.palm)):
                rows += self._matrix_commands(part)
        to = f"{self.arbitration_id:03X}#"
        to_all = Command(name="id, asked of all", request="0FF#C3", reply=f"{to}C3..", origin=TABLE)
        return (*command_table("\n".join(rows), head=to), *[to_all] * self.in_table)

    def _matrix_commands(self, part: int) -> list[str]:
        """Return the rows of requests for one matrix."""
        name, code = (*FINGERS, "palm")[part], f"{FIRST_MATRIX_COMMAND + part:02X}"
        (rows, columns), parts = self.touch.part(part)
        probe = f"? sum of the {name}  {code}  {code} ..{{2}}"
        if not parts and part != PALM_PART:
            answers = ", ".join(f"{code} {row:X}0 ..{{{columns}}}" for row in range(rows))
            return [probe, f"? matrix {name}  {code} {rows << 4 | columns:02X}  {answers}"]
        selector, n = f"{code} {rows:02X} {columns:02X}", rows * columns
        pieces = ", ".join(
            f"{code} {k // columns:02X} {k % columns:02X} ..{{{min(VALUES_PER_FRAME, n - k)}}}"
            for k in range(0, n, VALUES_PER_FRAME)
        )
        with_sums = f"? matrix {name} and sums  {selector} 01  {pieces}, {code} FF ..{{{2 * len(parts)}}}"
        return [probe, f"? matrix {name}  {selector}  {pieces}", *[with_sums] * bool(parts)]
