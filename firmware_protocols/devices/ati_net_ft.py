"""ATI Net F/T and OnRobot (OptoForce) HEX: force and torque over UDP, in RDT's datagrams.

Wire: UDP port 49152. The host sends ``REQUEST``, nothing is answered; records leave as ``RECORD``, one a datagram, to
whoever spoke last. All numbers big-endian. What is no request of 8 bytes, or has another head, is ignored.

    command  argument                     about
    0000     -                            stop
    0002     records, 0: until stopped    start; records are numbered anew
    0042     ATI: 0                       bias: what is felt now is zero
             HEX: FF on, 00 off
    0081     HEX: 0 none, 1..6            low-pass at 500, 150, 50, 15, 5, 1.5 Hz
    0082     HEX: period [ms]             sampling and sending

    counts   per N       per Nm
    ATI      1 000 000   1 000 000        usually; the page netftapi2.xml says which
    HEX      10 000      100 000

Port "http" (ATI only) is the box's web server, of which there is the page ``/netftapi2.xml``: drivers read counts and
units there before they start. ``pynetft`` asks it first, then starts; for a bias it sends 0042 and starts again.
``NetFT`` asks for one record at a time, always on port 49152.

Force and torque are those that act on the tool, at the sensor's origin, z out of its tool side: a push is negative.

Try it: ``tactemu run ati_net_ft --port http=tcp:8080``, then
``pynetft.Client(pynetft.Config(sensor_host="127.0.0.1", http_port=8080))``.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column,
    Command,
    Counts,
    Device,
    Option,
    Outs,
    Reading,
    Rollover,
    Sense,
    Tcp,
    Udp,
    points,
)
from firmware_protocols.adc import LowPass, quantize
from firmware_protocols.protocols.http import Pages
from firmware_protocols.tables import Frame

REQUEST = Frame("""
    request
    0     12 34           head
    2     >u2             command
    4     >u4             argument
""")
RECORD = Frame("""
    record
    0     >u4 wrap        sequence   of records since the start, from 1
    4     >u4 wrap        sample     of the converter, also of those that are not sent
    8     >u4             status     0: no fault
    12    >i4 x 6         counts     Fx Fy Fz Tx Ty Tz
""")
PAGE = (
    '<?xml version="1.0"?>\n<netft><prodname>Net F/T</prodname><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu>'
    "<cfgcpf>{force}</cfgcpf><cfgcpt>{torque}</cfgcpt><comrdtrate>{rate}</comrdtrate></netft>\n"
)
STOP, START, BIAS, FILTER, PERIOD = 0x00, 0x02, 0x42, 0x81, 0x82
BIAS_ON, BIAS_OFF = 0xFF, 0x00
CUTOFF_HZ = (None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)
FOR_EVER = -1
AXES: tuple[tuple[str, Literal["x", "y", "z"]], ...] = tuple(
    (kind + axis, axis) for kind in "FT" for axis in ("x", "y", "z")
)
Point = Annotated[tuple[float, float, float], Option("where the tool is touched, from the sensor's origin", unit="m")]
Status = Annotated[int, Option("of every record; the bits are faults of the box", low=0, high=0xFFFF_FFFF)]
TOOL = (0.0, 0.0, 0.05)


class Rdt(Device):
    """What both have in common: start, stop and records."""

    kind = "force-torque sensor"
    ports = (Udp(port=49152),)
    rollovers = (Rollover(name="sequence", bits=32, state="sequence"),)
    sample_hz: int

    def _power_up(self, tool: tuple[float, float, float], per_newton: int, per_newton_metre: int, status: int) -> None:
        self.layout = points({"tool": tool})
        self.senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
        self.scale, self.status = np.array([per_newton] * 3 + [per_newton_metre] * 3), status
        self.columns = tuple(
            Column(name=name, axis=axis, unit="N" if name[0] == "F" else "Nm", counts_per_unit=scale, low=-(2**31),
                   high=2**31 - 1, push=-1 if name == "Fz" else 0)
            for (name, axis), scale in zip(AXES, self.scale.tolist())
        )  # fmt: skip
        self.low_pass = LowPass()
        self.felt = self.bias = np.zeros((1, 6))
        self.left = self.sequence = 0

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Counts of Fx, Fy, Fz, Tx, Ty, Tz on the tool, less the bias, int32 range, shape ``(1, 6)``."""
        self.felt = self.low_pass(reading["wrench"], t_ns)
        self.counts = quantize(self.felt - self.bias, self.scale, -(2**31), 2**31 - 1)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs:
        """A record, while started."""
        if not self.left:
            return ()
        self.left -= self.left > 0
        self.sequence = (self.sequence + 1) & 0xFFFF_FFFF
        sample = t_ns * self.sample_hz // 1_000_000_000
        return [RECORD.pack(sequence=self.sequence, sample=sample, status=self.status, counts=self.counts[0])]

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """One datagram."""
        request = REQUEST.unpack(data)
        if request is None:
            self.counters["bad_request"] += 1
        elif not self._obey(**request):
            self.counters["unknown_command"] += 1
        return ()

    def _obey(self, command: int, argument: int) -> bool:
        """Whether the command is known."""
        if command == START:
            self.left, self.sequence = argument or FOR_EVER, 0
        elif command == STOP:
            self.left = 0
        return command in (START, STOP)


