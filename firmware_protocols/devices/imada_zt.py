"""IMADA ZTA and ZTS: force gauges with a rod that is pushed, which answer short words with lines.

Wire: USB-CDC, opened at 19200 or 460800; the speed has no effect. Requests and answers end with CR.

    request   answer
    XAR       a ``LINE``
    XAg, XAG  lines, ten or 2000 a second, until XAS, which has no answer
    Z         -                     the present force becomes zero
    XFC       XFC, six codes        the units by number, two digits each: 02 N, 08 kgf, 11 lbf, 01 mN, 07 gf, 10 ozf

Evidence: two drivers, run.

Try it: ``tactemu run imada_zt``, then ``IMADA_ZTS.py PORT`` of ay_test.
"""

from typing import Annotated, Literal

from firmware_protocols import (
    Column, Device, Frame, Lines, Option, Request, Serial, Transmissions, command, fact_table, points,
)  # fmt: skip

LINE = Frame("""
    line
    0     72            start      r
    1     bytes x 6     force      sign and five characters, one of them a point
    7     30 x 8        reserved
    15    30            unit       its number: N
    16    30 x 4        reserved
    20    0D            end
""")
MOST = 5500
"""The largest count, 110 % of the capacity."""
RATES_HZ = {b"XAg": 10, b"XAG": 2000}
LEPT, AY = "myIMD-gauge 0.0.7", "akihikoy/ay_test@f13e48e"
GAUGE, ZTS = f"{LEPT} myIMD_gauge.py", f"{AY} python/serial/IMADA_ZTS.py, IMADA_ZTS2.py"
BOTH = f"{GAUGE}, {ZTS}"


class ImadaZt(Device):
    """A force gauge, asked or sending by itself."""

    name = "imada_zt"
    title = "IMADA ZTA and ZTS force gauges"
    kind = "force-torque sensor"
    ports = (Serial(baud=19200, usb=True),)
    rate_hz = 2000.0
    evidence = ("driver",)
    sources = (GAUGE, ZTS)
    judge = f"{LEPT}, {AY}"
    origin = BOTH
    facts = fact_table(f"""
        stated touch: a line has 20 characters and CR; six of them are the force, and the unit is a number @
            {GAUGE}:49-54; {ZTS}:57-68
        assumed touch: a push is positive; the number of decimals follows from the capacity, and values saturate at 110
            % of it; the other characters are zeros @ {BOTH}
        stated configuration: the requests XAR, XAg, XAG, XAS and XFC, and the codes of units @ {ZTS}:12-30, 42-55; Z @
            {GAUGE}:10
        assumed configuration: which six units it has; it displays newtons; Z, XQT and other requests get no answer @
            {BOTH}
        stated timing: lines are sent ten or 2000 times a second @ {ZTS}:44-45
        assumed timing: it measures 2000 times a second, with XAg ten times @ {BOTH}
    """)

    def __init__(self, *, capacity: Annotated[Literal[5, 50, 500], Option("largest force", unit="N")] = 50):
        self.layout = points({"rod": (0.0, 0.0, 0.0)})
        self.columns = (Column(name="force", unit="N", counts_per_unit=5000 / capacity, low=-MOST, high=MOST, push=1),)
        self.decimals = {5: 3, 50: 2, 500: 1}[capacity]
        self.packets = Lines(b"\r", counters=self.counters, longest=16)
        self.sending = False

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a line, between XAG and XAS."""
        return [self._line()] if self.sending else ()

    def _line(self) -> bytes:
        force = self.counts[0] / 10**self.decimals
        return LINE.pack(force=f"{force:+06.{self.decimals}f}".encode("ascii"))

    @command(b"XAR\r", "72 2B ..{18} 0D", safe=True)
    def read(self, request: Request) -> bytes:
        """Return a line."""
        return self._line()

    @command(b"XAg\r", name="ten lines a second")
    @command(b"XAG\r", name="2000 lines a second")
    def start(self, request: Request) -> None:
        """Start the lines."""
        self.sending, self.period_ns = True, round(1e9 / RATES_HZ[request.packet])

    @command(b"XAS\r")
    def stop(self, request: Request) -> None:
        """Stop the lines."""
        self.sending, self.period_ns = False, round(1e9 / self.rate_hz)

    @command(b"Z\r")
    def set_zero(self, request: Request) -> None:
        """Make the present force zero."""
        self.zero = self.present

    @command(b"XFC\r", b"XFC020811010710\r", safe=True)
    def units(self, request: Request) -> bytes:
        """Return the codes of the units."""
        return b"XFC020811010710\r"
