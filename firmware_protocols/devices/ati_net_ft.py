"""ATI Net F/T and OnRobot (OptoForce) HEX: force and torque over UDP, in RDT's datagrams, and over TCP.

Wire: UDP port 49152. The host sends ``REQUEST``, nothing is answered; records leave as ``RECORD``, one a datagram, to
whoever spoke last. All numbers big-endian. What is no request of 8 bytes, or has another head, is ignored.

    command  argument                     about
    0000     -                            stop
    0001     as 0002                      Ethernet Axia: start
    0002     records, 0: until stopped    start; records are numbered anew
    0003     as 0002                      ATI: start, several records a datagram (option ``buffered``)
    0041     -                            ATI: clears the latch of monitor conditions, of which there is none
    0042     ATI: 0                       bias: what is measured now becomes zero
             HEX: FF on, 00 off
    0081     HEX: 0 none, 1..6            low-pass at 500, 150, 50, 15, 5, 1.5 Hz; 15 Hz at power-up
    0082     HEX: period [ms], 0 stops    sampling and sending; 10 ms at power-up

The HEX looks at the low half of an argument: the vendor's ROS driver repeats 16 bits in both halves.

    counts   per N       per Nm
    ATI      1 000 000   1 000 000        usually; the page netftapi2.xml says which
    HEX      10 000      100 000

Status, ATI: bit 31 any error, 17 (Axia: 30) saturated, 16 monitor condition latched ... (option). HEX: bits 0-2 the
sensor that has an error, from 1, 3 several have, 4-9 overload of Fx Fy Fz Tx Ty Tz, 10-12 sensor not found (1) or
broken (2), 13-15 converter's error (1) or no communication (2).

Port "tcp" is TCP port 49151, one client at a time. Requests have 20 bytes, the first is the command.

    command  bytes 18, 19                 answer
    00       ATI: 1 bias, 2 clear latch   ``READING``
    01       -                            ``CALIBRATION``
    02 03    -                            ATI: 12 34, command, 1: the tool transform and monitor conditions are refused

Port "http" (ATI only) is the box's web server, of which there is the page ``/netftapi2.xml``: drivers read counts and
units there before they start. ``pynetft`` asks it first, then starts; for a bias it sends 0042 and starts again.
``NetFT`` asks for one record at a time, always on port 49152.

Force and torque are those that act on the tool, at the sensor's origin, z out of its tool side: a push is negative.

Try it: ``tactemu run ati_net_ft --port tcp=tcp:49151 --port http=tcp:8080``, then
``pynetft.Client(pynetft.Config(sensor_host="127.0.0.1", http_port=8080))``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Column,
    Command,
    Counts,
    Device,
    Option,
    Reading,
    Rollover,
    Sense,
    Tcp,
    Transmissions,
    Udp,
    points,
)
from firmware_protocols.adc import LowPass, quantize
from firmware_protocols.facts import assumed, stated
from firmware_protocols.framing import Packets
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
READING = Frame("""
    answer to 00 over TCP
    0     12 34           head
    2     >u2             status     ATI: bits 31..16
    4     >i2 x 6 clip    counts     Fx Fy Fz Tx Ty Tz over their scale
""")
CALIBRATION = Frame("""
    answer to 01 over TCP
    0     12 34           head
    2     02              unit       of force, N
    3     03              unit       of torque, Nm
    4     >u4             force      counts per N
    8     >u4             torque     counts per Nm
    12    >u2 x 6         scale      of the counts in an answer to 00
