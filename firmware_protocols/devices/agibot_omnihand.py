"""AgiBot OmniHand Pro 2025 (O12) and OmniHand 2025 (O10): CAN-FD hands whose touch is polled by finger.

Wire: CAN-FD, 29-bit identifiers ``ppppp tttttttt 00000001 w ddddddd`` (p part, t message, w write, d number of the
hand). A driver sends up to 64 bytes; the hand answers under the same identifier with the write bit clear, within 50 ms.

    message  part      data, low byte first
    01       0         ``VENDOR``
    02       0         ``NUMBER``: number of the hand, and the line
    02       1         write: another number, kept; answered under the old one
    03       joint     current threshold, int16
    05       1..7      touch of a finger, thumb first; 6 and 7, of an O10, are its palm and its back
    10       joint     mode: 0 position; O10: 1 servo, 2 velocity, 3 torque; Pro: 1 velocity, 2 torque
    11       joint     torque, int16
    12       joint     velocity, int16
    13       joint     position 0..2000 (O10: to 4096), int16
    14       0         write: joint and mode << 5 in a byte, and two or three int16; a position comes first
    20       joint     errors, two bytes: 1 stalled, 2 hot, 4 current, 8 motor, 10 line
    21       joint     temperature, uint16
    22       joint     current, int16

A joint is 1..12 (O10: 1..10), 0 is all of them, one after the other. A write to 20, 21 or 22 sets a period [ms] at
which the hand reports all joints unasked, as part 0. A write is answered like a read.

Evidence: the vendor's SDKs, run.

Try it: ``tactemu run agibot_omnihand_pro --port can:socketcan:vcan0``, then
``candump vcan0 & cansend vcan0 01050101##1$(printf '00%.0s' {1..64})``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from firmware_protocols import (
    Can,
    CanFrame,
    Column,
    Command,
    Counts,
    Device,
    Fact,
    Option,
    Reading,
    Transmissions,
    assumed,
    grid_layout,
    stated,
)
from firmware_protocols.adc import quantize
from firmware_protocols.frames import with_payload
from firmware_protocols.layouts import stack
from firmware_protocols.motors import Motors
from firmware_protocols.tables import Frame, Identifier

CAN_ID = Identifier("ppppptttttttt00000001wddddddd", {"part": "p", "message": "t", "write": "w", "device": "d"})
VENDOR = Frame("""
    vendor, id ppppp 00000001 00000001 w ddddddd (p part, w write, d device)
    0     bytes x 16    model         ASCII
    16    bytes x 14    serial        ASCII
    30    u1 x 4        hardware      version
    34    u1 x 4        software      version
    38    <i2           supply        [mV]
    40    u1            joints
    41    00 x 7        unused
""")
NUMBER = Frame("""
    number, id ppppp 00000010 00000001 w ddddddd (p part, w write, d device)
    0     u1            number
    1     02            bits          1 Mbit/s of 125 k, 500 k, 1 M, 5 M
    2     01            sampled       at 80 % of 75, 80, 87.5
    3     03            data_bits     5 Mbit/s
    4     00            data_sampled  at 75 %
