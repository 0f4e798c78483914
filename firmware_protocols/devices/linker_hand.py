"""LinkerHand L6, L10, L20, L25, G20 (fingertips of 12 x 6 taxels) and O6 (10 x 4): CAN, polled, a matrix row a frame.

Wire: classic CAN, 1 Mbit/s, one standard id per hand in both directions: 0x28 left, 0x27 right. Byte 0 is the command;
an answer repeats id and command. ``f`` = 0 thumb .. 4 little finger, 5 palm.

    request          answer                                             about
    B1+f C6          12 x [B1+f, row << 4, 6 x u8]                      12 x 6 matrix, raw 0..255, row by row
    B1+f A4          10 x [B1+f, row << 4, 4 x u8]                      10 x 4 matrix (O6)
    B1+f R C         [B1+f, row, column, 5 x u8] ..                     R x C matrix, row by row, 5 numbers a frame
    B1+f R C any     the same, then [B1+f, FF, 1 to 3 x u16 LE]         and the sums of its parts
    B1+f             [B1+f, u16 LE]                                     sum of the matrix; two bytes = matrix sensor
    B0               [B0, type]                                         touch: 1 four quantities, 2 12x6, 4 10x4, 5, 7
    20 21 22 23      [cmd, 5 x u8]                                      normal, tangential, direction, approach (older)
    C0               4 x [C0, i, 6 ASCII]                               serial number, NUL padded; i = 0, 1, 2, 3
    C1, C2, C4       [cmd, major, minor, patch]                         PCB, firmware, mechanical version; C1 as a ping
    C1 01 (L6, L10)  [C1, 01, major, minor, patch]                      PCB version
    64 (L6 L10 O6)   [64, dof, mech, serial, 'L'|'R', sw, hw, rev]      older identity; versions in nibbles
    01 02 05         [cmd, 6 x u8]                                      joint angles, torques, speeds
    33 35 36         [cmd, 6 x u8]                                      temperatures, faults, currents
    cmd n x u8       [cmd, n x u8]                                      set; the answer is what a query answers then

A matrix of R rows and C columns is asked for by two bytes in the palm, and on all fingers of the sensors 5 and 7; the
fingers of the others want one byte, R << 4 | C. Sensor 5: fingers 23 x 9 (tip 11 rows, middle 6, root 6: three sums),
palm 28 x 20 (upper and lower half: two sums). Sensor 7: fingers 12 x 6, palm 14 x 16, one sum each. Other palms: 14 x
15 beside 12 x 6 and 10 x 10 beside 10 x 4, without sums. A palm that is asked for as C x R comes column by column. Four
quantities: 20..23, of the hands in the vendor's table 90..93.

L10: ``i`` of the serial number is 0, 6, 12, 18. Its ten joints come in two parts: angles 01 (6) and 04 (4); torques
02 03, speeds 05 06, temperatures 33 34 and faults 35 36 (5 and 5); 09 answers as 01, 04, 02, 03. L6: 83 01 x 6 clears
faults. O6: 87 are accelerations.

L20: five bytes, a finger each: angles 01 pitch, 02 yaw, 03 roll, 04 tip; 05 speeds, 06 currents, 07 faults (01 clears);
11..17 set the same without an answer; temperatures 09 0B 0C 0D.

L25, G20, and the L20 as V10 or V11, have six joints a finger (yaw, roll, root 1, 2, 3, tip; used: all four of the thumb
but root 2 and 3, of the others yaw, root 1, tip), and three ways to each quantity:

    quantity      one joint of all fingers, 5 bytes        one finger, 6 bytes    whole fingers, 5 bytes
    angles        01 roll 02 yaw 03 04 05 roots 06 tip     41+f
    speeds        09..0E                                   49+f                   81
    torques       11..16                                   51+f                   82
    faults        19..1E                                   59+f                   83                        01 clears
    temperatures  21..26                                   61+f                   84

What is set is the goal or the limit, what is answered is how it is now: speeds and torques at rest are 0. They
answer to id FF, too, under their own. ``C3`` answers ``C3 id``, ``C3 n`` sets it from the next power-up, ``CD`` answers
"restart" and forgets the calibration. L25: 85 with 5 x 01 disables, with 00 enables fingers.

The fifth field of the serial number is the kind of touch sensor: A four quantities, B 12 x 6, F and J 10 x 4, Z none;
B1, F1 with a palm.
Evidence: the vendor's CAN table of the L20 V10, V11, L25 and G20, and the vendor's drivers; no firmware was seen.

Try it: ``tactemu run linker_hand_l6 --port can:udp_multicast:239.74.163.2``, then
``linkerbot.L6("left", "239.74.163.2", "udp_multicast").force_sensor.get_blocking()``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Annotated, ClassVar, Literal, NamedTuple

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
    Reading,
    Transmissions,
    grid_layout,
)
from firmware_protocols.adc import quantize
from firmware_protocols.facts import assumed, measured, stated
from firmware_protocols.layouts import stack
from firmware_protocols.motors import Motors

FINGERS = ("thumb", "index", "middle", "ring", "little")
FINGER_SPACING = 0.025
PALM_DISTANCE = 0.06
PITCH = 0.0015
COUNTS_PER_NEWTON = 500.0
FIRST_FINGER = 0xB1
PALM = 5
BROADCAST = 0xFF
JOINTS = {"thumb_flex": 1.2, "thumb_abd": 1.5, "index": 1.6, "middle": 1.6, "ring": 1.6, "pinky": 1.6}
"""Joints of a hand with six, and how far each goes from open (255) to closed (0) [rad]."""
STROKE_S = 0.5
STRENGTH_NM = 0.8
OVERLOAD = 0.9
OVERLOADED = 8
SERIAL_BYTES = 24
OLDER_IDENTITY = b"\x06\x16"
OLDER_VERSIONS = b"\x24\x11\x00"
"""Mechanical version and number; software 2.4, hardware 1.1, revision."""
MOST_JOINTS = 30
VALUES_PER_FRAME = 5
"""Numbers of a matrix in a frame that says where they begin."""


class Touch(NamedTuple):
    """A kind of touch sensor."""

    number: int
    """In the answer to B0."""
    letter: str
    """Fifth field of the serial number."""
    finger: tuple[int, int]
    """Rows and columns."""
    palm: tuple[int, int] = (0, 0)
    finger_parts: tuple[int, ...] = ()
    """Rows of each part that has a sum; such fingers are asked for by two bytes."""
    palm_parts: tuple[int, ...] = ()


QUANTITIES = ("normal forces", "tangential forces", "directions", "approach")
SENSORS = {"quantities": Touch(1, "A", (12, 6)), "12x6": Touch(2, "B", (12, 6)), "10x4": Touch(4, "F", (10, 4))}
"""Sensors without a palm."""
PALMS = {"12x6": Touch(2, "B1", (12, 6), (14, 15)), "10x4": Touch(4, "F1", (10, 4), (10, 10))}
WHOLE_HANDS = {
    "12x6": Touch(7, "B", (12, 6), (14, 16), (12,), (14,)),
    "23x9": Touch(5, "B", (23, 9), (28, 20), (11, 6, 6), (14, 14)),
}
"""Sensors with a palm of the hands in the vendor's table."""

