r"""Synria (Xuanya) pressure module: sixty points behind a Modbus unit that has two functions of its own.

Wire: RS-485, 4 000 000 8N1, Modbus RTU, unit 1 as delivered. Functions 03 and 06 as in the standard, high byte first.

    41 index     text: 1 model, 2 protocol, 3 its version, 4 firmware; the answer is index, length, text
    42           all values: number of bytes and values, low byte first, row by row

Exceptions are 1 (function), 2 (address, read-only or write-only), 3 (value). A broadcast is obeyed without an answer.
``kind`` selects values of the ADC or mN; an ADC value below ``mask`` reads 0. Writing 1 to ``zero`` makes the present
force zero, 2 restores the zero of power-up. The driver also subtracts the values that it reads 0.1 s later.

Try it: ``tactemu run synria_60``, then ``TactilePressureSDK(port)`` of ``tactile_sdk``.
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Frame, Option, Reading, Refused, RegisterMap, Registers, Rs485, Transmissions,
    command_table, fact_table, grid_layout, quantize,
)  # fmt: skip
from firmware_protocols.protocols.modbus import Banks, Rtu

MAP = RegisterMap(
    """
    2    >u2       unit          1..247  = 1  flash     at once
    22   >u2       push          0..1  flash
    24   >u2       push_hz       50..200  = 100  flash
    26   >u2       kind          0..1  flash            0 ADC, 1 mN
    28   >u2       mask          flash
    30   >u2       points        = 60  r
    32   >u2       area          = 250  flash           of a point [0.1 mm2]
    34   >u2       auto_zero     0..1  w  flash         at power-up
    36   >u2       zero          0..2  w                1 now, 2 as at power-up
    200  >u2       fit           1..11  = 1             calibration: its point
    202  u1 x 2    fit_adc       r
    204  u1 x 2    fit_force                            [mN]
    206  u1 x 2    fit_at                               taxel
    208  >u2       fit_mode      100..101  = 101        one taxel, all
    210  u1 x 2    fit_take      w
    224  u1 x 2    fit_clear     w
    """,
    gaps=False,
)
VALUES = Frame("""
    values, the data of function 42; row by row
    0     <u2            size = len(values)
    2     bytes          values
