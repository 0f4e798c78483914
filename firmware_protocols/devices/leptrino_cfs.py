"""Leptrino CFS and PFS: six-axis force-torque sensors that count in ten thousandths of their rated load.

Wire: USB-CDC, opened at 460800 or 921600 8N1; the speed has no effect. Each message is a frame of JIS X 5002: 10 02, a
``REQUEST`` or an ``ANSWER``, 10 03, exclusive or; a 10 inside is sent twice. A wrong sum is answered 10 15.

    command  data of the answer     about
    2A       ``IDENTITY``
    2B       six floats             rated Fx Fy Fz [N], Mx My Mz [Nm]
    30       ``READING``            once
    32       none, then readings    as answers to 32, until 33
    33       none
    A6       none                   low-pass of four bytes: 00 none, 01 10 Hz, 02 100 Hz, 03 200 Hz, and three zeros;
                                    in force from the next power-up
    B6       low-pass               of four bytes

Results: 00 done, 01 wrong length, 02 unknown command, 03 wrong value, which have no data.

Evidence: the vendor's document, and two drivers.

Try it: ``tactemu run leptrino_cfs``, then ``force_torque_sensor().init(PORT)`` of the package myLepFT.
"""

import struct
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Device, Dle, Frame, LowPass, Option, Request, Sense, Serial, Tool, Transmissions, command, dle, fact_table, one_of,
    points, wrench,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     u1       size = total
    1     FF       sensor
    2     u1       command
    3     00       reserved
    4     bytes    data
""")
ANSWER = Frame("""
    answer
    0     u1       size = total
    1     FF       sensor
    2     u1       command
    3     u1       result
    4     bytes    data
""")
IDENTITY = Frame("""
    identity, ASCII
    0     bytes x 16    model
    16    bytes x 8     serial
    24    bytes x 4     firmware
""")
READING = Frame("""
    reading
    0     <i2 x 6       wrench        Fx Fy Fz Mx My Mz [1/10000 of the rated load]
    12    00 x 2        reserved
    14    u1            status        4: beyond the rated load
    15    00            reserved
