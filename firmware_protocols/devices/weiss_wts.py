"""Weiss WTS: a tactile matrix with a controller of its own, asked for frames or pushing them.

Wire: 115200 8N1. ``MESSAGE`` in both directions, little-endian; other than a DSACON32m's, its CRC is always there and
counts the preamble, too. An answer repeats the id and begins with a status, 0; a pushed frame has id 00 and no status.

    id  payload              answer, behind the status
    20  flags, or nothing    ``FRAME``, the next one
    21  flags, ms 2 bytes    nothing; then frames with id 00 every so many ms
    22  -                    nothing; no more frames
    23  flags, or nothing    nothing; what is felt now is zero
    30  -                    ``MATRIX``
    46  -                    temperature [0.1 deg C], 2 bytes

Drivers disagree about a value: two bytes, low one first (wts_driver), or 16 times as much, high byte first (wts-ft); an
option chooses. 34 to 38 (threshold, gain, type), 50 and 52 (system, tag) are there, too, not what they answer.

Try it: ``tactemu run weiss_wts``, then send AA AA AA 30 00 00 CA CF.
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
    Serial,
    grid_layout,
    points,
)
from firmware_protocols.adc import int16, quantize
from firmware_protocols.framing import MORE, SOUND, Packets
from firmware_protocols.sums import crc16_weiss
from firmware_protocols.tables import Frame

MESSAGE = Frame("""
    message, either direction
    0     AA AA AA         preamble
    3     u1               id
    4     <u2              size = len(payload)
    6     bytes            payload
    last  <crc16_weiss     crc
""")
FRAME = Frame("""
    frame, row by row
    0     <u4 wrap         time        [ms]
    4     00               flags
    5     bytes            values      of two bytes
""")
MATRIX = Frame("""
    matrix
    0     <u2              columns
    2     <u2              rows
    4     <u2 x 2          cell        width, height [0.01 mm]
    8     <u2              full_scale
