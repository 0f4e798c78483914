"""OnRobot RG2-FT: a gripper with a force-torque and a proximity sensor in each fingertip, behind a Compute Box.

Wire: Modbus TCP, port 502, unit 65; the Modbus address of a register is half of its address in ``MAP``. Functions 3, 6
and 16. Drivers write zero, force, width and control, then read 5..6, 257..282 and 0 in every cycle. Registers 257, 266,
274 and 277 are the status of the sensors, 0.

A grip begins when control becomes 1 and ends at the width, or where the fingers meet the force; until then the gripper
is busy and ignores control, but for 0 and 8, which stop it.

Evidence: a laboratory's ROS 2 driver and its message files; a recorder that agrees with it.

Try it: ``tactemu run onrobot_rg2_ft``, then read holding registers 257 to 282 of unit 65.
"""

from collections.abc import Sequence

import numpy as np

from firmware_protocols import (
    Device, Layout, Motors, RegisterMap, Registers, Sense, Tcp, Transmissions, command_table, fact_table, modbus,
    points, stack, wrench,
)  # fmt: skip

MAP = RegisterMap("""
    0    >u2      zero          0..1                1: force and torque at that time become 0; 0: as they are
    4    >u2      force         0..400              [0.1 N]
    6    >u2      width         0..1000             [0.1 mm], between the fingers
    8    >u2      control       0..8                1 grip, 0 and 8 stop
    10   >u2 x 2  offsets                           of the proximity, left and right [0.1 mm]
    518  >i2 x 6  wrench_left             r         Fx Fy Fz [0.1 N], Tx Ty Tz [0.01 Nm]
    536  >i2 x 6  wrench_right            r
    550  >i2      near_left     = 300     r         proximity, less the offset [0.1 mm]
    556  >i2      near_right    = 300     r
    560  >i2      opening       = 1000    r         [0.1 mm]
    562  >u2      busy          0..1      r
    564  >u2      grip          0..1      r         detected
""")
UNIT, GRIP, STOPS = 65, 1, (0, 8)
NEAR = 300
"""The proximity without offset [0.1 mm]."""
SPEED = 1000.0
"""The speed of a grip [0.1 mm/s]."""
DRIVER = "fraunhoferhhi/Ros2-OnRobot-RG2-FT@e5fc87b"
COM, BASE = (f"{DRIVER} onrobot_rg_control/onrobot_rg_control/{name}.py" for name in ("comModbusTcp", "baseOnRobotRG"))
MESSAGES = f"{DRIVER} onrobot_rg_msgs/msg"
ALL = "onrobot_rg_control, onrobot_rg_msgs, README.md (all files)"


def in_fingers(y: float, z: float) -> Layout:
    """Return a point in each finger [m], 60 mm apart."""
    return stack(*(points({side: (x, y, z)}, link=side) for side, x in (("left", -0.03), ("right", 0.03))))


class OnrobotRg2Ft(Device):
    """A gripper with two fingers."""

    name = "onrobot_rg2_ft"
    title = "OnRobot RG2-FT gripper with force-torque fingertips"
    kind = "hand"
    ports = (Tcp(port=502),)
    senses = (Sense("wrench", at=in_fingers(0, 0)),)
    columns = wrench("Fx Fy Fz Tx Ty Tz", per_unit=(10, 100), low=-0x8000, high=0x7FFF)
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (f"{COM} (registers)", f"{BASE} (their order)", f"{MESSAGES} (units, meaning)")
    judge = DRIVER
    documented = command_table(
        """
        ? offsets       00 06 41 03 00 05 00 02     00 07 41 03 04 00 00 00 00
        ? fingers       00 06 41 03 01 01 00 1A     00 37 41 03 34 ..{52}
        ? zero          00 06 41 03 00 00 00 01     00 05 41 03 02 00 00
        no zero         00 06 41 06 00 00 00 00     =
        force 20 N      00 06 41 06 00 02 00 C8     =
        width 50 mm     00 06 41 06 00 03 01 F4     =
        grip            00 06 41 06 00 04 00 01     =
        stop            00 06 41 06 00 04 00 08     =
        left offset     00 06 41 06 00 05 00 E6     =
        too wide        00 06 41 06 00 03 03 E9     00 03 41 86 03
        """,
        head="00 01 00 00",
        origin=f"{COM}:56-113, packed by the Modbus specification",
    )
    facts = fact_table(f"""
        stated touch: forces are in 0.1 N and torques in 0.01 Nm, in two's complement @
            {MESSAGES}/OnRobotRGInput.msg:42-62
        stated touch: the registers of both fingers @ {BASE}:99-134, {COM}:101-113
        assumed touch: a pad is touched 12 mm above and 20 mm beside the origin of its sensor; z points out of the pad @
            {ALL}
        assumed touch: the proximity is 30 mm minus its offset, whatever is near; its status is 0 @ {ALL}
        stated configuration: the limits of force and width @ {BASE}:34-51
        stated configuration: command 1 grips, 8 stops; the driver stops with 0; a busy gripper ignores commands @
            {MESSAGES}/OnRobotRGOutput.msg; {BASE}:53-57
        stated configuration: register zero: 1 keeps the zero until 0 is written @ {MESSAGES}/OnRobotRGOutput.msg:24-27
        assumed configuration: the gripper is open after power-up and moves at 100 mm/s; it detects a grip when the mean
            push on the pads reaches the target force; registers between the modelled ones read 0; other functions are
            refused @ {ALL}
        stated timing: unit 65 @ {COM}:56-113
        assumed timing: 100 conversions a second; requests are answered at once @ {ALL}
    """)

    def __init__(self):
        self.layout = in_fingers(0.02, 0.012)
        self.registers = Registers(MAP)
        self.clients: dict[str, modbus.Mbap] = {}
        self.motors = Motors(
            [1000.0], low=0, high=1000, time_constant_s=0, speed_limit=SPEED, names=("opening",), unit=1e-4
        )

    def filtered(self, values: np.ndarray, t_ns: int) -> np.ndarray:
        """Return the values; the fingers stop where the push is the force."""
        self.motors.apply_loads(-values[:, 2].mean(), max(self.registers["force"] / 10, 0.1), t_ns)
        return values

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer Modbus requests of any client."""
        client = self.clients.setdefault(port, modbus.Mbap(counters=self.counters))
        return client.answers(data, t_ns, {UNIT: modbus.Banks(holding=self, functions=(3, 6, 16))})

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Drop the incomplete request of a client that comes or goes."""
        self.clients.pop(port, None)
        return ()

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return the registers as they are now."""
        self.registers["wrench_left"], self.registers["wrench_right"] = self.layout.on_wire(self.counts)
        for side, offset in zip(("left", "right"), self.registers.all("offsets")):
            self.registers[f"near_{side}"] = NEAR - offset
        self.registers["opening"] = self.motors.positions(t_ns)
        self.registers["busy"], self.registers["grip"] = self.motors.moving(t_ns), self.motors.stalled
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store the registers; zero, grip or stop."""
        written = self.registers.write(address, data)
        if "zero" in written:
            self.zero = self.present if self.registers["zero"] else 0.0
        if "control" in written:
            if self.registers["control"] in STOPS:
                self.motors.hold(t_ns)
            elif self.registers["control"] == GRIP and not self.motors.moving(t_ns).any():
                self.motors.go(self.registers["width"], t_ns)
        return written