class AtiNetFt(Rdt):
    """The Net F/T box, or an Ethernet Axia."""

    name = "ati_net_ft"
    title = "ATI Net F/T, force and torque"
    ports = (Udp(name="rdt", port=49152), Tcp(name="http", port=80, plugged=False))
    rollovers = (*Rdt.rollovers, Rollover(name="sample", bits=32, step=7000, clock=True))
    sample_hz = 7000
    evidence = ("driver", "assumed")
    sources = (
        "pynetft 2.1.3 (record, page, bias), NetFT 2.0.1 __init__.py (record, single records)",
        "jsbyysheng/onrobot_hex_ft_sensor@8223adc example/highspeed_udp.c (the same datagrams)",
    )
    judge = "pynetft 2.1.3 and NetFT 2.0.1"
    assumed = (
        "the tool is touched 50 mm above the sensor's origin; z points out of the tool side",
        "records are numbered from 1 after each start; 7000 samples and 1000 records a second",
        "commands 0003, 0004 and 0041 (buffered, multi-unit, thresholds) are not spoken: no source read has them",
        "status bits: none is set unless the option says so",
        "root and product name of the page, and what else a real one says; other pages are not found",
    )

    def __init__(
        self,
        *,
        tool: Point = TOOL,
        counts_per_force: Annotated[int, Option("as calibrated", unit="1/N", low=1, high=2**31 - 1)] = 1_000_000,
        counts_per_torque: Annotated[int, Option("as calibrated", unit="1/Nm", low=1, high=2**31 - 1)] = 1_000_000,
        records_per_second: Annotated[int, Option("as set in the box", unit="Hz", low=1, high=7000)] = 1000,
        status: Status = 0,
    ):
        self._power_up(tool, counts_per_force, counts_per_torque, status)
        self.rate_hz = float(records_per_second)
        self.pages = Pages(counters=self.counters)
        page = PAGE.format(force=counts_per_force, torque=counts_per_torque, rate=records_per_second)
        self.shown = {"/netftapi2.xml": ("text/xml", page.encode("ascii"))}

    @property
    def commands(self) -> tuple[Command, ...]:
        """What the drivers send."""
        ask = b"GET /netftapi2.xml HTTP/1.1\r\nHost: 192.168.1.1\r\nAccept: */*\r\n\r\n"
        return (
            Command(name="start", request="12 34 00 02 00 00 00 00", origin="pynetft 2.1.3"),
            Command(name="one record", request="12 34 00 02 00 00 00 01", origin="NetFT 2.0.1 getMeasurement()"),
            Command(name="bias", request="12 34 00 42 00 00 00 00", origin="pynetft 2.1.3 bias()"),
            Command(name="stop", request="12 34 00 00 00 00 00 00", origin="NetFT 2.0.1 stopStreaming()"),
            Command(name="page", request=ask, reply=f"{b'HTTP/1.1 200 '.hex()} *", port="http", origin="pynetft 2.1.3"),
        )

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """One datagram, or a piece of a request to the web server."""
        return self.pages.answers(data, self.shown) if port == "http" else super().receive(data, t_ns, port)

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Outs:
        """A browser comes or goes: what it left unfinished is forgotten."""
        if port == "http":
            self.pages.heard = b""
        return ()

    def _obey(self, command: int, argument: int) -> bool:
        if command == BIAS:
            self.bias = self.felt
        return command == BIAS or super()._obey(command, argument)


class OnrobotHex(Rdt):
    """HEX-E or HEX-H at the Compute Box, OptoForce at the EtherDAQ."""

    name = "onrobot_hex"
    title = "OnRobot (OptoForce) HEX, force and torque over UDP"
    rollovers = (*Rdt.rollovers, Rollover(name="sample", bits=32, step=1000, clock=True))
    sample_hz = 1000
    evidence = ("driver", "assumed")
    sources = ("jsbyysheng/onrobot_hex_ft_sensor@8223adc example/highspeed_udp.c",)
    judge = "NetFT 2.0.1, which is made for ATI's"
    assumed = (
        "the tool is touched 50 mm above the sensor's origin; z points out of the tool side",
        "records are numbered from 1 after each start; 1000 samples a second",
        "at power-up 500 records a second, no filter, no bias; the filter is a first-order low-pass",
        "another period than 1..255 ms, and another filter than 0..6, change nothing; other biases are on",
        "status bits: none is set unless the option says so; TCP port 49151 is left out: its scales are contradictory",
    )

    def __init__(self, *, tool: Point = TOOL, status: Status = 0):
        self._power_up(tool, 10_000, 100_000, status)
        self.rate_hz = 500.0

    @property
    def commands(self) -> tuple[Command, ...]:
        """What the vendor's example sends, in its order."""
        named = (("100 records a second", "82 00 00 00 0A"), ("15 Hz filter", "81 00 00 00 04"),
                 ("bias", "42 00 00 00 FF"), ("start", "02 00 00 00 00"), ("no bias", "42 00 00 00 00"),
                 ("stop", "00 00 00 00 00"))  # fmt: skip
        origin = "onrobot_hex_ft_sensor@8223adc example/highspeed_udp.c"
        return tuple(Command(name=name, request=f"12 34 00 {rest}", origin=origin) for name, rest in named)

    def _obey(self, command: int, argument: int) -> bool:
        if command == BIAS:
            self.bias = np.zeros((1, 6)) if argument == BIAS_OFF else self.felt
        elif command == FILTER and argument < len(CUTOFF_HZ):
            self.low_pass.cutoff_hz = CUTOFF_HZ[argument]
        elif command == PERIOD and 1 <= argument <= 0xFF:
            self.period_ns = argument * 1_000_000
        else:
            return super()._obey(command, argument)
        return True
