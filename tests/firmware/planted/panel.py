"""Panel: a pad of 4 x 5 taxels with registers, which streams contacts and an image.

Wire: 115200 8N1. Requests are ``REQUEST`` s. A write is sent in two stages: the board acknowledges the header, then
takes the data. All else is skipped.

Evidence: invented for the tests of ``tactemu check``.

Try it: ``tactemu check tests/firmware/planted/panel.py:Panel``.
"""

import numpy as np

from firmware_protocols import (
    Column,
    Device,
    Frame,
    Packets,
    RegisterMap,
    Registers,
    Request,
    Serial,
    assumed,
    command,
    grid_layout,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     81 7E           head
    2     u1              kind       1 read, 2 write, 3 stream
    3     u1              register
    4     <u2             value      of a write: the number of bytes
    last  sum8 from 2     sum
""")
ANSWER = Frame("""
    answer
    0     05 7E           head
    2     u1              register
    3     <u2             size = len(data)
    5     bytes           data
    last  sum8 from 2     sum
""")
CONTACT = Frame("""
    contact
    0     u1              id
    1     u1              taxel
    2     <u2             force      [mN]
""")
FRAME = Frame(
    """
    frame, row by row
    0     0A 55           head
    2     u1              n = count(contacts)
    3     u1 x taxels     image
    ..    CONTACT x n     contacts
    last  sum8 from 2     sum
    """,
    CONTACT=CONTACT,
)
MAP = RegisterMap("""
    0   <u2   rate        1..200  = 50  flash    frames a second
    2   u1    detail      0..3    = 1   flash
    4   <u2   serial      = 4660  r
    6   u1    streaming   0..1
""")
THRESHOLD_COUNTS = 25


class Panel(Device):
    """A pad with registers."""

    name = "panel"
    title = "Panel, a pad of 4x5"
    kind = "skin"
    ports = (Serial(baud=115200),)
    senses = ("force",)
    rate_hz = 50.0
    columns = (Column(name="push", unit="N", counts_per_unit=50.0, low=0, high=255, push=1),)
    evidence = ("assumed",)
    sources = ("invented",)
    origin = "written by hand"
    documented_with = None
    facts = (assumed("touch", "everything", "nothing: it is invented"),)

    def __init__(self):
        self.layout = grid_layout(4, 5, 0.004, name="pad")
        self.frame = FRAME.bind(wire_order=self.layout.wire_order)
        self.registers = Registers(MAP, kept=self.flash)
        self.packets = Packets(REQUEST, by="kind", counters=self.counters)
        self.register = 0

    def stream(self, t_ns: int, name: str):
        """Return a frame while streaming."""
        if not self.registers["streaming"]:
            return ()
        pressed = np.flatnonzero(self.counts > THRESHOLD_COUNTS).tolist()
        contacts = [{"id": k, "taxel": taxel, "force": int(self.counts[taxel]) * 20} for k, taxel in enumerate(pressed)]
        return [self.frame.pack(image=self.counts, contacts=contacts)]

    @command("81 7E 01 00 02 00 03", "05 7E 00 02 00 32 00 34", name="rate", within_ms=100)
    def read_register(self, request: Request):
        """Return the bytes of a register."""
        data = self.registers.read(request.register, request.value % 64)
        return [ANSWER.pack(register=request.register, data=data)]

    @command(["81 7E 02 00 02 00 04", "14 00"], ["05 02", "05 00"], name="20 frames a second")
    def write_register(self, request: Request):
        """Acknowledge the header; the data follow."""
        self.register = request.register
        self.packets.expect(request.value % 64 or 1)
        return [b"\x05\x02"]

    def staged(self, request: Request):
        """Store the data."""
        self.registers.write(self.register, request.packet)
        self.period_ns = round(1e9 / self.registers["rate"])
        self.flash.update(self.registers.kept())
        return [b"\x05\x00"]

    @command("81 7E 03 00 01 00 04", "05 03")
    def start(self, request: Request):
        """Start the stream."""
        self.registers["streaming"] = request.value & 1
        return [b"\x05\x03"]
