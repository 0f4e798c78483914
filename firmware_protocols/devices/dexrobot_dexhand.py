"""DexRobot DexHand021: six boards on CAN-FD, five with a fingertip that feels force and warmth.

Wire: CAN-FD, standard identifiers; b is 1..6 on a left hand, 7..12 on a right one, first the fingers, the thumb first.

    id         data                  direction   about
    180+b      ``FEEDBACK``          to host     of a fingertip's board; the sixth sends only its first 16 bytes
    100+b      (not published)       to board    motion; in mode 2 answered by feedback
    000+b      74 mode               to board    feedback from now on: 1 periodic, 2 when asked, 3 when it has changed
    000+b      A4                    to board    clear errors
    080+b      03, command, 00, 01   to host     answer to these two
    600+b      EE, type, bits        to host     an error; never sent

The published parser takes shorter frames for boards without touch, and warns of a force that is no number.

Evidence: the published driver; its parser has read frames that were built by hand.

Try it: ``tactemu run dexrobot_dexhand --port can:socketcan:vcan0``, then ``candump vcan0``.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Command, Counts, Device, Option, Outs, Reading
from firmware_protocols.adc import quantize
from firmware_protocols.layouts import points, stack
from firmware_protocols.tables import Frame

FEEDBACK = Frame("""
    feedback
    0     00 x 12    motors              i16 x 3 of each of two: current [mA], speed [rpm], position [counts]
    12    00 x 4     angles              i16 x 2 [0.01 deg]
    16    <f4        normal              [N]
    20    00 x 4     normal_delta        u32
    24    <f4        tangential          [N]
    28    00 x 4     tangential_delta    u32
    32    <u2        direction           of the tangential force [deg]
    34    00 x 4     proximity           u32
    38    <u4        temperature         [deg C]
    42    00 x 4     encoders            u16 x 2
    46    00 x 2     unused