""")
VENDOR_INFO = 0x01
DEVICE = 0x02
THRESHOLD = 0x03
TOUCH = 0x05
MODE = 0x10
TORQUE = 0x11
SPEED = 0x12
POSITION = 0x13
MIXED = 0x14
ERRORS = 0x20
TEMPERATURE = 0x21
CURRENT = 0x22
TYPES = {
    MODE: "u1", THRESHOLD: "<i2", TORQUE: "<i2", SPEED: "<i2", POSITION: "<i2", ERRORS: "<u2", TEMPERATURE: "<u2",
    CURRENT: "<i2",
}  # fmt: skip
REPORTS = (ERRORS, TEMPERATURE, CURRENT)
MIXED_BYTES = {"O12": {3: 5, 4: 5, 5: 7}, "O10": {4: 5, 5: 5, 6: 7}}
"""The bytes of one joint in a mixed order, by model and mode."""
WITH_POSITION = {"O12": (3, 5), "O10": (4, 6)}

FINGERS = ("thumb", "index", "middle", "ring", "little")
PAD_CENTRES_M = {name: ((k - 2) * 0.025, 0.0, 0.0) for k, name in enumerate(FINGERS)}
PAD_CENTRES_M |= {"palm": (-0.025, -0.06, 0.0), "back": (0.025, -0.06, 0.0)}
PITCH_M = 0.004
COUNTS_PER_NEWTON = 1000 / 9.80665
PRO_COUNTS_PER_NEWTON = 1000.0
PRO = "AgibotTech/OmniHand-Pro-2025@3c7048e "
O10 = "AgibotTech/Omnihand-2025-SDK@bcbccf4 "


class AgibotOmniHand(Device[CanFrame]):
    """The protocol that both hands share."""

    kind = "hand"
    ports = (Can(data_bitrate=5_000_000, hears=(CAN_ID.filter(),)),)
    evidence = ("driver", "vendor document")
    model: ClassVar[str]
    parts: ClassVar[Mapping[str, tuple[int, int]]]
    """The rows and columns of each part, by name, from part 1 on."""
    answers: ClassVar[Mapping[tuple[int, int], Frame]]
    """The table of the touch answer, by rows and columns of the part."""
    said_model: ClassVar[str]
    highest: ClassVar[int]
    """The greatest position."""
    joint_names: ClassVar[tuple[str, ...]]
    counts: np.ndarray

    def __init__(
        self,
        *,
        device: Annotated[int, Option("number of the hand on the bus, as delivered", low=0, high=127)] = 1,
        side: Annotated[Literal["left", "right"], Option("which hand; mirrors the taxels")] = "left",
        serial: Annotated[str, Option("14 characters of ASCII")] = "OH250100000001",
    ):
        self.device, self.serial = self.flash.get("device", device), serial.encode("ascii")[:14].ljust(14, b"\0")
        pads = []
        for name, (rows, cols) in self.parts.items():
            pad = grid_layout(rows, cols, PITCH_M, name=name, origin=PAD_CENTRES_M[name], link=name)
            pads.append(replace(pad, wire_order=self._order(side, rows, cols)))
        self.layout = stack(*pads)
        n = len(self.joint_names)
        self.motors = Motors([2000] * n, low=0, high=self.highest, time_constant_s=0.05, speed_limit=2000)
        self.stored = {message: np.zeros(n, int) for message in (MODE, THRESHOLD, TORQUE, SPEED)}
        self.stored[THRESHOLD] += 1000
        self.periods_ms = {message: np.zeros(n, int) for message in REPORTS}
        self.due_ns: dict[int, int] = dict.fromkeys(REPORTS, 0)

    def _order(self, side: str, rows: int, cols: int) -> np.ndarray:
        """Return the index of the taxel that is sent first, second ..."""
        return np.arange(rows * cols)

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Answer a read or a write."""
        asked = CAN_ID.read(data.arbitration_id) if data.is_extended_id and data.is_fd else None
        if asked is None or asked["device"] != self.device:
            self.counters["ignored" if asked is None else "other_device"] += 1
            return ()
        answered = self.device
        answer = self._answer(asked["message"], asked["part"], data.data if asked["write"] else None, t_ns)
        if answer is None:
            self.counters["unknown_command"] += 1
            return ()
        self.counters["requests"] += 1
        return [_frame(asked["message"], asked["part"], answered, answer)]

    def _answer(self, message: int, part: int, order: bytes | None, t_ns: int) -> bytes | None:
        if message == TOUCH and 1 <= part <= len(self.parts):
            patch = self.layout.patches[part - 1]
            return self._touch(self.answers[patch.rows, patch.cols], self.layout.on_wire(self.counts)[patch.taxels])
        if message == VENDOR_INFO and part == 0:
            return VENDOR.pack(
                model=self.said_model.encode("ascii").ljust(16, b"\0"), serial=self.serial, hardware=(1, 0, 0, 0),
                software=(1, 1, 0, 0), supply=24000, joints=len(self.joint_names),
            )  # fmt: skip
        if message == DEVICE and part <= 1:
            if order and part == 1 and order[0] < 128:
                self.device = self.flash["device"] = order[0]
            return NUMBER.pack(number=self.device)
        if message == MIXED and part == 0:
            self._mix(order or b"", t_ns)
            return bytes(8)
        if message in TYPES and part <= len(self.joint_names):
            joints = slice(None) if part == 0 else slice(part - 1, part)
            if order is not None:
                self._order_joints(message, joints, order, t_ns)
            return self._joints(message, t_ns)[joints].astype(TYPES[message]).tobytes()
        return None

    def _touch(self, table: Frame, counts: np.ndarray) -> bytes:
        """Return the touch answer of a part with these counts."""
        return table.pack(channels=counts)

    def _joints(self, message: int, t_ns: int) -> np.ndarray:
        """Return what a read of ``message`` gives for all joints."""
        if message == POSITION:
            return np.rint(self.motors.positions(t_ns))
        if message == TEMPERATURE:
            return np.full(len(self.joint_names), 25)
        return self.stored.get(message, np.zeros(len(self.joint_names), int))

    def _order_joints(self, message: int, joints: slice, order: bytes, t_ns: int) -> None:
        n = len(range(len(self.joint_names))[joints])
        kind = np.dtype("<u2" if message in REPORTS else TYPES[message])
        if len(order) < n * kind.itemsize:
            return
        numbers = np.frombuffer(order, kind, n)
        if message == POSITION:
            goals = np.full(len(self.joint_names), np.nan)
            goals[joints] = numbers
            self.motors.go(goals, t_ns)
        elif message in REPORTS:
            self.periods_ms[message][joints] = numbers
            self.due_ns[message] = t_ns + self._period_ns(message)
            self._wait()
        else:
            self.stored[message][joints] = numbers

    def _mix(self, order: bytes, t_ns: int) -> None:
        goals = np.full(len(self.joint_names), np.nan)
        while order and 1 <= order[0] & 0x1F <= len(goals) and (size := MIXED_BYTES[self.model].get(order[0] >> 5)):
            if order[0] >> 5 in WITH_POSITION[self.model] and len(order) >= size:
                goals[(order[0] & 0x1F) - 1] = int.from_bytes(order[1:3], "little", signed=True)
            order = order[size:]
        self.motors.go(goals, t_ns)

    # -- reports unasked -------------------------------------------------------------------------------------------

    def _period_ns(self, message: int) -> int:
        periods = self.periods_ms[message][self.periods_ms[message] > 0]
        return int(periods.min()) * 1_000_000 if len(periods) else 0

    def _wait(self) -> None:
        due = [self.due_ns[message] for message in REPORTS if self._period_ns(message)]
        self.wake_ns = min(due) if due else None

    def wake(self, t_ns: int) -> Transmissions[CanFrame]:
        """Return the reports that are due."""
        due = [message for message in REPORTS if self._period_ns(message) and self.due_ns[message] <= t_ns]
        for message in due:
            self.due_ns[message] += self._period_ns(message)
        self._wait()
        return [
            _frame(message, 0, self.device, self._joints(message, t_ns).astype(TYPES[message]).tobytes())
            for message in due
        ]

    @property
    def commands(self) -> tuple[Command, ...]:
        """A read of each part and of each value, and two writes; for a hand with number 1."""
        if self.device != 1:
            return ()
        origin, n = self.sources[0], len(self.joint_names)
        asked = [(f"touch of {part}", TOUCH, k, "") for k, part in enumerate(self.parts, 1)]
        asked += [("vendor", VENDOR_INFO, 0, "..{30} 01000000 01010000 C05D *"), ("number", DEVICE, 0, "0102010300")]
        asked += [(f"{name} of all joints", message, 0, "") for name, message in _NAMES.items()]
        asked += [(f"{name} of joint {n}", message, n, "") for name, message in _NAMES.items()]
        questions = tuple(
            Command(
                name=name,
                request=f"{part:02X}{message:02X}0101##1{'00' * 64}",
                reply=f"{part:02X}{message:02X}0101##1 {reply or '*'}",
                origin=origin,
            )
            for name, message, part, reply in asked
        )
        return (
            *questions,
            Command(
                name="position of joint 8",
                request=f"08130181##1E803{'00' * 62}",
                reply="08130101##1 D007",
                origin=origin,
            ),
            Command(
                name="threshold of joint 1",
                request=f"01030181##12003{'00' * 62}",
                reply="01030101##1 2003",
                origin=origin,
            ),
        )


