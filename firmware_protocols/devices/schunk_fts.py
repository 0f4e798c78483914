"""SCHUNK FTS: six-axis force-torque sensors with the Ethernet interface box FTS IFB-EN.

Wire: commands over TCP, port 82: ``MESSAGE`` in both directions, low byte first. An answer repeats the command; its
data begin with an error code, 00 for none, and its counter counts the answers of a connection from 1. Between the
commands 40 and 41 each ``READING`` goes to UDP port 54843 of the host, where the driver listens and sends nothing.

    command  data                    answer, behind the error code
    F0       index <u2, subindex     index, subindex, value
    F1       the same, value         index, subindex; error 10: the user may not
    10, 11   -                       nothing; no known effect
    12, 13   -                       nothing; the present force and torque become zero, or no more
    20       -                       nothing; restart
    30       tool 0..3               nothing; no effect here
    31       filter 0..4             nothing; readings are the mean of the latest 1, 2, 4, 8 or 16
    40, 41   -                       nothing; start and stop of the readings

Errors: 01 unknown command, 02 wrong length, 03 wrong value, 13 no such index, 14 no such subindex. The driver closes
the connection after 100 ms without readings and comes back each second.

Evidence: the vendor's library and ROS 2 node, its tests, and the dummy sensor that they run against.

Try it: ``tactemu run schunk_fts``, then ``Driver("127.0.0.1").streaming_on()``, ``sample()``.
"""

import numpy as np

from firmware_protocols import (
    Device, Frame, Packets, Refused, Request, Restart, Rollover, Sense, Sent, Tcp, Tool, Transmissions, Udp, command,
    fact_table, points, wrench,
)  # fmt: skip

MESSAGE = Frame("""
    message, either direction
    0     FF FF           sync
    2     <u2             counter
    4     <u2             size = len(data) + 1
    6     u1              command
    7     bytes           data
""")
READING = Frame("""
    reading
    0     FF FF           sync
    2     <u2 wrap        counter
    4     1D 00           size         29
    6     01              id
    7     <u4             status       1 ready, 16 mechanical overrange
    11    <f4 x 6         wrench       Fx Fy Fz [N], Tx Ty Tz [Nm]
""")
PARAMETERS = {b"\x01\0\0": b"FTS", b"\x01\0\3": b"\1\0\0\0", b"\x40\0\0": b"\0", b"\x50\0\0": b"\0"}
"""The values by index and subindex: name and id of the product, unknown, unit."""
NOT_ALLOWED, NO_INDEX, NO_SUBINDEX = 0x10, 0x13, 0x14
ERRORS = {"unknown_command": 0x01, "bad_length": 0x02, "refused": 0x03}
READY, OVERRANGE = 1, 16
RANGE = [1000.0] * 3 + [50.0] * 3
"""The largest force [N] and torque [Nm]."""
VENDOR = "SCHUNK-SE-Co-KG/schunk_force_torque_sensor@b0e4359"
LIBRARY = f"{VENDOR} schunk_fts_library/schunk_fts_library"
DUMMY = f"{VENDOR} schunk_fts_dummy/src"
ALL = "schunk_fts_library, schunk_fts_driver, schunk_fts_dummy, README.md (all files)"


