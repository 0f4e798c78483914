"""BrainCo Revo3 Touch: a hand with eleven tactile modules, over Modbus RTU or CAN-FD.

Wire: RS-485, 5 Mbit/s (or 1, 2, 3) 8N1, Modbus RTU, unit 7E; functions 03, 04, 06, 16. Modules are the palm, then tip
and pad of thumb, index, middle, ring and little finger. Register 135 gives the kind of sensors:

    about                       1: piezoresistive array          2: high-density matrix
    module on or off            4000..4010                       5900..5910
    zero, all or one            4011, 4012..4022: 1              5214, 5215..5225: 1, and 2 cancels it
    zeroed                      -                                5226, 5227..5237: 1
    values, all or one          4024: 0 ADC, 1 raw, 2 [mN]       5202, 5203..5213: 0 ADC, 1 [10 mN]
    selection                   4023: 0 points, 1 forces         -
    points of each module       4037..4047                       5191..5201
    restart, all or one         -                                5179, 5180..5190: 1
    forces [mN]                 4100..4141: 42 regions           -
    points                      16 bits each                     8 bits each

    first register of points, and how many
    1: 4200 36   4250 31  4290 57   4350 21  4400 52   4460 21  4500 52   4560 21  4600 52   4660 21  4700 52
    2: 5240 60   5340 60  5380 60   5440 60  5480 60   5540 60  5580 60   5640 60  5680 60   5740 60  5780 60

The vendor's SDK reads two points of a matrix in one register, the first one in its high byte: 30 registers a module.
The vendor's document has 60 registers a module, at 5240, 5300, 5360, 5420 ... (option ``packing=single``). The model
assumes that points follow row by row.

Identity: 101 the hand, 1 right, 2 left; 108 unit; 109 line (0 1 M, 1 2 M, 2 3 M, 4 5 Mbit/s); 110 CAN-FD (3 is 5
Mbit/s); 135 kind of touch; 240..260 and 270..290 the joints' limits [0.01 deg]; 1800..1804 state, current [mA], voltage
[10 mV], power [10 mW], temperature; 2000..2170 the joints, which stand still at 0; 3020 the joints that are fitted;
3060 and 3300 serial numbers and versions of their motors; 3030, 3040, 3050 firmware, hardware and serial number, 20
characters each, two in a register. The serial number of a left Ultra Touch begins BCUTL4.

On CAN-FD (``brainco_revo3_canfd``) the same Modbus frame, CRC included, is the data of a frame, padded with zeros, as
for ``brainco_revo2_canfd``: more than 29 registers do not fit, and the SDK reads points in pieces.

Try it: ``tactemu run brainco_revo3``, then
``await bc_revo3_sdk.Manager().connect_auto(port=..., protocol=ProtocolType.Modbus, slave_id=0x7E)``.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols import (
    CanFrame, Column, Counts, Device, Layout, Option, Reading, RegisterMap, Registers, Rs485, Transmissions,
    command_table, fact_table, filled, grid_layout, place, quantize, stack,
)  # fmt: skip
from firmware_protocols.devices import brainco_canfd
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns

BAUD_CODES = {1000000: 0, 2000000: 1, 3000000: 2, 5000000: 4}
MAP = RegisterMap(
    """
    120    u1 x 44     zero_offsets
    202    >u2         hand        1..2  = 2  r
    210    >u2 x 3     switches    0..1  = 1
    218    >u2         baud        0..4  = 4  r
    220    >u2         can_baud    0..3  = 3  r
    224    u1 x 2      calibrates
    232    >u2         strongest   = 1500
    236    u1 x 6      states
    216    >u2         unit        1..247  = 126  r
    270    >u2         kind        r
    400    >u2 x 22    protected   = 1500
    480    u1 x 42     lowest      r
    540    >i2 x 21    highest     = 9000  r
    600    u1 x 42     slowest     r
    642    >i2 x 21    fastest     = 20000  r
    3600   >u2 x 5     system      = 0, 300, 2400, 720, 25  r
    4000   u1 x 42     motor_states  r
    4060   u1 x 42     speeds      r
    4120   u1 x 42     positions   r
    4180   u1 x 42     currents    r
    4240   u1 x 42     errors      r
    4300   >u2 x 21    warmths     = 25  r
    6040   >u2 x 2     online      = 31, 65535  r
    6060   u1 x 20     firmware    r
    6080   u1 x 20     hardware    r
    6100   u1 x 20     serial      r
    6120   u1 x 420    motor_serials  r
    6600   u1 x 42     motor_firmware  = 1  r
    8000   >u2 x 11    array_on    0..1  = 1
    8022   >u2 x 12    array_zero  0..1
    8046   >u2         shown       0..1
    8048   >u2         array_mode  0..2
    8050   >u2 x 12    factory     0..3
    8074   >u2 x 11    array_size  r
    8200   >u2 x 42    forces      r
    8400   >u2 x 36    array_0     r
    8500   >u2 x 31    array_1     r
    8580   >u2 x 57    array_2     r
    8700   >u2 x 21    array_3     r
    8800   >u2 x 52    array_4     r
    8920   >u2 x 21    array_5     r
    9000   >u2 x 52    array_6     r
    9120   >u2 x 21    array_7     r
    9200   >u2 x 52    array_8     r
    9320   >u2 x 21    array_9     r
    9400   >u2 x 52    array_10    r
    10358  >u2 x 12    restart     0..1
    10382  >u2 x 11    matrix_size  r
    10404  >u2 x 12    matrix_mode  0..1
    10428  >u2 x 12    matrix_zero  0..2
    10452  >u2 x 12    zeroed       r
    10480  u1 x 1320   matrix       r
    11800  >u2 x 11    matrix_on    0..1  = 1
    """
)
"""Offsets count bytes: two for each register. Twelve values are one for all modules, then one for each."""
MATRIX_OFFSET = MAP.by_name["matrix"].address
ARRAY_POINTS = (36, 31, 57, 21, 52, 21, 52, 21, 52, 21, 52)
MATRIX_POINTS = (60,) * 11
REGIONS_PER_MODULE = (1, 3, 6, 3, 5, 3, 5, 3, 5, 3, 5)
"""The number of regions, and so of forces, of each module."""
_POINTS = np.split(np.arange(sum(ARRAY_POINTS)), np.cumsum(ARRAY_POINTS)[:-1])
REGION_STARTS = [run[0] for points, n in zip(_POINTS, REGIONS_PER_MODULE) for run in np.array_split(points, n)]
PAIRED_FIRST_REGISTERS = (5240, 5340, 5380, 5440, 5480, 5540, 5580, 5640, 5680, 5740, 5780)
PLACES_M = {
    "palm": (0.0, 0.0), "thumb": (0.06, 0.0), "index": (0.033, 0.06), "middle": (0.011, 0.07), "ring": (-0.011, 0.065),
    "little": (-0.033, 0.055),
}  # fmt: skip
MODULES = ("palm", *(f"{finger} {part}" for finger in tuple(PLACES_M)[1:] for part in ("tip", "pad")))
ARRAY_COUNTS_PER_NEWTON = np.array([200.0, 200.0, 1000.0])
MATRIX_COUNTS_PER_NEWTON = np.array([50.0, 100.0])
MILLINEWTONS_PER_NEWTON = 1000.0
ZERO, UNDO = 1, 2


SDK = "BrainCoTech/brainco-revo3-sdk@7ba96eb "
LOOKED = f"all of {SDK}docs, python; bc-revo3-sdk 2.3.2 and 1.5.1 main_mod.pyi"


Touch = Annotated[Literal["array", "matrix"], Option("kind of sensors")]
Packing = Annotated[
    Literal["pairs", "single"], Option("points of a matrix in a register: two as in the SDK, or one as in the document")
]
Side = Annotated[Literal["left", "right"], Option("which hand; sets the serial number")]
SerialNumber = Annotated[str, Option("20 characters of ASCII, from which the SDK reads the model; default: by side")]


class Revo3(Device[Any]):
    """A hand with eleven tactile modules, for either line; its joints do not move."""

    kind = "hand"
    evidence = ("vendor document", "driver")
    sources = (
        f"{SDK}docs/device/REVO3_TOUCH_API.md, REVO3_MOTOR_API.md (registers)",
        "bc-revo3-sdk 2.3.2 and 1.5.1: what they read and write (identity, points per module, regions, packing)",
    )
    facts = fact_table(f"""
        stated touch: the registers, the points of each module, and the units of force @
            {SDK}docs/device/REVO3_TOUCH_API.md
        assumed touch: places: row by row in one plane with normal +z, at a pitch of 2 mm on fingers and 4 mm on the
            palm; matrices are 10 x 6
        assumed touch: a point has 200 counts/N (ADC and raw), 0..4095; a point of a matrix has 50 counts/N (ADC)
        assumed touch: each region is a run of points of equal length; forces and points can be read whatever register
            4023 holds
        assumed touch: a zero holds until the next restart; registers 4025..4036 have no effect; modules that are off
            read 0
        stated identity: register 101 is the side of the hand: 1 right, 2 left @ bc-revo3-sdk 1.5.1
            revo3_get_hand_type(), main_mod.pyi:575
        stated identity: registers 109 and 110 set the speeds of the lines, by their codes @ bc-revo3-sdk 1.5.1
            revo3_get_rs485_baudrate(), each code tried
        stated identity: the motors' status and versions, and which of them are fitted @
            {SDK}docs/device/REVO3_MOTOR_API.md:292, 350
        assumed identity: firmware 0.1.2, hardware V1.0, motors 1.1; modules and motors have no serial numbers
        assumed configuration: limits are 0 and 90 deg, 200 rpm and 1500 mA; the hand reports 24 V, 0.3 A and 25 deg C;
            all modules are on
        assumed configuration: functions 03 and 04 read the same registers; registers that are not modelled read 0;
            joints do not move
        stated configuration: Modbus frames are sent in CAN-FD frames, with at most 29 registers @ bc-revo3-sdk 2.3.2,
            as it speaks
        assumed timing: the hand answers at once; touch is sampled 100 times a second
    """, looked=LOOKED)  # fmt: skip

    def _power_up(self, touch: str, packing: str, side: str, serial: str) -> None:
        serial = serial or f"BCUT{side[0].upper()}40000000000"
        self.touch, self.packing, self.array = touch, packing, touch == "array"
        self.columns = (Column(name="touch", low=0, high=4095 if self.array else 255, push=1),)
        self.layout = _hand(touch)
        self.modules = np.repeat(np.arange(11), ARRAY_POINTS if self.array else MATRIX_POINTS)
        """The module of each point."""
        self.registers = registers = Registers(MAP)
        registers["kind"] = 1 if self.array else 2
        registers["hand"] = 2 if side == "left" else 1
        registers["array_size" if self.array else "matrix_size"] = ARRAY_POINTS if self.array else MATRIX_POINTS
        for name, text in (("firmware", "0.1.2"), ("hardware", "V1.0"), ("serial", serial)):
            registers[name] = text.encode("ascii")
        self.unit = registers["unit"]
        self.felt = self.zero = np.zeros(len(self.layout))
        self.counts = np.zeros(len(self.layout), int)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the points, 0..4095 of an array, 0..255 of a matrix, in the unit that is set for their module."""
        self.felt = self.layout.push(reading["force"])
        pushes = (self.felt - self.zero) * np.array(self.registers.all(f"{self.touch}_on"))[self.modules]
        if self.array:
            self.counts = quantize(pushes, ARRAY_COUNTS_PER_NEWTON[self.registers["array_mode"]], 0, 4095)
            self.registers["forces"] = np.add.reduceat(pushes, REGION_STARTS) * MILLINEWTONS_PER_NEWTON
        else:
            modes = np.array(self.registers.all("matrix_mode"))[1:]
            self.counts = quantize(pushes, MATRIX_COUNTS_PER_NEWTON[modes][self.modules], 0, 255)
        return self.counts

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return registers, with the points of the last conversion."""
        if address + n <= MAP.by_name["array_0"].address:
            return self.registers.read(address, n)
        wire, area = self.layout.on_wire(self.counts), np.zeros(1320, int)
        for k, patch in enumerate(self.layout.patches):
            points = wire[patch.taxels]
            if self.array:
                self.registers[f"array_{k}"] = points
            elif self.packing == "single":
                area[120 * k + 1 : 120 * k + 120 : 2] = points
            else:
                area[2 * PAIRED_FIRST_REGISTERS[k] - MATRIX_OFFSET :][:60] = points
        self.registers["matrix"] = area
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and execute its orders."""
        written = self.registers.write(address, data)
        if self.array:
            self._zero(self.registers.all("array_zero"))
        else:
            self._zero(self.registers.all("matrix_zero"))
            self._zero([UNDO * order for order in self.registers.all("restart")])
            if address <= MAP.by_name["matrix_mode"].address < address + len(data):
                self.registers["matrix_mode"] = self.registers["matrix_mode"]  # the first is for all
        self.registers.reset("array_zero", "matrix_zero", "restart")
        return written

    def _zero(self, orders: list[int]) -> None:
        """Set or cancel the zero of all modules (the first order) and of each."""
        zeroed = np.array(self.registers.all("zeroed"))
        for order, which in zip(orders, (slice(None), *range(11))):
            if order:
                points = np.isin(self.modules, np.arange(11)[which])
                self.zero = np.where(points, self.felt if order == ZERO else 0.0, self.zero)
                zeroed[1:][which] = order == ZERO
        zeroed[0] = zeroed[1:].all()
        self.registers["zeroed"] = zeroed


