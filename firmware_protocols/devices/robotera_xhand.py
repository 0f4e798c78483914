r"""RobotEra XHand 1: twelve joints, and five fingertips of 120 points that feel in three axes.

Wire: RS-485, 3 000 000 8N1. The host is FE, the hand 80; each command is answered once, with the command's number.

    13    version     no data
    02    move        twelve orders; the answer is the state: twelve joints, then five fingertips, 2208 bytes

A bad CRC is dropped without a word. An answer with its request takes 8.4 ms on the line, so that nobody reads more
than 118 states a second. Points and fingers come one after another, x, y, z of each. In its public driver the function
that cuts an answer uses other sizes (22 and 366 bytes) than its record formats (24 and 384), and one example writes the
head as AA 55: neither is what a hand says or hears.

Try it: ``tactemu run robotera_xhand``, then send the version request ``55 AA FE 80 13 00 00 EF C3`` at 3000000.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Annotated

import numpy as np

from firmware_protocols import Column, Command, Counts, Device, Option, Outs, Reading, Rs485, Sense, points
from firmware_protocols.adc import quantize
from firmware_protocols.framing import MORE, SOUND, Packets
from firmware_protocols.layouts import filled, place, stack
from firmware_protocols.motors import Motors
from firmware_protocols.sums import crc16_xmodem
from firmware_protocols.tables import Frame

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
    0     i1 x 3               force        of the tip: x, y, z
    3     i1 x taxels x 3      points       x, y, z of each
    ..    u1 x 20              temperatures  [deg C]
    ..    00                   more
""")
ORDER = struct.Struct("<HhhhfHH8x")
"""Number, gains p, i, d, position [rad], limit of the torque, mode, spare: twelve of them are the data of a move."""
HOST, HAND, MOVE, VERSION = 0xFE, 0x80, 0x02, 0x13
JOINTS, POINTS, POSITION = 12, 120, 3
FINGERS = {
    # name: centre of the pad in the palm's frame [m]
    "thumb": (0.06, 0.03, 0.0), "index": (0.033, 0.09, 0.0), "middle": (0.011, 0.1, 0.0),
    "ring": (-0.011, 0.095, 0.0), "little": (-0.033, 0.08, 0.0),
}  # fmt: skip
TIPS = stack(*(points({name: base}, link=name) for name, base in FINGERS.items()))


