"""ATI Wireless F/T: the box of one to six force-torque transducers, which sends their counts over Wi-Fi.

Wire: commands and records on UDP port 49152, high byte first; settings as lines of telnet on TCP port 23. A
``COMMAND`` has no answer; records follow command 1, each with the transducers in its mask.

    command  data                about
    1        number, 4 bytes     send so many records, 0: without end
    2        -                   stop
    5        -                   end the telnet session

    line of telnet      about
    rate R N            R records a second, each the mean of N samples; R N at most 4000
    bias * ON, OFF      the present counts of all transducers become 0, or no more; a number for one of them
    ntp enable 1, 0     time by NTP

Evidence: a laboratory's driver, after the maker's Java program.

Try it: ``tactemu run ati_wireless_ft``, then send 00 0A 00 01 00 00 00 00 73 46.
"""

import re
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Device, Frame, Layout, Lines, Option, Packets, Request, Rollover, Sense, Sent, Tcp, Transmissions, Udp, command,
    command_table, fact_table, points, stack, wrench,
)  # fmt: skip

COMMAND = Frame("""
    command
    0     >u2             size = total
    2     u1              sequence
    3     u1              command
    4     bytes           data
    last  >crc16_ati      crc
""")
RECORD = Frame("""
    record, transducer by transducer
    0     >u4 wrap            time        20 bits of seconds, 12 of 1/4096 s
    4     >u4 wrap            sequence
    8     >u4 x 2             status      of transducers 1 to 3, and 4 to 6: bits 1 3 5 green, 24 25 26 saturated
    16    u1                  battery     level
    17    u1                  mask        bit 0: transducer 1 is present
    18    >i4 x taxels x 6    counts      Fx Fy Fz Tx Ty Tz of each that is present
""")
TRANSDUCERS, MAX_HZ, MIN_HZ = 6, 4000, 5
FULL_COUNTS = 2**31 - 1
UNTIL_STOPPED = -1
"""The number of records left while a stream has no end."""
LINE = re.compile(rb"rate (\d{1,4}) (\d{1,4})|bias (\*|[1-6]) (ON|OFF)|ntp enable ([01])")
PROMPT = b"OK\r\n>"
DRIVER = "personalrobotics/forque_sensor_hardware@875d0a7"
CPP, HPP = f"{DRIVER} src/wireless_ft.cpp", f"{DRIVER} include/forque_sensor_hardware/wireless_ft.h"
ALL = "wireless_ft.cpp, wireless_ft.h, main.cpp (all whole)"


def in_row(transducers: int, place: tuple[float, float, float]) -> Layout:
    """Return a point on each transducer [m], 0.1 m apart."""
    names = {f"transducer {k + 1}": 0.1 * k for k in range(transducers)}
    return stack(*(points({name: (place[0] + x, *place[1:])}, link=name) for name, x in names.items()))


