"""LinkerHand L6, L10 (fingertips of 12 x 6 taxels) and O6 (10 x 4): CAN, polled, a matrix row per frame.

Wire: classic CAN, 1 Mbit/s, one standard id per hand in both directions: 0x28 left, 0x27 right. Byte 0 is the command;
an answer repeats id and command. ``f`` = 0 thumb .. 4 little finger.

    request          answer                                             about
    B1+f C6          12 x [B1+f, row << 4, 6 x u8]                      12 x 6 matrix, raw 0..255, row 0 first
    B1+f A4          10 x [B1+f, row << 4, 4 x u8]                      10 x 4 matrix (O6)
    B1               [B1, rows, columns]                                touch probe: two data bytes = matrix sensor
    B0               silence                                            sent before the probe
    20 21 22 23      [cmd, 5 x u8]                                      normal, tangential, direction, approach (older)
    C0               4 x [C0, i, 6 ASCII]                               serial number, NUL padded
    C1 01 (O6: C1)   [C1, 01, major, minor, patch] (O6: without 01)     PCB version
    C2, C4           [cmd, major, minor, patch]                         firmware, mechanical version
    64               [64, dof, mech, serial, 'L'|'R', sw, hw, rev]      older identity; versions in nibbles
    01 02 05         [cmd, 6 x u8]                                      joint angles, torques, speeds
    33 35 36         [cmd, 6 x u8]                                      temperatures, faults, currents
    01 02 05 6 x u8  silence                                            set; read back by the request without data

The fifth field of the serial number is the kind of touch sensor: A four quantities, B 12 x 6, F and J 10 x 4, Z none.
Evidence: both published drivers decode these frames; no firmware source or manual was seen.

Try it: ``tactemu run linker_hand_l6 --port can:udp_multicast:239.74.163.2``, then
``linkerbot.L6("left", "239.74.163.2", "udp_multicast").force_sensor.get_blocking()``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

import numpy as np

from firmware_protocols.adc import quantize
from firmware_protocols.device import CanFrame, CanWire, Command, Device, Layout, Outgoing, Reading, grid_layout
from firmware_protocols.layouts import stack

FINGERS = ("thumb", "index", "middle", "ring", "little")
FINGER_SPACING = 0.025
PITCH = 0.0015
COUNTS_PER_NEWTON = 500.0

SERIAL, PCB, FIRMWARE, MECHANICAL, OLD_IDENTITY = 0xC0, 0xC1, 0xC2, 0xC4, 0x64
OLD_PREPARE, FIRST_FINGER = 0xB0, 0xB1
NORMAL, TANGENTIAL, DIRECTION, APPROACH = 0x20, 0x21, 0x22, 0x23
ANGLE, TORQUE, SPEED, TEMPERATURE, FAULT, CURRENT = 0x01, 0x02, 0x05, 0x33, 0x35, 0x36

Version = tuple[int, int, int]


class LinkerHand(Device):
    """Five fingertips that answer one request each with their matrix.

    Args:
        side: which hand; sets the id.
        touch: ``matrix``, or the older ``quantities`` (four numbers per finger, commands 20..23).
    """

    wires = (CanWire(bitrate=1_000_000),)
    senses = "force"
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (
        "linkerbot 0.5.4 hand/{l6,o6}/force_sensor.py, version.py, comm/can/can.py",
        "linker-bot/linkerhand-python-sdk@b371361 LinkerHand/core/can/linker_hand_{l10,o6}_can.py",
    )
    judge = "linkerbot 0.5.4"
    assumed = (
        f"{COUNTS_PER_NEWTON:.0f} counts/N of normal force per taxel (raw units, no scale published)",
        f"pitch {PITCH * 1e3} mm, fingertips side by side every {FINGER_SPACING * 1e3:.0f} mm, row 0 at the tip",
        "B1 without data answers rows and columns; another size's selector, and 20..23 on a matrix hand, are ignored",
        "older quantities: sums over the fingertip in the matrix's scale, direction 256 steps a turn, approach 0",
        "joints answer what was last set; 100 Hz conversion",
    )
    rows: ClassVar[int] = 12
    columns: ClassVar[int] = 6
    selector: ClassVar[int] = 0xC6
    touch_letter: ClassVar[str] = "B"
    model: ClassVar[str]
    pcb_echo: ClassVar[bytes] = b"\x01"
    """What follows C1 in the request, and comes back in the answer."""
    firmware_version: ClassVar[Version] = (1, 2, 3)
    mechanical_version: ClassVar[Version] = (2, 0, 1)
    pcb_version: ClassVar[Version] = (1, 0, 4)
    degrees_of_freedom: ClassVar[int] = 6

    def __init__(self, *, side: Literal["left", "right"] = "left", touch: Literal["matrix", "quantities"] = "matrix"):
        super().__init__()
        if side not in ("left", "right"):
            raise ValueError(f"{self.name}: side: expected 'left' or 'right', got {side!r}")
        if touch not in ("matrix", "quantities"):
            raise ValueError(f"{self.name}: touch: expected 'matrix' or 'quantities', got {touch!r}")
        self.side, self.touch = side, touch
        self.arbitration_id = 0x28 if side == "left" else 0x27
        self.layout = _fingertips(self.rows, self.columns)
        letter = "A" if touch == "quantities" else self.touch_letter
        self.serial_number = f"LH{self.model}-03-001-{side[0].upper()}-{letter}-1-A"
        self._answers = self._answer_table()
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Joints half open, skin unloaded."""
        self.joints = {ANGLE: bytes([128] * 6), TORQUE: bytes([255] * 6), SPEED: bytes([255] * 6)}
        self.joints |= {TEMPERATURE: bytes([30] * 6), FAULT: bytes(6), CURRENT: bytes(6)}
        self.counts = np.zeros(len(self.layout), np.uint8)
        self._quantities = np.zeros((4, 5), np.uint8)
        return ()

    def digitize(self, reading: Reading) -> np.ndarray:
        """Raw counts 0..255 of the normal force of each taxel, uint8, shape ``(n_taxels,)``."""
        force = self.layout.to_taxel_frame(np.asarray(reading.values))
        self._quantities = self._four_quantities(force.reshape(5, -1, 3).sum(axis=1))
        return quantize(self.layout.push(reading.values), COUNTS_PER_NEWTON, 0, 255).astype(np.uint8)

    def _four_quantities(self, force: np.ndarray) -> np.ndarray:
        """Normal, tangential, direction, approach under ``force`` [N] of shape ``(5, 3)``; uint8 ``(4, 5)``."""
        turn = np.arctan2(force[:, 1], force[:, 0]) / (2 * np.pi) % 1.0
        normal = quantize(-force[:, 2], COUNTS_PER_NEWTON, 0, 255)
        tangential = quantize(np.hypot(force[:, 0], force[:, 1]), COUNTS_PER_NEWTON, 0, 255)
        direction = np.rint(turn * 256).astype(int) % 256
        return np.stack([normal, tangential, direction, np.zeros(5, int)]).astype(np.uint8)

    def receive(self, data: CanFrame, t_ns: int) -> Sequence[Outgoing]:
        """Answer one request frame; frames for others, and what is not documented, get silence."""
        if not self._is_mine(data):
            self.counters["ignored"] += 1
            return ()
        command, payload = data.data[0], data.data[1:]
        if command in (ANGLE, TORQUE, SPEED) and len(payload) == 6:
            self.joints[command] = payload
            self.counters["requests"] += 1
            return ()
        answer = self._answers.get(data.data)
        self.counters["unknown_command" if answer is None else "requests"] += 1
        return answer() if answer else ()

    def _is_mine(self, frame: CanFrame) -> bool:
        return (
            frame.arbitration_id == self.arbitration_id
            and not (frame.is_extended_id or frame.is_remote_frame or frame.is_fd)
            and len(frame.data) > 0
        )

    # -- answers ---------------------------------------------------------------------------------------------------

    def _answer_table(self) -> dict[bytes, Callable[[], Sequence[CanFrame]]]:
        """Request payload to answer. Requests are matched whole: a wrong selector or length is no request."""
        table: dict[bytes, Callable[[], Sequence[CanFrame]]] = {
            bytes([SERIAL]): self._serial_frames,
            bytes([PCB]) + self.pcb_echo: lambda: [self._frame(PCB, *self.pcb_echo, *self.pcb_version)],
            bytes([FIRMWARE]): lambda: [self._frame(FIRMWARE, *self.firmware_version)],
            bytes([MECHANICAL]): lambda: [self._frame(MECHANICAL, *self.mechanical_version)],
            bytes([OLD_IDENTITY]): self._old_identity,
            bytes([OLD_PREPARE]): list,
        }
        for command in (ANGLE, TORQUE, SPEED, TEMPERATURE, FAULT, CURRENT):
            table[bytes([command])] = lambda c=command: [self._frame(c, *self.joints[c])]
        if self.touch == "quantities":
            for command in (NORMAL, TANGENTIAL, DIRECTION, APPROACH):
                table[bytes([command])] = lambda c=command: [self._frame(c, *self._quantities[c - NORMAL])]
            return table
        table[bytes([FIRST_FINGER])] = lambda: [self._frame(FIRST_FINGER, self.rows, self.columns)]
        for finger in range(len(FINGERS)):
            table[bytes([FIRST_FINGER + finger, self.selector])] = lambda f=finger: self._matrix_frames(f)
        return table

    def _frame(self, *data: int) -> CanFrame:
        return CanFrame(arbitration_id=self.arbitration_id, data=bytes(map(int, data)))

    def _matrix_frames(self, finger: int) -> Sequence[CanFrame]:
        """One frame per row of one sample: rows are never of different age."""
        matrix = self.counts[self.layout.patches[finger].taxels].reshape(self.rows, self.columns)
        return [self._frame(FIRST_FINGER + finger, row << 4, *matrix[row]) for row in range(self.rows)]

    def _serial_frames(self) -> Sequence[CanFrame]:
        text = self.serial_number.encode("ascii").ljust(24, b"\0")
        return [self._frame(SERIAL, i, *text[6 * i : 6 * i + 6]) for i in range(4)]

    def _old_identity(self) -> Sequence[CanFrame]:
        software = self.firmware_version[0] << 4 | self.firmware_version[1]
        hardware = self.pcb_version[0] << 4 | self.pcb_version[1]
        side = ord(self.side[0].upper())
        mechanical, revision = self.mechanical_version[0], ord("A")
        return [self._frame(OLD_IDENTITY, self.degrees_of_freedom, mechanical, 1, side, software, hardware, revision)]

    # -- datasheet -------------------------------------------------------------------------------------------------

    @property
    def commands(self) -> tuple[Command, ...]:
        """Identity, matrices or quantities, joints."""
        listed = [
            Command(name=_NAMES[request[0]], request=self._frame(*request), reply=answer() or None)
            for request, answer in self._answers.items()
            if not FIRST_FINGER <= request[0] < FIRST_FINGER + 5 and request[0] not in _QUANTITIES
        ]
        listed += [
            Command(name=f"set {_NAMES[c]}", request=self._frame(c, 1, 2, 3, 4, 5, 6), reply=None)
            for c in (ANGLE, TORQUE, SPEED)
        ]
        if self.touch == "quantities":
            return (*listed, *(Command(name=_NAMES[c], request=self._frame(c), reply=_length(6)) for c in _QUANTITIES))
        probe = Command(
            name="touch probe",
            request=self._frame(FIRST_FINGER),
            reply=[self._frame(FIRST_FINGER, self.rows, self.columns)],
            after=[self._frame(OLD_PREPARE)],
        )
        matrices = [
            Command(
                name=f"matrix {finger}", request=self._frame(FIRST_FINGER + i, self.selector), reply=self._is_matrix(i)
            )
            for i, finger in enumerate(FINGERS)
        ]
        return (*listed, probe, *matrices)

    def _is_matrix(self, finger: int) -> Callable[[list], bool]:
        def check(frames: list) -> bool:
            heads = [bytes([FIRST_FINGER + finger, row << 4]) for row in range(self.rows)]
            return [f.data[:2] for f in frames] == heads and all(len(f.data) == 2 + self.columns for f in frames)

        return check


