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

from typing import Annotated

import numpy as np

from firmware_protocols import (
    Axis, Column, Command, Counts, Device, Frame, Lines, Option, Reading, Rollover, Serial, Transmissions, fact_table,
    grid_layout, stack,
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
FORCE_RANGES_N = np.array([4.0, 4.0, 15.0])
DEFLECTION_RANGES_MM = np.array([1.0, 1.0, 2.5])
"""The ranges of a pillar along x, y, z, as those of force above."""
LIBRARY = "m-rosette/contactile_gripper_ros2@146709d"
RATES_HZ = {b"f100": 100, b"f250": 250, b"f500": 500, b"f1000": 1000}
ZERO_COMMAND = b"z"
SLIP_COMMANDS = (b"S", b"s")
AXES: tuple[Axis, ...] = ("x", "y", "z")


class ContactilePapillArray(Device):
    """A controller that streams the readings of sensors with 3 x 3 pillars."""

    name = "contactile_papillarray"
    kind = "fingertip"
    ports = (Serial(baud=115200, usb=True),)
    rate_hz = 1000.0
    columns = tuple(
        Column(name=f"{letter}{axis}", axis=axis, unit=unit, counts_per_unit=scale, low=-most, high=most,
               push=1 if axis == "z" else 0)
        for letter, unit, scale, ranges in (("F", "N", 1.0, FORCE_RANGES_N), ("D", "m", 1000.0, DEFLECTION_RANGES_MM))
        for axis, most in zip(AXES, ranges.tolist())
    )  # fmt: skip
    rollovers = (Rollover(name="counter", bits=32, state="counter"),)
    evidence = ("vendor document", "driver")
    sources = (
        "langxin11/contactile_pts_lab@2797753 docs/manuals (PTSCOM_2.0_SPEC_SEP22, PTS_2.1_SPEC_JAN25)",
        "langxin11/contactile_pts_lab@5bb5ea0 python_ws/pts_protocol.py",
        "m-rosette/contactile_gripper_ros2@146709d papillarray_ros2_v2: the vendor's library and its headers (sense of "
        "offsets, entry of kind 0, commands, slip), launch/papillarray.launch.py",
    )
    judge = "m-rosette/contactile_gripper_ros2@146709d (Contactile's libPTSDK.a)"
    facts = fact_table(f"""
        stated touch: N, mm and N mm, all along X, Y, Z of the sensor @ {LIBRARY} lib/PTSDKSensor.h:78-150
        stated touch: 3 x 3 pillars, 7 mm apart; ranges 4 N and 15 N, 1 mm and 2.5 mm @ PTS_2.1_SPEC_JAN25
        assumed touch: pillars row by row from the sensor's upper left; a push is positive in Fz and Dz, as contact is
            Fz over 0.5 N @ PTSCOM_2.0_SPEC_SEP22, PTS_2.1_SPEC_JAN25; {LIBRARY} lib/PTSDKConstants.h:23
        assumed touch: the total is the sum over the pillars; torque r x F, with r from the middle of the sensor, F as
            sent @ PTSCOM_2.0_SPEC_SEP22; {LIBRARY} lib, all headers
        assumed touch: pillars are springs: deflection follows force, as the ranges do; both saturate there @
            PTS_2.1_SPEC_JAN25
        stated touch: -1: no estimate of friction, and so no grip force @ {LIBRARY} lib/PTSDKConstants.h:31
        assumed touch: slip is not modelled: states stay 0, detection on or off; kind 7 is not sent @
            PTSCOM_2.0_SPEC_SEP22, which does not describe it
        stated identity: no version, no serial number: the library asks for none @ {LIBRARY} lib/PTSDKListener.h
        stated configuration: at most 4 sensors @ {LIBRARY} lib/PTSDKConstants.h:17
        stated configuration: any baud rate; the launch file has 9600 on /dev/ttyACM0 @ {LIBRARY}
            launch/papillarray.launch.py
        assumed configuration: the entry of kind 0 has no offset (unless asked for): the library takes either @
            PTSCOM_2.0_SPEC_SEP22; the library, run
        assumed configuration: zero is at once (the vendor: about 2 s), of deflections too @ {LIBRARY}
            lib/PTSDKListener.h (sendBiasRequest)
        stated timing: 100, 250, 500 or 1000 packets a second, 1000 by default @ {LIBRARY} lib/PTSDKListener.h
            (setSamplingRate)
        assumed timing: the rate is 1000 after each power-up; the time is of power-up @ PTSCOM_2.0_SPEC_SEP22; {LIBRARY}
            lib, all headers
    """)

    def __init__(
        self,
        *,
        sensors: Annotated[int, Option("sensors on the controller; the library supports four", low=1, high=4)] = 2,
        end_offset: Annotated[bool, Option("the entry of kind 0 has an offset, like the others")] = False,
    ):
        self.title = f"Contactile PapillArray v2 controller, {sensors} sensors of 3x3 pillars"
        pads = (
            grid_layout(
                ROWS, ROWS, PITCH_M, name=f"sensor {k}", link=f"sensor {k}", origin=(k * SENSOR_SPACING_M, 0, 0)
            )
            for k in range(sensors)
        )
        self.layout = stack(*pads)
        places = 1000 * self.layout.positions[:PILLARS]
        self.arms = np.array([np.cross(places, axis) for axis in np.eye(3)])
        self.commands_in = Lines(b"\r\n\0", counters=self.counters, longest=16)
        self.zero = np.zeros((len(self.layout), 3))
        self.counter = 0
        self._lay_out(sensors, ENTRY.pack(block=0, offset=0)[: 4 if end_offset else 2])

    def _lay_out(self, n: int, end: bytes) -> None:
        """Prepare what all packets of ``n`` sensors share: the table, the indices, and the blocks of slip."""
        slips, slip = PILLARS * PILLAR_SLIP.pack(), SENSOR_SLIP.pack()
        time, pillar, total = TIME.size or 0, PILLAR.size or 0, TOTAL.size or 0
        starts = [1 + 4 * len(BLOCKS) + len(end)]
        starts.append(starts[-1] + time)
        self.pillar_heads = _indices(starts[-1], n, pillar)
        starts.append(starts[-1] + sum(map(len, self.pillar_heads)) + n * PILLARS * pillar)
        self.total_head = _index(starts[-1], n, total)
        starts.append(starts[-1] + len(self.total_head) + n * total)
        self.tail = b"".join(head + slips for head in _indices(starts[-1], n, len(slips) // PILLARS))
        starts.append(starts[-1] + len(self.tail))
        self.tail += _index(starts[-1], n, len(slip)) + n * slip
        entries = [ENTRY.pack(block=block, offset=at) for block, at in zip(BLOCKS, starts)]
        self.head = b"".join([b"\2", *entries, end])

    @property
    def commands(self) -> tuple[Command, ...]:
        """Commands for zero, rates and slip detection; some with the library's NUL."""
        origin = "PTSCOM_2.0_SPEC_SEP22; the NUL as the vendor's library sends it"
        return (
            Command(name="zero", request="7A 0A", origin=origin),
            Command(name="zero, by the library", request="7A 0A 00", origin=origin),
            Command(name="slip detection on", request="53 0A 00", origin=origin),
            Command(name="slip detection off", request="73 0A", origin=origin),
            *(
                Command(name=f"{hz} Hz", request=(line + b"\n").hex(" "), origin=origin)
                for line, hz in RATES_HZ.items()
            ),
        )

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return Fx, Fy, Fz [N] and Dx, Dy, Dz [mm] of each pillar as sent, float32 ``(n, 6)``; a push is positive."""
        self.felt = self.layout.to_taxel_frame(reading["force"]) * [1, 1, -1]
        force = (
            np.clip(self.felt - self.zero, -FORCE_RANGES_N, FORCE_RANGES_N) + 0.0
        )  # an unloaded pillar sends 0.0, not -0.0
        self.counts = np.hstack([force, force * (DEFLECTION_RANGES_MM / FORCE_RANGES_N)]).astype(np.float32)
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions:
        """Return one packet."""
        self.counter = (self.counter + 1) & 0xFFFFFFFF
        n, counts = len(self.pillar_heads), self.layout.on_wire(self.counts)
        pillars = PILLAR.pack_many(n * PILLARS, force=counts[:, :3], displacement=counts[:, 3:])
        data = [self.head, TIME.pack(counter=self.counter, time=t_ns // 1000)]
        for k, head in enumerate(self.pillar_heads):
            data += [head, *pillars[k * PILLARS : (k + 1) * PILLARS]]
        data.append(self.total_head)
        for forces in self.counts.reshape(n, PILLARS, 6)[..., :3]:
            torque = np.einsum("apt,pa->t", self.arms, forces) + 0.0
            data.append(TOTAL.pack(force=forces.sum(axis=0), torque=torque))
        data.append(self.tail)
        return [PACKET.pack(data=b"".join(data))]

    def receive(self, data: bytes, t_ns: int, port: str) -> Transmissions:
        """Obey lines, which arrive in chunks of any size; none is answered."""
        for line in self.commands_in.cut(data):
            self.counters["requests"] += 1
            if line == ZERO_COMMAND:
                self.zero = self.felt
            elif line in RATES_HZ:
                self.period_ns = 1_000_000_000 // RATES_HZ[line]
            elif line not in SLIP_COMMANDS:
                self.counters["unknown_command"] += 1
        return ()


def _index(at: int, n: int, size: int) -> bytes:
    """Return an index at offset ``at`` of the ``n`` parts of ``size`` bytes that follow it."""
    return INDEX.bind(parts=n).pack(count=n, offsets=at + 2 + 2 * n + size * np.arange(n))


def _indices(at: int, sensors: int, size: int) -> list[bytes]:
    """Return, for a block at ``at`` with ``size`` bytes per pillar, the indices before the records of each sensor."""
    sensor_size = len(_index(0, PILLARS, size)) + PILLARS * size
    first = at + len(_index(0, sensors, sensor_size))
    inner = [_index(first + k * sensor_size, PILLARS, size) for k in range(sensors)]
    return [_index(at, sensors, sensor_size) + inner[0], *inner[1:]]
