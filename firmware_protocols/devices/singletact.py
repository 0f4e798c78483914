"""SingleTact: one capacitive pad that measures force, behind its USB board or an Arduino, or itself on I2C.

Wire: USB serial, 115200. The board only answers, ``ANSWER`` to ``REQUEST``: operation 01 reads ``count`` bytes of a
memory, 02 writes ``data`` into it, 04 a calibration, 03 switches pins. Hosts append a 16th byte, 00, to a request to
read.

    location  content
    0..127    ``SETTINGS``, then zeros; hosts read them as four times 32 bytes
    128..133  ``DATA``
    134..191  zeros

512 counts are the range of the pad (10 N here) at a scaling of 100. A write of settings is answered when they are in
flash, 50 ms later, and makes the present force 255: so hosts tare. From firmware 2 to 254 its last byte is the sum of
the others; one with a wrong sum has no effect. The pad answers to address 4, too.

The board's answer for another address comes after 100 ms, with the old contents of its buffer; answers without data
have the time of the last read. Hosts move DTR and RTS when they open, to restart an Arduino, and wait for 2 s.

Without a board (``board=none``) the pad is a target on I2C. It reads from the location that ``01 location count`` has
named, else from 128, and writes ``02 location count data FF``. What else is written to it has no effect.

Try it: ``tactemu run singletact``, then send FF FF FF FF 04 64 01 01 80 06 FF FE FE FE FE.
"""

from typing import Annotated, Any, Literal

