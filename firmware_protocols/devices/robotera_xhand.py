r"""RobotEra XHand 1: twelve joints, and five fingertips of 120 points that measure along three axes.

Wire: RS-485, 3 000 000 8N1. The host is FE, a hand 80 + its id, FF all; each command gets one answer with its number,
from the hand itself.

    command         data                   answer
    02    move      twelve orders          the state: twelve joints, then five fingertips, 2208 bytes
    05    save      -                      10 00
    12    zero      -, to tip 11 .. 15     none
    13    version   -                      <u2 patch, u1 minor, u1 major
    14    restart   -                      none
    15    read      <u2 register, <u2 n    <u2 register, n bytes
    16    write     <u2 register, bytes    10 00
    17    calibrate 48 bytes               00

Registers are bytes: side, serial number, id, name and the joints' calibration. Command 05 keeps what was written; a new
id is in force at once. A version is that of a joint (sent to 0 .. B), of a tip (to 11 .. 15), or of the palm.

A message with a bad CRC gets no answer. A request and its answer take 8.4 ms on the line, so that a driver reads 118
states a second at most. Points and fingers come one after another, x, y, z of each. The vendor's library has z
unsigned; a public Python class has it signed (option ``z``). In that class the function that cuts an answer uses other
sizes (22 and 366 bytes) than its record formats (24 and 384), and one example writes the head as AA 55: neither is in
the hand's protocol.

Try it: ``tactemu run robotera_xhand``, then send the version request ``55 AA FE 80 13 00 00 EF C3`` at 3000000.
"""

import struct
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Counts, Device, Frame, Motors, Option, Packets, Reading, RegisterMap, Registers, Request, Restart, Rs485, Sense,
    Transmissions, command, command_table, fact_table, filled, on_fingers, points, quantize, xyz,
)  # fmt: skip

MESSAGE = Frame("""
    message, either direction
    0     55 AA                head
    2     u1                   source
    3     u1                   target
    4     u1                   command
    5     <u2                  length = len(data)
    7     bytes                data
    last  <crc16_xmodem        crc
""")
JOINT = Frame("""
    joint, twelve of them begin a state
    0     u1                   number
    1     00                   sensor
    2     <f4                  position     [rad]
    6     00 00                torque
    8     00 00                raw          position
    10    <u2                  temperature  [deg C]
    12    00 00 00 00 00 00    errors       of three boards
    18    00 00 00 00 00 00    spare
""")
TIP = Frame("""
    fingertip, five of them end a state; points row by row
    0     u1 x 3               force        of the tip: x, y, z
    3     u1 x taxels x 3      points       x, y, z of each; x and y are signed
    ..    u1 x 21              temperatures  [deg C]: of twenty places, then of the tip
""")
JOINT_ORDER = struct.Struct("<HhhhfHH8x")
"""One of the twelve orders of a move: number, gains p, i, d, position [rad], torque limit, mode, spare."""
MAP = RegisterMap(
    """
    20   u1        side       r              L or R, ASCII
    21   u1 x 32   serial     r              ASCII
    53   u1        id         0..126  flash
    54   u1 x 32   name       flash          ASCII
    86   u1 x 96   places     flash          joints' calibration: stretched, closed, zero, init, 12 x <i2 each
    182  i1 x 12   low        = 0, -60, -10, -10, 0, 0, 0, 0, 0, 0, 0, 0  flash                     [deg]
    194  i1 x 12   high       = 105, 90, 105, 10, 110, 110, 110, 110, 110, 110, 110, 110  flash     [deg]
    """,
    size=512,
)
BROADCAST = 0xFF
FIRST_HAND = 0x80
FIRST_TIP = 0x11
DONE = b"\x10\0"
JOINTS = 12
N_TIPS = 5
POINTS_PER_TIP = 120
POSITION_MODE = 3
JOINT_VERSION = b"\x07\0\0\x01"
RESTART_NS = 500_000_000
TIPS = on_fingers(points({"tip": (0.0, 0.0, 0.0)}))


_SDK = "yoimika/xhand_control_python@b61a82d xhand_control_sdk_py"
_EXAMPLE = "yoimika/xhand_control_python@b61a82d xhand_control_example.py"
_READ = "the SDK's headers, tests and library; wrs xhand_x.py, data_type.py"


