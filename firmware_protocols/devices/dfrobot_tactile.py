"""DFRobot tactile sensor: a matrix of 4 x 8 or 6 x 6 taxels in Modbus registers.

Wire: RS-485, 8N1, 9600, 57600, 115200 or 921600 baud, Modbus RTU; functions 03, 04, 06, 16.

    input register  about
    0, 1            vendor and product, 3343
    5, 6            version, state: 1
    7..             ADC value of each taxel, 0..4095: 32 or 36, row by row from the bottom
    43              0: 4 x 8, 1: 6 x 6

    holding register  about
    2                 unit: the answer already comes from the new one
    3, 4              line speed (3: 9600, 7: 57600, 8: 115200, 9: 921600), stop bits and parity
    6                 threshold 0..4095, 50 as delivered: lower values read 0
    7                 any write: resets all but the unit to the values as delivered
    8                 0: 20 readings a second, 1: 50

The vendor's driver swaps the bytes that it writes to holding registers, so these are *low byte first*, and reverses the
rows that it reads: its first row is the last one in the registers. It opens /dev/ttyAMA0.

Try it: ``tactemu run dfrobot_tactile``, then ``01 04 00 07 00 20 40 13`` for 32 values.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Option, Reading, RegisterMap, Registers, Rs485, Transmissions, command_table, fact_table,
    grid_layout,
)  # fmt: skip
from firmware_protocols.protocols.modbus import Banks, Rtu, rtu, silence_ns

INPUTS = RegisterMap(
    """
    0   >u2       vendor   = 13123  r
    2   >u2       product  = 13123  r
    10  >u2       version  = 256  r
    12  >u2       state    = 1  r
    14  >u2 x 36  values   0..4095  r
    86  >u2       model    0..1  r
    """
)
HOLDING = RegisterMap(
    """
    4   <u2  unit       1..247  = 1  flash
    6   <u2  speed      3..9  = 8  flash
    8   u1   stop       0..3  = 1  flash
    9   u1   parity     0..3  flash
    12  <u2  threshold  0..4095  = 50  flash
    14  u1 x 2  reset
    16  <u2  rate       0..1  flash
    """
)
"""Offsets count bytes: two for each register."""
SIZES = {"4x8": (4, 8), "6x6": (6, 6)}
PERIODS_NS = (50_000_000, 20_000_000)
SPEED_CODES = {9600: 3, 57600: 7, 115200: 8, 921600: 9}
DRIVER = "DFRobot/DFRobot_TactileSensor@962a7b3"
PYTHON = f"{DRIVER} python/raspberrypi/DFRobot_Tactile_Sensor.py"
HEADER = f"{DRIVER} src/DFRobot_TactileSensor.h"
ALL = "DFRobot_Tactile_Sensor.py, DFRobot_TactileSensor.cpp, .h, get_tactile_data.py, README.md (all whole)"
COUNTS_PER_NEWTON = 400.0
PITCH_M = 0.005


class DfrobotTactile(Device):
    """A matrix of taxels that a driver polls."""

    name = "dfrobot_tactile"
    title = "DFRobot tactile sensor, 4x8 or 6x6"
    kind = "fingertip"
    columns = (Column(name="touch", low=0, high=4095, assumed_per_unit=COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    sources = (
        f"{DRIVER} python/raspberrypi, src (the vendor's own)",
        "Modbus application protocol V1.1b3; Modbus over serial line V1.02",
    )
    judge = DRIVER
    documented = command_table(
        """
        @ DFRobot/DFRobot_TactileSensor@962a7b3 python/raspberrypi, src (the vendor's own)
        ? vendor                            04 00 00 00 01 31 CA                 04 02 33 43 EC 31
        ? product                           04 00 01 00 01 60 0A                 04 02 33 43 EC 31
        ? version                           04 00 05 00 01 21 CB                 0402..{2} ..{2}
        ? state                             04 00 06 00 01 D1 CB                 04 02 00 01 78 F0
        ? 32 values                         04 00 07 00 20 40 13                 0440..{64} ..{2}
        ? 36 values                         04 00 07 00 24 41 D0                 0448..{72} ..{2}
        ? model                             04 00 2B 00 01 41 C2                 0402..{2} ..{2}
        ? unit                              03 00 02 00 01 25 CA                 03 02 01 00 B9 D4
        unit 1 again, bytes turned          06 00 02 01 00 29 9A                 =
        line speed 115200, bytes turned     06 00 03 08 00 7E 0A                 =
        one stop bit, no parity             06 00 04 01 00 C9 9B                 =
        threshold 300, bytes turned         06 00 06 2C 01 B4 CB                 =
        50 readings a second, bytes turned  06 00 08 01 00 09 98                 =
        settings as delivered               06 00 07 00 00 38 0B                 =
        unit and line speed                 10 00 02 00 02 04 01 00 03 00 73 7A  10 00 02 00 02 E0 08
        @ Modbus application protocol V1.1b3; Modbus over serial line V1.02
        line speed 2: illegal value         06 00 03 02 00 78 AA                 86 03 02 61
        threshold 4096: illegal value       06 00 06 00 10 68 07                 86 03 02 61
        ? beyond the map: illegal address   04 00 2C 00 01 F0 03                 84 02 C2 C1
        write a product: illegal address    06 00 01 00 01 19 CA                 86 02 C3 A1
        read coils: illegal function        01 00 00 00 01 FD CA                 81 01 81 90
        """,
        head="01",
    )
    documented_with = ("model", "baud")
    facts = fact_table(f"""
        stated touch: each register has one value; rows are numbered from the bottom @ {PYTHON}:131-150
        stated touch: register 43 is 0 for 4 rows of 8 taxels, 1 for 6 rows of 6 @ {PYTHON}:91-116
        stated touch: the threshold is 0 to 4095, and 50 as delivered @ {HEADER}:120
        assumed touch: values below the threshold read 0; values are 0 to 4095, with 400 counts/N and a pitch of 5 mm
        stated identity: product 3343 @ {HEADER}:91
        assumed identity: the vendor has the same number; the version is 0100
        stated identity: the driver reports a state of 1 as true @ {PYTHON}:216
        assumed identity: the state is always 1
        stated configuration: the codes 3, 7, 8 and 9 of line speeds @ {HEADER}:30-33
        stated configuration: the high byte has the code of the stop bits, 0 to 3, the low byte that of the parity @
            {PYTHON}:190
        stated configuration: the codes of parity are even 2 and odd 3 in the Python driver, even 1 and odd 2 in the C++
            driver @ {PYTHON}:78-80; {HEADER}:41-43
        stated configuration: on the device a new speed takes effect at once; the model stores it without effect @
            {DRIVER} get_tactile_data.py:61
        stated configuration: a new unit takes effect at once: the drivers wait for no answer from the old one @
            {PYTHON}:160-173
        assumed configuration: the answer to this write comes from the new unit
        stated configuration: a write to register 7 restores threshold, address, line settings and rate @ {HEADER}:135
        stated configuration: the unit does not change with it, neither in the driver nor in the model @ {DRIVER}
            get_tactile_data.py:51
        stated configuration: unit 1 and 115200 baud as delivered @ {DRIVER} examples/getTactileData/getTactileData.ino
        assumed configuration: settings survive power-off; all other registers read 0
        stated timing: 20 or 50 readings a second @ {HEADER}:80-83
        assumed timing: 20 readings a second as delivered
    """, looked=ALL)  # fmt: skip

    def __init__(
        self,
        *,
        model: Annotated[Literal["4x8", "6x6"], Option("rows and columns")] = "4x8",
        unit: Annotated[int, Option("unit as delivered; register 2 holds it", low=1, high=247)] = 1,
        baud: Annotated[Literal[9600, 57600, 115200, 921600], Option("line speed")] = 115200,
    ):
        rows, cols = SIZES[model]
        grid = grid_layout(rows, cols, PITCH_M, name="matrix")
        self.layout = replace(grid, wire_order=np.arange(rows * cols).reshape(rows, cols)[::-1].ravel())
        self.ports = (Rs485(baud=baud),)
        self.inputs = Registers(INPUTS)
        self.inputs["model"] = model == "6x6"
        self.delivered = {"unit": unit, "speed": SPEED_CODES[baud]}
        self.registers = Registers(HOLDING, kept={**self.delivered, **self.flash})
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(baud))
        self.period_ns = PERIODS_NS[self.registers["rate"]]

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return ADC values 0..4095, shape ``(n,)``; 0 below the threshold."""
        super().measure(reading, t_ns)
        counts = np.where(self.counts < self.registers["threshold"], 0, self.counts)
        self.inputs["values"] = np.pad(self.layout.on_wire(counts), (0, 36 - len(counts)))
        return counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        unit = self.registers["unit"]
        banks = Banks(holding=self, inputs=self.inputs, functions=(3, 4, 6, 16))
        answers = self.rtu.answers(data, t_ns, {unit: banks})
        new = self.registers["unit"]
        return answers if new == unit or not answers else [*answers[:-1], rtu(new, answers[-1][1:-2])]

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return holding registers."""
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and execute its orders."""
        written = self.registers.write(address, data)
        if "reset" in written:
            unit = self.registers["unit"]
            self.registers = Registers(HOLDING, kept={**self.delivered, "unit": unit})
        self.period_ns = PERIODS_NS[self.registers["rate"]]
        self.flash.update(self.registers.kept())
        return written
