r"""Sensel Morph: a pad of force sensors that finds contacts, polled or streaming.

Wire: USB-CDC, 2C2F:0007, opened at 115200; the speed has no effect. A request is 01 (write) or 81 (read), a register
and a number of bytes. Sums are those of the data.

    request                      answer
    81 register n                ``READ``: n bytes
    81 register 00               ``VARIABLE``: a register of any length; 26 is ``HEAD``, then ``LIST``
    01 register n data sum       05 register
    01 register 00 04 size sum   07 register; then ``PACKET``: 07

Write 01 to register 25 and the frame of the next scan answers each read of 26; write 02 and frames come unasked, with
09 in place of 03; 00 stops. A ``CONTACT`` has a number for as long as it lasts, and a state: 1 begins, 2 moves, 3 ends.
Cells are read row by row. The parts of a contact beyond the first ten bytes (register 4B), buffered frames (22) and the
image, which is compressed by a method that is not public, are not modelled: 24 and 28 have contacts and acceleration.

Evidence: the vendor's driver in C, run.

Try it: ``tactemu exec sensel_morph -- ./example-2-contacts``, an example of sensel-api.
"""

import numpy as np

from firmware_protocols import (
    NO_PACKET, SOUND, USB, Column, Device, Frame, Packets, Refused, RegisterMap, Registers, Request, Rollover, Sense,
    Serial, Transmissions, command, command_table, fact_table, grid_layout, points, xyz,
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
LIST = Frame("""
    contacts
    0     00            parts      of a contact beyond the first
    1     u1            n = count(contacts)
    2     CONTACT x n   contacts
""", CONTACT=CONTACT)  # fmt: skip
PACKET = Frame("""
    data of a long write
    0     <u2           size = len(data)
    2     bytes         data
    last  sum8 from 2   sum
""")
MAP = RegisterMap("""
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
""", size=256)  # fmt: skip
SERIAL_NUMBER, FRAMES, LEDS = 0x0F, 0x26, 0x80
ANY_LENGTH = {SERIAL_NUMBER: b"SM01174600001", LEDS: bytes(24)}
CONTACTS, ACCELERATION, ACCELERATION_REGISTER = 0x04, 0x08, 0x60
ANSWER, UNASKED, WRITE_ACK, LONG_ACK = 0x03, 0x09, 0x05, 0x07
BEGIN, MOVE, END = 1, 2, 3
ROWS, COLS = 105, 185
ROW = COLS + 1
"""The distance of a cell from the one below it, among cells that are numbered with one more in each row."""
PITCH_M = 0.23 / COLS
MM_256 = 256 * PITCH_M * 1000
GRAM = 0.00980665
CHIP = points({"chip": (0.0, 0.0, -0.003)})
REQUEST_BYTES, LONG_BYTES, GAP_NS = 3, 9, 100_000_000
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
    documented = command_table(
        """
        ? magic                81 00 06           01 00 06 00 53 33 4E 53 33 31 8B
        ? scale of positions   81 A0 01           01 A0 01 00 08 08
        ? serial number        81 0F 00           03 0F 00 0D 00 53 4D 30 31 31 37 34 36 30 30 30 30 31 *
        ? LEDs                 81 80 00           03 80 00 18 00 *
        scan                   01 25 01 01 01     05 25
        scan and send frames   01 25 01 02 02     05 25
        a frame                01 25 01 01 01; 81 26 00  -          after the next scan
        250 scans a second     01 20 02 FA 00 FA  05 20
        reset                  01 E0 01 01 01     05 E0
        """,
        origin=origin,
    )
    facts = fact_table(f"""
        stated touch: a contact has number, state, x, y, force and area; its scales are 2 to the power of a register @
            {API} sensel-lib/src/sensel_protocol.h; sensel.c:186-251
        assumed touch: 105 rows of 185 cells on 230 x 130 mm; x points right, y down; positions are in 1/256 mm, forces
            in 1/8 g, areas in cells @ {ALL}
        assumed touch: cells above the least force that share a side form one contact; a contact that shares a cell with
            an earlier one continues it; the end of a contact repeats its last values @ {ALL}
        assumed touch: acceleration is three int16, 16384 counts per g (the driver gives no scale) @ {ALL}
        stated identity: register 00 reads S3NS31; the serial number has 13 characters @ {API}
            sensel-lib/src/sensel_serial_linux.c:387
        assumed identity: firmware 0.19.298, device 1; the serial number @ {ALL}
        stated configuration: the registers and their sizes; four kinds of answers @ {API}
            sensel-lib/src/sensel_register_map.h
        assumed configuration: the defaults of the registers; 24 LEDs of one byte each, 100 at most; 16 contacts @ {ALL}
        assumed configuration: a wrong sum, an unknown register or a value out of range gets no answer; an incomplete
            request is discarded after 100 ms @ {ALL}
        assumed timing: 125 scans a second, or the rate in register 20 @ {ALL}
    """)

    def __init__(self):
        self.layout = grid_layout(ROWS, COLS, PITCH_M, name="pad")
        self.packets = Packets(b"", _size, _check, counters=self.counters, gap_ns=GAP_NS)
        self.reset()

    def reset(self) -> None:
        """Return to the settings at power-up."""
        self.registers, self.any_length = Registers(MAP), dict(ANY_LENGTH)
        self.number, self.asked = 0, 0
        self.contacts: dict[int, dict[str, int]] = {}
        self.ended: list[dict[str, int]] = []
        self.owners = np.full(ROWS * ROW, -1)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Find the contacts of this scan while scanning; send them if asked for, or unasked."""
        if not self.registers["scan"]:
            return ()
        self._find()
        (self.registers["acceleration"],) = self.counts["acceleration"]
        content = self.registers["content"]
        frame = HEAD.pack(content=content, number=self.number, time=t_ns // 1_000_000)
        if content & CONTACTS:
            frame += LIST.pack(contacts=[*self.contacts.values(), *self.ended])
        if content & ACCELERATION:
            frame += self.registers.read(ACCELERATION_REGISTER, 6)
        self.number, asked, self.asked = (self.number + 1) & 0xFF, self.asked, 0
        kinds = [ANSWER] * asked + [UNASKED] * (self.registers["scan"] == 2)
        return [VARIABLE.pack(kind=kind, register=FRAMES, data=frame) for kind in kinds]

    def _find(self) -> None:
        """Set the contacts: connected cells, each with the number of the contact that it goes on from."""
        force = np.pad(self.layout.on_wire(self.counts["force"]).reshape(ROWS, COLS), ((0, 0), (0, 1))).ravel()
        labels = _connected(force > 0)
        totals = np.bincount(labels, force, len(force) + 1)[:-1]
        owners, last, self.owners, self.contacts = self.owners, self.contacts, np.full(len(force), -1), {}
        for label in np.flatnonzero(totals >= max(1, self.registers["min_force"])):
            at, total = np.flatnonzero(labels == label), totals[label]
            known = next((n for n in owners[at].tolist() if n >= 0 and n not in self.contacts), None)
            free = (n for n in range(self.registers["max_contacts"]) if n not in self.contacts and n not in last)
            if (number := next(free, None) if known is None else known) is None:
                continue
            y, x = (round(float((each + 0.5) @ force[at] / total * MM_256)) for each in np.divmod(at, ROW))
            places = {"x": x, "y": y, "force": min(int(total), 0xFFFF), "area": len(at)}
            self.owners[at] = number
            self.contacts[number] = {"number": number, "state": BEGIN if known is None else MOVE, **places}
        self.ended = [{**last[n], "state": END} for n in last if n not in self.contacts]

    @command(pattern=b"\x81(.)\0")
    def read_any(self, request: Request):
        """Return a register of any length; a frame follows the next scan."""
        if (register := request.value[0]) == FRAMES and self.registers["scan"]:
            self.asked += 1
            return ()
        if register not in self.any_length:
            raise Refused("address")
        return VARIABLE.pack(kind=ANSWER, register=register, data=self.any_length[register])

    @command(pattern=b"\x81(.)(.)")
    def read_registers(self, request: Request):
        """Return bytes of registers."""
        (register,), (size,) = request.values
        return READ.pack(register=register, data=self.registers.read(register, size))

    @command(("01 80 00 04 18 00 00 00 18", "18 00 64 " + "00 " * 23 + "64"), ("07 80", "07"), name="first LED on")
    @command(pattern=b"\x01(.)\0\x04(..)\0\0.")
    def write_any(self, request: Request):
        """Acknowledge, and wait for the packet."""
        register, size = request.value[0], int.from_bytes(request.values[1], "little")
        if register != LEDS or size != len(self.any_length[LEDS]):
            raise Refused("address")
        assert isinstance(self.packets, Packets)
        self.packets.expect(size + 3)
        return bytes([LONG_ACK, register])

    def staged(self, request: Request) -> Transmissions[bytes]:
        """Take the packet."""
        if (fields := PACKET.unpack(request.packet)) is None:
            raise Refused("value")
        self.any_length[LEDS] = fields["data"]
        return (bytes([LONG_ACK]),)

    @command(pattern=b"\x01(.)(.)(.+).")
    def write_registers(self, request: Request):
        """Write registers."""
        (register,), _, data = request.values
        if "reset" in self.registers.write(register, data):
            self.reset()
        self.period_ns = round(1e9 / self.registers["rate"])
        return bytes([WRITE_ACK, register])


def _connected(pressed: np.ndarray) -> np.ndarray:
    """Return a label for each cell: the number of one of those that it is connected with by sides; else the length."""
    labels, before = np.where(pressed, np.arange(len(pressed)), len(pressed)), np.array(())
    while not np.array_equal(labels, before):
        before = labels.copy()
        for step in (1, ROW):
            np.minimum(labels[step:], before[:-step], out=labels[step:], where=pressed[step:])
            np.minimum(labels[:-step], before[step:], out=labels[:-step], where=pressed[:-step])
        labels[pressed] = labels[labels[pressed]]
    return labels


def _size(data: bytes) -> int | str:
    """Return the length of the request that begins these bytes."""
    if data[0] not in (0x01, 0x81):
        return NO_PACKET
    if len(data) < REQUEST_BYTES or data[0] == 0x81:
        return REQUEST_BYTES
    return data[2] + 4 if data[2] else LONG_BYTES


def _check(packet: bytes) -> str:
    """Return the fault of a request: a write ends with the sum of its data."""
    data = packet[3 if packet[2] else 4 : -1]
    return SOUND if packet[0] == 0x81 or sum(data) & 0xFF == packet[-1] else "bad_checksum"
