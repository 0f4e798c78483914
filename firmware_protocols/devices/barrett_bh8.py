"""Barrett BH8-282: a hand with 24 tactile cells on each finger and the palm, polled puck by puck on CAN.

Wire: classic CAN, 1 Mbit/s, standard ids ``to & 41F | from << 5``. The host is node 0, the pucks of the fingers are 11,
12 and 13, that of the spread and the palm 14; 400 is all of them, and so are 405 and 407 (properties GRPA, GRPB, GRPC).

    id      data                        direction   about
    00B-E   property                    to puck     get
    00B-E   80 | property, 00, value    to puck     set: two or four bytes, little-endian, signed
    566     80 | property, 00, value    to host     answer to a get: two bytes, or four of ``WIDE_PROPERTIES``
    563     position, inner link        to host     answer to a get of 48 (P), group 3; 567: inner link, of 96 (JP)
    568     one frame                   to host     the ten highest cells of the puck, group 8
    569     five frames                 to host     all cells of the puck, group 9
    5..     the same                    to host     586 583 587 588 589 of puck 12, 5A. of 13, 5C. of 14

A puck sleeps after power-up, with properties 0 to 7 alone, and wakes when property 5 (STAT) is set to 2.
Property 106 (TACT) selects what a puck sends of its cells, at once when it is set and again for each get:

    0   nothing (after power-up)
    1   the ten highest cells: a map of 24 bits, the lowest is cell 0, and ten values of 4 bits [N/cm2], by cell
    2   all cells, in five frames of 8 bytes, read as one big-endian number: four bits of sequence, 0 to 4, then five
        values of 12 bits [1/256 N/cm2], in the last frame four and twelve bits of 0
    3   tare: what is measured now becomes zero; the selection stays as it was

A position is 800000 | 22 bits of counts, three bytes, most significant first; the inner link of a finger turns two
fifths of its motor, the spread has none. Cells are numbered from the left in rows from the bottom: of a finger three in
each of eight rows, of the palm 5 7 7 5.

Motors: 29 (CMD) 13 goes to 0, 18 closes, 20 opens, 19 goes to DP, 14 and 15 close and open by DS; 58 (M) goes there; 8
(MODE) 5 goes to 52 (E), 4 drives at 44 (V, counts/ms), 3 follows 48 (P). MODE reads 5 as long as a motor moves, then 3
with HOLD, else 0. SAVE (30) writes the property that it names, or all for -1, to the flash, DEF (32) its default, and
LOAD (31) reads it.

Evidence: three published drivers, run.

Try it: ``tactemu run barrett_bh8 --port can:socketcan:vcan0``, then
``candump vcan0 & cansend vcan0 400#85000200; cansend vcan0 00B#EA0002000000``.
"""

from typing import Annotated

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Column, Command, Device, Layout, Motors, Option, Patch, Transmissions, command_table, fact_table,
    stack,
)  # fmt: skip

PUCKS = {11: "finger 1", 12: "finger 2", 13: "finger 3", 14: "palm"}
SPREAD = 14
CELLS = 24
CELLS_PER_FRAME = 5
HIGHEST_CELLS = 10
COUNTS_PER_PASCAL = 256 / 1e4
PADS = {
    # name: place and size [m], cells in each row, from the bottom
    "finger 1": ((-0.03, 0.06), (0.012, 0.024), (3,) * 8),
    "finger 2": ((0.0, 0.06), (0.012, 0.024), (3,) * 8),
    "finger 3": ((0.03, 0.06), (0.012, 0.024), (3,) * 8),
    "palm": ((0.0, 0.0), (0.040, 0.040), (5, 7, 7, 5)),
}