_QUANTITIES = (NORMAL, TANGENTIAL, DIRECTION, APPROACH)
_NAMES = {
    SERIAL: "serial number", PCB: "PCB version", FIRMWARE: "firmware version", MECHANICAL: "mechanical version",
    OLD_IDENTITY: "identity (older)", OLD_PREPARE: "touch probe, first part", ANGLE: "joint angles",
    TORQUE: "torque limits", SPEED: "speeds", TEMPERATURE: "temperatures", FAULT: "faults", CURRENT: "currents",
    NORMAL: "normal forces", TANGENTIAL: "tangential forces", DIRECTION: "directions", APPROACH: "approach",
}  # fmt: skip


def _length(n: int) -> Callable[[list], bool]:
    return lambda frames: len(frames) == 1 and len(frames[0].data) == n


def _fingertips(rows: int, columns: int) -> Layout:
    """Five flat pads side by side along x, thumb at the smallest x, tips to +y."""
    places = [((i - 2) * FINGER_SPACING, 0.0, 0.0) for i in range(len(FINGERS))]
    return stack(*(grid_layout(rows, columns, PITCH, name=f, origin=p) for f, p in zip(FINGERS, places)))


class LinkerHandL6(LinkerHand):
    """L6: 12 x 6 fingertips, six joints."""

    name = "linker_hand_l6"
    title = "LinkerHand L6, 5 fingertips 12x6"
    model = "L6"


class LinkerHandL10(LinkerHand):
    """L10: 12 x 6 fingertips, ten joints (the first six answer)."""

    name = "linker_hand_l10"
    title = "LinkerHand L10, 5 fingertips 12x6"
    model = "L10"
    degrees_of_freedom = 10
    judge = "none (decoded like the L6)"
    assumed = (*LinkerHand.assumed, "PCB version asked as on the L6; joints 7 to 10 do not answer")


class LinkerHandO6(LinkerHand):
    """O6: 10 x 4 fingertips; asks for the PCB version in its own way."""

    name = "linker_hand_o6"
    title = "LinkerHand O6, 5 fingertips 10x4"
    model = "O6"
    rows, columns, selector, touch_letter = 10, 4, 0xA4, "F"
    pcb_echo = b""
