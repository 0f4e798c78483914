r"""Sensel Morph: a pad of force sensors that finds contacts, polled or streaming.

Wire: USB-CDC, 2C2F:0007, opened at 115200; the speed has no effect. A request is 01 (write) or 81 (read), a register
and a number of bytes. Sums are those of the data.

    request                      answer
    81 register n                ``READ``: n bytes
    81 register 00               ``VARIABLE``: a register of any length; 26 is ``HEAD``, then ``LIST``
    01 register n data sum       05 register
    01 register 00 04 size sum   07 register; then, for each packet of at most 512 bytes: size (2 bytes), data, sum: 07

Write 01 to register 25 and the frame of the next scan answers each read of 26; write 02 and frames come unasked, with
09 in place of 03; 00 stops. A ``CONTACT`` has a number for as long as it lasts, and a state: 1 begins, 2 moves, 3 ends.
Cells are read row by row. The parts of a contact beyond the first ten bytes (register 4B), buffered frames (22) and the
image, which is compressed by a method that is not public, are not modelled: 24 and 28 have contacts and acceleration.

Evidence: the vendor's driver in C, run.

Try it: ``tactemu exec sensel_morph -- ./example-2-contacts``, an example of sensel-api.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from firmware_protocols import (
    NO_PACKET, SOUND, USB, Column, Device, Frame, Packets, Refused, RegisterMap, Registers, Request, Rollover, Sense,
    Serial, Transmissions, command, fact_table, grid_layout, points, xyz,
)  # fmt: skip

READ = Frame("""
    answer to a read
    0     01            kind
    1     u1            register
    2     <u2           size = len(data)
    4     bytes         data
    last  sum8 from 4   sum
""")
VARIABLE = Frame("""
    answer to a read of any length
    0     u1            kind       3; a frame unasked: 9
    1     u1            register
    2     00            header
    3     <u2           size = len(data)
    5     bytes         data
    last  sum8 from 5   sum
""")
CONTACT = Frame("""
    contact
    0     u1            number
    1     u1            state      1 begins, 2 moves, 3 ends
    2     <u2           x          [1/256 mm], from the left
    4     <u2           y          [1/256 mm], from the top
    6     <u2           force      [1/8 g]
    8     <u2           area       [cells]
""")
HEAD = Frame("""
    frame
    0     u1            content    4: contacts, 8: acceleration; both may follow, in this order
    1     u1 wrap       number
    2     <u4 wrap      time       [ms]
""")
LIST = Frame(
    """
    contacts
    0     00            parts      of a contact beyond the first
    1     u1            n = count(contacts)
    2     CONTACT x n   contacts
