"""Weiss WTS: a tactile matrix with a controller of its own, which a driver polls or which streams.

Wire: a virtual COM port on USB, which drivers open at 115200. ``MESSAGE`` in both directions, little-endian; unlike in
a DSACON32m, the CRC is always there and includes the preamble. An answer repeats the id and begins with a status,
0; a pushed frame has id 00 and no status.

    id  payload              answer, behind the status
    06  any                  the same
    20  flags, or nothing    ``FRAME``, the next one
    21  flags, ms 2 bytes    nothing; then frames with id 00 at this period, with 0 at that of the scans
    22  -                    nothing; no more frames
    23  flags, or nothing    nothing; what is measured now becomes zero, with 00 no zero
    30  -                    ``MATRIX``
    34  threshold 2 bytes    nothing; a texel below it reads 0
    35  -                    threshold, 2 bytes
    36  gain                 nothing
    37  -                    gain
    38  -                    type of the sensor, text
    46  -                    temperature [0.1 deg C], 2 bytes
    50  -                    ``SYSTEM``
    51  text                 nothing; the tag is kept
    52  -                    tag, text; a driver names its topic after it

Other ids are answered with the status 14, other lengths with 12 (no payload expected) or 13 (not enough).

Drivers disagree about a value: two bytes, low one first (the vendor's manual, wts_driver), or 16 times
as much, high byte first (wts-ft); an option chooses.

Try it: ``tactemu run weiss_wts``, then send AA AA AA 30 00 00 CA CF.
"""

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Frame, Option, Packets, Reading, Request, Rollover, Sense, Serial, Transmissions, command,
    command_table, fact_table, grid_layout, int16, points,
)  # fmt: skip

MESSAGE = Frame("""
    message, either direction
    0     AA AA AA         preamble
    3     u1               id
    4     <u2              size = len(payload)
    6     bytes            payload
    last  <crc16_weiss     crc
""")
FRAME = Frame("""
    frame, row by row
    0     <u4 wrap         time        [ms]
    4     00               flags
    5     bytes            values      of two bytes
""")
MATRIX = Frame("""
    matrix
    0     <u2              columns
    2     <u2              rows
    4     <u2 x 2          cell        width, height [0.01 mm]
    8     <u2              full_scale
""")
SYSTEM = Frame("""
    system
    0     01               type        a WTS; 00: unknown
    1     01               hardware
    2     00 10            firmware    1.0.0, four bits each from the highest, then its kind
    4     <u4              serial
""")
MAX_PAYLOAD_BYTES = 64
PUSHED, SINGLE = 0x00, 0x20
DONE = b"\0\0"

SCAN_PERIOD_NS = 10_000_000
PITCH_M = 0.0034
FULL_SCALE_COUNTS = 4095
BOARD = points({"board": (0.0, 0.0, -0.005)})
CPP = "ksatyaki/wts_driver@82c46ac"
PYTHON = "CNCR-NTU/wts-ft@bbb00b0"
MANUAL = "Weiss Robotics, WTS Command Set Reference Manual, March 2013"
BOTH = "wts_driver.cpp, common.cpp, serial_comm.cpp, wts_ft_interface.py (all whole)"


