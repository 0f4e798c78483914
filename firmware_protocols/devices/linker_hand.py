"""LinkerHand L6 to L25, G20 (fingertips of 12 x 6 taxels) and O6 (10 x 4): CAN, polled, a matrix row per frame.

Wire: classic CAN, 1 Mbit/s, one standard id per hand in both directions: 0x28 left, 0x27 right. Byte 0 is the command;
an answer repeats id and command. ``f`` = 0 thumb .. 4 little finger, 5 palm.

    request          answer                                             about
    B1+f C6          12 x [B1+f, row << 4, 6 x u8]                      12 x 6 matrix, raw 0..255, row by row
    B1+f A4          10 x [B1+f, row << 4, 4 x u8]                      10 x 4 matrix (O6)
    B1+f R C         [B1+f, row, column, 5 x u8] ..                     R x C matrix, row by row, 5 numbers a frame
    B1+f R C any     the same, then [B1+f, FF, 1 to 3 x u16 LE]         matrix, and the sums of its parts
    B1+f             [B1+f, u16 LE]                                     sum of the matrix; two bytes = matrix sensor
    B0               [B0, type]                                         touch: 1 four quantities, 2 12x6, 4 10x4, 5, 7
    20 21 22 23      [cmd, 5 x u8]                                      normal, tangential, direction, approach (older)
    C0               4 x [C0, i, 6 ASCII]                               serial number, NUL padded; i = 0, 1, 2, 3
    C1, C2, C4       [cmd, major, minor, patch]                         PCB, firmware, mechanical version; C1 as a ping
    C1 01 (L6, L10)  [C1, 01, major, minor, patch]                      PCB version
    64 (L6-L10 O6)   [64, dof, mech, serial, 'L'|'R', sw, hw, rev]      older identity; versions in nibbles
    01 02 05         [cmd, 6 x u8]                                      joint angles, torques, speeds
    33 35 36         [cmd, 6 x u8]                                      temperatures, faults, currents (not L7)
    cmd n x u8       [cmd, n x u8]                                      set; answered like a query after it

Two bytes request a matrix of R rows and C columns in the palm, and on all fingers of the sensors 5 and 7; one byte, R
<< 4 | C, requests other fingers. Sensor 5: fingers 23 x 9 (tip 11 rows, middle 6, root 6: three sums), palm 28 x 20
(upper and lower half: two sums). Sensor 7: fingers 12 x 6, palm 14 x 16, one sum each. Other palms: 14 x 15 beside 12 x
6 and 10 x 10 beside 10 x 4, without sums. A palm requested as C x R comes column by column. Four quantities: 20..23, of
the hands in the vendor's table 90..93.

L10: ``i`` of the serial number is 0, 6, 12, 18. Its ten joints come in two parts: angles 01 (6) and 04 (4); torques
02 03, speeds 05 06, temperatures 33 34 and faults 35 36 (5 and 5); 09 answers as 01, 04, 02, 03. L6: 83 01 x 6 clears
faults. O6: 87 are accelerations. L7: 01 02 05 33 35 have seven bytes.

L20: five bytes, a finger each: angles 01 pitch, 02 yaw, 03 roll, 04 tip; 05 speeds, 06 currents, 07 faults (01 clears);
11..17 set the same without an answer; temperatures 09 0B 0C 0D.

L25, L21, G20, and the L20 as V10 or V11, have six joints on each finger (yaw, roll, root 1, 2, 3, tip; used: all four
of the thumb but root 2 and 3, of the others yaw, root 1, tip), and three ways to each quantity:

    quantity      one joint of all fingers, 5 bytes        one finger, 6 bytes    whole fingers, 5 bytes
    angles        01 roll 02 yaw 03 04 05 roots 06 tip     41+f
    speeds        09..0E                                   49+f                   81
    torques       11..16                                   51+f                   82
    faults        19..1E                                   59+f                   83                        01 clears
    temperatures  21..26                                   61+f                   84

A set changes the goal or the limit, an answer has the present value: speeds and torques are 0 in a still hand. They
answer to id FF, too, under their own. ``C3`` answers ``C3 id``, ``C3 n`` sets it from the next power-up, ``CD`` answers
"restart" and drops the calibration. L25, L21: 85 with 5 x 01 disables, with 00 enables fingers.

The fifth field of the serial number is the kind of touch sensor: A four quantities, B 12 x 6, F and J 10 x 4, Z none;
B1, F1 with a palm.
Evidence: the vendor's CAN table of the L20 V10, V11, L25 and G20, and the vendor's drivers; no firmware was available.

Try it: ``tactemu run linker_hand_l6 --port can:udp_multicast:239.74.163.2``, then
``linkerbot.L6("left", "239.74.163.2", "udp_multicast").force_sensor.get_blocking()``.
"""