""",
    CONTACT=CONTACT,
)
MAP = RegisterMap(
    """
    0    u1 x 6  magic          = 83, 51, 78, 83, 51, 49  r     S3NS31
    6    u1      protocol       = 1  r
    7    u1 x 2  version        = 0, 19  r
    9    <u2     build          = 298  r
    11   u1      release        = 1  r
    12   <u2     device         = 1  r
    14   u1      revision       = 1  r
    16   <u2     cols           = 185  r
    18   <u2     rows           = 105  r
    20   <u4     width          = 230000  r                    [um]
    24   <u4     height         = 130000  r                    [um]
    32   <u2     rate           1..1000  = 125
    34   u1      buffers        0..0
    35   u1      detail         0..2
    36   u1      content        0..12  = 4
    37   u1      scan           0..2
    40   u1      supported      = 12  r
    64   u1      max_contacts   = 16  r
    65   u1      merge          0..1  = 1
    71   <u2     min_force      = 160                          [1/8 g]
    75   u1      parts          0..0
    80   u1      baseline       0..1  = 1
    81   <u2 x 2  rates         0..65535  = 1, 1               of the baseline
    87   u1      dynamic        0..1  = 1
    96   <i2 x 3  acceleration  r
    112  u1 x 2  battery        r
    114  u1      button         r
    129  u1      led_size       = 1  r
    130  <u2     led_max        = 100  r
    132  u1      leds           = 24  r
    160  u1 x 5  shifts         = 8, 3, 0, 4, 0  r             bits of dimensions, force, area, angle, time
    208  u1      open           0..255
    224  u1      reset          0..1
    236  u1      error          r
    """,
    size=256,
)
SERIAL_NUMBER, FRAMES, LEDS = 0x0F, 0x26, 0x80
ANY_LENGTH = {SERIAL_NUMBER: b"SM01174600001", LEDS: bytes(24)}
CONTACTS, ACCELERATION, ACCELERATION_REGISTER = 0x04, 0x08, 0x60
ANSWER, UNASKED, WRITE_ACK, LONG_ACK = 0x03, 0x09, 0x05, 0x07
BEGIN, MOVE, END = 1, 2, 3
ROWS, COLS = 105, 185
PITCH_M = 0.23 / COLS
MM_256 = 256 * PITCH_M * 1000
GRAM = 0.00980665
CHIP = points({"chip": (0.0, 0.0, -0.003)})
REQUEST_BYTES, PACKET_BYTES = 3, 512
GAP_NS = 100_000_000
API = "sensel/sensel-api@ad66eab"
ALL = f"{API} sensel-lib/src (all files)"


class SenselMorph(Device):
    """A pad whose firmware finds contacts."""

    name = "sensel_morph"
    title = "Sensel Morph"
    kind = "skin"
    ports = (Serial(baud=115_200, usb=USB(0x2C2F, 0x0007)),)
    senses = ("force", Sense("acceleration", at=CHIP))
    columns = (
        Column(name="force", assumed_per_unit=8 / GRAM, low=0, high=0xFFFF, push=1),
        *xyz("ax ay az", sense="acceleration", assumed_per_unit=16384 / 9.80665, low=-0x8000, high=0x7FFF),
    )
    rate_hz = 125.0
    rollovers = (Rollover(name="number", bits=8, state="number"), Rollover(name="time", bits=32, step=1000, clock=True))
    evidence = ("driver",)
    sources = (f"{API} sensel.c, sensel_register.c, sensel_serial_linux.c, sensel_protocol.h, sensel_register_map.h",)
    judge = API
    origin = f"{API} sensel-lib/src/sensel_register.c"
    facts = fact_table(f"""
        stated touch: a contact is number, state, x, y, force, area; scales are 2 to the power of a register
            @ {API} sensel-lib/src/sensel_protocol.h; sensel.c:186-251
        assumed touch: 105 rows of 185 cells on 230 x 130 mm, x to the right, y down; 1/256 mm, 1/8 g, cells @ {ALL}
        assumed touch: cells that touch by a side are one contact, from the least force on; one that shares a cell with
            an earlier one goes on; the end has the last values @ {ALL}
        assumed touch: three int16 for gravity, 16384 per g, of which the driver knows no scale @ {ALL}
        stated identity: S3NS31 at 00; serial number of 13 characters @ {API} sensel-lib/src/sensel_serial_linux.c:387
        assumed identity: firmware 0.19.298, device 1; the serial number @ {ALL}
        stated configuration: registers, their sizes; four answers @ {API} sensel-lib/src/sensel_register_map.h
        assumed configuration: defaults of the registers; 24 LEDs of a byte, 100 at most; 16 contacts @ {ALL}
        assumed configuration: a wrong sum, another register or a value out of range gets no answer; half
            a request is discarded after 100 ms @ {ALL}
        assumed timing: 125 scans a second, or what register 20 says @ {ALL}
    """)

    def __init__(self):
        self.layout = grid_layout(ROWS, COLS, PITCH_M, name="pad")
        self.packets = Packets(b"", _size, _check, counters=self.counters, gap_ns=GAP_NS)
        self.reset()

    def reset(self) -> None:
        """Return to the settings at power-up."""
        self.registers = Registers(MAP)
        self.any_length = dict(ANY_LENGTH)
        self.number, self.awaited, self.in_size, self.written = 0, 0, False, bytearray()
        self.asked = 0
        self.contacts: dict[int, dict[str, Any]] = {}
        self.cells: dict[int, set[int]] = {}

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Find the contacts of this scan while scanning; send them if asked for, or unasked."""
        if not self.registers["scan"]:
            return ()
        self._find()
        (self.registers["acceleration"],) = self.counts["acceleration"]
        content = self.registers["content"]
        frame = HEAD.pack(content=content, number=self.number, time=t_ns // 1_000_000)
        if content & CONTACTS:
            frame += LIST.pack(contacts=list(self.contacts.values()))
        if content & ACCELERATION:
            frame += self.registers.read(ACCELERATION_REGISTER, 6)
        self.number, asked, self.asked = (self.number + 1) & 0xFF, self.asked, 0
        kinds = [ANSWER] * asked + [UNASKED] * (self.registers["scan"] == 2)
        return [VARIABLE.pack(kind=kind, register=FRAMES, data=frame) for kind in kinds]

    def _find(self) -> None:
        """Set the contacts: connected cells, each with the number of the contact that it goes on from."""
        force = self.layout.on_wire(self.counts["force"]).reshape(ROWS, COLS)
        ended = {n for n, contact in self.contacts.items() if contact["state"] == END}
        before = {n: cells for n, cells in self.cells.items() if n not in ended}
        last, self.contacts, self.cells = self.contacts, {}, {}
        for cells in _connected(force):
            rows, cols = np.divmod(np.array(sorted(cells)), COLS)
            weights = force[rows, cols]
            if (total := int(weights.sum())) < self.registers["min_force"]:
                continue
            known = next((n for n in before if n not in self.contacts and before[n] & cells), None)
            free = (n for n in range(self.registers["max_contacts"]) if n not in self.contacts and n not in before)
            if (number := next(free, None) if known is None else known) is None:
                continue
            x, y = (round(float(at @ weights) / total * MM_256) for at in (cols + 0.5, rows + 0.5))
            state = BEGIN if known is None else MOVE
            self.cells[number] = cells
            self.contacts[number] = {
                "number": number, "state": state, "x": x, "y": y, "force": min(total, 0xFFFF), "area": len(cells)
            }  # fmt: skip
        gone = {n: {**last[n], "state": END} for n in before if n not in self.contacts}
        self.contacts |= gone
        self.cells |= {n: set() for n in gone}

    @command("81 26 00", after=("01 25 01 01 01",), name="a frame, after the next scan")
    @command("81 80 00", "03 80 00 18 00 " + "00 " * 25, name="brightness of the LEDs", safe=True)
    @command("81 0F 00", "03 0F 00 0D 00 53 4D 30 31 31 37 34 36 30 30 30 30 31 *", name="serial number", safe=True)
    @command(pattern=b"\x81(.)\0")
    def read_any(self, request: Request):
        """Return a register of any length; a frame follows the next scan."""
        if (register := request.value[0]) == FRAMES and self.registers["scan"]:
            self.asked += 1
            return ()
        if register not in self.any_length:
            raise Refused("register")
        return VARIABLE.pack(kind=ANSWER, register=register, data=self.any_length[register])

    @command("81 00 06", "01 00 06 00 53 33 4E 53 33 31 8B", name="magic", safe=True)
    @command("81 A0 01", "01 A0 01 00 08 08", name="scale of positions", safe=True)
    @command(pattern=b"\x81(.)(.)")
    def read_registers(self, request: Request):
        """Return bytes of registers."""
        (register,), (size,) = request.values
        return READ.pack(register=register, data=self.registers.read(register, size))

    @command(("01 80 00 04 18 00 00 00 18", "18 00 64 " + "00 " * 23 + "64"), ("07 80", "07"), name="first LED on")
    @command(pattern=b"\x01(.)\0\x04(..)\0\0.")
    def write_any(self, request: Request):
        """Acknowledge, and wait for the packets."""
        register = request.value[0]
        self.awaited, self.written = int.from_bytes(request.values[1], "little"), bytearray()
        if register != LEDS or self.awaited != len(self.any_length[LEDS]):
            raise Refused("register")
        self.in_size = True
        self.packets.expect(2)
        return bytes([LONG_ACK, register])

    def staged(self, request: Request):
        """Take the size of a packet, then the packet."""
        if self.in_size:
            self.in_size = False
            if (size := int.from_bytes(request.packet, "little")) > min(PACKET_BYTES, self.awaited - len(self.written)):
                raise Refused("size")
            self.packets.expect(size + 1)
            return ()
        *data, check = request.packet
        if sum(data) & 0xFF != check:
            self.counters["bad_checksum"] += 1
            return ()
        self.written += bytes(data)
        if len(self.written) < self.awaited:
            self.in_size = True
            self.packets.expect(2)
        else:
            self.any_length[LEDS] = bytes(self.written)
        return bytes([LONG_ACK])

    @command("01 25 01 01 01", "05 25", name="scan")
    @command("01 25 01 02 02", "05 25", name="scan and send frames")
    @command("01 E0 01 01 01", "05 E0", name="reset")
    @command("01 20 02 FA 00 FA", "05 20", name="250 scans a second")
    @command(pattern=b"\x01(.)(.)(.+).")
    def write_registers(self, request: Request):
        """Write registers."""
        (register,), _, data = request.values
        if "rate" in (names := self.registers.write(register, data)):
            self.period_ns = round(1e9 / self.registers["rate"])
        if "reset" in names:
            self.reset()
        return bytes([WRITE_ACK, register])


def _connected(force: np.ndarray) -> Iterator[set[int]]:
    """Yield the cells of each contact: those above 0 that touch by a side; row by row, by their index."""
    cols = force.shape[1]
    left = set(np.flatnonzero(force).tolist())
    for first in sorted(left):
        if first not in left:
            continue
        left.discard(first)
        found, todo = {first}, [first]
        while todo:
            cell = todo.pop()
            col = cell % cols
            beside = ({cell - 1} if col else set()) | ({cell + 1} if col < cols - 1 else set())
            new = ({cell - cols, cell + cols} | beside) & left
            todo += new
            left -= new
            found |= new
        yield found


def _size(data: bytes) -> int | str:
    """Return the length of the request that begins these bytes."""
    if data[0] not in (0x01, 0x81):
        return NO_PACKET
    if len(data) < REQUEST_BYTES or data[0] == 0x81:
        return REQUEST_BYTES
    return data[2] + 4 if data[2] else 9


def _check(packet: bytes) -> str:
    """Return the fault of a request: a write ends with the sum of its data."""
    data = packet[3 if packet[2] else 4 : -1]
    return SOUND if packet[0] == 0x81 or sum(data) & 0xFF == packet[-1] else "bad_checksum"