TABLE = "linkerhand-ros2-sdk@bba0b9d core/can/L20_V10_V11-..._V1.0.5.xlsx"
SDK = "linkerhand-python-sdk@b371361"
LINKERBOT = "linkerbot 0.5.4"
SOURCES = (
    "linkerbot 0.5.4 hand/{l6,o6}/force_sensor.py, version.py, comm/can/can.py",
    "linkerbot 0.5.4 hand/l20lite (ten joints, like the L10), hand/l25 (joints by finger)",
    "linker-bot/linkerhand-python-sdk@b371361 LinkerHand/core/can/linker_hand_{l6,l10,o6,l20,l25,g20}_can.py",
    "linker-bot/linkerhand-ros2-sdk@bba0b9d LinkerHand/core/can/L20_V10_V11-..._V1.0.5.xlsx, linker_hand_*_can.py",
    "linker-bot/linkerhand-cpp-sdk@a0100cf docs/API-Reference.md; its library as a driver",
)

AT_REST = {"angles": 0x80, "torques": 0xFF, "speeds": 0xFF, "temperatures": 0x1E}
"""At power-up, by quantity; others are 0."""
MOTION = ("speeds", "torques")
"""Quantities whose limits are set, and which the hands in the vendor's table answer as they are now."""


class View(NamedTuple):
    """The joints that one command shows."""

    name: str
    quantity: str
    groups: tuple[tuple[int, ...], ...]
    """Joints that each byte stands for: it sets all of them, and shows their mean, or the faults of any."""
    access: Literal["", "set", "clear"] = ""
    answers: bool = True
    least: int = 0
    """Bytes that are enough to set the first joints; 0: all of them."""


Views = Mapping[int, View]


def _view(quantity: str, n: int, first: int = 0, access: Literal["", "set", "clear"] = "", **more: bool) -> View:
    """Return a byte for each of ``n`` joints in a row."""
    name = quantity if not first and n > VALUES_PER_FRAME else f"{quantity} {first + 1} to {first + n}"
    return View(name, quantity, tuple((first + k,) for k in range(n)), access, **more)


