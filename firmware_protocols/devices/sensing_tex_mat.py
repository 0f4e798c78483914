"""Sensing Tex pressure mat: 48 x 48 cells, of which it sends those that are touched.

Wire: USB-CDC, opened at 115200; the speed has no effect. The host sends the letter R; the answer is a ``MAP``, row by
row. Other bytes are not answered.

Evidence: a reader, run, and maps that its author has kept.

Try it: ``tactemu run sensing_tex_mat``, then ``Mat(PORT).get_matrix()`` of the reader, twice: it looks for an answer at
once, and finds the one to the letter before.
"""

import numpy as np

from firmware_protocols import (
    Column, Counts, CountsPerNewton, Device, Frame, Packets, Reading, Request, Serial, command, fact_table, grid_layout,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     u1            command
""")
POINT = Frame("""
    point
    0     u1            x          column
    1     u1            y          row
    2     >u2           value
""")
MAP = Frame("""
    map
    0     4E 0A         start
    2     >u2           n = count(points)
    4     0A 0A         separator
    6     POINT x n     points
""", POINT=POINT)  # fmt: skip
ROWS, COLS = 48, 48
LEAST, MOST = 60, 4095
READER = "linneakirby/HAND@d1bc95e"
OTHERS = "and four more readers: a Sensing Mat Consolidator, a collector for a mat of 80 x 28, two of 48 x 48"


class SensingTexMat(Device):
    """A mat that answers with the points that are touched."""

    name = "sensing_tex_mat"
    title = "Sensing Tex pressure mat, 48x48"
    kind = "skin"
    ports = (Serial(baud=115200, usb=True),)
    rate_hz = 50.0
    evidence = ("driver",)
    sources = (f"{READER} Software/Mat.py",)
    judge = READER
    facts = fact_table(f"""
        stated touch: columns and rows are numbered from 0; values are sent high byte first @ {READER}
            Software/Mat.py:33-64
        measured touch: the recordings have values of 60 and more, and a few of 1; at most 1205 under hands; about 200
            of 2304 points @ {READER} Software/Results (17 maps)
        assumed touch: values are 0 to 4095, with 300 counts per N; cells are 10 mm wide, with row 0 towards +y and
            column 0 towards -x @ {READER}, all files
        stated configuration: 115200 baud; R requests a map @ {READER} Software/Mat.py:21-31
        assumed configuration: the byte after N and the two bytes after the number, which readers skip, are LF @
            {READER}, {OTHERS}
        assumed timing: 50 maps a second @ {READER}, {OTHERS}
    """)

    def __init__(self, *, counts_per_newton: CountsPerNewton = 300.0):
        self.layout = grid_layout(ROWS, COLS, 0.01, name="mat")
        self.columns = (Column(name="value", low=0, high=MOST, assumed_per_unit=counts_per_newton, push=1),)
        self.packets = Packets(REQUEST, by="command", counters=self.counters)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the counts of each cell, 0 below the least."""
        counts = np.asarray(super().measure(reading, t_ns))
        self.counts = np.where(counts < LEAST, 0, counts)
        return self.counts

    @command("52", "4E 0A .. .. 0A 0A *", origin=f"{READER} Software/Mat.py", safe=True)
    def read(self, request: Request) -> bytes:
        """Return the points that are touched."""
        counts = self.layout.on_wire(self.counts)
        at = np.flatnonzero(counts)
        points = [{"x": k % COLS, "y": k // COLS, "value": int(counts[k])} for k in at.tolist()]
        return MAP.pack(points=points)
