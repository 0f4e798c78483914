"""DFRobot tactile sensor: a matrix of 4 x 8 or 6 x 6 taxels in Modbus registers.

Wire: RS-485, 8N1, 9600, 57600, 115200 or 921600 baud, Modbus RTU; functions 03, 04, 06, 16.

    input register  about
    0, 1            vendor and product, 3343
    5, 6            version, state
    7..             ADC value of each taxel, 0..4095: 32 or 36, row by row from the bottom
    43              0: 4 x 8, 1: 6 x 6

    holding register  about
    2, 3, 4           unit, line speed, parity and stop bits
    6                 threshold 0..4095: what is less reads 0
    7                 order: restart
    8                 0: 20 readings a second, 1: 50

The vendor's driver turns the bytes of what it writes to holding registers, so these are *low byte first*, and turns the
order of the rows that it reads: its first row is the last one in the registers.

Try it: ``tactemu run dfrobot_tactile``, then ``01 04 00 07 00 20 40 13`` for 32 values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Column, Command, Counts, Device, Option, Outs, Reading, Restart, Rs485, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns
from firmware_protocols.registers import RegisterMap, Registers

INPUTS = RegisterMap(
    """
    0   >u2       vendor   = 13123  r
    2   >u2       product  = 13123  r
    10  >u2       version  = 256  r
    14  >u2 x 36  values   0..4095  r
    86  >u2       model    0..1  r
    """
)
HOLDING = RegisterMap(
    """
    4   <u2  unit       1..247  = 1  flash
    6   <u2  speed      0..3  flash
    8   u1 x 2  format  flash
    12  <u2  threshold  0..4095  flash
    14  <u2  restart    0..1
    16  <u2  rate       0..1
    """
)
"""By byte: two for each register."""
SIZES = {"4x8": (4, 8), "6x6": (6, 6)}
PERIODS_NS, RESTART_NS = (50_000_000, 20_000_000), 100_000_000
COUNTS_PER_NEWTON, PITCH = 400.0, 0.005


class DfrobotTactile(Device):
    """One matrix, polled."""

    name = "dfrobot_tactile"
    title = "DFRobot tactile sensor, 4x8 or 6x6"
    kind = "fingertip"
    columns = (Column(name="touch", low=0, high=4095, push=1),)
    evidence = ("driver",)
    sources = (
        "DFRobot/DFRobot_TactileSensor@962a7b3 python/raspberrypi/DFRobot_Tactile_Sensor.py l.88, 120-150",
        "Modbus application protocol V1.1b3; Modbus over serial line V1.02",
    )
    judge = "pymodbus 3.11 and modbus_tk 1.1.5, which know no sensor; own second reader"
    assumed = (
        f"{COUNTS_PER_NEWTON:.0f} counts/N, pitch {PITCH * 1e3:.0f} mm; 4 x 8 is four rows of eight",
        "unit 1 and 115200 baud as delivered; vendor as product; version 0100; state, and all other registers: 0",
        "the threshold makes less than itself 0; a reset is a restart 0.1 s later",
        "line speed (0..3) and format are stored without effect, a new unit answers from the next power-up on; all are "
        "kept at once but for the rate, which is 20 Hz at power-up",
    )

    def __init__(
        self,
        *,
        model: Annotated[Literal["4x8", "6x6"], Option("rows and columns")] = "4x8",
        unit: Annotated[int, Option("as delivered; register 2 tells and changes it", low=1, high=247)] = 1,
        baud: Annotated[Literal[9600, 57600, 115200, 921600], Option("line speed")] = 115200,
    ):
        rows, cols = SIZES[model]
        grid = grid_layout(rows, cols, PITCH, name="matrix")
        self.layout = replace(grid, wire_order=np.arange(rows * cols).reshape(rows, cols)[::-1].ravel())
        self.ports = (Rs485(baud=baud),)
        self.inputs = Registers(INPUTS)
        self.inputs["model"] = model == "6x6"
        self.registers = Registers(HOLDING, kept={"unit": unit, **self.flash})
        self.unit = self.registers["unit"]
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(baud))
        self.period_ns = PERIODS_NS[0]

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """ADC values 0..4095, shape ``(n,)``; 0 below the threshold."""
        counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 4095)
        counts = np.where(counts < self.registers["threshold"], 0, counts)
        self.inputs["values"] = np.pad(self.layout.on_wire(counts), (0, 36 - len(counts)))
        return counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Modbus requests in chunks of any size."""
        banks = Banks(holding=self, inputs=self.inputs, functions=(3, 4, 6, 16))
        return self.rtu.answers(data, t_ns, {self.unit: banks})

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Holding registers."""
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store, and do what was ordered."""
        written = self.registers.write(address, data)
        if "rate" in written:
            self.period_ns = PERIODS_NS[self.registers["rate"]]
        if self.registers["restart"]:
            self.wake_ns = t_ns + RESTART_NS
        self.registers.reset("restart")
        self.flash.update(self.registers.kept())
        return written

    def wake(self, t_ns: int) -> Outs:
        """The restart that was ordered."""
        return [Restart()]

    @property
    def commands(self) -> tuple[Command, ...]:
        """Of a sensor as it comes."""
        if self.unit != 1:
            return ()
        return tuple(
            Command(name=name, request=f"01 {request}", reply=f"01 {reply or request}", origin=origin)
            for name, request, reply, origin in _EXAMPLES
        )


_DRIVER, _STANDARD = DfrobotTactile.sources
_EXAMPLES = (
    # name, request, answer, without the unit; CRC by pymodbus; a write of one register comes back as it was
    ("vendor", "04 00 00 00 01 31 CA", "04 02 33 43 EC 31", _DRIVER),
    ("product", "04 00 01 00 01 60 0A", "04 02 33 43 EC 31", _DRIVER),
    ("version", "04 00 05 00 01 21 CB", "0402..{2} ..{2}", _DRIVER),
    ("state", "04 00 06 00 01 D1 CB", "04 02 00 00 B9 30", _DRIVER),
    ("32 values", "04 00 07 00 20 40 13", "0440..{64} ..{2}", _DRIVER),
    ("36 values", "04 00 07 00 24 41 D0", "0448..{72} ..{2}", _DRIVER),
    ("model", "04 00 2B 00 01 41 C2", "0402..{2} ..{2}", _DRIVER),
    ("unit", "03 00 02 00 01 25 CA", "03 02 01 00 B9 D4", _DRIVER),
    ("unit 1 again, bytes turned", "06 00 02 01 00 29 9A", "", _DRIVER),
    ("line speed", "06 00 03 02 00 78 AA", "", _DRIVER),
    ("parity and stop bits", "06 00 04 00 00 C8 0B", "", _DRIVER),
    ("threshold 300, bytes turned", "06 00 06 2C 01 B4 CB", "", _DRIVER),
    ("50 readings a second, bytes turned", "06 00 08 01 00 09 98", "", _DRIVER),
    ("restart, bytes turned", "06 00 07 01 00 39 9B", "", _DRIVER),
    ("unit and line speed", "10 00 02 00 02 04 01 00 03 00 73 7A", "10 00 02 00 02 E0 08", _DRIVER),
    ("threshold 4096: illegal value", "06 00 06 00 10 68 07", "86 03 02 61", _STANDARD),
    ("beyond the map: illegal address", "04 00 2C 00 01 F0 03", "84 02 C2 C1", _STANDARD),
    ("write a product: illegal address", "06 00 01 00 01 19 CA", "86 02 C3 A1", _STANDARD),
    ("read coils: illegal function", "01 00 00 00 01 FD CA", "81 01 81 90", _STANDARD),
)