_NAMES = {
    "threshold": THRESHOLD, "mode": MODE, "torque": TORQUE, "velocity": SPEED, "position": POSITION, "errors": ERRORS,
    "temperature": TEMPERATURE, "current": CURRENT,
}  # fmt: skip


def _frame(message: int, part: int, device: int, data: bytes) -> CanFrame:
    ident = CAN_ID.of(part=part, message=message, write=0, device=device)
    frame = with_payload(CanFrame(arbitration_id=ident, is_extended_id=True, is_fd=True, bitrate_switch=True), data)
    assert isinstance(frame, CanFrame)
    return frame


def _facts(looked: str, *own: Fact) -> tuple[Fact, ...]:
    """Return the facts of one hand, followed by those of both."""
    return (
        *own,
        assumed("touch", f"pads {PITCH_M * 1e3:.0f} mm apart, all facing one way, tips to +y", looked),
        assumed("identity", "number 1 as delivered; serial number, versions 1.0.0 and 1.1.0, 24 V", looked),
        assumed("configuration", "what a write is answered with: as a question, with what is so now", looked),
        assumed(
            "configuration",
            "threshold 1000, mode 0, 25 degrees, no current, no error; torque and speed are stored",
            looked,
        ),
        assumed(
            "configuration", "motors: at 2000 after power-up, 2000 a second; positions are obeyed in every mode", looked
        ),
        assumed(
            "configuration",
            "reports of all joints come in the shortest period of any; firmware upgrades are not answered",
            looked,
        ),
        assumed("timing", "100 conversions a second", looked),
    )