""")
READ_TEXT = 0x41
READ_ALL = 0x42
REQUEST_BYTES = {READ_TEXT: 5, READ_ALL: 4}
ADC_KIND = 0
ADC_MAX = 4095


_README = "tactile-pressure-sdk 2.0.0 METADATA"
_READ = "tactile-pressure-sdk 2.0.0 (all of it: client.py, models.py, api/, protocol/, transport/, METADATA)"


class Synria60(Device):
    """A module of sixty points, which a driver polls."""

    name = "synria_60"
    kind = "skin"
    title = "Synria pressure module, 60 points"
    ports = (Rs485(baud=4_000_000),)
    rate_hz = 200.0
    columns = (Column(name="pressure", low=0, high=0xFFFF, push=1),)
    evidence = ("driver",)
    sources = ("tactile-pressure-sdk 2.0.0 tactile_sdk/protocol/constants.py, modbus_rtu.py, api/ (the vendor's own)",)
    judge = "tactile-pressure-sdk 2.0.0"
    documented = command_table(
        """
        ? all values                     42 80 11                       42 78 00 ..{120} ..{2}
        ? model                          41 01 D1 90                    41 01 ..{9} ..{2}
        ? no such text                   41 05 D0 53                    C1 03 31 91
        ? points                         03 00 0F 00 01 B4 09           03 02 00 3C B8 55
        zero                             06 00 12 00 01 E8 0F           =
        ? read what can only be written  03 00 11 00 01 D4 0F           83 02 C0 F1
        a kind that is not               06 00 0D 00 02 99 C8           86 03 02 61
        write several: no such function  10 00 0D 00 01 02 00 01 66 8D  90 01 8D C0
        """,
        head="01",
        origin="tactile-pressure-sdk 2.0.0; CRC by its calculate_crc16()",
    )
    documented_with = ("counts_per_newton", "model", "firmware")
    facts = fact_table(f"""
        stated touch: ADC values have 12 bits (or 16, depending on the firmware); values in mN saturate at 65535 @
            {_README} l.999
        stated touch: the ADC of one module reads 559 at 100 mN and 2284 at 1000 mN on a point @ {_README} l.975
        assumed touch: the ADC is linear, values in mN are exact @ {_READ}
        stated touch: there are 60 points of 25 mm2 @ {_README} l.455, l.742
        assumed touch: 6 x 10 points at a pitch of 5 mm, row by row, with normal +z @ {_READ}
        stated identity: the texts of model and versions @ tactile-pressure-sdk 2.0.0 tactile_sdk/models.py:25
        stated configuration: 4 000 000 8N1, unit 1; registers 17 and 18 are write-only @ {_README} l.743, l.991
        stated configuration: writing 2 to register 18 restores the zero of power-up @ {_README} l.948
        assumed configuration: the defaults of all registers except 15 and 16; written values survive power-off, the
            zero does not @ {_READ}
        assumed configuration: values that the module pushes by itself (register 11) have an undocumented format and are
            not sent; calibration is stored without effect @ {_READ}
        stated timing: a host can read it at most 1480 times a second @ {_README} l.1000
        assumed timing: 200 conversions a second, answers at once @ {_READ}
    """)

    def __init__(
        self,
        *,
        unit: Annotated[int, Option("unit as delivered; register 1 holds it", low=1, high=247)] = 1,
        counts_per_newton: Annotated[float, Option("scale of the ADC", unit="1/N")] = 2284.0,
        model: Annotated[str, Option("model in text 1, ASCII")] = "ST-00-01",
        firmware: Annotated[str, Option("version, ASCII")] = "v1.0.1",
    ):
        self.counts_per_newton = counts_per_newton
        self.texts = [text.encode("ascii") for text in (model, "YF-e0-000001", "v1.2", firmware)]
        self.layout = grid_layout(6, 10, 0.005, name="module")
        self.registers = Registers(MAP, kept={"unit": unit, **self.flash})
        self.rtu = Rtu(counters=self.counters, sizes=REQUEST_BYTES)
        self.push = self.zero = self.first = np.zeros(len(self.layout))
        self.counts, self.settled = np.zeros(len(self.layout), np.int64), False

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return ADC values 0..4095 or mN 0..65535, by register ``kind``, shape ``(60,)``."""
        self.push = self.layout.push(reading["force"])
        if not self.settled and self.registers["auto_zero"]:
            self.zero = self.first = self.push
        self.settled = True
        return self._convert()

    def _convert(self) -> np.ndarray:
        adc = self.registers["kind"] == ADC_KIND
        scale, most = (self.counts_per_newton, ADC_MAX) if adc else (1000.0, 0xFFFF)
        counts = quantize(self.push - self.zero, scale, 0, most)
        self.counts = np.where(counts < self.registers["mask"], 0, counts) if adc else counts
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        banks, answers = Banks(holding=self, functions=(3, 6), own=self._own), []
        for at in range(len(data)):  # byte by byte, as a new unit holds for the next request, even in the same chunk
            answers += self.rtu.answers(data[at : at + 1], t_ns, {self.registers["unit"]: banks})
        return answers

    def _own(self, pdu: bytes) -> bytes | None:
        """Return the answer to functions 41 and 42."""
        if pdu[0] == READ_ALL and len(pdu) == 1:
            return pdu + VALUES.pack(values=self.layout.on_wire(self.counts).astype("<u2").tobytes())
        if pdu[0] == READ_TEXT and len(pdu) == 2:
            if not 1 <= pdu[1] <= len(self.texts):
                raise Refused("value")
            text = self.texts[pdu[1] - 1]
            return pdu + bytes([len(text)]) + text
        return None

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return registers."""
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, keep it in flash, and set a zero if ordered."""
        written = self.registers.write(address, data)
        self.flash.update({name: self.registers.all(name) for name in written if MAP.by_name[name].flash})
        if "zero" in written and self.registers["zero"]:
            self.zero = self.push if self.registers["zero"] == 1 else self.first
        self._convert()
        return written
