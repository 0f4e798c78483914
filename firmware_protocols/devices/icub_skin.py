"""iCub skin (iCub, iCub3, ergoCub; boards MTB and MTB4): capacitive triangles on CAN, values that fall when pressed.

Wire: classic CAN, 1 Mbit/s, standard ids ``class << 8 | source << 4 | x``. Several boards share the bus; a board
carries up to 16 triangles of 12 pads (10 taxels, thermal pads 6 and 10: ``icub_triangles.py``). On the board of a hand
triangles 0 to 4 are the fingertips, whose 12 pads all feel, and 8 to 11 the palm.

Host to board b (1..14), id 0x200 | b, never answered, bytes behind these ignored:

    4D type period noload                    type 0: temperature compensation, 1 palm or fingertip, 2 none; period
                                             in ms; clears all triangles
    50 first last shift enable cdcL cdcH     for triangles first..last; stops transmission and recalibrates:
                                             what is felt now becomes no load
    07 00, 07 01                             start, stop
    4C, 4E                                   obsolete set-up; 4C starts at once, every 40 ms, all triangles

Board to host, two frames of the same id per enabled triangle and period: ``HEAD`` and ``TAIL``. Old firmware (option
``firmware``) knows the obsolete set-up alone, and sends under class 3 in place of 4.

Flags: 1 the chip does not acknowledge, 2 triangle not connected. A pad reads
``noload - ((raw - offset - drift) >> shift)``, clamped to 0..255; ``drift`` is what the thermal pads say (type 0 only).

Each board samples at its own period, also while it is silent: what it feels when 50 comes is its new no load.

Evidence: firmware of the boards and the robot's own driver (YARP ``canBusSkin``).

Try it: ``tactemu run icub_skin --port can:socketcan:vcan0``, then for each board, here 1 (50 Hz, triangles 0 to 2):
``for m in 4D0014F0 50000202010022 0700; do cansend vcan0 201#$m; done; candump vcan0``
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np

from firmware_protocols import Can, CanFrame, Column, Command, Counts, Device, Layout, Option, Outs, Reading, Stream
from firmware_protocols.adc import quantize
from firmware_protocols.can_frames import CanFrames
from firmware_protocols.devices.icub_triangles import (
    PADS,
    PALM,
    SHEETS,
    TAXELS,
    THERMAL,
    Place,
    fingertip,
    flat,
    places_of,
    wrapped,
)
from firmware_protocols.layouts import place, stack
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
COMPENSATED, OF_A_HAND = 0, 1
NEW, OLD = 4, 3
"""Classes of identifiers."""
FINGERS = ("index", "middle", "ring", "little", "thumb")
HAND = (0, 1, 2, 3, 4, 8, 9, 10, 11)
"""Numbers of a hand's fingertips and palm triangles."""
MS = 1_000_000

PATTERN = np.array(
    [
        (10, 11, 11, 12, 9, 2, 12, -14, 11, 12, -7, 9),
        (14, 8, 3, 14, 12, -2, 6, -25, 7, 4, -16, 5),
        (8, 11, 14, 14, 14, 13, 14, 12, 13, 14, 13, 11),
        (13, 14, 22, 23, 22, 22, 24, 22, 19, 22, 22, 15),
        (8, -13, -37, 3, 2, -28, -5, -27, 3, 3, -27, -6),
    ]
)
"""How far below its calibration each pad of a hand's fingertips was at rest, in raw counts, finger by finger."""

_MASK = 1 << np.arange(PADS)
REST, RAW_MAX = 0x6000, 0xFFFF
RAW_PER_NEWTON, RAW_PER_DEG = 600.0, 20.0
NO_LOAD, SHIFT = 240, 2


class Blank(NamedTuple):
    """The frames of some triangles before anything is felt."""

    frames: CanFrames
    data: np.ndarray
    """Of head and tail, shape ``(n, 2, 8)``."""
    head_pads: slice
    tail_pads: slice
    out_of_range: slice
    ending: slice


@lru_cache(256)
def _blank(_tables: tuple[str, str], ident: int, enabled: bytes, numbers: bytes) -> Blank:
    """Of the triangles that are enabled, by the tables of head and tail."""
    which = np.frombuffer(numbers, int)[np.frombuffer(enabled, bool)]
    head, tail = HEAD.pack(pads=[0] * 7), TAIL.pack(pads=[0] * 5, out_of_range=0, ending=0)
    data = np.frombuffer((head + tail) * len(which), np.uint8).reshape(-1, 2, 8)
    frames = CanFrames.of(np.repeat(ident | which, 2), data.reshape(-1, 8))
    return Blank(frames, data, HEAD.place("pads"), *map(TAIL.place, ("pads", "out_of_range", "ending")))