""")
PAGE = (
    '<?xml version="1.0"?><netft>\n<prodname>Net F/T</prodname><runstat>0x{status:08x}</runstat>'
    "<runft>{counts}</runft><runrate>7000</runrate>\n<scfgfu>N</scfgfu><scfgtu>Nm</scfgtu>\n"
    "<cfgcpf>{force}</cfgcpf><cfgcpt>{torque}</cfgcpt>\n<cfgmr>{rated}</cfgmr>\n<setcfgsel>0</setcfgsel>"
    "<setmce>0</setmce>\n<setbias>{bias}</setbias>\n<setuserfilter>0</setuserfilter>\n<netip>192.168.1.1</netip>\n"
    "<comrdte>Enabled</comrdte><comrdtrate>{rate}</comrdtrate><comrdtbsiz>{buffered}</comrdtbsiz>\n</netft>\n"
)
LIVE = "a live page of a box with firmware 2.2.59, in a public repository's test_ft_config.py"
STOP = 0x00
START = 0x02
FILTER = 0x81
PERIOD = 0x82
AXIA_START = 0x01
START_BUFFERED = 0x03
CLEAR_LATCH = 0x41
BIAS = 0x42
BIAS_ON = 0xFF
BIAS_OFF = 0x00
TCP_BYTES = 20
READ = 0
CALIBRATE = 1
WRITES = (2, 3)
REFUSED = 1
TCP_BIAS = 1
NET_FT = "ATI 9620-05-NET FT-11"
AXIA = "ATI 9610-05-Ethernet Axia-09"
HEX = "jsbyysheng/onrobot_hex_ft_sensor@b8ae330"
HEX_MANUAL = "OptoForce manual for Ethernet Converter 2.0"
SENSOR = 1
"""Number of the HEX that has an error: there is one."""
CUTOFF_HZ = (None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)
FOR_EVER = -1
AXES: tuple[tuple[str, Literal["x", "y", "z"]], ...] = tuple(
    (kind + axis, axis) for kind in "FT" for axis in ("x", "y", "z")
)
Point = Annotated[tuple[float, float, float], Option("where the tool is touched, from the sensor's origin", unit="m")]
Status = Annotated[int, Option("of every record; the bits are faults of the box", low=0, high=0xFFFF_FFFF)]
TOOL = (0.0, 0.0, 0.05)
Rated = Annotated[float, Option("rated, of each axis", unit="N", low=1e-3)]
RatedTorque = Annotated[float, Option("rated, of each axis", unit="Nm", low=1e-3)]


class Rdt(Device):
    """What both have in common: start, stop and records; the answers over TCP."""

    kind = "force-torque sensor"
    ports = (Udp(name="rdt", port=49152), Tcp(name="tcp", port=49151, plugged=False))
    rollovers = (Rollover(name="sequence", bits=32, state="sequence"),)
    sample_hz: int

    def _power_up(
        self, tool: Sequence[float], per_newton: int, per_newton_metre: int, tcp_scale: Sequence[int], status: int
    ) -> None:
        self.layout = points({"tool": tool})
        self.senses = (Sense("wrench", at=points({"origin": (0.0, 0.0, 0.0)})),)
        self.scale, self.status = np.array([per_newton] * 3 + [per_newton_metre] * 3), status
        self.columns = tuple(
            Column(name=name, axis=axis, unit="N" if name[0] == "F" else "Nm", counts_per_unit=scale, low=-(2**31),
                   high=2**31 - 1, push=-1 if name == "Fz" else 0)
            for (name, axis), scale in zip(AXES, self.scale.tolist())
        )  # fmt: skip
        self.calibration = CALIBRATION.pack(force=per_newton, torque=per_newton_metre, scale=tcp_scale)
        self.tcp_scale = np.array(tcp_scale)
        self.packets = Packets(b"", _tcp_size, counters=self.counters)
        self.low_pass = LowPass()
        self.felt = self.bias = np.zeros((1, 6))
        self.counts = np.zeros((1, 6), np.int64)
        self.left = self.sequence = self.samples_before = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return counts of Fx, Fy, Fz, Tx, Ty, Tz on the tool, less the bias, int32 range, shape ``(1, 6)``."""
        self.felt = self.low_pass(reading["wrench"], t_ns)
        self.counts = quantize(self.felt - self.bias, self.scale, -(2**31), 2**31 - 1)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a record, while started."""
        if not self.left:
            return ()
        self.left -= self.left > 0
        self.sequence = (self.sequence + 1) & 0xFFFF_FFFF
        return self._sent(
            RECORD.pack(sequence=self.sequence, sample=self._sample(t_ns), status=self._status(), counts=self.counts[0])
        )

    def _sent(self, record: bytes) -> list[bytes]:
        return [record]

    def _sample(self, t_ns: int) -> int:
        return t_ns * self.sample_hz // 1_000_000_000 + self.samples_before

    def _status(self) -> int:
        return self.status

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Return one datagram, or a piece of a request over TCP."""
        if port == "tcp":
            return [answer for packet in self.packets.cut(data, t_ns) for answer in self._answer(packet)]
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

    def _answer(self, request: bytes) -> list[bytes]:
        if request[0] == CALIBRATE:
            return [self.calibration]
        if request[0] == READ:
            counts = np.rint(self.counts[0] / self.tcp_scale).astype(np.int64)
            return [READING.pack(status=self._tcp_status(), counts=counts)]
        self.counters["unknown_command"] += 1
        return []

    def _tcp_status(self) -> int:
        return self._status() & 0xFFFF

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """A client comes or goes: what it left unfinished is forgotten."""
        if port == "tcp":
            self.packets.reset()
        return ()


