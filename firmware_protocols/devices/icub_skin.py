"""iCub skin (iCub, iCub3, ergoCub; boards MTB and MTB4): capacitive triangles on CAN, values that fall when pressed.

Wire: classic CAN, 1 Mbit/s, standard ids ``class << 8 | source << 4 | x``. Several boards share the bus; a board
carries up to 16 triangles of 12 pads (10 taxels, thermal pads 6 and 10: ``icub_triangles.py``).

Host to board b (1..14), id 0x200 | b, never answered:

    4D type period noload                    type 0: temperature compensation, 1 palm or fingertip, 2 none; period
                                             in ms; clears all triangles
    50 first last shift enable cdcL cdcH     for triangles first..last; stops transmission and recalibrates:
                                             what is felt now becomes no load
    07 00, 07 01                             start, stop
    4C, 4E                                   obsolete set-up; 4C starts at once, every 40 ms, all triangles

Board to host, two frames per enabled triangle t and period, the same id 0x400 | b << 4 | t:

    byte   0    1..5            6                        7
    head   40   pads 0..4       pad 5                    pad 6
    tail   C0   pads 7..11      out of range, pads 11..4 out of range, pads 3..0 << 4 | flags

Flags: 1 the chip does not acknowledge, 2 triangle not connected. A pad reads
``noload - ((raw - offset - drift) >> shift)``, clamped to 0..255; ``drift`` is what the thermal pads say (type 0 only).

Evidence: firmware of the boards and the robot's own driver (YARP ``canBusSkin``).

Try it: ``tactemu run icub_skin --port can:socketcan:vcan0``, then for each board, here 1 (50 Hz, triangles 0 to 2):
``for m in 4D0014F0 50000202010022 0700; do cansend vcan0 201#$m; done; candump vcan0``
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Literal

import numpy as np

from firmware_protocols.device import CanFrame, CanWire, Command, Device, Outgoing, Reading
from firmware_protocols.devices.icub_triangles import (
    FOREARM_RADIUS,
    PADS,
    TAXELS,
    THERMAL,
    Place,
    flat,
    forearm_places,
    wrapped,
)

TRIANGLES = 16
HEAD, TAIL = 0x40, 0xC0
NO_ACK, NOT_CONNECTED = 1, 2
COMPENSATED = 0
MS = 1_000_000

REST, RAW_MAX = 0x6000, 0xFFFF
RAW_PER_NEWTON, RAW_PER_DEG = 600.0, 20.0
NO_LOAD, SHIFT = 240, 2


class Op(IntEnum):
    """First byte of a message to a board."""

    TRANSMIT = 0x07
    OLD_SET_BOARD = 0x4C
    SET_BOARD = 0x4D
    OLD_SET_TRIANGLES = 0x4E
    SET_TRIANGLES = 0x50


class Board:
    """One microcontroller with its 16 triangle slots: set-up, calibration, frames."""

    def __init__(self, address: int, triangles: int):
        self.address = address
        self.present = np.arange(TRIANGLES) < triangles
        self.flags = np.zeros(TRIANGLES, int)
        self.power_on()

    def power_on(self) -> None:
        """Silent, every triangle enabled, calibrated at rest and 25 deg C."""
        self.kind, self.no_load, self.period_ns = COMPENSATED, NO_LOAD, 50 * MS
        self.shift = np.full((TRIANGLES, 1), SHIFT)
        self.enabled = np.ones(TRIANGLES, bool)
        self.raw = np.full((TRIANGLES, PADS), REST)
        self.offset = self.raw.copy()
        self.transmitting = False
        self.due_ns = 0

    # -- values ----------------------------------------------------------------------------------------------------

    def values(self) -> np.ndarray:
        """What every pad reads, uint8, shape ``(16, 12)``."""
        change = self.raw - self.offset
        if self.kind == COMPENSATED:
            change = change - change[:, THERMAL].sum(axis=1, keepdims=True) // len(THERMAL)
        values = np.clip(self.no_load - (change >> self.shift), 0, 255)
        return np.where(self.flags[:, None] == 0, values, self.no_load).astype(np.uint8)

    def out_of_range(self) -> np.ndarray:
        """Bit ``k``: the converter of pad ``k`` is at its end; shape ``(16,)``."""
        return ((self.raw <= 0) | (self.raw >= RAW_MAX)) @ (1 << np.arange(PADS))

    def frames(self, t_ns: int) -> list[CanFrame]:
        """Head and tail of every enabled triangle that there is, if the board transmits and its period is over."""
        if not self.transmitting or t_ns < self.due_ns - self.period_ns // 4:
            return []
        self.due_ns = t_ns + self.period_ns
        values, masks = self.values(), self.out_of_range()
        return [
            frame
            for triangle in np.flatnonzero(self.enabled & self.present)
            for frame in self._pair(int(triangle), values[triangle].tobytes(), int(masks[triangle]))
        ]

    def _pair(self, triangle: int, pads: bytes, mask: int) -> tuple[CanFrame, CanFrame]:
        ident = 0x400 | self.address << 4 | triangle
        ending = bytes([mask >> 4, (mask & 0xF) << 4 | int(self.flags[triangle])])
        head = CanFrame(arbitration_id=ident, data=bytes([HEAD]) + pads[:7])
        return head, CanFrame(arbitration_id=ident, data=bytes([TAIL]) + pads[7:] + ending)

    # -- commands --------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, t_ns: int) -> bool:
        """Obey one message; ``False``: it is none that the board knows."""
        match tuple(data):
            case [Op.TRANSMIT, (0 | 1) as stop, *_]:
                self.transmitting, self.due_ns = not stop, t_ns
            case [Op.SET_BOARD, kind, period, no_load, *_]:
                self.kind, self.period_ns, self.no_load = kind, max(period, 1) * MS, no_load
                self.enabled[:] = False
            case [Op.SET_TRIANGLES, first, last, shift, enable, _, _, *_] if first <= last < TRIANGLES:
                self.transmitting = False
                self.enabled[first : last + 1] = bool(enable & 1)
                self.shift[first : last + 1] = min(shift, 15)
                self.offset[first : last + 1] = self.raw[first : last + 1]
            case [Op.OLD_SET_BOARD, *_]:
                self.period_ns, self.transmitting, self.due_ns = 40 * MS, True, t_ns
                self.enabled[:] = True
            case [Op.OLD_SET_TRIANGLES, *_]:
                pass
            case _:
                return False
        return True


class IcubSkin(Device):
    """Triangles of the iCub skin on one CAN bus.

    Args:
        part: ``forearm`` (24 triangles, 240 taxels around a cylinder about the link's z axis) or ``triangle`` (one,
            flat, normal +z).
        triangles_per_board: how the triangles share boards, in order: 1..16.
        first_board: address of the first board; the others follow.
        no_ack: triangles whose chip does not answer, as ``"board.triangle"``.
        not_connected: triangles that are unplugged.
    """

    name = "icub_skin"
    title = "iCub skin, forearm of 24 triangles"
    wires = (CanWire(bitrate=1_000_000),)
    senses = "force"
    rate_hz = 20.0
    evidence = ("firmware", "driver")
    sources = (
        "icub-firmware@b429921 embot_prot_can_skin_periodic.cpp, embot_app_application_theSkin.cpp",
        "icub-firmware-shared@62f2818 can/canProtocolLib/iCubCanProto_{classes,analogSensorMessages}.h",
        "icub-main@24c1a00 canBusSkin/CanBusSkin.cpp l.615-640, skinLib/SkinDiagnostics.h",
        "icub-main app/skinGui conf (triangle_10pad)",
    )
    judge = "candump, canbusload (can-utils)"
    assumed = (
        f"{RAW_PER_NEWTON:.0f} raw counts/N and {RAW_PER_DEG:.0f} per deg C, every pad alike; a pad is out of range at "
        "the ends of a 16-bit converter",
        "forearm: a cylinder of 40 mm radius, 3 strips of 8 triangles, 3 triangles a board (a robot's is a free form)",
        "pad coordinates of the triangle as its drawing tool places them; edge 30 mm",
        "types other than 0 do not compensate; the cdc offset shifts nothing that calibration does not take away",
        "slots without a triangle are not sent; a triangle with a flag is sent at no load; 4E does nothing",
    )

    def __init__(
        self,
        *,
        part: Literal["forearm", "triangle"] = "forearm",
        triangles_per_board: int = 3,
        first_board: int = 1,
        no_ack: Sequence[str] = (),
        not_connected: Sequence[str] = (),
    ):
        super().__init__()
        if part not in ("forearm", "triangle"):
            raise ValueError(f"icub_skin: part: expected 'forearm' or 'triangle', got {part!r}")
        if not 1 <= triangles_per_board <= TRIANGLES:
            raise ValueError(f"icub_skin: triangles_per_board: expected 1..{TRIANGLES}, got {triangles_per_board}")
        places = forearm_places() if part == "forearm" else [Place(0.0, 0.0, False)]
        self._slots = [(k // triangles_per_board, k % triangles_per_board) for k in range(len(places))]
        self.boards = self._make_boards(first_board)
        names = [f"{first_board + board}.{triangle}" for board, triangle in self._slots]
        self.layout = wrapped(places, names, FOREARM_RADIUS) if part == "forearm" else flat(places, names)
        for which, flag in ((no_ack, NO_ACK), (not_connected, NOT_CONNECTED)):
            for name in which:
                self._set_flag(name, names, flag)
        self.power_on(0)

    def _make_boards(self, first: int) -> list[Board]:
        last = first + self._slots[-1][0]
        if first < 1 or last > 14:
            raise ValueError(f"icub_skin: boards have addresses 1..14, got {first}..{last}: put more triangles on each")
        on_board = np.bincount([board for board, _ in self._slots])
        return [Board(first + k, int(count)) for k, count in enumerate(on_board)]

    def _set_flag(self, name: str, names: list[str], flag: int) -> None:
        if name not in names:
            raise ValueError(f"icub_skin: no triangle {name!r}; there are {names[0]} to {names[-1]} (board.triangle)")
        board, triangle = self._slots[names.index(name)]
        self.boards[board].flags[triangle] |= flag

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Boards are silent until started."""
        for board in self.boards:
            board.power_on()
        self.counts = np.full(len(self.layout), NO_LOAD, np.uint8)
        self._sync_period()
        return ()

    def _sync_period(self) -> None:
        """The skin is sampled for the fastest board; the others take every so many samples."""
        self.period_ns = min(board.period_ns for board in self.boards)

    def digitize(self, reading: Reading) -> np.ndarray:
        """What each taxel reads, uint8, shape ``(n_taxels,)``: no load minus what presses."""
        push = self.layout.push(reading.values).reshape(-1, len(TAXELS))
        warmth = np.broadcast_to(reading.temperature, len(self.layout)).reshape(-1, len(TAXELS)).mean(axis=1) - 25.0
        raw = np.repeat(REST + RAW_PER_DEG * warmth[:, None], PADS, axis=1)
        raw[:, TAXELS] += RAW_PER_NEWTON * np.maximum(push, 0.0)
        raw = np.clip(np.rint(raw), 0, RAW_MAX).astype(np.int64)
        for (board, triangle), pads in zip(self._slots, raw):
            self.boards[board].raw[triangle] = pads
        values = [board.values() for board in self.boards]
        return np.concatenate([values[board][triangle, TAXELS] for board, triangle in self._slots])

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """Two frames per enabled triangle of every board that transmits."""
        return [frame for board in self.boards for frame in board.frames(t_ns)]

    def receive(self, data: CanFrame, t_ns: int) -> Sequence[Outgoing]:
        """Set-up, start and stop of one board; nothing is ever answered."""
        for board in self.boards:
            if data == _to(board.address, data.data):
                known = board.receive(data.data, t_ns)
                self.counters["requests" if known else "unknown_command"] += 1
                self._sync_period()
                return ()
        self.counters["ignored"] += 1
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """The set-up in the order of the robot's driver, for the first board; the others take the same. All silent."""
        address = self.boards[0].address
        return tuple(
            Command(name=name, request=_to(address, data), reply=None, about=about) for name, data, about in _SET_UP
        )


_SET_UP = (
    (
        "board set-up",
        bytes([Op.SET_BOARD, COMPENSATED, 50, NO_LOAD]),
        "compensated, 50 ms, no load 240; clears triangles",
    ),
    ("triangle set-up", bytes([Op.SET_TRIANGLES, 0, 15, SHIFT, 1, 0x00, 0x22]), "all triangles; recalibrates, stops"),
    ("start", bytes([Op.TRANSMIT, 0]), "two frames per triangle and period from now on"),
    ("stop", bytes([Op.TRANSMIT, 1]), ""),
    ("old board set-up", bytes([Op.OLD_SET_BOARD, 0, 0, 0]), "obsolete; starts at once"),
    ("old triangle set-up", bytes([Op.OLD_SET_TRIANGLES, 0, 0, 0]), "obsolete"),
)


def _to(board: int, data: bytes) -> CanFrame:
    return CanFrame(arbitration_id=0x200 | board, data=data)
