"""Contactile PapillArray: sensors of nine pillars that measure force and deflection, behind one controller.

Wire: USB-CDC; hosts open it at 9600 to 115200; the speed has no effect. Protocol 2.0: packets stream from power-up, all
numbers little-endian:

    PACKET   around the data
    data     1 byte, the size of an offset (2); an ENTRY for each block, and one of kind 0; the blocks
    kind 1   TIME
    kind 3   INDEX of sensors; each: INDEX of pillars; each: PILLAR
    kind 4   INDEX of sensors; each: TOTAL
    kind 5   INDEX of sensors; each: INDEX of pillars; each: PILLAR_SLIP
    kind 6   INDEX of sensors; each: SENSOR_SLIP

Offsets count from the first byte of the data. There is no escape: the vendor's library takes AA BB CC DD inside a
packet for its end, and hangs. It crashes if a sensor in its settings, or the entry of kind 0, is missing.

Commands are text with LF; the library appends a NUL to some. None is answered.

    z                       what is measured now becomes zero
    f100 f250 f500 f1000    packets per second
    S s                     slip detection on, off

Try it: ``tactemu run contactile_papillarray``; packets of 817 bytes, the first pillar's force at byte 67.
"""

from functools import lru_cache
from typing import Annotated

import numpy as np

from firmware_protocols import (
    Counts, Device, Frame, Lines, Option, Reading, Request, Rollover, Serial, Transmissions, command, fact_table,
    grid_layout, stack, xyz,
)  # fmt: skip

PACKET = Frame("""
    packet
    0     55 66 77 88       start
    4     bytes             data
    ..    <sum16 from 4     sum      of the data's bytes
    ..    AA BB CC DD       end
""")
ENTRY = Frame("""
    entry of the table
    0     <u2               block
    2     <u2               offset
""")
TIME = Frame("""
    time
    0     <u4               counter  of packets
    4     <u8               time     [us]
""")
INDEX = Frame("""
    index
    0     <u2               count
    2     <u2 x parts       offsets
""")
PILLAR = Frame("""
    pillar, row by row
    0     02 00             kind
    2     <f4 x 3           force         Fx Fy Fz [N]
    14    <f4 x 3           displacement  Dx Dy Dz [mm]
""")
TOTAL = Frame("""
    total of a sensor
    0     02 00             kind
    2     <f4 x 3           force         Fx Fy Fz [N]
    14    <f4 x 3           torque        Tx Ty Tz [N mm]
""")
PILLAR_SLIP = Frame("""
    slip of a pillar
    0     01 00             kind
    2     00                slip          i1; -2 no contact at the start, -1 lost, 1 contact, 2 loaded, 3 slipped
    3     00 00 80 BF       friction      <f4; -1: no estimate
""")
SENSOR_SLIP = Frame("""
    slip of a sensor
    0     01 00             kind
    2     00                state         u1
    3     00 00 80 BF       friction      <f4; -1: no estimate
    7     00 00 80 BF       grip          <f4 [N]; -1: no estimate of friction
""")
ROWS = 3
PILLARS = 9
PITCH_M = 0.007
SENSOR_SPACING_M = 0.04

BLOCKS = (1, 3, 4, 5, 6)
"""The kinds of blocks: time, pillars, totals, slip of pillars, slip of sensors."""
FORCE_RANGES_N = np.array([4.0, 4.0, 15.0])
DEFLECTION_RANGES_MM = np.array([1.0, 1.0, 2.5])
"""The ranges of a pillar along x, y, z, as those of force above."""
LIBRARY = "m-rosette/contactile_gripper_ros2@146709d"