class BraincoRevo3(Revo3):
    """A hand on RS-485."""

    name = "brainco_revo3"
    title = "BrainCo Revo3 Touch hand"
    judge = "bc-revo3-sdk 2.3.2, bc-revo3-sdk 1.5.1"
    documented = command_table(
        """
        @ bc-revo3-sdk 2.3.2 and 1.5.1: what they read and write (identity, points per module, regions, packing)
        ? unit                       03 00 6C 00 01 4F D8     03 02 00 7E 2D AE
        ? serial number              04 0B EA 00 0A 58 12     04 14 ..{20} ..{2}
        ? kind of touch              03 00 87 00 01 3F EC     03 02 00 01 6C 4E
        ? hardware                   04 0B E0 00 0A 78 10     04 14 ..{20} ..{2}
        ? hand                       03 00 65 00 01 9F DA     03 02 00 02 2C 4F
        ? lower limits               03 00 F0 00 15 8F F9     03 2A ..{42} ..{2}
        ? upper limits               03 01 0E 00 15 EF F5     03 2A ..{42} ..{2}
        ? firmware                   04 0B D6 00 0A 98 1E     04 14 ..{20} ..{2}
        ? points of each module      03 0F C5 00 0B 1C EB     03 16 ..{22} ..{2}
        ? modules that are on        03 0F A0 00 0B 0C F4     03 16 ..{22} ..{2}
        ? forces of regions          04 10 04 00 2A 3F 1B     04 54 ..{84} ..{2}
        ? what is shown              03 0F B7 00 01 3C F7     03 02 00 00 AD 8E
        show forces                  06 0F B7 00 01 F0 F7     =
        values [mN]                  06 0F B8 00 02 80 F5     =
        zero all                     06 0F AB 00 01 31 31     =
        zero the index finger's tip  06 0F AF 00 01 70 F0     =
        palm off                     06 0F A0 00 00 81 33     =
        all modules on  10 0F A0 00 0B 16 00 01 00 01 00 01 00 01 00 01 00 01 00 01 00 01 00 01 00 01 00 01 AA 7B
            10 0F A0 00 0B 89 37
        @ BrainCoTech/brainco-revo3-sdk@7ba96eb docs/device/REVO3_TOUCH_API.md, REVO3_MOTOR_API.md (registers)
        ? palm                         04 10 68 00 24 7E C2  04 48 ..{72} ..{2}
        ? thumb tip                    04 10 9A 00 1F 9E E2  04 3E ..{62} ..{2}
        ? thumb pad                    04 10 C2 00 39 9E EB  04 72 ..{114} ..{2}
        ? index tip                    04 10 FE 00 15 5F 3A  04 2A ..{42} ..{2}
        ? index pad                    04 11 30 00 34 FF 21  04 68 ..{104} ..{2}
        ? middle tip                   04 11 6C 00 15 FF 2B  04 2A ..{42} ..{2}
        ? middle pad                   04 11 94 00 34 BE C2  04 68 ..{104} ..{2}
        ? ring tip                     04 11 D0 00 15 3E CF  04 2A ..{42} ..{2}
        ? ring pad                     04 11 F8 00 34 7E DF  04 68 ..{104} ..{2}
        ? little tip                   04 12 34 00 15 7E BC  04 2A ..{42} ..{2}
        ? little pad                   04 12 5C 00 34 3F 78  04 68 ..{104} ..{2}
        factory's zero of all modules  06 0F B9 00 03 10 F5  =
        @ Modbus application protocol V1.1b3, 7
        ? beyond the map: illegal address  03 23 28 00 01 04 49  83 02 F1 29
        write a point: illegal address     06 10 68 00 01 C6 D9  86 02 F2 79
        mode 3: illegal value              06 0F B8 00 03 41 35  86 03 33 B9
        read coils: illegal function       01 00 00 00 01 F6 05  81 01 B0 48
        """,
        head="7E",
    )
    documented_with = ("packing", "serial", "baud")

    def __init__(
        self,
        *,
        touch: Touch = "array",
        packing: Packing = "pairs",
        side: Side = "left",
        serial: SerialNumber = "",
        baud: Annotated[Literal[1000000, 2000000, 3000000, 5000000], Option("line speed")] = 5000000,
    ):
        self._power_up(touch, packing, side, serial)
        self.registers["baud"] = BAUD_CODES[baud]
        self.ports = (Rs485(baud=baud),)
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(baud))

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        banks = Banks(holding=self, inputs=self, functions=(3, 4, 6, 16))
        return self.rtu.answers(data, t_ns, {self.unit: banks})


