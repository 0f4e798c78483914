"""Sunrise (SRI) M8128: the acquisition box of six-axis force-torque sensors, on TCP or a serial line.

Wire: TCP port 4008, one client; or serial, 115200 8N1. Requests are lines of ASCII that end with CR LF.

    line           answer
    AT+GSD         none; a ``FRAME`` for each conversion until AT+GSD=STOP
    AT+GOD         one ``FRAME``
    AT+X=?         ACK+X=value$OK
    AT+X=value     ACK+X=value$OK, or ACK+X=value$ERROR

X is SMPF or SMPR, the rate [Hz]; DCPM, the matrix; DCPCU, its unit; SGDM, the format; DCKMD, the check; EIP and ETPT,
address and port. Python's readers decode the first frame of what a `recv` returns.

Evidence: a part of the vendor's document with a worked example, frames captured by two users, drivers, one of them
run.

Try it: ``tactemu run sunrise_m8128``, then send ``AT+GOD``.
"""

from firmware_protocols import (
    Device, Frame, Lines, Refused, Request, Rollover, Sense, Sent, Serial, Tcp, Tool, Transmissions, command,
    fact_table, points, wrench,
)  # fmt: skip

FRAME = Frame("""
    frame
    0     AA 55             head
    2     00 1B             length    27: of all behind it
    4     >u2 wrap          number    of frames, from 0
    6     <f4 x 6           wrench    Fx Fy Fz [N], Mx My Mz [Nm]
    last  sum8 from 6       check     of the wrench
""")
FORMAT = b"(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)"
MATRIX = b";".join([b"(0.0,0.0,0.0,0.0,0.0,0.0)"] * 6)
SETTINGS = {b"SMPF": b"100", b"SMPR": b"100", b"DCPCU": b"MVPV", b"SGDM": FORMAT, b"DCKMD": b"SUM", b"DCPM": MATRIX,
            b"EIP": b"192.168.0.108", b"ETPT": b"4008"}  # fmt: skip
"""The settings as delivered, by command."""
FIXED = {b"SGDM": FORMAT, b"DCKMD": b"SUM"}
"""Settings of which this model has one value."""
MAX_HZ = 2000
RANGE: list[float] = [1000.0] * 3 + [100.0] * 3
DOCUMENT = "SRI, M8128 commands GSD, GOD, DCKMD, as copied beside ZenanLin1999/ROS_package_M8128_data_acquire"
CPP = "ZenanLin1999/ROS_package_M8128_data_acquire@e0afb05 force_sensor/src/M8128_data_acquire.cpp"
PYFORCE, READER = "Elycyx/PyForce@a263e82", "Li-yuyan/RSI_sensor_data_reading@0ef4559"
ALL = "pyforce/sensor.py, README.md; Single_SRI_sensor.py; M8128_data_acquire.cpp (all whole)"


