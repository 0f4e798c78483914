"""WACOH DynPick: a six-axis force-torque sensor that answers a letter with a line.

Wire: 921600 8N1. The host sends single letters.

    R    a digit that counts the answers, then Fx Fy Fz Mx My Mz as four hexadecimal digits each, 2000 (8192) where
         nothing acts, CR LF: 27 characters
    p    counts per newton and newton metre of the six axes, CR LF
    O    what acts now is zero from now on; no answer

Try it: ``tactemu run dynpick``, then send ``R``.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from firmware_protocols import Column, Command, Counts, Device, Option, Outs, Reading, Sense, Serial, points
from firmware_protocols.adc import quantize
from firmware_protocols.device import Axis

REST, HIGH = 8192, 16383
AXES: tuple[Axis, ...] = ("x", "y", "z")


class DynPick(Device):
    """Force and torque of a tool, a line for each request."""

    name = "dynpick"
    kind = "force-torque sensor"
    title = "WACOH DynPick six-axis force-torque sensor"
    ports = (Serial(baud=921600),)
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    rate_hz = 500.0
    evidence = ("driver",)
    sources = ("tork-a/dynpick_driver@d5ea649",)
    judge = "own second reader"
    assumed = (
        "the tool is touched 50 mm above the sensor's origin; z points out of the tool side, forces act on the tool",
        "50 counts/N and 1500 counts/Nm, as numbers with three decimals and commas between them in the answer to p",
        "the digit goes from 0 to 9; counts end at 0 and 16383; upper-case digits; 500 conversions per second",
        "other letters are not answered; the zero is forgotten at power-off",
    )

    def __init__(
        self,
        *,
        tool: Annotated[
            tuple[float, float, float], Option("where the tool is touched, from the sensor's origin", unit="m")
        ] = (0.0, 0.0, 0.05),
        counts_per_newton: Annotated[float, Option("of the three forces", unit="1/N", low=1e-3, high=1e6)] = 50.0,
        counts_per_newton_metre: Annotated[float, Option("of the torques", unit="1/Nm", low=1e-3, high=1e6)] = 1500.0,
    ):
        self.layout = points({"tool": tool})
        self.scale = np.array([counts_per_newton] * 3 + [counts_per_newton_metre] * 3)
        self.columns = tuple(
            Column(name=f"{letter}{axis}", axis=axis, unit=unit, counts_per_unit=scale, low=0, high=HIGH, rest=REST)
            for letter, unit, scale in (("F", "N", counts_per_newton), ("M", "Nm", counts_per_newton_metre))
            for axis in AXES
        )
        self.felt = self.zero = np.zeros((1, 6))
        self.tick = 0

    @property
    def commands(self) -> tuple[Command, ...]:
        """The three letters."""
        origin = self.sources[0]
        return (
            Command(name="read", request="52", reply="30 ..{24} 0D 0A", origin=origin),
            Command(name="sensitivity", request="70", reply="*", origin=origin),
            Command(name="zero", request="4F", origin=origin),
        )

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Fx Fy Fz Mx My Mz, 8192 where nothing acts, shape ``(1, 6)``."""
        self.felt = reading["wrench"]
        self.counts = quantize(self.felt - self.zero, self.scale, 0, HIGH, rest=REST)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Letters."""
        return [answer for letter in data.decode("latin-1") for answer in self._answer(letter)]

    def _answer(self, letter: str) -> list[bytes]:
        self.counters["requests"] += 1
        if letter == "R":
            line = f"{self.tick}" + "".join(f"{count:04X}" for count in self.counts[0].tolist())
            self.tick = (self.tick + 1) % 10
        elif letter == "p":
            line = ",".join(f"{scale:.3f}" for scale in self.scale.tolist())
        else:
            self.zero = self.felt if letter == "O" else self.zero
            self.counters["unknown_command"] += letter != "O"
            return []
        return [f"{line}\r\n".encode("ascii")]
