r"""OSMO glove: three-axis magnetometers under magnetic skins, on the fingers of a glove.

Wire: USB-CDC, opened at 9600. Device to host only: there is no command. Each sensor sends a message 50 times a
second (the build with an operating system): protobuf (``bowie.Data``), stuffed by COBS and ended by 00.

    field  type     content
    1      varint   index
    2      varint   finger, 1 pinky to 5 thumb
    3      varint   link
    4      varint   sensor
    5      message  Mag: 1 seconds, 2 nanoseconds (varints), 3 x, 4 y, 5 z (float32)
    6      message  Quat, which is not sent here

As protobuf does, what is zero is left out. The driver drops and counts a block that is no COBS.

Try it: ``tactemu run osmo_glove``, then the reader of osmo_tactile_glove's labs/glove2robot/utils/bowie.py.
"""

from __future__ import annotations

import struct
from typing import Annotated

import numpy as np

from firmware_protocols import Column, Counts, Device, Option, Outs, Reading, Serial
from firmware_protocols.device import Axis
from firmware_protocols.framing import cobs
from firmware_protocols.layouts import points
from firmware_protocols.magnetic import LinearMagnet

FINGERS = {
    "pinky": (-0.034, 0.075, 0.0), "ring": (-0.012, 0.092, 0.0), "middle": (0.010, 0.100, 0.0),
    "index": (0.032, 0.090, 0.0), "thumb": (0.060, 0.040, 0.0),
}  # fmt: skip
AXES: tuple[Axis, ...] = ("x", "y", "z")
RANGE_UT = 2000.0
VARINT, MESSAGE, FLOAT = 0, 2, 5
"""Wire types of protobuf."""


class OsmoGlove(Device):
    """A magnetometer at each fingertip."""

    name = "osmo_glove"
    kind = "glove"
    title = "OSMO tactile glove, five fingertips"
    ports = (Serial(baud=9600, usb=True),)
    rate_hz = 50.0
    evidence = ("firmware", "driver")
    sources = ("jessicayin/osmo_tactile_glove@e0465b6 firmware bowie.proto; labs/glove2robot/utils/bowie.py",)
    judge = "own second reader"
    assumed = (
        "one sensor at each fingertip, of a flat hand; index counts them from 0, link and sensor are 1",
        "numbers of Mag's fields, whole seconds and nanoseconds since power-up; Quat is not sent",
        "microtesla; no rest field, 60 uT/N in the plane, 90 uT/N along the normal, a push raises z; +-2000 uT",
    )

    def __init__(
        self,
        *,
        gains: Annotated[
            tuple[float, float, float],
            Option("of the force along x, y and z of a sensor, z out of the skin", unit="uT/N"),
        ] = (60.0, 60.0, -90.0),
    ):
        self.layout = points(FINGERS)
        self.columns = tuple(
            Column(name=a, axis=a, unit="uT", counts_per_unit=1.0, low=-RANGE_UT, high=RANGE_UT) for a in AXES
        )
        self.magnet = LinearMagnet(gain=gains)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """Field [uT] of each sensor as it is sent, float32 ``(5, 3)``."""
        field = self.magnet(self.layout.to_taxel_frame(reading["force"]))
        self.counts, self.felt_ns = np.clip(field, -RANGE_UT, RANGE_UT).astype(np.float32), t_ns
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs:
        """A message of each sensor."""
        seconds, nanoseconds = divmod(self.felt_ns, 1_000_000_000)
        messages = []
        for k in self.layout.wire_order.tolist():
            mag = _message(seconds, nanoseconds, *self.counts[k].tolist())
            messages.append(cobs(_message(k, k + 1, 1, 1, mag)))
        return messages


def _message(*values: int | float | bytes) -> bytes:
    """Fields 1, 2, 3 ... in protobuf."""
    data = b""
    for number, value in enumerate(values, 1):
        if isinstance(value, bytes):
            data += bytes([number << 3 | MESSAGE]) + _varint(len(value)) + value
        elif isinstance(value, float) and value:
            data += bytes([number << 3 | FLOAT]) + struct.pack("<f", value)
        elif value:
            data += bytes([number << 3 | VARINT]) + _varint(int(value))
    return data


def _varint(number: int) -> bytes:
    """Seven bits a byte, the lowest first; bit 7 says that there are more."""
    data = bytearray()
    while number > 0x7F:
        data.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*data, number])
