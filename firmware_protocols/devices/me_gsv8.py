"""ME-Systeme GSV-8: an amplifier of eight strain gauges, here with a load cell on each channel.

Wire: USB-CDC, opened at 115200; the speed has no effect. The host sends a ``REQUEST`` and gets an ``ANSWER``.
``READING`` s come unasked from power-up on.

    command  data                      data of the answer      about
    23       -                         -                       no more readings
    24       -                         -                       readings
    3B       -                         a reading, no answer
    0C       channel                   -                       the present value becomes zero
    14       channel                   float                   user scale: the value at full input
    15       channel, float            -
    8A       -                         float                   readings a second
    8B       float                     -
    A2       channel, FF               00, u4                  type of the input, and its range [0.01 mV/V]

Channels are 1 to 8, and 0 in a write: all. Errors: 40 unknown command, 51 channel, 52 value, 5B number of data.

Evidence: the maker's Python library, run.

Try it: ``tactemu run me_gsv8``, then ``gsv86(PORT, 115200).ReadMultiple()`` of the package gsv86lib.
"""

import struct
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Column, Counts, Device, Frame, Option, Packets, Reading, Refused, Request, Serial, Transmissions, command,
    fact_table, points,
)  # fmt: skip

REQUEST = Frame("""
    request
    0     AA            start
    1     u1            size = len(data) + 144
    2     u1            command
    3     bytes         data
    ..    85            end
""")
ANSWER = Frame("""
    answer
    0     AA            start
    1     u1            size = len(data) + 80
    2     u1            error
    3     bytes         data
    ..    85            end
""")
READING = Frame("""
    reading, in the order of the channels
    0     AA 17         start       measured values, of eight channels
    2     u1            status      B0, floats; 1: an input is overloaded
    3     >f4 x taxels  values      in units of the user scale
    ..    85            end
""")
CHANNELS = 8
FLOATS, OVERLOADED = 0xB0, 1
INPUT_RANGE = 200
"""The range of an input [0.01 mV/V]."""
ERRORS = {"unknown_command": 0x40, "bad_length": 0x5B, "address": 0x51, "value": 0x52}
LIBRARY = "gsv86lib 0.1.1"
ALL = f"{LIBRARY}, all files; me-systeme/gsv86lib@d9833da documentation.pdf, examples"


