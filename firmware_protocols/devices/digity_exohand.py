r"""Digity exohand: a glove with a board for each finger that measures angles, motion and touch.

Wire: 921600 8N1 through a USB-serial chip; the driver takes the first port of the vendor ids 1A86, 10C4, 0403 or 303A.
Device to host only: there is no command. About 50 times a second each board sends one ``PACKET``: a number of records,
one after the other. No checksum: a driver that begins within a packet may take an 01 02 in there for the next one.

An id is the finger in the high nibble and a part of it in the low one. Fingers are 0 thumb to 4 little; a record of
angles has five numbers on a finger. The boards of the arm (group 0, boards 1 to 4, with 3, 2, 2 and 3 angles) are not
modelled. Touch is six raw counts of capacitance, 0 to 4095; acceleration and angular velocity are raw, too.

Try it: ``tactemu run digity_exohand``, then ``for frame in GloveStream(port=...).connect(): ...``.
"""

from itertools import chain
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    USB, Column, Counts, CountsPerNewton, Device, Frame, Option, Quantity, Reading, Rollover, Sense, Serial,
    Transmissions, fact_table, grid_layout, points, quantize, stack, xyz,
)  # fmt: skip

PACKET = Frame("""
    packet
    0     01 02        start     data, version 2
    2     u1           side      0 right, 1 left
    3     01           group     hand
    4     u1           board
    5     <u2          sequence
    7     <u2          length = len(payload)
    9     bytes        payload   number of records, then records
""")
ANGLES = Frame("""
    angles
    0     10           type
    1     u1           id
    2     01           samples
    3     <u8          time      [us]
    11    <u2 clip     step      [us] between samples
    13    <i2 x 5      angles    [0.01 deg]
""")
IMU = Frame("""
    imu
    0     11           type
    1     u1           id
    2     01           samples
    3     <u8          time      [us]
    11    <u2 clip     step      [us] between samples
    13    00 x 4       unused
    17    <i2 x 6      motion    acceleration x, y, z, angular velocity x, y, z
""")
TOUCH = Frame("""
    touch, row by row
    0     12           type
    1     u1           id
    2     01           samples
    3     <u8          time      [us]
    11    <u2 x 6      touch     0..4095
""")
SDK = "digity 0.2.5"
FINGERTIPS_M = {
    "thumb": (-0.06, 0.0), "index": (-0.033, 0.05), "middle": (-0.011, 0.06), "ring": (0.011, 0.055),
    "little": (0.033, 0.04),
}  # fmt: skip
"""The fingertips of a left hand, seen from its palm, fingers up."""
PITCH_M = 0.006

Record = Literal["angles", "imu", "touch"]
RECORDS: tuple[Record, ...] = ("angles", "imu", "touch")
MOTION_SCALES: dict[Quantity, tuple[str, float]] = {
    "acceleration": ("m/s^2", 16384 / 9.80665),
    "angular_velocity": ("rad/s", 131 * 180 / np.pi),
}
"""The unit of a quantity, and its counts per unit."""


class DigityExohand(Device):
    """Five boards that stream, one for each finger."""

    name = "digity_exohand"
    kind = "glove"
    ports = (Serial(baud=921_600, usb=USB(0x10C4, 0xEA60, node="ttyUSB")),)
    rate_hz = 50.0
    rollovers = (Rollover(name="sequence", bits=16, state="sequence"),)
    evidence = ("driver",)
    sources = ("digity 0.2.5 _humi.py, _serial.py, README (the vendor's own)",)
    judge = "digity 0.2.5"
    facts = fact_table(f"""
        stated identity: the glove has one of four makes of USB chips, which the driver finds by id or text @ {SDK}
            _serial.py l.18-19
        stated touch: a touch record has six counts of 0 to 4095; the driver's example has 16384 counts per g @ {SDK}
            README; _humi.py l.183
        stated touch: a finger has five angles in 0.01 deg; the arm boards have 3, 2, 2 and 3 @ {SDK} _humi.py l.36-47
        stated timing: about 50 packets a second; the sequence number has 16 bits; times are in us @ {SDK} README
        assumed identity: the model has a CP2102, one of the four chips
        assumed identity: the low nibble of an id is 1 for angles, 2 for motion, 3 for touch ('communication line') @
            {SDK} README, _types.py
        assumed touch: the six channels are 3 rows of 2, 6 mm apart, from the fingertip on; the hand is flat @ {SDK}
            viz/static
        assumed touch: 400 counts/N, 0 if untouched; 131 counts per deg/s; axes are those of the link
        assumed touch: angles stay constant: the model has no wearer whose fingers move
        assumed timing: a packet has one record of each kind, all of one sample; all boards share one sequence number
    """, looked=f"{SDK} whole")  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["right", "left"], Option("hand that the glove fits")] = "right",
        records: Annotated[tuple[Record, ...], Option("records of a packet, in order")] = RECORDS,
        angles: Annotated[
            tuple[float, float, float, float, float], Option("angles of every finger", unit="deg", low=-327, high=327)
        ] = (0.0, 0.0, 0.0, 0.0, 0.0),
        counts_per_newton: CountsPerNewton = 400.0,
    ):
        self.title = f"Digity exohand, {side}"
        tips = {name: (x if side == "left" else -x, y, 0.0) for name, (x, y) in FINGERTIPS_M.items()}
        self.layout = stack(*(grid_layout(3, 2, PITCH_M, name=name, origin=at, link=name) for name, at in tips.items()))
        boards = points({f"{name} board": at for name, at in tips.items()})
        self.senses = ("force", *(Sense(each, at=boards) for each in MOTION_SCALES))
        motion = (
            xyz("x y z", sense=sense, unit=unit, counts_per_unit=scale, low=-0x8000, high=0x7FFF)
            for sense, (unit, scale) in MOTION_SCALES.items()
        )
        touch = Column(name="touch", unit="N", counts_per_unit=counts_per_newton, low=0, high=4095, push=1)
        self.columns = (touch, *chain(*motion))
        self.side, self.records = int(side == "left"), records
        self.angles = quantize(angles, 100, -0x8000, 0x7FFF)
        self.sequence = 0

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return, by sense, touch 0..4095 of 30 channels by finger; x, y, z of acceleration and angular velocity."""
        self.felt_ns = t_ns
        return super().measure(reading, t_ns)

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one packet for each finger."""
        self.sequence = self.sequence + 1 & 0xFFFF
        touch = self.layout.on_wire(self.counts["force"]).reshape(len(FINGERTIPS_M), -1)
        return [
            PACKET.pack(side=self.side, board=k, sequence=self.sequence, payload=self._payload(k, counts))
            for k, counts in enumerate(touch)
        ]

    def _payload(self, finger: int, touch: np.ndarray) -> bytes:
        ident, when = finger << 4, {"time": self.felt_ns // 1000, "step": self.period_ns // 1000}
        motion = np.concatenate([self.counts[each][finger] for each in MOTION_SCALES])
        made = {
            "angles": ANGLES.pack(id=ident | 1, angles=self.angles, **when),
            "imu": IMU.pack(id=ident | 2, motion=motion, **when),
            "touch": TOUCH.pack(id=ident | 3, time=when["time"], touch=touch),
        }
        return bytes([len(self.records)]) + b"".join(made[kind] for kind in self.records)
