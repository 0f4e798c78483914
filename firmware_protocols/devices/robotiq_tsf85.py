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
    MORE, USB, Column, Counts, Device, Frame, Layout, Option, Packets, Reading, Restart, Sense, Serial, Transmissions,
    command_table, fact_table, grid_layout, int16, place, points, quantize, stack,
)  # fmt: skip

PACKET = Frame("""
    packet, either direction
    0    9A       start
    1    00       crc8           of command, length, data by the vendor's comment; neither driver computes it
    2    u1       command        an answer repeats it
    3    u1       length = len(data)
    4    bytes    data
""")
READ = 0x61
AUTOSEND_SYNC = 0x58
AUTOSEND_ASYNC = 0x59
BOOTLOADER = 0xE2
VERSION = 0xE3
DATA_BYTES = {READ: 0, AUTOSEND_SYNC: 1, AUTOSEND_ASYNC: 1, BOOTLOADER: 0, VERSION: 0}

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
    documented = command_table(
        """
        ? version                     E3 00     E3 05 312e312e38
        ? read once                   61 00     61 AC 10 ..{171}
        autosend synchronous, 10 ms   58 01 0A
        autosend asynchronous, 10 ms  59 01 0A
        stop                          58 01 00
        bootloader                    E2 00     -  restarts the firmware
        """,
        head="9A 00",
        origin="robotiq/tactile_sensors@8cb0219 sensor_quickstart/protocol.py l.18-22, 119-125",
    )
    documented_with = ("counts_per_newton", "baseline", "static_hz")
    facts = fact_table(f"""
        stated touch: fields, their types, big-endian @ {PROTOCOL}:172-250
        stated touch: 7 rows of 4, row-major, first at the top left @ {VENDOR} sdk_cpp/README.md:132-143
        assumed touch: 5 mm pitch; pads 85 mm apart, 60 mm above the palm, row 0 at the fingertip @ {ALL}
        assumed touch: 2000 counts/N over 1000; dynamic: change of a finger's static sum / 16 @ {ALL}
        stated touch: an accelerometer at rest reads 44, 16244, 728 @ {VENDOR} sdk_cpp/README.md:70
        assumed touch: so 16384 per g; which of its axes is up is ours @ {ALL}
        assumed touch: 131 per deg/s, 100 per deg C; the magnetometer reads 0 @ {ALL}
        stated identity: 16D0:14CC, older ones 04B4:F232 @ {QUICK}:39-42
        stated identity: E3 is answered with ASCII @ {PROTOCOL}:112-116
        stated identity: 1.1.8 is the latest firmware @ {VENDOR} firmware/bootloader_host.py:51
        assumed identity: the answer is nothing but the version @ {ALL}
        stated configuration: 58 with 0 stops @ {QUICK}:255-262
        stated configuration: E2 makes it a HID bootloader @ {VENDOR} firmware/bootloader_host.py:41-42, 419-436
        assumed configuration: here E2 restarts the firmware @ {ALL}
        stated configuration: the crc8 byte is 00 @ {PROTOCOL}:90
        assumed configuration: it is not checked; 58 and 59 stream alike, unanswered; other lengths skipped @ {ALL}
        assumed configuration: both fingers in one packet; drivers take one each, too @ {ALL}
        stated timing: 1 kHz, static counts at 60 Hz @ {VENDOR} README.md:5-6
        stated timing: a timestamp of 8 bytes, 2 in older firmware @ {QUICK}:80, 562
        stated timing: it counts microseconds @ {QUICK}:746-748
        assumed timing: static counts change with each packet, which static_hz=60 ends @ {ALL}
    """)

    def __init__(
        self,
        *,
        packets: Annotated[
            Literal["together", "per_finger"],
            Option("both fingers in one packet or one each: drivers accept both, no source says which hardware sends"),
        ] = "together",
        magnetometer: Annotated[bool, Option("send field 50 (the vendor's viewer loses the fields behind it)")] = False,
        counts_per_newton: Annotated[float, Option("scale of the static counts, along a taxel's normal")] = 2000.0,
        baseline: Annotated[
            int, Option("static counts at rest; drivers subtract their own", low=0, high=0xFFFF)
        ] = 1000,
        version: Annotated[str, Option("ASCII answer to E3")] = "1.1.8",
        static_hz: Annotated[
            float, Option("rate of the static counts; hardware: 60; 0: each packet", unit="Hz", low=0)
        ] = 0.0,
    ):
        self.columns = (Column(name="static", low=0, high=0xFFFF, rest=baseline, push=1),)
        self.together, self.magnetometer, self.version = packets == "together", magnetometer, version.encode("ascii")
        self.counts_per_newton, self.baseline = counts_per_newton, baseline
        self.layout = _two_fingers(OPENING_M)
        self.parser = Packets(PACKET.head, _size, counters=self.counters)
        self.autosend: int | None = None
        self.counts = self.now = np.full(len(self.layout), baseline)
        self.hold_ns, self.due_ns = round(1e9 / static_hz) if static_hz else 0, 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return static counts, uint16 range, shape ``(56,)``: finger 0 row by row, then finger 1."""
        before = self.now
        self.now = quantize(self.layout.push(reading["force"]), self.counts_per_newton, rest=self.baseline)
        if t_ns >= self.due_ns:
            self.counts = self.now
            self.due_ns = (t_ns // self.hold_ns + 1) * self.hold_ns if self.hold_ns else 0
        static = self.layout.on_wire(self.counts).reshape(FINGERS, -1).astype(">u2")
        change = (self.now - before).reshape(FINGERS, -1).sum(axis=1)
        chips = (
            reading["acceleration"] * COUNTS_PER_MS2,
            reading["angular_velocity"] * COUNTS_PER_RAD_S,
            np.zeros((FINGERS, 3)),
            reading["temperature"] * COUNTS_PER_DEG_C,
        )
        time = (t_ns // 1000).to_bytes(8, "big")
        self.fields = [
            self._fields(k, static[k].tobytes(), int16(change[k] / 16), *(int16(each[k]) for each in chips), time)
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
        return [PACKET.pack(command=command, data=data) for data in contents]

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the reading as autosend packets; nothing while autosend is off."""
        return () if self.autosend is None else self._reading(self.autosend)

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Answer commands, which arrive in chunks of any size; other bytes are skipped."""
        return [out for packet in self.parser.cut(data, t_ns) for out in self._answer(packet[2], packet[4:])]

    def _answer(self, command: int, data: bytes) -> Transmissions:
        if command == VERSION:
            return [PACKET.pack(command=VERSION, data=self.version)]
        if command == READ:
            return self._reading(READ)
        if command == BOOTLOADER:
            return [Restart()]
        self.autosend = command if data[0] else None
        if data[0]:
            self.period_ns = data[0] * 1_000_000
        return ()


def _size(data: bytes) -> int | str:
    """Return the length of the command at the start of ``data`` [bytes], or the counter of its error."""
    if len(data) < 4:
        return MORE
    if data[2] not in DATA_BYTES:
        return "unknown_command"
    return 4 + data[3] if data[3] == DATA_BYTES[data[2]] else "bad_length"


def _two_fingers(opening: float) -> Layout:
    """Return two pads ``opening`` [m] apart that face each other along x; the fingers point along +z."""
    left = place(
        grid_layout(ROWS, COLS, PITCH_M, name="finger 0", link="left"),
        (-opening / 2, 0.0, PAD_HEIGHT_M),
        x_axis=(0.0, 1.0, 0.0),
        normal=(1.0, 0.0, 0.0),
    )
    right = place(
        grid_layout(ROWS, COLS, PITCH_M, name="finger 1", link="right"),
        (opening / 2, 0.0, PAD_HEIGHT_M),
        x_axis=(0.0, -1.0, 0.0),
        normal=(-1.0, 0.0, 0.0),
    )
    return stack(left, right)