from firmware_protocols import (
    MORE, SOUND, USB, Column, Counts, CountsPerNewton, Device, Frame, I2c, Option, Packets, Reading, Refused, Request,
    Rollover, Sent, Serial, Transmissions, command, command_table, fact_table, points, quantize,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     FF FF FF FF     head
    4     u1              address    on the I2C behind the board
    5     u1              timeout    usually 64
    6     u1              id         the answer repeats it
    7     u1              operation  01 read, 02 write, 03 switch, 04 calibrate
    8     u1              location
    9     u1              count
    10    bytes           data       none in a read
    ..    FF FE FE FE FE  tail
""")
ANSWER = Frame("""
    answer
    0     u1 x 4          head       AA from the USB board, FF from an Arduino
    4     u1              address
    5     00              timeout
    6     u1              id
    7     >u4 wrap        time       [0.1 ms]
    11    u1              count = len(data)
    12    bytes           data       of a read
    ..    FE FE FE FE     tail
""")
DATA = Frame("""
    reading
    0     >u2             iteration
    2     >u2 wrap        time       [0.1 ms]
    4     >u2             value      255: no force
""")
SETTINGS = Frame("""
    settings as delivered
    0     u1              address
    1     00 00           hardware
    3     >u2             serial
    5     05              accumulator
    6     05              gain       5: a pad of 1, 10 or 100 N; 1: of 4.5, 45 or 450 N
    7     u1              firmware
    8     00 00           discharge  timer and output current
    10    >u2             scaling    100: factor 1
    12    01              elements
    13    01              calibrated
    14    00              unused
""")
READ, WRITE, SWITCH, CALIBRATE = OPERATIONS = 1, 2, 3, 4
REQUEST_BYTES = 15
MAX_READ_BYTES = 61
MAX_WRITE_BYTES = 28
MEMORY_BYTES = 192
DATA_LOCATION = 128
WRITABLE_BYTES = 128
SCALING_BYTES = slice(10, 12)
UNITY_SCALING = 100
FLASH_WRITE_NS = 50_000_000
NO_PAD_NS = 100_000_000
TICK_NS = 100_000
HEAD_BYTES = {"usb": 0xAA, "arduino": 0xFF}
USB_PRODUCT_IDS = {"usb": 0x8036, "arduino": 0x0043}
BROADCAST = 4
"""The address to which all pads answer."""
TAIL = b"\xfe" * 4
FILLER = b"\0"
"""The byte that hosts append to a request to read; the board drops it."""
REST_COUNTS = 255
MAX_COUNTS = 1023
NET = "SingleTact/NETInterface@30c0e82"
PYTHON = "philip-long/singletact-python-wrapper@659796f"
FIRMWARE = "SingleTact/WinAppArduinoInterface@5e9c026"
ROS2 = "matteogrisenti/SingleTact_ROS2_Package@5296909"
UNO = "SingleTact/StandaloneArduino@ba3b878"
PI = "SingleTact/RaspberryPiDemo@f3c2357 pps-singletact.py"
ALL = "SingleTactDemo.ino, SingleTactLibrary/*.cs, Demo/GUI.cs, pps-singletact.py, both Python drivers (all whole)"
OVER_I2C = command_table(
    """
    ? reading              09 00 00 00 06           ..{6}
    read request           08 01 00 20
    write of the baseline  08 02 29 02 00 00 FF
    """,
    origin=f"{UNO} SingleTactDemo.ino, {PI}:397-405",
)
OVER_USB = command_table(
    f"""
    ? reading           FF FF FF FF 04 64 01 01 80 06 FF        ..{{4}} 04 00 01 ..{{4}} 06 ..{{6}}
    ? settings from 0   FF FF FF FF 04 64 02 01 00 20 FF        ..{{4}} 04 00 02 ..{{4}} 20 ..{{32}}
    ? settings from 32  FF FF FF FF 04 64 03 01 20 20 FF        ..{{4}} 04 00 03 ..{{4}} 20 ..{{32}}
    ? settings from 64  FF FF FF FF 04 64 04 01 40 20 FF        ..{{4}} 04 00 04 ..{{4}} 20 ..{{32}}
    ? settings from 96  FF FF FF FF 04 64 05 01 60 20 FF        ..{{4}} 04 00 05 ..{{4}} 20 ..{{32}}
    write two settings  FF FF FF FF 04 64 06 02 10 02 12 34 FF  ..{{4}} 04 00 06 ..{{4}} 00
    switch all pins     FF FF FF FF 04 64 07 03 08 10 {"07 " * 16}FF  ..{{4}} 04 00 07 ..{{4}} 00
    calibration         FF FF FF FF 04 64 08 04 00 10 {"00 FF " * 8}FF  ..{{4}} 04 00 08 ..{{4}} 00
    """,
    tail="FE FE FE FE",
    origin=f"{PYTHON} singletact_library.py",
)


class Requests(Packets):
    """The cutter of requests to the board, which drops a filler behind them."""

    def fields(self, content: bytes) -> dict[str, Any] | None:
        """Return a request by field."""
        return super().fields(content.removesuffix(FILLER))


class SingleTact(Device):
    """One pad, which a driver polls."""

    name = "singletact"
    kind = "fingertip"
    title = "SingleTact, one pad"
    columns = (Column(name="value", low=0, high=MAX_COUNTS, rest=REST_COUNTS, push=1),)
    rollovers = (
        Rollover(name="iteration", bits=16, state="iteration"),
        Rollover(name="time", bits=32, step=10_000, clock=True, state="clock_ticks"),
    )
    evidence = ("firmware", "driver")
    sources = (
        f"{FIRMWARE} SingleTactDemo.ino (the Arduino's firmware; the vendor's own)",
        f"{NET} SingleTactLibrary (the vendor's own)",
        f"{PI} (the data; the vendor's own)",
        f"{UNO} SingleTactDemo.ino, SingleTactAddressChange.ino (I2C; the vendor's own)",
        f"{PYTHON} singletact_library.py",
        f"{ROS2} SingleTactInterface.py, SingleTactPortDriver.py",
    )
    judge = f"{PYTHON}, {ROS2}, i2cdriver 1.0.6"
    documented_with = None
    facts = fact_table(f"""
        stated touch: a value of 255 means no force; values are sent high byte first @ {PI}:303-305
        stated touch: 512 counts are the full range @ {NET} SingleTact Demo/GUI.cs:241, 281
        stated touch: ranges of 1, 10, 100 or 4.5, 45, 450 N @ {NET} SingleTact Demo/GUI.cs:122-140
        assumed touch: the range is 10 N; the pad is 8 mm wide; values saturate at 0 and 1023 @ {ALL}
        stated touch: the six bytes are frame index, time and value @ {PI}:303-305
        stated identity: USB ids 2341:8036 are the USB board; other products of vendor 2341 are an Arduino @ {NET}
            ComPortFinder.cs:42-51
        assumed identity: an Arduino Uno, 2341:0043 @ {ALL}
        stated identity: an answer of the USB board begins with AA @ {NET} ArduinoSingleTactDriver.cs:359-362
        assumed identity: its three other header bytes are as one driver expects them @ {ALL}; {ROS2} reads AA AA
        stated identity: the addresses of serial number, firmware and gain @ {NET} SingleTactSettings.cs:19-34
        assumed identity: serial number 1, firmware 1, timer and current 0 @ {ALL}
        stated configuration: settings are in flash; writing it takes 50 ms @ {NET} ArduinoSingleTactDriver.cs:132
        stated configuration: a write of settings tares @ {NET} SingleTact.cs:210-214
        stated configuration: with firmware 2 to 254 the last byte is a sum @ {NET} SingleTact.cs:70-82
        assumed configuration: a request with a wrong sum is answered but not obeyed; the tare is lost at power-off @
            {ALL}
        stated configuration: scaling is at least 100 @ {NET} SingleTact Demo/GUI.cs:193-195
        assumed configuration: values are multiplied by the scaling, of which 100 is a factor of 1 @ {ALL}
        stated configuration: the addresses 0 to 191 are valid @ {NET} ArduinoSingleTactDriver.cs:239
        stated configuration: every sensor answers to address 4 @ {NET} SingleTact.cs:217
        stated configuration: commands 03 and 04 are answered without data @ {FIRMWARE} SingleTactDemo.ino:317-410
        stated configuration: a request to another address is answered with the previous content of the buffer @
            {FIRMWARE} SingleTactDemo.ino:277-302
        assumed configuration: the USB board behaves like the Arduino; addresses above 191 get no answer @ {ALL}
        stated configuration: on I2C, a read without a request begins at location 128 @ {PI}:295-300
        stated configuration: on I2C, a request to read is 01, location, count @ {UNO} SingleTactDemo.ino:57-65
        stated configuration: on I2C, a write is 02, location, count, data, FF @ {UNO} SingleTactAddressChange.ino:52-61
        assumed configuration: on I2C, other writes have no effect; nothing waits for the flash @ {ALL}; {UNO} (whole)
        stated configuration: DTR restarts an Arduino, for 2 s; in the model it has no effect @ {NET}
            ArduinoSingleTactDriver.cs:63-67
        stated timing: the clock counts 0.1 ms @ {FIRMWARE} SingleTactDemo.ino:114; {NET} SingleTact.cs:184
        stated timing: a write repeats the time of the last read @ {FIRMWARE} SingleTactDemo.ino:226-266
        assumed timing: 100 conversions a second, which the frame index counts; reads take no time @ {ALL}
    """)

    def __init__(
        self,
        *,
        board: Annotated[
            Literal["usb", "arduino", "none"], Option("board between the pad and the host; none: the pad's own I2C")
        ] = "usb",
        address: Annotated[int, Option("address of the pad on the board's I2C", low=0, high=0x7F)] = 4,
        counts_per_newton: CountsPerNewton = 51.2,
        serial: Annotated[int, Option("serial number of the pad", low=0, high=0xFFFF)] = 1,
        firmware: Annotated[int, Option("version; from 2 on, settings end with a sum", low=0, high=0xFF)] = 1,
    ):
        self.layout = points({"pad": (0.0, 0.0, 0.0)}, pitch=0.008)
        self.counts_per_newton, self.firmware = counts_per_newton, firmware
        self.board, self.head = board, [HEAD_BYTES.get(board, 0)] * 4
        self.packets = Requests(REQUEST, _size, _check, by="operation", counters=self.counters)
        self.documented = OVER_I2C if board == "none" else OVER_USB
        delivered = SETTINGS.pack(address=address, serial=serial, firmware=firmware, scaling=UNITY_SCALING)
        self.settings = self.flash.get("settings", delivered.ljust(WRITABLE_BYTES, b"\0"))
        if board == "none":
            self.ports = (I2c(addresses=tuple({self.settings[0]: 0, BROADCAST: 0})),)
        else:
            self.ports = (Serial(baud=115200, usb=USB(0x2341, USB_PRODUCT_IDS[board])),)
        self.location, self.reads_from = DATA_LOCATION, DATA_LOCATION
        self.buffer = bytes(MAX_READ_BYTES + len(TAIL))
        self.iteration, self.pushed, self.zero, self.felt_ns, self.read_ns = 0, 0.0, 0.0, 0, 0
        self.clock_ticks = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the value, 0..1023, shape ``(1,)``."""
        self.iteration, self.felt_ns = (self.iteration + 1) & 0xFFFF, t_ns
        self.pushed = float(self.layout.push(reading["force"])[0])
        scale = self.counts_per_newton * int.from_bytes(self.settings[SCALING_BYTES], "big") / UNITY_SCALING
        self.counts = quantize([self.pushed - self.zero], scale, 0, MAX_COUNTS, rest=REST_COUNTS)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer requests, which arrive in chunks of any size; on I2C, each is a transaction."""
        return self._transact(data, t_ns) if self.board == "none" else super().receive(data, t_ns, port)

    def _transact(self, frame: bytes, t_ns: int) -> Transmissions:
        if (asked := I2c.asked(frame)) is not None:
            done, count = asked
            if not count:
                return ()
            if not done:
                self.reads_from, self.location, self.read_ns = self.location, DATA_LOCATION, t_ns
            first = self.reads_from + done
            return [self._memory()[first : first + count].ljust(count, FILLER)]
        operation, first, count = frame[1:4] if len(frame) >= 4 else (0, 0, 0)
        data = frame[4 : 4 + count]
        if operation == READ and first + count <= MEMORY_BYTES:
            self.location = first
        elif operation == WRITE and 0 < count == len(data) and first + count <= WRITABLE_BYTES:
            self._store(first, data)
        else:
            self.counters["refused"] += 1
        return ()

    def accepts(self, request: Request) -> bool:
        """Return True, also for a request to a pad that is not there."""
        request.here = request.address in (BROADCAST, self.settings[0])
        self.counters["other_device"] += not request.here
        return True

    @command(on=READ)
    def read(self, request: Request):
        """Return memory, or the old buffer."""
        first, end = _range(request, MAX_READ_BYTES, MEMORY_BYTES)
        self.read_ns = request.t_ns
        shown = self._memory()[first:end] if request.here else self.buffer[: request.count]
        self.buffer = shown + TAIL + self.buffer[len(shown + TAIL) :]
        return self._answer(request, shown, 0 if request.here else NO_PAD_NS)

    @command(on=WRITE)
    def write(self, request: Request):
        """Store settings."""
        first, _ = _range(request, MAX_WRITE_BYTES, WRITABLE_BYTES)
        if request.here:
            self._store(first, request.data)
        return self._done(request, FLASH_WRITE_NS)

    @command(on=(SWITCH, CALIBRATE))
    def do_nothing(self, request: Request):
        """Answer, without effect."""
        _range(request, MAX_WRITE_BYTES)
        return self._done(request, 0 if request.operation == SWITCH else FLASH_WRITE_NS)

    def _done(self, request: Request, delay_ns: int) -> Transmissions:
        self.buffer = TAIL + self.buffer[len(TAIL) :]
        return self._answer(request, b"", delay_ns if request.here else 0)

    def _answer(self, request: Request, data: bytes, delay_ns: int) -> Transmissions:
        time = self.read_ns // TICK_NS + self.clock_ticks
        answer = ANSWER.pack(head=self.head, data=data, address=request.address, id=request.id, time=time)
        return [Sent(answer, delay_ns=delay_ns)]

    def _memory(self) -> bytes:
        time = self.felt_ns // TICK_NS + self.clock_ticks
        reading = DATA.pack(iteration=self.iteration, time=time, value=int(self.counts[0]))
        return (self.settings + reading).ljust(MEMORY_BYTES, b"\0")

    def _store(self, first: int, data: bytes) -> None:
        if 2 <= self.firmware <= 254:
            data, last = data[:-1], data[-1]
            if sum(data) & 0xFF != last:
                self.counters["bad_checksum"] += 1
                return
        self.settings = self.settings[:first] + data + self.settings[first + len(data) :]
        self.flash["settings"], self.zero = self.settings, self.pushed


def _size(data: bytes) -> int | str:
    if len(data) < 10:
        return MORE
    if data[7] not in OPERATIONS:
        return "unknown_command"
    if data[7] == READ:
        return REQUEST_BYTES + data.startswith(FILLER, REQUEST_BYTES)
    return REQUEST_BYTES + data[9]


def _check(packet: bytes) -> str:
    return SOUND if REQUEST.unpack(packet.removesuffix(FILLER)) else "bad_tail"


def _range(request: Request, longest: int, last: int = 0x200) -> tuple[int, int]:
    """Return the first and the last location of a request, behind which there is no memory."""
    if not 0 < request.count <= longest or request.location + request.count > last:
        raise Refused("value")
    return request.location, request.location + request.count
