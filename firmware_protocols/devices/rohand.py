"""OYMotion ROHand: a hand with dots or three-axis points in its fingers and palm, over Modbus RTU.

Wire: RS-485 or RS-232, 115200 8N1, Modbus RTU, unit 2; functions 03, 06, 16. Registers, six values being thumb, index,
middle, ring, little finger and the thumb's root; where they differ, those of the second generation follow a bar:

    register     numbers  access  about
    1000         1        r       protocol: 01xx first, 02xx second generation
    1001, 1002   1 each   r       firmware, its revision
    1003         1        r       hardware, 2001
    1005         1        rw      unit: kept, and a restart
    1006         1        r       cause of the last exception 4
    1008, 1009   1 each   rw      self-test and beeps, 1 on; kept
    1012, 1013   1 each   w       orders: calibrate the motors, initialise; read 0 again
    1014         1        w       0 restarts; any other value waits for new firmware, silently
         |1016   1        w       1 zeros the forces; in the first generation reserved
    1045         4 x 10   rw      gains P, I, D, G [0.01] of six motors; kept
    1085         6        r       0 opening, 1 closing, 2 there
    1095         6        rw      limits of the currents [mA]
    1105         6        r       currents [mA]
    1115         5|6      rw      force limits | targets [mN]
    1120|1175    5|6      r       force of each finger [mN]
    1125         6        rw      speeds, 65535 is the fastest
    1135         6        rw      positions to go to, 0 open .. 65535 closed
    1145         6        r       positions
    1155         6        rw      angles to go to, int16 [0.01 deg]
    1165         6        r       angles
    1185|1195    6        rw      current of a stalled motor [mA]; 1195|1205 time until it stops, 1205|1215 retries [ms]
         |1265   1        r       high byte: 0 dots, 1 three-axis points
         |2000 + 100 part  r      touch of the thumb, index, middle, ring, little finger, palm (part 0 to 5)

    part                   thumb  index, middle, ring  little  palm
    dots                   36     60 each              32      56
    three-axis points      1      2 each               1       56 dots

Dots are bytes 0..255, row by row, two in a register, the first one in its high byte. A three-axis point is normal,
tangential, direction in three registers, *low byte first*, against the rule of Modbus; FFFF marks an invalid one. The
first generation (``touch=finger``) has one force for each finger only.

Exception 1 is an unknown function, 2 an address, 3 an invalid request; 4 refers to 1006: 1 not initialised, 2 not
calibrated, 3 value out of its range, 4 a motor stuck, 5 failed, 6 not saved.

Try it: ``tactemu run rohand``, then ``02 03 08 34 00 1E 86 5F`` for the index finger's dots.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Layout, Motors, Option, Reading, Refused, RegisterMap, Registers, Restart, Rs485,
    Transmissions, command_table, fact_table, grid_layout, place, quantize, stack,
)  # fmt: skip
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns

BAUD = 115200
COMMON_REGISTERS = """
    2000  >u2      protocol       r
    2002  >u2      firmware       = 256  r
    2006  >u2      hardware       = 8193  r
    2011  u1       unit           1..247  = 2  flash
    2012  >u2      cause          0..6  r
    2017  u1       self_test      0..1  = 1  flash
    2019  u1       beep           0..1  = 1  flash
    2024  u1 x 2   calibrate
    2026  u1 x 2   initialise
    2028  u1 x 2   restart
    2090  >u2 x 6  p              = 25000  flash
    2110  >u2 x 6  i              = 200  flash
    2130  >u2 x 6  d              = 25000  flash
    2150  >u2 x 6  g              = 100  flash
    2170  >u2 x 6  status         = 2  r
    2190  >u2 x 6  current_limit  = 1178
    2210  >u2 x 6  current        r
    2250  >u2 x 6  speed          = 65535
    2270  >u2 x 6  position_set
    2290  >u2 x 6  position       r
    2310  >i2 x 6  angle_set      = 3670, 17837, 17606, 17656, 17486, 0
    2330  >i2 x 6  angle          r