class AgibotOmniHandO10(AgibotOmniHand):
    """An O10: 16 taxels on each finger, 25 on the palm and on the back."""

    name = "agibot_omnihand_o10"
    title = "AgiBot OmniHand 2025 (O10)"
    model, said_model, highest = "O10", "OmniHand2025", 4096
    joint_names = tuple(f"joint {k}" for k in range(1, 11))
    columns = (Column(name="touch", unit="N", counts_per_unit=COUNTS_PER_NEWTON, low=0, high=0xFF, push=1),)
    sources = (
        f"{O10}src/proto.h, src/implementation/c_agibot_hand_can/c_agibot_hand_can.cc, src/kinematics_solver",
        f"{O10}document/pic/tactile_sensor_array.jpg, document/en/API_CPP.md, python/example/demo_tactile_sensor.py",
    )
    judge = "AgibotTech/Omnihand-2025-SDK@bcbccf4"
    facts = _facts(
        f"all of {O10}src, document, python, node",
        stated("touch", "a count is a gram", f"{O10}python/example/demo_tactile_sensor.py:12"),
        stated(
            "touch",
            "fingers 8 x 2, from the base, mirrored in a left hand",
            f"{O10}document/pic/tactile_sensor_array.jpg",
        ),
        assumed("touch", "palm and back are squares, row by row", f"all of {O10}src, document, python, node"),
        stated(
            "configuration",
            "identifiers, messages and types",
            f"{O10}src/proto.h, src/implementation/c_agibot_hand_can",
        ),
        stated(
            "configuration",
            "positions 0..2000; to 4096",
            f"{O10}document/en/API_CPP.md:205; src/kinematics_solver.h:92",
        ),
        stated(
            "configuration",
            "1 and 5 Mbit/s, sampled at 80 and 75 %",
            f"{O10}src/can_bus_device/zlg_usb_canfd/c_zlg_usbcanfd_sdk.cc:67",
        ),
    )
    parts = {**dict.fromkeys(FINGERS, (8, 2)), "palm": (5, 5), "back": (5, 5)}
    answers = {
        (8, 2): Frame("""
            finger, row by row from the bottom right, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1 x 16       channels      [g]; of a right hand from the left
        """),
        (5, 5): Frame("""
            palm or back, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1 x 25       channels      [g]
            25    00 x 7        unused
        """),
    }

    def _order(self, side: str, rows: int, cols: int) -> np.ndarray:
        """Return the order on the wire: fingers begin at their base."""
        grid = np.arange(rows * cols).reshape(rows, cols)
        if cols == 2:
            grid = grid[::-1, ::-1] if side == "left" else grid[::-1]
        return grid.ravel()

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return the normal force on each taxel [g], 0..255, shape ``(n_taxels,)``."""
        self.counts = quantize(self.layout.push(reading["force"]), COUNTS_PER_NEWTON, 0, 0xFF)
        return self.counts


class AgibotOmniHandPro(AgibotOmniHand):
    """An O12: nine channels on each finger, and the force that its firmware computes from them."""

    name = "agibot_omnihand_pro"
    title = "AgiBot OmniHand Pro 2025 (O12)"
    model, said_model, highest = "O12", "OmniHandPro2025", 2000
    joint_names = tuple(f"joint {k}" for k in range(1, 13))
    columns = (
        Column(name="channel", low=0, high=0xFFFF, push=1),
        Column(name="normal", unit="N", counts_per_unit=10.0, low=0, high=3000, push=1),
        Column(name="tangential", unit="N", counts_per_unit=10.0, low=0, high=3000),
        Column(name="angle", low=0, high=359),
    )
    sources = (f"{PRO}src/proto.h, src/c_agibot_hand.cc, src/kinematics_solver, document/API_CPP.md",)
    judge = "AgibotTech/OmniHand-Pro-2025@3c7048e"
    facts = _facts(
        f"all of {PRO}src, document, python, node",
        stated(
            "touch", "nine channels; normal 0..3000 in 0.1 N; angle 0 at the tip, clockwise", f"{PRO}src/proto.h:55"
        ),
        assumed("touch", "channels 3 x 3, row by row, 1000 counts/N", f"all of {PRO}src, document, python, node"),
        assumed(
            "touch",
            "forces are those on all channels of the finger, tangential in 0.1 N as normal; online 1, proximity 0",
            f"all of {PRO}src, document, python, node",
        ),
        stated("configuration", "identifiers, messages and types", f"{PRO}src/proto.h, src/c_agibot_hand.cc:430, 1234"),
        stated("configuration", "positions 0..2000", f"{PRO}src/kinematics_solver/kinematics_solver.h:100"),
        stated(
            "configuration",
            "1 and 5 Mbit/s, sampled at 80 and 75 %",
            f"{PRO}src/can_bus_device/zlg_usb_canfd/c_zlg_usbcanfd_sdk.cc:67",
        ),
    )
    parts = dict.fromkeys(FINGERS, (3, 3))
    answers = {
        (3, 3): Frame("""
            finger, row by row, id ppppp 00000101 00000001 w ddddddd (p part, w write, d device)
            0     u1            online
            1     <u2 x 9       channels
            19    <u2           normal        0..3000 [0.1 N]
            21    <u2           tangential
            23    <u2           angle         of the tangential force [deg], 0 towards the tip, clockwise
            25    u1 x 4        proximity
            29    00 x 3        unused
        """)
    }

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return each taxel's raw normal force, and normal, tangential [0.1 N] and angle [deg] of its finger."""
        force = self.layout.to_taxel_frame(reading["force"])
        x, y, z = force.reshape(len(FINGERS), -1, 3).sum(axis=1).T
        forces = quantize(np.stack([-z, np.hypot(x, y)]), 10.0, 0, 3000)
        angle = np.rint(np.degrees(np.arctan2(x, y))).astype(int) % 360
        of_finger = np.stack([*forces, angle], axis=1).repeat(len(force) // len(FINGERS), axis=0)
        self.counts = np.column_stack([quantize(-force[:, 2], PRO_COUNTS_PER_NEWTON), of_finger])
        return self.counts

    def _touch(self, table: Frame, counts: np.ndarray) -> bytes:
        _, normal, tangential, angle = counts[0].tolist()
        return table.pack(
            online=1, channels=counts[:, 0], normal=normal, tangential=tangential, angle=angle, proximity=[0] * 4
        )
