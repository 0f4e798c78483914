"""ATI Net F/T and OnRobot (OptoForce) HEX: force and torque over UDP, in RDT's datagrams, and over TCP.

Wire: UDP port 49152. The host sends ``REQUEST`` and gets no answer; records leave as ``RECORD``, one in a datagram, to
the last sender. All numbers are big-endian. Datagrams of other lengths than 8 bytes, or with another head, are ignored.

    command  argument                     about
    0000     -                            stop
    0001     as 0002                      Ethernet Axia: start
    0002     records, 0: until stopped    start; records are numbered anew
    0003     as 0002                      ATI: start, several records a datagram (option ``buffered``)
    0041     -                            ATI: clears the latch of monitor conditions, of which the model has none
    0042     ATI: 0                       bias: the present force and torque become zero
             HEX: FF on, 00 off
    0081     HEX: 0 none, 1..6            low-pass at 500, 150, 50, 15, 5, 1.5 Hz; 15 Hz at power-up
    0082     HEX: period [ms], 0 stops    sampling and sending; 10 ms at power-up

The HEX uses the low half of an argument: the vendor's ROS driver repeats 16 bits in both halves.

    counts   per N       per Nm
    ATI      1 000 000   1 000 000        usually; the page netftapi2.xml has the values
    HEX      10 000      100 000

Status, ATI: bit 31 any error, 17 (Axia: 30) saturated, 16 monitor condition latched ... (option). HEX: bits 0-2 the
sensor that has an error, from 1, 3 several have, 4-9 overload of Fx Fy Fz Tx Ty Tz, 10-12 sensor not found (1) or
broken (2), 13-15 converter's error (1) or no communication (2).

Port "tcp" is TCP port 49151, one client at a time. Requests have 20 bytes, the first is the command.

    command  bytes 18, 19                 answer
    00       ATI: 1 bias, 2 clear latch   ``READING``
    01       -                            ``CALIBRATION``
    02 03    -                            ATI: 12 34, command, 1: the tool transform and monitor conditions are refused

Port "http" (ATI only) is the box's web server, of which the model has the page ``/netftapi2.xml``: drivers read counts
and units there before they start. ``pynetft`` reads it first, then starts; for a bias it sends 0042 and starts again.
``NetFT`` requests one record at a time, always on port 49152.

Force and torque act on the tool, at the sensor's origin, z out of its tool side: a push is negative.

Try it: ``tactemu run ati_net_ft --port tcp=tcp:49151 --port http=tcp:8080``, then
``pynetft.Client(pynetft.Config(sensor_host="127.0.0.1", http_port=8080))``.
"""

import math
from typing import Annotated

import numpy as np

from firmware_protocols import Option, Rollover, Tcp, Tool, Transmissions, command_table, fact_table
from firmware_protocols.devices.ati_rdt import READ, REQUEST, START, Rdt
from firmware_protocols.protocols.http import Pages

PAGE = (
    '<?xml version="1.0"?><netft>\n<prodname>Net F/T</prodname><runstat>0x{status:08x}</runstat>'
    "<runft>{counts}</runft><runrate>7000</runrate>\n<scfgfu>N</scfgfu><scfgtu>Nm</scfgtu>\n"
    "<cfgcpf>{force}</cfgcpf><cfgcpt>{torque}</cfgcpt>\n<cfgmr>{rated}</cfgmr>\n<setcfgsel>0</setcfgsel>"
    "<setmce>0</setmce>\n<setbias>{bias}</setbias>\n<setuserfilter>0</setuserfilter>\n<netip>192.168.1.1</netip>\n"
    "<comrdte>Enabled</comrdte><comrdtrate>{rate}</comrdtrate><comrdtbsiz>{buffered}</comrdtbsiz>\n</netft>\n"
)
LIVE = "a live page of a box with firmware 2.2.59, in a public repository's test_ft_config.py"
AXIA_START, START_BUFFERED, CLEAR_LATCH, BIAS, FILTER, PERIOD = 0x01, 0x03, 0x41, 0x42, 0x81, 0x82
BIAS_ON, BIAS_OFF, TCP_BIAS = 0xFF, 0x00, 1
WRITE_REQUESTS, REFUSED = (2, 3), 1
NET_FT = "ATI 9620-05-NET FT-11"
AXIA = "ATI 9610-05-Ethernet Axia-09"
HEX = "jsbyysheng/onrobot_hex_ft_sensor@b8ae330"
HEX_MANUAL = "OptoForce manual for Ethernet Converter 2.0"
SENSOR_NUMBER = 1
"""The number of the HEX that has an error; there is only one."""
CUTOFF_HZ = (None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)
Status = Annotated[int, Option("status of every record; the bits are faults of the box", low=0, high=0xFFFF_FFFF)]
Rated = Annotated[float, Option("rated force of each axis", unit="N", low=1e-3)]
RatedTorque = Annotated[float, Option("rated torque of each axis", unit="Nm", low=1e-3)]


