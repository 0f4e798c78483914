"""Feetech STS3215 servos on one half-duplex line, as a test of shared lines: position, goal, id and baud only.

Wire: one-wire TTL, 1 000 000 8N1; frames as in :mod:`firmware_protocols.protocols.feetech`.

Try it: ``tactemu run tests/devices/servo_bus.py:ServoBus``.
"""

from typing import Annotated

import numpy as np

from firmware_protocols import Device, Option, Rs485, Sense, Sent, points
from firmware_protocols.motors import Motors
from firmware_protocols.protocols.feetech import ServoLine
from firmware_protocols.registers import RegisterMap, Registers

COUNTS_PER_TURN = 4096
MAP = RegisterMap(
    """
    3   <u2           model       = 777          r
    5   u1            id          0..253  = 1    flash
    7   u1            delay                      flash      2 us each
    8   u1            level       0..1  = 1      flash
    42  <u2 sign 15   goal        = 2048
    56  <u2 sign 15   position    = 2048         r
    """,
    size=90,
)


class Servo:
    """One servo: a memory whose position follows its goal."""

    status = 0

    def __init__(self, bus: "ServoBus", ident: int):
        self.bus, self.index = bus, len(bus.servos)
        self.registers = Registers(MAP, kept={"id": ident})

    @property
    def id(self):
        return self.registers["id"]

    @property
    def delay_ns(self):
        return 2000 * self.registers["delay"]

    @property
    def confirms(self):
        return self.registers["level"] == 1

    def read(self, address, n, t_ns):
        self.registers["position"] = round(self.bus.motors.positions(t_ns)[self.index])
        return self.registers.read(address, n, t_ns)

    def write(self, address, data, t_ns):
        touched = self.registers.write(address, data, t_ns)
        if "goal" in touched:
            goals = np.full(len(self.bus.servos), np.nan)
            goals[self.index] = self.registers["goal"]
            self.bus.motors.go(goals, t_ns)
        return touched


class ServoBus(Device):
    """Servos with consecutive ids."""

    name, title = "servo_bus", "Feetech servos"
    ports = (Rs485(baud=1_000_000, turnaround_ns=20_000),)
    evidence, sources = ("driver",), ("feetech-servo-sdk 1.0.0",)
    boot_s = 0.01

    def __init__(self, *, first: Annotated[int, Option("id of the first servo", low=0, high=250)] = 1, count: int = 3):
        self.layout = points({})
        self.senses = (Sense("load", at=points({f"servo {first + k}": (0, 0, 0) for k in range(count)})),)
        self.motors = Motors(np.full(count, 2048.0), low=0, high=4095, time_constant_s=0.02)
        self.line = ServoLine(counters=self.counters)
        self.servos: list[Servo] = []
        for k in range(count):
            self.servos.append(Servo(self, first + k))

    def measure(self, reading, t_ns):
        return np.rint(reading["load"] * 1000).astype(np.int64)

    def receive(self, data, t_ns, port):
        answers = self.line.answers(data, t_ns, self.servos)
        return [Sent(answer.frame, delay_ns=answer.delay_ns, turn=answer.turn) for answer in answers]

    def joints(self, t_ns):
        turns = (self.motors.positions(t_ns) - 2048) / COUNTS_PER_TURN
        return {f"servo {servo.id}": 2 * np.pi * float(turn) for servo, turn in zip(self.servos, turns)}