WAKE = "400#85000200"
SET = 0x80
GROUP = 0x400
TO_POSITIONS, TO_OTHERS, TO_INNER, TO_TOP_TEN, TO_CELLS = 3, 6, 7, 8, 9
"""The groups of answers."""
VERS, ROLE, SN, ID, STAT, MODE, TEMP = 0, 1, 2, 3, 5, 8, 9
THERM, SG, GRPA, GRPB, GRPC, CMD, SAVE, LOAD, DEF = 20, 25, 26, 27, 28, 29, 30, 31, 32
V, MV, P, DP, E, OT, CT, M, DS, HOLD, JP, TACT, TACTID = 44, 45, 48, 50, 52, 54, 56, 58, 60, 77, 96, 106, 107
"""The numbers of the properties, by the names of the drivers."""
WIDE_PROPERTIES = (P, DP, E, OT, CT, M, 66, 68, 74, 88, JP, 98)
"""The properties of 32 bits."""
READY = 2
PROPERTIES_WHEN_ASLEEP = range(8)
NOTHING, TOP_TEN, ALL_CELLS, TARE = range(4)
HI, CLOSE_STEP, OPEN_STEP, CLOSE, MOVE, OPEN = 13, 14, 15, 18, 19, 20
IDLE, PID, VELOCITY, TRAPEZOIDAL = 0, 3, 4, 5

COMMON_PROPERTIES = {
    VERS: 175, ROLE: 0x1205, SN: 1, 4: 0, STAT: READY, 6: 0, 7: 0, MODE: IDLE, TEMP: 30, 10: 0, 11: 60, 12: 0, 14: 0,
    15: 0, 16: 0, 17: 0, 18: 0, 19: 0, THERM: 30, 21: 480, 22: 0, 23: 50, 24: 0, SG: 2048, GRPA: 0, GRPB: 7, GRPC: 5,
    42: 0, 43: 2200, V: 0, 46: 200, 47: 200, P: 0, E: 0, OT: 0, M: 0, DS: 25600, 66: 0, 68: 4096, 71: 0, 72: 0, 73: -75,
    74: 0, 81: 0, 82: 200, 86: 20000, 87: 0, 88: 7, 90: 6, 91: 500, 92: 204, 93: 102, 100: 0, TACT: NOTHING, TACTID: 1,
}  # fmt: skip
FINGER_PROPERTIES = {MV: 200, DP: 45000, CT: 195000, HOLD: 0, 78: 50, 79: 500, 80: 2500, JP: 0}
SPREAD_PROPERTIES = {MV: 50, DP: 17975, CT: 35950, HOLD: 1, 78: 150, 79: 1000, 80: 10000}
"""The properties of the spread's puck at power-up, by number, as those above of all pucks and of a finger's."""