class SchunkFts(Device):
    """A sensor behind its interface box."""

    name = "schunk_fts"
    title = "SCHUNK FTS force-torque sensor, Ethernet"
    kind = "force-torque sensor"
    ports = (Tcp(name="tcp", port=82), Udp(name="stream", port=54843, is_of_host=True))
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    rate_hz = 1000.0
    columns = wrench("Fx Fy Fz Tx Ty Tz", per_unit=(1, 1), is_float=True, low=[-each for each in RANGE], high=RANGE)
    rollovers = (Rollover(name="counter", bits=16, state="counter"),)
    boot_s = 0.1
    evidence = ("driver",)
    sources = (f"{LIBRARY}/utility.py (messages, readings), driver.py", f"{DUMMY}/sensor.rs, tcp.rs, udp.rs (answers)")
    judge = VENDOR
    origin = f"{LIBRARY}/driver.py, utility.py:268-284"
    facts = fact_table(f"""
        stated touch: six float32, low byte first, after id and status @ {LIBRARY}/utility.py:83-99
        stated touch: N and Nm @ {VENDOR} schunk_fts_library/README.md:32-37
        stated touch: the bits of the status @ {LIBRARY}/driver.py:36-56
        assumed touch: the id is 1, as in the vendor's tests (in its dummy sensor the id counts); the counter advances
            while no reading is sent; the ranges are {RANGE[0]:g} N and {RANGE[3]:g} Nm; the tool is touched at the
            point `tool`, z points out of the tool side @ {ALL}
        stated identity: parameter 0001/00 is the name, FTS or KMS; 0001/03 is the product id @
            {LIBRARY}/driver.py:123-137; {LIBRARY}/tests/test_parameters.py:24-29
        assumed identity: the four bytes of the product id @ {ALL}
        stated configuration: commands and errors @ {DUMMY}/sensor.rs:16; {VENDOR} schunk_fts_driver/
            schunk_fts_driver/driver.py:44-71; {LIBRARY}/driver.py:208-273
        stated configuration: not every user may read or write every parameter @ {LIBRARY}/tests/test_parameters.py:40
        stated configuration: each connection has its own counter of answers @ {DUMMY}/tcp.rs:13, 50
        assumed configuration: parameters 0040 and 0050 are 00; zero and filter are lost at power-off; readings stop
            when their connection closes @ {ALL}
        stated timing: ports 82 and 54843 @ {LIBRARY}/driver.py:75-77
        stated timing: 1000 readings a second @ {VENDOR} README.md:24
        assumed timing: a restart takes 0.1 s; the vendor's test waits 5 s @ {ALL}
    """)

    def __init__(self, *, tool: Tool = (0.02, 0.01, 0.05)):
        self.layout = points({"tool": tool})
        self.packets = Packets(MESSAGE, by="command", counters=self.counters, max_data=64)
        self.streaming, self.counter, self.answers, self.mean_of = False, 0, 0, 1
        self.latest: list[np.ndarray] = []

    def filtered(self, values: np.ndarray, t_ns: int) -> np.ndarray:
        """Return the mean of the latest values."""
        self.latest = [*self.latest, values][-self.mean_of :]
        return np.mean(self.latest, axis=0)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a reading, between start and stop."""
        self.counter = (self.counter + 1) & 0xFFFF
        status = READY | OVERRANGE * bool((np.abs(self.counts[0]) >= RANGE).any())
        reading = READING.pack(counter=self.counter, status=status, wrench=self.counts[0])
        return [Sent(reading, port="stream")] if self.streaming else ()

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Forget a connection that comes or goes."""
        if port != "stream":
            self.packets.reset()
            self.streaming, self.answers = False, 0
        return ()

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return an answer, whose first byte is the error."""
        self.answers = (self.answers + 1) & 0xFFFF
        return [MESSAGE.pack(counter=self.answers, command=request.command, data=content or b"\0")]

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the error."""
        return self.reply(request, bytes([ERRORS[why]]))

    @command("FF FF 00 00 04 00 F0 01 00 00", "FF FF 01 00 08 00 F0 00 01 00 00 46 54 53", safe=True, within_ms=2000)
    @command("FF FF 00 00 04 00 F0 01 00 03", "FF FF 01 00 09 00 F0 00 01 00 03 ..{4}", name="product id", safe=True)
    @command("FF FF 00 00 04 00 F0 99 99 FF", "FF FF 01 00 05 00 F0 13 99 99 FF", name="no such index", safe=True)
    def read(self, request: Request) -> bytes:
        """Return the value of a parameter."""
        return bytes([_fault(request.data)]) + request.data + PARAMETERS.get(request.data, b"")

    @command("FF FF 00 00 05 00 F1 50 00 00 00", "FF FF 01 00 05 00 F1 10 50 00 00", data="<HB*")
    def write(self, request: Request) -> bytes:
        """Refuse to set a parameter."""
        return bytes([_fault(request.data[:3]) or NOT_ALLOWED]) + request.data[:3]

    @command("FF FF 00 00 01 00 40", "FF FF 01 00 02 00 40 00", name="start")
    @command("FF FF 00 00 01 00 41", "FF FF 01 00 02 00 41 00", name="stop")
    @command("FF FF 00 00 01 00 10", "FF FF 01 00 02 00 10 00", name="10")
    @command("FF FF 00 00 01 00 11", "FF FF 01 00 02 00 11 00", name="11")
    @command("FF FF 00 00 01 00 12", "FF FF 01 00 02 00 12 00", name="tare")
    @command("FF FF 00 00 01 00 13", "FF FF 01 00 02 00 13 00", name="no tare")
    def execute(self, request: Request) -> None:
        """Start, stop, tare or undo it."""
        if request.command in (0x40, 0x41):
            self.streaming = request.command == 0x40
        elif request.command in (0x12, 0x13):
            self.zero = self.present if request.command == 0x12 else 0.0

    @command("FF FF 00 00 01 00 20", "FF FF 01 00 02 00 20 00")
    def restart(self, request: Request) -> Transmissions:
        """Answer and restart."""
        return [*self.reply(request, b""), Restart()]

    @command("FF FF 00 00 02 00 30 03", "FF FF 01 00 02 00 30 00", name="tool 3", data="B")
    @command("FF FF 00 00 02 00 31 04", "FF FF 01 00 02 00 31 00", name="mean of 16")
    @command("FF FF 00 00 02 00 31 05", "FF FF 01 00 02 00 31 03", name="no such filter")
    def select(self, request: Request) -> None:
        """Select a tool, or the length of the mean."""
        if request.value > (3 if request.command == 0x30 else 4):
            raise Refused("value")
        if request.command == 0x31:
            self.mean_of = 1 << request.value


def _fault(place: bytes) -> int:
    """Return the error of an index and a subindex."""
    if place in PARAMETERS:
        return 0
    return NO_SUBINDEX if any(place[:2] == each[:2] for each in PARAMETERS) else NO_INDEX