class AtiWirelessFt(Device):
    """A box with transducers."""

    name = "ati_wireless_ft"
    title = "ATI Wireless F/T"
    kind = "force-torque sensor"
    ports = (Udp(name="udp", port=49152), Tcp(name="telnet", port=23))
    rate_hz = 50.0
    columns = wrench("Fx Fy Fz Tx Ty Tz", per_unit=(1_000_000, 1_000_000), low=-FULL_COUNTS - 1, high=FULL_COUNTS)
    rollovers = (
        Rollover(name="time", bits=32, step=4096, clock=True, state="clock"),
        Rollover(name="sequence", bits=32, state="sequence"),
    )
    evidence = ("driver",)
    sources = (f"{CPP} (commands, CRC, telnet)", f"{HPP} (record, status)")
    judge = DRIVER
    origin = f"{CPP}:351-432; CRC by its crcBuf"
    documented = command_table(
        r"""
        rate          telnet: 'rate 50 2\r\n'      'OK\r\n>'
        bias          telnet: 'bias * ON\r\n'      'OK\r\n>'
        bias of one   telnet: 'bias 1 OFF\r\n'     'OK\r\n>'
        time          telnet: 'ntp enable 1\r\n'   'OK\r\n>'
        """,
        origin=f"{CPP}:202-236",
    )
    documented_with = ("transducers",)
    facts = fact_table(f"""
        stated touch: the record, high byte first; it has only the transducers in the mask, in order @ {HPP}:119-133;
            {CPP}:526-538
        stated touch: counts per N and Nm, 1000000 by default @ {DRIVER} src/main.cpp:107, 116
        stated touch: the time has 20 bits for seconds and 12 bits for the fraction of a second @ {CPP}:481-500
        stated touch: the bits of the status @ {HPP}:58-106
        assumed touch: counts are of force and torque, not of gauges; the tool is touched 50 mm above the origin and to
            the side of it @ {ALL}
        assumed identity: all LEDs of a transducer that is present are green; the battery is at 100 %; records are
            numbered from 1 @ {ALL}
        stated configuration: the lengths, the sequence number, a CRC that starts at 1234, and the number of records @
            {CPP}:351-432, 471
        stated configuration: the command lines over telnet; rate times samples is at most 4000 @ {CPP}:202-236;
            {HPP}:113
        assumed configuration: the text of the answers; the time begins at 0, even with NTP; records are not averaged; a
            wrong CRC gets no answer; settings are lost at power-off; rates begin at 5, as the driver allows @ {ALL}
        stated timing: UDP 49152, TCP 23 @ {HPP}:109-110
        assumed timing: 50 records a second after power-up, as the driver sets it @ {ALL}
    """)

    def __init__(self, *, transducers: Annotated[int, Option("transducers of the box", low=1, high=TRANSDUCERS)] = 1):
        self.layout = in_row(transducers, (0.02, 0.01, 0.05))
        self.senses = (Sense("wrench", at=in_row(transducers, (0.0, 0.0, 0.0))),)
        self.record = RECORD.bind(wire_order=self.layout.wire_order, mask=(1 << transducers) - 1, battery=100)
        self.packets, self.telnet = (
            Packets(COMMAND, by="command", counters=self.counters, max_data=4), Lines(counters=self.counters)
        )  # fmt: skip
        self.zero = np.zeros((transducers, 6))
        self.left, self.clock, self.sequence = 0, 0, 0

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a record, between start and stop."""
        if not self.left:
            return ()
        self.left -= self.left > 0
        self.sequence += 1
        status, full = [0, 0], (np.abs(self.counts) >= FULL_COUNTS).any(axis=1).tolist()
        for k, is_full in enumerate(full):
            status[k // 3] |= 2 << 2 * (k % 3) | is_full << 24 + k % 3
        time = (t_ns << 12) // 1_000_000_000 + self.clock
        record = self.record.pack(time=time, sequence=self.sequence, status=status, counts=self.counts)
        return [Sent(record, port="udp")]

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey a datagram, or answer lines of telnet."""
        if port == "telnet":
            return [answer for line in self.telnet.cut(data) for answer in self._set(line)]
        self.packets.reset()  # each datagram is one command
        return super().receive(data, t_ns, port)

    def lines(self, dtr: bool, rts: bool, t_ns: int, port: str) -> Transmissions:
        """Drop the incomplete line of a client that comes or goes."""
        self.telnet.reset()
        return ()

    @command("00 0A 00 01 00 00 00 00 73 46", name="start", data=">I")
    @command("00 0A 00 01 00 00 00 02 53 04", name="two records")
    def start(self, request: Request) -> Transmissions:
        """Send records."""
        self.left = request.value or UNTIL_STOPPED
        return ()

    @command("00 06 01 02 4E 79", name="stop")
    @command("00 06 00 05 0D AF", name="end telnet")
    def stop(self, request: Request) -> Transmissions:
        """Send no more records; or drop the incomplete line of telnet."""
        if request.command == 2:
            self.left = 0
        else:
            self.telnet.reset()
        return ()

    def _set(self, line: bytes) -> list[bytes]:
        found = LINE.fullmatch(line)
        if found is None:
            self.counters["unknown_command"] += 1
            return [b"?\r\n>"]
        rate, samples, which, switch, _ = found.groups()
        if rate and not (MIN_HZ <= int(rate) and 1 <= int(samples) <= MAX_HZ // int(rate)):
            self.counters["refused"] += 1
            return [b"?\r\n>"]
        if rate:
            self.period_ns = round(1e9 / int(rate))
        if which:
            chosen = slice(None) if which == b"*" else slice(int(which) - 1, int(which))
            self.zero = self.zero.copy()
            self.zero[chosen] = self.present[chosen] if switch == b"ON" else 0.0
        return [PROMPT]
