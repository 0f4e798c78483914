r"""ROBOTIS HX5-D20: a hand of twenty motors with nine pressures on each fingertip, behind one controller.

Wire: RS-485 (or USB), 4 000 000 8N1, packets as :mod:`firmware_protocols.protocols.dynamixel` says. The controller is
110 in a right hand, 140 in a left one. Behind it, and answering by themselves, are five fingers from the thumb on: four
motors, DYNAMIXEL XC335-T332, and a sensor each, 111..115 to 131..135 (141..145 to 161..165).

While ``sync`` is 1 the controller asks them, and shows what they said in five tables of 198 bytes, from 1024 on:

    offset  bytes   content
    0       6       ids of six nodes
    6       12, 12  where to read each, and how many bytes
    30      12, 12  where to write each, and how many bytes
    54      72      what was read of one after the other
    126     72      what to write to one after the other

Four motors of 6 bytes (current, velocity [0.02397 rad/s], position [0.001534 rad, 2048 is 0], int16 each) and nine
pressures 0..255, row by row: these are at 1102, 1300, 1498, 1696 and 1894. Goals of a motor are current and position.
The motors show that at 224..229 and take it at 230..233, where their indirect addresses 126 127 128 129 132 133 and
102 103 116 117 put it. The vendor's driver reboots all nodes, writes 0 to ``sync``, fills tables and indirect
addresses, writes 1, and then reads and writes by the controller's own indirect addresses: byte k of ``read_data`` (634)
is that at the k-th address of ``read_places`` (122), ``write_data`` (799) goes to ``write_places`` (452).

    ping            FF FF FD 00 6E 03 00 01 08 82                FF FF FD 00 6E 07 00 55 00 04 01 01 EA 32
    thumb           FF FF FD 00 6E 07 00 02 4E 04 09 00 19 42    FF FF FD 00 6E 0D 00 55 00 ..{9} ..{2}

Try it: ``tactemu run robotis_hx5``, then ``PacketHandler(2.0).readTxRx(port, 110, 1102, 9)`` of ``dynamixel_sdk``.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from firmware_protocols import (
    Column,
    Command,
    Counts,
    Device,
    Option,
    Reading,
    Rollover,
    Rs485,
    Sent,
    Transmissions,
    assumed,
    grid_layout,
    stated,
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
TABLES = 1024
TABLE_BYTES = 198
DATA_BYTES = 72
MOTORS = 4
MIDDLES = ", ".join(["0, 0, 0, 8"] * MOTORS + ["0"] * (DATA_BYTES - 4 * MOTORS))
"""Goals of four motors: no current, 2048."""
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
    102  u1 x 2     voltage       r
    106  u1         status        r
    122  <u2 x 165  read_places
    452  <u2 x 91   write_places
    634  u1 x 165   read_data     r
    799  u1 x 91    write_data
    """
    + "".join(
        f"""
    {at}        u1 x 6     ids_{k}
    {at + 6}    <u2 x 6    read_at_{k}     = 224, 224, 224, 224, 72, 0
    {at + 18}   <u2 x 6    read_n_{k}      = 6, 6, 6, 6, 9, 0
    {at + 30}   <u2 x 6    write_at_{k}    = 230, 230, 230, 230, 0, 0
    {at + 42}   <u2 x 6    write_n_{k}     = 4, 4, 4, 4, 0, 0
    {at + 54}   u1 x 72    read_{k}        r
    {at + 126}  u1 x 72    write_{k}       = {MIDDLES}
    """
        for k, at in enumerate(range(TABLES, TABLES + len(FINGERS) * TABLE_BYTES, TABLE_BYTES))
    )
)
LATER = ", ".join(map(str, range(234, 252)))
"""Indirect addresses that point at their own data."""
MOTOR = RegisterMap(
    f"""
    0    <u2        model         = 1700  r
    2    u1 x 4     information   r
    6    u1         firmware      = 1  r
    7    u1         id            0..252  flash
    8    u1         baud          = 6  flash
    9    u1         delay         flash               before an answer [2 us]
    10   u1         drive_mode    = 12  flash         8: a goal turns the torque on
    11   u1         mode          = 5  flash
    12   u1         second_id     = 255  flash
    13   u1         protocol      = 2  flash
    20   u1 x 8     offsets       flash               homing, moving threshold
    31   u1         hottest       flash
    32   u1 x 8     limits        flash               voltage: most, least; PWM, current
    44   u1 x 12    ranges        flash               velocity; positions: most, least
    60   u1 x 2     startup       flash
    62   u1 x 2     protection    flash               PWM slope, shutdown
    64   u1         torque        0..1
    65   u1         led           0..1
    68   u1         level         0..2  = 2           as the controller's
    69   u1 x 2     status        r                   instruction registered, hardware error
    76   u1 x 16    gains                             velocity I, P; position D, I, P; -; feedforward 2, 1
    98   u1         watchdog
    100  u1 x 8     other_goals                       PWM, current, velocity
    108  u1 x 8     profile                           acceleration, velocity
    116  <i4        goal          = 2048
    120  <u2        tick          r                   [ms]
    122  u1 x 2     moving        r
    124  u1 x 4     effort        r                   PWM, current
    128  <i4        speed         r                   [0.02397 rad/s]
    132  <i4        position      r
    136  u1 x 11    others        r                   trajectory, voltage, temperature
    168  <u2 x 28   places        = 126, 127, 128, 129, 132, 133, 102, 103, 116, 117, {LATER}
    224  u1 x 28    data
    """
)
SENSOR = RegisterMap(
    """
    0    u1         model         r
    6    u1         firmware      = 1  r
    7    u1         id            0..252  flash
    9    u1         delay         flash
    68   u1         level         0..2  = 2
    72   u1 x 9     pressures     r
    """
)
DHI = "ROBOTIS-GIT/dynamixel_hardware_interface@db2b903 "
MODELS_AT = "param/dxl_model"
HAND = "ROBOTIS-GIT/robotis_hand@d59e479 robotis_hand_description/ros2_control/hx5_d20_rev2/*.xacro"
LOOKED = f"{DHI}src, scripts, {MODELS_AT}; ROBOTIS-GIT/robotis_hand@d59e479 (all); ROBOTIS-GIT/DynamixelSDK@2ded684d"
MODELS = {110: 260, 140: 261}
SYNC = MAP.by_name["sync"].address
RAD_PER_COUNT = 0.001534
SPEED_PER_COUNT = 0.02397
MIDDLE = 2048
TURNS_ON = 8