class BraincoRevo3CanFd(Revo3):
    """A hand on CAN-FD."""

    name = "brainco_revo3_canfd"
    title = "BrainCo Revo3 Touch hand on CAN-FD"
    judge = "bc-revo3-sdk 2.3.2"
    documented = command_table(
        """
        @ bc-revo3-sdk 2.3.2, as it speaks; CRC by pymodbus
        ? unit                   007E0108##1 7E 03 00 6C 00 01 4F D8  007E0107##1 7E 03 02 00 7E 2D AE
        ? serial number          007E0108##1 7E 04 0B EA 00 0A 58 12  007E0119##1 7E 04 14 ..{20} ..{2} 00{7}
        ? kind of touch          007E0108##1 7E 03 00 87 00 01 3F EC  007E0107##1 7E 03 02 00 01 6C 4E
        ? lower limits           007E0108##1 7E 03 00 F0 00 15 8F F9  007E012F##1 7E 03 2A ..{42} ..{2} 00
        ? points of each module  007E0108##1 7E 03 0F C5 00 0B 1C EB  007E011B##1 7E 03 16 ..{22} ..{2} 00{5}
        ? palm, first 29         007E0108##1 7E 04 10 68 00 1D BE D0  007E013F##1 7E 04 3A ..{58} ..{2} 00
        ? palm, last 7           007E0108##1 7E 04 10 85 00 07 AF 2E  007E0113##1 7E 04 0E ..{14} ..{2} 00
        ? thumb tip, first 29    007E0108##1 7E 04 10 9A 00 1D 1F 23  007E013F##1 7E 04 3A ..{58} ..{2} 00
        ? index tip              007E0108##1 7E 04 10 FE 00 15 5F 3A  007E012F##1 7E 04 2A ..{42} ..{2} 00
        zero all                 007E0108##1 7E 06 0F AB 00 01 31 31  =
        ? too much for a frame: illegal value  007E0108##1 7E 04 10 68 00 24 7E C2  007E0105##1 7E 84 03 32 D9
        """
    )
    documented_with = ("packing", "serial")

    def __init__(
        self, *, touch: Touch = "array", packing: Packing = "pairs", side: Side = "left", serial: SerialNumber = ""
    ):
        self._power_up(touch, packing, side, serial)
        brainco_canfd.plug(self)

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Answer the request in one frame."""
        return brainco_canfd.answers(self, data, t_ns)


def _hand(touch: str) -> Layout:
    """Return modules in wire order, each on its link; x across the hand, y along the fingers, z out of it."""
    pads = []
    for name, n in zip(MODULES, ARRAY_POINTS if touch == "array" else MATRIX_POINTS):
        link, _, part = name.partition(" ")
        pitch = 0.002 if part else 0.004
        if touch == "matrix" or n == 36:
            pad = grid_layout(n // 6, 6, pitch, name=name, link=link)
        else:
            pad = filled(n, 6 * pitch, n / 6 * pitch, name=name, link=link)
        x, y = PLACES_M[link]
        pads.append(place(pad, (x, y + (0.025 if part == "tip" else 0.0), 0.0)))
    return stack(*pads)