class RoboteraXhand(Device):
    """An XHand on RS-485."""

    name = "robotera_xhand"
    kind = "hand"
    title = "RobotEra XHand 1, five tips of 120 points"
    ports = (Rs485(baud=3_000_000),)
    senses = ("force", Sense("temperature", at=TIPS))
    rate_hz = 118.0
    evidence = ("driver",)
    sources = (
        f"{_SDK} include/communiation_interface.hpp, data_type.hpp, lib/libxhand_control.so 1.2.10 (the vendor's own)",
        "wanweiwei07/wrs@552ce47 wrs/robot_con/xhand/xhand_x.py, data_type.py",
    )
    documented = command_table(
        f"""
        @ xhand_x.py, data_type.py
        state                 FE 80 02 20 01 {"00" * 288} 05 FD          80 FE 02 A0 08 ..{{2208}} ..{{2}}
        @ as the vendor's library 1.2.10 sends it, and takes the answer
        save                  FE 80 05 00 00 2C 32                       80 FE 05 02 00 10 00 D4 1B
        zero the thumb's tip  FE 11 12 00 00 F4 44
        ? version             FE 80 13 00 00 EF C3                       80 FE 13 04 00 03 00 01 01 A4 EC
        ? version of joint 0  FE 00 13 00 00 D7 1E                       80 FE 13 04 00 07 00 00 01 64 15
        ? search              FE FF 15 04 00 14 00 BA 00 A2 4A           80 FE 15 BC 00 14 00 52 ..{{185}} ..{{2}}
        ? side                FE 80 15 04 00 14 00 01 00 9B E1           80 FE 15 03 00 14 00 52 F8 61
        name xhand            FE 80 16 07 00 36 00 78 68 61 6E 64 39 00  80 FE 16 02 00 10 00 5C F1
        @ CRC by crcmod
        no such register      FE 80 15 04 00 00 02 01 00 6F E6
        """,
        head="55 AA",
    )
    judge = "yoimika/xhand_control_python@b61a82d (RobotEra's libxhand_control.so 1.2.10), wanweiwei07/wrs@552ce47"
    facts = fact_table(f"""
        stated touch: x and y of a point are int8, z is uint8 @ {_SDK} include/data_type.hpp:62
        assumed touch: 10 counts/N; the force of a tip is the sum over its points; thumb first @ {_READ}
        assumed touch: places: 120 points in evenly spaced rows on flat pads of 16 x 20 mm, with normal +z @ {_READ}
        assumed touch: each fingertip has one temperature, which its last byte and all its other temperature bytes show
            @ {_READ}
        stated identity: side, serial number, id, name and calibration are the registers 20, 21, 53, 54 and 86 @ {_SDK}
            include/communiation_interface.hpp:54
        stated identity: a version is <u2 patch, u1 minor, u1 major; a broadcast of command 15 with 186 bytes finds the
            hand @ {_SDK} lib/libxhand_control.so 1.2.10 takes this alone
        stated identity: the firmware versions palm 1.1.3 and joints 1.0.7 are of 2024 @ {_SDK}
            tests/src/serial_test.cpp:225
        stated identity: a serial number has 16 characters @ {_EXAMPLE}:71
        assumed identity: fingertips have the version of the joints; the letters of the serial number @ {_READ}
        stated configuration: the answers: 10 00 to 16 and 05, 00 to 17, none to 12; a new id takes effect at once @
            {_SDK} lib/libxhand_control.so 1.2.10 takes this alone
        stated configuration: the stops of the joints [deg] @ {_SDK} tests/src/serial_test.cpp:184
        assumed configuration: a calibration is stored without effect; command 12 to the hand itself resets all
            fingertips @ {_READ}
        assumed configuration: a joint with a gain p of 0, or in a mode other than 3, does not move; torque and errors
            are 0, temperatures 25 deg C @ {_READ}
        assumed configuration: a wrong length, command, register or target gets no answer @ {_READ}
        assumed timing: the hand answers at once; joints move at 5 rad/s; a restart takes 0.5 s @ {_READ}
    """)

    def __init__(
        self,
        *,
        counts_per_newton: Annotated[float, Option("scale of each axis of a point", unit="1/N")] = 10.0,
        z: Annotated[Literal["unsigned", "signed"], Option("z of a point: 0..255 or -128..127")] = "unsigned",
        side: Annotated[Literal["right", "left"], Option("which hand; R or L in register 20")] = "right",
        hand_id: Annotated[int, Option("id as delivered; register 53 holds it", low=0, high=126)] = 0,
        serial: Annotated[str, Option("serial number of at most 32 characters of ASCII")] = "XH1R000000000001",
        version: Annotated[str, Option("version of the palm: major.minor.patch")] = "1.1.3",
    ):
        major, minor, patch = (int(number) for number in version.split("."))
        self.version = struct.pack("<HBB", patch, minor, major)
        limits = {"low": [-128, -128, -128 if z == "signed" else 0], "high": [127, 127, 127 if z == "signed" else 255]}
        self.columns = xyz("x y z", assumed_per_unit=counts_per_newton, push=1, **limits)
        self.layout = on_fingers(filled(POINTS_PER_TIP, 0.016, 0.02, name="tip"))
        self.present = self.zero = np.zeros((len(self.layout), 3))
        self.tip = TIP.bind(taxels=POINTS_PER_TIP)
        self.packets = Packets(MESSAGE, by="command", counters=self.counters, gap_ns=50_000_000)
        delivered = {"side": ord(side[0].upper()), "serial": serial.encode("ascii"), "id": hand_id}
        self.registers = Registers(MAP, kept={**delivered, **self.flash})
        low, high = (np.deg2rad(self.registers.all(name)) for name in ("low", "high"))
        self.motors = Motors(np.zeros(JOINTS), low=low, high=high, time_constant_s=0.0, speed_limit=5.0)
        self.counts = np.zeros((len(self.layout), 3), np.int64)
        self.tips, self.warmth = np.zeros((N_TIPS, 3), np.int64), np.full(N_TIPS, 25)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return raw counts of each point, x and y -128..127, z 0..255, shape ``(600, 3)``."""
        self.counts = super().measure(reading, t_ns)["force"]
        forces = (self.present - self.zero).reshape(N_TIPS, POINTS_PER_TIP, 3).sum(1)
        low, high = ([getattr(column, limit) for column in self.columns] for limit in ("low", "high"))
        self.tips = quantize(forces, self.columns[0].scale or 0.0, np.array(low), np.array(high))
        self.warmth = quantize(reading["temperature"], 1.0, 0, 255)
        return self.counts

    @command(on=0x02, data="288s")
    def move(self, request: Request):
        """Go where the orders say, and return the state."""
        goals = np.full(JOINTS, np.nan)
        for number, gain, _, _, position, _, mode in JOINT_ORDER.iter_unpack(request.data):
            if number < JOINTS and gain > 0 and mode == POSITION_MODE and np.isfinite(position):
                goals[number] = position
        self.motors.go(goals, request.t_ns)
        return self._state(request.t_ns)

    @command(on=0x05, data="")
    def save(self, request: Request):
        """Keep what was written."""
        self.flash.update(self.registers.kept())
        return DONE

    @command(on=0x12, data="")
    def set_zero(self, request: Request):
        """Make the present forces on one tip, or on all, the zero."""
        zero = self.zero.copy().reshape(N_TIPS, POINTS_PER_TIP, 3)
        tips = [request.target - FIRST_TIP] if request.target < FIRST_HAND else slice(None)
        zero[tips] = self.present.reshape(zero.shape)[tips]
        self.zero = zero.reshape(self.present.shape)
        return ()

    @command(on=0x13, data="")
    def version_of(self, request: Request):
        """Return the version of a joint, or of the palm."""
        return JOINT_VERSION if request.target < FIRST_HAND else self.version

    @command(on=0x14, data="")
    def restart(self, request: Request):
        """Restart the hand."""
        return [Restart(RESTART_NS)]

    @command(on=0x15, data="<HH")
    def read_registers(self, request: Request):
        """Return registers."""
        return request.data[:2] + self.registers.read(*request.values)

    @command(on=0x16, data="*")
    def write_registers(self, request: Request):
        """Store registers."""
        self.registers.write(int.from_bytes(request.data[:2], "little"), request.data[2:])
        return DONE

    @command(on=0x17, data="48s")
    def calibrate(self, request: Request):
        """Answer, without effect."""
        return b"\0"

    def accepts(self, request: Request) -> bool:
        """Return True for a request to this hand; zeros and versions also to a joint or a tip."""
        parts = (*range(JOINTS), *range(FIRST_TIP, FIRST_TIP + N_TIPS)) if request.command in (0x12, 0x13) else ()
        request.own = FIRST_HAND + self.registers["id"]  # a new id is in force for the next request
        return request.target in (request.own, BROADCAST, *parts)

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the answer, from the hand itself."""
        return [MESSAGE.pack(source=request.own, target=request.source, command=request.command, data=content)]

    def _state(self, t_ns: int) -> bytes:
        positions = self.motors.positions(t_ns).astype(np.float32)
        joints = JOINT.pack_many(JOINTS, number=np.arange(JOINTS), position=positions, temperature=25)
        wire = self.layout.on_wire(self.counts & 0xFF).reshape(N_TIPS, POINTS_PER_TIP, 3)
        warm = np.repeat(self.warmth[:, None], 21, axis=1)
        return b"".join(joints + self.tip.pack_many(N_TIPS, force=self.tips & 0xFF, points=wire, temperatures=warm))

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angles of the joints [rad], by name."""
        return {f"joint {k}": position for k, position in enumerate(self.motors.positions(t_ns).tolist())}