class RoboteraXhand(Device):
    """The hand on RS-485."""

    name = "robotera_xhand"
    kind = "hand"
    title = "RobotEra XHand 1, five tips of 120 points"
    ports = (Rs485(baud=3_000_000),)
    senses = ("force", Sense("temperature", at=TIPS))
    rate_hz = 118.0
    columns = (
        Column(name="x", axis="x", low=-128, high=127),
        Column(name="y", axis="y", low=-128, high=127),
        Column(name="z", axis="z", low=-128, high=127, push=1),
    )
    evidence = ("driver",)
    sources = (
        "wanweiwei07/wrs@552ce47 wrs/robot_con/xhand/xhand_x.py, data_type.py",
        "a later public version of xhand_x.py (a live hand answers with 12 x 24 + 5 x 384 bytes)",
    )
    judge = "own second reader"
    assumed = (
        "10 counts/N along x, y and into the skin; the force of a tip is the sum over its points",
        "places: 120 points in even rows on flat pads of 16 x 20 mm, thumb first, normal +z",
        "positions in rad; 5 rad/s, stops at -3 and 3 rad; a joint without gain p, or in another mode than 3, stays",
        "torque and raw position 0; one temperature for a tip and 25 deg C for joints; sensor byte and last byte 0",
        "the version's text; answers at once; another length, command or target is not answered",
    )

    def __init__(
        self,
        *,
        counts_per_newton: Annotated[float, Option("of each axis of a point", unit="1/N")] = 10.0,
        version: Annotated[str, Option("the data of the answer to 13, ASCII")] = "1.2.3",
    ):
        self.counts_per_newton, self.version = counts_per_newton, version.encode("ascii")
        self.layout = stack(
            *(place(filled(POINTS, 0.016, 0.02, name=name, link=name), base) for name, base in FINGERS.items())
        )
        self.tip = TIP.bind(taxels=POINTS)
        self.packets = Packets(MESSAGE.head, _size, _check, counters=self.counters, gap_ns=50_000_000)
        self.motors = Motors(np.zeros(JOINTS), low=-3.0, high=3.0, time_constant_s=0.0, speed_limit=5.0)
        self.counts = np.zeros((len(self.layout), 3), np.int64)
        self.tips, self.warmth = np.zeros((len(FINGERS), 3), np.int64), np.full(len(FINGERS), 25)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """x, y, z of each point in raw counts -128..127, shape ``(600, 3)``."""
        felt = self.layout.to_taxel_frame(reading["force"]) * [1, 1, -1]
        self.counts = quantize(felt, self.counts_per_newton, -128, 127)
        self.tips = quantize(felt.reshape(len(FINGERS), POINTS, 3).sum(1), self.counts_per_newton, -128, 127)
        self.warmth = quantize(reading["temperature"], 1.0, 0, 255)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Messages in chunks of any size."""
        return [answer for packet in self.packets.cut(data, t_ns) for answer in self._answer(packet, t_ns)]

    def _answer(self, packet: bytes, t_ns: int) -> list[bytes]:
        source, target, command, data = packet[2], packet[3], packet[4], packet[7:-2]
        if target != HAND:
            self.counters["other_address"] += 1
            return []
        if command == MOVE and len(data) == JOINTS * ORDER.size:
            self._move(data, t_ns)
            return [MESSAGE.pack(source=HAND, target=source, command=command, data=self._state(t_ns))]
        if command == VERSION and not data:
            return [MESSAGE.pack(source=HAND, target=source, command=command, data=self.version)]
        self.counters["unknown_command"] += 1
        return []

    def _move(self, data: bytes, t_ns: int) -> None:
        goals = np.full(JOINTS, np.nan)
        for number, gain, _, _, position, _, mode in ORDER.iter_unpack(data):
            if number < JOINTS and gain > 0 and mode == POSITION and np.isfinite(position):
                goals[number] = position
        self.motors.go(goals, t_ns)

    def _state(self, t_ns: int) -> bytes:
        positions = self.motors.positions(t_ns).astype(np.float32)
        joints = JOINT.rows(JOINTS, number=np.arange(JOINTS), position=positions, temperature=25)
        felt = self.layout.on_wire(self.counts).reshape(len(FINGERS), POINTS, 3)
        warm = np.repeat(self.warmth[:, None], 20, axis=1)
        return b"".join(joints + self.tip.rows(len(FINGERS), force=self.tips, points=felt, temperatures=warm))

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """Where the joints are [rad]."""
        return {f"joint {k}": position for k, position in enumerate(self.motors.positions(t_ns).tolist())}

    @property
    def commands(self) -> tuple[Command, ...]:
        """The version, and a move that orders nothing: the first joint to 0.5 rad without gains."""
        origin = "xhand_x.py, data_type.py (ORDER of its records)"
        return (
            Command(
                name="version", request="55 AA FE 80 13 00 00 EF C3", reply="55 AA 80 FE 13 * .. ..", origin=origin
            ),
            Command(name="state", request=_STILL, reply="55 AA 80 FE 02 A0 08 ..{2208} ..{2}", origin=origin),
        )


_STILL = "55 AA FE 80 02 20 01" + "00" * 288 + "05 FD"


def _size(data: bytes) -> int:
    return 9 + int.from_bytes(data[5:7], "little") if len(data) > 6 else MORE


def _check(packet: bytes) -> str:
    return SOUND if crc16_xmodem(packet[:-2]) == int.from_bytes(packet[-2:], "little") else "bad_checksum"
