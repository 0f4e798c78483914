r"""Robotiq TSF-85: the two tactile fingertips of a 2F-85 gripper behind one USB hub.

Wire: USB-CDC (16D0:14CC), opened at 115200 8N1; nothing depends on the speed. Every packet, in both directions:

    offset  bytes  field
    0       1      9A
    1       1      crc8 of command, length, data by the vendor's comment; neither driver computes it, so 00 here
    2       1      command; an answer repeats it
    3       1      n, length of data
    4       n      data

    command  data         does
    61       -            one reading
    58       period [ms]  autosend, synchronous; 00 stops
    59       period [ms]  autosend, asynchronous; 00 stops
    E3       -            firmware version, ASCII
    E2       -            bootloader

A reading describes itself: fields of one type byte (type in the high nibble, finger in bits 3..2, index in bits 1..0)
and big-endian values. A driver that meets an unknown type has lost the rest of the packet.

    type  values     content
    10    28 uint16  static, 7 rows x 4 columns, row-major
    20    1 int16    dynamic
    30    3 int16    acceleration
    40    3 int16    angular velocity
    50    3 int16    magnetometer
    60    1 int16    temperature
    70    1 uint64   timestamp

All raw counts: no source gives a unit. On open, the vendor's Python sets DTR, clears RTS, asks E3 and sends 58.

Try it: ``tactemu run robotiq_tsf85``, then ``RobotiqTactileSensor(port=...).configure(update_period_ms=10)``.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Literal

import numpy as np

from firmware_protocols.device import Command, Device, Outgoing, Reading, SerialWire, grid_layout
from firmware_protocols.layouts import place, stack

START = 0x9A
READ, AUTOSEND_SYNC, AUTOSEND_ASYNC, BOOTLOADER, VERSION = 0x61, 0x58, 0x59, 0xE2, 0xE3
DATA_LENGTH = {READ: 0, AUTOSEND_SYNC: 1, AUTOSEND_ASYNC: 1, BOOTLOADER: 0, VERSION: 0}

FINGERS, ROWS, COLS = 2, 7, 4
TAXELS = ROWS * COLS
PITCH = 0.005
PAD_HEIGHT = 0.06

ACCELERATION_PER_MS2 = 16384 / 9.80665
RATE_PER_RAD_S = 131 * 180 / np.pi
TEMPERATURE_PER_DEG = 100


class RobotiqTsf85(Device):
    """Two 7 x 4 fingertips with inertial sensors; silent until a driver asks for a reading or for autosend.

    Args:
        packets: ``"together"`` sends both fingers in one packet, ``"per_finger"`` one packet each. Both drivers accept
            either; which one the hardware does is not stated.
        magnetometer: send field 50 (the vendor's C++ driver does not know it).
        counts_per_newton: static counts per newton along a taxel's normal.
        baseline: static counts at rest (drivers subtract their own average).
        version: the ASCII answer to E3.
    """

    name = "robotiq_tsf85"
    title = "Robotiq TSF-85 tactile fingertips"
    wires = (SerialWire(baud=115200, usb=True),)
    senses = "force"
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (
        "robotiq/tactile_sensors@8cb0219 sensor_quickstart/protocol.py l.18-37, 82-125, 185-250 (the vendor's own)",
        "robotiq/tactile_sensors@8cb0219 sdk_cpp/RobotiqTactileSensor.cpp l.97-104",
        "pyrobotiqtactile 0.1.2",
    )
    judge = "pyrobotiqtactile 0.1.2"
    assumed = (
        "5 mm pitch; the pads face each other 85 mm apart, 60 mm above the palm, row 0 at the fingertip",
        "2000 counts/N over a baseline of 1000; dynamic: change of the finger's static sum since the last sample, / 16",
        "acceleration 16384 per g, angular velocity 131 per deg/s, temperature 100 per deg C, timestamp in us",
        "the magnetometer reads zero (a scene has no magnetic field); the crc8 byte is 00 and is not checked",
        "autosend is not acknowledged; synchronous and asynchronous stream alike; E2 restarts the firmware",
        "a command with another data length than its own is skipped",
    )

    def __init__(
        self,
        *,
        packets: Literal["together", "per_finger"] = "together",
        magnetometer: bool = True,
        counts_per_newton: float = 2000.0,
        baseline: int = 1000,
        version: str = "TSF-85 1.0.0",
    ):
        super().__init__()
        if packets not in ("together", "per_finger"):
            raise ValueError(f"robotiq_tsf85: packets must be 'together' or 'per_finger', got {packets!r}")
        self.packets = packets
        self.magnetometer = magnetometer
        self.counts_per_newton = counts_per_newton
        self.baseline = baseline
        self.version = version.encode("ascii")
        self.layout = _two_fingers(opening=0.085)
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Silent, at the default rate."""
        self._buffer = bytearray()
        self._autosend: int | None = None
        self.counts = np.full(FINGERS * TAXELS, self.baseline)
        self._fields = self._describe(Reading(t_ns=t_ns, values=np.zeros((FINGERS * TAXELS, 3))), self.counts, t_ns)
        self.period_ns = round(1e9 / self.rate_hz)
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """The five commands of both vendor drivers."""

        def reading(frames: list) -> bool:
            return len(frames) in (1, FINGERS) and all(f[0] == START and f[2] == READ for f in frames)

        return (
            Command(name="version", request=packet(VERSION), reply=[packet(VERSION, self.version)]),
            Command(name="read once", request=packet(READ), reply=reading),
            Command(name="autosend synchronous, 10 ms", request=packet(AUTOSEND_SYNC, b"\x0a"), reply=None),
            Command(name="autosend asynchronous, 10 ms", request=packet(AUTOSEND_ASYNC, b"\x0a"), reply=None),
            Command(name="stop", request=packet(AUTOSEND_SYNC, b"\x00"), reply=None),
            Command(name="bootloader", request=packet(BOOTLOADER), reply=None, about="restarts the firmware"),
        )

    # -- readings --------------------------------------------------------------------------------------------------

    def digitize(self, reading: Reading) -> np.ndarray:
        """Static counts, uint16 range, shape ``(56,)``: finger 0 row by row, then finger 1."""
        counts = np.rint(self.baseline + self.counts_per_newton * self.layout.push(reading.values))
        return np.clip(counts, 0, 0xFFFF).astype(np.int64)

    def sample(self, reading: Reading, t_ns: int) -> Sequence[Outgoing]:
        """Convert; send if autosend is on."""
        before, self.counts = self.counts, self.digitize(reading)
        self._fields = self._describe(reading, self.counts - before, t_ns)
        return self.stream(t_ns)

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """The reading as autosend packets; nothing while autosend is off."""
        return () if self._autosend is None else self._reading_packets(self._autosend)

    def _describe(self, reading: Reading, change: np.ndarray, t_ns: int) -> list[bytes]:
        """The fields of each finger, type bytes included."""
        acceleration = _int16(np.asarray(reading.acceleration) * ACCELERATION_PER_MS2)
        rate = _int16(np.asarray(reading.angular_velocity) * RATE_PER_RAD_S)
        warmth = np.broadcast_to(reading.temperature, FINGERS * TAXELS).reshape(FINGERS, TAXELS).mean(1)
        fields = []
        for finger in range(FINGERS):
            taxels = slice(finger * TAXELS, (finger + 1) * TAXELS)
            values = {
                0x10: self.counts[taxels].astype(">u2"),
                0x20: _int16(change[taxels].sum() / 16),
                0x30: acceleration,
                0x40: rate,
                0x50: _int16(np.zeros(3)),
                0x60: _int16(warmth[finger] * TEMPERATURE_PER_DEG),
                0x70: np.array(t_ns // 1000, ">u8"),
            }
            if not self.magnetometer:
                del values[0x50]
            fields.append(b"".join(bytes([kind | finger << 2]) + value.tobytes() for kind, value in values.items()))
        return fields

    def _reading_packets(self, command: int) -> list[bytes]:
        if self.packets == "together":
            return [packet(command, b"".join(self._fields))]
        return [packet(command, fields) for fields in self._fields]

    # -- commands --------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Commands in chunks of any size; what is none is skipped byte by byte."""
        self._buffer += data
        answers: list[Outgoing] = []
        while (request := self._next_command()) is not None:
            self.counters["requests"] += 1
            answers += self._answer(*request, t_ns)
        return answers

    def _next_command(self) -> tuple[int, bytes] | None:
        """The next whole command, or ``None`` until more bytes come."""
        buffer = self._buffer
        while buffer:
            if buffer[0] != START:
                self.counters["skipped_bytes"] += 1
            elif len(buffer) < 4:
                return None
            elif buffer[2] not in DATA_LENGTH:
                self.counters["unknown_command"] += 1
            elif buffer[3] != DATA_LENGTH[buffer[2]]:
                self.counters["bad_length"] += 1
            elif len(buffer) < 4 + buffer[3]:
                return None
            else:
                command, data = buffer[2], bytes(buffer[4 : 4 + buffer[3]])
                del buffer[: 4 + len(data)]
                return command, data
            del buffer[0]
        return None

    def _answer(self, command: int, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        if command == VERSION:
            return [packet(VERSION, self.version)]
        if command == READ:
            return self._reading_packets(READ)
        if command == BOOTLOADER:
            rest = self._buffer
            answer = self.power_on(t_ns)
            self._buffer = rest
            return answer
        self._autosend = command if data[0] else None
        if data[0]:
            self.period_ns = data[0] * 1_000_000
        return ()


def packet(command: int, data: bytes = b"") -> bytes:
    """One packet, either direction."""
    return struct.pack("BBBB", START, 0, command, len(data)) + data


def _int16(values) -> np.ndarray:
    return np.asarray(np.clip(np.rint(values), -0x8000, 0x7FFF), dtype=">i2")


def _two_fingers(opening: float):
    """Both pads ``opening`` [m] apart, facing each other along x, above the palm; the fingers point along +z."""
    left = place(
        grid_layout(ROWS, COLS, PITCH, name="finger 0"),
        (-opening / 2, 0.0, PAD_HEIGHT),
        x_axis=(0.0, 1.0, 0.0),
        normal=(1.0, 0.0, 0.0),
    )
    right = place(
        grid_layout(ROWS, COLS, PITCH, name="finger 1"),
        (opening / 2, 0.0, PAD_HEIGHT),
        x_axis=(0.0, -1.0, 0.0),
        normal=(-1.0, 0.0, 0.0),
    )
    return stack(left, right)
