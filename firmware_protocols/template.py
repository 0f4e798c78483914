"""Vendor Model: the product in one line. (Copy this file, rename the class, and replace every line marked "yours".)

Wire: USB-CDC, opened at 115200 8N1; the speed matters on a true UART only. (State the direction and who sends first.
The frames themselves are tables below: `tactemu devices` prints them.)

    request  answer
    3F       one frame, at once
    others   silence

Evidence: the source of each table, and each assumption. (Captured, vendor document, firmware, driver: best first.
Repeat every source in ``sources`` and every guess in ``facts``.)

Try it: ``tactemu run path/to/this_file.py:VendorModel``, then a line that makes the real driver read.
"""

from typing import Annotated

from firmware_protocols import (
    Column,
    Device,
    Frame,
    Option,
    Packets,
    Request,
    Serial,
    Transmissions,
    command,
    fact_table,
    grid_layout,
)

ROWS, COLUMNS = 4, 4

REQUEST = Frame("""
    request
    0     u1              command
""")
IMAGE = Frame("""
    image, row by row
    0     A5              start
    1     >u2 x taxels    push     raw counts
    last  sum8            check
""")


class VendorModel(Device):
    """A pad of 4 x 4 taxels that streams, and answers one request."""

    # The datasheet: `tactemu devices NAME` prints it, and `tactemu check` requires every part of it.
    name = "template"  # yours: the name in the registry, lower case with underscores
    title = "Template, a 4x4 pad"
    kind = "fingertip"  # the heading in lists of devices: or hand, glove, force-torque sensor, skin
    # Or another connector, such as Rs485, Can or Tcp; give each a name if there are several.
    ports = (Serial(baud=115200, usb=True),)
    senses = ("force",)  # the measured quantities: force, pressure, depth, displacement, touch, temperature ...
    rate_hz = 100.0
    evidence = ("assumed",)
    sources = ("no sensor: this file shows how one is written",)
    judge = "none"  # the unmodified driver that has read this device
    facts = fact_table("""
        assumed touch: everything @ nothing: it is an example
    """)

    def __init__(
        self,
        *,
        counts_per_newton: Annotated[float, Option("scale of the converter", unit="1/N", low=0.0)] = 1000.0,
    ):
        """Power up: the attributes set here are the firmware's memory, and a restart runs this again."""
        # The converter follows from the columns: scale, limits and direction. Another one overrides `measure`.
        self.columns = (Column(name="push", unit="N", counts_per_unit=counts_per_newton, low=0, high=0xFFFF, push=1),)
        self.layout = grid_layout(ROWS, COLUMNS, pitch=0.004)  # metres, link frame, normals out of the skin
        self.image = IMAGE.bind(wire_order=self.layout.wire_order, taxels=len(self.layout))
        # Cuts requests from chunks of any size, counts what is none, and tells them apart by a field.
        self.packets = Packets(REQUEST, by="command", counters=self.counters)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the frames that follow each conversion without a request. Each frame is written in one piece."""
        return [self.image.pack(push=self.counts)]

    # Every documented command, as literal bytes, on the method that answers it: `tactemu check` sends each, whole and
    # damaged. `safe`: it only reads.
    @command("3F", "A5 ..{32} ..", origin="invented", safe=True)
    def read(self, request: Request) -> bytes:
        """Return one frame."""
        return self.image.pack(push=self.counts)