class BarrettBh8(Device[CanFrame]):
    """A hand of four pucks, each with a motor and tactile cells."""

    name = "barrett_bh8"
    kind = "hand"
    title = "Barrett Hand BH8-282"
    ports = (
        Can(filters=(*((puck, 0x7FF) for puck in PUCKS), (GROUP, 0x7E0)), addressed=tuple((p, 0x41F) for p in PUCKS)),
    )
    senses = ("pressure",)
    columns = (Column(name="cell", unit="Pa", counts_per_unit=COUNTS_PER_PASCAL, low=0, high=0xFFF, push=1),)
    evidence = ("driver",)
    sources = (
        "libbarrett@109faf6 tactile_puck.cpp, puck.h, puck_group.h, hand.cpp, motor_puck-inl.h, property_list.cpp",
        "a later libbarrett's tactile_puck.cpp, Top10TactParser",
        "personalrobotics/owd@126b940 openwam/CANbus.cc",
        "RobotnikAutomation/barrett_hand@4993a1f pyHand_api.py, puck_properties_consts.py, BHandGUI.ui",
    )
    judge = (
        "BarrettTechnology/libbarrett@109faf6, personalrobotics/owd@126b940, RobotnikAutomation/barrett_hand@4993a1f"
    )
    facts = fact_table("""
        stated touch: values in a report of all cells are in 1/256 N/cm2, those in a report of the ten highest in 1
            N/cm2 @ owd CANbus.cc:2450-2500
        stated touch: the last of the five frames has 8 bytes as well @ libbarrett tactile_puck.cpp FullTactParser
        stated touch: the lowest bit of the bit map is the first cell @ a later libbarrett's Top10TactParser; pyHand
        stated touch: the places of the cells, in rows @ BHandGUI.ui; libbarrett sandbox/tactile_test.cpp graphPressures
        assumed touch: a cell is 4 x 3 mm on a finger and 6 x 10 mm on the palm, all in one plane
        assumed touch: whole N/cm2 are truncated, not rounded; of equal cells the first counts as higher @
            Top10TactParser, owd, pyHand
        assumed touch: a tare does not change the report format, and is lost at power-off
        stated identity: role 5: tactile cells and a Hall encoder (1205) @ libbarrett puck.h:46-54, 186-195
        stated identity: firmware version 175 has every property that is modelled @ libbarrett property_list.cpp; owd
            CANbus.cc:3330
        assumed identity: serial number 1, TACTID 1 (-2 is an error) @ libbarrett tactile_puck.cpp, owd, pyHand
        stated configuration: a puck is asleep after power-up; asleep, it has properties 0 to 7 only @ libbarrett
            puck.cpp, property_list.cpp
        stated configuration: the value in a set message has two or four bytes @ libbarrett puck-inl.h; pyHand set_16,
            set_32
        stated configuration: the values of the motors' properties; the groups are 0, 7 and 5 @ pyHand set_puck_like
        assumed configuration: a request for cells while TACT is 0 gets no answer
        stated timing: cells are sent at once after a set message, as after a get @ owd CANbus.cc:2799-2802
        stated timing: a puck that wakes up receives nothing for a time shorter than 1 s @ libbarrett puck.h
            WAKE_UP_TIME
        assumed timing: touch is sampled 100 times a second
        assumed timing: motors turn at the speed MV, as without load
    """, looked="libbarrett, owd, pyHand")  # fmt: skip

    def __init__(
        self,
        *,
        wake_s: Annotated[
            float, Option("time for which a waking puck receives nothing; drivers wait 1 s", unit="s", low=0, high=1)
        ] = 0.0,
    ):
        self.layout = stack(*(_pad(name) for name in PUCKS.values()))
        self.present = self.zero = np.zeros(len(self.layout))
        self.values = {puck: _properties(puck, self.flash) for puck in PUCKS}
        self.deaf_ns = round(1e9 * wake_s)
        self.awake = dict.fromkeys(PUCKS, False)
        self.wakes_ns = dict.fromkeys(PUCKS, 0)
        own = [FINGER_PROPERTIES] * 3 + [SPREAD_PROPERTIES]
        self.motors = Motors(
            [0.0] * 4, low=0.0, high=[each[CT] for each in own], time_constant_s=0.0,
            speed_limit=[1000.0 * each[MV] for each in own], names=("finger_1", "finger_2", "finger_3", "spread"),
            unit=2 * np.pi / 4096 / np.array([125, 125, 125, 17.5]),
        )  # fmt: skip

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Get or set a property of one puck, or of a group of them."""
        to, message = data.arbitration_id, data.data
        pucks = [
            puck for puck in PUCKS if to == puck or to - GROUP in [self.values[puck][g] for g in (GRPA, GRPB, GRPC)]
        ]
        if not pucks or data != CanFrame(arbitration_id=to, data=message):
            self.counters["ignored"] += 1
            return ()
        is_set = bool(message) and message[0] >= SET
        if len(message) not in ((4, 6) if is_set else (1,)):
            self.counters["bad_length"] += 1
            return ()
        self.counters["requests"] += 1
        number, answers = message[0] % SET, []
        for puck in pucks:
            if t_ns < self.wakes_ns[puck]:
                self.counters["asleep"] += 1
            elif number not in self.values[puck] and number not in (CMD, SAVE, LOAD, DEF):
                self.counters["unknown_command"] += 1
            elif not self.awake[puck] and number not in PROPERTIES_WHEN_ASLEEP:
                self.counters["asleep"] += 1
            elif is_set:
                answers += self._set(puck, number, int.from_bytes(message[2:], "little", signed=True), t_ns)
            else:
                answers += self._get(puck, number, t_ns)
        return answers

    def _get(self, puck: int, number: int, t_ns: int) -> list[CanFrame]:
        if number == TACT:
            return self._cells(puck)
        value = self.values[puck].get(number, 0)
        if number in (P, JP):
            counts = round(self.motors.positions(t_ns)[puck - min(PUCKS)])
            places = [counts] if puck == SPREAD else [counts, counts * 2 // 5]
            data = b"".join((0x800000 | each & 0x3FFFFF).to_bytes(3, "big") for each in places)
            return [_frame(puck, TO_POSITIONS, data) if number == P else _frame(puck, TO_INNER, data[-3:])]
        if number == STAT:
            value = READY if self.awake[puck] else 0
        elif number == MODE and value == TRAPEZOIDAL and not self.motors.moving(t_ns, 0.5)[puck - min(PUCKS)]:
            value = PID if self.values[puck][HOLD] else IDLE
        size = 4 if number in WIDE_PROPERTIES else 2
        value &= (1 << 8 * size) - 1
        return [_frame(puck, TO_OTHERS, bytes([SET | number, 0]) + value.to_bytes(size, "little"))]

    def _set(self, puck: int, number: int, value: int, t_ns: int) -> list[CanFrame]:
        values = self.values[puck]
        if number == STAT:
            if value == READY and not self.awake[puck]:
                self.wakes_ns[puck] = t_ns + self.deaf_ns
            elif value == 0:
                self.values[puck] = _properties(puck, self.flash)
            self.awake[puck] = value == READY
        elif number == TACT:
            if value == TARE:
                cells = self._taxels(puck)
                self.zero = self.zero.copy()
                self.zero[cells] = self.present[cells]
            elif NOTHING <= value <= ALL_CELLS:
                values[TACT] = value
                return self._cells(puck)
            else:
                self.counters["refused"] += 1
        elif number in (SAVE, LOAD, DEF):
            for each in values if value == -1 else {value} & set(values):
                place = f"{puck}.{each}"
                if number == SAVE:
                    self.flash[place] = values[each]
                elif number == DEF:
                    self.flash.pop(place, None)
                else:
                    values[each] = _properties(puck, self.flash)[each]
        elif number not in (VERS, ROLE, ID):
            values[number] = value
            self._move(puck, number, value, t_ns)
        return []

    def _move(self, puck: int, number: int, value: int, t_ns: int) -> None:
        """Move the motor as a written property orders."""
        values, motor = self.values[puck], puck - min(PUCKS)
        here, goal = self.motors.positions(t_ns)[motor], None
        commands = {HI: 0, CLOSE: values[CT], OPEN: values[OT], MOVE: values[DP]}
        commands |= {CLOSE_STEP: here + values[DS], OPEN_STEP: here - values[DS]}
        if number == MODE and value == VELOCITY:
            self.motors.drive(1000.0 * values[V], t_ns, at=motor)
        elif number == MODE:
            goal = values[E] if value == TRAPEZOIDAL else here
        elif number == M or (number == CMD and value in commands):
            goal = value if number == M else commands[value]
            values[MODE] = TRAPEZOIDAL
        elif number == P and values[MODE] == PID:
            goal = value
        if goal is not None:
            self.motors.go(goal, t_ns, at=motor)

    def _taxels(self, puck: int) -> slice:
        return self.layout.patches[puck - min(PUCKS)].taxels

    def _cells(self, puck: int) -> list[CanFrame]:
        form, cells = self.values[puck][TACT], self.layout.on_wire(self.counts)[self._taxels(puck)].tolist()
        if form == NOTHING:
            return []
        return _top_ten(puck, cells) if form == TOP_TEN else _all_cells(puck, cells)

    @property
    def commands(self) -> tuple[Command, ...]:
        """The drivers' first requests, then cells and tare of each puck, awake."""
        return (*_FIRST, *(each for puck, name in PUCKS.items() for each in _of_cells(puck, name)))