class ContactilePapillArray(Device):
    """A controller that streams the readings of sensors with 3 x 3 pillars."""

    name = "contactile_papillarray"
    kind = "fingertip"
    ports = (Serial(baud=115200, usb=True),)
    rate_hz = 1000.0
    columns = (
        *xyz("Fx Fy Fz", unit="N", counts_per_unit=1.0, low=-FORCE_RANGES_N, high=FORCE_RANGES_N, push=1),
        *xyz("Dx Dy Dz", unit="m", counts_per_unit=1e3, low=-DEFLECTION_RANGES_MM, high=DEFLECTION_RANGES_MM, push=1),
    )
    rollovers = (Rollover(name="counter", bits=32, state="counter"),)
    evidence = ("vendor document", "driver")
    sources = (
        "langxin11/contactile_pts_lab@2797753 docs/manuals (PTSCOM_2.0_SPEC_SEP22, PTS_2.1_SPEC_JAN25)",
        "langxin11/contactile_pts_lab@5bb5ea0 python_ws/pts_protocol.py",
        "m-rosette/contactile_gripper_ros2@146709d papillarray_ros2_v2: the vendor's library and its headers (sense of "
        "offsets, entry of kind 0, commands, slip), launch/papillarray.launch.py",
    )
    origin = "PTSCOM_2.0_SPEC_SEP22; the NUL as the vendor's library sends it"
    documented_with = None
    judge = "m-rosette/contactile_gripper_ros2@146709d (Contactile's libPTSDK.a)"
    facts = fact_table(f"""
        stated touch: units are N, mm and N mm, all along X, Y and Z of the sensor @ {LIBRARY} lib/PTSDKSensor.h:78-150
        stated touch: 3 x 3 pillars, 7 mm apart; the ranges are 4 N and 15 N, and 1 mm and 2.5 mm @ PTS_2.1_SPEC_JAN25
        assumed touch: pillars are numbered row by row from the sensor's upper left; a push is positive in Fz and Dz,
            since the library takes Fz above 0.5 N for contact @ PTSCOM_2.0_SPEC_SEP22, PTS_2.1_SPEC_JAN25; {LIBRARY}
            lib/PTSDKConstants.h:23
        assumed touch: the total is the sum over the pillars; the torque is r x F, with r from the middle of the sensor
            and F as sent
        assumed touch: pillars are springs: the deflection is proportional to the force, in the ratio of the two ranges;
            both saturate at the end of their range @ PTS_2.1_SPEC_JAN25
        stated touch: -1 means that there is no estimate of friction, and so none of the grip force @ {LIBRARY}
            lib/PTSDKConstants.h:31
        assumed touch: slip is not modelled: its states stay 0 whether detection is on or off; blocks of kind 7 are not
            sent @ PTSCOM_2.0_SPEC_SEP22, which does not describe it
        stated identity: the controller reports neither version nor serial number: the library requests none @ {LIBRARY}
            lib/PTSDKListener.h
        stated configuration: at most 4 sensors @ {LIBRARY} lib/PTSDKConstants.h:17
        stated configuration: any baud rate works; the launch file opens /dev/ttyACM0 at 9600 @ {LIBRARY}
            launch/papillarray.launch.py
        assumed configuration: the entry of kind 0 has no offset (an option adds one): the library accepts both @
            PTSCOM_2.0_SPEC_SEP22; the library, run
        assumed configuration: a zero takes effect at once (about 2 s according to the vendor), on deflections as well @
            {LIBRARY} lib/PTSDKListener.h (sendBiasRequest)
        stated timing: 100, 250, 500 or 1000 packets a second, 1000 by default @ {LIBRARY} lib/PTSDKListener.h
            (setSamplingRate)
        assumed timing: the rate is 1000 packets a second after each power-up; the time counts from power-up
    """, looked=f"PTSCOM_2.0_SPEC_SEP22; {LIBRARY} lib, all headers")  # fmt: skip

    def __init__(
        self,
        *,
        sensors: Annotated[int, Option("sensors on the controller; the library supports four", low=1, high=4)] = 2,
        end_offset: Annotated[bool, Option("the entry of kind 0 has an offset, like the others")] = False,
    ):
        self.title = f"Contactile PapillArray v2 controller, {sensors} sensors of 3x3 pillars"
        places = {f"sensor {k}": (k * SENSOR_SPACING_M, 0, 0) for k in range(sensors)}
        pads = (grid_layout(ROWS, ROWS, PITCH_M, name=name, link=name, origin=at) for name, at in places.items())
        self.layout = stack(*pads)
        pillars_mm = 1000 * self.layout.positions[:PILLARS]
        self.arms = np.array([np.cross(pillars_mm, axis) for axis in np.eye(3)])
        self.packets = Lines(b"\r\n\0", counters=self.counters, longest=16)
        self.zero = np.zeros((len(self.layout), 3))
        self.counter = 0
        self.end = ENTRY.pack(block=0, offset=0)[: 4 if end_offset else 2]
        self.slips = [[PILLAR_SLIP.pack()] * PILLARS] * sensors, [SENSOR_SLIP.pack()] * sensors

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return Fx, Fy, Fz [N] and Dx, Dy, Dz [mm] of each pillar as sent, float32 ``(n, 6)``; a push is positive."""
        self.present = self.layout.to_taxel_frame(reading["force"]) * [1, 1, -1]
        force = np.clip(self.present - self.zero, -FORCE_RANGES_N, FORCE_RANGES_N) + 0.0  # 0.0, not -0.0
        self.counts = np.hstack([force, force * (DEFLECTION_RANGES_MM / FORCE_RANGES_N)]).astype(np.float32)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one packet."""
        self.counter = (self.counter + 1) & 0xFFFFFFFF
        wire = self.layout.on_wire(self.counts)
        pillars = PILLAR.pack_many(len(wire), force=wire[:, :3], displacement=wire[:, 3:])
        totals = []
        for forces in self.counts.reshape(-1, PILLARS, 6)[..., :3]:
            torque = np.einsum("apt,pa->t", self.arms, forces) + 0.0
            totals.append(TOTAL.pack(force=forces.sum(axis=0), torque=torque))
        of_sensors = [pillars[k : k + PILLARS] for k in range(0, len(pillars), PILLARS)]
        at, offsets, blocks = 1 + 4 * len(BLOCKS) + len(self.end), [], []
        for block in (TIME.pack(counter=self.counter, time=t_ns // 1000), of_sensors, totals, *self.slips):
            offsets.append(at)
            blocks.append(_indexed(at, block))
            at += len(blocks[-1])
        entries = ENTRY.pack_many(len(BLOCKS), block=BLOCKS, offset=offsets)
        return [PACKET.pack(data=b"".join([b"\2", *entries, self.end, *blocks]))]

    @command("7A 0A", name="zero")
    @command("7A 0A 00", name="zero, by the library")
    def zero_all(self, request: Request):
        """Make what is measured now zero."""
        self.zero = self.present

    @command("53 0A 00", name="slip detection on")
    @command("73 0A", name="slip detection off")
    def slip_detection(self, request: Request):
        """Change nothing: slip is not modelled."""

    @command(b"f100\n", name="100 Hz", pattern=rb"f(100|250|500|1000)")
    @command(b"f250\n", name="250 Hz")
    @command(b"f500\n", name="500 Hz")
    @command(b"f1000\n", name="1000 Hz")
    def set_rate(self, request: Request):
        """Set the packets per second."""
        self.period_ns = 1_000_000_000 // int(request.value)


def _indexed(at: int, block: bytes | list) -> bytes:
    """Return a block at offset ``at``: bytes, or a list of blocks behind their index."""
    if isinstance(block, bytes):
        return block
    parts, first = [], at + 2 + 2 * len(block)
    for part in block:
        parts.append(_indexed(first, part))
        first += len(parts[-1])
    return _index(INDEX.text, at, tuple(map(len, parts))) + b"".join(parts)


@lru_cache(256)
def _index(_table: str, at: int, sizes: tuple[int, ...]) -> bytes:
    """Return an index at offset ``at`` of these parts; ``_table`` makes a changed table a new key of the cache."""
    n = len(sizes)
    return INDEX.bind(parts=n).pack(count=n, offsets=at + 2 + 2 * n + np.cumsum((0, *sizes[:-1])))