@dataclass(eq=False)
class Board:
    """One microcontroller with its triangles, as it powers up: silent, all enabled, calibrated at rest and 25 deg C."""

    address: int
    taxels: np.ndarray
    """In the layout, in the order of the pads, triangle by triangle."""
    normals: np.ndarray
    """Of these taxels."""
    numbers: np.ndarray
    """Of its triangles."""
    feeling: list[tuple[int, ...]]
    """Pads of each triangle that are taxels."""
    flags: np.ndarray
    """Of each triangle."""
    pattern: np.ndarray
    """How far below its calibration each pad rests."""
    family: int = NEW
    """Class of its identifiers."""
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
        self.shift = np.full((n, 1), SHIFT)
        self.enabled = np.ones(n, bool)
        self.flagged = self.flags[:, None] != 0
        self.pad_of = np.concatenate([PADS * k + np.array(pads) for k, pads in enumerate(self.feeling)])
        self.taxel_of = np.full((n, PADS), len(self.pad_of))
        self.taxel_of.ravel()[self.pad_of] = np.arange(len(self.pad_of))
        self.pattern = np.where(self.taxel_of < len(self.pad_of), self.pattern, 0)
        self.offset = self.raw + self.pattern
        sizes = np.array([len(pads) for pads in self.feeling])
        self.sizes, self.starts = sizes[:, None], np.cumsum(sizes) - sizes

    def convert(self, push: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        """What every pad reads, uint8, shape ``(n_triangles, 12)``; of pushes [N] and temperatures [deg C] by taxel."""
        warmth = np.add.reduceat(temperature, self.starts)[:, None] / self.sizes - 25.0
        pushed = np.append(RAW_PER_NEWTON * push, 0.0)  # what a thermal pad feels
        self.raw = quantize(REST + RAW_PER_DEG * warmth + pushed[self.taxel_of], high=RAW_MAX)
        change = self.raw - self.offset
        if self.kind == COMPENSATED:
            first, second = THERMAL
            change -= (change[:, first] + change[:, second])[:, None] // 2
        values = np.minimum(np.maximum(self.no_load - (change >> self.shift), 0), 255)
        self.pads = np.where(self.flagged, self.no_load, values).astype(np.uint8)
        return self.pads

    def frames(self) -> CanFrames:
        """Head and tail of every enabled triangle."""
        which, ident = self.enabled, self.family << 8 | self.address << 4
        blank = _blank((HEAD.text, TAIL.text), ident, which.tobytes(), self.numbers.tobytes())
        data, pads = blank.data.copy(), self.pads[which]
        data[:, 0, blank.head_pads] = pads[:, :7]
        data[:, 1, blank.tail_pads] = pads[:, 7:]
        data[:, 1, blank.ending] = self.flags[which, None]
        if self.raw.min() <= 0 or self.raw.max() >= RAW_MAX:
            out = (self.raw <= 0) | (self.raw >= RAW_MAX)
            mask = out[which, None] @ _MASK
            data[:, 1, blank.out_of_range] = mask >> 4
            data[:, 1, blank.ending] |= ((mask & 0xF) << 4).astype(np.uint8)
        return blank.frames.with_data(data.reshape(-1, 8))

    def obey(self, data: bytes) -> bool:
        """Obey one message; ``False``: it is none that the board knows."""
        match tuple(data):
            case [0x07, (0 | 1) as stop, *_]:
                self.transmitting = not stop
            case [0x4D, kind, period, no_load, *_] if self.family == NEW:
                self.kind, self.period_ns, self.no_load = kind, max(period, 1) * MS, no_load
                self.enabled[:] = False
            case [0x50, first, last, shift, enable, _, _, *_] if self.family == NEW and first <= last < TRIANGLES:
                self.transmitting = False
                which = (first <= self.numbers) & (self.numbers <= last)
                self.enabled[which], self.shift[which] = bool(enable & 1), min(shift, 15)
                self.offset[which] = self.raw[which] + self.pattern[which]
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
        "clear-nus/icub_grasp_dataset@87dceeca (recordings of a hand: `pattern`)",
    )
    judge = "candump, canbusload (can-utils); own second reader"
    assumed = (
        f"{RAW_PER_NEWTON:.0f} raw counts/N and {RAW_PER_DEG:.0f} per deg C; a pad is out of range at "
        "the ends of a 16-bit converter",
        "forearm: a cylinder of 40 mm radius, 3 strips of 8 triangles, 3 triangles a board (a robot's is a free form)",
        "upper arm: 45 mm radius, 5 strips of 7; torso: flat, 4 strips of 11; 16 triangles a board",
        "`pattern`: fingertips as recorded; the triangles of other parts like them, one finger after another",
        "hand: index, middle, ring, little, thumb, each 4 x 3 pads row by row at 4 mm around 7 mm; palm triangles in a "
        "row, ten taxels each (a hand V2.1 has 104 in all); numbers 0 to 4 and 8 to 11; type 1 after power-up",
        "old firmware: the frames of the new one, 40 ms",
        "pad coordinates of the triangle as its drawing tool places them; edge 30 mm",
        "types other than 0 do not compensate; the cdc offset shifts nothing that calibration does not take away",
        "slots without a triangle are not sent; a triangle with a flag is sent at no load; 4E does nothing",
    )

    def __init__(
        self,
        *,
        part: Annotated[
            Literal["forearm", "upper_arm", "torso", "hand", "triangle"],
            Option("24, 35 or 44 triangles; five fingertips and a palm of four; or one triangle"),
        ] = "forearm",
        firmware: Annotated[Literal["new", "old"], Option("old: the set-up 4C and 4E, identifiers of class 3")] = "new",
        triangles_per_board: Annotated[
            int | None, Option("in order; default: 3 on a forearm, else 16", low=1, high=TRIANGLES)
        ] = None,
        triangles: Annotated[int | None, Option("fitted of the part, from the first; default: all", low=1)] = None,
        first_board: Annotated[int, Option("address of the first board; the others follow", low=1, high=14)] = 1,
        no_ack: Annotated[tuple[str, ...], Option("triangles whose chip does not answer, as board.triangle")] = (),
        not_connected: Annotated[tuple[str, ...], Option("triangles that are unplugged")] = (),
        pattern: Annotated[
            Literal["even", "measured"],
            Option("at rest: no load, or as the fingertips of a hand read it, finger by finger"),
        ] = "even",
    ):
        numbers = HAND if part == "hand" else range(TRIANGLES)
        whole = len(HAND) if part == "hand" else len(places_of(SHEETS[part])) if part in SHEETS else 1
        n = triangles or whole
        if n > whole or (n < whole and part not in SHEETS):
            raise ValueError(f"triangles: a {part} has {whole}, got {n}")
        per_board = triangles_per_board or (3 if part == "forearm" else TRIANGLES)
        slots = [(first_board + k // per_board, numbers[k % per_board]) for k in range(n)]
        names = [f"{board}.{triangle}" for board, triangle in slots]
        if (last := slots[-1][0]) > 14:
            raise ValueError(f"boards have addresses 1..14, got {first_board}..{last}: put more triangles on each")
        if unknown := [name for name in (*no_ack, *not_connected) if name not in names]:
            raise ValueError(f"no triangle {unknown[0]!r}; there are {names[0]} to {names[-1]} (board.triangle)")
        self.layout = _layout(part, names)
        self.title = f"iCub skin, {part.replace('_', ' ')} of {n} triangles"
        if part in ("hand", "triangle"):
            self.title = "iCub skin, five fingertips and palm" if part == "hand" else "iCub skin, one triangle"
        feeling = [tuple(range(PADS)) if part == "hand" and k < len(FINGERS) else TAXELS for k in range(n)]
        flags = [NO_ACK * (name in no_ack) | NOT_CONNECTED * (name in not_connected) for name in names]
        order = np.split(self.layout.wire_order, np.cumsum([len(pads) for pads in feeling])[:-1])
        self.boards: dict[str, Board] = {}
        for start in range(0, n, per_board):
            own, taxels = slice(start, start + per_board), np.concatenate(order[start : start + per_board])
            self.boards[f"board {slots[start][0]}"] = Board(
                slots[start][0],
                taxels,
                self.layout.normals[taxels],
                np.array([number for _, number in slots[own]]),
                feeling[own],
                np.array(flags[own]),
                PATTERN[np.arange(start, start + len(flags[own])) % len(PATTERN)]
                if pattern == "measured"
                else np.zeros(PADS, int),
                OLD if firmware == "old" else NEW,
                OF_A_HAND if part == "hand" else COMPENSATED,
            )
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
        board = next(iter(self.boards.values()))
        to, known = f"{0x200 | board.address:03X}#", _SET_UP if board.family == NEW else _SET_UP[2:]
        return tuple(
            Command(name=name, request=to + data, about=about, origin=origin) for name, data, about, origin in known
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


def _layout(part: str, names: list[str]) -> Layout:
    """Where the triangles of a part are; patches named ``names``."""
    if part == "hand":
        tips = [fingertip(name, finger, (2 - k) * 0.02) for k, (name, finger) in enumerate(zip(names, FINGERS))]
        return stack(*tips, place(flat(places_of(PALM), names[len(tips) :], "palm"), (0.0, -0.08, 0.0)))
    if part == "triangle":
        return flat([Place(0.0, 0.0, False)], names)
    sheet = SHEETS[part]
    places = places_of(sheet)[: len(names)]
    return wrapped(places, names, sheet.radius) if sheet.radius else flat(places, names)
