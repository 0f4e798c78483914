"""GLI GHand 5: a hand with three-axis taxels in five fingertips, in Modbus registers.

Wire: RS-485, 1 000 000 8N1, Modbus RTU; unit 0x31 is a left hand, 0x32 a right one. A register is two bytes, high byte
first. Input registers (function 04):

    1000  8 registers    name; from 1008 hardware version, 1010 firmware version, all text
    1018  8              serial number, one number
    1020  1              1 a left hand, 2 a right one
    1021  2              state (0 stopped, 1 runs) and error, temperature [deg C]
    1023  3 a joint      state and error, angle [0.1 deg], speed and torque [%]: thumb IP, MCP, TMC FE, AA, PS, index
                         DIP, PIP, MCP, AA, middle DIP, PIP, MCP, ring likewise, little finger likewise
    1080  1              bits 8 to 12: thumb .. little finger are valid; low byte: error
    1081  3 a finger     resultant Fx, Fy (signed), Fz, each in the high byte
    1090  57, then 4x47  taxels of the thumb (38), index .. little finger (31 each): bytes Fx, Fy (signed), Fz, row by
                         row; a byte 00 completes the last register of a finger

Holding registers (functions 03, 06, 16):

    0000  1              unit, in force at once
    0001  1              0100 clears faults; the low byte then reads 1, for done
    0002  1              1 initialises the joints
    0010  1              high byte: mode, 0 position, 1 torque, 2 speed; low byte: 1 stops
    0011  2 a motor      angle to go to [0.1 deg], speed and torque [%], of the 13 joints that have one
    002B  1              0100 touch on, 0200 off, 0400 makes the present forces zero
    2007  3              motor driver's version

Forces are in 0.1 N. The hand also has CAN-FD and EtherCAT, which are not in this model.

Try it: ``tactemu run ghand5``, then send 31 04 10 80 00 10 F1 1E; or ``GHand(ProductType.GHand5, CommType.RS485)``.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Counts, Device, Motors, Option, Reading, RegisterMap, Registers, Rs485, Transmissions, command_table,
    fact_table, filled, place, quantize, stack, xyz,
)  # fmt: skip
from firmware_protocols.protocols.modbus import Banks, Rtu, silence_ns

JOINTS = {
    # name: stops [deg], in the order of their input registers; no stops: no motor
    "thumb ip": (), "thumb mcp": (0, 66), "thumb fe": (0, 50), "thumb aa": (20, 90), "thumb ps": (-10, 60),
    "index dip": (), "index pip": (0, 80), "index mcp": (0, 90), "index aa": (-10, 10),
    "middle dip": (), "middle pip": (0, 90), "middle mcp": (0, 90),
    "ring dip": (), "ring pip": (0, 90), "ring mcp": (0, 90),
    "little dip": (), "little pip": (0, 74), "little mcp": (0, 90),
}  # fmt: skip
DRIVEN_JOINTS = [k for k, stops in enumerate(JOINTS.values()) if stops]
INPUTS = RegisterMap("""
    8192  u1 x 16   name         r
    8208  u1 x 16   hardware     r
    8224  u1 x 16   firmware     r
    8240  u1 x 16   serial       r
    8256  >u2       side         r
    8258  u1        running      r
    8259  u1        fault        r
    8260  >u2       temperature  = 25  r
    8262  u1 x 108  joints       r
    8448  u1        state        r  = 31   bit k: finger k is valid
    8449  u1        error        r
    8450  u1 x 30   resultant    r         Fx 00 Fy 00 Fz 00 of each finger
    8480  u1 x 490  taxels       r         row by row
""")
HOLDING = RegisterMap("""
    0      >u2       unit        1..247  = 49  flash
    2      u1        clear       0..1
    3      u1        cleared
    4      >u2       initialise  0..1
    32     u1        mode        0..2
    33     u1        stop        0..1
    34     u1 x 52   orders                       angle [0.1 deg], speed, torque [%] of each motor
    86     u1        touch       0..4
    87     u1        touch_done
    16398  >u2 x 3   drivers     = 1, 0, 0  r