class Node:
    """A node of the line: its control table, as the protocol asks for it."""

    table: ClassVar[RegisterMap]
    alert = 0

    def __init__(self, ident: int, kept: Mapping[str, Any]):
        self.registers = Registers(self.table, kept={"id": ident, **kept})
        self.is_changed = False
        """What is kept has changed."""

    @property
    def id(self) -> int:
        """Its number."""
        return self.registers["id"]

    @property
    def ping(self) -> bytes:
        """Model and firmware."""
        return struct.pack("<HB", self.registers["model"], self.registers["firmware"])

    @property
    def delay_ns(self) -> int:
        """Return delay."""
        return 2000 * self.registers["delay"]

    @property
    def level(self) -> int:
        """Status return level."""
        return self.registers["level"]

    def reboot(self, t_ns: int) -> None:
        """Forget what is not kept."""
        self.registers = Registers(self.table, kept=self.registers.kept())

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as it is."""
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store."""
        written = self.registers.write(address, data)
        self.is_changed |= any(self.table.by_name[name].flash for name in written)
        return written


class Motor(Node):
    """One of the motors of all."""

    table = MOTOR

    def __init__(self, ident: int, kept: Mapping[str, Any], motors: Motors, number: int):
        super().__init__(ident, kept)
        self.motors, self.number = motors, number

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as it is at ``t_ns``."""
        speed = self.motors.velocities(t_ns)[self.number] * RAD_PER_COUNT / SPEED_PER_COUNT
        self.registers["position"] = round(self.motors.positions(t_ns)[self.number])
        self.registers["speed"] = round(speed)
        self.registers["tick"] = t_ns // 1_000_000 & 0x7FFF
        return with_indirect(self.registers, "places", "data", address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store, and go."""
        written = [*super().write(address, data, t_ns)]
        if "data" in written:
            for at, some in indirect(self.registers, "places", "data", address, data):
                written += self.registers.write(at, some)
        if "goal" in written and self.registers["drive_mode"] & TURNS_ON:
            self.registers["torque"] = 1
        if self.registers["torque"] and {"goal", "torque"} & set(written):
            goal, goals = self.registers["goal"], np.full(len(self.motors.goals), np.nan)
            if goal != self.motors.goals[self.number]:
                goals[self.number] = goal
                self.motors.go(goals, t_ns)
        return written


