"""The nodes of a ROBOTIS HX5-D20: controller, motors and sensors, with their control tables.

The datasheet of the hand is :mod:`firmware_protocols.devices.robotis_hx5`.
"""

import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from firmware_protocols import Motors, Refused, RegisterMap, Registers

FINGERS = ("thumb", "index", "middle", "ring", "little")
FIRST_FINGER_TABLE = 1024
FINGER_TABLE_BYTES = 198
FINGER_TABLES_END = FIRST_FINGER_TABLE + len(FINGERS) * FINGER_TABLE_BYTES
SLOT_DATA_BYTES = 72
MOTORS_PER_FINGER = 4
MIDDLE_GOALS = ", ".join(["0, 0, 0, 8"] * MOTORS_PER_FINGER + ["0"] * (SLOT_DATA_BYTES - 4 * MOTORS_PER_FINGER))
"""The goals of four motors at power-up: no current, position 2048."""
CONTROLLER_TABLE = RegisterMap(
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
    {at + 126}  u1 x 72    write_{k}       = {MIDDLE_GOALS}
    """
        for k, at in enumerate(range(FIRST_FINGER_TABLE, FINGER_TABLES_END, FINGER_TABLE_BYTES))
    )
)
OWN_DATA_ADDRESSES = ", ".join(map(str, range(234, 252)))
"""The indirect addresses that point at their own data."""
MOTOR_TABLE = RegisterMap(
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
    168  <u2 x 28   places        = 126, 127, 128, 129, 132, 133, 102, 103, 116, 117, {OWN_DATA_ADDRESSES}
    224  u1 x 28    data
    """
)
SENSOR_TABLE = RegisterMap(
    """
    0    u1         model         r
    6    u1         firmware      = 1  r
    7    u1         id            0..252  flash
    9    u1         delay         flash
    68   u1         level         0..2  = 2
    72   u1 x 9     pressures     r
    """
)
MODEL_BY_ID = {110: 260, 140: 261}
SYNC_ADDRESS = CONTROLLER_TABLE.by_name["sync"].address
RAD_PER_COUNT = 0.001534
RAD_S_PER_COUNT = 0.02397
MIDDLE_COUNTS = 2048
TORQUE_ON_BY_GOAL = 8


class Node:
    """A node of the line, with its control table."""

    table: ClassVar[RegisterMap]
    alert = 0

    def __init__(self, ident: int, kept: Mapping[str, Any]):
        self.registers = Registers(self.table, kept={"id": ident, **kept})
        self.is_changed = False
        """True after a write to a register that is kept."""

    @property
    def id(self) -> int:
        """The id of the node."""
        return self.registers["id"]

    @property
    def ping(self) -> bytes:
        """The data of the answer to a ping: model and firmware."""
        return struct.pack("<HB", self.registers["model"], self.registers["firmware"])

    @property
    def delay_ns(self) -> int:
        """The delay before an answer [ns]."""
        return 2000 * self.registers["delay"]

    @property
    def level(self) -> int:
        """The status return level."""
        return self.registers["level"]

    def reboot(self, t_ns: int) -> None:
        """Restart the node: only the registers that are kept survive."""
        self.registers = Registers(self.table, kept=self.registers.kept())

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory."""
        return self.registers.read(address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes; return the names of the registers."""
        written = self.registers.write(address, data)
        self.is_changed |= any(self.table.by_name[name].flash for name in written)
        return written


class Motor(Node):
    """One of the twenty motors."""

    table = MOTOR_TABLE

    def __init__(self, ident: int, kept: Mapping[str, Any], motors: Motors, number: int):
        super().__init__(ident, kept)
        self.motors, self.number = motors, number

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as it is at ``t_ns``."""
        speed = self.motors.velocities(t_ns)[self.number] * RAD_PER_COUNT / RAD_S_PER_COUNT
        self.registers["position"] = round(self.motors.positions(t_ns)[self.number])
        self.registers["speed"] = round(speed)
        self.registers["tick"] = t_ns // 1_000_000 & 0x7FFF
        return with_indirect(self.registers, "places", "data", address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and move."""
        written = [*super().write(address, data, t_ns)]
        if "data" in written:
            for at, some in indirect(self.registers, "places", "data", address, data):
                written += self.registers.write(at, some)
        if "goal" in written and self.registers["drive_mode"] & TORQUE_ON_BY_GOAL:
            self.registers["torque"] = 1
        if self.registers["torque"] and {"goal", "torque"} & set(written):
            goal, goals = self.registers["goal"], np.full(len(self.motors.goals), np.nan)
            if goal != self.motors.goals[self.number]:
                goals[self.number] = goal
                self.motors.go(goals, t_ns)
        return written


