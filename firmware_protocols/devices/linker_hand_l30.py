"""LinkerHand L30: five fingertips of 12 x 6 taxels and seventeen joints, on CAN-FD.

Wire: CAN-FD, 1 and 5 Mbit/s, extended identifiers (``ID``): priority, 1 to write, command, part, receiver, sender; the
hand is 1, the host 0. Data begin with their length and the number of frames less 1, then that of this frame, four bits
each; in an answer a state follows, which the length does not count. Numbers are high byte first, one for each joint.

    command  part      access  data
    1        01 .. 03  write   positions, torques [6.5 mA] 60 .. 800, speeds [0.732 rpm] 1 .. 250; no answer
    1        07, 08    write   enables, disables
    2        01 .. 05  read    thumb .. little finger: 61 and 11 values in two frames, row by row from the bottom
    3        01        write   password 12 34 56 78 9A BC, before other writes of command 3
    3        02        both    product, serial number, versions, id, hand, sensor, origin; serial number, origin
    3        03        read    product code, ASCII
    3        04        both    id, in force at once, kept
    3        05        write   the present pose becomes 0, while disabled
    3        06        both    hand: 0 left, 1 right, kept
    4        01 .. 05  write   1 or 0, period [ms] and mask of joints, four bytes each: values as of command 5, unasked
    5        01 .. 05  read    positions, currents, speeds, two bytes each; temperatures [deg C], errors, a byte each
    6        joint     write   one joint: 20 position, 40 torque, 60 speed, plus the number

States: 00 done, 10 length, 11 value, 12 command, 13 part, 20 locked, 22 disabled, 23 not now, 35 period.

Evidence: the vendor's driver for protocol 1.0.6, run.

Try it: ``tactemu run linker_hand_l30 --port can:socketcan:vcan0``, then ``cansend vcan0 00A02100##10000`` for touch.
"""

import struct
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Column, Device, Identifier, Motors, Option, Refused, Request, Transmissions, command,
    command_table, fact_table, int16,
)  # fmt: skip
from firmware_protocols.devices.linker_hand_touch import COUNTS_PER_NEWTON, pads

ID = Identifier(
    "pppwccccssssssssrrrrrmmmmm000",
    {"priority": "p", "write": "w", "command": "c", "part": "s", "to": "r", "sender": "m"},
)
JOINTS = 17
LOWS = [0] * 4 + [-200] + [0] * 6 + [-200] * 3 + [0, 0, -900]
HIGHS = [900, 1200, 900, 800, 200, *[1200] * 4, 1500, 1200, 200, 200, 200, 1200, 1200, 900]
COUNTS_PER_S_PER_SPEED = 0.732 * 6 * 10
PASSWORD = bytes.fromhex("123456789ABC")
FRAME_VALUES = 61
SPEEDS = range(1, 251)
PERIODS_MS = range(20, 1001)
STATES = {"bad_length": 0x10, "value": 0x11, "access": 0x20, "failure": 0x22, "busy": 0x23, "address": 0x35}
BAD_COMMAND, BAD_PART = 0x12, 0x13
DRIVER = "linker-bot/linkerhand-l30-sdk@0103fc5 core/linker_hand_l30_v6_2_canfd.py"