_FIRST = command_table(f"""
    @ libbarrett puck.cpp
    ? is it awake             00B#05  566#85000000
    @ libbarrett puck.h
    ? role                    00E#01  5C6#81000512
    @ pyHand initialize
    wake all                  {WAKE}
    @ libbarrett property_list.cpp
    cells of one that sleeps  00B#EA000200
""")


def _of_cells(puck: int, name: str) -> tuple[Command, ...]:
    """Return the requests for the cells of a puck that is awake."""
    to, top = f"{WAKE}; {puck:03X}#", f"{GROUP | TO_TOP_TEN | puck << 5:03X}#..{{8}}"
    cells = ", ".join([f"{GROUP | TO_CELLS | puck << 5:03X}#..{{8}}"] * 5)
    return command_table(f"""
        @ libbarrett
        cells of {name}              {to}EA0002000000                    {cells}
        @ pyHand
        cells, in 16 bits, of {name}  {to}EA000200                        {cells}
        @ libbarrett requestFull
        cells again of {name}        {to}EA000200; {puck:03X}#6A         {cells}
        @ pyHand get_top_tact
        ten highest of {name}        {to}EA000100                        {top}
        @ libbarrett tare
        tare {name}                  {to}EA0003000000
    """)


def _properties(puck: int, flash: dict[str, int]) -> dict[int, int]:
    """Return the properties of a puck at power-up, by number."""
    own = {ID: puck, 85: puck - 3, 70: puck - 10}
    values = COMMON_PROPERTIES | (SPREAD_PROPERTIES if puck == SPREAD else FINGER_PROPERTIES) | own
    return {number: flash.get(f"{puck}.{number}", value) for number, value in values.items()}


