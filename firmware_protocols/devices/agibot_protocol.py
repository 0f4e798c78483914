"""The CAN-FD protocol that AgiBot's OmniHand Pro 2025 (O12) and OmniHand 2025 (O10) share.

The datasheet of both is :mod:`firmware_protocols.devices.agibot_omnihand`.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Command, Device, Fact, Frame, Identifier, Motors, Option, Transmissions, fact_table, grid_layout,
    stack, with_payload,
)  # fmt: skip

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


class AgibotOmniHand(Device[CanFrame]):
    """The protocol that both hands share."""

    kind = "hand"
    ports = (Can(data_bitrate=5_000_000, filters=(CAN_ID.filter(),)),)
    evidence = ("driver", "vendor document")
    model: ClassVar[str]
    parts: ClassVar[Mapping[str, tuple[int, int]]]
    """The rows and columns of each part, by name, from part 1 on."""
    answers: ClassVar[Mapping[tuple[int, int], Frame]]
    """The table of the touch answer, by rows and columns of the part."""
    reported_model: ClassVar[str]
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
                model=self.reported_model.encode("ascii").ljust(16, b"\0"), serial=self.serial, hardware=(1, 0, 0, 0),
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
                safe=True,
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


def shared_facts(looked: str) -> tuple[Fact, ...]:
    """Return the facts that hold for both hands."""
    return fact_table(f"""
        assumed touch: pads {PITCH_M * 1e3:.0f} mm apart, all facing one way, tips to +y @ {looked}
        assumed identity: number 1 as delivered; serial number, versions 1.0.0 and 1.1.0, 24 V @ {looked}
        assumed configuration: what a write is answered with: as a question, with what is so now @ {looked}
        assumed configuration: threshold 1000, mode 0, 25 degrees, no current, no error; torque and speed are stored
            @ {looked}
        assumed configuration: motors: at 2000 after power-up, 2000 a second; positions are obeyed in every mode
            @ {looked}
        assumed configuration: reports of all joints come in the shortest period of any; firmware upgrades are not
            answered @ {looked}
        assumed timing: 100 conversions a second @ {looked}
    """)
