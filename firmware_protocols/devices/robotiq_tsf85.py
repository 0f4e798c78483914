r"""Robotiq TSF-85: the two tactile fingertips of a 2F-85 gripper behind one USB hub.

Wire: USB-CDC (16D0:14CC), opened at 115200 8N1; the speed has no effect. Both directions have one packet format.

    command  data         about
    61       -            one reading
    58       period [ms]  autosend, synchronous; 00 stops
    59       period [ms]  autosend, asynchronous; 00 stops
    E3       -            firmware version, ASCII
    E2       -            bootloader; hardware leaves the port and comes back as HID 04B4:B71D

A reading describes itself: fields of one type byte (type in the high nibble, finger in bits 3..2, index in bits 1..0)
and big-endian values. A driver that meets an unknown type has lost the rest of the packet.

    type  values     content
    10    28 uint16  static, 7 rows x 4 columns, row-major
    20    1 int16    dynamic
    30    3 int16    acceleration
    40    3 int16    angular velocity
    50    3 int16    magnetometer (sent by option only: the vendor's viewer loses the fields behind it)
    60    1 int16    temperature
    70    1 uint64   timestamp [us]

All values are raw counts: no source gives a unit. On open, the vendor's Python sets DTR, clears RTS, sends E3 and 58.
Hardware sends up to 1000 packets a second, in which the static counts change 60 times a second; in this model with each
packet (option ``static_hz``).

Try it: ``tactemu run robotiq_tsf85``, then ``RobotiqTactileSensor(port=...).configure(update_period_ms=10)``.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    MORE, USB, Column, Counts, CountsPerNewton, Device, Frame, Layout, Option, Packets, Reading, Request, Restart,
    Sense, Serial, Transmissions, command, fact_table, grid_layout, int16, place, points, stack,
)  # fmt: skip

PACKET = Frame("""
    packet, either direction
    0    9A       start
    1    u1       crc8           00: of command, length, data by the vendor's comment; neither driver computes it
    2    u1       command        an answer repeats it
    3    u1       length = len(data)
    4    bytes    data