""")
PUSHED, SINGLE, START, STOP, TARE, MATRIX_INFO, TEMPERATURE = 0x00, 0x20, 0x21, 0x22, 0x23, 0x30, 0x46
PAYLOAD_BYTES = {SINGLE: (0, 1), START: (3,), STOP: (0,), TARE: (0, 1), MATRIX_INFO: (0,), TEMPERATURE: (0,)}
DONE = b"\0\0"

ROWS, COLS, PITCH = 14, 6, 0.0034
FULL_SCALE = 4095
BOARD = points({"board": (0.0, 0.0, -0.005)})


class WeissWts(Device):
    """One matrix of texels."""

    name = "weiss_wts"
    kind = "fingertip"
    title = "Weiss WTS tactile matrix, 14x6"
    ports = (Serial(baud=115200),)
    senses = ("force", Sense("temperature", at=BOARD))
    columns = (
        Column(name="texel", low=0, high=FULL_SCALE, push=1),
        Column(name="T", sense="temperature", unit="degC", counts_per_unit=10.0, low=-0x8000, high=0x7FFF, rest=250),
    )
    rollovers = (Rollover(name="time", bits=32, step=1000, clock=True),)
    evidence = ("driver",)
    sources = (
        "ksatyaki/wts_driver@82c46ac src/wts_driver.cpp (ids, CRC, values with the low byte first)",
        "CNCR-NTU/wts-ft@bbb00b0 crc16.py, wts_ft_interface.py (values of 16ths, high byte first)",
    )
    judge = "own second reader"
    assumed = (
        "14 rows of 6 texels of 3.4 mm, row by row from the upper left; 115200 baud; MATRIX is of 16-bit numbers",
        "1000 counts/N, full scale 4095; the frame as a DSACON32m's, not run-length coded, whatever the flags",
        "a scan every 10 ms, and as often as frames are pushed; a period of 0 gets no answer",
        "wrong CRCs, lengths and ids get no answer; the zero is forgotten at power-off",
    )

    def __init__(
        self,
        *,
        values: Annotated[
            Literal["low_first", "sixteenths"], Option("as wts_driver reads them, or as wts-ft does")
        ] = "low_first",
        counts_per_newton: Annotated[float, Option("of a texel", unit="1/N", low=1e-6)] = 1000.0,
    ):
        self.layout = grid_layout(ROWS, COLS, PITCH)
        self.sixteenths, self.counts_per_newton = values == "sixteenths", counts_per_newton
        self.packets = Packets(MESSAGE.head, _size, _check, counters=self.counters, longest=64)
        self.pushed = self.zero = np.zeros(len(self.layout))
        self.pushing, self.singles = False, 0

    @property
    def commands(self) -> tuple[Command, ...]:
        """All whose answer is known."""
        origin = "wts_driver@82c46ac; CRC by a second program"
        return tuple(
            Command(name=name, request=f"AA AA AA {request}", reply=reply and f"AA AA AA {reply}", origin=origin)
            for name, request, reply in (
                ("matrix", "30 00 00 CA CF", "30 0C 00 00 00 06 00 0E 00 54 01 54 01 FF 0F 59 3E"),
                ("temperature", "46 00 00 86 B7", "46 04 00 00 00 ..{2} ..{2}"),
                ("tare", "23 00 00 AC 1C", "23 02 00 00 00 3C D7"),
                ("frames every 20 ms", "21 03 00 00 14 00 D9 AB", "21 02 00 00 00 28 04"),
                ("no more frames", "22 00 00 0E 76", "22 02 00 00 00 A7 2E"),
                ("one frame, after the next scan", "20 01 00 00 8F 83", None),
            )
        )

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """By sense: counts of the texels, 0..4095, ``(84,)``; temperature [0.1 deg C] ``(1,)``."""
        self.pushed = self.layout.push(reading["force"])
        self.texels = quantize(self.pushed - self.zero, self.counts_per_newton, 0, FULL_SCALE)
        self.warmth = quantize(reading["temperature"], 10.0, -0x8000, 0x7FFF)
        return {"force": self.texels, "temperature": self.warmth}

    def stream(self, t_ns: int, name: str) -> Outs:
        """Frames that were asked for, then one that is pushed."""
        texels = self.layout.on_wire(self.texels)
        values = (16 * texels).astype(">u2") if self.sixteenths else texels.astype("<u2")
        frame = FRAME.pack(time=t_ns // 1_000_000, values=values.tobytes())
        asked, self.singles = self.singles, 0
        answers = [MESSAGE.pack(id=SINGLE, payload=DONE + frame)] * asked
        return answers + [MESSAGE.pack(id=PUSHED, payload=frame)] * self.pushing

    def receive(self, data: bytes, t_ns: int, port: str) -> Outs:
        """Messages in chunks of any size."""
        return [out for packet in self.packets.cut(data, t_ns) for out in self._obey(packet[3], packet[6:-2])]

    def _obey(self, request: int, payload: bytes) -> list[bytes]:
        period_ms = int.from_bytes(payload[1:3], "little")
        if len(payload) not in PAYLOAD_BYTES.get(request, ()) or (request == START and not period_ms):
            self.counters["refused"] += 1
            return []
        answer = b""
        if request == SINGLE:
            self.singles = 1
            return []
        if request == START:
            self.pushing, self.period_ns = True, period_ms * 1_000_000
        elif request == STOP:
            self.pushing = False
        elif request == TARE:
            self.zero = self.pushed
        elif request == MATRIX_INFO:
            cell = [round(PITCH * 1e5)] * 2
            answer = MATRIX.pack(columns=COLS, rows=ROWS, cell=cell, full_scale=FULL_SCALE)
        else:
            answer = int16(self.warmth, "<")
        return [MESSAGE.pack(id=request, payload=DONE + answer)]


def _size(data: bytes) -> int:
    return MORE if len(data) < 6 else 8 + int.from_bytes(data[4:6], "little")


def _check(packet: bytes) -> str:
    return SOUND if crc16_weiss(packet[:-2]) == int.from_bytes(packet[-2:], "little") else "bad_checksum"