class WeissWts(Device):
    """One matrix of texels, which a driver polls or which streams."""

    name = "weiss_wts"
    kind = "fingertip"
    ports = (Serial(baud=115200, usb=True),)
    senses = ("force", Sense("temperature", at=BOARD))
    rate_hz = 1e9 / SCAN_PERIOD_NS
    rollovers = (Rollover(name="time", bits=32, step=1000, clock=True, state="clock_ms"),)
    evidence = ("driver",)
    sources = (
        f"{CPP} src/wts_driver.cpp, src/common.cpp (ids, status, CRC, answers)",
        f"{PYTHON} wts_ft_interface.py (8 x 4; values of 16ths, high byte first)",
        f"{MANUAL} (ids, byte order, USB)",
    )
    judge = f"{CPP}, {PYTHON}"
    origin = f"{CPP}; CRC by a second program"
    documented = command_table(
        """
        unknown id            31 00 00 68 A5        31 02 00 0E 00 70 81
        a payload too many    30 01 00 00 6B 12     30 02 00 0C 00 4D 10
        a payload too short   21 01 00 00 4D 16     21 02 00 0D 00 BE 60
        """,
        head="AA AA AA",
        origin=origin,
    )
    documented_with = ("values", "counts_per_newton")
    facts = fact_table(f"""
        stated touch: words of several bytes are sent low byte first @ {MANUAL}, page 4
        stated touch: values begin at byte 5 of a frame, low byte first @ {CPP} src/wts_driver.cpp:349
        stated touch: wts-ft reads them high byte first, which gives 16 times the value @ {PYTHON}
            wts_ft_interface.py:106
        stated touch: 8 rows of 4 texels, row by row @ {PYTHON} wts_ft_interface.py:62-63, 104-106
        assumed touch: texels are 3.4 mm wide; 14 rows of 6 by default; 1000 counts/N; the full scale is 4095 @ {BOTH}
        assumed touch: no frame is compressed, whatever the flags @ {BOTH}
        stated identity: tag and type are text after the status @ {CPP} src/wts_driver.cpp:410, 415
        stated identity: the layout of the system information @ {CPP} src/common.cpp:115-136
        stated identity: a type has 14 characters @ {PYTHON} wts_ft_interface.py:85
        assumed identity: the texts; hardware 1, firmware 1.0.0, serial number 1 @ {BOTH}
        stated configuration: status codes are 0 to 30, including 12 to 14 @ {CPP} include/wts_driver/common.hpp:45-76
        stated configuration: command 34 takes two bytes, 36 one @ {PYTHON} wts_ft_interface.py:54, 60
        assumed configuration: values below the threshold read 0; a gain is stored without effect @ {BOTH}
        assumed configuration: a request with a wrong CRC gets no answer; only the tag survives power-off @ {BOTH}
        stated timing: a UART, or a virtual COM port on USB @ {MANUAL}, page 4
        stated timing: /dev/ttyACM0 at 115200 @ {CPP} src/main.cpp:9; launch/wts_one_sensor.launch:2; {PYTHON}
            wts_ft_interface.py:52-53
        stated timing: the time of a frame is in ms @ {CPP} src/wts_driver.cpp:333-336
        assumed timing: a scan every 10 ms, or as often as frames are pushed @ {BOTH}
    """)

    def __init__(
        self,
        *,
        rows: Annotated[int, Option("rows of texels", low=1, high=64)] = 14,
        cols: Annotated[int, Option("texels in a row", low=1, high=64)] = 6,
        values: Annotated[
            Literal["low_first", "sixteenths"], Option("format: that of the manual, or that of wts-ft")
        ] = "low_first",
        counts_per_newton: Annotated[float, Option("scale of a texel", unit="1/N", low=1e-6)] = 1000.0,
        tag: Annotated[str, Option("tag as delivered; 51 changes it")] = "wts",
        sensor_type: Annotated[str, Option("answer to 38; default: by size, such as WTS-FT-0614-34")] = "",
        serial: Annotated[int, Option("serial number of the device", low=0, high=0xFFFFFFFF)] = 1,
    ):
        self.title = f"Weiss WTS tactile matrix, {rows}x{cols}"
        self.layout = grid_layout(rows, cols, PITCH_M)
        self.rows, self.cols, self.serial = rows, cols, serial
        self.sixteenths = values == "sixteenths"
        self.columns = (
            Column(name="texel", low=0, high=FULL_SCALE_COUNTS, assumed_per_unit=counts_per_newton, push=1),
            Column(
                name="T", sense="temperature", unit="degC", counts_per_unit=10.0, low=-0x8000, high=0x7FFF, rest=250
            ),
        )
        self.type = (sensor_type or f"WTS-FT-{cols:02}{rows:02}-34").encode("latin-1", "replace")
        self.tag = self.flash.get("tag", tag.encode("latin-1", "replace"))
        self.packets = Packets(MESSAGE, by="id", counters=self.counters, max_data=MAX_PAYLOAD_BYTES)
        self.pushing, self.singles, self.threshold, self.gain = False, 0, 0, 0
        self.clock_ms = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return, by sense, counts of the texels, 0..4095, ``(rows * cols,)``; temperature [0.1 deg C] ``(1,)``."""
        super().measure(reading, t_ns)
        self.counts["force"][self.counts["force"] < self.threshold] = 0
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return the frames that were requested, then one of the stream."""
        texels = self.layout.on_wire(self.counts["force"])
        values = (16 * texels).astype(">u2") if self.sixteenths else texels.astype("<u2")
        frame = FRAME.pack(time=t_ns // 1_000_000 + self.clock_ms, values=values.tobytes())
        asked, self.singles = self.singles, 0
        answers = [MESSAGE.pack(id=SINGLE, payload=DONE + frame)] * asked
        return answers + [MESSAGE.pack(id=PUSHED, payload=frame)] * self.pushing

    @command("AA AA AA 06 02 00 12 34 E8 CF", "AA AA AA 06 04 00 00 00 12 34 AD 02", data="*", safe=True)
    def loop(self, request: Request):
        """Return the payload."""
        return request.payload

    @command("AA AA AA 20 01 00 00 8F 83", name="one frame, after the next scan", safe=True)
    @command("AA AA AA 20 00 00 4A A3", name="one frame, without flags")
    def ask_for_a_frame(self, request: Request):
        """Remember that a frame was requested; it follows the next scan."""
        self.singles += 1
        return ()

    @command("AA AA AA 21 03 00 00 14 00 D9 AB", "AA AA AA 21 02 00 00 00 28 04", name="frames every 20 ms", data="<BH")
    @command("AA AA AA 21 03 00 00 00 00 F5 5C", "AA AA AA 21 02 00 00 00 28 04", name="frames of each scan")
    def start(self, request: Request):
        """Start the stream, with flags and a period [ms]."""
        self.pushing, self.period_ns = True, 1_000_000 * request.values[1] or SCAN_PERIOD_NS

    @command("AA AA AA 22 00 00 0E 76", "AA AA AA 22 02 00 00 00 A7 2E", name="no more frames")
    def stop(self, request: Request):
        """Stop the stream."""
        self.pushing = False

    @command("AA AA AA 23 00 00 AC 1C", "AA AA AA 23 02 00 00 00 3C D7", name="tare")
    @command("AA AA AA 23 01 00 00 D8 1E", "AA AA AA 23 02 00 00 00 3C D7", name="no tare")
    def tare(self, request: Request):
        """Make the present forces zero, or drop the zero."""
        self.zero = np.zeros(len(self.layout)) if request.payload == b"\0" else self.present

    @command("AA AA AA 30 00 00 CA CF", "AA AA AA 30 0C 00 00 00 06 00 0E 00 54 01 54 01 FF 0F 59 3E", safe=True)
    def matrix(self, request: Request):
        """Return rows, columns and cells."""
        cell = [round(PITCH_M * 1e5)] * 2
        return MATRIX.pack(columns=self.cols, rows=self.rows, cell=cell, full_scale=FULL_SCALE_COUNTS)

    @command("AA AA AA 34 02 00 64 00 8E C7", "AA AA AA 34 02 00 00 00 82 C3", name="threshold 100", data="<H")
    def set_threshold(self, request: Request):
        """Set the threshold."""
        self.threshold = request.value

    @command("AA AA AA 35 00 00 F1 2C", "AA AA AA 35 04 00 00 00 00 00 0C F7", name="threshold", safe=True)
    def get_threshold(self, request: Request):
        """Return the threshold."""
        return self.threshold.to_bytes(2, "little")

    @command("AA AA AA 36 01 00 80 6F 99", "AA AA AA 36 02 00 00 00 96 10", name="gain 128", data="B")
    def set_gain(self, request: Request):
        """Keep the gain."""
        self.gain = request.value

    @command("AA AA AA 37 00 00 B5 F9", "AA AA AA 37 03 00 00 00 00 DF 28", name="gain", safe=True)
    def get_gain(self, request: Request):
        """Return the gain."""
        return bytes([self.gain])

    @command(
        "AA AA AA 38 00 00 EA CF",
        "AA AA AA 38 10 00 00 00 57 54 53 2D 46 54 2D 30 36 31 34 2D 33 34 FB F3",
        name="type",
        safe=True,
    )
    def get_type(self, request: Request):
        """Return the type as text."""
        return self.type

    @command("AA AA AA 46 00 00 86 B7", "AA AA AA 46 04 00 00 00 ..{2} ..{2}", safe=True)
    def temperature(self, request: Request):
        """Return the temperature [0.1 deg C]."""
        return int16(self.counts["temperature"], "<")

    @command("AA AA AA 50 00 00 DB 87", "AA AA AA 50 0A 00 00 00 01 01 00 10 01 00 00 00 CA 60", safe=True)
    def system(self, request: Request):
        """Return versions and the serial number."""
        return SYSTEM.pack(serial=self.serial)

    @command("AA AA AA 51 04 00 6C 65 66 74 6F E7", "AA AA AA 51 02 00 00 00 EC 62", name="new tag", data="*")
    def set_tag(self, request: Request):
        """Keep the tag in flash."""
        self.tag = self.flash["tag"] = request.payload

    @command("AA AA AA 52 00 00 9F 52", "AA AA AA 52 05 00 00 00 77 74 73 45 40", name="tag", safe=True)
    def get_tag(self, request: Request):
        """Return the tag."""
        return self.tag

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the answer: id, status and content."""
        return [MESSAGE.pack(id=request.id, payload=DONE + content)]

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer with an error."""
        error = 14 if why == "unknown_command" else 13 if request.wanted else 12
        return [MESSAGE.pack(id=request.id, payload=error.to_bytes(2, "little"))]