"""
FIRST_GENERATION = RegisterMap(
    COMMON_REGISTERS
    + """
    2004  >u2      revision       = 309  r
    2230  >u2 x 5  force_limit    = 15000
    2240  >u2 x 5  force          r
    2370  >u2 x 6  stall_current  = 200
    2390  >u2 x 6  stall_time     = 300
    2410  >u2 x 6  retry_time     = 500
    """,
    size=2468,
    writable=((2010, 2034), (2040, 2170), (2190, 2210), (2250, 2290), (2310, 2330), (2350, 2468)),
)
SECOND_GENERATION = RegisterMap(
    COMMON_REGISTERS
    + """
    2033  u1       zero           0..1
    2230  >u2 x 6  force_limit    = 15000
    2350  >u2 x 6  force          r
    2390  >u2 x 6  stall_current  = 200
    2410  >u2 x 6  stall_time     = 300
    2430  >u2 x 6  retry_time     = 500
    2530  u1       force_type     r
    4000  u1 x 36  thumb          r
    4200  u1 x 60  index          r
    4400  u1 x 60  middle         r
    4600  u1 x 60  ring           r
    4800  u1 x 32  little         r
    5000  u1 x 56  palm           r
    """,
    writable=((2010, 2034), (2040, 2170), (2190, 2210), (2230, 2290), (2310, 2330), (2370, 2568)),
)
"""Offsets count bytes: two for each register."""
TOUCH_PARTS = {
    # name: place [m], rows and columns of dots, number of three-axis points
    "thumb": ((0.06, 0.02, 0.0), 9, 4, 1),
    "index": ((0.033, 0.09, 0.0), 12, 5, 2),
    "middle": ((0.011, 0.1, 0.0), 12, 5, 2),
    "ring": ((-0.011, 0.095, 0.0), 12, 5, 2),
    "little": ((-0.033, 0.08, 0.0), 8, 4, 1),
    "palm": ((0.0, 0.0, 0.0), 7, 8, 0),
}
RESTART_NS = 100_000_000
ORDERS = ("calibrate", "initialise", "restart")
TARGETS = ("position_set", "angle_set")
BAD_VALUE = 3

OPEN_CENTIDEG = np.array([3670, 17837, 17606, 17656, 17486, 0])
CLOSED_CENTIDEG = np.array([226, 10022, 9781, 10138, 9884, 8998])
"""The angles of a closed hand [0.01 deg], as those of an open one above."""
STROKES_CENTIDEG = CLOSED_CENTIDEG - OPEN_CENTIDEG
FULL_STROKE_S = 1.0
MOVING_MA = 200
FULL_SCALE = 0xFFFF
JOINT_NAMES = ("thumb", "index", "middle", "ring", "little", "thumb root")
DOT_COUNTS_PER_NEWTON = 50.0
COUNTS_PER_NEWTON = 100.0
MILLINEWTONS_PER_NEWTON = 1000.0
Touch = Literal["dots", "three_axis", "finger"]
_DEMOS = "oymotion/roh_gen2_demos@026e86b"
_FIRMWARE = "oymotion/roh_firmware@4697700"
_DOC = f"{_FIRMWARE} protocol/OHandModBusRTUProtocol_EN.md"
_READ = "roh_gen2_demos (whole), OHandModBusRTUProtocol_EN.md, RELEASE_INFO.md, unienv-rohand"


class RoHand(Device):
    """A hand with touch, and fingers that follow their commands."""

    name = "rohand"
    title = "OYMotion ROHand"
    kind = "hand"
    evidence = ("vendor document", "driver")
    sources = (
        f"{_DEMOS} common/roh_registers_v2.py, heat_map_dot.py l.8-14, "
        "force_on_rohand/force_chart.py l.120-175, 332-372, loop_test/loop_test.py (second generation)",
        f"{_FIRMWARE} protocol/OHandModBusRTUProtocol_EN.md (first generation: registers, defaults, line, exceptions)",
        "unienv-rohand 0.0.1a2 roh_registers_v1.py, rohand.py (1085..1174, units, angles open and closed)",
    )
    judge = "oymotion/roh_gen2_demos@026e86b, unienv-rohand 0.0.1a2"
    documented = command_table(
        """
        @ oymotion/roh_gen2_demos@026e86b common/roh_registers_v2.py
        ? dots of the thumb               03 07 D0 00 12 C5 79                 03 24 ..{36} ..{2}
        ? dots of the index finger        03 08 34 00 1E 86 5F                 03 3C ..{60} ..{2}
        ? dots of the middle finger       03 08 98 00 1E 46 7E                 03 3C ..{60} ..{2}
        ? dots of the ring finger         03 08 FC 00 1E 07 A1                 03 3C ..{60} ..{2}
        ? dots of the little finger       03 09 60 00 10 47 B7                 03 20 ..{32} ..{2}
        ? dots of the palm                03 09 C4 00 1C 06 51                 03 38 ..{56} ..{2}
        ? kind of touch                   03 04 F1 00 01 D4 FA                 03 02 00 00 FC 44
        ? hardware                        03 03 EB 00 01 F4 49                 03 02 20 01 24 44
        ? forces                          03 04 97 00 06 75 27                 03 0C ..{12} ..{2}
        zero the forces                   10 03 F8 00 01 02 00 01 55 D8        10 03 F8 00 01 80 4F
        @ oymotion/roh_firmware@4697700 protocol/OHandModBusRTUProtocol_EN.md
        ? protocol                        03 03 E8 00 01 04 49                 03 02 02 00 FD 24
        ? firmware                        03 03 E9 00 01 55 89                 03 02 ..{2} ..{2}
        ? unit                            03 03 ED 00 01 14 48                 03 02 00 02 7D 85
        ? cause of exception 4            03 03 EE 00 01 E4 48                 03 02 00 00 FC 44
        unit 248: exception 4             06 03 ED 00 F8 18 0A                 86 04 B3 A3
        calibrate                         06 03 F4 00 01 09 8F                 =
        initialise                        06 03 F5 00 01 58 4F                 =
        restart                           06 03 F6 00 00 69 8F                 =
        @ unienv-rohand 0.0.1a2 roh_registers_v1.py, rohand.py (1085..1174, units, angles open and closed)
        ? states                          03 04 3D 00 06 55 07                 03 0C ..{12} ..{2}
        ? currents                        03 04 51 00 06 95 1A                 03 0C ..{12} ..{2}
        ? positions                       03 04 79 00 06 15 12                 03 0C ..{12} ..{2}
        ? angles                          03 04 8D 00 06 54 E0                 03 0C ..{12} ..{2}
        limit a force                     06 04 5B 3A 98 EA 10                 =
        slow the thumb                    06 04 65 40 00 A9 16                 =
        bend the thumb                    06 04 6F 80 00 D9 14                 =
        two angles                        10 04 83 00 02 04 07 D0 36 B0 90 C7  10 04 83 00 02 B1 23
        @ Modbus application protocol V1.1b3, 7
        ? beyond the map: illegal address   03 27 10 00 01 8F 48                 83 02 30 F1
        write a version: illegal address  06 03 E8 00 01 C8 49                 86 02 33 A1
        read coils: illegal function      01 03 E8 00 01 7D 89                 81 01 71 90
        ? read too much: illegal value    03 03 E8 00 7E 45 A9                 83 03 F1 31
        """,
        head="02",
    )
    facts = fact_table(f"""
        stated touch: the dots, parts and bytes of touch in each generation @ {_DEMOS} force_chart.py:120
        stated touch: forces of fingers are in mN (first generation) @ {_DOC}:242
        assumed touch: second generation: forces are in mN and are sums over dots; for three-axis points they are 0
        assumed touch: places: flat grids of 9x4, 12x5, 8x4 and 7x8 dots, at 2 mm on fingers and 5 mm on the palm (the
            vendor's drawing has dots that do not exist); three-axis points are 12 mm apart, single ones in the middle
            of a finger
        assumed touch: a dot has 50 counts/N, a three-axis point 100 counts/N and a direction of 0..359 deg; values are
            never invalid
        stated identity: hardware 2001 @ {_DEMOS} force_on_rohand/force_chart.py:29
        stated identity: firmware 3.1.309 of the first generation @ {_FIRMWARE} firmware/RELEASE_INFO.md:25
        assumed identity: firmware of the second generation 1.0, boot loader 0
        stated configuration: RS-232 and RS-485, 115200 @ {_DOC}:12
        stated configuration: the registers of the second generation @ {_DEMOS} common/roh_registers_v2.py:7
        stated configuration: the registers and factory defaults of the first generation @ {_DOC}:122
        stated configuration: a new unit is saved, and the hand restarts @ {_DOC}:127
        stated configuration: register 1014: 0 restarts the hand, other values start a firmware update @ {_DOC}:136
        assumed configuration: the second generation has the first one's defaults; force targets 15000
        assumed configuration: limits, gains, calibration, initialisation and stalls have no effect; the hand is ready
            at once; the zero is lost at power-off; reserved registers are stored; all others read 0
        assumed timing: a full stroke takes 1 s at full speed; a moving motor draws 200 mA; a restart follows after 0.1
            s; 100 conversions a second
    """, looked=_READ)  # fmt: skip

    def __init__(
        self,
        *,
        touch: Annotated[Touch, Option("kind of sensors; finger: first generation, one force each")] = "dots",
        unit: Annotated[int, Option("unit as delivered; register 1005 holds it", low=1, high=247)] = 2,
    ):
        self.touch, self.layout, self.columns, first = touch, hand_layout(touch), _columns(touch), touch == "finger"
        self.registers = Registers(FIRST_GENERATION if first else SECOND_GENERATION, kept={"unit": unit, **self.flash})
        self.registers["protocol"] = 0x0100 if first else 0x0200
        if first:
            self.registers["firmware"] = 0x0301
        else:
            self.registers["force_type"] = touch == "three_axis"
        self.updating = False
        self.unit = self.registers["unit"]
        self.ports = (Rs485(baud=BAUD),)
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(BAUD))
        speed = FULL_SCALE / FULL_STROKE_S
        self.motors = Motors([0.0] * 6, low=0.0, high=FULL_SCALE, time_constant_s=0.0, speed_limit=speed)
        self.present = self.zero = np.zeros((len(self.layout), 3) if touch == "three_axis" else len(self.layout))
        self.counts = np.zeros(len(self.layout), int)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return dots 0..255 or fingers [mN], shape ``(n,)``; or normal, tangential, direction, shape ``(n, 3)``."""
        if self.touch != "three_axis":
            return super().measure(reading, t_ns)
        self.present = self.layout.to_taxel_frame(reading["force"])
        x, y, z = (self.present - self.zero).T
        direction = np.rint(np.rad2deg(np.arctan2(y, x))).astype(int) % 360
        forces = [quantize(force, COUNTS_PER_NEWTON, 0, FULL_SCALE - 1) for force in (-z, np.hypot(x, y))]
        self.counts = np.stack([*forces, direction], axis=-1)
        palm = self.layout.patches[-1].taxels
        self.counts[palm] = 0
        self.counts[palm, 0] = quantize(-z[palm], DOT_COUNTS_PER_NEWTON, 0, 255)
        return self.counts

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angles of the joints [rad] as the hand reports them, by name."""
        return dict(zip(JOINT_NAMES, np.deg2rad(self._angles(t_ns) / 100).tolist()))

    def _angles(self, t_ns: int) -> np.ndarray:
        return OPEN_CENTIDEG + STROKES_CENTIDEG * self.motors.positions(t_ns) / FULL_SCALE

    # -- requests --------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        if self.updating:
            self.counters["ignored"] += 1
            return ()
        return self.rtu.answers(data, t_ns, {self.unit: Banks(holding=self, functions=(3, 6, 16))})

    def wake(self, t_ns: int) -> Transmissions:
        """Restart, as ordered."""
        return [Restart()]

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as the hand reports it at ``t_ns``."""
        moving = self.motors.moving(t_ns)
        self.registers["status"] = np.select([~moving, self.motors.goals > self.motors.positions(t_ns)], [2, 1], 0)
        self.registers["current"] = MOVING_MA * moving
        self.registers["position"] = self.motors.positions(t_ns)
        self.registers["angle"] = self._angles(t_ns)
        wire = self.layout.on_wire(self.counts)
        if self.touch == "finger":
            self.registers["force"] = wire
            return self.registers.read(address, n)
        if address + n > self.registers.table.by_name["thumb"].address:
            for patch in self.layout.patches:
                self._show(patch.name, wire[patch.taxels])
        elif self.touch == "dots":
            push = self.present - self.zero
            sums = [push[patch.taxels].sum() for patch in self.layout.patches if patch.name != "palm"]
            self.registers["force"] = np.append(np.maximum(sums, 0.0) * MILLINEWTONS_PER_NEWTON, 0.0)
        return self.registers.read(address, n)

    def _show(self, part: str, counts: np.ndarray) -> None:
        """Store a part's dots unchanged; points as three registers each, low byte first."""
        if counts.ndim == 2:
            counts = counts[:, 0] if part == "palm" else np.frombuffer(counts.astype("<u2").tobytes(), np.uint8)
        self.registers[part] = np.pad(counts, (0, self.registers.table.by_name[part].count - len(counts)))

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and execute its orders; a value out of its range is exception 4."""
        before = [np.array(self.registers.all(name)) for name in TARGETS]
        try:
            written = self.registers.write(address, data)
        except Refused as refused:
            if refused.why != "value":
                raise
            self.registers["cause"] = BAD_VALUE
            raise Refused("failure") from None
        self.flash.update(self.registers.kept())
        positions, angles = (np.array(self.registers.all(name)) for name in TARGETS)
        if "position_set" in written:
            self.motors.go(np.where(positions != before[0], positions, np.nan), t_ns)
            self.registers["angle_set"] = OPEN_CENTIDEG + STROKES_CENTIDEG * self.motors.goals / FULL_SCALE
        if "angle_set" in written:
            goals = (angles - OPEN_CENTIDEG) / STROKES_CENTIDEG * FULL_SCALE
            self.motors.go(np.where(angles != before[1], goals, np.nan), t_ns)
            self.registers["position_set"] = self.motors.goals
        if "speed" in written:
            self.motors.limit_speed(np.array(self.registers.all("speed")) / FULL_STROKE_S, t_ns)
        if self.touch != "finger" and self.registers["zero"]:
            self.zero, self.registers["zero"] = self.present, 0
        self.updating = any(self.registers.all("restart"))
        if "unit" in written or ("restart" in written and not self.updating):
            self.wake_ns = t_ns + RESTART_NS
        self.registers.reset(*ORDERS)
        return written


def _columns(touch: Touch) -> tuple[Column, ...]:
    if touch == "dots":
        return (Column(name="touch", low=0, high=255, assumed_per_unit=DOT_COUNTS_PER_NEWTON, push=1),)
    if touch == "finger":
        scale = MILLINEWTONS_PER_NEWTON
        return (Column(name="force", unit="N", counts_per_unit=scale, low=0, high=FULL_SCALE, push=1),)
    return (
        Column(name="normal", axis="z", low=0, high=FULL_SCALE - 1, push=1),
        Column(name="tangential", low=0, high=FULL_SCALE - 1),
        Column(name="direction", low=0, high=359),
    )


def hand_layout(touch: Touch) -> Layout:
    """Return the parts in wire order, each on its link; x across the hand, y along the fingers, z out of it."""
    pads = []
    for name, (centre, rows, cols, n_points) in TOUCH_PARTS.items():
        pitch = 0.005 if name == "palm" else 0.002
        if touch != "dots" and n_points:
            rows, cols, pitch = (1 if touch == "finger" else n_points), 1, 0.012
        if touch != "finger" or n_points:
            pads.append(place(grid_layout(rows, cols, pitch, name=name, link=name), centre))
    return stack(*pads)
