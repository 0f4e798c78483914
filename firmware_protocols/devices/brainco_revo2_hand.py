"""The BrainCo Revo2 Touch hand, without the line that carries its Modbus frames: registers, touch and motors.

Its datasheet is :mod:`firmware_protocols.devices.brainco_revo2`.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Layout, Motors, Option, Reading, RegisterMap, Registers, Restart, fact_table, filled,
    grid_layout, place, quantize, stack, xyz,
)  # fmt: skip

MAP = RegisterMap(
    """
    1802   >u2       side             1..4  = 1  r
    1806   >u2       defaults         0..1
    1808   >u2 x 3   switches         0..1  = 1  flash
    1820   u1 x 20   key
    1840   u1 x 20   new_serial
    1860   >u2 x 6   protected        = 1000  flash
    1872   >u2       lock             = 1000  flash
    1874   u1 x 2    unit_mode
    1876   >u2 x 2   set_lowest
    1880   >u2 x 2   set_highest
    1884   >u2 x 2   set_fastest
    1888   >u2 x 2   set_strongest
    1892   >u2 x 6   lowest           r  flash
    1904   >u2 x 6   highest          = 1000  r  flash
    1916   >u2 x 6   fastest          = 1000  r  flash
    1928   >u2 x 6   strongest        = 1000  r  flash
    1940   >u2       kind             1..4  = 1  r
    1960   u1 x 14   backlash         flash
    2000   >u2       unit             1..247  = 126  flash
    2002   >u2       baud             0..9  = 3  flash
    2004   >u2       can_baud         0..10  = 10  flash
    2006   u1 x 2    can_sampling     flash
    2018   >u2       restart          0..1
    2020   >u2 x 12  by_time
    2044   >u2 x 12  by_speed
    2068   >i2 x 6   speeds
    2080   >i2 x 6   currents
    2092   >i2 x 6   duties
    2104   >u2 x 3   one_by_time
    2110   >u2 x 3   one_by_speed
    2116   >i2 x 2   one_speed
    2120   >i2 x 2   one_current
    2124   >i2 x 2   one_duty
    2128   u1 x 2    led
    2130   >u2       turbo            0..1  flash
    2132   >u2 x 2   turbo_times      = 2000, 3000  flash
    2136   >u2       auto_calibration  0..1  flash
    2138   u1 x 2    calibrate_motors
    2140   >u2 x 6   by_percent
    4000   >u2 x 6   now_positions    r
    4012   >i2 x 6   now_speeds       r
    4024   u1 x 12   now_currents     r
    4036   >u2 x 6   now_states       r
    6000   u1 x 20   firmware         r
    6020   u1 x 20   serial           r  flash
    8000   >u2 x 5   tips_on          0..1  = 1
    8010   >u2 x 5   baseline         0..1
    8020   >u2 x 5   calibrate        0..1
    8200   u1 x 100  tip_firmware     r
    8400   >u2 x 15  forces           r
    8430   >u4 x 5   proximity        r
    8500   u1 x 60   single           r
    12000  >u2       mode             0..2
    12002  >u2 x 6   sums             r
    12020  >u2 x 91  points           r
    12220  u1 x 120  pad_firmware     r
    12400  >u2 x 6   pads_on          0..1  = 1
    12480  u1 x 120  pad_serial       r
    12620  >u2 x 6   calibrate_pads   0..1
    14002  >u2 x 4   force_on         0..1  = 1
    14012  >u2 x 4   calibrate_force  0..1
    14200  u1 x 16   force_sums       r
    14400  u1 x 124  force_index      r
    14600  u1 x 124  force_middle     r
    14800  u1 x 124  force_ring       r
    15000  u1 x 124  force_little     r
    """
)
"""Offsets count bytes: two for each register."""
TOUCH = {
    # kind of touch: its number, switches, and orders that zero it
    "capacitive": (1, "tips_on", ("baseline", "calibrate")),
    "pressure": (2, "pads_on", ("calibrate_pads",)),
    "force3d": (4, "force_on", ("calibrate_force",)),
}
ORDER_REGISTERS = ("baseline", "calibrate", "calibrate_pads", "calibrate_force", "defaults", "restart")
POINT_TYPE = np.dtype([("shear", "i1", 2), ("normal", ">u2")])
POINT_LIMITS = np.array([(-128, -128, 0), (127, 127, 0xFFFF)])
FORCE3D_COUNTS_PER_NEWTON = 10.0
BAUDS = (115200, 57600, 19200, 460800, 1_000_000, 2_000_000, 5_000_000, 6_000_000, 4_000_000, 3_000_000)
RESTARTING_REGISTERS = {"unit", "baud", "can_baud", "restart", "auto_calibration", "defaults"}
"""The registers that restart the hand when they change."""
N_MOTORS = 6
"""The motors: thumb, thumb turn, index, middle, ring, little finger."""
FIRMWARE = b"1.0.5".ljust(20, b"\0")
FINGERTIPS_M = {
    "thumb": (0.06, 0.0), "index": (0.03, 0.09), "middle": (0.01, 0.1), "ring": (-0.01, 0.095),
    "little": (-0.03, 0.08),
}  # fmt: skip
RESTART_NS = 100_000_000
_MOTION_REGISTERS = (
    "by_time", "by_speed", "by_percent", "speeds", "currents", "duties", "one_by_time", "one_by_speed", "one_speed",
    "one_current", "one_duty",
)  # fmt: skip
COUNTS_PER_NEWTON = 100.0
PROXIMITY_COUNTS_PER_NEWTON = 10000.0
POINT_COUNTS_PER_NEWTON = (200.0, 200.0, 1000.0)
"""The scale of a pressure point in the modes raw, calibrated and force."""


EXAMPLES = "BrainCoTech/stark-serialport-example@b27b922 python/"
LOOKED = "bc-stark-sdk 2.0.8 main_mod.pyi; all of BrainCoTech/stark-serialport-example@b27b922 python, README.md"


class Revo2(Device[Any]):
    """A hand with its registers, for either line."""

    kind = "hand"
    evidence = ("driver",)
    sources = (
        "bc-stark-sdk 2.0.8 main_mod.pyi (RegAddrRevo2, Baudrate, TouchVendor, SkuType), and what it reads and writes",
        f"{EXAMPLES}common_socketcan.py, revo2, revo2_canfd",
        "serial numbers in public logs: BCXTL2313J2500008, BCXTR2124J2600024",
    )
    judge = "bc-stark-sdk 2.0.8"
    documented_with = ("serial", "single_proximity")
    facts = fact_table(f"""
        stated touch: the order and size of all values @ bc-stark-sdk 2.0.8 main_mod.pyi TouchFingerItem, RegAddrRevo2
        stated touch: the proximities at 4250 have their low byte first @ bc-stark-sdk 2.0.8, what
            get_single_touch_sensor_status() makes of them
        assumed touch: places: all in one plane with normal +z, row by row; 3 x 3 points 3 mm apart, on the palm 5 mm
        assumed touch: 100 counts/N; the direction is in degrees, 0..359; the proximity has 10000 counts/N of push; all
            states are normal
        assumed touch: points have 200 counts/N as raw and calibrated values, mN as forces, and the range 0..4095; the
            sums of a module have the unit of its points
        stated touch: three-axis points: the registers of four fingers with 31 points each; x and y are signed bytes, z
            has 16 bits @ bc-stark-sdk 2.0.8, what it makes of each byte
        assumed touch: three-axis points have 10 counts/N and lie row by row on 12 x 18 mm; the sums of a finger
            saturate
        assumed touch: a new baseline and a calibration make the present forces zero, until power-off; sensors that are
            off read 0
        stated identity: the registers of versions, serial numbers, unit and line, and their codes @ bc-stark-sdk 2.0.8
            main_mod.pyi
        stated identity: a serial number may be written after a factory key @ {EXAMPLES}revo2/revo2_cfg.py:150
        assumed identity: firmware 1.0.5 of hand, fingertips and pads; the serial numbers of the pads; any factory key
            is accepted
        stated configuration: the hand restarts when unit, line or automatic calibration is changed @
            {EXAMPLES}revo2/revo2_cfg.py:11, 121
        stated configuration: sensors are on at power-up @ {EXAMPLES}revo2/revo2_touch.py:13
        stated configuration: goals are 0..1000 and times 1..2000 ms; speeds, currents and duties are -1000..1000 @
            bc-stark-sdk 2.0.8 main_mod.pyi:1283
        assumed configuration: functions 03 and 04 read the same registers; registers that are not modelled read 0; a
            restart takes 0.1 s
        assumed configuration: limits are 1000; LED, buzzer and vibration are on; limits, turbo, gestures and the unit
            of goals have no effect
        assumed configuration: motors move 2000 counts a second; currents and duties drive them like speeds; currents
            read 0
        assumed timing: 460800 baud as delivered; the hand answers at once; touch is sampled 100 times a second
        assumed timing: over CAN a request for more than 29 registers is answered with exception 3
    """, looked=LOOKED)  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["left", "right"], Option("which hand; sets unit and serial number")] = "left",
        touch: Annotated[Literal["capacitive", "pressure", "force3d"], Option("kind of sensors")] = "capacitive",
        serial: Annotated[str, Option("20 characters of ASCII; default: by side")] = "",
        single_proximity: Annotated[
            Literal["little", "big"],
            Option("first byte of the proximities at 4250: low, as the SDK reads them, or high"),
        ] = "little",
    ):
        self.touch, self.single_type = touch, f"{'>' if single_proximity == 'big' else '<'}u4"
        self.layout, self.columns = _hand(touch), _columns(touch)
        serial = serial or f"BCXT{side[0].upper()}2313J2500008"
        delivered = {"unit": 0x7E if side == "left" else 0x7F, "serial": serial.encode("ascii")}
        self.registers = Registers(MAP, kept={**delivered, **self.flash})
        self.registers["side"], self.registers["kind"] = (2 if side == "left" else 1), TOUCH[touch][0]
        self.registers["firmware"] = FIRMWARE
        if touch != "force3d":
            name = "tip_firmware" if touch == "capacitive" else "pad_firmware"
            self.registers[name] = FIRMWARE * len(self.layout.patches)
        if touch == "pressure":
            self.registers["pad_serial"] = b"".join(b"BCPT2313J250000%d" % k + bytes(4) for k in range(1, 7))
        self.unit = self.registers["unit"]
        self.motors = Motors([0.0] * N_MOTORS, low=0, high=1000, speed_limit=2000, names=(), time_constant_s=0.02)
        self.felt = self.zero = np.zeros((len(self.layout), 3))
        self.modules = np.repeat(np.arange(len(self.layout.patches)), [len(patch) for patch in self.layout.patches])
        self.counts = np.zeros({"capacitive": (5, 4), "pressure": 91, "force3d": (124, 3)}[touch], int)
        self.restarts = False
        """True after a write that restarts the hand."""
        self._plug()

    @abstractmethod
    def _plug(self) -> None:
        """Set up the ports and the framing of the line."""

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return normal, tangential, direction, proximity ``(5, 4)``; or points ``(91,)``; or x, y, z ``(124, 3)``."""
        self.felt = self.layout.to_taxel_frame(reading["force"])
        on = np.array(self.registers.all(TOUCH[self.touch][1]))
        x, y, z = ((self.felt - self.zero) * on[self.modules, None]).T
        if self.touch == "capacitive":
            direction = np.rint(np.rad2deg(np.arctan2(y, x))).astype(int) % 360
            forces = [quantize(force, COUNTS_PER_NEWTON) for force in (-z, np.hypot(x, y))]
            near = quantize(-z, PROXIMITY_COUNTS_PER_NEWTON, 0, 0xFFFFFFFF)
            self.counts = np.stack([*forces, direction, near], axis=-1)
        elif self.touch == "force3d":
            forces = np.stack([x, y, -z], axis=-1)
            self.counts = quantize(forces, FORCE3D_COUNTS_PER_NEWTON, *POINT_LIMITS)
            sums = quantize(np.add.reduceat(forces, range(0, 124, 31)), FORCE3D_COUNTS_PER_NEWTON, *POINT_LIMITS)
            self.registers["force_sums"] = _points(sums)
        else:
            scale = POINT_COUNTS_PER_NEWTON[self.registers["mode"]]
            self.counts = quantize(-z, scale, 0, 4095)
            self.registers["sums"] = np.bincount(self.modules, -z) * scale
        return self.counts

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return registers, with the touch of the last conversion and the motors at ``t_ns``."""
        touched = {reg.name for reg in MAP.touched(address, address + n)}
        wire = self.layout.on_wire(self.counts)
        if touched & {"now_positions", "now_speeds", "now_states"}:
            self.registers["now_positions"] = self.motors.positions(t_ns)
            self.registers["now_speeds"] = self.motors.velocities(t_ns)
            self.registers["now_states"] = self.motors.moving(t_ns, 1.0)
        if self.touch == "force3d":
            for patch in self.layout.patches:
                self.registers[f"force_{patch.name}"] = _points(wire[patch.taxels])
        elif self.touch == "capacitive":
            self.registers["forces"], self.registers["proximity"] = wire[:, :3].ravel(), wire[:, 3]
            singles = np.zeros(5, [("forces", ">u2", 3), ("proximity", self.single_type), ("state", ">u2")])
            singles["forces"], singles["proximity"] = wire[:, :3], wire[:, 3]
            self.registers["single"] = np.frombuffer(singles.tobytes(), np.uint8)
        else:
            self.registers["points"] = wire
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and execute its orders."""
        before = {name: self.registers.all(name) for name in RESTARTING_REGISTERS}
        written = self.registers.write(address, data)
        for order in TOUCH[self.touch][2]:
            ordered = np.array(self.registers.all(order))[self.modules, None]
            self.zero = np.where(ordered, self.felt, self.zero)
        for name in written:
            if name.startswith("set_"):
                finger, value = self.registers.all(name)
                limits = self.registers.all(name.removeprefix("set_"))
                if 1 <= finger <= len(limits):
                    limits[finger - 1] = value
                    self.registers[name.removeprefix("set_")] = limits
            self._drive(name, t_ns)
        if "new_serial" in written and any(self.registers.all("key")):
            self.registers["serial"] = self.registers.all("new_serial")
        if "defaults" in written and self.registers["defaults"]:
            unit, serial = self.registers["unit"], self.registers.all("serial")
            self.registers.reset(*(reg.name for reg in MAP.rows if reg.flash))
            self.registers["unit"], self.registers["serial"] = unit, serial
        self.restarts |= any(self.registers.all(name) != before[name] for name in RESTARTING_REGISTERS & set(written))
        self.registers.reset(*ORDER_REGISTERS)
        if {"new_serial", "defaults"} & set(written) or any(
            MAP.by_name[name].flash or name.startswith("set_") for name in written
        ):
            self.flash.update(self.registers.kept())
        return written

    def _drive(self, name: str, t_ns: int) -> None:
        """Move the motors as the register ``name`` orders."""
        if name not in _MOTION_REGISTERS:
            return
        numbers, n, one = np.array(self.registers.all(name), float), N_MOTORS, name.startswith("one_")
        if one and not 1 <= numbers[0] <= n:
            return
        at, first, second = slice(None), numbers[:n], numbers[n:]
        if one:
            at, first, second = slice(int(numbers[0]) - 1, int(numbers[0])), numbers[1:2], numbers[2:]
        if not name.endswith(("by_time", "by_speed", "by_percent")):
            self.motors.drive(first, t_ns, at=at)
            return
        goals, limits = first * (10 if name == "by_percent" else 1), np.full(n, 2000.0)
        if name.endswith("by_time"):
            second = np.abs(goals - self.motors.positions(t_ns)[at]) / np.maximum(second, 1) * 1000
        if len(second):
            limits[at] = np.maximum(second, 1.0)
        self.motors.limit_speed(limits, t_ns)
        self.motors.go(goals, t_ns, at=at)

    def _restarted(self, sent: Sequence[Any]) -> list[Any]:
        """Return ``sent``, followed by the restart if one was ordered."""
        ordered, self.restarts = self.restarts, False
        return [*sent, Restart(delay_ns=RESTART_NS)] if ordered else [*sent]