""")
"""Offsets count bytes: two for each register."""
ORDER_TYPE = np.dtype([("angle", ">i2"), ("speed", "i1"), ("torque", "i1")])
JOINT_TYPE = np.dtype(">u1, u1, >i2, i1, i1")
BAUD = 1_000_000
UNITS = {"left": 0x31, "right": 0x32}
TOUCH_ON, TOUCH_OFF, TOUCH_ZERO = 1, 2, 4
FULL_SPEED_DEG_PER_S = 180.0
TAXELS = {"thumb": 38, "index": 31, "middle": 31, "ring": 31, "little": 31}
ALL_VALID = 0x1F
PAD_SIZE_M = (0.012, 0.018)
FINGER_SPACING_M = 0.025
COUNTS_PER_NEWTON = 10.0
LOW_COUNTS = np.array([-128, -128, 0])
HIGH_COUNTS = np.array([127, 127, 255])
_SDK = "gli-sdk/GHand-Python-SDK@3ebbadf"
_COMM = f"{_SDK} src/ghand/comm/rs485_comm.py"
_READ = "rs485_comm.py, canfd_comm.py, modbus_codec.py, ghand.py, types.py, config/, README.md, docs/, examples/"


class GHand5(Device):
    """A hand of five fingertips and thirteen motors, which a driver polls by register."""

    name = "ghand5"
    kind = "hand"
    title = "GLI GHand 5, five three-axis fingertips"
    ports = (Rs485(baud=BAUD),)
    columns = xyz("Fx Fy Fz", unit="N", counts_per_unit=COUNTS_PER_NEWTON, low=LOW_COUNTS, high=HIGH_COUNTS, push=1)
    evidence = ("driver",)
    sources = (f"{_SDK} (the vendor's own)",)
    judge = _SDK
    documented = command_table(
        """
        ? state and resultants        04 10 80 00 10 F1 1E                 04 20 1F 00 ..{30} ..{2}
        ? taxels of the thumb         04 10 90 00 39 31 05                 04 72 ..{114} ..{2}
        ? taxels of the index finger  04 10 C9 00 2F 60 D8                 04 5E ..{94} ..{2}
        ? taxels of the middle finger   04 10 F8 00 2F 31 17                 04 5E ..{94} ..{2}
        ? taxels of the ring finger   04 11 27 00 2F 01 11                 04 5E ..{94} ..{2}
        ? taxels of the little finger   04 11 56 00 2F 51 0A                 04 5E ..{94} ..{2}
        ? name                        04 10 00 00 08 F0 FC                 04 10 ..{16} ..{2}
        ? hardware version            04 10 08 00 08 71 3E                 04 10 ..{16} ..{2}
        ? firmware version            04 10 10 00 08 F1 39
            04 10 76 31 2E 30 2E 30 00 00 00 00 00 00 00 00 00 00 B5 CC
        ? serial number               04 10 18 00 08 70 FB
            04 10 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 01 DB E8
        ? side                        04 10 20 00 01 31 30                 04 02 00 01 38 F4
        ? state and temperature       04 10 21 00 02 20 F1                 04 04 00 00 00 19 0A 4D
        ? joints                      04 10 23 00 36 80 E6                 04 6C ..{108} ..{2}
        ? unit                        03 00 00 00 01 81 FA                 03 02 00 31 39 94
        ? drivers                     03 20 07 00 03 BA 3A                 03 06 00 01 00 00 00 00 48 B4
        clear faults                  06 00 01 01 00 DC 6A                 =
        initialise                    06 00 02 00 01 EC 3A                 =
        stop                          06 00 10 00 01 4C 3F                 =
        mode: position                06 00 10 00 00 8D FF                 =
        the thumb's MCP to 30 deg     10 00 11 00 02 04 01 2C 64 64 27 71  10 00 11 00 02 14 3D
        touch on                      06 00 2B 01 00 FD A2                 =
        touch off                     06 00 2B 02 00 FD 52                 =
        zero                          06 00 2B 04 00 FE F2                 =
        read coils: no such function  01 00 00 00 01 F8 3A                 81 01 81 9F
        """,
        head="31",
        origin="gli-sdk/GHand-Python-SDK@3ebbadf; CRC by a second program",
    )
    facts = fact_table(f"""
        stated touch: resultants and taxels are in units of 0.1 N @ {_SDK} src/ghand/comm/ethercat_protocol.py:157
        stated touch: the taxels of each finger @ {_SDK} config/ghand5.json:25 (introduction.rst: 52)
        assumed touch: places: evenly spaced rows on pads of 12 x 18 mm, 25 mm apart; a push is positive; the resultant
            is the sum over the taxels
        assumed touch: every finger is valid and without error; touch is on after power-up; while it is off, no finger
            is valid and all values are 0
        stated identity: the unit of a left hand is 31, that of a right one 32 @ {_SDK} README.md:159
        stated identity: the hand's name is GHand 5: the driver opens no other @ {_SDK} src/ghand/ghand.py:254
        stated identity: firmware v1.0.0 @ {_SDK} src/ghand/ghand.py:465 (an example)
        assumed identity: the hardware version, the serial number and the motor driver's version
        stated configuration: 1 000 000 baud @ {_COMM}:73, README.md:134
        stated configuration: the commands of registers 0001, 0002, 0010, 0011 .. and 002B @ {_COMM}:323, 497, 541, 552
        stated configuration: a new unit takes effect at once @ {_COMM}:304
        stated configuration: the stops of the joints @ {_SDK} config/ghand5.json:4
        assumed configuration: a new unit is kept; faults never occur; initialising has no effect; joints without a
            motor stand at 0; torque and speed modes move nothing; other registers read 0; temperatures are 25 deg C
        assumed timing: 100 conversions a second; a speed of 100 % is 180 deg/s; commands take effect and are answered
            at once
    """, looked=_READ)  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["right", "left"], Option("which hand; sets the unit")] = "left",
        model: Annotated[str, Option("text in register 1000; at most 16 characters of ASCII")] = "GHand 5",
        firmware: Annotated[str, Option("text in register 1010; at most 16 characters of ASCII")] = "v1.0.0",
        serial: Annotated[int, Option("number in register 1018", low=0, high=2**128 - 1)] = 1,
    ):
        pads = [filled(count, *PAD_SIZE_M, name=name, link=name) for name, count in TAXELS.items()]
        self.layout = stack(*(place(pad, (k * FINGER_SPACING_M, 0.0, 0.0)) for k, pad in enumerate(pads)))
        self.inputs = Registers(INPUTS)
        for name, text in (("name", model), ("hardware", "v1.0.0"), ("firmware", firmware)):
            self.inputs[name] = text.encode("ascii")
        self.inputs["serial"] = serial.to_bytes(16, "big")
        self.inputs["side"] = 1 if side == "left" else 2
        self.holding = Registers(HOLDING, kept={"unit": UNITS[side], **self.flash})
        self.rtu = Rtu(counters=self.counters, gap_ns=silence_ns(BAUD))
        low, high = np.array([stops for stops in JOINTS.values() if stops], float).T
        speed = FULL_SPEED_DEG_PER_S
        self.motors = Motors(np.maximum(low, 0.0), low=low, high=high, time_constant_s=0.0, speed_limit=speed)
        self.present = self.zero = np.zeros((len(self.layout), 3))
        self.on = True

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return Fx, Fy, Fz of each taxel [0.1 N], a push positive, shape ``(162, 3)``."""
        super().measure(reading, t_ns)
        counts, fingers = self.counts * self.on, [patch.taxels for patch in self.layout.patches]
        forces = np.array([(self.present - self.zero)[taxels].sum(axis=0) for taxels in fingers]) * self.on
        sums = quantize(forces, COUNTS_PER_NEWTON, LOW_COUNTS, HIGH_COUNTS)
        self.inputs["resultant"] = np.stack([sums & 0xFF, 0 * sums], axis=-1).ravel()
        sent = self.layout.on_wire(counts & 0xFF)
        self.inputs["taxels"] = np.concatenate([_padded(sent[taxels].ravel()) for taxels in fingers])
        self.inputs["state"] = ALL_VALID * self.on
        return counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests, which arrive in chunks of any size."""
        self._report(t_ns)
        banks = Banks(inputs=self.inputs, holding=self, functions=(3, 4, 6, 16))
        return self.rtu.answers(data, t_ns, {self.holding["unit"]: banks})

    def _report(self, t_ns: int) -> None:
        """Update the registers of the joints."""
        moving, orders, joints = self.motors.moving(t_ns), self._orders(), np.zeros(len(JOINTS), JOINT_TYPE)
        joints["f0"][DRIVEN_JOINTS], joints["f3"][DRIVEN_JOINTS] = moving, np.where(moving, orders["speed"], 0)
        joints["f2"][DRIVEN_JOINTS] = np.rint(10 * self.motors.positions(t_ns))
        self.inputs["joints"] = joints.tobytes()
        self.inputs["running"] = moving.any()

    def _orders(self) -> np.ndarray:
        return np.frombuffer(bytes(self.holding.all("orders")), ORDER_TYPE)

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return holding registers."""
        return self.holding.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and execute its orders."""
        written = self.holding.write(address, data)
        self.flash.update(self.holding.kept())
        if self.holding["clear"]:
            self.holding["clear"], self.holding["cleared"] = 0, 1
        if "touch" in written:
            self._order_touch(self.holding["touch"])
        if self.holding["stop"]:
            self.motors.go(self.motors.positions(t_ns), t_ns)
        elif "orders" in written and self.holding["mode"] == 0:
            orders, first, end = self._orders(), max(address - 34, 0) // 4, (address + len(data) - 34 + 3) // 4
            self.motors.limit_speed(FULL_SPEED_DEG_PER_S * np.abs(orders["speed"]) / 100, t_ns)
            self.motors.go(orders["angle"][first:end] / 10, t_ns, at=slice(first, end))
        self.holding.reset("stop", "initialise", "touch")
        return written

    def _order_touch(self, order: int) -> None:
        if order == TOUCH_ZERO:
            self.zero = self.present
        elif order in (TOUCH_ON, TOUCH_OFF):
            self.on = order == TOUCH_ON

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angles of the joints that have a motor [rad], by name."""
        return dict(zip([list(JOINTS)[k] for k in DRIVEN_JOINTS], np.deg2rad(self.motors.positions(t_ns)).tolist()))


def _padded(data: np.ndarray) -> np.ndarray:
    """Return ``data``, padded with a byte 0 to complete its last register."""
    return np.append(data, [0] * (len(data) % 2))
