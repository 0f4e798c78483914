"""Harp LoadCells: a board with eight load cells that speaks the Harp protocol.

Wire: 1000000 8N1, RTS/CTS, through an FTDI bridge. A request is a ``MESSAGE``, an answer a ``STAMPED`` with the type of
the request, plus 8 for an error: there is no such register, or it has another kind or length, or only reads.

    register  kind       about
    0         u2         1232, the board
    1 .. 7    u1         versions: hardware, assembly, core, firmware
    8, 9      u4, u2     time: seconds, and 32 us
    10        u1         operation
    12        25 bytes   name
    13        u2         serial number
    14, 15    u1         clock, offset of the time
    32        u1         1: acquisition, 0: none
    33        i2 x 8     the load cells
    48 .. 55  i2         offset of a load cell, subtracted
    90        u1         events; bit 0: a ``STAMPED`` of type 3 with register 33 after each conversion of an acquisition

Evidence: the maker's Python packages, run.

Try it: ``tactemu run harp_loadcells``, then ``LoadCells(PORT)`` of harp-loadcells.
"""

import struct

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, CountsPerNewton, Device, Frame, Packets, Reading, Refused, Request, Serial, Transmissions,
    command, fact_table, points,
)  # fmt: skip

MESSAGE = Frame("""
    request
    0     u1          type        1 read, 2 write
    1     u1          size = total - 2
    2     u1          register
    3     FF          port
    4     u1          kind        01 u1, 02 u2, 04 u4, 82 i2
    5     bytes       data
    last  sum8        sum
""")
STAMPED = Frame("""
    answer, event; load cells in their order
    0     u1          type
    1     u1          size = total - 2
    2     u1          register
    3     FF          port
    4     u1          kind        plus 10, for the time
    5     <u4 wrap    seconds
    9     <u2         ticks       [32 us]
    11    bytes       data
    last  sum8        sum
""")
LOADS = Frame("""
    loads
    0     <i2 x taxels   loads
""")
CELLS = 8
EVENT, ERROR, TIMED = 3, 8, 0x10
ACQUISITION, DATA, OFFSETS, EVENTS = 32, 33, range(48, 56), 90
FIXED = {0: "H", **dict.fromkeys(range(1, 8), "B"), 12: "25s", 13: "H", 14: "B", DATA: "8h"}
"""The registers that only read, by number, with their form for ``struct``."""
WRITABLE = {10: "B", 15: "B", ACQUISITION: "B", **dict.fromkeys(OFFSETS, "h"), EVENTS: "B"}
KINDS = {"B": 0x01, "s": 0x01, "H": 0x02, "I": 0x04, "h": 0x82}
FORMS = {**FIXED, 8: "I", 9: "H", **WRITABLE}
LIBRARY = "harp-loadcells 0.1.0a4"
PROTOCOL = "harp-protocol 0.4.0, harp-serial 0.4.0"
ALL = f"{LIBRARY}, {PROTOCOL}, all files"