from typing import Annotated, Any, ClassVar, Literal

from firmware_protocols import Option, assumed, fact_table, stated
from firmware_protocols.devices.linker_hand_base import (
    JOINT_STROKES_RAD, OVERLOAD_SHARE, PYTHON, ROS2, SDKS, STRENGTH_NM, STROKE_S, TABLE, LinkerHand,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_joints import (
    BY_TABLE, SEVEN_JOINTS, SIX_JOINTS, TEN_JOINTS, TWENTY_JOINTS, Views, joint_view,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_touch import (
    COUNTS_PER_NEWTON, FINGER_SPACING_M, PALM_DISTANCE_M, PITCH_M, TABLE_SENSORS,
)  # fmt: skip

Shown = Annotated[
    Literal["present", "set"], Option("what speeds and torques answer: the present values, or the limits set")
]
READ = "linkerhand-python-sdk@b371361 and -ros2-sdk@bba0b9d core/can, doc; linkerbot 0.5.4 hand; the vendor's table"
"""The files that were read for what is assumed."""
L21_TOPIC = f"{ROS2} doc/Topic-Reference.md:140, what an L21 published"
FACTS = fact_table(f"""
    stated touch: raw 0..255, more under more force @ {TABLE} G70
    stated touch: one byte, rows in its high bits and columns in its low ones, asks for a matrix @ {TABLE} H71
    stated touch: rows begin at the tip (11 of the tip, 6 of the middle, 6 of the root) @ {TABLE} H70
    stated touch: palms of 14 x 15, 14 x 4, 10 x 10 beside fingers @ {ROS2} linker_hand_l6_can.py:80-106
    stated touch: B1..B5 alone answer a sum of two bytes @ {ROS2} linker_hand_g20_can.py:590
    measured touch: the second of them is 0 when nothing touches, so it is no number of columns @ {L21_TOPIC}
    assumed touch: it is the low byte first, as in the frames of sums, and the sum of the counts @ {READ}
    assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N of normal force per taxel (no scale is published) @ {READ}
    assumed touch: pitch {PITCH_M * 1000.0} mm, fingertips side by side every {FINGER_SPACING_M * 1000.0:.0f} mm, a palm
        {PALM_DISTANCE_M * 1000.0:.0f} mm below them @ {READ}
    assumed touch: another size's selector, and four quantities of a matrix hand, get silence @ {READ}
    assumed touch: four quantities: sums in the matrix's scale, direction 256 steps a turn, approach 0 @ {READ}
    stated identity: letters A, B, F are sensors 1, 2, 4 @ {ROS2} linker_hand_g20_can.py:258
    assumed identity: B0 answers the same on an L6, L10 and O6 @ {READ}
    assumed identity: the versions, the serial number's other fields @ {READ}
    stated configuration: a set is answered by the present value @ linkerbot 0.5.4 hand/*/angle.py
    assumed configuration: joints go at once where they are sent; power-up: angles 80, limits FF, 30 degrees @ {READ}
    stated timing: an answer begins within 1 ms @ {TABLE}, remarks, 7
    stated timing: one finger at a time; drivers wait 2.5 ms between @ linkerbot 0.5.4 l6/force_sensor.py:202
    assumed timing: 100 Hz conversion; an answer begins at once @ {READ}
""")
OLDER_FACTS = fact_table(f"""
    measured identity: 64 of a right L10: 10, 6, 22, 82, 20, 17, 0 @ {PYTHON} doc/API-Reference.md:98
    assumed identity: software 2.4, from which on the L10's driver reads torques, and the same of an L6, O6 @ {READ}
""")
MOTOR_FACTS = fact_table(f"""
    assumed configuration: 255 is open, 0 closed ({", ".join(f"{j} {s} rad" for j, s in JOINT_STROKES_RAD.items())}) @
        {READ}
    assumed configuration: in an engine a stroke takes {STROKE_S} s at speed 255; torque 255 is {STRENGTH_NM} Nm and
        1400 mA; fault bit 3 while a joint is stalled at more than {OVERLOAD_SHARE:.0%} of that @ {READ}
""")
TABLE_FACTS = fact_table(f"""
    stated touch: sensors 5 and 7: sizes, two bytes, a third for sums behind FF @ {TABLE} H70, H71
    stated touch: frames of row, column, five numbers; sums u16 LE @ {ROS2} linker_hand_g20_can.py:485-556
    stated touch: the palm of 5 is 20 x 28, and asked for so @ {TABLE} H70; C++ library
    stated touch: it is 28 x 20, and asked for so @ {ROS2} linker_hand_g20_can.py:557, doc/Topic-Reference.md:131
    assumed touch: it is 28 x 20; asked for the other way round, a palm comes so @ {READ}
    assumed touch: a sum is that of the counts, at most FFFF; letter B beside sensors 5 and 7 @ {READ}
    stated identity: 21 characters in four frames; a frame that is not full ends them @ {TABLE} H77; C++ library
    stated identity: C1, C2, C4 answer three numbers; C3 the id, FF is a broadcast @ {TABLE} H78..H81
    assumed identity: FF is answered under the hand's own id @ {TABLE}, remarks, 5
    stated configuration: sets and answers of one form; wrong ones get no answer @ {TABLE}, remarks, 2, 6
    stated configuration: a finger is yaw, roll, root 1, 2, 3, tip; which are used @ {TABLE} H32, J3..P8
    stated configuration: speeds and torques answer what is, not the limits @ {TABLE} E8..E19, remarks, 2
    measured configuration: so does an L21: speeds 0, 1, 4, 6, torques 0 to 16, reserved joints 0 @ {L21_TOPIC}
    stated configuration: shown=set: speeds are those set @ linkerhand-cpp-sdk@a0100cf docs/API-Reference.md:158
    stated configuration: angles 80 in the example of 41, reserved ones too @ {TABLE} H32
    stated configuration: one byte sets the roll of the thumb @ linkerhand-cpp-sdk@a0100cf, its library sends it
    assumed configuration: whole fingers: mean of the used joints, faults of any of them @ {READ}
""")
L25_FACTS = fact_table(f"""
    stated configuration: sets of five bytes behind 49..4D, 51..55; 85 @ {PYTHON} linker_hand_l25_can.py:418-463
    assumed configuration: five bytes leave the tip as it is; 85 answers what was set and disables nothing @ {READ}
    stated configuration: the vendor's classes take roll for the first of a finger @ {PYTHON} linker_hand_l25_can.py:620
    stated identity: version_numbers=4: shown from four numbers on @ linkerhand-cpp-sdk@a0100cf, L25Hand::getVersion
    measured identity: an L21 has four: 7, 0, 0, 0 @ {L21_TOPIC}
""")
L20_FACTS = fact_table(f"""
    stated configuration: joints, 05 06 07, silent from 11 on, C3, CF @ {PYTHON} linker_hand_l20_can.py:11-32
    stated configuration: a query may carry 00; 09 0B 0C 0D are temperatures @ {PYTHON} linker_hand_l20_can.py:236, 377,
        392
    assumed configuration: hardware V10 and V11 follow the table, others the vendor's class @ {READ}
""")


class LinkerHandL6(LinkerHand):
    """An L6: 12 x 6 fingertips, six joints."""

    name = "linker_hand_l6"
    title = "LinkerHand L6, 5 fingertips 12x6"
    facts = (*FACTS, *OLDER_FACTS, *MOTOR_FACTS)
    model = "L6"
    views = {**SIX_JOINTS, 0x83: joint_view("faults", 6, access="clear")._replace(name="faults of 83")}


class LinkerHandL7(LinkerHand):
    """An L7: 12 x 6 fingertips, seven joints."""

    name = "linker_hand_l7"
    title = "LinkerHand L7, 5 fingertips 12x6"
    judge = f"linker-bot/{PYTHON}"
    facts = (
        *FACTS,
        *OLDER_FACTS,
        *fact_table(f"""
        stated configuration: seven values of angles, torques, speeds, temperatures, faults; no fault is cleared @
            {PYTHON} linker_hand_l7_can.py:136-170, 406
        stated configuration: the order is thumb flexion, abduction, four fingers, thumb rotation @ {PYTHON}
            linker_hand_l7_can.py:400
        """),
    )
    model = "L7"
    palms = {}
    degrees_of_freedom = 7
    has_motors = False
    views = SEVEN_JOINTS


class LinkerHandL10(LinkerHand):
    """An L10: 12 x 6 fingertips, ten joints."""

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
    """An O6: 10 x 4 fingertips; it has no request C1 01 for the PCB version."""

    name = "linker_hand_o6"
    title = "LinkerHand O6, 5 fingertips 10x4"
    facts = (*FACTS, *OLDER_FACTS, *MOTOR_FACTS)
    model = "O6"
    sensor = "10x4"
    pcb_echoes = False
    views = {**SIX_JOINTS, 0x87: joint_view("accelerations", 6, access="set")}


class TableHand(LinkerHand):
    """A hand of the vendor's table: commands for joints of all fingers, of one finger, or for merged fingers."""

    evidence = ("vendor document", "driver")
    facts = (*FACTS, *TABLE_FACTS)
    degrees_of_freedom = 0
    pcb_echoes = False
    has_motors = False
    has_id = True
    in_table = True
    palms = TABLE_SENSORS
    first_quantity = 0x90
    series = "010"
    views = BY_TABLE

    def __init__(self, *, shown: Shown = "present", **options: Any):
        self.shows_limits = shown == "set"
        super().__init__(**options)


class LinkerHandL25(TableHand):
    """An L25: 12 x 6 fingertips, joints by finger."""

    name = "linker_hand_l25"
    title = "LinkerHand L25, 5 fingertips 12x6"
    judge = SDKS
    model = "L25"
    facts = (*FACTS, *TABLE_FACTS, *L25_FACTS)
    zero_asks = True
    views: ClassVar[Views] = {
        **BY_TABLE,
        **{code + f: BY_TABLE[code + f]._replace(least=5) for code in (0x49, 0x51) for f in range(5)},
        0x85: joint_view("disabled", 5, access="set")._replace(name="disabled fingers"),
    }

    def __init__(
        self,
        *,
        version_numbers: Annotated[
            int, Option("numbers in C1, C2, C4: 3 as in the vendor's table, 4 for its C++ library", low=3, high=4)
        ] = 3,
        **options: Any,
    ):
        super().__init__(**options)
        self.versions = {code: numbers.ljust(version_numbers, b"\0") for code, numbers in self.versions.items()}


class LinkerHandL21(LinkerHandL25):
    """An L21: 12 x 6 fingertips, joints by finger, versions of four numbers."""

    name = "linker_hand_l21"
    title = "LinkerHand L21, 5 fingertips 12x6"
    judge = f"linker-bot/{PYTHON}"
    model = "L21"
    versions = dict.fromkeys(LinkerHandL25.versions, b"\x07\0\0\0")
    facts = (
        *FACTS,
        *TABLE_FACTS,
        *L25_FACTS,
        *fact_table(f"""
        assumed identity: C2 and C4 answer as C1 @ {READ}
        assumed configuration: what no source says of an L21 is as of an L25: its driver sends the same requests @
            {PYTHON} linker_hand_l21_can.py, linker_hand_l25_can.py, both whole
        """),
    )


class LinkerHandG20(TableHand):
    """A G20: 12 x 6 fingertips; a palm by option."""

    name = "linker_hand_g20"
    title = "LinkerHand G20, 5 fingertips 12x6"
    model = "G20"


class LinkerHandL20(LinkerHand):
    """An L20: 12 x 6 fingertips, twenty joints; as V10 or V11 a hand of the vendor's table."""

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
        hardware: Annotated[Literal["first", "V10"], Option("V10, like V11, follows the vendor's table")] = "first",
        shown: Shown = "present",
        **options: Any,
    ):
        if hardware == "V10":
            self.in_table, self.zero_asks, self.palms = True, False, TABLE_SENSORS
            self.first_quantity, self.views, self.shows_limits = 0x90, BY_TABLE, shown == "set"
            self.series = "010"
        super().__init__(**options)