SIX_JOINTS: Views = {
    0x01: _view("angles", 6, access="set"),
    0x02: _view("torques", 6, access="set"),
    0x05: _view("speeds", 6, access="set"),
    0x33: _view("temperatures", 6),
    0x35: _view("faults", 6),
    0x36: _view("currents", 6),
}
TEN_JOINTS: Views = {
    0x01: _view("angles", 6, access="set"),
    0x04: _view("angles", 4, 6, "set"),
    **{0x02 + k: _view("torques", 5, 5 * k, "set") for k in range(2)},
    **{0x05 + k: _view("speeds", 5, 5 * k, "set") for k in range(2)},
    **{0x33 + k: _view("temperatures", 5, 5 * k) for k in range(2)},
    **{0x35 + k: _view("faults", 5, 5 * k) for k in range(2)},
}


def _twenty() -> dict[int, View]:
    """Pitch, yaw, roll, tip of five fingers; from 11 on without an answer."""
    named = [(0x01 + k, f"{joint} angles", _view("angles", 5, 5 * k, "set")) for k, joint in enumerate(IN_TWENTY)]
    named += [
        (0x05, "speeds", _view("speeds", 5, access="set")),
        (0x06, "currents", _view("currents", 5, access="set")),
    ]
    named += [(0x07, "faults", _view("faults", 5, access="clear"))]
    views = {code: view._replace(name=name) for code, name, view in named}
    views |= {code + 0x10: view._replace(name=f"{name}, silent", answers=False) for code, name, view in named}
    for k, (code, joint) in enumerate(zip((0x09, 0x0B, 0x0C, 0x0D), IN_TWENTY)):
        views[code] = _view("temperatures", 5, 5 * k)._replace(name=f"{joint} temperatures")
    return views


IN_TWENTY = ("pitch", "yaw", "roll", "tip")
TWENTY_JOINTS: Views = _twenty()
IN_FINGER = ("yaw", "roll", "root 1", "root 2", "root 3", "tip")
IN_TABLE = ("roll", "yaw", "root 1", "root 2", "root 3", "tip")
"""Joints in the order of their commands."""
USED = tuple(6 * f + k for f in range(5) for k in (0, 1, 2, 5) if f == 0 or k != 1)