def _tcp_size(data: bytes) -> int:
    return TCP_BYTES


class AtiNetFt(Rdt):
    """The Net F/T box, or an Ethernet Axia."""

    name = "ati_net_ft"
    title = "ATI Net F/T, force and torque"
    ports = (*Rdt.ports, Tcp(name="http", port=80, plugged=False))
    rollovers = (*Rdt.rollovers, Rollover(name="sample", bits=32, step=7000, clock=True, state="samples_before"))
    sample_hz = 7000
    evidence = ("vendor document", "driver")
    sources = (
        "ATI manuals 9620-05-NET FT-11 chapters 10, 11 and 9610-05-Ethernet Axia-09 chapters 4.8, 10 to 12",
        "pynetft 2.1.3 (record, page, bias), NetFT 2.0.1 __init__.py (record, single records)",
        "LouKordos/ati-netft-cpp@73a6349 netft_sensor.hpp (TCP), gpldecha/netft_rdt_driver@115cf5a (RDT)",
        "rpiRobotics/rpi_ati_net_ft and gbartyzel/ros2_net_ft_driver (what they look for in the page)",
    )
    judge = "pynetft 2.1.3, NetFT 2.0.1, LouKordos/ati-netft-cpp@73a6349, gpldecha/netft_rdt_driver@115cf5a"
    facts = (
        stated("touch", "counts over counts per unit are N and Nm; over TCP also times the axis's scale",
               f"{AXIA} 10.5, netft_sensor.hpp:203"),
        assumed("touch", "the tool is touched 50 mm above the sensor's origin; z points out of the tool side, "
                "forces act on the tool", f"{NET_FT} chapters 10, 11; {AXIA} chapters 10 to 12; all drivers' sources"),
        assumed("touch", "16-bit counts are the nearest whole numbers, the scale the least for the rated load",
                f"{NET_FT} chapter 11, {AXIA} 10.5 (\"dependent on the sensor's model\")"),
        stated("identity", "units over TCP: 2 is N, 3 is Nm", f"{AXIA} 10.5"),
        stated("identity", "root, units N and Nm (rpi_ati_net_ft wants N-m), rated loads, flags of the page", LIVE),
        assumed("identity", "product name; runft and setbias in counts (a live box has its six gages in setbias)",
                f"{AXIA} 11.1 (DINT[6] both); {LIVE}, trimmed"),
        stated("configuration", "0041 and 0042 have no answer; the latest command decides", f"{NET_FT} table 10.1"),
        stated("configuration", "bit 0 of the last word over TCP biases, bit 1 clears the latch; 02 and 03 answer "
               "12 34, command, status", f"{AXIA} 10.2, 10.8"),
        stated("configuration", "status bits: 0 temperature, 1 supply, 2 gage broken, 3 busy, 16 condition latched, "
               "27 gage out of range, 28 simulated, 29 checksum, 30 out of range, 31 any; Net F/T: 17 saturated",
               f"{AXIA} tables 4.7, 4.9; 9620-05-NET FT-22 17.1"),
        assumed("configuration", "a bias goes on with the stream; none is set at power-up, no filter, status 0",
                f"{NET_FT} 10.1, pynetft (starts again after a bias), netft_rdt_driver.cpp (has none)"),
        assumed("configuration", "02 and 03 are refused, 0004 and the pages .cgi, by which a box is set, are unknown",
                "our choice: no driver that was run sends them"),
        assumed("configuration", "about 50 more elements of the page are missing; one configuration, the first",
                f"{AXIA} 11.1"),
        stated("timing", "7000 over a whole number of records a second, rounded up: 150 is 152",
               f"the same repository's instructions, measured; {NET_FT} chapter 10"),
        stated("timing", "records are numbered from 1 after each start, roll over to 0; samples from power-up, 7000 a "
               "second, never reset", f"{AXIA} 12.1.2"),
        stated("timing", "0 records: until 0000", f"{AXIA} 12.1.1"),
        assumed("timing", "1000 records a second, 40 of a buffered datagram (both are set in the box); "
                "a TCP client may be silent for ever", f"{NET_FT} chapters 10, 11; {AXIA} chapters 10, 12"),
    )  # fmt: skip

    def __init__(
        self,
        *,
        tool: Point = TOOL,
        counts_per_force: Annotated[int, Option("as calibrated", unit="1/N", low=1, high=2**31 - 1)] = 1_000_000,
        counts_per_torque: Annotated[int, Option("as calibrated", unit="1/Nm", low=1, high=2**31 - 1)] = 1_000_000,
        records_per_second: Annotated[
            int, Option("as set in the box, rounded up to 7000 over a whole number", unit="Hz", low=1, high=7000)
        ] = 1000,
        status: Status = 0,
        force_range: Rated = 330.0,
        torque_range: RatedTorque = 30.0,
        buffered: Annotated[int, Option("records of a datagram, after 0003; as set in the box", low=1, high=40)] = 40,
    ):
        rated = [round(force_range * counts_per_force)] * 3 + [round(torque_range * counts_per_torque)] * 3
        scale = [min(math.ceil(most / 0x7FFF), 0xFFFF) or 1 for most in rated]
        self._power_up(tool, counts_per_force, counts_per_torque, scale, status)
        self.rate_hz = self.sample_hz / (self.sample_hz // records_per_second)
        self.pages = Pages(counters=self.counters)
        self.rated, self.buffered = [f"{most:g}" for most in [force_range] * 3 + [torque_range] * 3], buffered
        self.records_a_datagram, self.held = 1, b""

    @property
    def commands(self) -> tuple[Command, ...]:
        """What the drivers send."""
        ask = b"GET /netftapi2.xml HTTP/1.1\r\nHost: 192.168.1.1\r\nAccept: */*\r\n\r\n"
        tcp, manual = "LouKordos/ati-netft-cpp@73a6349 netft_sensor.hpp", f"{AXIA}, chapter 10"
        rest = "00" * 18
        return (
            Command(name="start", request="12 34 00 02 00 00 00 00", origin="pynetft 2.1.3"),
            Command(name="one record", request="12 34 00 02 00 00 00 01", origin="NetFT 2.0.1 getMeasurement()"),
            Command(name="bias", request="12 34 00 42 00 00 00 00", origin="pynetft 2.1.3 bias()"),
            Command(name="stop", request="12 34 00 00 00 00 00 00", origin="NetFT 2.0.1 stopStreaming()"),
            Command(name="start, Axia", request="12 34 00 01 00 00 00 00", origin=f"{AXIA}, table 12.1"),
            Command(name="start, buffered", request="12 34 00 03 00 00 00 00", origin=f"{NET_FT}, table 10.1"),
            Command(name="clear latch", request="12 34 00 41 00 00 00 00", origin=f"{NET_FT}, table 10.1"),
            Command(name="page", request=ask, reply=f"{b'HTTP/1.1 200 '.hex()} *", port="http", origin="pynetft 2.1.3"),
            Command(name="read", request=f"00 {rest} 00", reply="12 34 ..{14}", port="tcp", origin=tcp),
            Command(name="calibration", request=f"01 {rest} 00", reply="12 34 02 03 ..{20}", port="tcp", origin=tcp),
            Command(name="bias and read", request=f"00 {rest} 01", reply="12 34 ..{14}", port="tcp", origin=manual),
            Command(name="tool transform", request=f"02 {rest} 00", reply="12 34 02 01", port="tcp", origin=manual),
            Command(name="monitor condition", request=f"03 {rest} 00", reply="12 34 03 01", port="tcp", origin=manual),
        )

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Return one datagram, or a piece of a request over TCP or to the web server."""
        if port != "http":
            return super().receive(data, t_ns, port)
        return self.pages.answers(data, {"/netftapi2.xml": ("text/xml", self._page())})

    def _page(self) -> bytes:
        each = (self.counts[0], quantize(self.bias[0], self.scale, -(2**31), 2**31 - 1), self.rated)
        counts, bias, rated = (";".join(map(str, values)) for values in each)
        force, torque, rate = int(self.scale[0]), int(self.scale[3]), int(self.rate_hz)
        return PAGE.format(
            status=self.status, counts=counts, bias=bias, rated=rated, force=force, torque=torque, rate=rate,
            buffered=self.buffered,
        ).encode("ascii")  # fmt: skip

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """A client comes or goes: what it left unfinished is forgotten."""
        if port == "http":
            self.pages.heard = b""
        return super().lines(dtr, rts, t_ns, port)

    def _obey(self, command: int, argument: int) -> bool:
        if command == BIAS:
            self.bias = self.felt
        elif command in (AXIA_START, START, START_BUFFERED):
            self.records_a_datagram, self.held = self.buffered if command == START_BUFFERED else 1, b""
            return super()._obey(START, argument)
        elif command != CLEAR_LATCH:
            return super()._obey(command, argument)
        return True

    def _sent(self, record: bytes) -> list[bytes]:
        self.held += record
        if self.left and len(self.held) < self.records_a_datagram * len(record):
            return []
        datagram, self.held = self.held, b""
        return [datagram]

    def _answer(self, request: bytes) -> list[bytes]:
        if request[0] in WRITES:
            self.counters["refused"] += 1
            return [REQUEST.head + bytes([request[0], REFUSED])]
        if request[0] == READ and request[-1] & TCP_BIAS:
            self.bias = self.felt
            self.counts = quantize(self.felt - self.bias, self.scale, -(2**31), 2**31 - 1)
        return super()._answer(request)

    def _tcp_status(self) -> int:
        return self.status >> 16


class OnrobotHex(Rdt):
    """HEX-E or HEX-H at the Compute Box, OptoForce at the EtherDAQ."""

    name = "onrobot_hex"
    title = "OnRobot (OptoForce) HEX, force and torque over UDP"
    rollovers = (*Rdt.rollovers, Rollover(name="sample", bits=16, step=1000, clock=True, state="samples_before"))
    sample_hz = 1000
    rate_hz = 100.0
    evidence = ("vendor document", "driver")
    sources = (
        "Fiiila/Optoforce_ethernet_client@ffaab55 Optoforce_ethernet_converter_manual.pdf (vendor), chapters 7 to 9",
        "jsbyysheng/onrobot_hex_ft_sensor@b8ae330 example/highspeed_udp.c, example/tcp.c, src/etherdaq_driver.cpp",
        "Fiiila/Optoforce_ethernet_client@ffaab55 UDP_client.py, TCP_client.py",
    )
    judge = "Fiiila/Optoforce_ethernet_client@ffaab55, jsbyysheng/onrobot_hex_ft_sensor@b8ae330, NetFT 2.0.1"
    facts = (
        stated("touch", "10 000 counts per N, 100 000 per Nm; over TCP counts times scale over counts per unit",
               f"{HEX_MANUAL} 8.3, 9.1.2"),
        assumed("touch", "the tool is touched 50 mm above the sensor's origin; z points out of the tool side, "
                "forces act on the tool", f"{HEX_MANUAL}, whole; {HEX}, whole"),
        assumed("touch", "over TCP: 10 000 and 100 000 counts per unit, each scale 100, nearest whole numbers",
                f"{HEX_MANUAL} chapter 9; {HEX} example/tcp.c, which takes any; TCP_client.py"),
        stated("identity", "units over TCP: 2 is N, 3 is Nm", f"{HEX_MANUAL} 9.2.2"),
        stated("configuration", "at power-up 100 records a second, the 15 Hz filter, no bias",
               f"{HEX_MANUAL} 7.1, 8.4, 8.5, 8.6"),
        stated("configuration", "bias 255 on, 0 off; filters 0 to 6; 1 to 255 ms, 0 stops", f"{HEX_MANUAL} 8.4 to 8.6"),
        stated("configuration", "bits of the status word", f"{HEX_MANUAL} 7.1"),
        stated("configuration", "the ROS driver sends the 16 bits of each argument twice",
               f"{HEX} src/etherdaq_driver.cpp:105-116"),
        assumed("configuration", "the box looks at the low 16 bits; other values than those stated change nothing",
                f"{HEX_MANUAL} chapter 8, etherdaq_driver.cpp"),
        assumed("configuration", "overload beyond 200 N or 10 Nm on an axis (options); the filter is a first-order "
                "low-pass", f"{HEX_MANUAL}, whole; {HEX}, whole"),
        stated("timing", "records are numbered from 1 after each start; the sample counter has 16 bits and counts ms",
               f"{HEX_MANUAL} 8.3, 7.1"),
        stated("timing", "the box is up 5 s after power-on, and closes TCP after 1 s without a request (left out: "
               "it is up at once, a client may be silent for ever)", f"{HEX_MANUAL} chapters 2, 9"),
    )  # fmt: skip

    def __init__(
        self,
        *,
        tool: Point = TOOL,
        status: Status = 0,
        force_range: Rated = 200.0,
        torque_range: RatedTorque = 10.0,
    ):
        self._power_up(tool, 10_000, 100_000, [100] * 6, status)
        self.low_pass.cutoff_hz = CUTOFF_HZ[4]
        self.range = np.array([force_range] * 3 + [torque_range] * 3)

    @property
    def commands(self) -> tuple[Command, ...]:
        """What the vendor's examples and its ROS driver send."""
        named = (("100 records a second", "82 00 00 00 0A"), ("15 Hz filter", "81 00 00 00 04"),
                 ("bias", "42 00 00 00 FF"), ("start", "02 00 00 00 00"), ("no bias", "42 00 00 00 00"),
                 ("stop", "00 00 00 00 00"))  # fmt: skip
        twice = (("100 records a second, ROS", "82 00 0A 00 0A"), ("50 Hz filter, ROS", "81 00 03 00 03"))
        vendor, ros, rest = f"{HEX} example/highspeed_udp.c", f"{HEX} src/etherdaq_driver.cpp", "00" * 19
        tcp = f"{HEX} example/tcp.c"
        return (
            *(Command(name=name, request=f"12 34 00 {what}", origin=vendor) for name, what in named),
            *(Command(name=name, request=f"12 34 00 {what}", origin=ros) for name, what in twice),
            Command(name="no records", request="12 34 00 82 00 00 00 00", origin=f"{HEX_MANUAL}, 8.6"),
            Command(name="read", request=f"00 {rest}", reply="12 34 ..{14}", port="tcp", origin=tcp),
            Command(name="calibration", request=f"01 {rest}", reply="12 34 02 03 ..{20}", port="tcp", origin=tcp),
        )

    def _sample(self, t_ns: int) -> int:
        return super()._sample(t_ns) & 0xFFFF

    def _status(self) -> int:
        over = sum(1 << 4 + axis for axis in np.flatnonzero(np.abs(self.felt[0]) > self.range).tolist())
        return self.status | (over | SENSOR if over else 0)

    def _obey(self, command: int, argument: int) -> bool:
        low = argument & 0xFFFF
        if command == BIAS and low in (BIAS_ON, BIAS_OFF):
            self.bias = self.felt if low == BIAS_ON else np.zeros((1, 6))
        elif command == FILTER and low < len(CUTOFF_HZ):
            self.low_pass.cutoff_hz = CUTOFF_HZ[low]
        elif command == PERIOD and low <= 0xFF:
            self.period_ns = low * 1_000_000
        else:
            return super()._obey(command, argument)
        return True
