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
    stated touch: values are raw, 0..255, and rise with the force @ {TABLE} G70
    stated touch: one byte, with the rows in its high bits and the columns in its low ones, requests a matrix @ {TABLE}
        H71
    stated touch: rows begin at the tip (11 on the tip, 6 on the middle, 6 on the root) @ {TABLE} H70
    stated touch: palms have 14 x 15, 14 x 4 or 10 x 10 taxels, besides those of the fingers @ {ROS2}
        linker_hand_l6_can.py:80-106
    stated touch: B1..B5 without a size are answered with a sum of two bytes @ {ROS2} linker_hand_g20_can.py:590
    measured touch: the second of these bytes is 0 when nothing touches, so it is no number of columns @ {L21_TOPIC}
    assumed touch: the two bytes are the sum of the counts, low byte first as in the frames of sums @ {READ}
    assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N of normal force per taxel (no scale is published) @ {READ}
    assumed touch: the pitch is {PITCH_M * 1000.0} mm; fingertips lie side by side, {FINGER_SPACING_M * 1000.0:.0f} mm
        apart, and a palm {PALM_DISTANCE_M * 1000.0:.0f} mm below them @ {READ}
    assumed touch: a request for a matrix of another size, and one for the four quantities of a hand with matrices, get
        no answer @ {READ}
    assumed touch: the four quantities: sums in the scale of a matrix, the direction in 256 steps per turn, approach 0 @
        {READ}
    stated identity: the letters A, B, F in a model code stand for sensors 1, 2, 4 @ {ROS2} linker_hand_g20_can.py:258
    assumed identity: B0 is answered alike by an L6, L10 and O6 @ {READ}
    assumed identity: the versions, and the other fields of the serial number @ {READ}
    stated configuration: a set command is answered with the present value @ linkerbot 0.5.4 hand/*/angle.py
    assumed configuration: joints move to their goals at once; after power-up angles are 80, limits FF, temperatures 30
        deg C @ {READ}
    stated timing: an answer begins within 1 ms @ {TABLE}, remarks, 7
    stated timing: requests are for one finger at a time; drivers wait 2.5 ms between them @ linkerbot 0.5.4
        l6/force_sensor.py:202
    assumed timing: touch is sampled 100 times a second; an answer begins at once @ {READ}
""")
OLDER_FACTS = fact_table(f"""
    measured identity: message 64 of a right L10 has 10, 6, 22, 82, 20, 17, 0 @ {PYTHON} doc/API-Reference.md:98
    assumed identity: software 2.4, the first version whose torques the L10's driver reads; L6 and O6 have the same @
        {READ}
""")
MOTOR_FACTS = fact_table(f"""
    assumed configuration: 255 is open, 0 closed ({", ".join(f"{j} {s} rad" for j, s in JOINT_STROKES_RAD.items())}) @
        {READ}
    assumed configuration: in a physics engine a stroke takes {STROKE_S} s at speed 255; torque 255 is {STRENGTH_NM} Nm
        and 1400 mA; fault bit 3 is set while a joint is stalled at more than {OVERLOAD_SHARE:.0%} of that @ {READ}
""")
TABLE_FACTS = fact_table(f"""
    stated touch: sensors 5 and 7: the size is given by two bytes; a third byte requests sums, which follow FF @ {TABLE}
        H70, H71
    stated touch: frames have row, column and five numbers; sums are u16, low byte first @ {ROS2}
        linker_hand_g20_can.py:485-556
    stated touch: the palm of sensor 5 is 20 x 28, and is requested as 20 x 28 @ {TABLE} H70; C++ library
    stated touch: the palm is 28 x 20, and is requested as 28 x 20 @ {ROS2} linker_hand_g20_can.py:557,
        doc/Topic-Reference.md:131
    assumed touch: the palm is 28 x 20; a request with rows and columns exchanged is answered in that order @ {READ}
    assumed touch: a sum is that of the counts, at most FFFF; sensors 5 and 7 have the letter B @ {READ}
    stated identity: the text has 21 characters in four frames; a frame that is not full ends it @ {TABLE} H77; C++
        library
    stated identity: C1, C2 and C4 are answered with three numbers, C3 with the id; the id FF is a broadcast @ {TABLE}
        H78..H81
    assumed identity: a request to FF is answered under the hand's own id @ {TABLE}, remarks, 5
    stated configuration: set commands and answers have the same format; wrong ones get no answer @ {TABLE}, remarks, 2,
        6
    stated configuration: a finger has the joints yaw, roll, root 1, 2, 3 and tip; the list of those in use @ {TABLE}
        H32, J3..P8
    stated configuration: requests for speeds and torques are answered with the present values, not the limits @ {TABLE}
        E8..E19, remarks, 2
    measured configuration: an L21 does the same: it answered speeds 0, 1, 4, 6, torques 0 to 16, and 0 for reserved
        joints @ {L21_TOPIC}
    stated configuration: option shown=set: the speeds shown are the limits that were set @ linkerhand-cpp-sdk@a0100cf
        docs/API-Reference.md:158
    stated configuration: angles are 80 in the example for message 41, also those of reserved joints @ {TABLE} H32
    stated configuration: a message with one byte sets the roll of the thumb @ linkerhand-cpp-sdk@a0100cf, its library
        sends it
    assumed configuration: values of whole fingers are the mean of the joints in use, and the faults of any of them @
        {READ}
""")
L25_FACTS = fact_table(f"""
    stated configuration: set commands have five bytes after 49..4D and 51..55; and command 85 @ {PYTHON}
        linker_hand_l25_can.py:418-463
    assumed configuration: a set command of five bytes does not change the tip; 85 is answered with what was set and
        disables nothing @ {READ}
    stated configuration: the vendor's classes take the roll for a finger's first joint @ {PYTHON}
        linker_hand_l25_can.py:620
    stated identity: option version_numbers=4: the driver shows a version if it has four numbers or more @
        linkerhand-cpp-sdk@a0100cf, L25Hand::getVersion
    measured identity: the version of an L21 has four numbers: 7, 0, 0, 0 @ {L21_TOPIC}
""")
L20_FACTS = fact_table(f"""
    stated configuration: the joints; 05, 06 and 07; no answers from 11 on; C3 and CF @ {PYTHON}
        linker_hand_l20_can.py:11-32
    stated configuration: a query may have an additional byte 00; 09, 0B, 0C and 0D are temperatures @ {PYTHON}
        linker_hand_l20_can.py:236, 377, 392
    assumed configuration: hardware V10 and V11 follow the table, other versions the vendor's class @ {READ}
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
        stated configuration: angles, torques, speeds, temperatures and faults have seven values each; faults cannot be
            cleared @ {PYTHON} linker_hand_l7_can.py:136-170, 406
        stated configuration: the order is thumb flexion, thumb abduction, four fingers, thumb rotation @ {PYTHON}
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
        stated(
            "identity", "the frames of the serial number count bytes", f"{ROS2} linker_hand_l10_can.py:78, linkerbot"
        ),
        stated("identity", "in an older driver they count frames", f"{PYTHON} linker_hand_l10_can.py:72"),
        stated("configuration", "09 requests angles and torques", f"{PYTHON} linker_hand_l10_can.py:197"),
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
        assumed identity: C2 and C4 are answered like C1 @ {READ}
        assumed configuration: where no source says anything about an L21, it is modelled like an L25: its driver sends
            the same requests @ {PYTHON} linker_hand_l21_can.py, linker_hand_l25_can.py, both whole
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
