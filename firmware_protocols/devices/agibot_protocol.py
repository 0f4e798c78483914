"""The CAN-FD protocol that AgiBot's OmniHand Pro 2025 (O12) and OmniHand 2025 (O10) share.

The datasheet of both is :mod:`firmware_protocols.devices.agibot_omnihand`.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, CanRequests, Command, Device, Fact, Frame, Identifier, Motors, Option, Request,
    Transmissions, command, command_table, fact_table, grid_layout, one_of, stack,
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
VALUES = {
    # message: name and type of a value of each joint
    0x03: ("threshold", "<i2"), 0x10: ("mode", "u1"), 0x11: ("torque", "<i2"), 0x12: ("velocity", "<i2"),
    0x13: ("position", "<i2"), 0x20: ("errors", "<u2"), 0x21: ("temperature", "<u2"), 0x22: ("current", "<i2"),
}  # fmt: skip
VENDOR_INFO, DEVICE, THRESHOLD, TOUCH, POSITION, MIXED, TEMPERATURE = 0x01, 0x02, 0x03, 0x05, 0x13, 0x14, 0x21
REPORTS = (0x20, TEMPERATURE, 0x22)
ZEROS = "00" * 64
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
        self.stored = {message: np.zeros(n, int) for message in (THRESHOLD, 0x10, 0x11, 0x12)}
        self.stored[THRESHOLD] += 1000
        self.packets = CanRequests(CAN_ID, by="message", is_fd=True)
        self.periods_ms = {message: np.zeros(n, int) for message in REPORTS}
        self.due_ns: dict[int, int] = dict.fromkeys(REPORTS, 0)

    def _order(self, side: str, rows: int, cols: int) -> np.ndarray:
        """Return the index of the taxel that is sent first, second ..."""
        return np.arange(rows * cols)

    def accepts(self, request: Request) -> bool:
        """Return True for the number of this hand."""
        return request.device == self.device

    def reply(self, request: Request, content: bytes) -> Transmissions[CanFrame]:
        """Return the answer, under the number that was asked."""
        return [self._frame(request.message, request.part, request.device, content)]

    def _frame(self, message: int, part: int, device: int, data: bytes) -> CanFrame:
        return self.packets.frame(CAN_ID.of(part=part, message=message, write=0, device=device), data)

    @command(on=TOUCH, data="*")
    def touch(self, request: Request):
        """Return the touch of a part."""
        patch = one_of(self.layout.patches, request.part - 1)
        return self._touch(self.answers[patch.rows, patch.cols], self.layout.on_wire(self.counts)[patch.taxels])

    @command(on=VENDOR_INFO, data="*")
    def vendor(self, request: Request):
        """Return what the hand is."""
        one_of(range(1), request.part)
        return VENDOR.pack(
            model=self.reported_model.encode("ascii").ljust(16, b"\0"), serial=self.serial, hardware=(1, 0, 0, 0),
            software=(1, 1, 0, 0), supply=24000, joints=len(self.joint_names),
        )  # fmt: skip

    @command(on=DEVICE, data="*")
    def number(self, request: Request):
        """Return the number of the hand, or another one."""
        if one_of(range(2), request.part) and request.write and request.data and request.data[0] < 128:
            self.device = self.flash["device"] = request.data[0]
        return NUMBER.pack(number=self.device)

    @command(on=MIXED, data="*")
    def mixed(self, request: Request):
        """Obey an order for several joints."""
        one_of(range(1), request.part)
        self._mix(request.data if request.write else b"", request.t_ns)
        return bytes(8)

    @command(on=tuple(VALUES), data="*")
    def values(self, request: Request):
        """Return a value of one joint or all, which a write sets."""
        n = len(self.joint_names)
        part = one_of(range(n + 1), request.part)
        joints = slice(part - 1, part) if part else slice(n)
        if request.write:
            self._order_joints(request.message, joints, request.data, request.t_ns)
        return self._values(request.message, request.t_ns)[joints].tobytes()

    def _touch(self, table: Frame, counts: np.ndarray) -> bytes:
        """Return the touch answer of a part with these counts."""
        return table.pack(channels=counts)

    def _values(self, message: int, t_ns: int) -> np.ndarray:
        """Return what a read of ``message`` gives for all joints, as it is sent."""
        values = self.stored.get(message, np.full(len(self.joint_names), 25 if message == TEMPERATURE else 0))
        return (np.rint(self.motors.positions(t_ns)) if message == POSITION else values).astype(VALUES[message][1])

    def _order_joints(self, message: int, joints: slice, order: bytes, t_ns: int) -> None:
        n = len(range(len(self.joint_names))[joints])
        kind = np.dtype("<u2" if message in REPORTS else VALUES[message][1])
        if len(order) < n * kind.itemsize:
            return
        numbers = np.frombuffer(order, kind, n)
        if message == POSITION:
            self.motors.go(numbers, t_ns, at=joints)
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
        return [self._frame(message, 0, self.device, self._values(message, t_ns).tobytes()) for message in due]

    @property
    def commands(self) -> tuple[Command, ...]:
        """A read of each part and of each value, and two writes; for a hand with number 1."""
        if self.device != 1:
            return ()
        asked = [("vendor", VENDOR_INFO, 0, "..{30} 01000000 01010000 C05D *"), ("number", DEVICE, 0, "0102010300")]
        asked += [(f"touch of {part}", TOUCH, k, "*") for k, part in enumerate(self.parts, 1)]
        for part, whose in ((0, "all joints"), (n := len(self.joint_names), f"joint {n}")):
            asked += [(f"{name} of {whose}", message, part, "*") for message, (name, _) in VALUES.items()]
        return command_table(f"""
            position of joint 8   08130181##1E803{ZEROS[4:]}  08130101##1 D007
            threshold of joint 1  01030181##12003{ZEROS[4:]}  01030101##1 2003
        """ + "".join(
            f"            ? {name}  {part:02X}{message:02X}0101##1{ZEROS}  {part:02X}{message:02X}0101##1 {reply}\n"
            for name, message, part, reply in asked
        ), origin=self.sources[0])  # fmt: skip


def shared_facts(looked: str) -> tuple[Fact, ...]:
    """Return the facts that hold for both hands."""
    return fact_table(f"""
        assumed touch: pads lie {PITCH_M * 1e3:.0f} mm apart and all face the same way, with the fingertips towards +y
        assumed identity: the device number is 1 as delivered; the serial number, the versions 1.0.0 and 1.1.0, and a
            supply of 24 V
        assumed configuration: a write is answered like a question: with the present value
        assumed configuration: the hand reports threshold 1000, mode 0, 25 deg C, no current and no error; torque and
            speed are stored without effect
        assumed configuration: motors stand at 2000 after power-up and move 2000 counts a second; positions are obeyed
            in every mode
        assumed configuration: reports of all joints come with the shortest period that any of them has; firmware
            upgrades are not answered
        assumed timing: touch is sampled 100 times a second
    """, looked=looked)  # fmt: skip
