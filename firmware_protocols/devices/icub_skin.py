"""iCub skin (iCub, iCub3, ergoCub; boards MTB and MTB4): capacitive triangles on CAN, values that fall when pressed.

Wire: classic CAN, 1 Mbit/s, standard ids ``class << 8 | source << 4 | x``. Several boards share the bus; a board
carries up to 16 triangles of 12 pads (10 taxels, thermal pads 6 and 10: ``icub_triangles.py``).

Host to board b (1..14), id 0x200 | b, never answered, bytes behind these ignored:

    4D type period noload                    type 0: temperature compensation, 1 palm or fingertip, 2 none; period
                                             in ms; clears all triangles
    50 first last shift enable cdcL cdcH     for triangles first..last; stops transmission and recalibrates:
                                             what is felt now becomes no load
    07 00, 07 01                             start, stop
    4C, 4E                                   obsolete set-up; 4C starts at once, every 40 ms, all triangles

Board to host, two frames of the same id per enabled triangle and period: ``HEAD`` and ``TAIL``.

Flags: 1 the chip does not acknowledge, 2 triangle not connected. A pad reads
``noload - ((raw - offset - drift) >> shift)``, clamped to 0..255; ``drift`` is what the thermal pads say (type 0 only).

Each board samples at its own period, also while it is silent: what it feels when 50 comes is its new no load.

Evidence: firmware of the boards and the robot's own driver (YARP ``canBusSkin``).

Try it: ``tactemu run icub_skin --port can:socketcan:vcan0``, then for each board, here 1 (50 Hz, triangles 0 to 2):
``for m in 4D0014F0 50000202010022 0700; do cansend vcan0 201#$m; done; candump vcan0``
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Command, Counts, Device, Option, Outs, Reading, Stream
from firmware_protocols.adc import quantize
from firmware_protocols.devices.icub_triangles import PADS, TAXELS, THERMAL, Place, flat, forearm_places, wrapped
from firmware_protocols.tables import Frame

HEAD = Frame("""
    head, id 100 bbbb tttt (b board, t triangle)
    0    40        head
    1    u1 x 7    pads            0 to 6
""")
TAIL = Frame("""
    tail, id 100 bbbb tttt (b board, t triangle)
    0    C0        tail
    1    u1 x 5    pads            7 to 11
    6    u1        out_of_range    pads 11 to 4, a bit each
    7    u1        ending          out of range, pads 3 to 0; four bits of flags
