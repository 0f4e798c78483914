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

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    MORE, SOUND, Axis, Column, Command, Counts, Device, Frame, Motors, Option, Packets, Reading, Refused, RegisterMap,
    Registers, Restart, Rs485, Sense, Transmissions, fact_table, filled, place, points, quantize, stack,
)  # fmt: skip
from firmware_protocols.sums import crc16_xmodem

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
ZERO_COMMAND = 0x12
VERSION_COMMAND = 0x13
RESTART_COMMAND = 0x14
BROADCAST = 0xFF
FIRST_HAND = 0x80
FIRST_TIP = 0x11
DONE = b"\x10\0"
JOINTS = 12
POINTS_PER_TIP = 120
POSITION_MODE = 3
AXES: tuple[Axis, ...] = ("x", "y", "z")
JOINT_VERSION = b"\x07\0\0\x01"
RESTART_NS = 500_000_000
FINGERTIP_CENTRES_M = {
    # name: centre of the pad in the palm's frame [m]
    "thumb": (0.06, 0.03, 0.0), "index": (0.033, 0.09, 0.0), "middle": (0.011, 0.1, 0.0),
    "ring": (-0.011, 0.095, 0.0), "little": (-0.033, 0.08, 0.0),
}  # fmt: skip
TIPS = stack(*(points({name: base}, link=name) for name, base in FINGERTIP_CENTRES_M.items()))


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
    judge = "yoimika/xhand_control_python@b61a82d (RobotEra's libxhand_control.so 1.2.10), wanweiwei07/wrs@552ce47"
    facts = fact_table(f"""
        stated touch: x and y of a point are int8, z is uint8 @ {_SDK} include/data_type.hpp:62
        assumed touch: 10 counts/N; the force of a tip is the sum over its points; thumb first @ {_READ}
        assumed touch: places: 120 points in even rows on flat pads of 16 x 20 mm, normal +z @ {_READ}
        assumed touch: one temperature for a tip, which its last byte and all others show @ {_READ}
        stated identity: side, serial number, id, name and calibration are registers 20, 21, 53, 54, 86 @ {_SDK}
            include/communiation_interface.hpp:54
        stated identity: a version is <u2 patch, u1 minor, u1 major; a broadcast 15 of 186 bytes finds the hand @ {_SDK}
            lib/libxhand_control.so 1.2.10 takes this alone
        stated identity: palm 1.1.3 and joints 1.0.7 are firmwares of 2024 @ {_SDK} tests/src/serial_test.cpp:225
        stated identity: a serial number has 16 characters @ {_EXAMPLE}:71
        assumed identity: tips have the joints' version; the serial number's letters @ {_READ}
        stated configuration: 10 00 answers 16 and 05, 00 answers 17, nothing 12; a new id is in force at once @ {_SDK}
            lib/libxhand_control.so 1.2.10 takes this alone
        stated configuration: the joints' stops [deg] @ {_SDK} tests/src/serial_test.cpp:184
        assumed configuration: calibration is stored, without effect; 12 to the hand itself is for all tips @ {_READ}
        assumed configuration: a joint without gain p, or in another mode than 3, stays; torque, errors 0; 25 deg C @
            {_READ}
        assumed configuration: another length, command, register or target is not answered @ {_READ}
        assumed timing: answers at once; joints move 5 rad/s; a restart takes 0.5 s @ {_READ}
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
        self.counts_per_newton = counts_per_newton
        major, minor, patch = (int(number) for number in version.split("."))
        self.version = struct.pack("<HBB", patch, minor, major)
        self.low, self.high = np.array([-128, -128, 0]), np.array([127, 127, 255])
        if z == "signed":
            self.low[2], self.high[2] = -128, 127
        self.columns = tuple(
            Column(name=axis, axis=axis, low=low, high=high, push=1 if axis == "z" else 0)
            for axis, low, high in zip(AXES, self.low.tolist(), self.high.tolist())
        )
        self.layout = stack(
            *(
                place(filled(POINTS_PER_TIP, 0.016, 0.02, name=name, link=name), base)
                for name, base in FINGERTIP_CENTRES_M.items()
            )
        )
        self.tip = TIP.bind(taxels=POINTS_PER_TIP)
        self.packets = Packets(MESSAGE.head, _size, _check, counters=self.counters, gap_ns=50_000_000)
        kept = {"id": hand_id, **self.flash}
        self.registers = Registers(MAP, kept={"side": ord(side[0].upper()), "serial": _text(serial), **kept})
        low, high = (np.deg2rad(self.registers.all(name)) for name in ("low", "high"))
        self.motors = Motors(np.zeros(JOINTS), low=low, high=high, time_constant_s=0.0, speed_limit=5.0)
        self.counts = np.zeros((len(self.layout), 3), np.int64)
        self.felt = self.zero = np.zeros((len(self.layout), 3))
        self.tips, self.warmth = (
            np.zeros((len(FINGERTIP_CENTRES_M), 3), np.int64),
            np.full(len(FINGERTIP_CENTRES_M), 25),
        )

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return raw counts of each point, x and y -128..127, z 0..255, shape ``(600, 3)``."""
        self.felt = self.layout.to_taxel_frame(reading["force"]) * [1, 1, -1]
        forces = self.felt - self.zero
        self.counts = self._counts(forces)
        self.tips = self._counts(forces.reshape(len(FINGERTIP_CENTRES_M), POINTS_PER_TIP, 3).sum(1))
        self.warmth = quantize(reading["temperature"], 1.0, 0, 255)
        return self.counts

    def _counts(self, forces: np.ndarray) -> np.ndarray:
        return np.clip(quantize(forces, self.counts_per_newton, -128, 255), self.low, self.high)

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer messages, which arrive in chunks of any size."""
        return [answer for packet in self.packets.cut(data, t_ns) for answer in self._answer(packet, t_ns)]

    def _answer(self, packet: bytes, t_ns: int) -> list[bytes | Restart]:
        source, target, command, data = packet[2], packet[3], packet[4], packet[7:-2]
        own = FIRST_HAND + self.registers["id"]
        part = target in range(JOINTS) or target in range(FIRST_TIP, FIRST_TIP + len(FINGERTIP_CENTRES_M))
        if target not in (own, BROADCAST) and not (part and command in (VERSION_COMMAND, ZERO_COMMAND)):
            self.counters["other_address"] += 1
            return []
        if command == RESTART_COMMAND and not data:
            return [Restart(RESTART_NS)]
        reply = self._obey(command, data, target, t_ns)
        if reply is None:
            self.counters["unknown_command"] += 1
        return [MESSAGE.pack(source=own, target=source, command=command, data=reply)] if reply else []

    def _obey(self, command: int, data: bytes, target: int, t_ns: int) -> bytes | None:
        """Return the data of the answer, empty for no answer, or None if the command is unknown."""
        try:
            match command, len(data):
                case (0x02, 288):
                    self._move(data, t_ns)
                    return self._state(t_ns)
                case (0x05, 0):
                    self.flash.update(self.registers.kept())
                    return DONE
                case (0x12, 0):
                    self._set_zero(target)
                    return b""
                case (0x13, 0):
                    return JOINT_VERSION if target < FIRST_HAND else self.version
                case (0x15, 4):
                    address, n = struct.unpack("<HH", data)
                    return data[:2] + self.registers.read(address, n)
                case (0x16, n) if n > 2:
                    self.registers.write(int.from_bytes(data[:2], "little"), data[2:])
                    return DONE
                case (0x17, 48):
                    return b"\0"
        except Refused:
            self.counters["refused"] += 1
            return b""
        return None

    def _set_zero(self, target: int) -> None:
        """Make the present forces on one tip, or on all, the zero."""
        zero = self.zero.copy().reshape(len(FINGERTIP_CENTRES_M), POINTS_PER_TIP, 3)
        tips = [target - FIRST_TIP] if target < FIRST_HAND else slice(None)
        zero[tips] = self.felt.reshape(zero.shape)[tips]
        self.zero = zero.reshape(self.felt.shape)

    def _move(self, data: bytes, t_ns: int) -> None:
        goals = np.full(JOINTS, np.nan)
        for number, gain, _, _, position, _, mode in JOINT_ORDER.iter_unpack(data):
            if number < JOINTS and gain > 0 and mode == POSITION_MODE and np.isfinite(position):
                goals[number] = position
        self.motors.go(goals, t_ns)

    def _state(self, t_ns: int) -> bytes:
        positions = self.motors.positions(t_ns).astype(np.float32)
        joints = JOINT.pack_many(JOINTS, number=np.arange(JOINTS), position=positions, temperature=25)
        wire = self.layout.on_wire(self.counts & 0xFF).reshape(len(FINGERTIP_CENTRES_M), POINTS_PER_TIP, 3)
        warm = np.repeat(self.warmth[:, None], 21, axis=1)
        return b"".join(
            joints
            + self.tip.pack_many(len(FINGERTIP_CENTRES_M), force=self.tips & 0xFF, points=wire, temperatures=warm)
        )

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Return the angles of the joints [rad], by name."""
        return {f"joint {k}": position for k, position in enumerate(self.motors.positions(t_ns).tolist())}

    @property
    def commands(self) -> tuple[Command, ...]:
        """Each command, to a hand with default options; the move has no gains, so that it orders nothing."""
        if self.registers["id"] or self.options:
            return ()
        done = "10 00"
        return (
            Command(
                name="version", request="55 AA FE 80 13 00 00 EF C3", reply="55 AA 80 FE 13 04 00 03 00 01 01 A4 EC",
                origin=_SENT, safe=True,
            ),
            Command(
                name="version of joint 0", request="55 AA FE 00 13 00 00 D7 1E",
                reply="55 AA 80 FE 13 04 00 07 00 00 01 64 15", origin=_SENT, safe=True,
            ),
            Command(name="state", request=_STILL, reply="55 AA 80 FE 02 A0 08 ..{2208} ..{2}", origin=_RECORDS),
            Command(
                name="search", request="55 AA FE FF 15 04 00 14 00 BA 00 A2 4A",
                reply="55 AA 80 FE 15 BC 00 14 00 52 ..{185} ..{2}", origin=_SENT, safe=True,
            ),
            Command(
                name="side", request="55 AA FE 80 15 04 00 14 00 01 00 9B E1",
                reply="55 AA 80 FE 15 03 00 14 00 52 F8 61", origin=_SENT, safe=True,
            ),
            Command(
                name="name xhand", request="55 AA FE 80 16 07 00 36 00 78 68 61 6E 64 39 00",
                reply=f"55 AA 80 FE 16 02 00 {done} 5C F1", origin=_SENT,
            ),
            Command(
                name="save", request="55 AA FE 80 05 00 00 2C 32", reply=f"55 AA 80 FE 05 02 00 {done} D4 1B",
                origin=_SENT,
            ),
            Command(name="zero the thumb's tip", request="55 AA FE 11 12 00 00 F4 44", origin=_SENT),
            Command(name="no such register", request="55 AA FE 80 15 04 00 00 02 01 00 6F E6", origin="CRC by crcmod"),
        )  # fmt: skip


_SENT = "as the vendor's library 1.2.10 sends it, and takes the answer"
_RECORDS = "xhand_x.py, data_type.py (ORDER of its records)"
_STILL = "55 AA FE 80 02 20 01" + "00" * 288 + "05 FD"


def _text(text: str) -> np.ndarray:
    return np.frombuffer(text.encode("ascii")[:32].ljust(32, b"\0"), np.uint8)


def _size(data: bytes) -> int:
    return 9 + int.from_bytes(data[5:7], "little") if len(data) > 6 else MORE


def _check(packet: bytes) -> str:
    return SOUND if crc16_xmodem(packet[:-2]) == int.from_bytes(packet[-2:], "little") else "bad_checksum"
