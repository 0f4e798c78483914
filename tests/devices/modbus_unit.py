"""A Modbus unit on RS-485 that tells the push on its only taxel: two of them share a line.

Wire: RS-485, 19200 8N1; holding register 0: push [mN], register 1: unit.

Try it: ``tactemu run tests/devices/modbus_unit.py:ModbusUnit unit=2``.
"""

from typing import Annotated

from firmware_protocols import Device, Option, Rs485, grid_layout
from firmware_protocols.adc import quantize
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns
from firmware_protocols.registers import RegisterMap, Registers

MAP = RegisterMap(
    """
    0   >u2   push         r
    2   >u2   unit         r
    """
)


class ModbusUnit(Device):
    name, title = "modbus_unit", "Modbus unit"
    ports = (Rs485(baud=19200, turnaround_ns=2_000_000),)
    evidence, sources = ("assumed",), ("tests",)

    def __init__(self, *, unit: Annotated[int, Option("address on the line", low=1, high=247)] = 1):
        self.unit = unit
        self.layout = grid_layout(1, 1, 0.01)
        self.registers = Registers(MAP, kept=self.flash)
        self.registers["unit"] = unit
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(19200))

    def measure(self, reading, t_ns):
        counts = quantize(self.layout.push(reading["force"]), 1000.0, 0, 0xFFFF)
        self.registers["push"] = int(counts[0])
        return counts

    def receive(self, data, t_ns, port):
        return self.rtu.answers(data, t_ns, {self.unit: Banks(holding=self.registers)})
