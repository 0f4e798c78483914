"""ATI NETCANOEM: the board between a force-torque transducer and CAN, which tells its six strain gauges.

Wire: classic CAN, standard ids; 7F0 is the base as captured (option ``base``).

    id    data                        direction   about
    7F0   nothing                     to board    read the gauges
    7F0   ``FIRST``                   to host     status and three gauges
    7F1   ``SECOND``                  to host     the other three
    7F2   row                         to board    read one row of the matrix: 0 Fx, 1 Fy, 2 Fz, 3 Tx, 4 Ty, 5 Tz
    7F2   ``PAIR`` of gauges 0, 1     to host     and 7F3 of 2, 3, and 7F4 of 4, 5

A force is its row times the gauges; counts per newton are not modelled: the rows give newtons and newton metres.

Evidence: sixteen captured frames, with the gauges read twice and one row. They show neither the question for a row nor
which gauge stands where.

Try it: ``tactemu run ati_netcanoem --port can:socketcan:vcan0``, then ``candump vcan0 & cansend vcan0 7F0#``.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Command, Counts, Device, Option, Outs, Reading, Sense, points
from firmware_protocols.adc import quantize
from firmware_protocols.tables import Frame

FIRST = Frame("""
    first gauges
    0     >u2        status      4000 as captured
    2     >i2 x 3    gauges      0 2 4
""")
SECOND = Frame("""
    second gauges
    0     >i2 x 3    gauges      1 3 5
""")
PAIR = Frame("""
    part of a row
    0     >f4 x 2    row
""")
READ_GAUGES, READ_ROW = 0, 2
SHEAR, AXIAL, TORQUE = 100.0, 60.0, 5000.0
"""Counts of a gauge per newton across and along the axis, and per newton metre."""


def sensitivity() -> np.ndarray:
    """Counts of each gauge per N and Nm, shape ``(6, 6)``: three beams, an even gauge across and an odd one along."""
    rows = []
    for angle in 2 * np.pi / 3 * np.arange(3):
        sin, cos = np.sin(angle), np.cos(angle)
        rows += [[-SHEAR * sin, SHEAR * cos, 0, 0, 0, TORQUE], [0, 0, AXIAL, TORQUE * cos, TORQUE * sin, 0]]
    return np.array(rows)


class AtiNetcanoem(Device[CanFrame]):
    """Six gauges, asked for."""

    name = "ati_netcanoem"
    kind = "force-torque sensor"
    title = "ATI NETCANOEM, force and torque"
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    columns = tuple(Column(name=f"gauge {k}", low=-0x8000, high=0x7FFF) for k in range(6))
    rate_hz = 1000.0
    evidence = ("captured",)
    sources = ("a candump of a course's README, January 2021 (16 frames; which repository is not known)",)
    judge = "cantools, with a DBC of its frames"
    assumed = (
        "the question for a row: 7F2 and its number; which gauge stands where: 0 2 4 and 1 3 5",
        "three beams: 100 and 60 counts/N across and along, 5000 counts/Nm; 0 at rest; 1 Mbit/s; 1 kHz",
        "the tool is touched 50 mm above the origin; status 4000; whatever else is sent gets silence",
    )

    def __init__(
        self,
        *,
        base: Annotated[int, Option("first identifier", low=0, high=0x7F0)] = 0x7F0,
        order: Annotated[Literal["024135", "012345"], Option("which gauge stands at each place")] = "024135",
        tool: Annotated[
            tuple[float, float, float], Option("where the tool is touched, from the sensor's origin", unit="m")
        ] = (0.0, 0.0, 0.05),
    ):
        self.base, self.order = base, [int(gauge) for gauge in order]
        self.ports = (Can(hears=tuple((base + code, 0x7FF) for code in (READ_GAUGES, READ_ROW))),)
        self.layout = points({"tool": tool})
        self.sensitivity = sensitivity()
        self.matrix = (np.round(np.linalg.inv(self.sensitivity), 12) + 0.0).astype(np.float32)
        self.status = 0x4000

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Counts of the six gauges, int16 range, shape ``(1, 6)``."""
        self.counts = quantize(reading["wrench"] @ self.sensitivity.T, 1.0, -0x8000, 0x7FFF)
        return self.counts

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Outs[CanFrame]:
        """Gauges, or a row of the matrix."""
        code, message = data.arbitration_id - self.base, data.data
        if code not in (READ_GAUGES, READ_ROW) or data != CanFrame(arbitration_id=data.arbitration_id, data=message):
            self.counters["ignored"] += 1
            return ()
        if code == READ_GAUGES and not message:
            gauges = self.counts[0][self.order]
            answers = [FIRST.pack(status=self.status, gauges=gauges[:3]), SECOND.pack(gauges=gauges[3:])]
        elif code == READ_ROW and len(message) == 1 and message[0] < 6:
            answers = [PAIR.pack(row=pair) for pair in self.matrix[message[0]].reshape(3, 2)]
        else:
            self.counters["unknown_command"] += 1
            return ()
        self.counters["requests"] += 1
        return [CanFrame(arbitration_id=self.base + code + k, data=answer) for k, answer in enumerate(answers)]

    @property
    def commands(self) -> tuple[Command, ...]:
        """Gauges and rows."""
        ids = [f"{self.base + k:03X}#" for k in range(5)]
        return (
            Command(name="gauges", request=ids[0], reply=[ids[0] + "40 00 ..{6}", ids[1] + "..{6}"], origin="capture"),
            *(
                Command(
                    name=f"row of {axis}",
                    request=f"{ids[2]}{k:02X}",
                    reply=[each + "..{8}" for each in ids[2:]],
                    origin="the capture's answer",
                )
                for k, axis in enumerate(("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))
            ),
        )
