"""Barrett BH8-282: a hand whose three fingers and palm have 24 tactile cells each, asked for puck by puck on CAN.

Wire: classic CAN, 1 Mbit/s, standard ids ``to & 41F | from << 5``; the host is node 0, the pucks of the fingers are 11,
12 and 13, that of the palm 14.

    id      data               direction   about
    00B-E   EA 00 value (i32)  to puck     set property 106 (TACT), little-endian
                               value 2     all cells, once
                               value 3     tare: what is felt now is zero
    569     five frames        to host     cells of puck 11, sent to group 9; 589, 5A9, 5C9 of 12, 13, 14

A frame is read as one big-endian number: four bits of sequence, 0 to 4, then five values of 12 bits, in the last frame
four. Readers divide a value by 256. Value 1 asks for the ten highest cells in a form that is not known here: silence.

Evidence: two published drivers, read and not run.

Try it: ``tactemu run barrett_bh8 --port can:socketcan:vcan0``, then
``candump vcan0 & cansend vcan0 00B#EA0002000000``.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Command, Counts, Device, Layout, Option, Outs, Reading
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import filled, place, stack

PUCKS = {11: "finger 1", 12: "finger 2", 13: "finger 3", 14: "palm"}
CELLS, PER_FRAME = 24, 5
GROUP = 0x409
TACT, FULL, TARE = 0xEA, 2, 3
PADS = {"finger 1": (-0.03, 0.06), "finger 2": (0.0, 0.06), "finger 3": (0.03, 0.06), "palm": (0.0, 0.0)}
"""Centres [m]."""
FINGER_SIZE, PALM_SIZE = (0.012, 0.024), (0.040, 0.040)


class BarrettBh8(Device[CanFrame]):
    """Four pucks with tactile cells."""

    name = "barrett_bh8"
    kind = "hand"
    title = "Barrett Hand BH8-282"
    ports = (Can(hears=tuple((puck, 0x7FF) for puck in PUCKS)),)
    columns = (Column(name="cell", low=0, high=0xFFF, push=1),)
    evidence = ("driver",)
    sources = ("libbarrett@109faf6 tactile_puck.cpp, puck.h", "Robotnik pyHand@4993a1f")
    judge = "cantools, with a DBC of its frames; own second reader"
    assumed = (
        "set messages: EA 00, then the value; a set without four bytes of value is not known; every other gets silence",
        "the unit of a value, taken as newtons on a cell; 100 conversions a second; tare is forgotten at power-off",
        "cells spread evenly, row by row, over 12 x 24 mm on a finger and 40 x 40 mm on the palm, in one plane",
    )

    def __init__(
        self, *, counts_per_newton: Annotated[float, Option("of a cell", unit="1/N", low=1e-6, high=1e6)] = 256.0
    ):
        self.layout = stack(*(_pad(name) for name in PUCKS.values()))
        self.counts_per_newton = counts_per_newton
        self.pushed = self.zero = np.zeros(len(self.layout))

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Counts of each cell above its zero, 0..4095, shape ``(96,)``."""
        self.pushed = self.layout.push(reading["force"])
        self.counts = quantize(self.pushed - self.zero, self.counts_per_newton, 0, 0xFFF)
        return self.counts

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Outs[CanFrame]:
        """Set the property of one puck."""
        puck, message = data.arbitration_id, data.data
        if puck not in PUCKS or data != CanFrame(arbitration_id=puck, data=message):
            self.counters["ignored"] += 1
            return ()
        value = int.from_bytes(message[2:6], "little")
        if len(message) < 6 or message[0] != TACT or value not in (FULL, TARE):
            self.counters["unknown_command"] += 1
            return ()
        self.counters["requests"] += 1
        cells = self.layout.patches[puck - min(PUCKS)].taxels
        if value == TARE:
            self.zero = self.zero.copy()
            self.zero[cells] = self.pushed[cells]
            return ()
        return _frames(puck, self.layout.on_wire(self.counts)[cells].tolist())

    @property
    def commands(self) -> tuple[Command, ...]:
        """All cells, and tare, of each puck."""
        origin, listed = self.sources[0], []
        for puck, name in PUCKS.items():
            replies = [f"{GROUP | puck << 5:03X}#" + "..{8}" for _ in range(4)] + [
                f"{GROUP | puck << 5:03X}#" + "..{7}"
            ]
            listed += [
                Command(name=f"cells of {name}", request=f"{puck:03X}#EA0002000000", reply=replies, origin=origin),
                Command(name=f"tare {name}", request=f"{puck:03X}#EA0003000000", origin=origin),
            ]
        return tuple(listed)


def _pad(name: str) -> Layout:
    size = PALM_SIZE if name == "palm" else FINGER_SIZE
    return place(filled(CELLS, *size, name=name, link=name), (*PADS[name], 0.0))


def _frames(puck: int, cells: list[int]) -> list[CanFrame]:
    """Four bits of sequence and five values of 12 bits each; the last frame has four and ends with four bits of 0."""
    frames = []
    for k in range(0, CELLS, PER_FRAME):
        values = cells[k : k + PER_FRAME]
        bits = k // PER_FRAME
        for value in values:
            bits = bits << 12 | value
        spare = -(4 + 12 * len(values)) % 8
        data = (bits << spare).to_bytes((4 + 12 * len(values) + spare) // 8, "big")
        frames.append(CanFrame(arbitration_id=GROUP | puck << 5, data=data))
    return frames
