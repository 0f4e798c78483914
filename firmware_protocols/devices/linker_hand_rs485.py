"""LinkerHand L10 on RS-485: fingertips of 12 x 6 taxels, one at a time, in Modbus registers.

Wire: RS-485, 115200 8N1, Modbus RTU; unit 0x28 is a left hand, 0x27 a right one. Functions 03, 04, 06, 16; each number
is a register's low byte, so 0..255:

    register  numbers  access  about
    0         10       rw      joint angles
    10, 20    10, 10   rw      torques, speeds
    40, 50    10, 10   r       temperatures, faults
    70        1        rw      selects the finger of 72..157: 1 thumb .. 5 little finger
    72        10       r       unknown; drivers drop them
    82        72       r       matrix of that finger, raw, row by row
    158       6        r       version

A driver writes 70, waits 8 ms, reads the input registers 72..167 (function 04) and keeps 82..153.

Evidence: the vendor's SDK reads and writes these; no manual was seen. The same hand on CAN is ``linker_hand_l10``.

Try it: ``tactemu run linker_hand_l10_rs485``, then ``28 06 00 46 00 02 EE 27`` and ``28 04 00 48 00 60 77 CD``.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Device, Option, RegisterMap, Registers, Rs485, Transmissions, command_table, fact_table,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_base import OLDER_IDENTITY, OLDER_VERSIONS
from firmware_protocols.devices.linker_hand_touch import COUNTS_PER_NEWTON, FINGER_SPACING_M, PITCH_M, pads
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns

MAP = RegisterMap(
    """
    0    >u2 x 10  angles        0..255  = 128
    20   >u2 x 10  torques       0..255  = 255
    40   >u2 x 10  speeds        0..255  = 255
    80   >u2 x 10  temperatures  0..255  = 30  r
    140  >u2       finger        0..5
    164  >u2 x 72  matrix        0..255  r
    316  >u2 x 6   version       0..255  r
    """,
    size=2 * 168,
)
"""Offsets count bytes: two for each register."""
BAUD = 115200
SDK_FILE = "linkerhand-python-sdk@b371361 LinkerHand/core/rs485/linker_hand_l10_rs485.py"
READ = "linkerhand-python-sdk@b371361 and linkerhand-ros2-sdk@bba0b9d core/rs485, doc"
COMMANDS = command_table(
    f"""
    @ {SDK_FILE} l.110-170
    select finger 1                    06 00 46 00 01 AE 26                        =
    select finger 2                    06 00 46 00 02 EE 27                        =
    select finger 3                    06 00 46 00 03 2F E7                        =
    select finger 4                    06 00 46 00 04 6E 25                        =
    select finger 5                    06 00 46 00 05 AF E5                        =
    matrix of finger 1                 06 00 46 00 01 AE 26; 04 00 48 00 60 77 CD  04 C0 ..{{192}} ..{{2}}
    matrix of finger 2                 06 00 46 00 02 EE 27; 04 00 48 00 60 77 CD  04 C0 ..{{192}} ..{{2}}
    matrix of finger 3                 06 00 46 00 03 2F E7; 04 00 48 00 60 77 CD  04 C0 ..{{192}} ..{{2}}
    matrix of finger 4                 06 00 46 00 04 6E 25; 04 00 48 00 60 77 CD  04 C0 ..{{192}} ..{{2}}
    matrix of finger 5                 06 00 46 00 05 AF E5; 04 00 48 00 60 77 CD  04 C0 ..{{192}} ..{{2}}
    ? angles                           04 00 00 00 0A 77 F4                        04 14 ..{{20}} ..{{2}}
    ? temperatures                     04 00 28 00 0A F7 FC                        04 14 ..{{20}} ..{{2}}
    ? faults                           04 00 32 00 0A D6 3B                        04 14 ..{{20}} ..{{2}}
    ? version                          04 00 9E 00 06 16 1F                        04 0C ..{{12}} ..{{2}}
    set a torque                       06 00 0A 00 80 AF 91                        =
    set a speed                        06 00 14 00 40 CF C7                        =
    set two angles                     10 00 00 00 02 04 00 40 00 40 76 D7         10 00 00 00 02 46 31
    @ Modbus application protocol V1.1b3, 7
    ? matrix as holding registers      03 00 48 00 60 C2 0D                        03 C0 ..{{192}} ..{{2}}
    write a matrix: illegal address    06 00 48 00 01 CF E5                        86 02 12 69
    finger 6: illegal value            06 00 46 00 06 EF E4                        86 03 D3 A9
    ? beyond the map: illegal address  04 00 A8 00 01 B7 D3                        84 02 13 09
    write a coil: illegal function     05 00 00 00 00 CA 33                        85 01 52 98
    """,
    head="28",
)
"""Requests to a left hand."""


class LinkerHandL10Rs485(Device):
    """An L10 on RS-485."""

    name = "linker_hand_l10_rs485"
    kind = "hand"
    title = "LinkerHand L10 on RS-485, 5 fingertips 12x6"
    ports = (Rs485(baud=BAUD),)
    columns = (Column(name="touch", low=0, high=255, assumed_per_unit=COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    sources = (
        "linker-bot/linkerhand-python-sdk@b371361 LinkerHand/core/rs485/linker_hand_l10_rs485.py l.110-170",
        "linker-bot/linkerhand-python-sdk@b371361 LinkerHand/linker_hand_api.py l.22-24 (units)",
        "Modbus application protocol V1.1b3; Modbus over serial line V1.02",
    )
    judge = "linker-bot/linkerhand-python-sdk@b371361"
    documented_with = None
    facts = fact_table(f"""
        stated touch: register 70 selects a finger, within 8 ms; 96 numbers follow from 72 on, of which 82..153 are 12
            rows of 6 @ {SDK_FILE}:110-170
        stated touch: the numbers are in the low bytes @ {SDK_FILE}:151
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N of normal force per taxel (no scale is published) @ {READ}
        assumed touch: the pitch is {PITCH_M * 1000.0} mm; fingertips lie side by side, {FINGER_SPACING_M * 1000.0:.0f}
            mm apart; row 0 is at the tip @ {READ}
        assumed touch: the ten numbers before the matrix and those after it are 0 @ {READ}
        assumed touch: no finger is shown until one is selected; the selected one is shown at once, with the present
            forces @ {READ}
        stated identity: from register 158 on: degrees of freedom, version, number, side, software and hardware @
            {SDK_FILE}:69-79
        assumed identity: they are the numbers of message 64 on CAN, without the last @ {READ}
        stated configuration: the units; input registers for reading, function 16 for writing @ {SDK_FILE}:15-66,
            173-204
        assumed configuration: functions 03 and 04 read the same registers @ {READ}
        assumed configuration: joints report what was last set, and have no faults; the state after power-up is that on
            CAN @ {READ}
        assumed configuration: writes to other registers get exception 2; values above 255 and fingers above 5 get
            exception 3 @ {READ}
        stated timing: the driver waits 5 ms between calls and 8 ms after a write to 70, and up to 50 ms for an answer @
            {SDK_FILE}:8, 22, 139
        assumed timing: touch is sampled 100 times a second; an answer begins after the silence that Modbus demands @
            {READ}
    """)

    def __init__(self, *, side: Annotated[Literal["left", "right"], Option("which hand; sets the unit")] = "left"):
        self.unit = 0x28 if side == "left" else 0x27
        self.layout = pads((12, 6))
        self.registers = Registers(MAP)
        self.registers["version"] = [10, *OLDER_IDENTITY, ord(side[0].upper()), *OLDER_VERSIONS[:2]]
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(BAUD))
        self.counts = np.zeros(len(self.layout), np.int64)
        self.documented = COMMANDS if side == "left" else ()

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        return self.rtu.answers(data, t_ns, {self.unit: Banks(holding=self, inputs=self, functions=(3, 4, 6, 16))})

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return registers, with the matrix of the selected finger."""
        finger = self.registers["finger"]
        patch = self.layout.patches[finger - 1]
        self.registers["matrix"] = self.layout.on_wire(self.counts)[patch.taxels] if finger else 0
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes; joints answer what was set."""
        return self.registers.write(address, data)