def _by_table() -> dict[int, View]:
    """Return the vendor's table: quantity, command of the roll joints, of the thumb, of whole fingers."""
    views = {}
    accesses: dict[str, Literal["", "set", "clear"]] = {"faults": "clear", "temperatures": ""}
    for quantity, joint, finger, merged in (
        ("angles", 0x01, 0x41, 0),
        ("speeds", 0x09, 0x49, 0x81),
        ("torques", 0x11, 0x51, 0x82),
        ("faults", 0x19, 0x59, 0x83),
        ("temperatures", 0x21, 0x61, 0x84),
    ):
        access = accesses.get(quantity, "set")
        for k, name in enumerate(IN_TABLE):
            one_each = tuple((6 * f + IN_FINGER.index(name),) for f in range(5))
            least = 1 if name == "roll" else 0  # the thumb alone has such a joint
            views[joint + k] = View(f"{name} {quantity}", quantity, one_each, access, least=least)
        for f, name in enumerate(FINGERS):
            views[finger + f] = _view(quantity, 6, 6 * f, access)._replace(name=f"{quantity} of the {name}")
        if merged:
            whole = tuple(tuple(k for k in USED if k // 6 == f) for f in range(5))
            views[merged] = View(f"{quantity} of whole fingers", quantity, whole, access)
    return views


BY_TABLE: Views = _by_table()


Side = Annotated[Literal["left", "right"], Option("which hand; sets the id")]
Kind = Annotated[
    Literal["matrix", "12x6", "10x4", "23x9", "quantities"],
    Option("the model's own matrix, another, or the older sensor: four numbers a finger"),
]
Palm = Annotated[bool, Option("a matrix in the palm, too; 23x9 always has one")]
SerialNumber = Annotated[
    str, Option(f"at most {SERIAL_BYTES} characters of ASCII; default: as the model, side and touch sensor want it")
]
Shown = Annotated[Literal["present", "set"], Option("what speeds and torques answer: how it is now, or the limits set")]


READ = "linkerhand-python-sdk@b371361 and -ros2-sdk@bba0b9d core/can, doc; linkerbot 0.5.4 hand; the vendor's table"
"""Files that were read whole for what is assumed."""
ROS2 = "linkerhand-ros2-sdk@bba0b9d"
PYTHON = "linkerhand-python-sdk@b371361"
SDKS = f"linkerbot 0.5.4, linker-bot/{PYTHON}, linker-bot/linkerhand-cpp-sdk@a0100cf"
L21_TOPIC = f"{ROS2} doc/Topic-Reference.md:140, what an L21 published"
FACTS = (
    stated("touch", "raw 0..255, more under more force", f"{TABLE} G70"),
    stated("touch", "one byte, rows in its high bits and columns in its low ones, asks for a matrix", f"{TABLE} H71"),
    stated("touch", "rows begin at the tip (11 of the tip, 6 of the middle, 6 of the root)", f"{TABLE} H70"),
    stated("touch", "palms of 14 x 15, 14 x 4, 10 x 10 beside fingers", f"{ROS2} linker_hand_l6_can.py:80-106"),
    stated("touch", "B1..B5 alone answer a sum of two bytes", f"{ROS2} linker_hand_g20_can.py:590"),
    measured("touch", "the second of them is 0 when nothing touches, so it is no number of columns", L21_TOPIC),
    assumed("touch", "it is the low byte first, as in the frames of sums, and the sum of the counts", READ),
    assumed("touch", f"{COUNTS_PER_NEWTON:.0f} counts/N of normal force per taxel (no scale is published)", READ),
    assumed(
        "touch", f"pitch {PITCH * 1e3} mm, fingertips side by side every {FINGER_SPACING * 1e3:.0f} mm, a palm "
        f"{PALM_DISTANCE * 1e3:.0f} mm below them", READ,
    ),
    assumed("touch", "another size's selector, and four quantities of a matrix hand, get silence", READ),
    assumed("touch", "four quantities: sums in the matrix's scale, direction 256 steps a turn, approach 0", READ),
    stated("identity", "letters A, B, F are sensors 1, 2, 4", f"{ROS2} linker_hand_g20_can.py:258"),
    assumed("identity", "B0 answers the same on an L6, L10 and O6", READ),
    assumed("identity", "the versions, the serial number's other fields", READ),
    stated("configuration", "a set is answered by the present value", "linkerbot 0.5.4 hand/*/angle.py"),
    assumed("configuration", "joints go at once where they are sent; power-up: angles 80, limits FF, 30 degrees", READ),
    stated("timing", "an answer begins within 1 ms", f"{TABLE}, remarks, 7"),
    stated("timing", "one finger at a time; drivers wait 2.5 ms between", "linkerbot 0.5.4 l6/force_sensor.py:202"),
    assumed("timing", "100 Hz conversion; an answer begins at once", READ),
)  # fmt: skip
OLDER_FACTS = (
    measured("identity", "64 of a right L10: 10, 6, 22, 82, 20, 17, 0", f"{PYTHON} doc/API-Reference.md:98"),
    assumed("identity", "software 2.4, from which on the L10's driver reads torques, and the same of an L6, O6", READ),
)
MOTOR_FACTS = (
    assumed("configuration", f"255 is open, 0 closed ({', '.join(f'{j} {s} rad' for j, s in JOINTS.items())})", READ),
    assumed(
        "configuration", f"in an engine a stroke takes {STROKE_S} s at speed 255; torque 255 is {STRENGTH_NM} Nm and "
        f"1400 mA; fault bit 3 while a joint is stalled at more than {OVERLOAD:.0%} of that", READ,
    ),
)  # fmt: skip
TABLE_FACTS = (
    stated("touch", "sensors 5 and 7: sizes, two bytes, a third for sums behind FF", f"{TABLE} H70, H71"),
    stated("touch", "frames of row, column, five numbers; sums u16 LE", f"{ROS2} linker_hand_g20_can.py:485-556"),
    stated("touch", "the palm of 5 is 20 x 28, and asked for so", f"{TABLE} H70; C++ library"),
    stated(
        "touch", "it is 28 x 20, and asked for so", f"{ROS2} linker_hand_g20_can.py:557, doc/Topic-Reference.md:131"
    ),
    assumed("touch", "it is 28 x 20; asked for the other way round, a palm comes so", READ),
    assumed("touch", "a sum is that of the counts, at most FFFF; letter B beside sensors 5 and 7", READ),
    stated("identity", "21 characters in four frames; a frame that is not full ends them", f"{TABLE} H77; C++ library"),
    stated("identity", "C1, C2, C4 answer three numbers; C3 the id, FF is a broadcast", f"{TABLE} H78..H81"),
    assumed("identity", "FF is answered under the hand's own id", f"{TABLE}, remarks, 5"),
    stated("configuration", "sets and answers of one form; wrong ones get no answer", f"{TABLE}, remarks, 2, 6"),
    stated("configuration", "a finger is yaw, roll, root 1, 2, 3, tip; which are used", f"{TABLE} H32, J3..P8"),
    stated("configuration", "speeds and torques answer what is, not the limits", f"{TABLE} E8..E19, remarks, 2"),
    measured("configuration", "so does an L21: speeds 0, 1, 4, 6, torques 0 to 16, reserved joints 0", L21_TOPIC),
    stated("configuration", "shown=set: speeds are those set", "linkerhand-cpp-sdk@a0100cf docs/API-Reference.md:158"),
    stated("configuration", "angles 80 in the example of 41, reserved ones too", f"{TABLE} H32"),
    stated("configuration", "one byte sets the roll of the thumb", "linkerhand-cpp-sdk@a0100cf, its library sends it"),
    assumed("configuration", "whole fingers: mean of the used joints, faults of any of them", READ),
)
L25_FACTS = (
    stated("configuration", "sets of five bytes behind 49..4D, 51..55; 85", f"{PYTHON} linker_hand_l25_can.py:418-463"),
    assumed("configuration", "five bytes leave the tip as it is; 85 answers what was set and disables nothing", READ),
    stated(
        "configuration",
        "the vendor's classes take roll for the first of a finger",
        f"{PYTHON} linker_hand_l25_can.py:620",
    ),
    stated(
        "identity", "version_numbers=4: shown from four numbers on", "linkerhand-cpp-sdk@a0100cf, L25Hand::getVersion"
    ),
    measured("identity", "an L21 has four: 7, 0, 0, 0", L21_TOPIC),
)
L20_FACTS = (
    stated("configuration", "joints, 05 06 07, silent from 11 on, C3, CF", f"{PYTHON} linker_hand_l20_can.py:11-32"),
    stated(
        "configuration",
        "a query may carry 00; 09 0B 0C 0D are temperatures",
        f"{PYTHON} linker_hand_l20_can.py:236, 377, 392",
    ),
    assumed("configuration", "hardware V10 and V11 are what the table describes, others what the class speaks", READ),
)


class LinkerHand(Device[CanFrame]):
    """Five fingertips that answer one request each with their matrix."""

    columns = (Column(name="touch", low=0, high=255, push=1),)
    evidence = ("driver",)
    sources = SOURCES
    facts = (*FACTS, *OLDER_FACTS, *MOTOR_FACTS)
    kind = "hand"
    judge = f"{SDKS}, linker-bot/{ROS2}"
    model: ClassVar[str]
    sensor: ClassVar[str] = "12x6"
    """Key of its own touch sensor."""
    palms: Mapping[str, Touch] = PALMS
    series: str = "03"
    """Second field of the serial number."""
    versions: Mapping[int, bytes] = {0xC1: b"\x01\x00\x04", 0xC2: b"\x01\x02\x03", 0xC4: b"\x02\x00\x01"}
    """Major, minor, patch by command."""
    pcb_echoes: ClassVar[bool] = True
    """Whether C1 01 asks for the PCB version, too."""
    degrees_of_freedom: ClassVar[int] = 6
    """In the older identity; 0: has none."""
    serial_step: ClassVar[int] = 1
    """From one frame of the serial number to the next."""
    first_quantity: int = 0x20
    views: Views = SIX_JOINTS
    """Commands about joints."""
    together: ClassVar[Mapping[int, tuple[int, ...]]] = {}
    """Commands that answer as several others do."""
    has_motors: ClassVar[bool] = True
    """Whether an engine can move its joints, of which there are six."""
    has_id: ClassVar[bool] = False
    """Whether C3 asks for the id, and sets it."""
    zero_asks: bool = False
    """Whether one byte 00 behind a command is a query, too."""
    in_table: bool = False
    """Whether it is as the vendor's table says."""
    shows_limits: bool = True
    """Whether speeds and torques answer what was set, not how it is now."""

    def __init__(
        self, *, side: Side = "left", touch: Kind = "matrix", palm: Palm = False, serial_number: SerialNumber = ""
    ):
        self._power_up(side, touch, palm, serial_number)

    def _power_up(self, side: str, touch: str, palm: bool, serial_number: str) -> None:
        if len(serial_number) > SERIAL_BYTES or not serial_number.isascii():
            raise ValueError(
                f"option serial_number: expected {SERIAL_BYTES} characters of ASCII, got {serial_number!r}"
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
            view.quantity: bytearray([AT_REST.get(view.quantity, 0)] * MOST_JOINTS) for view in self.views.values()
        }
        if self.in_table:
            self.state["temperatures"] = bytearray(AT_REST["temperatures"] * (k in USED) for k in range(MOST_JOINTS))
        self.motors: Motors | None = None
        if self.has_motors:
            self.motors = Motors(
                [AT_REST["angles"]] * len(JOINTS), low=0, high=0xFF, time_constant_s=0.0, speed_limit=0xFF / STROKE_S,
                names=tuple(JOINTS), unit=[-stroke / 0xFF for stroke in JOINTS.values()], zero=0xFF,
                strength=STRENGTH_NM,
            )  # fmt: skip

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Raw counts 0..255 of the normal force of each taxel, uint8, shape ``(n_taxels,)``."""
        tips = self.layout.to_taxel_frame(reading["force"])[: len(FINGERS) * np.prod(self.touch.finger)]
        self.counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 255).astype(np.uint8)
        self.quantities = _four_quantities(tips.reshape(len(FINGERS), -1, 3).sum(axis=1))
        return self.counts

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """How far each joint of a hand with six is closed [rad]."""
        return self.motors.joints(t_ns) if self.motors else {}

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Answer one request frame; frames for others, and what is not documented, get silence."""
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
        """What follows the command in each answer. Requests are matched whole: ``None`` if it is none."""
        part, quantity = command - FIRST_FINGER, command - self.first_quantity
        match command, payload:
            case _ if command in self.views:
                return self._joints(self.views[command], payload, t_ns)
            case _ if 0 <= part <= PALM:
                return self._matrix(part, payload)
            case _, b"" if 0 <= quantity < len(QUANTITIES):
                return [] if self.has_matrix else [self.quantities[quantity].tobytes()]
            case 0xB0, b"":
                return [bytes([self.touch.number])]
            case 0xC0, b"":
                text = self.serial_number.encode("ascii")
                text = text if self.in_table else text.ljust(SERIAL_BYTES, b"\0")
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
        """Return the matrix of one sample: rows are never of different age."""
        size, parts = self.touch.finger, self.touch.finger_parts
        if part == PALM:
            size, parts = self.touch.palm, self.touch.palm_parts
        if not self.has_matrix or not any(size):
            return None
        matrix = self.layout.on_wire(self.counts)[self.layout.patches[part].taxels].reshape(size)
        rows, columns = size
        if not payload:
            return [_sums(matrix, (rows,))]
        if not parts and part != PALM:
            whole = [bytes([k << 4]) + row.tobytes() for k, row in enumerate(matrix)]
            return whole if payload == bytes([rows << 4 | columns]) else None
        sums = b"\xff" + _sums(matrix, parts)
        if payload[:2] == bytes([columns, rows]) and part == PALM and rows != columns:
            matrix, rows, columns = matrix.T, columns, rows
        if payload[:2] != bytes([rows, columns]) or len(payload) > 2 + bool(parts):
            return None
        flat = matrix.tobytes()
        starts = range(0, len(flat), VALUES_PER_FRAME)
        pieces = [bytes(divmod(k, columns)) + flat[k : k + VALUES_PER_FRAME] for k in starts]
        return [*pieces, sums] if len(payload) > 2 else pieces

    def _joints(self, view: View, payload: bytes, t_ns: int) -> list[bytes] | None:
        """Set joints, or clear their faults, and answer how they are."""
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
        """What was set acts on the motors."""
        if self.motors is None:
            return
        values = np.frombuffer(self.state[quantity], np.uint8, len(JOINTS)).astype(float)
        match quantity:
            case "angles":
                self.motors.go(values, t_ns)
            case "torques":
                self.motors.limit_force(values / 0xFF)
            case "speeds":
                self.motors.limit_speed(values / STROKE_S, t_ns)

    def _shown(self, quantity: str, t_ns: int) -> Sequence[int]:
        """Return numbers of all joints: in an engine as they are, else what was last set."""
        motors = self.motors
        if not self.shows_limits and quantity in MOTION:
            return bytes(MOST_JOINTS)
        if motors is None or not motors.is_in_engine:
            return self.state[quantity]
        share = np.abs(motors.forces) / motors.strength
        match quantity:
            case "angles":
                values = quantize(motors.positions(t_ns), 1.0, 0, 0xFF)
            case "faults":
                values = OVERLOADED * (motors.stalled & (share > OVERLOAD))
            case "currents":
                values = quantize(share, 0xFF, 0, 0xFF)
            case _:
                return self.state[quantity]
        return values.astype(np.uint8).tobytes()

    # -- datasheet -------------------------------------------------------------------------------------------------

    @property
    def commands(self) -> tuple[Command, ...]:
        """Identity, joints, matrices or quantities."""
        to, touch = f"{self.arbitration_id:03X}#", self.touch
        source = TABLE if self.in_table else SDK

        def command(name: str, request: str, *replies: str, origin: str = source) -> Command:
            answers = [to + reply for reply in replies]
            return Command(name=name, request=to + request, reply=answers or None, origin=origin)

        listed = [
            command("serial number", "C0", *(f"C0 {k * self.serial_step:02X} *" for k in range(4))),
            *(command(f"{what} version", f"{code:02X}", f"{code:02X} {self.versions[code].hex(' ')}", origin=LINKERBOT)
              for code, what in ((0xC1, "PCB"), (0xC2, "firmware"), (0xC4, "mechanical"))),
            command("touch sensor", "B0", f"B0 {touch.number:02X}"),
        ]  # fmt: skip
        if self.degrees_of_freedom:
            listed.append(command("identity (older)", "64", f"64 {self.degrees_of_freedom:02X} 06 16 .. 24 11 00"))
        if self.pcb_echoes:
            listed.append(command("PCB version with 01", "C1 01", "C1 01 01 00 04", origin=LINKERBOT))
        if self.has_id:
            listed.append(command("id", "C3", f"C3 {self.arbitration_id:02X}"))
        if self.in_table:
            listed.append(command("forget the calibration", "CD", "CD 72 65 73 74 61 72 74"))
            listed.append(Command(name="id, asked of all", request="0FF#C3", reply=f"{to}C3..", origin=TABLE))
        for code, view in self.views.items():
            n = len(view.groups)
            answer = f"{code:02X} ..{{{n}}}"
            answers = [answer] if view.answers else []
            listed.append(command(view.name, f"{code:02X}", *answers))
            if view.access:
                verb, byte = ("set", " 40") if view.access == "set" else ("clear", " 01")
                listed.append(command(f"{verb} {view.name} by {code:02X}", f"{code:02X}" + n * byte, *answers))
        for code, others in self.together.items():
            answers = [f"{other:02X} ..{{{len(self.views[other].groups)}}}" for other in others]
            listed.append(command("all of these", f"{code:02X}", *answers))
        for k, quantity in enumerate(QUANTITIES, self.first_quantity):
            answers = [] if self.has_matrix else [f"{k:02X} ..{{5}}"]
            listed.append(command(quantity, f"{k:02X}", *answers))
        if self.has_matrix:
            listed += [command(*each) for part in range(PALM + any(touch.palm)) for each in self._matrix_commands(part)]
        return tuple(listed)

    def _matrix_commands(self, part: int) -> list[tuple[str, ...]]:
        """Name, request and answers of what asks for one matrix."""
        name, code = (*FINGERS, "palm")[part], f"{FIRST_FINGER + part:02X}"
        (rows, columns), parts = self.touch.finger, self.touch.finger_parts
        if part == PALM:
            (rows, columns), parts = self.touch.palm, self.touch.palm_parts
        probe = f"sum of the {name}", code, f"{code} ..{{2}}"
        if not parts and part != PALM:
            selector = f"{code} {rows << 4 | columns:02X}"
            return [probe, (f"matrix {name}", selector, *(f"{code} {row:X}0 ..{{{columns}}}" for row in range(rows)))]
        selector, n = f"{code} {rows:02X} {columns:02X}", rows * columns
        pieces = [
            f"{code} {k // columns:02X} {k % columns:02X} ..{{{min(VALUES_PER_FRAME, n - k)}}}"
            for k in range(0, n, VALUES_PER_FRAME)
        ]
        with_sums = f"matrix {name} and sums", f"{selector} 01", *pieces, f"{code} FF ..{{{2 * len(parts)}}}"
        return [probe, (f"matrix {name}", selector, *pieces), *([with_sums] if parts else [])]


def _sums(matrix: np.ndarray, rows: Sequence[int]) -> bytes:
    """Sums of so many rows each, u16 LE."""
    parts = np.split(matrix, np.cumsum(rows)[:-1])
    return b"".join(min(int(part.sum()), 0xFFFF).to_bytes(2, "little") for part in parts)


def _four_quantities(force: np.ndarray) -> np.ndarray:
    """Return normal, tangential, direction, approach under ``force`` [N] of shape ``(5, 3)``; uint8 ``(4, 5)``."""
    turn = np.arctan2(force[:, 1], force[:, 0]) / (2 * np.pi) % 1.0
    normal = quantize(-force[:, 2], COUNTS_PER_NEWTON, 0, 255)
    tangential = quantize(np.hypot(force[:, 0], force[:, 1]), COUNTS_PER_NEWTON, 0, 255)
    direction = np.rint(turn * 256).astype(int) % 256
    return np.stack([normal, tangential, direction, np.zeros(5, int)]).astype(np.uint8)


def pads(finger: tuple[int, int], palm: tuple[int, int] = (0, 0)) -> Layout:
    """Flat pads on links of their names, fingertips side by side along x, thumb at the smallest x, tips to +y."""
    places = {name: (finger, ((i - 2) * FINGER_SPACING, 0.0, 0.0)) for i, name in enumerate(FINGERS)}
    if any(palm):
        places["palm"] = palm, (0.0, -PALM_DISTANCE, 0.0)
    return stack(*(grid_layout(*size, PITCH, name=f, origin=p, link=f) for f, (size, p) in places.items()))


class LinkerHandL6(LinkerHand):
    """L6: 12 x 6 fingertips, six joints."""

    name = "linker_hand_l6"
    title = "LinkerHand L6, 5 fingertips 12x6"
    model = "L6"
    views = {**SIX_JOINTS, 0x83: _view("faults", 6, access="clear")._replace(name="faults of 83")}


class LinkerHandL10(LinkerHand):
    """L10: 12 x 6 fingertips, ten joints."""

    name = "linker_hand_l10"
    title = "LinkerHand L10, 5 fingertips 12x6"
    model = "L10"
    palms = {}
    has_motors = False
    facts = (
        *FACTS,
        *OLDER_FACTS,
        stated("identity", "frames of the serial number count bytes", f"{ROS2} linker_hand_l10_can.py:78, linkerbot"),
        stated("identity", "they count frames in an older driver", f"{PYTHON} linker_hand_l10_can.py:72"),
        stated("configuration", "09 asks for angles and torques", f"{PYTHON} linker_hand_l10_can.py:197"),
        assumed("configuration", "09 is answered by frames 01, 04, 02, 03", READ),
    )
    degrees_of_freedom = 10
    serial_step = 6
    views = TEN_JOINTS
    together = {0x09: (0x01, 0x04, 0x02, 0x03)}


class LinkerHandO6(LinkerHand):
    """O6: 10 x 4 fingertips; asks for the PCB version in its own way."""

    name = "linker_hand_o6"
    title = "LinkerHand O6, 5 fingertips 10x4"
    model = "O6"
    sensor = "10x4"
    pcb_echoes = False
    views = {**SIX_JOINTS, 0x87: _view("accelerations", 6, access="set")}


class TableHand(LinkerHand):
    """A hand of the vendor's table: joints of all fingers, of one, or whole fingers."""

    evidence = ("vendor document", "driver")
    facts = (*FACTS, *TABLE_FACTS)
    degrees_of_freedom = 0
    pcb_echoes = False
    has_motors = False
    has_id = True
    in_table = True
    palms = WHOLE_HANDS
    first_quantity = 0x90
    series = "010"
    views = BY_TABLE

    def __init__(
        self,
        *,
        side: Side = "left",
        touch: Kind = "matrix",
        palm: Palm = False,
        serial_number: SerialNumber = "",
        shown: Shown = "present",
    ):
        self.shows_limits = shown == "set"
        self._power_up(side, touch, palm, serial_number)


class LinkerHandL25(TableHand):
    """L25: 12 x 6 fingertips, joints by finger."""

    name = "linker_hand_l25"
    title = "LinkerHand L25, 5 fingertips 12x6"
    judge = SDKS
    model = "L25"
    facts = (*FACTS, *TABLE_FACTS, *L25_FACTS)
    zero_asks = True
    views: ClassVar[Views] = {
        **BY_TABLE,
        **{code + f: BY_TABLE[code + f]._replace(least=5) for code in (0x49, 0x51) for f in range(5)},
        0x85: _view("disabled", 5, access="set")._replace(name="disabled fingers"),
    }

    def __init__(
        self,
        *,
        side: Side = "left",
        touch: Kind = "matrix",
        palm: Palm = False,
        serial_number: SerialNumber = "",
        shown: Shown = "present",
        version_numbers: Annotated[
            int, Option("of C1, C2, C4: 3 as the vendor's table says, 4 as its C++ library wants them", low=3, high=4)
        ] = 3,
    ):
        super().__init__(side=side, touch=touch, palm=palm, serial_number=serial_number, shown=shown)
        self.versions = {code: numbers.ljust(version_numbers, b"\0") for code, numbers in self.versions.items()}


class LinkerHandG20(TableHand):
    """G20: 12 x 6 fingertips; a palm by option."""

    name = "linker_hand_g20"
    title = "LinkerHand G20, 5 fingertips 12x6"
    model = "G20"


class LinkerHandL20(LinkerHand):
    """L20: 12 x 6 fingertips, twenty joints; as V10 or V11 a hand of the vendor's table."""

    name = "linker_hand_l20"
    title = "LinkerHand L20, 5 fingertips 12x6"
    judge = SDKS
    model = "L20"
    facts = (*FACTS, *L20_FACTS, *TABLE_FACTS)
    degrees_of_freedom = 0
    pcb_echoes = False
    has_motors = False
    has_id = zero_asks = True
    palms = {}
    views = TWENTY_JOINTS

    def __init__(
        self,
        *,
        side: Side = "left",
        touch: Kind = "matrix",
        palm: Palm = False,
        serial_number: SerialNumber = "",
        hardware: Annotated[Literal["first", "V10"], Option("V10 and V11 are as the vendor's table says")] = "first",
        shown: Shown = "present",
    ):
        if hardware == "V10":
            self.in_table, self.zero_asks, self.palms = True, False, WHOLE_HANDS
            self.first_quantity, self.views, self.shows_limits = 0x90, BY_TABLE, shown == "set"
            self.series = "010"
        self._power_up(side, touch, palm, serial_number)