""")
RATED, MOST, OVERLOAD, START, STOP = 10_000, 32_000, 4, 0x32, 0x33
NAK = b"\x10\x15"
RESULTS = {"bad_length": 1, "unknown_command": 2, "refused": 3}
CUTOFFS_HZ = (None, 10, 100, 200)
DOCUMENT = "Leptrino, communication format of the force sensors, version 1.13 (in Japanese)"
LEPFT = "myLepFT 1.0.1 myLepFT.py"
ROS = "hiveground-ros-package/leptrino_force_torque@02774a4"
ALL = f"{DOCUMENT}, whole; {LEPFT}; {ROS}, all files"


class LeptrinoCfs(Device):
    """A sensor between flange and tool, asked or sending by itself."""

    name = "leptrino_cfs"
    title = "Leptrino CFS and PFS six-axis force-torque sensors"
    kind = "force-torque sensor"
    ports = (Serial(baud=460800, usb=True),)
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    rate_hz = 1200.0
    evidence = ("vendor document", "driver")
    sources = (f"{DOCUMENT}: {ROS} doc/protocal.pdf", f"{ROS} src", LEPFT)
    judge = f"myLepFT 1.0.1, {ROS}"
    origin = f"{DOCUMENT}, 5 to 7; {LEPFT}:45-65"
    facts = fact_table(f"""
        stated touch: a value is 10000 at the rated load and 32000 at most; beyond it bit 2 of the status is set @
            {DOCUMENT}, 6.1
        assumed touch: forces act on the tool, which is touched 50 mm above the origin and to the side of it; z points
            out; two reserved bytes are 0 (the driver's header calls them a temperature) @ {ALL}
        stated touch: the rated loads are 150 N and 4 Nm @ Leptrino, manual of the CFS series, 4.2: {ROS} doc/manual.pdf
        stated identity: the identity has texts of 16, 8 and 4 characters; the serial number consists of digits @
            {DOCUMENT}, 5.1
        assumed identity: the texts, padded with spaces; a driver accepts spaces or zeros @ {ALL}
        stated configuration: the commands, the results and NAK; a new low-pass takes effect at the next power-up @
            {DOCUMENT}, 2.4.3, 3.2, 7.1
        stated configuration: the low-pass is 100 Hz as delivered @ Leptrino, manual of the CFS series, 3.1
        assumed configuration: the model has a first-order low-pass for the FIR filter; commands are obeyed while
            readings are sent; a frame without a command is answered as command 00 @ {ALL}
        stated timing: 460800 baud @ {DOCUMENT}, 2.1; {ROS} src/leptrino_force_torque.cpp:314; 921600 @ {LEPFT}:33
        assumed timing: 1200 readings a second, the rate of the driver's loop @ {ROS} leptrino_force_torque.cpp; {ALL}
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.02, 0.01, 0.05),
        rated_force: Annotated[float, Option("rated load along each axis", unit="N", low=1e-3)] = 150.0,
        rated_torque: Annotated[float, Option("rated load about each axis", unit="Nm", low=1e-3)] = 4.0,
        model: Annotated[str, Option("at most 16 characters of ASCII")] = "CFS034CA301U",
        serial_number: Annotated[str, Option("8 digits")] = "00000001",
    ):
        self.layout = points({"tool": tool})
        per_unit = (RATED / rated_force, RATED / rated_torque)
        self.columns = wrench("Fx Fy Fz Mx My Mz", per_unit=per_unit, low=-MOST, high=MOST)
        self.rated = struct.pack("<6f", *[rated_force] * 3, *[rated_torque] * 3)
        self.identity = IDENTITY.pack(
            model=model.encode("ascii").ljust(16), serial=serial_number.encode("ascii").ljust(8), firmware=b"1.00"
        )
        self.flash.setdefault("filter", 2)
        self.low_pass = LowPass(CUTOFFS_HZ[self.flash["filter"]])
        self.packets = Dle(REQUEST, by="command", counters=self.counters, broken=True)
        self.streaming = False

    def filtered(self, values: np.ndarray, t_ns: int) -> np.ndarray:
        """Return the force and torque behind the low-pass."""
        return self.low_pass(values, t_ns)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a reading, between 32 and 33."""
        return _answer(START, self._reading()) if self.streaming else ()

    def reply(self, request: Request, content: bytes) -> Transmissions:
        """Return the answer."""
        return _answer(request.command, content)

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer of a failure, or NAK."""
        if why not in RESULTS:
            return [NAK]
        fits = request.packet[:1] == bytes([len(request.packet)])
        return _answer(bytes(request.packet[2:3] or 1)[0], b"", RESULTS[why if fits else "bad_length"])

    def _reading(self) -> bytes:
        counts = self.counts[0]
        return READING.pack(wrench=counts, status=OVERLOAD if np.abs(counts).max() > RATED else 0)

    @command("10 02 04 FF 2A 00 10 03 D2", "10 02 20 FF 2A 00 43 46 53 ..{25} 10 03 ..", safe=True)
    def product(self, request: Request) -> bytes:
        """Return model, serial number and firmware."""
        return self.identity

    @command("10 02 04 FF 2B 00 10 03 D3", "10 02 1C FF 2B 00 00 00 16 43 ..{20} 10 03 ..", safe=True)
    def rated_load(self, request: Request) -> bytes:
        """Return the rated load."""
        return self.rated

    @command("10 02 04 FF 30 00 10 03 C8", "10 02 14 FF 30 00 * 10 03 ..", safe=True)
    def read(self, request: Request) -> bytes:
        """Return a reading."""
        return self._reading()

    @command("10 02 04 FF 32 00 10 03 CA", "10 02 04 FF 32 00 10 03 CA", name="start")
    @command("10 02 04 FF 33 00 10 03 CB", "10 02 04 FF 33 00 10 03 CB", name="stop")
    def start_or_stop(self, request: Request) -> None:
        """Start or stop the readings."""
        self.streaming = request.command == START

    @command("10 02 08 FF A6 00 01 00 00 00 10 03 53", "10 02 04 FF A6 00 10 03 5E", name="10 Hz low-pass")
    def set_filter(self, request: Request) -> None:
        """Save the low-pass of the next power-up."""
        one_of(CUTOFFS_HZ, request.data[0])
        self.flash["filter"] = request.data[0]

    @command("10 02 04 FF B6 00 10 03 4E", "10 02 08 FF B6 00 02 00 00 00 10 03 40", name="low-pass", safe=True)
    def filter(self, request: Request) -> bytes:
        """Return the low-pass."""
        return bytes([self.flash["filter"], 0, 0, 0])


def _answer(command: int, data: bytes, result: int = 0) -> list[bytes]:
    return [dle(ANSWER.pack(command=command, result=result, data=data))]
