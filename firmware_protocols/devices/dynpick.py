"""WACOH DynPick: a six-axis force-torque sensor that answers letters with lines.

Wire: 921600 8N1 through a CP210x bridge (10C4:EA60). The host sends letters; answers end with CR LF.

    R    a digit that counts the answers, then Fx Fy Fz Mx My Mz as four hexadecimal digits each, 2000 (8192) for
         zero: 27 characters
    S    starts such a line after each conversion; no answer
    E    stops them; no answer
    O    the present force and torque become zero; no answer
    p    counts per newton and newton metre of the six axes, with commas: numbers of six and seven characters, 46 in all
    T    temperature [1/16 deg C], four hexadecimal digits
    V    product and firmware, text
    nF   frequency divider n of 1, 2, 4, 8: each n-th conversion; no answer. 0F: a digit, n

Try it: ``tactemu run dynpick``, then send ``R``.
"""

from typing import Annotated

from firmware_protocols import (
    NO_PACKET, USB, Column, Device, Option, Packets, Request, Sense, Serial, Tool, Transmissions, command, fact_table,
    points, xyz,
)  # fmt: skip

REST_COUNTS = 8192
MAX_COUNTS = 16383
PERIOD_NS = 2_000_000
SENSITIVITY_WIDTHS = (6, 6, 6, 7, 7, 7)
"""The characters of each number in the answer to p."""
TORK = "tork-a/dynpick_driver@d5ea649"
UMEMOTO = "UmemotoCtrl/Matlab-Python-for-Dynpick@4bb2812"
PYTHON = f"{UMEMOTO} DynPick.py"
RUST = "Amelia10007/dynpick-force-torque-sensor-rs@89f6db0"
KOBE = "KobeKosenRobotics/Dynpick_Driver@a8bc768"
ALL = "main.cpp, test-com.c, DynPick.py, lib.rs, dynpick.cpp (all whole)"
ORIGIN = points({"origin": (0.0, 0.0, 0.0)})


