r"""OptoForce (OnRobot) OMD force sensors: domes of 3 axes, one or four of them, or 6 axes, behind the DAQ.

Wire: USB-CDC ("OptoForce DAQ"), opened at 1 000 000 8N1. All numbers big-endian; every packet ends in the 16-bit sum
of the bytes before it.

    bytes  packet
    16     AA 07 08 0A  counter u16  status u16  Fx Fy Fz int16                 sum     3 axes
    34     AA 07 08 1C  counter u16  status u16  4 x (Fx Fy Fz) int16           sum     4 x 3 axes
    22     AA 07 08 10  counter u16  status u16  Fx Fy Fz Tx Ty Tz int16        sum     6 axes
    9      AA 00 32 03  speed filter zero                                       sum     host: configure
    7      AA 00 50 01  0 = accepted                                            sum     answer to it
    6      AB 00 12 08                                                          sum     host: serial number
    14     AA 00 12 08  8 characters                                            sum     answer to it

    speed   0 stops, 1, 3, 10, 33, 100: period [ms]
    filter  0 none, 1..6: low-pass at 500, 150, 50, 15, 5, 1.5 Hz
    zero    FF: what is felt now is zero, 00: no zero

Status: bits 9..4 overload of Fx Fy Fz Tx Ty Tz, bit 3 more than one sensor, bits 2..0 the sensor.

The driver checks the sum but leaves it to its user (``valid_checksum``), and skips the answer to a configuration.

Try it: ``tactemu run optoforce``, then ``OptoForce16(port, speed_hz=100).connect()``.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from firmware_protocols.device import Command, Device, Layout, Outgoing, Patch, Reading, SerialWire

DATA_HEADS = {"3": b"\xaa\x07\x08\x0a", "4x3": b"\xaa\x07\x08\x1c", "6": b"\xaa\x07\x08\x10"}
CONFIGURE, CONFIGURE_BYTES = b"\xaa\x00\x32\x03", 9
SERIAL, SERIAL_BYTES = b"\xab\x00\x12\x08", 6
ACCEPTED, BAD_SUM, BAD_VALUE = 0, 1, 2

SPEEDS = (0, 1, 3, 10, 33, 100)
CUTOFF_HZ = (None, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)
ZERO, NO_ZERO = 0xFF, 0x00

FORCE_COUNTS = np.array([7925 / 300, 8641 / 300, 6049 / 2000])
CAPACITY = np.array([300.0, 300.0, 2000.0])
TORQUE_COUNTS = 1000.0
TORQUE_CAPACITY = 30.0
TOOL = 0.05


class OptoForce(Device):
    """Force sensors that stream unasked and obey a configuration packet.

    Args:
        axes: ``"3"``, ``"4x3"`` or ``"6"``.
        counts_per_newton: of Fx, Fy, Fz; the default is the calibration sheet that the driver has built in.
        serial_number: eight characters.
    """

    name = "optoforce"
    title = "OptoForce / OnRobot OMD force sensor"
    wires = (SerialWire(baud=1_000_000, usb=True),)
    senses = "force"
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (
        "alknemeyer/optoforce@88cfbf5 (optoforce 0.3.0) __init__.py, reading.py, status.py",
        "shadow-robot/optoforce@fe3c086 (an independent driver that agrees)",
    )
    judge = "optoforce 0.3.0"
    assumed = (
        "one taxel per dome, at its top, 10 mm above the base; four domes 20 mm apart; Fz counts a push as positive",
        "6 axes: the force acts 50 mm above the flange; 1000 counts/Nm, capacity 30 Nm",
        "overload beyond the built-in sheet's 300, 300, 2000 N",
        "streams at power-up at 100 Hz through the 15 Hz filter, which is a first-order low-pass",
        "the answer's code for a wrong sum is 1, for a wrong value 2; the counter counts packets",
    )

    def __init__(
        self,
        *,
        axes: Literal["3", "4x3", "6"] = "3",
        counts_per_newton: Sequence[float] = tuple(FORCE_COUNTS),
        serial_number: str = "ISE00001",
    ):
        super().__init__()
        if axes not in DATA_HEADS:
            raise ValueError(f"optoforce: axes must be one of {', '.join(DATA_HEADS)}, got {axes!r}")
        self.axes = axes
        self.force_counts = np.asarray(counts_per_newton, float)
        self.serial_number = serial_number.encode("ascii").ljust(8)[:8]
        self.layout = _domes(axes)
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """100 Hz, 15 Hz filter, no zero."""
        self._buffer = bytearray()
        self._streaming = True
        self._cutoff_hz: float | None = 15.0
        self._felt: np.ndarray | None = None
        self._felt_ns = t_ns
        self._zero = np.zeros((len(self.layout), 6 if self.axes == "6" else 3))
        self._counter = 0
        self._status = 0
        self.counts = self._zero.astype(np.int64)
        self.period_ns = round(1e9 / self.rate_hz)
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """Configuration and serial number."""
        accepted = [summed(b"\xaa\x00\x50\x01\x00")]

        def configure(name: str, *values: int) -> Command:
            return Command(name=name, request=summed(CONFIGURE + bytes(values)), reply=accepted)

        return (
            configure("100 Hz, 15 Hz filter", 10, 4, NO_ZERO),
            configure("1000 Hz, no filter, zero", 1, 0, ZERO),
            configure("stop", 0, 4, NO_ZERO),
            Command(name="serial number", request=summed(SERIAL), reply=[self._serial_answer()]),
        )

    def _serial_answer(self) -> bytes:
        return summed(b"\xaa\x00\x12\x08" + self.serial_number)

    # -- readings --------------------------------------------------------------------------------------------------

    def sample(self, reading: Reading, t_ns: int) -> Sequence[Outgoing]:
        """Filter, convert; send unless stopped."""
        values = np.asarray(reading.values, float)
        if self._felt is None or self._cutoff_hz is None:
            self._felt = values
        else:
            passed = -np.expm1(-2 * np.pi * self._cutoff_hz * (t_ns - self._felt_ns) * 1e-9)
            self._felt = self._felt + (values - self._felt) * passed
        self._felt_ns = t_ns
        return super().sample(replace(reading, values=self._felt), t_ns)

    def digitize(self, reading: Reading) -> np.ndarray:
        """Counts of Fx, Fy, Fz (and Tx, Ty, Tz) per dome, int16 range, shape ``(n_domes, 3 or 6)``."""
        values = self._wrench(np.asarray(reading.values))
        scale, capacity = self.force_counts, CAPACITY
        if self.axes == "6":
            scale, capacity = np.append(scale, [TORQUE_COUNTS] * 3), np.append(capacity, [TORQUE_CAPACITY] * 3)
        overloaded = (np.abs(values) > capacity).any(axis=0)
        self._status = sum(1 << 9 - axis for axis in np.flatnonzero(overloaded).tolist())
        return np.clip(np.rint((values - self._zero) * scale), -0x8000, 0x7FFF).astype(np.int64)

    def _wrench(self, forces: np.ndarray) -> np.ndarray:
        """Fx, Fy, Fz [N] with a push positive; for 6 axes also the torque [Nm] about the flange."""
        if self.axes != "6":
            return self.layout.to_taxel_frame(forces) * [1, 1, -1]
        return np.concatenate([forces * [1, 1, -1], np.cross(self.layout.positions, forces)], axis=-1)

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """One data packet."""
        if not self._streaming:
            return ()
        self._counter = (self._counter + 1) & 0xFFFF
        values = self.counts[self.layout.wire_order].astype(">i2").tobytes()
        return (summed(DATA_HEADS[self.axes] + struct.pack(">HH", self._counter, self._status) + values),)

    # -- commands --------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, t_ns: int) -> Sequence[Outgoing]:
        """Packets in chunks of any size; what is none is skipped byte by byte."""
        self._buffer += data
        buffer, answers = self._buffer, []
        while buffer:
            size = _size(buffer)
            if size is None:
                del buffer[0]
                self.counters["skipped_bytes"] += 1
            elif len(buffer) < size:
                break
            else:
                packet = bytes(buffer[:size])
                good = summed(packet[:-2]) == packet
                del buffer[: size if good else 1]
                self.counters["requests" if good else "bad_checksum"] += 1
                answers += self._answer(packet, good)
        return answers

    def _answer(self, packet: bytes, good: bool) -> list[bytes]:
        if packet.startswith(SERIAL):
            return [self._serial_answer()] if good else []
        code = self._configure(*packet[4:7]) if good else BAD_SUM
        return [summed(b"\xaa\x00\x50\x01" + bytes([code]))]

    def _configure(self, speed: int, cutoff: int, zero: int) -> int:
        if speed not in SPEEDS or cutoff >= len(CUTOFF_HZ) or zero not in (ZERO, NO_ZERO):
            self.counters["refused"] += 1
            return BAD_VALUE
        self._streaming = speed > 0
        if speed:
            self.period_ns = speed * 1_000_000
        self._cutoff_hz = CUTOFF_HZ[cutoff]
        felt = zero == ZERO and self._felt is not None
        self._zero = self._wrench(self._felt) if felt else np.zeros_like(self._zero)  # type: ignore[arg-type]
        return ACCEPTED


def summed(content: bytes) -> bytes:
    """``content`` and its 16-bit sum."""
    return content + struct.pack(">H", sum(content) & 0xFFFF)


def _size(buffer: bytearray) -> int | None:
    """Length of the packet that begins the buffer, ``None`` if none does."""
    for head, size in ((CONFIGURE, CONFIGURE_BYTES), (SERIAL, SERIAL_BYTES)):
        if head.startswith(buffer[:4]):
            return size
    return None


def _domes(axes: str) -> Layout:
    places = {"3": [(0.0, 0.0, 0.01)], "6": [(0.0, 0.0, TOOL)]}.get(
        axes, [(x, y, 0.01) for y in (0.01, -0.01) for x in (-0.01, 0.01)]
    )
    patch = Patch(name="domes", start=0, rows=0, cols=len(places))
    return Layout(positions=np.array(places), normals=np.array([0.0, 0.0, 1.0]), patches=(patch,), pitch=0.02)
