r"""ROBOTIS HX5-D20: a hand of twenty motors with nine pressures on each fingertip, behind one controller.

Wire: RS-485 (or USB), 4 000 000 8N1, packets as :mod:`firmware_protocols.protocols.dynamixel` says. Of the hand's nodes
only the controller answers, a right hand's at 110, a left one's at 140. It asks its fingers itself, four motors and a
sensor each, while ``sync`` is 1, and shows what they said in five tables from 1024 on, 198 bytes each, thumb to little:

    offset  bytes   content
    0       54      six ids, addresses and sizes to read, addresses and sizes to write, which the host fills
    54      24      four motors: current, velocity (0.02397 rad/s), position (0.001534 rad, 2048 is 0), int16 each
    78      9       pressures 0..255, row by row
    126     24      goals for the host to write: current, position, and two bytes more of each motor

So the pressures are at 1102, 1300, 1498, 1696 and 1894. A host writes 0 to ``sync``, fills the tables, and writes 1.
Byte k of ``read_data`` (634) is that at the k-th address of ``read_places`` (122); ``write_data`` (799) goes to
``write_places`` (452) in the same way.

    ping            FF FF FD 00 6E 03 00 01 08 82                FF FF FD 00 6E 07 00 55 00 04 01 01 EA 32
    thumb           FF FF FD 00 6E 07 00 02 4E 04 09 00 19 42    FF FF FD 00 6E 0D 00 55 00 ..{9} ..{2}

Try it: ``tactemu run robotis_hx5``, then ``PacketHandler(2.0).readTxRx(port, 110, 1102, 9)`` of ``dynamixel_sdk``.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column,
    Command,
    Counts,
    Device,
    Option,
    Outs,
    Reading,
    Rollover,
    Rs485,
    Sent,
    grid_layout,
)
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import place, stack
from firmware_protocols.motors import Motors
from firmware_protocols.protocols.dynamixel import DynamixelLine
from firmware_protocols.registers import Refused, RegisterMap, Registers

FINGERS = {
    # name: centre of the pad in the hand's frame [m]
    "thumb": (0.06, 0.03, 0.0), "index": (0.033, 0.09, 0.0), "middle": (0.011, 0.1, 0.0),
    "ring": (-0.011, 0.095, 0.0), "little": (-0.033, 0.08, 0.0),
}  # fmt: skip
TABLES, TABLE_BYTES = 1024, 198
MAP = RegisterMap(
    """
    0    <u2        model         = 260  r
    2    u1 x 4     information   r
    6    u1         firmware      = 1  r
    7    u1         id            0..252  = 110  flash
    8    u1         watchdog
    11   u1         protocol      = 2  flash
    12   u1         bus_baud      = 6  flash
    13   u1         delay         flash               before an answer [2 us]
    15   u1         level         0..2  = 2  flash    0: answers pings, 1: reads too, 2: everything
    20   u1         motor_baud    = 6  flash
    65   u1         led           0..1
    70   u1         sync          0..1                the controller asks its fingers
    100  <u2        tick          r                   [ms]
    106  u1         status        r
    122  <u2 x 165  read_places
    452  <u2 x 91   write_places
    634  u1 x 165   read_data     r
    799  u1 x 91    write_data
    """
    + "".join(
        f"""
    {at}        u1 x 54    slots_{name}
    {at + 54}   <i2 x 12   motors_{name}    r         current, velocity, position of each
    {at + 78}   u1 x 9     pressures_{name}  r        row by row
    {at + 126}  <i2 x 12   goals_{name}  = {", ".join(["0, 2048, 0"] * 4)}    current, position, two bytes more of each
    {at + 150}  u1 x 48    more_{name}
    """
        for at, name in zip(range(TABLES, TABLES + len(FINGERS) * TABLE_BYTES, TABLE_BYTES), FINGERS)
    )
)
MODELS = {110: 260, 140: 261}
SYNC, WRITE_DATA = MAP.by_name["sync"].address, MAP.by_name["write_data"]
RAD_PER_COUNT, SPEED_PER_COUNT, MIDDLE = 0.001534, 0.02397, 2048


class RobotisHx5(Device):
    """The hand as its controller shows it."""

    name = "robotis_hx5"
    kind = "hand"
    title = "ROBOTIS HX5-D20 hand, five tips of 3x3"
    ports = (Rs485(baud=4_000_000),)
    rate_hz = 1000.0
    rollovers = (Rollover(name="tick", bits=16, step=1000, clock=True, state="tick"),)
    evidence = ("driver",)
    sources = (
        "ROBOTIS-GIT/dynamixel_hardware_interface@db2b903 param/dxl_model/hx5_d20_rr.model, hx5_d20_rl.model",
        "ROBOTIS-GIT/robotis_hand@d59e479 ros2_control/hx5_d20_rev2 (sync tables)",
        "howon720/robotis_hand_hx5_d20@00b3a75 tactile_sensor.cpp (order of the cells)",
        "dynamixel-sdk 4.1.0 protocol2_packet_handler.py",
    )
    judge = "dynamixel-sdk 4.1.0"
    assumed = (
        "places: pads of 3 x 3 at 4 mm in one plane, normal +z; 50 counts/N of 0..255",
        "the tables show these fingers whatever their slots say, and stand still while sync is 0",
        "motors: positions 0..4095 at 6 rad/s, no current; goals are obeyed while sync is 1, their currents are not",
        "codes of line speeds, firmware 1; the tick begins at power-up; unknown instruction: error 2, bad CRC: error 3",
        "a read or write beyond the tables: error 4, of what can only be read: 7; fingers do not answer by themselves",
        "the voltage (102) reads 0; watchdog, line speeds and protocol are stored, without effect; no Modbus",
    )

    def __init__(
        self,
        *,
        id: Annotated[Literal[110, 140], Option("as delivered: 110 a right hand, 140 a left one")] = 110,
        counts_per_newton: Annotated[float, Option("raw counts along a cell's normal", unit="1/N")] = 50.0,
    ):
        self.counts_per_newton, self.tick = counts_per_newton, 0
        self.columns = (Column(name="pressure", low=0, high=255, push=1),)
        self.layout = stack(
            *(place(grid_layout(3, 3, 0.004, name=name, link=name), base) for name, base in FINGERS.items())
        )
        self.registers = Registers(MAP, kept={"id": id, **self.flash})
        self.registers["model"] = MODELS[id]
        n = 4 * len(FINGERS)
        self.motors = Motors([MIDDLE] * n, low=0, high=4095, time_constant_s=0.02, speed_limit=6 / RAD_PER_COUNT)
        self.counts = np.zeros(len(self.layout), np.int64)
        self.line = DynamixelLine(counters=self.counters)

    # -- what the line asks ----------------------------------------------------------------------------------------

    @property
    def id(self) -> int:
        """Of the controller."""
        return self.registers["id"]

    @property
    def ping(self) -> bytes:
        """Model and firmware."""
        return struct.pack("<HB", self.registers["model"], self.registers["firmware"])

    @property
    def alert(self) -> int:
        """Never."""
        return 0

    @property
    def delay_ns(self) -> int:
        """Return delay."""
        return 2000 * self.registers["delay"]

    @property
    def level(self) -> int:
        """Status return level."""
        return self.registers["level"]

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Memory as it is at ``t_ns``."""
        for reg in MAP.touched(address, address + n):
            if reg.name == "tick":
                self.registers["tick"] = (t_ns // 1_000_000 + self.tick) & 0xFFFF
            elif reg.name == "read_data":
                self.registers["read_data"] = [self._byte(at, t_ns) for at in self.registers.all("read_places")]
            elif self.registers["sync"]:
                self._mirror(reg.name, t_ns)
        return self.registers.read(address, n)

    def _mirror(self, name: str, t_ns: int) -> None:
        """What a finger says of its motors or its pressures, into the tables."""
        kind, _, finger = name.partition("_")
        if kind == "motors":
            self.registers[name] = self._moved(t_ns)[finger]
        elif kind == "pressures":
            cells = self.layout.on_wire(self.counts).reshape(len(FINGERS), -1)
            self.registers[name] = cells[list(FINGERS).index(finger)]

    def _byte(self, address: int, t_ns: int) -> int:
        """What an indirect address shows: 0 beyond the memory."""
        indirect = MAP.by_name["read_data"]
        if address >= MAP.size or indirect.address <= address < indirect.end:
            return 0
        return self.read(address, 1, t_ns)[0]

    def _moved(self, t_ns: int) -> dict[str, np.ndarray]:
        """Current, velocity and position of each motor, by finger."""
        positions, speeds = self.motors.positions(t_ns), self.motors.velocities(t_ns) * RAD_PER_COUNT / SPEED_PER_COUNT
        numbers = np.stack([np.zeros_like(speeds), speeds, positions], axis=-1)
        return dict(zip(FINGERS, numbers.reshape(len(FINGERS), -1)))

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store, keep what is kept, and go."""
        if self.registers["sync"] and address <= SYNC < address + len(data):
            for name in MAP.by_name:
                self._mirror(name, t_ns)  # once more: it may be the last time
        written = self.registers.write(address, data)
        self.flash.update({name: self.registers.all(name) for name in written if MAP.by_name[name].flash})
        if "write_data" in written:
            for at, place_ in enumerate(self.registers.all("write_places"), WRITE_DATA.address):
                if address <= at < address + len(data) and not WRITE_DATA.address <= place_ < WRITE_DATA.end:
                    self._put(place_, data[at - address : at - address + 1], t_ns)
        if self.registers["sync"] and any(name == "sync" or name.startswith("goals_") for name in written):
            goals = [self.registers.all(f"goals_{name}")[1::3] for name in FINGERS]
            self.motors.go(np.ravel(goals), t_ns)
        return written

    def _put(self, address: int, byte: bytes, t_ns: int) -> None:
        try:
            self.write(address, byte, t_ns)
        except Refused:
            self.counters["refused"] += 1

    # -- what the runner asks --------------------------------------------------------------------------------------

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Raw pressures 0..255, shape ``(45,)``, thumb to little, row by row."""
        self.counts = quantize(self.layout.push(reading["force"]), self.counts_per_newton, 0, 255)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Packets in chunks of any size."""
        answers = self.line.answers(data, t_ns, [self])
        return [Sent(answer.frame, delay_ns=answer.delay_ns, turn=answer.turn) for answer in answers]

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """How far each motor is from its middle [rad]."""
        angles = (self.motors.positions(t_ns) - MIDDLE) * RAD_PER_COUNT
        return dict(zip((f"{name} {k}" for name in FINGERS for k in range(1, 5)), angles.tolist()))

    @property
    def commands(self) -> tuple[Command, ...]:
        """Requests to a right hand as it comes."""
        if self.options:
            return ()
        return tuple(
            Command(name=name, request=f"FF FF FD 00 {request}", reply=reply, after=after, origin=_ORIGIN)
            for name, request, reply, after in _EXAMPLES
        )


_ORIGIN = "hx5_d20_rr.model; packets by dynamixel-sdk 4.1.0"
_HEAD, _SYNC = "FF FF FD 00", "FF FF FD 00 6E 06 00 03 46 00 01 53 0F"
_DONE, _NINE = f"{_HEAD} 6E 04 00 55 00 09 1F", f"{_HEAD} 6E 0D 00 55 00 ..{{9}} ..{{2}}"
_NINE_FAST = f"{_HEAD} FE 0E 00 55 00 6E ..{{9}} ..{{2}}"
_EXAMPLES = (
    # name, request, reply, what goes before
    ("ping", "6E 03 00 01 08 82", f"{_HEAD} 6E 07 00 55 00 04 01 01 EA 32", ()),
    ("ping all", "FE 03 00 01 31 42", f"{_HEAD} 6E 07 00 55 00 04 01 01 EA 32", ()),
    ("ask the fingers", "6E 06 00 03 46 00 01 53 0F", _DONE, ()),
    ("thumb", "6E 07 00 02 4E 04 09 00 19 42", _NINE, (_SYNC,)),
    ("index", "6E 07 00 02 14 05 09 00 15 8A", _NINE, (_SYNC,)),
    ("middle", "6E 07 00 02 DA 05 09 00 34 D2", _NINE, (_SYNC,)),
    ("ring", "6E 07 00 02 A0 06 09 00 1F 1A", _NINE, (_SYNC,)),
    ("little", "6E 07 00 02 66 07 09 00 2A E2", _NINE, (_SYNC,)),
    ("sync read", "FE 08 00 82 4E 04 09 00 6E 48 BF", _NINE, ()),
    ("fast sync read", "FE 08 00 8A 4E 04 09 00 6E 41 FF", _NINE_FAST, ()),
    ("bulk read", "FE 08 00 92 6E 4E 04 09 00 C4 8F", _NINE, ()),
    ("fast bulk read", "FE 08 00 9A 6E 4E 04 09 00 CD CF", _NINE_FAST, ()),
    ("sync write", "FE 09 00 83 46 00 01 00 6E 01 1D AD", None, ()),
    ("bulk write", "FE 09 00 93 6E 46 00 01 00 01 37 13", None, ()),
    ("LED", "6E 06 00 03 41 00 01 3C 8F", _DONE, ()),
    ("write the model: access", "6E 06 00 03 00 00 01 28 8A", f"{_HEAD} 6E 04 00 55 07 18 9F", ()),
    ("read beyond: range", "6E 07 00 02 DA 07 09 00 1F 52", f"{_HEAD} 6E 04 00 55 04 12 9F", ()),
    ("sync 2: value", "6E 06 00 03 46 00 02 59 0F", f"{_HEAD} 6E 04 00 55 06 1D 1F", ()),
    ("reboot: instruction", "6E 03 00 08 3E 82", f"{_HEAD} 6E 04 00 55 02 06 9F", ()),
)
