"""ATI NETCANOEM: a board between a force-torque transducer and CAN that transmits six strain gauges.

Wire: classic CAN, 250 kbit/s, standard ids: seven bits of base (20 as delivered, option ``base``), four bits of code.

    id    data                        direction   about
    200   nothing                     to board    read the gauges
    200   ``FIRST``                   to host     status and three gauges
    201   ``SECOND``                  to host     the other three
    202   row                         to board    read one row of the matrix: 0 Fx, 1 Fy, 2 Fz, 3 Tx, 4 Ty, 5 Tz
    202   ``PAIR`` of gauges 0, 1     to host     and 203 of 2, 3, and 204 of 4, 5
    205   nothing, 8 bytes            both        serial number, ASCII
    206   slot                        both        selects the calibration, 0 to 15; 0 after power-up
    207   nothing, ``COUNTS``         both        counts per force and per torque
    208   nothing, two bytes          both        their units, 02 N, 03 N-m
    209   index, ``>u2``              both        diagnostic voltage: 0 middle, 2 thermistor, 3 power, 4 DAC, 5 ground
    20C   nothing                     to board    reset, unanswered: slot 0 again
    20D   base; nothing               both        base from the next power-up on
    20E   divisor - 1; nothing        both        2 Mbit/s by divisor from the next power-up on
    20F   nothing, ``VERSION``        both        firmware

Bytes behind those listed are ignored. A force is its row times the gauges, divided by the counts per force; the rows
are those of a Mini45 SI-580-20. Status: 0 watchdog, 1 2 converter too high, low, 3 ground, 4 5 supply too high, low, 6
bad calibration, 7 EEPROM, 8 configuration, 11 12 too hot, cold, 14 CAN bus error, 15 any error.

Evidence: vendor's manual 9610-05-1030-04, section 7; sixteen captured frames of a board with base 7F, whose status was
4000 (CAN bus error).

Try it: ``tactemu run ati_netcanoem --port can:socketcan:vcan0``, then ``candump vcan0 & cansend vcan0 200#``.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Column, Counts, Device, Frame, Identifier, Option, Reading, Request, Sense, Tool,
    command, command_table, fact_table, one_of, points, quantize,
)  # fmt: skip

FIRST = Frame("""
    first gauges
    0     >u2        status
    2     >i2 x 3    gauges      0 2 4
""")
SECOND = Frame("""
    second gauges
    0     >i2 x 3    gauges      1 3 5
""")
PAIR = Frame("""
    part of a row
    0     >f4 x 2    row
""")
COUNTS = Frame("""
    counts per unit
    0     >u4        force
    4     >u4        torque
""")
VERSION = Frame("""
    firmware version
    0     u1         major
    1     u1         minor
    2     >u2        build
""")
SERIAL, PER_UNIT, UNITS, VERSIONS = 5, 7, 8, 0xF
BAD_CALIBRATION = 1 << 6
ANY_ERROR = 1 << 15
VOLTAGE_COUNTS = (0x8000, 0, 0x6000, 0x9000, 0x8000, 0)
MINI45_CALIBRATION = np.array("""
    10.0835583 114.459548 980.330335 -31561.5308 1061.32636 31461.1601
    -1084.03836 35437.2111 460.271838 -18530.1499 -255.517816 -17976.089
    37692.0271 24.827954 40565.9105 -2225.79045 38187.8589 -319.026033
    -26.1841023 247.507591 -638.468458 -92.0704656 627.375533 -129.739674
    715.795266 1.51704258 -395.805429 236.24811 -370.835901 -209.272225
    14.1880353 -435.510512 15.2161441 -448.583974 -15.3689784 -456.04746