""")
TRIANGLES = 16
NO_ACK, NOT_CONNECTED = 1, 2
COMPENSATED = 0
MS = 1_000_000

REST, RAW_MAX = 0x6000, 0xFFFF
RAW_PER_NEWTON, RAW_PER_DEG = 600.0, 20.0
NO_LOAD, SHIFT = 240, 2


@dataclass(eq=False)
class Board:
    """One microcontroller with its triangles, as it powers up: silent, all enabled, calibrated at rest and 25 deg C."""

    address: int
    taxels: np.ndarray
    """In the layout, in the order of the pads, triangle by triangle."""
    normals: np.ndarray
    """Of these taxels."""
    flags: list[int]
    """Of each triangle."""
    kind: int = COMPENSATED
    no_load: int = NO_LOAD
    period_ns: int = 50 * MS
    transmitting: bool = False
    raw: np.ndarray = field(init=False)
    """What the converter reads of every pad, shape ``(n_triangles, 12)``."""
    pads: np.ndarray = field(init=False)
    """What is sent of it, uint8, since the first conversion."""

    def __post_init__(self):
        n = len(self.flags)
        self.raw = np.full((n, PADS), REST)
        self.offset = self.raw.copy()
        self.shift = np.full((n, 1), SHIFT)
        self.enabled = np.ones(n, bool)
        self.flagged = np.array(self.flags)[:, None] != 0
        self.pad_of = (PADS * np.arange(n)[:, None] + np.array(TAXELS)).ravel()
        self.taxel_of = np.full((n, PADS), n * len(TAXELS))
        self.taxel_of.ravel()[self.pad_of] = np.arange(n * len(TAXELS))

    def convert(self, push: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        """What every pad reads, uint8, shape ``(n_triangles, 12)``; of pushes [N] and temperatures [deg C] by taxel."""
        warmth = np.add.reduce(temperature.reshape(-1, len(TAXELS)), 1, keepdims=True) / len(TAXELS) - 25.0
        pushed = np.append(RAW_PER_NEWTON * np.maximum(push, 0.0), 0.0)  # what a thermal pad feels
        self.raw = quantize(REST + RAW_PER_DEG * warmth + pushed[self.taxel_of], high=RAW_MAX)
        change = self.raw - self.offset
        if self.kind == COMPENSATED:
            first, second = THERMAL
            change -= (change[:, first] + change[:, second])[:, None] // 2
        values = np.minimum(np.maximum(self.no_load - (change >> self.shift), 0), 255)
        self.pads = np.where(self.flagged, self.no_load, values).astype(np.uint8)
        return self.pads

    def frames(self) -> list[CanFrame]:
        """Head and tail of every enabled triangle."""
        frames = []
        out = (self.raw <= 0) | (self.raw >= RAW_MAX)
        at_the_end = (out @ (1 << np.arange(PADS))).tolist() if out.any() else [0] * len(out)
        for triangle in np.flatnonzero(self.enabled).tolist():
            ident, pads, mask = 0x400 | self.address << 4 | triangle, self.pads[triangle], at_the_end[triangle]
            ending = (mask & 0xF) << 4 | self.flags[triangle]
            tail = TAIL.pack(pads=pads[7:], out_of_range=mask >> 4, ending=ending)
            frames += [CanFrame(arbitration_id=ident, data=data) for data in (HEAD.pack(pads=pads[:7]), tail)]
        return frames

    def obey(self, data: bytes) -> bool:
        """Obey one message; ``False``: it is none that the board knows."""
        match tuple(data):
            case [0x07, (0 | 1) as stop, *_]:
                self.transmitting = not stop
            case [0x4D, kind, period, no_load, *_]:
                self.kind, self.period_ns, self.no_load = kind, max(period, 1) * MS, no_load
                self.enabled[:] = False
            case [0x50, first, last, shift, enable, _, _, *_] if first <= last < TRIANGLES:
                self.transmitting, which = False, slice(first, last + 1)
                self.enabled[which], self.shift[which] = bool(enable & 1), min(shift, 15)
                self.offset[which] = self.raw[which]
            case [0x4C, *_]:
                self.period_ns, self.transmitting = 40 * MS, True
                self.enabled[:] = True
            case [0x4E, *_]:
                pass
            case _:
                return False
        return True


class IcubSkin(Device[CanFrame]):
    """Triangles of the iCub skin on one CAN bus: flat with normal +z, or around a cylinder about the link's z axis."""

    name = "icub_skin"
    kind = "skin"
    senses = ("force", "temperature")
    columns = (Column(name="pad", low=0, high=255, rest=NO_LOAD, push=-1),)
    evidence = ("firmware", "driver")
    sources = (
        "icub-firmware@b429921 embot_prot_can_skin_periodic.cpp, embot_app_application_theSkin.cpp",
        "icub-firmware-shared@62f2818 can/canProtocolLib/iCubCanProto_{classes,analogSensorMessages}.h",
        "icub-main@24c1a00 canBusSkin/CanBusSkin.cpp l.615-640, skinLib/SkinDiagnostics.h",
        "icub-main app/skinGui conf (triangle_10pad)",
    )
    judge = "candump, canbusload (can-utils); own second reader"
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
        part: Annotated[Literal["forearm", "triangle"], Option("24 triangles, or one")] = "forearm",
        triangles_per_board: Annotated[int, Option("in order", low=1, high=TRIANGLES)] = 3,
        first_board: Annotated[int, Option("address of the first board; the others follow", low=1, high=14)] = 1,
        no_ack: Annotated[tuple[str, ...], Option("triangles whose chip does not answer, as board.triangle")] = (),
        not_connected: Annotated[tuple[str, ...], Option("triangles that are unplugged")] = (),
    ):
        places = forearm_places() if part == "forearm" else [Place(0.0, 0.0, False)]
        slots = [(first_board + k // triangles_per_board, k % triangles_per_board) for k in range(len(places))]
        names = [f"{board}.{triangle}" for board, triangle in slots]
        if (last := slots[-1][0]) > 14:
            raise ValueError(f"boards have addresses 1..14, got {first_board}..{last}: put more triangles on each")
        if unknown := [name for name in (*no_ack, *not_connected) if name not in names]:
            raise ValueError(f"no triangle {unknown[0]!r}; there are {names[0]} to {names[-1]} (board.triangle)")
        self.title = "iCub skin, forearm of 24 triangles" if part == "forearm" else "iCub skin, one triangle"
        self.layout = wrapped(places, names) if part == "forearm" else flat(places, names)
        flags = [NO_ACK * (name in no_ack) | NOT_CONNECTED * (name in not_connected) for name in names]
        self.boards: dict[str, Board] = {}
        for start in range(0, len(places), triangles_per_board):
            address, own = slots[start][0], flags[start : start + triangles_per_board]
            taxels = self.layout.wire_order[start * len(TAXELS) :][: len(own) * len(TAXELS)]
            self.boards[f"board {address}"] = Board(address, taxels, self.layout.normals[taxels], own)
        self.ports = (Can(hears=tuple((0x200 | board.address, 0x7FF) for board in self.boards.values())),)
        self.streams = {name: Stream(1e9 / board.period_ns) for name, board in self.boards.items()}
        self.counts = np.full(len(self.layout), NO_LOAD, np.uint8)

    def feel(self, reading: Reading, t_ns: int) -> Counts:
        """What each taxel reads, uint8, shape ``(n_taxels,)``: no load minus what presses; other boards as before."""
        board = self.boards[reading.stream]
        push = -np.add.reduce(reading["force"][board.taxels] * board.normals, -1)
        pads = board.convert(push, reading["temperature"][board.taxels])
        self.counts = self.counts.copy()
        self.counts[board.taxels] = pads.ravel()[board.pad_of]
        return self.counts

    def stream(self, t_ns: int, name: str) -> Outs[CanFrame]:
        """Two frames per enabled triangle of a board that transmits."""
        return self.boards[name].frames() if self.boards[name].transmitting else ()

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Outs[CanFrame]:
        """Set-up, start and stop of one board; nothing is ever answered."""
        name = f"board {data.arbitration_id & 0xF}"
        board = self.boards.get(name)
        if board is None or data != CanFrame(arbitration_id=0x200 | board.address, data=data.data):
            self.counters["ignored"] += 1
        elif board.obey(data.data):
            self.counters["requests"] += 1
            self.periods[name] = board.period_ns
        else:
            self.counters["unknown_command"] += 1
        return ()

    @property
    def commands(self) -> tuple[Command, ...]:
        """The set-up in the order of the robot's driver, for the first board; the others take the same. All silent."""
        to = f"{0x200 | next(iter(self.boards.values())).address:03X}#"
        return tuple(
            Command(name=name, request=to + data, about=about, origin=origin) for name, data, about, origin in _SET_UP
        )


_DRIVER, _MESSAGES = "icub-main@24c1a00 CanBusSkin.cpp", "icub-firmware-shared@62f2818 iCubCanProto_classes.h"
_SET_UP = (
    ("board set-up", "4D 00 32 F0", "compensated, 50 ms, no load 240; clears triangles", _DRIVER),
    ("triangle set-up", "50 00 0F 02 01 00 22", "all triangles; recalibrates, stops", _DRIVER),
    ("start", "07 00", "two frames per triangle and period from now on", _DRIVER),
    ("stop", "07 01", "", _DRIVER),
    ("old board set-up", "4C 00 00 00", "obsolete; starts at once", _MESSAGES),
    ("old triangle set-up", "4E 00 00 00", "obsolete", _MESSAGES),
)