class DynPick(Device):
    """A sensor of force and torque on a tool, which sends a line for each request or conversion."""

    name = "dynpick"
    kind = "force-torque sensor"
    title = "WACOH DynPick six-axis force-torque sensor"
    ports = (Serial(baud=921600, usb=USB(0x10C4, 0xEA60, node="ttyUSB")),)
    senses = (Sense("wrench", at=ORIGIN), Sense("temperature", at=ORIGIN))
    rate_hz = 1e9 / PERIOD_NS
    evidence = ("driver",)
    sources = (f"{TORK} src/main.cpp, doc/index.rst", f"{UMEMOTO} DynPick.py", f"{RUST} src/lib.rs")
    judge = f"{TORK}, {UMEMOTO}, {RUST}"
    origin = f"{TORK} src/main.cpp, doc/index.rst"
    documented_with = None
    facts = fact_table(f"""
        stated touch: the answer has six numbers of four hexadecimal digits; 8192 is zero @ {TORK} src/main.cpp:237-249
        stated touch: z points towards the tool mount @ {TORK} urdf/dynpick_WEF-6A200_macro.xacro:40-50
        assumed touch: forces act on the tool, which is touched 50 mm above the origin
        stated touch: sensitivities differ from sensor to sensor: 24.9, 24.6, 24.5 counts/N and 1664.7 counts/Nm @
            {RUST} src/lib.rs:108
        stated touch: another sensor has 65.47, 65.44, 65.08 counts/N and 1638.5 counts/Nm @ {UMEMOTO} DynPick.py:32
        assumed touch: the model has 50 counts/N and 1500 counts/Nm; counts saturate at 0 and 16383; hexadecimal digits
            are in upper case
        stated touch: temperature in 1/16 deg C, four hexadecimal digits @ {UMEMOTO} DynPick.py:136-148
        assumed touch: temperatures below 0 deg C read 0
        stated identity: 10C4:EA60, a CP210x bridge @ {TORK} doc/index.rst:22-32; {RUST} examples/demo.rs:6-8
        assumed identity: the text of the answer to V
        stated configuration: the answer to p has 46 characters @ {TORK} src/main.cpp:51; {RUST} src/lib.rs:134; 45:
            {KOBE}
        assumed configuration: with three decimals for a force, two for a torque, and CR LF, the answer has 46
            characters
        stated configuration: the Rust driver, which is not tested on p, expects no CR LF after the last number @ {RUST}
            src/lib.rs:131-149
        stated configuration: some sensors do not answer p @ {RUST} src/lib.rs:131
        stated configuration: the dividers are 1, 2, 4 and 8; 0F is answered with a digit and two characters @ {TORK}
            src/main.cpp:202-212
        stated configuration: on the hardware, O works when it is sent three times @ {TORK} src/main.cpp:48
        assumed configuration: in the model O works when it is sent once; the zero is lost at power-off
        assumed configuration: the sensor is silent after power-up, with divider 1; other letters get no answer
        stated timing: 921600 baud @ {TORK} src/main.cpp:71; {UMEMOTO} DynPick.py:27; {RUST} src/lib.rs:81
        assumed timing: 500 conversions a second, divided by the divider; the digit counts from 0 to 9
    """, looked=ALL)  # fmt: skip

    def __init__(
        self,
        *,
        tool: Tool = (0.0, 0.0, 0.05),
        counts_per_newton: Annotated[
            float, Option("scale of the three forces", unit="1/N", low=1e-3, high=99999)
        ] = 50.0,
        counts_per_newton_metre: Annotated[
            float, Option("scale of the torques", unit="1/Nm", low=1e-3, high=999999)
        ] = 1500.0,
        version: Annotated[str, Option("answer to V: product and firmware")] = "DynPick 1.00",
    ):
        self.layout = points({"tool": tool})
        self.scale = [counts_per_newton] * 3 + [counts_per_newton_metre] * 3
        limits = {"sense": "wrench", "low": 0, "high": MAX_COUNTS, "rest": REST_COUNTS}
        self.columns = (
            *xyz("Fx Fy Fz", unit="N", counts_per_unit=counts_per_newton, **limits),
            *xyz("Mx My Mz", unit="Nm", counts_per_unit=counts_per_newton_metre, **limits),
            Column(name="T", sense="temperature", unit="degC", counts_per_unit=16.0, low=0, high=0xFFFF, rest=400),
        )
        self.version = version.encode("latin-1", "replace")
        self.packets = Packets(b"", _size, counters=self.counters)
        self.tick, self.streaming, self.divider = 0, False, b"1"

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one line, between S and E."""
        return [self._reading()] if self.streaming else ()

    def _reading(self) -> bytes:
        tick, self.tick = self.tick, (self.tick + 1) % 10
        counts = "".join(f"{count:04X}" for count in self.counts["wrench"][0].tolist())
        return f"{tick}{counts}\r\n".encode("ascii")

    @command(b"R", "30 ..{24} 0D 0A", safe=True)
    def read(self, request: Request):
        """Return one line."""
        return self._reading()

    @command(b"O")
    def take_as_zero(self, request: Request):
        """Make the present force and torque zero."""
        self.zero = self.present

    @command(b"2F", name="each second conversion", pattern=b"([1248])F")
    def divide(self, request: Request):
        """Set the divider of the conversions."""
        self.divider, self.period_ns = request.value, int(request.value) * PERIOD_NS

    @command(b"0F", "32 0D 0A", after=(b"2F",))
    def divider_of_rate(self, request: Request):
        """Return the divider."""
        return self.divider + b"\r\n"

    @command(b"S", origin=PYTHON)
    def start(self, request: Request):
        """Start the lines."""
        self.streaming = True

    @command(b"E", origin=PYTHON)
    def stop(self, request: Request):
        """Stop the lines."""
        self.streaming = False

    @command(b"T", "..{4} 0D 0A", origin=PYTHON, safe=True)
    def temperature(self, request: Request):
        """Return the temperature."""
        return f"{self.counts['temperature'][0]:04X}\r\n".encode("ascii")

    @command(b"V", "*", origin=PYTHON, safe=True)
    def version_text(self, request: Request):
        """Return product and firmware."""
        return self.version + b"\r\n"

    @command(b"p", "..{44} 0D 0A", origin=f"{RUST} src/lib.rs", safe=True)
    def sensitivity(self, request: Request):
        """Return the counts per unit of the six axes."""
        texts = (f"{scale:.5f}"[:width] for scale, width in zip(self.scale, SENSITIVITY_WIDTHS))
        return f"{','.join(texts)}\r\n".encode("ascii")


def _size(data: bytes) -> int | str:
    if not data[:1].isdigit():
        return 1
    return NO_PACKET if data[1:2].isdigit() else 2