""")
WITHOUT_TOUCH = 16
FINGERS = ("thumb", "index", "middle", "ring", "little")
BOARDS = 6
PERIODIC, WHEN_ASKED, ON_CHANGE = 1, 2, 3
SPACING, PITCH, FORCE_MAX = 0.025, 0.012, 50.0


class DexrobotDexHand(Device[CanFrame]):
    """Fingertips with one sensor of force each."""

    name = "dexrobot_dexhand"
    kind = "hand"
    title = "DexRobot DexHand021"
    senses = ("force", "temperature")
    columns = (
        Column(name="normal", unit="N", counts_per_unit=1.0, low=0, high=FORCE_MAX, push=1),
        Column(name="tangential", unit="N", counts_per_unit=1.0, low=0, high=FORCE_MAX),
        Column(name="direction", low=0, high=359),
        Column(name="temperature", sense="temperature", unit="degC", counts_per_unit=1.0, low=0, high=85, rest=25),
    )
    evidence = ("driver",)
    sources = ("DexRobot/pyzlg_dexhand@316575a dexhand_protocol/{__init__,messages,commands}.py",)
    judge = "cantools, with a DBC of its frames; own second reader"
    assumed = (
        "1 Mbit/s, 5 Mbit/s for data; boards 1..5 thumb to little finger; mode 1 at 100 Hz after power-up",
        "a set-up message begins with the command or with 03 and the command; the mode is the next byte",
        f"forces to {FORCE_MAX:.0f} N, temperature 0 to 85 deg C; direction 0 towards the tip, clockwise",
        "motors stand still at 0, what else is marked 00 is not modelled; any motion message is a question",
        f"one point per fingertip, {SPACING * 1e3:.0f} mm apart, normal +z, tips to +y",
    )

    def __init__(self, *, side: Annotated[Literal["left", "right"], Option("which hand; sets the ids")] = "left"):
        self.first = 1 if side == "left" else 7
        boards = range(self.first, self.first + BOARDS)
        self.ports = (
            Can(data_bitrate=5_000_000, hears=tuple((to | board, 0x7FF) for to in (0x000, 0x100) for board in boards)),
        )
        places = {finger: ((k - 2) * SPACING, 0.0, 0.0) for k, finger in enumerate(FINGERS)}
        self.layout = stack(*(points({f: at}, pitch=PITCH, link=f) for f, at in places.items()))
        self.modes = [PERIODIC] * BOARDS
        self.said = [b""] * BOARDS

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """By sense: normal and tangential force [N], float32, and direction [deg] of each tip; temperature [deg C]."""
        x, y, z = self.layout.to_taxel_frame(reading["force"]).T
        forces = np.clip(np.stack([-z, np.hypot(x, y)]), 0.0, FORCE_MAX).astype(np.float32)
        direction = np.rint(np.degrees(np.arctan2(x, y))) % 360
        self.counts = np.stack([*forces, direction], axis=1)
        self.warmth = quantize(reading["temperature"], 1.0, 0, 85)
        return {"force": self.counts, "temperature": self.warmth}

    def stream(self, t_ns: int, name: str) -> Outs[CanFrame]:
        """Feedback of the boards that send it unasked."""
        frames = []
        for board, mode in enumerate(self.modes):
            frame = self._feedback(board)
            if mode == PERIODIC or (mode == ON_CHANGE and frame.data != self.said[board]):
                frames.append(frame)
                self.said[board] = frame.data
        return frames

    def _feedback(self, board: int) -> CanFrame:
        """What one board says, counted from 0; the sixth has no fingertip."""
        ident = 0x180 | self.first + board
        if board >= len(FINGERS):
            return _fd(ident, bytes(WITHOUT_TOUCH))
        normal, tangential, direction = self.layout.on_wire(self.counts)[board].tolist()
        warmth = self.layout.on_wire(self.warmth)[board].item()
        data = FEEDBACK.pack(normal=normal, tangential=tangential, direction=int(direction), temperature=warmth)
        return _fd(ident, data)

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Outs[CanFrame]:
        """Set-up, and motion, which moves nothing."""
        to, board = data.arbitration_id & 0x780, (data.arbitration_id & 0x7F) - self.first
        if not data.is_fd or data.is_extended_id or to not in (0x000, 0x100) or not 0 <= board < BOARDS:
            self.counters["ignored"] += 1
            return ()
        if to == 0x100:
            self.counters["requests"] += 1
            return [self._feedback(board)] if self.modes[board] == WHEN_ASKED else ()
        message = data.data[1:] if data.data[:1] == b"\x03" else data.data
        if message[:1] == b"\x74" and message[1:2] in (b"\1", b"\2", b"\3"):
            self.modes[board], self.said[board] = message[1], b""
        elif message[:1] != b"\xa4":
            self.counters["unknown_command"] += 1
            return ()
        self.counters["requests"] += 1
        return [_fd(0x080 | self.first + board, bytes([0x03, message[0], 0x00, 0x01]))]

    @property
    def commands(self) -> tuple[Command, ...]:
        """Modes and errors of the first board; the others take the same."""
        to, reply = f"{self.first:03X}##1", f"{0x80 | self.first:03X}##1"
        asked = f"{0x100 | self.first:03X}##1 {'00' * 8}"
        origin = "pyzlg_dexhand@316575a commands.py"
        return (
            *(
                Command(name=f"feedback {name}", request=f"{to}74{mode:02X}", reply=f"{reply}03740001", origin=origin)
                for mode, name in ((PERIODIC, "all the time"), (WHEN_ASKED, "when asked"), (ON_CHANGE, "on change"))
            ),
            Command(name="clear errors", request=f"{to}A4", reply=f"{reply}03A40001", origin=origin),
            Command(
                name="motion",
                request=asked,
                after=(f"{to}7402",),
                reply=f"{0x180 | self.first:03X}##1 ..{{48}}",
                about="moves nothing; asks for feedback",
                origin=origin,
            ),
        )


def _fd(ident: int, data: bytes) -> CanFrame:
    return CanFrame(arbitration_id=ident, data=data, is_fd=True, bitrate_switch=True)