class Sensor(Node):
    """The sensor of a fingertip."""

    table = SENSOR


class Controller(Node):
    """The node that asks the others."""

    table = MAP

    def __init__(self, ident: int, kept: Mapping[str, Any], nodes: Sequence[Node], counters: Counter[str]):
        super().__init__(ident, kept)
        self.model, self.nodes, self.counters, self.tick = MODELS[ident], nodes, counters, 0
        self.registers["model"] = self.model

    def reboot(self, t_ns: int) -> None:
        """Forget what is not kept."""
        super().reboot(t_ns)
        self.registers["model"] = self.model

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as it is at ``t_ns``."""
        touched = {reg.name for reg in MAP.touched(address, address + n)}
        self.registers["tick"] = (t_ns // 1_000_000 + self.tick) & 0xFFFF
        if self.registers["sync"]:
            self._ask(t_ns, [k for k in range(len(FINGERS)) if touched & {f"read_{k}", "read_data"}])
        return with_indirect(self.registers, "read_places", "read_data", address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store, and pass on what is for the nodes."""
        end = address + len(data)
        if self.registers["sync"] and address <= SYNC < end:
            self._ask(t_ns, range(len(FINGERS)))  # once more: it may be the last time
        written, spans = {*super().write(address, data, t_ns)}, [(address, end)]
        if "write_data" in written:
            for at, some in indirect(self.registers, "write_places", "write_data", address, data):
                try:
                    written.update(super().write(at, some, t_ns))
                    spans.append((at, at + len(some)))
                except Refused:
                    self.counters["refused"] += 1
        if self.registers["sync"]:
            everything = "sync" in written
            fingers = [k for k in range(len(FINGERS)) if everything or f"write_{k}" in written]
            self._tell(t_ns, fingers, [(0, MAP.size)] if everything else spans)
        return sorted(written)

    def _slots(self, fingers: Iterable[int], what: str) -> Iterator[tuple[int, Node | None, int, int]]:
        """Finger, node, address and size of each slot of their tables."""
        by_id = {node.id: node for node in self.nodes}
        for k in fingers:
            names = f"ids_{k}", f"{what}_at_{k}", f"{what}_n_{k}"
            for ident, at, n in zip(*map(self.registers.all, names)):
                yield k, by_id.get(ident), at, n

    def _ask(self, t_ns: int, fingers: Iterable[int]) -> None:
        """Fill tables with what their nodes say; one that is not there says 0."""
        said = dict.fromkeys(fingers, b"")
        for k, node, at, n in self._slots(said, "read"):
            try:
                said[k] += node.read(at, n, t_ns) if node is not None else bytes(n)
            except Refused:
                said[k] += bytes(n)
        for k, data in said.items():
            self.registers[f"read_{k}"] = list(data[:DATA_BYTES].ljust(DATA_BYTES, b"\0"))

    def _tell(self, t_ns: int, fingers: Sequence[int], spans: Sequence[tuple[int, int]]) -> None:
        """Write to the nodes of these tables what has been written for them."""
        starts = {k: MAP.by_name[f"write_{k}"].address for k in fingers}
        for k, node, at, n in self._slots(fingers, "write"):
            start, starts[k] = starts[k], starts[k] + n
            if node is not None and n and any(start < end and first < start + n for first, end in spans):
                try:
                    node.write(at, self.registers.read(start, n), t_ns)
                except Refused:
                    self.counters["refused"] += 1


