"""M1616 piezoresistive array: a mat of 16 x 16 taxels with its board, as sold without a name.

Wire: serial, 115200 8N1. Device to host only: one ``FRAME`` after another, 22 a second at most.

The reader searches for AA AB AC and takes the 516 bytes that follow, of which the last four are of no use to it. It
searches through a frame that it has lost too, so that taxels that read AA AB AC would begin one.

Evidence: the one public reader, run.

Try it: ``tactemu run m1616_array``, then its ``main.py`` with ``PORT`` in place of ``COM10``.
"""

from typing import Annotated

from firmware_protocols import (
    Column, CountsPerNewton, Device, Frame, Option, Serial, Transmissions, fact_table, grid_layout,
)  # fmt: skip

READER = "Ninth2234/PiezoresistiveArray_SerialMonitor@7f8553a"
FRAME = Frame("""
    frame, row by row
    0     AA AB AC        head
    3     >u2 x taxels    touch   of the ADC
    ..    00 00 00 00     reserved
""")


class M1616Array(Device):
    """A mat that streams."""

    name = "m1616_array"
    title = "M1616 16x16 piezoresistive array"
    kind = "skin"
    ports = (Serial(baud=115_200),)
    rate_hz = 20.0
    evidence = ("driver",)
    sources = (f"{READER} main.py",)
    judge = READER
    facts = fact_table(f"""
        stated touch: 256 taxels in rows of 16, two bytes each, high byte first @ {READER} main.py:31
        stated touch: the reader draws values from 0 to 512 @ {READER} main.py:43
        assumed touch: row 0 is at the far edge; taxels are 10 mm apart; values have 12 bits, 0 at rest, 100 counts/N @
            {READER}, all files
        stated configuration: 115200 baud; AA AB AC begins a frame, 516 bytes follow @ {READER} main.py:5-8
        assumed configuration: the last four bytes, which the reader drops, are 0 @ {READER}, all files
        assumed timing: 20 frames a second from power-up on (the line can carry 22.2) @ {READER}, all files
    """)

    def __init__(
        self,
        *,
        counts_per_newton: CountsPerNewton = 100.0,
        baseline: Annotated[int, Option("counts of a taxel at rest", low=0, high=4000)] = 0,
    ):
        self.layout = grid_layout(16, 16, 0.01, name="mat")
        self.columns = (
            Column(name="touch", low=0, high=4095, rest=baseline, assumed_per_unit=counts_per_newton, push=1),
        )
        self.frame = FRAME.bind(wire_order=self.layout.wire_order)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one frame."""
        return [self.frame.pack(touch=self.counts)]