def _points(counts: np.ndarray) -> bytes:
    """Return points as they are sent: x and y in the two bytes of a register, z in the next one."""
    points = np.zeros(len(counts), POINT_TYPE)
    points["shear"], points["normal"] = counts[:, :2], counts[:, 2]
    return points.tobytes()


def _columns(touch: str) -> tuple[Column, ...]:
    if touch == "force3d":
        low, high = POINT_LIMITS
        return xyz("Fx Fy Fz", low=low, high=high, assumed_per_unit=FORCE3D_COUNTS_PER_NEWTON, push=1)
    if touch == "pressure":
        return (Column(name="touch", low=0, high=4095, push=1),)
    return (
        Column(name="normal", axis="z", low=0, high=0xFFFF, push=1),
        Column(name="tangential", low=0, high=0xFFFF),
        Column(name="direction", low=0, high=359),
        Column(name="proximity", low=0, high=0xFFFFFFFF, push=1),
    )


def _hand(touch: str) -> Layout:
    """Return fingertips, then the palm, each on its link; x across the hand, y along the fingers, z out of it."""
    if touch == "force3d":
        fingers = list(FINGERTIPS_M.items())[1:]
        return stack(*(place(filled(31, 0.012, 0.018, name=f, link=f), (*at, 0.0)) for f, at in fingers))
    size, pitch = ((1, 1), 0.01) if touch == "capacitive" else ((3, 3), 0.003)
    pads = [place(grid_layout(*size, pitch, name=name, link=name), (*at, 0.0)) for name, at in FINGERTIPS_M.items()]
    return stack(*pads) if touch == "capacitive" else stack(*pads, filled(46, 0.035, 0.035, name="palm", link="palm"))