class SunriseM8128(Device):
    """A box that streams, or is asked for single frames."""

    name = "sunrise_m8128"
    title = "Sunrise M8128 box with a six-axis force-torque sensor"
    kind = "force-torque sensor"
    ports = (Tcp(name="tcp", port=4008), Serial(name="uart", baud=115200, is_plugged=False))
    senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
    columns = wrench("Fx Fy Fz Mx My Mz", per_unit=(1, 1), is_float=True, low=[-each for each in RANGE], high=RANGE)
    rollovers = (Rollover(name="number", bits=16, state="number"),)
    evidence = ("captured", "vendor document", "driver")
    sources = (f"{DOCUMENT} (frame, example)", f"{CPP}:36-46 (a frame)", f"{READER} README.md, {PYFORCE} (commands)")
    judge = PYFORCE
    origin = f"{READER} README.md; {PYFORCE} pyforce/sensor.py"
    documented_with = ("tool",)
    facts = fact_table(f"""
        stated touch: float32 values, low byte first, after a frame number that counts from 0, high byte first; a sum
            over the data @ {DOCUMENT}
        measured touch: the sums of two captured frames are right @ {CPP}:36-46; a comment of another driver on a serial
            line
        stated touch: force, then torque @ {READER} Single_SRI_sensor.py:71-77
        assumed touch: units are N and Nm in format E; the ranges are {RANGE[0]:g} N and {RANGE[3]:g} Nm; the tool is
            touched at the point `tool`, z points out of it @ {ALL}
        stated identity: 192.168.0.108, port 4008 @ {READER} README.md
        stated configuration: the format of the answers @ {READER} README.md; {DOCUMENT}
        assumed configuration: the text $ERROR; only one data format and one checksum; the matrix is stored without
            effect; all settings but the rate are lost at power-off; a stop is answered @ {ALL}
        stated timing: SMPF sets the rate of the frames @ {DOCUMENT}
        assumed timing: SMPR sets it, too; it is 100 Hz after the first power-up and at most {MAX_HZ} Hz @ {ALL}
    """)

    def __init__(self, *, tool: Tool = (0.02, 0.01, 0.05)):
        self.layout = points({"tool": tool})
        rate = self.flash.get("rate", SETTINGS[b"SMPF"])
        self.settings = {**SETTINGS, b"SMPF": rate, b"SMPR": rate}
        self.rate_hz, self.streaming, self.number = float(rate), "", -1
        self.packets = Lines(counters=self.counters)

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Forget a connection that comes or goes."""
        self.packets.reset()
        self.streaming = ""
        return ()

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a frame, between start and stop."""
        return [Sent(self._frame(), port=self.streaming)] if self.streaming else ()

    def _frame(self) -> bytes:
        self.number = (self.number + 1) & 0xFFFF
        return FRAME.pack(number=self.number, wrench=self.counts[0])

    @command(b"AT+GSD\r\n", name="start")
    @command(b"AT+GSD=STOP\r\n", b"ACK+GSD=STOP$OK\r\n", name="stop")
    def start_or_stop(self, request: Request) -> bytes:
        """Start or stop the frames."""
        self.streaming = "" if request.packet.endswith(b"STOP") else request.port
        return b"" if self.streaming else b"ACK+GSD=STOP$OK\r\n"

    @command(b"AT+GOD\r\n", "AA 55 00 1B *", name="one frame", origin=DOCUMENT)
    def one(self, request: Request) -> bytes:
        """Return a frame."""
        return self._frame()

    @command(b"AT+EIP=?\r\n", b"ACK+EIP=192.168.0.108$OK\r\n", name="address", safe=True)
    @command(b"AT+ETPT=?\r\n", b"ACK+ETPT=4008$OK\r\n", name="port", safe=True)
    @command(b"AT+DCPM=?\r\n", b"ACK+DCPM=" + MATRIX + b"$OK\r\n", name="matrix", safe=True)
    @command(b"AT+DCPCU=?\r\n", b"ACK+DCPCU=MVPV$OK\r\n", name="unit", safe=True)
    @command(b"AT+DCPCU=MVPV\r\n", b"ACK+DCPCU=MVPV$OK\r\n", name="set unit")
    @command(b"AT+SMPR=1000\r\n", b"ACK+SMPR=1000$OK\r\n", name="1000 Hz")
    @command(b"AT+SMPF=100\r\n", b"ACK+SMPF=100$OK\r\n", name="100 Hz", origin=DOCUMENT)
    @command(b"AT+DCKMD=SUM\r\n", b"ACK+DCKMD=SUM$OK\r\n", name="check", origin=DOCUMENT)
    @command(
        b"AT+SGDM=" + FORMAT + b"\r\n", b"ACK+SGDM=" + FORMAT + b"$OK\r\n", name="format",
        pattern=rb"AT\+([A-Z]{1,8})=([!-~]{1,200})",
    )  # fmt: skip
    def setting(self, request: Request) -> bytes:
        """Return a setting, or change it."""
        name, value = request.values
        if name not in self.settings:
            raise Refused("value")
        if value != b"?":
            self._set(name, value)
        return b"ACK+%s=%s$OK\r\n" % (name, self.settings[name])

    def _set(self, name: bytes, value: bytes) -> None:
        if FIXED.get(name, value) != value:
            raise Refused("value")
        if name in (b"SMPF", b"SMPR"):
            if not value.isdigit() or not 1 <= int(value) <= MAX_HZ:
                raise Refused("value")
            self.settings[b"SMPF"] = self.settings[b"SMPR"] = self.flash["rate"] = value
            self.period_ns = round(1e9 / int(value))
        self.settings[name] = value

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the error of a setting."""
        name, value = request.values or (b"", b"")
        return [b"ACK+%s=%s$ERROR\r\n" % (name, value)] if why == "refused" else ()