class HarpLoadCells(Device):
    """A board with eight load cells."""

    name = "harp_loadcells"
    title = "Harp LoadCells, eight load cells"
    kind = "skin"
    ports = (Serial(baud=1_000_000, usb=USB(0x0403, 0x6001, node="ttyUSB")),)
    rate_hz = 1000.0
    evidence = ("driver",)
    sources = (f"{LIBRARY} harp/devices/loadcells/harpdevice.py", f"{PROTOCOL} messages.py, base.py, device.py")
    judge = LIBRARY
    origin = f"{LIBRARY}, {PROTOCOL}, run"
    facts = fact_table(f"""
        stated touch: register 33 has eight int16, low byte first @ {LIBRARY} harpdevice.py:10, 301, 397
        assumed touch: 100 counts per newton; load cells are 30 mm apart; offsets are subtracted @ {ALL}
        stated identity: the registers that all Harp devices have @ harp-protocol 0.4.0 base.py:189-204; 1232 @
            {LIBRARY} harpdevice.py:358
        assumed identity: versions, name, serial number; an FTDI bridge @ {ALL}
        stated configuration: the message types, the payload kinds, the sum over all bytes, and the time in answers @
            harp-protocol 0.4.0 messages.py
        assumed configuration: reading a register as another kind than its own is an error; the library expects this
            error for the serial number @ harp-serial 0.4.0 device.py:1284
        assumed configuration: nothing is saved; other registers are unknown; after power-up acquisition is off and the
            events are 0F @ {ALL}
        stated timing: 1000000 baud @ harp-serial 0.4.0 device.py:158
        assumed timing: 1000 conversions a second @ {ALL}
    """)

    def __init__(self, *, counts_per_newton: CountsPerNewton = 100.0):
        self.layout = points({f"cell {k}": (0.03 * k, 0.0, 0.0) for k in range(CELLS)})
        self.columns = (Column(name="load", low=-0x8000, high=0x7FFF, assumed_per_unit=counts_per_newton, push=1),)
        self.loads = LOADS.bind(wire_order=self.layout.wire_order)
        self.packets = Packets(MESSAGE, by="type", counters=self.counters, gap_ns=100_000_000)
        self.values = {number: bytes(struct.calcsize(form)) for number, form in FORMS.items()}
        versions = {0: 1232, 1: 1, 4: 1, 5: 13, 6: 1, 13: 1}
        self.values |= {number: struct.pack(f"<{FORMS[number]}", value) for number, value in versions.items()}
        self.values |= {12: b"LoadCells".ljust(25, b"\0"), EVENTS: b"\x0f"}

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the counts of the load cells, less their offsets."""
        offsets = struct.unpack("<8h", b"".join(self.values[number] for number in OFFSETS))
        self.counts = np.clip(np.asarray(super().measure(reading, t_ns)) - offsets, -0x8000, 0x7FFF)
        self.values[DATA] = self.loads.pack(loads=self.counts)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return an event, during an acquisition."""
        sends = self.values[ACQUISITION][0] and self.values[EVENTS][0] & 1
        return _stamped(EVENT, DATA, self.values[DATA], t_ns) if sends else ()

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the answer."""
        return _stamped(request.type, request.register, content, request.t_ns)

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer of an error, with the request's own data; none to another type."""
        if why == "unknown_command":
            return ()
        return _stamped(request.type | ERROR, request.register, request.data, request.t_ns, request.kind)

    @command("01 04 00 FF 02 06", "01 0C 00 FF 12 ..{6} D0 04 ..", data="*", name="board", safe=True)
    @command("01 04 21 FF 82 A7", "01 1A 21 FF 92 ..{6} ..{16} ..", name="load cells", safe=True)
    @command("01 04 0D FF 01 12", "09 0A 0D FF 11 ..{6} ..", name="serial number of another kind", safe=True)
    def read(self, request: Request) -> bytes:
        """Return a register."""
        if request.kind != KINDS.get(FORMS.get(request.register, "?")[-1]):
            raise Refused("address")
        seconds, rest = divmod(request.t_ns, 1_000_000_000)
        self.values |= {8: struct.pack("<I", seconds & 0xFFFF_FFFF), 9: struct.pack("<H", rest // 32_000)}
        return self.values[request.register]

    @command("02 05 20 FF 01 01 28", "02 0B 20 FF 11 ..{6} 01 ..", data="*", name="acquisition")
    @command("02 06 30 FF 82 0A 00 C3", "02 0C 30 FF 92 ..{6} 0A 00 ..", name="offset of a load cell")
    def write(self, request: Request) -> bytes:
        """Set a register."""
        form = WRITABLE.get(request.register, "?")
        if request.kind != KINDS.get(form) or len(request.data) != struct.calcsize(form):
            raise Refused("address")
        self.values[request.register] = request.data
        return request.data


def _stamped(kind: int, register: int, data: bytes, t_ns: int, form: int = 0) -> list[bytes]:
    seconds, rest = divmod(t_ns, 1_000_000_000)
    form = form or KINDS[FORMS[register][-1]]
    return [
        STAMPED.pack(type=kind, register=register, kind=form | TIMED, seconds=seconds, ticks=rest // 32_000, data=data)
    ]
