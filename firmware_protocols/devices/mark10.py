"""Mark-10 Series 5: a force gauge that answers questions with a number and its unit.

Wire: USB-CDC, opened at 115200; the speed has no effect. Requests and answers end with CR LF, or requests with CR.

    request   answer
    ?, ?C     the force     such as 12.34 N; with the option ``numeric`` the number alone
    ?PT, ?PC  the largest pull, the largest push since power-up, in the same form
    N         -             newtons from now on
    others    -

Evidence: two drivers, run.

Try it: ``tactemu run mark10``, then a ``Mark10.create(PORT)`` of Opentrons.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, Device, Lines, Option, Reading, Request, Serial, command, fact_table, points,
)  # fmt: skip

NEWTONS = {"N": 1.0, "lbF": 4.4482216152605, "kgF": 9.80665}
MOST = 5500
"""The largest count [0.01 N]."""
OPENTRONS = "Opentrons/opentrons@08e382b"
FILE = f"{OPENTRONS} hardware-testing/hardware_testing/drivers/mark10/mark10_fg.py"
READER = "1ramihamada/read-force@5ec00a9"
BOTH = f"{FILE}; {READER}, all files"


class Mark10(Device):
    """A force gauge that is asked."""

    name = "mark10"
    title = "Mark-10 Series 5 force gauge"
    kind = "force-torque sensor"
    ports = (Serial(baud=115200, usb=USB(0x0483, 0xA1AD)),)
    columns = (Column(name="force", unit="N", counts_per_unit=100.0, low=-MOST, high=MOST, push=1),)
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (FILE, f"{READER} README.md")
    judge = f"{OPENTRONS}, {READER}"
    origin = f"{FILE}, {READER} README.md"
    facts = fact_table(f"""
        stated touch: a number, a space and the unit @ {FILE}:86-100; the number alone as a setting @ {READER} README.md
        assumed touch: a model of 50 N: two decimals, saturation at 110 %; a push is positive @ {BOTH}
        stated identity: USB ids 0483:A1AD, of which the source is not sure @ {FILE}:11-15
        stated configuration: the requests ?, ?C, ?PT and ?PC @ {READER} README.md; N sets newtons @ {FILE}:94
        assumed configuration: N and other requests get no answer; peaks last until power-off, and so does the unit @
            {BOTH}
        stated timing: 115200 baud @ {FILE}:65; {READER} README.md
        assumed timing: 100 readings a second @ {BOTH}
    """)

    def __init__(
        self,
        *,
        unit: Annotated[Literal["N", "lbF", "kgF"], Option("unit at power-up")] = "N",
        numeric: Annotated[bool, Option("send numbers without their unit")] = False,
    ):
        self.layout = points({"rod": (0.0, 0.0, 0.0)})
        self.unit, self.numeric = unit, numeric
        self.packets = Lines(counters=self.counters, longest=16)
        self.pull = self.push = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the force [0.01 N], and keep the peaks."""
        self.counts = np.asarray(super().measure(reading, t_ns))
        self.pull, self.push = min(self.pull, int(self.counts[0])), max(self.push, int(self.counts[0]))
        return self.counts

    @command(b"?\r\n", "* 20 4E 0D 0A", name="displayed force", safe=True)
    @command(b"?C\r\n", "* 20 4E 0D 0A", name="present force", safe=True)
    @command(b"?PT\r\n", "* 20 4E 0D 0A", name="largest pull", safe=True)
    @command(b"?PC\r\n", "* 20 4E 0D 0A", name="largest push", safe=True)
    def force(self, request: Request) -> bytes:
        """Return a force."""
        count = {b"?PT": self.pull, b"?PC": self.push}.get(request.packet, int(self.counts[0]))
        number = f"{count / 100 / NEWTONS[self.unit]:.2f}"
        return (number if self.numeric else f"{number} {self.unit}").encode("ascii") + b"\r\n"

    @command(b"N\r\n")
    def set_newtons(self, request: Request) -> None:
        """Show newtons."""
        self.unit = "N"
