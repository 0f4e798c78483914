"""SingleTact: one capacitive pad that feels a force, behind its USB board or an Arduino.

Wire: USB serial, 115200. It only answers, ``ANSWER`` to ``REQUEST``: operation 01 reads ``count`` bytes of a memory,
02 writes ``data`` into it. Hosts send a 16th byte, 00, behind a request to read, which is skipped.

    location  content
    0..127    settings, which hosts read as four times 32 bytes
    128..133  ``DATA``

The driver sets DTR for 1 s, clears it for 1 s and sets RTS when it opens, and ignores what is 00 here but the settings.

Try it: ``tactemu run singletact``, then send FF FF FF FF 04 64 01 01 80 06 FF FE FE FE FE.
"""

from __future__ import annotations

from typing import Annotated, Literal

from firmware_protocols import (
    Column,
    Command,
    Counts,
    Device,
    Option,
    Outs,
    Reading,
    Rollover,
    Serial,
    points,
)
from firmware_protocols.adc import quantize
from firmware_protocols.framing import MORE, SOUND, Packets
from firmware_protocols.tables import Frame

REQUEST = Frame("""
    request
    0     FF FF FF FF     head
    4     u1              address    on the I2C behind the board
    5     u1              timeout    usually 64
    6     u1              id         the answer repeats it
    7     u1              operation  01 read, 02 write
    8     u1              location
    9     u1              count
    10    bytes           data       of a write
    ..    FF FE FE FE FE  tail
""")
ANSWER = Frame("""
    answer
    0     u1              first      AA from the USB board, FF from an Arduino
    1     FF FF FF        head
    4     u1              address
    5     00              unused
    6     u1              id
    7     >u4 wrap        time       [ms]
    11    u1              count = len(data)
    12    bytes           data       of a read
    ..    FE FE FE FE     tail
""")
DATA = Frame("""
    what is felt
    0     >u2             iteration
    2     00 00           unused
    4     >u2             value      255: no force
""")
READ, WRITE = 1, 2
REQUEST_BYTES = 15
SETTINGS = 128
FIRST = {"usb": 0xAA, "arduino": 0xFF}
REST, FULL = 255, 1023


class SingleTact(Device):
    """One pad, asked for what it feels."""

    name = "singletact"
    kind = "fingertip"
    title = "SingleTact, one pad"
    ports = (Serial(baud=115200, usb=True),)
    columns = (Column(name="value", low=0, high=FULL, rest=REST, push=1),)
    rollovers = (
        Rollover(name="iteration", bits=16, state="iteration"),
        Rollover(name="time", bits=32, step=1000, clock=True),
    )
    evidence = ("driver",)
    sources = (
        "philip-long/singletact-python-wrapper@659796f singletact_library.py",
        "SingleTact/NETInterface@30c0e82 l.402-405 (AA from the USB board; the vendor's own)",
    )
    judge = "own second reader"
    assumed = (
        "51.2 counts/N above 255, up to 1023; a pad of 15 mm",
        "100 conversions per second, which the iteration counts, high byte first; the time is in ms",
        "settings are 0 until written, and again after power-up; a write is answered without data",
        "silence for another address, for bytes beyond the data, and for a write of what is no setting",
    )

    def __init__(
        self,
        *,
        board: Annotated[Literal["usb", "arduino"], Option("what is between the pad and the host")] = "usb",
        address: Annotated[int, Option("of the pad on the board's I2C", low=0, high=0x7F)] = 4,
        counts_per_newton: Annotated[float, Option("above the rest", unit="1/N", low=1e-6)] = 51.2,
    ):
        self.layout = points({"pad": (0.0, 0.0, 0.0)}, pitch=0.015)
        self.address, self.counts_per_newton = address, counts_per_newton
        self.answer = ANSWER.bind(first=FIRST[board], address=address)
        self.packets = Packets(REQUEST.head, _size, _check, counters=self.counters)
        self.settings = bytes(SETTINGS)
        self.iteration = 0

    @property
    def commands(self) -> tuple[Command, ...]:
        """Readings and settings, of a pad at the usual address."""
        if self.address != 4:
            return ()
        asked = (
            ("what is felt", "01 01 80 06", "01 ..{4} 06 ..{6}"),
            ("settings from 0", "02 01 00 20", "02 ..{4} 20 ..{32}"),
            ("settings from 32", "03 01 20 20", "03 ..{4} 20 ..{32}"),
            ("settings from 64", "04 01 40 20", "04 ..{4} 20 ..{32}"),
            ("settings from 96", "05 01 60 20", "05 ..{4} 20 ..{32}"),
            ("write two settings", "06 02 10 02 12 34", "06 ..{4} 00"),
        )
        return tuple(
            Command(
                name=name,
                request=f"FF FF FF FF 04 64 {request} FF FE FE FE FE",
                reply=f".. FF FF FF 04 00 {reply} FE FE FE FE",
                origin="singletact-python-wrapper@659796f singletact_library.py",
            )
            for name, request, reply in asked
        )

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """The value, 0..1023, shape ``(1,)``."""
        self.iteration = (self.iteration + 1) & 0xFFFF
        push = self.layout.push(reading["force"])
        self.counts = quantize(push, self.counts_per_newton, 0, FULL, rest=REST)
        return self.counts

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Requests in chunks of any size."""
        return [out for packet in self.packets.cut(data, t_ns) for out in self._obey(packet, t_ns)]

    def _obey(self, packet: bytes, t_ns: int) -> list[bytes]:
        request = REQUEST.unpack(packet)
        assert request is not None, "the cutter has checked it"
        if request["address"] != self.address:
            self.counters["other_device"] += 1
            return []
        memory = self.settings + DATA.pack(iteration=self.iteration, value=int(self.counts[0]))
        reads, first, data = request["operation"] == READ, request["location"], request["data"]
        end = first + request["count"]
        if end > (len(memory) if reads else SETTINGS):
            self.counters["refused"] += 1
            return []
        if not reads:
            self.settings = self.settings[:first] + data + self.settings[end:]
        content = memory[first:end] if reads else b""
        return [self.answer.pack(id=request["id"], time=t_ns // 1_000_000, data=content)]


def _size(data: bytes) -> int | str:
    if len(data) < 10:
        return MORE
    if data[7] not in (READ, WRITE):
        return "unknown_command"
    return REQUEST_BYTES + (data[9] if data[7] == WRITE else 0)


def _check(packet: bytes) -> str:
    return SOUND if REQUEST.unpack(packet) else "bad_tail"