class AtiNetFt(Rdt):
    """A Net F/T box, or an Ethernet Axia."""

    name = "ati_net_ft"
    title = "ATI Net F/T, force and torque"
    ports = (*Rdt.ports, Tcp(name="http", port=80, is_plugged=False))
    rollovers = (*Rdt.rollovers, Rollover(name="sample", bits=32, step=7000, clock=True, state="samples_before"))
    sample_hz = 7000
    evidence = ("vendor document", "driver")
    sources = (
        "ATI manuals 9620-05-NET FT-11 chapters 10, 11 and 9610-05-Ethernet Axia-09 chapters 4.8, 10 to 12",
        "pynetft 2.1.3 (record, page, bias), NetFT 2.0.1 __init__.py (record, single records)",
        "LouKordos/ati-netft-cpp@73a6349 netft_sensor.hpp (TCP), gpldecha/netft_rdt_driver@115cf5a (RDT)",
        "rpiRobotics/rpi_ati_net_ft and gbartyzel/ros2_net_ft_driver (what they look for in the page)",
    )
    documented_with = None
    documented = command_table(rf"""
        @ pynetft 2.1.3
        start                 12 34 00 02 00 00 00 00
        bias                  12 34 00 42 00 00 00 00
        ? page                http: 'GET /netftapi2.xml HTTP/1.1\r\nHost: 192.168.1.1\r\nAccept: */*\r\n\r\n'
            48 54 54 50 2F 31 2E 31 20 32 30 30 20 *  HTTP/1.1 200
        @ NetFT 2.0.1
        one record            12 34 00 02 00 00 00 01
        stop                  12 34 00 00 00 00 00 00
        @ {AXIA}, table 12.1
        start, Axia           12 34 00 01 00 00 00 00
        @ {NET_FT}, table 10.1
        start, buffered       12 34 00 03 00 00 00 00
        clear latch           12 34 00 41 00 00 00 00
        @ LouKordos/ati-netft-cpp@73a6349 netft_sensor.hpp
        ? read                tcp: {"00" * 20}               12 34 ..{{14}}
        ? calibration         tcp: 01{"00" * 19}             12 34 02 03 ..{{20}}
        @ {AXIA}, chapter 10
        bias and read         tcp: {"00" * 19}01             12 34 ..{{14}}
        tool transform        tcp: 02{"00" * 19}             12 34 02 01
        monitor condition     tcp: 03{"00" * 19}             12 34 03 01
    """)
    judge = "pynetft 2.1.3, NetFT 2.0.1, LouKordos/ati-netft-cpp@73a6349, gpldecha/netft_rdt_driver@115cf5a"
    facts = fact_table(f"""
        stated touch: counts divided by the counts per unit are N and Nm; over TCP they are also multiplied by the scale
            of their axis @ {AXIA} 10.5, netft_sensor.hpp:203
        assumed touch: the tool is touched 50 mm above the sensor's origin; z points out of the tool side, forces act on
            the tool @ {NET_FT} chapters 10, 11; {AXIA} chapters 10 to 12; all drivers' sources
        assumed touch: 16-bit counts are rounded; the scale is the smallest one with which the rated load fits @
            {NET_FT} chapter 11, {AXIA} 10.5 ("dependent on the sensor's model")
        stated identity: the codes of units over TCP: 2 is N, 3 is Nm @ {AXIA} 10.5
        stated identity: the root element of the page, its units N and Nm (rpi_ati_net_ft expects N-m), rated loads and
            flags @ {LIVE}
        assumed identity: the product name; runft and setbias are in counts (in a real box setbias holds its six gages)
            @ {AXIA} 11.1 (DINT[6] both); {LIVE}, trimmed
        stated configuration: commands 0041 and 0042 get no answer; the latest start command decides what is sent @
            {NET_FT} table 10.1
        stated configuration: over TCP bit 0 of the last word sets the bias, bit 1 clears the latch; 02 and 03 are
            answered with 12 34, the command and a status @ {AXIA} 10.2, 10.8
        stated configuration: status bits: 0 temperature, 1 supply, 2 broken gage, 3 busy, 16 condition latched, 27 gage
            out of range, 28 simulated, 29 checksum, 30 out of range, 31 any of them; on the Net F/T 17 is saturation @
            {AXIA} tables 4.7, 4.9; 9620-05-NET FT-22 17.1
        assumed configuration: setting a bias does not stop the stream; after power-up there is no bias and no filter,
            and the status is 0 @ {NET_FT} 10.1, pynetft (starts again after a bias), netft_rdt_driver.cpp (has none)
        assumed configuration: 02 and 03 are refused; 0004 and the .cgi pages that configure a box are not modelled @
            our choice: no driver that was run sends them
        assumed configuration: the page lacks about 50 of its elements; it has only one configuration, the first @
            {AXIA} 11.1
        stated timing: the rate is 7000 records a second divided by a whole number, rounded up: a request for 150 gives
            152 @ the same repository's instructions, measured; {NET_FT} chapter 10
        stated timing: records are numbered from 1 after each start and roll over to 0; samples are counted from
            power-up on, 7000 a second, and never reset @ {AXIA} 12.1.2
        stated timing: a request for 0 records streams until the command 0000 @ {AXIA} 12.1.1
        assumed timing: 1000 records a second, 40 records in a buffered datagram (both are settings of the box); a TCP
            client may be silent for any time @ {NET_FT} chapters 10, 11; {AXIA} chapters 10, 12
    """)

    def __init__(
        self,
        *,
        tool: Tool = (0.0, 0.0, 0.05),
        counts_per_force: Annotated[
            int, Option("scale of force, as calibrated", unit="1/N", low=1, high=2**31 - 1)
        ] = 1_000_000,
        counts_per_torque: Annotated[
            int, Option("scale of torque, as calibrated", unit="1/Nm", low=1, high=2**31 - 1)
        ] = 1_000_000,
        records_per_second: Annotated[
            int, Option("rate that is set in the box, rounded up to 7000 over an integer", unit="Hz", low=1, high=7000)
        ] = 1000,
        status: Status = 0,
        force_range: Rated = 330.0,
        torque_range: RatedTorque = 30.0,
        buffered: Annotated[int, Option("records in a datagram after 0003, as set in the box", low=1, high=40)] = 40,
    ):
        rated = [round(force_range * counts_per_force)] * 3 + [round(torque_range * counts_per_torque)] * 3
        scale = [min(math.ceil(most / 0x7FFF), 0xFFFF) or 1 for most in rated]
        self._power_up(tool, counts_per_force, counts_per_torque, scale, status)
        self.rate_hz = self.sample_hz / (self.sample_hz // records_per_second)
        self.pages = Pages(counters=self.counters)
        self.rated, self.buffered = [f"{most:g}" for most in [force_range] * 3 + [torque_range] * 3], buffered
        self.records_a_datagram, self.held = 1, b""

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey one datagram, or answer a request over TCP or to the web server."""
        if port != "http":
            return super().receive(data, t_ns, port)
        return self.pages.answers(data, {"/netftapi2.xml": ("text/xml", self._page())})

    def _page(self) -> bytes:
        each = (self.counts[0], self.quantized(self.bias[0]), self.rated)
        counts, bias, rated = (";".join(map(str, values)) for values in each)
        force, torque, rate = int(self.scale[0]), int(self.scale[3]), int(self.rate_hz)
        numbers = {"force": force, "torque": torque, "rate": rate, "buffered": self.buffered}
        return PAGE.format(status=self.status, counts=counts, bias=bias, rated=rated, **numbers).encode("ascii")

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Drop the incomplete request of a client that comes or goes."""
        if port == "http":
            self.pages.buffer = b""
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
        if request[0] in WRITE_REQUESTS:
            self.counters["refused"] += 1
            return [REQUEST.head + bytes([request[0], REFUSED])]
        if request[0] == READ and request[-1] & TCP_BIAS:
            self.bias = self.felt
            self.counts = self.quantized(self.felt - self.bias)
        return super()._answer(request)

    def _tcp_status(self) -> int:
        return self.status >> 16


class OnrobotHex(Rdt):
    """A HEX-E or HEX-H at the Compute Box, or an OptoForce at the EtherDAQ."""

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
    documented_with = None
    documented = command_table(f"""
        @ {HEX} example/highspeed_udp.c
        100 records a second       12 34 00 82 00 00 00 0A
        15 Hz filter               12 34 00 81 00 00 00 04
        bias                       12 34 00 42 00 00 00 FF
        start                      12 34 00 02 00 00 00 00
        no bias                    12 34 00 42 00 00 00 00
        stop                       12 34 00 00 00 00 00 00
        @ {HEX} src/etherdaq_driver.cpp
        100 records a second, ROS  12 34 00 82 00 0A 00 0A
        50 Hz filter, ROS          12 34 00 81 00 03 00 03
        @ {HEX_MANUAL}, 8.6
        no records                 12 34 00 82 00 00 00 00
        @ {HEX} example/tcp.c
        ? read                     tcp: {"00" * 20}    12 34 ..{{14}}
        ? calibration              tcp: 01{"00" * 19}  12 34 02 03 ..{{20}}
    """)
    judge = "Fiiila/Optoforce_ethernet_client@ffaab55, jsbyysheng/onrobot_hex_ft_sensor@b8ae330, NetFT 2.0.1"
    facts = fact_table(f"""
        stated touch: 10 000 counts per N, 100 000 per Nm; over TCP the load is counts times scale, divided by the
            counts per unit @ {HEX_MANUAL} 8.3, 9.1.2
        assumed touch: the tool is touched 50 mm above the sensor's origin; z points out of the tool side, forces act on
            the tool
        assumed touch: over TCP: 10 000 and 100 000 counts per unit, every scale is 100, values are rounded @
            {HEX_MANUAL} chapter 9; {HEX} example/tcp.c, which takes any; TCP_client.py
        stated identity: the codes of units over TCP: 2 is N, 3 is Nm @ {HEX_MANUAL} 9.2.2
        stated configuration: after power-up 100 records a second, the 15 Hz filter, no bias @ {HEX_MANUAL} 7.1, 8.4,
            8.5, 8.6
        stated configuration: bias 255 is on, 0 off; filters are 0 to 6; periods are 1 to 255 ms, 0 stops the stream @
            {HEX_MANUAL} 8.4 to 8.6
        stated configuration: the bits of the status word @ {HEX_MANUAL} 7.1
        stated configuration: the ROS driver sends the 16 bits of each argument twice @ {HEX}
            src/etherdaq_driver.cpp:105-116
        assumed configuration: the box uses the low 16 bits; values other than those stated have no effect @
            {HEX_MANUAL} chapter 8, etherdaq_driver.cpp
        assumed configuration: overload beyond 200 N or 10 Nm on an axis (options); the filter is a first-order low-pass
        stated timing: records are numbered from 1 after each start; the sample counter has 16 bits and counts ms @
            {HEX_MANUAL} 8.3, 7.1
        stated timing: the box is up 5 s after power-on, and closes TCP after 1 s without a request (not modelled: the
            model is up at once, and a client may be silent for any time) @ {HEX_MANUAL} chapters 2, 9
    """, looked=f"{HEX_MANUAL}, whole; {HEX}, whole")  # fmt: skip

    def __init__(
        self,
        *,
        tool: Tool = (0.0, 0.0, 0.05),
        status: Status = 0,
        force_range: Rated = 200.0,
        torque_range: RatedTorque = 10.0,
    ):
        self._power_up(tool, 10_000, 100_000, [100] * 6, status)
        self.low_pass.cutoff_hz = CUTOFF_HZ[4]
        self.range = np.array([force_range] * 3 + [torque_range] * 3)

    def _sample(self, t_ns: int) -> int:
        return super()._sample(t_ns) & 0xFFFF

    def _status(self) -> int:
        over = sum(1 << 4 + axis for axis in np.flatnonzero(np.abs(self.felt[0]) > self.range).tolist())
        return self.status | (over | SENSOR_NUMBER if over else 0)

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