""")
ANSWER = PACKET.bind(crc8=0)
DATA_BYTES = {0x58: 1, 0x59: 1, 0x61: 0, 0xE2: 0, 0xE3: 0}

FINGERS = 2
ROWS = 7
COLS = 4
PITCH_M = 0.005
OPENING_M = 0.085
PAD_HEIGHT_M = 0.06

COUNTS_PER_MS2 = 16384 / 9.80665
COUNTS_PER_RAD_S = 131 * 180 / np.pi
COUNTS_PER_DEG_C = 100

VENDOR = "robotiq/tactile_sensors@8cb0219"
PROTOCOL = f"{VENDOR} sensor_quickstart/protocol.py"
QUICK = f"{VENDOR} sensor_quickstart/quick_connect.py"
ALL = (
    "sensor_quickstart/*.py, web/app.js, sdk_cpp/*, firmware/bootloader_host.py, all READMEs, pyrobotiqtactile (whole)"
)
CHIPS = points({"finger 0": (-OPENING_M / 2, 0.0, PAD_HEIGHT_M), "finger 1": (OPENING_M / 2, 0.0, PAD_HEIGHT_M)})


class RobotiqTsf85(Device):
    """Two 7 x 4 fingertips with inertial sensors; silent until a driver requests a reading or autosend."""

    name = "robotiq_tsf85"
    title = "Robotiq TSF-85 tactile fingertips"
    kind = "fingertip"
    ports = (Serial(baud=115200, usb=USB(0x16D0, 0x14CC)),)
    senses = ("force", *(Sense(each, at=CHIPS) for each in ("temperature", "acceleration", "angular_velocity")))
    evidence = ("driver",)
    sources = (
        f"{VENDOR} sensor_quickstart, sdk_cpp, firmware (the vendor's own)",
        "pyrobotiqtactile 0.1.2",
    )
    judge = f"pyrobotiqtactile 0.1.2, {VENDOR}"
    origin = f"{PROTOCOL} l.18-22, 119-125"
    documented_with = ("counts_per_newton", "baseline", "static_hz")
    facts = fact_table(f"""
        stated touch: the fields and their types, big-endian @ {PROTOCOL}:172-250
        stated touch: 7 rows of 4 taxels, row by row, beginning at the top left @ {VENDOR} sdk_cpp/README.md:132-143
        assumed touch: the pitch is 5 mm; the pads are 85 mm apart and 60 mm above the palm; row 0 is at the fingertip @
            {ALL}
        assumed touch: static values have 2000 counts/N, with 1000 at rest; the dynamic value is the change of the
            finger's static sum, divided by 16 @ {ALL}
        stated touch: an accelerometer at rest reads 44, 16244, 728 @ {VENDOR} sdk_cpp/README.md:70
        assumed touch: hence 16384 counts per g; which of its axes points up is our choice @ {ALL}
        assumed touch: 131 counts per deg/s, 100 counts per deg C; the magnetometer reads 0 @ {ALL}
        stated identity: USB ids 16D0:14CC, on older sensors 04B4:F232 @ {QUICK}:39-42
        stated identity: the answer to E3 is ASCII text @ {PROTOCOL}:112-116
        stated identity: 1.1.8 is the latest firmware @ {VENDOR} firmware/bootloader_host.py:51
        assumed identity: the answer has the version only @ {ALL}
        stated configuration: command 58 with 0 stops the stream @ {QUICK}:255-262
        stated configuration: command E2 starts the HID bootloader @ {VENDOR} firmware/bootloader_host.py:41-42, 419-436
        assumed configuration: in the model E2 restarts the firmware @ {ALL}
        stated configuration: the CRC-8 byte of a request is 00 @ {PROTOCOL}:90
        assumed configuration: this byte is not checked; 58 and 59 start the same stream and get no answer; requests of
            other lengths are skipped @ {ALL}
        assumed configuration: one packet has both fingers; drivers also accept a packet for each @ {ALL}
        stated timing: packets come at 1 kHz, static counts change at 60 Hz @ {VENDOR} README.md:5-6
        stated timing: the timestamp has 8 bytes, in older firmware 2 @ {QUICK}:80, 562
        stated timing: the timestamp counts microseconds @ {QUICK}:746-748
        assumed timing: static counts change with each packet (option static_hz=60 makes them change at 60 Hz) @ {ALL}
    """)

    def __init__(
        self,
        *,
        packets: Annotated[
            Literal["together", "per_finger"],
            Option("both fingers in one packet or one each: drivers accept both, no source says which hardware sends"),
        ] = "together",
        magnetometer: Annotated[bool, Option("send field 50 (the vendor's viewer loses the fields behind it)")] = False,
        counts_per_newton: CountsPerNewton = 2000.0,
        baseline: Annotated[
            int, Option("static counts at rest; drivers subtract their own", low=0, high=0xFFFF)
        ] = 1000,
        version: Annotated[str, Option("ASCII answer to E3")] = "1.1.8",
        static_hz: Annotated[
            float, Option("rate of the static counts; hardware: 60; 0: each packet", unit="Hz", low=0)
        ] = 0.0,
    ):
        self.columns = (
            Column(name="static", low=0, high=0xFFFF, rest=baseline, assumed_per_unit=counts_per_newton, push=1),
        )
        self.together, self.magnetometer, self.version = packets == "together", magnetometer, version.encode("ascii")
        self.layout = stack(*(_finger(k, side) for k, side in enumerate((-1.0, 1.0))))
        self.packets = Packets(PACKET, _size, by="command", counters=self.counters)
        self.autosend: int | None = None
        self.counts = self.shown = self.now = np.full(len(self.layout), baseline)
        self.hold_ns, self.due_ns = round(1e9 / static_hz) if static_hz else 0, 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return static counts, uint16 range, shape ``(56,)``: finger 0 row by row, then finger 1."""
        before, self.now = self.now, super().measure(reading, t_ns)["force"]
        self.counts = self.shown
        if t_ns >= self.due_ns:
            self.counts = self.shown = self.now
            self.due_ns = (t_ns // self.hold_ns + 1) * self.hold_ns if self.hold_ns else 0
        static = self.layout.on_wire(self.counts).reshape(FINGERS, -1).astype(">u2")
        change = (self.now - before).reshape(FINGERS, -1).sum(axis=1)
        chips = np.hstack([
            reading["acceleration"] * COUNTS_PER_MS2,
            reading["angular_velocity"] * COUNTS_PER_RAD_S,
            np.zeros((FINGERS, 3)),
            reading["temperature"][:, None] * COUNTS_PER_DEG_C,
        ])  # fmt: skip
        time = (t_ns // 1000).to_bytes(8, "big")
        self.fields = [
            self._fields(
                k, static[k].tobytes(), int16(change[k] / 16), *map(int16, np.split(chips[k], (3, 6, 9))), time
            )
            for k in range(FINGERS)
        ]
        return self.counts

    def _fields(self, finger: int, *values: bytes) -> bytes:
        """Return the fields of one finger, with their type bytes."""
        typed = zip(range(0x10, 0x80, 0x10), values)
        return b"".join(
            bytes([kind | finger << 2]) + value for kind, value in typed if kind != 0x50 or self.magnetometer
        )

    def _reading(self, command: int) -> list[bytes]:
        contents = [b"".join(self.fields)] if self.together else self.fields
        return [ANSWER.pack(command=command, data=data) for data in contents]

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the reading as autosend packets; nothing while autosend is off."""
        return () if self.autosend is None else self._reading(self.autosend)

    @command("9A 00 E3 00", "9A 00 E3 05 31 2e 31 2e 38", name="version", safe=True)
    def get_version(self, request: Request):
        """Return the version."""
        return [ANSWER.pack(command=request.command, data=self.version)]

    @command("9A 00 61 00", "9A 00 61 AC 10 ..{171}", safe=True)
    def read_once(self, request: Request):
        """Return a reading."""
        return self._reading(request.command)

    @command("9A 00 58 01 0A", name="autosend synchronous, 10 ms", data="B")
    @command("9A 00 59 01 0A", name="autosend asynchronous, 10 ms")
    @command("9A 00 58 01 00", name="stop")
    def start(self, request: Request):
        """Send readings unasked, or no more."""
        self.autosend = request.command if request.value else None
        if request.value:
            self.period_ns = request.value * 1_000_000
        return ()

    @command("9A 00 E2 00", about="restarts the firmware")
    def bootloader(self, request: Request):
        """Restart, as if a bootloader began."""
        return [Restart()]


def _size(data: bytes) -> int | str:
    """Return the length of the command at the start of ``data`` [bytes], or the counter of its error."""
    if len(data) < 4:
        return MORE
    if data[2] not in DATA_BYTES:
        return "unknown_command"
    return 4 + data[3] if data[3] == DATA_BYTES[data[2]] else "bad_length"


def _finger(k: int, side: float) -> Layout:
    """Return the pad of a finger, at the side -1 or 1 of the opening along x; it faces the other, and points to +z."""
    pad = grid_layout(ROWS, COLS, PITCH_M, name=f"finger {k}", link="left" if k == 0 else "right")
    x_axis, normal = (0.0, -side, 0.0), (-side, 0.0, 0.0)
    return place(pad, (side * OPENING_M / 2, 0.0, PAD_HEIGHT_M), x_axis=x_axis, normal=normal)