class Sensor(Node):
    """The sensor of a fingertip."""

    table = SENSOR_TABLE


class Controller(Node):
    """The node that polls the others."""

    table = CONTROLLER_TABLE

    def __init__(self, ident: int, kept: Mapping[str, Any], nodes: Sequence[Node], counters: Counter[str]):
        super().__init__(ident, kept)
        self.model, self.nodes, self.counters, self.tick = MODEL_BY_ID[ident], nodes, counters, 0
        self.registers["model"] = self.model

    def reboot(self, t_ns: int) -> None:
        """Restart the node: only the registers that are kept survive."""
        super().reboot(t_ns)
        self.registers["model"] = self.model

    def read(self, address: int, n: int, t_ns: int) -> bytes:
        """Return memory as it is at ``t_ns``."""
        touched = {reg.name for reg in CONTROLLER_TABLE.touched(address, address + n)}
        self.registers["tick"] = (t_ns // 1_000_000 + self.tick) & 0xFFFF
        if self.registers["sync"]:
            self._poll_nodes(t_ns, [k for k in range(len(FINGERS)) if touched & {f"read_{k}", "read_data"}])
        return with_indirect(self.registers, "read_places", "read_data", address, n)

    def write(self, address: int, data: bytes, t_ns: int) -> Sequence[str]:
        """Store what the host writes, and pass data on to the nodes."""
        end = address + len(data)
        if self.registers["sync"] and address <= SYNC_ADDRESS < end:
            self._poll_nodes(t_ns, range(len(FINGERS)))  # once more, as this write may end the polling
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
            self._write_nodes(t_ns, fingers, [(0, CONTROLLER_TABLE.size)] if everything else spans)
        return sorted(written)

    def _slots(self, fingers: Iterable[int], what: str) -> Iterator[tuple[int, Node | None, int, int]]:
        """Yield finger, node, address and size of each slot in the fingers' tables."""
        by_id = {node.id: node for node in self.nodes}
        for k in fingers:
            names = f"ids_{k}", f"{what}_at_{k}", f"{what}_n_{k}"
            for ident, at, n in zip(*map(self.registers.all, names)):
                yield k, by_id.get(ident), at, n

    def _poll_nodes(self, t_ns: int, fingers: Iterable[int]) -> None:
        """Fill the fingers' tables with the data of their nodes, 0 for a missing node."""
        data_of = dict.fromkeys(fingers, b"")
        for k, node, at, n in self._slots(data_of, "read"):
            try:
                data_of[k] += node.read(at, n, t_ns) if node is not None else bytes(n)
            except Refused:
                data_of[k] += bytes(n)
        for k, data in data_of.items():
            self.registers[f"read_{k}"] = list(data[:SLOT_DATA_BYTES].ljust(SLOT_DATA_BYTES, b"\0"))

    def _write_nodes(self, t_ns: int, fingers: Sequence[int], spans: Sequence[tuple[int, int]]) -> None:
        """Write to the nodes of the fingers' tables the data within ``spans``."""
        starts = {k: CONTROLLER_TABLE.by_name[f"write_{k}"].address for k in fingers}
        for k, node, at, n in self._slots(fingers, "write"):
            start, starts[k] = starts[k], starts[k] + n
            if node is not None and n and any(start < end and first < start + n for first, end in spans):
                try:
                    node.write(at, self.registers.read(start, n), t_ns)
                except Refused:
                    self.counters["refused"] += 1


def with_indirect(registers: Registers, places: str, data: str, address: int, n: int) -> bytes:
    """Return memory in which the bytes of ``data`` are those at ``places``; 0 for an address in ``data`` or none."""
    table, shown = registers.table, registers.table.by_name[data]
    content = registers.read(address, n)
    first, end = max(shown.address, address), min(shown.end, address + n)
    if first >= end:
        return content
    memory = registers.read(0, table.size)
    wanted = registers.all(places)[first - shown.address : end - shown.address]
    bytes_ = bytes(0 if at >= table.size or shown.address <= at < shown.end else memory[at] for at in wanted)
    return content[: first - address] + bytes_ + content[end - address :]


def indirect(registers: Registers, places: str, data: str, address: int, written: bytes) -> list[tuple[int, bytes]]:
    """Return the runs of address and bytes to which a write to ``data`` at ``address`` is redirected."""
    shown, runs = registers.table.by_name[data], []
    for at, place_ in enumerate(registers.all(places), shown.address):
        if address <= at < address + len(written) and not shown.address <= place_ < shown.end:
            byte = written[at - address : at - address + 1]
            if runs and runs[-1][0] + len(runs[-1][1]) == place_:
                runs[-1] = (runs[-1][0], runs[-1][1] + byte)
            else:
                runs.append((place_, byte))
    return runs