class LinkerHandL30(Device[CanFrame]):
    """An L30, which answers a request for a finger with its matrix."""

    name = "linker_hand_l30"
    title = "LinkerHand L30, 5 fingertips 12x6"
    kind = "hand"
    columns = (Column(name="touch", low=0, high=255, assumed_per_unit=COUNTS_PER_NEWTON, push=1),)
    evidence = ("driver",)
    sources = (DRIVER,)
    judge = "linker-bot/linkerhand-l30-sdk@0103fc5"
    documented = command_table(
        f"""
        ? thumb          00402100##10000  00402008##13D1000 ..{{61}}, 00402008##10B1100 ..{{11}} 00 00
        ? information    00604100##10000  00604008##1120000 13 ..{{17}} 00 00 00
        ? product code   00606100##10000  00606008##1140000 4C 48 54 33 30 ..{{15}} 00
        ? id             00608100##10000  00608008##1010000 01
        ? hand           0060C100##10000  0060C008##1010000 00
        ? positions      00A02100##10000  00A02008##1220000 {"00" * 34} {"00" * 11}
        ? currents       00A04100##10000  00A04008##1220000 {"00" * 34} {"00" * 11}
        ? speeds         00A06100##10000  00A06008##1220000 {"00" * 34} {"00" * 11}
        ? temperatures   00A08100##10000  00A08008##1110000 {"19" * 17}
        ? errors         00A0A100##10000  00A0A008##1110000 {"00" * 17}
        move             02202100##12200 {"000A" * 17} {"00" * 12}
        torques          02204100##12200 {"0064" * 17} {"00" * 12}
        all at 50        02206100##12200 {"0032" * 17} {"00" * 12}
        disable          02210100##10000  02210008##1000000
        enable           0220E100##10000  0220E008##1000000
        unlock           02602100##10600123456789ABC  02602008##1000000
        zero, locked     0260A100##10000  0260A008##1000020
        joint 1 to 100   02C42100##102000064  02C42008##1000000
        stop             0220A100##10000  0220A008##1000013
        """,
        origin=DRIVER,
    )
    facts = fact_table(f"""
        stated touch: a matrix has 72 bytes in two frames of 61 and 11; the driver reverses the order of the rows @
            {DRIVER}:800-873
        assumed touch: {COUNTS_PER_NEWTON:.0f} counts/N; the first row that is sent is the one farthest from the tip
        stated identity: the information has 18 bytes; the model code is such as LHT30-06-169-L-B-1-A @ {DRIVER}:920-990
        assumed identity: versions 1.0.6, 1.0.0, 6.2.0, sensor 2, origin 1
        stated configuration: identifiers, transactions, states, commands, units, limits @ {DRIVER}:7-22, 160-330
        stated configuration: writes are refused while the hand is locked; zeros are set while it is disabled @
            {DRIVER}:880-905, 1045
        assumed configuration: an answer repeats priority and access; after power-up the hand is enabled, with positions
            0 and speed 250; positions are in 0.1 deg; torques and the zero have no effect; errors and currents are 0,
            temperatures 25 deg C; wrong passwords do not lock the hand for good
        stated configuration: the commands stop and pause are not supported @ {DRIVER}:178
        stated timing: periods are 20 to 1000 ms; others are answered with state 35 @ {DRIVER}:1107
        assumed timing: touch is sampled 100 times a second; the device answers at once
    """, looked="linker-bot/linkerhand-l30-sdk@0103fc5, all files")  # fmt: skip

    def __init__(
        self,
        *,
        side: Annotated[Literal["left", "right"], Option("which hand as delivered")] = "left",
        serial_number: Annotated[int, Option("serial number", low=0, high=0xFFFFFFFF)] = 169,
    ):
        grids = pads((12, 6))
        self.layout = replace(grids, wire_order=grids.wire_order.reshape(5, 12, 6)[:, ::-1].ravel())
        delivered = {"id": 1, "hand": int(side == "right"), "serial": serial_number, "origin": 1}
        self.kept: dict[str, int] = {**delivered, **self.flash}
        self.ports = (Can(data_bitrate=5_000_000, filters=(ID.filter(to=self.kept["id"]),)),)
        self.packets = CanRequests(ID, by="command part write", is_fd=True)
        self.motors = Motors(
            np.zeros(JOINTS), low=LOWS, high=HIGHS, time_constant_s=0.0, speed_limit=250 * COUNTS_PER_S_PER_SPEED
        )
        self.speeds, self.enabled, self.locked = [250] * JOINTS, True, True
        self.reports: dict[int, list[int]] = {}
        """Period [ns], mask and next time of each value that is sent unasked."""
        self.counts = np.zeros(len(self.layout), np.int64)

    # -- requests --------------------------------------------------------------------------------------------------

    def accepts(self, request: Request) -> bool:
        """Return True for a request to this hand."""
        request.own = self.kept["id"]
        data = request.data or b"\0\0"
        request.body = data[2 : 2 + data[0]]
        return request.to == request.own

    @command(on=[(1, part, 1) for part in (1, 2, 3)], data="*")
    def set_all(self, request: Request):
        """Set positions, torques or speeds of all joints."""
        if len(request.body) == 2 * JOINTS:
            self._set(request.part, dict(enumerate(struct.unpack(">17h", request.body))), request.t_ns)
        return ()

    @command(on=[(6, kind << 5 | joint, 1) for kind in (1, 2, 3) for joint in range(1, JOINTS + 1)], data="*")
    def set_one(self, request: Request):
        """Set the position, torque or speed of one joint."""
        (value,) = _unpacked(">h", request.body)
        if not self.enabled:
            raise Refused("failure")
        self._set(request.part >> 5, {(request.part & 0x1F) - 1: value}, request.t_ns)

    def _set(self, kind: int, values: dict[int, int], t_ns: int) -> None:
        if kind == 1 and self.enabled:
            goals = np.full(JOINTS, np.nan)
            goals[list(values)] = list(values.values())
            self.motors.go(goals, t_ns)
        if kind == 3:
            for joint, value in values.items():
                self.speeds[joint] = min(max(value, SPEEDS[0]), SPEEDS[-1])
            self.motors.limit_speed(np.array(self.speeds) * COUNTS_PER_S_PER_SPEED, t_ns)

    @command(on=[(1, 7, 1), (1, 8, 1)], data="*")
    def enable(self, request: Request):
        """Enable or disable all joints."""
        self.enabled = request.part == 7

    @command(on=[(2, part, 0) for part in range(1, 6)], data="*")
    def touch(self, request: Request):
        """Return the matrix of a finger in two frames."""
        patch = self.layout.patches[request.part - 1]
        values = self.layout.on_wire(self.counts)[patch.taxels].astype(np.uint8).tobytes()
        parts = enumerate((values[:FRAME_VALUES], values[FRAME_VALUES:]))
        return [self._frame(request, bytes([len(part), 0x10 | k, 0]) + part) for k, part in parts]

    @command(on=[(5, part, 0) for part in range(1, 6)], data="*")
    def values(self, request: Request):
        """Return a value of each joint."""
        return self._values(request.part, request.t_ns)

    def _values(self, part: int, t_ns: int, joints: list[int] | None = None) -> bytes:
        """Return a value of each of these joints, all by default."""
        chosen = slice(None) if joints is None else joints
        if part == 1:
            return int16(self.motors.positions(t_ns)[chosen])
        if part == 3:
            return int16(self.motors.velocities(t_ns)[chosen] / COUNTS_PER_S_PER_SPEED)
        number = JOINTS if joints is None else len(joints)
        return bytes(2 * number) if part == 2 else bytes([25 * (part == 4)]) * number

    @command(on=[(4, part, 1) for part in range(1, 6)], data="*")
    def report(self, request: Request):
        """Send a value of the joints unasked, or no more."""
        on, period_ms, mask = _unpacked(">BII", request.body)
        if on and period_ms not in PERIODS_MS:
            raise Refused("address")
        self.reports.pop(request.part, None)
        if on:
            period_ns = period_ms * 1_000_000
            self.reports[request.part] = [period_ns, mask or (1 << JOINTS) - 1, request.t_ns + period_ns]
        self._set_alarm()

    def wake(self, t_ns: int) -> Transmissions[CanFrame]:
        """Return the values that are due."""
        sent = []
        for part, report in self.reports.items():
            period_ns, mask, due_ns = report
            if due_ns <= t_ns:
                data = self._values(part, t_ns, [k for k in range(JOINTS) if mask >> k & 1])
                ident = ID.of(priority=0, write=0, command=4, part=part, to=0, sender=self.kept["id"])
                sent.append(self.packets.frame(ident, bytes([len(data), 0]) + data))
                report[2] = due_ns + period_ns
        self._set_alarm()
        return sent

    def _set_alarm(self) -> None:
        self.wake_ns = min((due_ns for _, _, due_ns in self.reports.values()), default=None)

    # -- configuration ---------------------------------------------------------------------------------------------

    @command(on=[(3, 1, 1)], data="*")
    def unlock(self, request: Request):
        """Allow writes of the configuration."""
        self.locked = request.body != PASSWORD
        if self.locked:
            raise Refused("access")

    @command(on=[(3, 2, 0)], data="*")
    def information(self, request: Request):
        """Return what the hand is."""
        kept = self.kept
        versions = bytes([1, 0, 6, 1, 0, 0, 6, 2, 0])
        return struct.pack(">BI9s4B", 0x13, kept["serial"], versions, kept["id"], kept["hand"], 2, kept["origin"])

    @command(on=[(3, 3, 0)], data="*")
    def product_code(self, request: Request):
        """Return the code of the product."""
        side = "LR"[self.kept["hand"]]
        return f"LHT30-06-{self.kept['serial']:03}-{side}-B-1-A".encode("ascii")

    @command(on=[(3, 4, 0), (3, 6, 0)], data="*")
    def number(self, request: Request):
        """Return the id, or which hand it is."""
        return bytes([self.kept["id" if request.part == 4 else "hand"]])

    @command(on=[(3, part, 1) for part in (2, 4, 5, 6)], data="*")
    def configure(self, request: Request):
        """Keep a part of the configuration, or set the zero."""
        if self.locked:
            raise Refused("access")
        if request.part == 5:
            if self.enabled:
                raise Refused("busy")
            return
        if request.part == 2:
            serial, origin = _unpacked(">IB", request.body)
            changed = {"serial": serial, "origin": origin}
        else:
            changed = {"id" if request.part == 4 else "hand": _unpacked("B", request.body)[0]}
        if not 1 <= changed.get("id", 1) <= 31 or changed.get("hand", 0) > 1:
            raise Refused("value")
        self.kept |= changed
        self.flash.update(changed)
        self.ports = (replace(self.ports[0], filters=(ID.filter(to=self.kept["id"]),)),)

    # -- answers ---------------------------------------------------------------------------------------------------

    def _frame(self, request: Request, data: bytes) -> CanFrame:
        fields = {name: request.fields[name] for name in ("priority", "write", "command", "part")}
        return self.packets.frame(ID.of(**fields, to=request.sender, sender=request.own), data)

    def reply(self, request: Request, content: bytes) -> Transmissions[CanFrame]:
        """Return the answer to a request that was obeyed."""
        return [self._frame(request, bytes([len(content), 0, 0]) + content)]

    def refused(self, request: Request, why: str) -> Transmissions[CanFrame]:
        """Return an answer with a state."""
        unknown = BAD_PART if 1 <= request.command <= 6 else BAD_COMMAND
        state = unknown if why == "unknown_command" else STATES.get(request.why, 0x11)
        return [self._frame(request, bytes([0, 0, state]))]


def _unpacked(form: str, body: bytes) -> tuple:
    """Return the numbers in data, which have this form."""
    if len(body) != struct.calcsize(form):
        raise Refused("value")
    return struct.unpack(form, body)