""".split(), float).reshape(6, 6)  # fmt: skip
"""The rows Fx, Fy, Fz, Tx, Ty, Tz of a Mini45 SI-580-20, for 1000000 counts per N and Nm."""


class AtiNetcanoem(Device[CanFrame]):
    """A board with six gauges, which a driver polls."""

    name = "ati_netcanoem"
    kind = "force-torque sensor"
    title = "ATI NETCANOEM, force and torque"
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    columns = tuple(Column(name=f"gauge {k}", low=-0x8000, high=0x7FFF) for k in range(6))
    rate_hz = 1000.0
    evidence = ("vendor document", "captured")
    sources = (
        "ATI manual 9610-05-1030-04, tables 4.2 and 4.3, section 10 (in griloHBG/ati-netcanoem-cpp@8967bbd)",
        "griloHBG/ati-netcanoem-cpp@8967bbd main.cpp",
        "ToyotaResearchInstitute/tri_hardware_drivers@02d4579 ati_netcanoem_ft_driver.cpp",
        "lapo5/ROS2-HAL-ATI-Mini45@c352310 HAL_ATI_FT_Mini45.py, defines.py, can_init.sh, FT10484_Net.xml",
        "a candump of a course's README, January 2021 (16 frames; which repository is not known)",
    )
    judge = (
        "griloHBG/ati-netcanoem-cpp@8967bbd, ToyotaResearchInstitute/tri_hardware_drivers@02d4579, "
        "lapo5/ROS2-HAL-ATI-Mini45@c352310"
    )
    documented = command_table("""
        @ manual, table 4.2
        ? gauges               200#    200#..{8}, 201#..{6}
        ? row of Fx            202#00  202#..{8}, 203#..{8}, 204#..{8}
        ? row of Fy            202#01  202#..{8}, 203#..{8}, 204#..{8}
        ? row of Fz            202#02  202#..{8}, 203#..{8}, 204#..{8}
        ? row of Tx            202#03  202#..{8}, 203#..{8}, 204#..{8}
        ? row of Ty            202#04  202#..{8}, 203#..{8}, 204#..{8}
        ? row of Tz            202#05  202#..{8}, 203#..{8}, 204#..{8}
        ? serial number        205#    205#..{8}
        calibration 0          206#00  =
        calibration 1          206#01  =  status bit 6 marks it as bad
        ? counts per unit      207#    207#..{8}
        ? units                208#    208#02 03
        ? voltage of middle    209#00  209#..{2}
        ? voltage of thermistor  209#02  209#..{2}
        ? voltage of power     209#03  209#..{2}
        ? voltage of DAC       209#04  209#..{2}
        ? voltage of ground    209#05  209#..{2}
        reset                  20C#
        base                   20D#7F  20D#  from the next power-up on
        500 kbit/s             20E#03  20E#  from the next power-up on
        ? firmware version     20F#    20F#..{4}
    """)
    documented_with = ("serial", "counts_per_force", "counts_per_torque", "status", "order", "tool")
    facts = fact_table("""
        stated touch: one message has the gauges 0, 2, 4, the other 1, 3, 5, signed; a row of the matrix is requested by
            its number @ manual, table 4.2
        stated touch: the rows of the matrix times the gauges, divided by the counts per force or per torque, are the
            load @ manual, section 10.3
        measured touch: the format of a reading and of a matrix row @ candump of 16 frames
        stated touch: matrix of a Mini45 SI-580-20, 1000000 counts per N and Nm @ FT10484_Net.xml, its calibration
        measured touch: an odd gauge has most of the weight of Tz, as in the captured row @ candump of 16 frames
        assumed touch: gauges are 0 at rest @ manual; FT10484_Net.xml (offsets of the converter only)
        assumed touch: the tool is touched 50 mm above the origin @ manual
        stated touch: status 0 means no error; bit 14 is a CAN bus error @ manual, table 4.3
        measured touch: a board in use reported status 4000, without bit 15 @ candump of 16 frames
        stated identity: every Mini45 has 1000000 counts per unit of force and of torque @ manual, section 10.3
        stated identity: version 3.8, build 2 @ griloHBG/ati-netcanoem-cpp@8967bbd README.md
        stated identity: serial numbers have the form FT10484, followed by a 0 @ FT10484_Net.xml; HAL_ATI_FT_Mini45.py
        assumed identity: serial number FT00001 @ manual, sections 1 to 11; main.cpp; README.md
        assumed identity: diagnostic voltages @ manual, table 4.2 (no scale); both drivers
        stated configuration: base identifier 20 and 250 kbit/s as delivered; new values take effect at the next
            power-up @ manual, 7, 7.2; lapo5
        stated configuration: slot 0 after power-up and reset; a slot without calibration sets bit 6 @ manual, 10.1
        assumed configuration: only slot 0 has a calibration; the rows of others are the same @ manual, 10.1
        stated configuration: additional bytes after a request are ignored @ lapo5/ROS2-HAL-ATI-Mini45, which sends one
        assumed configuration: a request with too few bytes, or with a wrong row, slot or code, gets no answer @ manual,
            section 7; the drivers
        assumed timing: 1000 conversions a second @ manual, sections 5, 7, 10
    """)

    def __init__(
        self,
        *,
        base: Annotated[
            int, Option("first seven bits of the identifiers, as delivered 20 (hex)", low=0, high=0x7F)
        ] = 0x20,
        serial: Annotated[str, Option("at most 8 characters of ASCII")] = "FT00001",
        counts_per_force: Annotated[
            int, Option("scale of a force row times the gauges", unit="1/N", low=1, high=10**9)
        ] = 1_000_000,
        counts_per_torque: Annotated[
            int, Option("scale of a torque row times the gauges", unit="1/Nm", low=1, high=10**9)
        ] = 1_000_000,
        status: Annotated[
            int, Option("status of each reading; bit 14 (16384) is a CAN bus error", low=0, high=0xFFFF)
        ] = 0,
        order: Annotated[Literal["024135", "012345"], Option("which gauge stands at each place")] = "024135",
        tool: Tool = (0.0, 0.0, 0.05),
    ):
        ident = Identifier(f"{self.flash.get('base', base):07b}cccc", {"code": "c"})
        self.packets, self.order = CanRequests(ident, by="code"), [int(gauge) for gauge in order]
        self.ports = (Can(bitrate=2_000_000 // self.flash.get("divisor", 8), filters=(ident.filter(),)),)
        self.layout = points({"tool": tool})
        self.serial = serial.encode("ascii")[:8].ljust(8, b"\0")
        self.per_unit = COUNTS.pack(force=counts_per_force, torque=counts_per_torque)
        self.status, self.slot = status, 0
        self.sensitivity = np.linalg.inv(MINI45_CALIBRATION / 1e6)
        self.matrix = (MINI45_CALIBRATION / 1e6 * np.repeat([counts_per_force, counts_per_torque], 3)[:, None]).astype(
            np.float32
        )

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the counts of the six gauges, int16 range, shape ``(1, 6)``."""
        self.counts = quantize(reading["wrench"] @ self.sensitivity.T, 1.0, -0x8000, 0x7FFF)
        return self.counts

    @command(on=0, data="*")
    def gauges(self, request: Request):
        """Return status and gauges."""
        gauges = self.counts[0][self.order]
        status = self.status | (BAD_CALIBRATION | ANY_ERROR if self.slot else 0)
        return self._frames(request, FIRST.pack(status=status, gauges=gauges[:3]), SECOND.pack(gauges=gauges[3:]))

    @command(on=2, data="B*")
    def row(self, request: Request):
        """Return a row of the matrix."""
        row = one_of(self.matrix, request.value).reshape(3, 2)
        return self._frames(request, *(PAIR.pack(row=pair) for pair in row))

    @command(on=(SERIAL, PER_UNIT, UNITS, VERSIONS), data="*")
    def identity(self, request: Request):
        """Return serial number, counts per unit, units or version."""
        version = VERSION.pack(major=3, minor=8, build=2)
        return {SERIAL: self.serial, PER_UNIT: self.per_unit, UNITS: b"\2\3", VERSIONS: version}[request.code]

    @command(on=6, data="B*")
    def select(self, request: Request):
        """Select a calibration."""
        self.slot = one_of(range(16), request.value)
        return request.data[:1]

    @command(on=9, data="B*")
    def voltage(self, request: Request):
        """Return a diagnostic voltage."""
        return one_of(VOLTAGE_COUNTS, request.value).to_bytes(2, "big")

    @command(on=0xC, data="*")
    def reset(self, request: Request):
        """Select the first calibration."""
        self.slot = 0

    @command(on=0xD, data="B*")
    def set_base(self, request: Request):
        """Set the base from the next power-up on."""
        self.flash["base"] = one_of(range(0x80), request.value)
        return self._frames(request, b"")

    @command(on=0xE, data="B*")
    def set_baud(self, request: Request):
        """Set the line speed from the next power-up on."""
        self.flash["divisor"] = request.value + 1
        return self._frames(request, b"")

    def _frames(self, request: Request, *contents: bytes) -> list[CanFrame]:
        return [self.packets.frame(request.id + k, content) for k, content in enumerate(contents)]