def _pad(name: str) -> Layout:
    (x, y), (width, height), rows = PADS[name]
    step_x, step_y = width / max(rows), height / len(rows)
    cells = [
        (x + (k - (n - 1) / 2) * step_x, y + (row - (len(rows) - 1) / 2) * step_y, 0.0)
        for row, n in enumerate(rows)
        for k in range(n)
    ]
    patch = Patch(name=name, start=0, rows=0, cols=CELLS, pitch=min(step_x, step_y), area=step_x * step_y, link=name)
    return Layout(positions=np.array(cells), normals=np.array([0.0, 0.0, 1.0]), patches=(patch,))


def _frame(puck: int, group: int, data: bytes) -> CanFrame:
    return CanFrame(arbitration_id=GROUP | group | puck << 5, data=data)


def _all_cells(puck: int, cells: list[int]) -> list[CanFrame]:
    """Return five frames: four bits of sequence, and five values of 12 bits, 0 behind the last cell."""
    frames = []
    for k in range(0, CELLS, CELLS_PER_FRAME):
        bits = k // CELLS_PER_FRAME
        for value in [*cells[k : k + CELLS_PER_FRAME], 0][:CELLS_PER_FRAME]:
            bits = bits << 12 | value
        frames.append(_frame(puck, TO_CELLS, bits.to_bytes(8, "big")))
    return frames


def _top_ten(puck: int, cells: list[int]) -> list[CanFrame]:
    """Return one frame: a map of the ten highest cells, and their values in integer N/cm2."""
    highest = sorted(sorted(range(CELLS), key=lambda cell: -cells[cell])[:HIGHEST_CELLS])
    bits = sum(1 << cell for cell in highest)
    for cell in highest:
        bits = bits << 4 | cells[cell] >> 8
    return [_frame(puck, TO_TOP_TEN, bits.to_bytes(8, "big"))]