class MeGsv8(Device):
    """An amplifier that sends the values of its channels."""

    name = "me_gsv8"
    title = "ME-Systeme GSV-8, eight load cells"
    kind = "skin"
    ports = (Serial(baud=115200, usb=True),)
    evidence = ("driver",)
    sources = (
        f"{LIBRARY} GSV6_SeriallLib.py, GSV6_Protocol.py, GSV6_BasicFrameType.py, GSV6_AnfrageCodes.py, gsv86.py",
    )
    judge = LIBRARY
    origin = f"{LIBRARY} GSV6_SeriallLib.py, run"
    documented_with = None
    facts = fact_table(f"""
        stated touch: a frame has one float for each channel, high byte first; bit 0 of the status is overload @
            {LIBRARY} GSV6_Protocol.py:165, GSV6_BasicFrameType.py:85
        stated touch: the value is the signal divided by the input range, times the user scale @ {LIBRARY} gsv86.py:942
        assumed touch: each channel is a load cell, 30 mm from the next; an input saturates, and reports an overload, at
            its range @ {ALL}
        stated configuration: requests, answers, errors @ {LIBRARY} GSV6_AnfrageCodes.py, GSV6_ErrorCodes.py
        assumed configuration: the input range is 2 mV/V; other commands are unknown; nothing is saved @ {ALL}
        assumed configuration: readings are sent from power-up on, as the library expects @ {LIBRARY} gsv86.py:132
        assumed timing: 10 readings a second after power-up; rates are 0.1 to 12000, the highest that the library knows
            @ {ALL}
    """)
    rate_hz = 10.0

    def __init__(
        self,
        *,
        rated_load: Annotated[float, Option("of each load cell", unit="N", low=1e-3)] = 100.0,
        sensitivity: Annotated[float, Option("of a load cell, in mV/V at its rated load", low=1e-3)] = 2.0,
    ):
        self.layout = points({f"channel {k + 1}": (0.03 * k, 0.0, 0.0) for k in range(CHANNELS)})
        self.full = rated_load * INPUT_RANGE / (100 * sensitivity)
        self.columns = (
            Column(name="value", unit="N", counts_per_unit=1.0, is_float=True, low=-self.full, high=self.full, push=1),
        )
        self.reading = READING.bind(wire_order=self.layout.wire_order)
        self.packets = Packets(REQUEST, by="command", counters=self.counters)
        self.scales, self.zeros, self.sending = np.full(CHANNELS, self.full), np.zeros(CHANNELS), True

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the float32 value of each channel, in units of its user scale."""
        signal = self.layout.push(reading["force"]) / self.full
        self.status = FLOATS | (OVERLOADED if np.abs(signal).max() > 1 else 0)
        self.signals = np.clip(signal, -1, 1)
        self.counts = ((self.signals - self.zeros) * self.scales).astype(np.float32)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return a reading, from 24 to 23."""
        return self.read_values() if self.sending else ()

    def reply(self, request: Request, content: bytes, error: int = 0) -> Transmissions:
        """Return the answer."""
        return [ANSWER.pack(error=error, data=content)]

    def refused(self, request: Request, why: str) -> Transmissions:
        """Return the answer of a failure."""
        return self.reply(request, b"", ERRORS[request.why or why])

    @command("AA 90 23 85", "AA 50 00 85", name="stop")
    @command("AA 90 24 85", "AA 50 00 85", name="start")
    def start_or_stop(self, request: Request) -> None:
        """Start or stop the readings."""
        self.sending = request.command == 0x24

    @command("AA 90 3B 85", "AA 17 B0 ..{32} 85", after=("AA 90 23 85",))
    def read_values(self, request: Request | None = None) -> Transmissions:
        """Return a reading."""
        return [self.reading.pack(status=self.status, values=self.counts)]

    @command("AA 91 0C 00 85", "AA 50 00 85", data="B")
    def set_zero(self, request: Request) -> None:
        """Make the present value of a channel, or of all, zero."""
        at = _channels(request.value)
        self.zeros[at] = self.signals[at]

    @command("AA 91 14 01 85", "AA 54 00 42 C8 00 00 85", data="B", safe=True)
    def user_scale(self, request: Request) -> bytes:
        """Return a user scale."""
        return struct.pack(">f", self.scales[_channels(request.value)][0])

    @command("AA 95 15 01 42 48 00 00 85", "AA 50 00 85", data=">Bf")
    def set_user_scale(self, request: Request) -> None:
        """Set a user scale, or all."""
        self.scales[_channels(request.value)] = _finite(request.values[1])

    @command("AA 90 8A 85", "AA 54 00 41 20 00 00 85", safe=True)
    def data_rate(self, request: Request) -> bytes:
        """Return the readings a second."""
        return struct.pack(">f", 1e9 / self.period_ns)

    @command("AA 94 8B 42 48 00 00 85", "AA 50 00 85", data=">f")
    def set_data_rate(self, request: Request) -> None:
        """Set the readings a second."""
        if not 0.1 <= _finite(request.value) <= 12000:
            raise Refused("value")
        self.period_ns = round(1e9 / request.value)

    @command("AA 92 A2 01 FF 85", "AA 55 00 00 00 00 00 C8 85", data="BB", safe=True)
    def input_range(self, request: Request) -> bytes:
        """Return the type of an input, and its range."""
        _channels(request.value)
        return struct.pack(">BI", 0, INPUT_RANGE)


def _channels(number: int) -> slice:
    """Return the place of a channel, or of all."""
    if number > CHANNELS:
        raise Refused("address")
    return slice(number - 1, number) if number else slice(None)


def _finite(value: float) -> float:
    if not np.isfinite(value):
        raise Refused("value")
    return value