def with_indirect(registers: Registers, places: str, data: str, address: int, n: int) -> bytes:
    """Read memory in which the bytes of ``data`` show those at ``places``, and 0 for one another or nothing."""
    table, shown = registers.table, registers.table.by_name[data]
    said = registers.read(address, n)
    first, end = max(shown.address, address), min(shown.end, address + n)
    if first >= end:
        return said
    memory = registers.read(0, table.size)
    wanted = registers.all(places)[first - shown.address : end - shown.address]
    bytes_ = bytes(0 if at >= table.size or shown.address <= at < shown.end else memory[at] for at in wanted)
    return said[: first - address] + bytes_ + said[end - address :]


def indirect(registers: Registers, places: str, data: str, address: int, written: bytes) -> list[tuple[int, bytes]]:
    """Return where else bytes belong that were written to ``address``, in runs."""
    shown, runs = registers.table.by_name[data], []
    for at, place_ in enumerate(registers.all(places), shown.address):
        if address <= at < address + len(written) and not shown.address <= place_ < shown.end:
            byte = written[at - address : at - address + 1]
            if runs and runs[-1][0] + len(runs[-1][1]) == place_:
                runs[-1] = (runs[-1][0], runs[-1][1] + byte)
            else:
                runs.append((place_, byte))
    return runs


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
        f"{DHI}src/dynamixel_hardware_interface.cpp, src/dynamixel/dynamixel.cpp, {MODELS_AT}/*.model",
        f"{HAND}",
        "howon720/robotis_hand_hx5_d20@00b3a75 tactile_sensor.cpp (order of the cells)",
        "dynamixel-sdk 4.1.0 protocol2_packet_handler.py",
    )
    judge = "ROBOTIS-GIT/dynamixel_hardware_interface@db2b903, dynamixel-sdk 4.1.0"
    facts = (
        stated("touch", "nine raw bytes of each fingertip", f"{DHI}{MODELS_AT}/hx5_d20_r_synctable_1_device_5.model"),
        stated(
            "touch",
            "cells row by row, from the left, from the top",
            "howon720/robotis_hand_hx5_d20@00b3a75 tactile_sensor.cpp",
        ),
        assumed("touch", "pads of 3 x 3 at 4 mm in one plane, normal +z; 50 counts/N", LOOKED),
        stated(
            "identity",
            "models 260 and 261, nodes 110..135 and 140..165",
            f"{DHI}{MODELS_AT}/dynamixel.model:6; {HAND}:231",
        ),
        stated(
            "identity",
            "motors are XC335-T332, model 1700: no other has the items and addresses that are set",
            f"{HAND}:364 read with {DHI}{MODELS_AT}/xc335_t332.model and the other 90",
        ),
        assumed("identity", "firmware 1 of every node, model 0 of the sensors", LOOKED),
        stated(
            "configuration",
            "every node answers reboot; controller and motors ping",
            f"{DHI}src/dynamixel_hardware_interface.cpp:201",
        ),
        stated(
            "configuration",
            "data of the slots lie one after the other",
            f"{DHI}scripts/hx_synctable_model_generator.py:178",
        ),
        stated("configuration", "slots, sizes and indirect addresses", f"{HAND}:236, 371"),
        assumed(
            "configuration",
            "at power-up they are as the vendor's driver sets them; sync is 0; a reboot takes no time",
            LOOKED,
        ),
        assumed("configuration", "tables stand still while sync is 0; goals are passed on while it is 1", LOOKED),
        assumed(
            "configuration",
            "drive mode 8: a goal turns the torque on; offset, direction, profile and gains do nothing",
            LOOKED,
        ),
        assumed("configuration", "motors: positions 0..4095 at 6 rad/s, no current, currents are not obeyed", LOOKED),
        assumed(
            "configuration",
            "watchdog, line speeds, protocol are stored without effect; voltages read 0; no Modbus",
            LOOKED,
        ),
        stated(
            "configuration",
            "errors 2 instruction, 4 range, 6 value, 7 access",
            "dynamixel-sdk 4.1.0 protocol2_packet_handler.py:52",
        ),
        assumed(
            "configuration", "which error: unknown instruction 2, bad CRC 3, beyond the tables 4, read only 7", LOOKED
        ),
        assumed("timing", "1000 conversions a second; the tick begins at power-up", LOOKED),
    )

    def __init__(
        self,
        *,
        id: Annotated[Literal[110, 140], Option("as delivered: 110 a right hand, 140 a left one")] = 110,
        counts_per_newton: Annotated[float, Option("raw counts along a cell's normal", unit="1/N")] = 50.0,
    ):
        self.counts_per_newton, self.hand = counts_per_newton, id
        self.columns = (Column(name="pressure", low=0, high=255, push=1),)
        self.layout = stack(
            *(place(grid_layout(3, 3, 0.004, name=name, link=name), base) for name, base in FINGERS.items())
        )
        n = MOTORS * len(FINGERS)
        self.motors = Motors([MIDDLE] * n, low=0, high=4095, time_constant_s=0.02, speed_limit=6 / RAD_PER_COUNT)
        self.counts = np.zeros(len(self.layout), np.int64)
        self.nodes: list[Node] = []
        for k in range(len(FINGERS)):
            first = id + 1 + k * (MOTORS + 1)
            for number in range(MOTORS):
                self.nodes.append(Motor(*self._kept(first + number), self.motors, MOTORS * k + number))
            self.nodes.append(Sensor(*self._kept(first + MOTORS)))
        self.controller = Controller(*self._kept(id), self.nodes, self.counters)
        for k in range(len(FINGERS)):
            first = id + 1 + k * (MOTORS + 1)
            self.controller.registers[f"ids_{k}"] = [*range(first, first + MOTORS + 1), 0]
        self.line = DynamixelLine(counters=self.counters)

    def _kept(self, ident: int) -> tuple[int, Mapping[str, Any]]:
        return ident, self.flash.get(str(ident), {})

    @property
    def tick(self) -> int:
        """What is added to the controller's clock [ms]."""
        return self.controller.tick

    @tick.setter
    def tick(self, tick: int) -> None:
        self.controller.tick = tick

    # -- what the runner asks --------------------------------------------------------------------------------------

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Raw pressures 0..255, shape ``(45,)``, thumb to little, row by row."""
        self.counts = quantize(self.layout.push(reading["force"]), self.counts_per_newton, 0, 255)
        for sensor, cells in zip(self.nodes[MOTORS :: MOTORS + 1], self.layout.on_wire(self.counts).reshape(-1, 9)):
            sensor.registers["pressures"] = cells
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer packets, which arrive in chunks of any size."""
        nodes = [self.controller, *self.nodes]
        answers = self.line.answers(data, t_ns, nodes)
        for ident, node in enumerate(nodes, self.hand):
            if node.is_changed:
                self.flash[str(ident)], node.is_changed = node.registers.kept(), False
        return [Sent(answer.frame, delay_ns=answer.delay_ns, turn=answer.turn) for answer in answers]

    def joints(self, t_ns: int) -> Mapping[str, float]:
        """How far each motor is from its middle [rad]."""
        angles = (self.motors.positions(t_ns) - MIDDLE) * RAD_PER_COUNT
        return dict(zip((f"{name} {k}" for name in FINGERS for k in range(1, MOTORS + 1)), angles.tolist()))

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
_HEAD = "FF FF FD 00"
_SYNC = "FF FF FD 00 6E 06 00 03 46 00 01 53 0F"
_DONE = f"{_HEAD} 6E 04 00 55 00 09 1F"
_NINE = f"{_HEAD} 6E 0D 00 55 00 ..{{9}} ..{{2}}"
_NINE_FAST = f"{_HEAD} FE 0E 00 55 00 6E ..{{9}} ..{{2}}"
_EXAMPLES = (
    # name, request, reply, what goes before
    ("ping", "6E 03 00 01 08 82", f"{_HEAD} 6E 07 00 55 00 04 01 01 EA 32", ()),
    ("ping the index's first motor", "74 03 00 01 0E 4A", f"{_HEAD} 74 07 00 55 00 A4 06 01 ..{{2}}", ()),
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
    ("reboot", "6E 03 00 08 3E 82", _DONE, ()),
    ("factory reset: instruction", "6E 04 00 06 FF 0E 77", f"{_HEAD} 6E 04 00 55 02 06 9F", ()),
)
