"""iCub skin (iCub, iCub3, ergoCub; boards MTB and MTB4): capacitive triangles on CAN, values that fall when pressed.

Wire: classic CAN, 1 Mbit/s, standard ids ``class << 8 | source << 4 | x``. Several boards share the bus; a board
carries up to 16 triangles of 12 pads (10 taxels, thermal pads 6 and 10: ``icub_triangles.py``). On the board of a hand
triangles 0 to 4 are the fingertips, whose 12 pads all feel, and 8 to 11 the palm.

Host to board b (1..14), id 0x200 | b, never answered, bytes behind these ignored:

    4D type period noload                    type as in ``GAINS``, 7 test mode, all others without compensation; period
                                             in ms; clears all triangles
    50 first last shift enable cdcL cdcH     for triangles first..last; stops transmission and recalibrates the board:
                                             what is felt now becomes no load
    07 00, 07 01                             start, stop
    4C, 4E                                   obsolete set-up; 4C starts at once, every 40 ms, all triangles, as powered
                                             up, recalibrated
    1C major minor                           210#1C 0B 01 19 00 02 00 ok: MTB4, version 1.25.0, protocol 2.0, whether
                                             that is what was asked for
    FF, of class 7: 70F#FF                   710#FF 0B 01 19 00: who is there
    0C, of class 7: 701#0C                   710#0C 00 and four characters, to 07: additional information

F in place of b is all boards. Board to host, two frames of the same id per enabled triangle and period: ``HEAD`` and
``TAIL``; triangles 0 to 15 that are not fitted are sent as not connected. Old firmware (option ``firmware``) knows the
obsolete set-up alone, and sends under class 3 in place of 4.

A pad reads ``noload - ((raw - offset - drift) >> shift)``, clamped to 0..255, and is out of range from twice the change
on that reaches an end. ``drift`` is ``((thermal - its offset) >> 2) * gain >> 5``, of pad 6. In test mode a pad is the
low byte of its raw value. Flags: 1 the chip does not acknowledge, 2 triangle not connected. Every fifth triangle that
does not acknowledge recalibrates the board.

Each board samples at its own period, also while it is silent: what it feels when 50 comes is its new no load.

Evidence: firmware of the boards and the robot's own driver (YARP ``canBusSkin``).

Try it: ``tactemu run icub_skin --port can:socketcan:vcan0``, then for each board, here 1 (50 Hz, triangles 0 to 2):
``for m in 4D0014F0 50000202010022 0700; do cansend vcan0 201#$m; done; candump vcan0``
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np

from firmware_protocols import (
    Can,
    CanFrame,
    Column,
    Command,
    Counts,
    Device,
    Layout,
    Option,
    Reading,
    Stream,
    Transmissions,
    assumed,
    measured,
    stated,
)
from firmware_protocols.adc import quantize
from firmware_protocols.can_frames import CanFrames
from firmware_protocols.devices.icub_triangles import (
    PADS_PER_TRIANGLE,
    PALM,
    SHEETS,
    TAXEL_PADS,
    THERMAL_PADS,
    TrianglePlace,
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
NO_ACK = 1
NOT_CONNECTED = 2
TO_ALL = 0xF
NEW = 4
OLD = 3
"""Classes of identifiers."""
TEMPERATURE = 0
PALM_OR_TIP = 1
ERGO_HAND = 3
TEST_MODE = 7
TEMPERATURE_V2 = 8
GAINS = {
    TEMPERATURE: (70, 96, 83, 38, 38, 70, 0, 45, 77, 164, 0, 77),
    PALM_OR_TIP: (0,) * PADS_PER_TRIANGLE,
    ERGO_HAND: (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86),
    TEMPERATURE_V2: (58, 91, 39, 23, 35, 90, 0, 38, 68, 115, 0, 86),
}
"""Of each pad by type, in 1/128 of what the thermal pad drifts."""
ERGO_ORDER = np.array([0, 4, 8, 12, 16, 9, 10, 11, 13, 15, 1, 2, 3, 5, 6, 7])
"""The chip that each triangle of an ergoCub hand is sent from; 0 to 4 are fingertips, which it does not compensate."""
ORDER = np.arange(16)
CHIPS = 17
ABSENT = 0xFFFF
SCANS = 5
BOARD_TYPE = 11
VERSION = (1, 25, 0)
PROTOCOL = (2, 0)
INFORMATION = b"skin".ljust(32, b"\0")
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

_MASK = 1 << np.arange(PADS_PER_TRIANGLE)
REST = 0x6000
RAW_MAX = 0xFFFF
RAW_PER_NEWTON = 600.0
RAW_PER_DEG = 20.0
NO_LOAD = 245
OLD_NO_LOAD = 240
SHIFT = 2


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
def _blank(_tables: tuple[str, str], ident: int, enabled: bytes) -> Blank:
    """Of the triangles that are enabled, by the tables of head and tail."""
    which = np.flatnonzero(np.frombuffer(enabled, bool))
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
    kind: int = TEMPERATURE
    no_load: int = NO_LOAD
    period_ns: int = 50 * MS
    transmitting: bool = False
    raw: np.ndarray = field(init=False)
    """What the converter reads of every pad, shape ``(17, 12)``."""
    pads: np.ndarray = field(init=False)
    """What is sent of it, uint8, since the first conversion."""

    def __post_init__(self):
        n = len(self.flags)
        self.raw = np.full((CHIPS, PADS_PER_TRIANGLE), ABSENT)
        self.shift = np.full(TRIANGLES, SHIFT)
        self.enabled = np.ones(TRIANGLES, bool)
        self.unheard, self.calibrates = 0, False
        self.pad_of = np.concatenate([PADS_PER_TRIANGLE * k + np.array(pads) for k, pads in enumerate(self.feeling)])
        self.taxel_of = np.full((n, PADS_PER_TRIANGLE), len(self.pad_of))
        self.taxel_of.ravel()[self.pad_of] = np.arange(len(self.pad_of))
        self.pattern = np.where(self.taxel_of < len(self.pad_of), self.pattern, 0)
        sizes = np.array([len(pads) for pads in self.feeling])
        self.sizes, self.starts = sizes[:, None], np.cumsum(sizes) - sizes
        drifts = RAW_PER_DEG * np.array(GAINS[TEMPERATURE]) / 128
        drifts[list(THERMAL_PADS)] = RAW_PER_DEG
        self.per_deg = np.where(self.sizes == PADS_PER_TRIANGLE, RAW_PER_DEG, drifts)
        self.offset = np.full((CHIPS, PADS_PER_TRIANGLE), ABSENT)
        self.raw[self.numbers] = np.where(self.flags[:, None] == NOT_CONNECTED, ABSENT, REST)
        self.offset[self.numbers] = np.where(self.flags[:, None] == NOT_CONNECTED, ABSENT, REST + self.pattern)

    def convert(self, push: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        """Return what every pad of the fitted triangles reads, uint8, shape ``(n_triangles, 12)``.

        Args:
            push: of each taxel [N].
            temperature: of each taxel [deg C].
        """
        warmth = np.add.reduceat(temperature, self.starts)[:, None] / self.sizes - 25.0
        pushed = np.append(RAW_PER_NEWTON * push, 0.0)  # what a thermal pad feels
        fitted = quantize(REST + self.per_deg * warmth + pushed[self.taxel_of], high=RAW_MAX - 1)
        if self.flags.any():
            fitted[self.flags == NO_ACK], fitted[self.flags == NOT_CONNECTED] = 0, ABSENT
        self.raw[self.numbers] = fitted
        if self.calibrates:
            self.calibrate()
        sent_as, drift = self._sent_as(), 0
        change = self.raw - self.offset
        if self.kind in GAINS:
            gain = np.array(GAINS[self.kind])
            if self.kind == ERGO_HAND:
                gain = np.where((sent_as > 4)[:, None], gain, 0)
            thermal = change[:, THERMAL_PADS[:1]]
            drift = np.where(thermal > 0, (thermal >> 2) * gain >> 5, -(-thermal >> 2) * gain >> 5)
        shift = self.shift[np.minimum(sent_as, TRIANGLES - 1)][:, None]
        change = change - drift
        self.pads = np.minimum(np.maximum(self.no_load - (change >> shift), 0), 255).astype(np.uint8)
        self.out = (change <= -(255 - self.no_load << shift) * 2) | (change >= (self.no_load << shift) * 2)
        if self.kind == TEST_MODE:
            self.pads, self.out = (self.raw & 0xFF).astype(np.uint8), np.zeros_like(self.out)
        return self.pads[self.numbers]

    def calibrate(self) -> None:
        """Make what is felt now no load; a chip that does not acknowledge keeps what it had."""
        own, heard = self.numbers, (self.flags != NO_ACK)[:, None]
        fitted = self.raw[own] + np.where(self.flags[:, None] == NOT_CONNECTED, 0, self.pattern)
        self.offset[own] = np.where(heard, fitted, self.offset[own])
        self.calibrates = False

    def frames(self) -> CanFrames:
        """Head and tail of every enabled triangle."""
        which, ident = self.enabled, self.family << 8 | self.address << 4
        blank = _blank((HEAD.text, TAIL.text), ident, which.tobytes())
        chips = (ERGO_ORDER if self.kind == ERGO_HAND else ORDER)[which]
        data, pads, raw = blank.data.copy(), self.pads[chips], self.raw[chips]
        mask = self.out[chips, None] @ _MASK
        data[:, 0, blank.head_pads] = pads[:, :7]
        data[:, 1, blank.tail_pads] = pads[:, 7:]
        data[:, 1, blank.out_of_range] = mask >> 4
        flags = np.zeros((len(chips), 1), np.uint8)
        if self.kind != TEST_MODE:
            unheard = ((raw == 0) & (self.offset[chips] != 0)).any(1)
            flags[:, 0] = NO_ACK * unheard + NOT_CONNECTED * (raw == ABSENT).all(1)
            self.unheard += int(unheard.sum())
        if self.unheard >= SCANS:
            self.unheard, self.calibrates = 0, True
        data[:, 1, blank.ending] = (mask & 0xF) << 4 | flags
        return blank.frames.with_data(data.reshape(-1, 8))

    def _sent_as(self) -> np.ndarray:
        """Return the number under which each chip is sent, 16 for none, shape ``(17,)``."""
        numbers = np.full(CHIPS, TRIANGLES)
        numbers[ERGO_ORDER if self.kind == ERGO_HAND else ORDER] = ORDER
        return numbers

    def answers(self, klass: int, data: bytes) -> list[bytes]:
        """Return what the board says of itself where it is asked."""
        match klass, tuple(data):
            case 2, [0x1C, *wanted] if self.family == NEW:
                major, minor = (*wanted, 0, 0)[:2]
                is_wanted = major == PROTOCOL[0] and minor <= PROTOCOL[1]
                return [bytes([0x1C, BOARD_TYPE, *VERSION, *PROTOCOL, is_wanted])]
            case 7, [0xFF, *_] if self.family == NEW:
                return [bytes([0xFF, BOARD_TYPE, *VERSION])]
            case 7, [0x0C, *_] if self.family == NEW:
                return [bytes([0x0C, k, *INFORMATION[4 * k :][:4]]) for k in range(8)]
        return []

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
                self.enabled[first : last + 1], self.shift[first : last + 1] = bool(enable & 1), min(shift, 15)
                self.calibrate()
            case [0x4C, *_]:
                self.period_ns, self.transmitting = 40 * MS, True
                self.enabled[:] = True
                if self.family == NEW:
                    self.kind, self.no_load = TEMPERATURE, NO_LOAD
                self.calibrate()
            case [0x4E, *_]:
                pass
            case _:
                return False
        return True


_SKIN = "icub-firmware@b429921 embot_app_application_theSkin.cpp"


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
    judge = "robotology/icub-main@24c1a00"
    facts = (
        stated("touch", "compensation, ends, range, order of an ergoCub hand, test mode", f"{_SKIN}:70-110, 330-520"),
        stated(
            "touch",
            "errors that recalibrate, flags of a triangle",
            f"{_SKIN}:500-530; embot_prot_can_skin_periodic.cpp",
        ),
        stated(
            "touch",
            "a triangle that is not fitted reads FFFF, and is not connected",
            "icub-firmware AD7147.c TrianglesInit",
        ),
        assumed(
            "touch",
            f"{RAW_PER_NEWTON:.0f} raw counts/N and {RAW_PER_DEG:.0f} per deg C of a thermal pad",
            "theSkin, AD7147.c",
        ),
        assumed(
            "touch",
            "a pad drifts by its gain of type 0 / 128 of a thermal pad, one of a fingertip like that",
            "theSkin",
        ),
        assumed(
            "touch",
            "a chip that does not acknowledge reads 0 and did so after it was calibrated",
            "AD7147.c, I2C_Multi_SDA.c",
        ),
        assumed("touch", "the cdc offset shifts nothing that calibration does not take away", "theSkin, AD7147.c"),
        measured(
            "touch",
            "`pattern`: fingertips as recorded; other parts like them, one finger after another",
            "icub_grasp_dataset",
        ),
        assumed(
            "touch",
            "forearm: a cylinder of 40 mm radius, 3 strips of 8 triangles, 3 a board; upper arm: 45 mm, 5 strips of 7; "
            "torso: flat, 4 strips of 11; 16 triangles a board; edge 30 mm; pads as the drawing tool places them",
            "icub-main app/skinGui conf (free forms of one robot)",
        ),
        assumed(
            "touch",
            "hand: index, middle, ring, little, thumb, each 4 x 3 pads row by row at 4 mm around 7 mm; palm triangles "
            "in a row, ten taxels each (a hand V2.1 has 104 in all); numbers 0 to 4 and 8 to 11",
            "icub-main app/skinGui conf",
        ),
        stated(
            "identity",
            "MTB4 is 11, version 1.25.0, protocol 2.0",
            "icub-firmware main-appcan.cpp:20; iCubCanProto_types.h",
        ),
        stated(
            "configuration", "type 0, 50 ms, no load 245, shift 2, all enabled, silent", f"{_SKIN}:150-165; AD7147.h"
        ),
        stated(
            "configuration",
            "50 recalibrates all, 4C sets all back and starts; 4E does nothing",
            f"{_SKIN}:255-310, 720-765",
        ),
        stated(
            "configuration",
            "a frame is for a board by four bits, F for all, from any host",
            "embot_prot_can.cpp:100-117",
        ),
        assumed(
            "configuration", "old firmware: no load 240, 40 ms, the frames of the new one", "icub-firmware (not in it)"
        ),
        assumed("configuration", "boot loader, addresses and times get silence", "left out; bootloader.cpp"),
        assumed("configuration", "a hand's board has type 1 after power-up, as drivers set it", "theSkin has 0 on all"),
        assumed("identity", "additional information: skin", "set by a user; embot_prot_can_bootloader.cpp"),
        stated("timing", "period in ms, 40 after 4C", "embot_prot_can_analog_polling.cpp:217, 281"),
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
        if firmware == "old":
            self.columns = (replace(self.columns[0], rest=OLD_NO_LOAD),)
        self.layout = _layout(part, names)
        self.title = f"iCub skin, {part.replace('_', ' ')} of {n} triangles"
        if part in ("hand", "triangle"):
            self.title = "iCub skin, five fingertips and palm" if part == "hand" else "iCub skin, one triangle"
        feeling = [
            tuple(range(PADS_PER_TRIANGLE)) if part == "hand" and k < len(FINGERS) else TAXEL_PADS for k in range(n)
        ]
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
                else np.zeros(PADS_PER_TRIANGLE, int),
                OLD if firmware == "old" else NEW,
                PALM_OR_TIP if part == "hand" else TEMPERATURE,
                OLD_NO_LOAD if firmware == "old" else NO_LOAD,
            )
        addresses = [*(board.address for board in self.boards.values()), TO_ALL]
        self.ports = (Can(hears=tuple((klass << 8 | each, 0x70F) for klass in (2, 7) for each in addresses)),)
        self.streams = {name: Stream(1e9 / board.period_ns) for name, board in self.boards.items()}
        self.counts = np.full(len(self.layout), OLD_NO_LOAD if firmware == "old" else NO_LOAD, np.uint8)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """What each taxel reads, uint8, shape ``(n_taxels,)``: no load minus what presses; other boards as before."""
        board = self.boards[reading.stream]
        push = -np.add.reduce(reading["force"][board.taxels] * board.normals, -1)
        pads = board.convert(push, reading["temperature"][board.taxels])
        self.counts = self.counts.copy()
        self.counts[board.taxels] = pads.ravel()[board.pad_of]
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Two frames per enabled triangle of a board that transmits."""
        return self.boards[name].frames() if self.boards[name].transmitting else ()

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Set-up, start and stop of one board or all, unanswered; and what they are."""
        klass, host, to = data.arbitration_id >> 8, data.arbitration_id >> 4 & 0xF, data.arbitration_id & 0xF
        boards = {name: board for name, board in self.boards.items() if to in (board.address, TO_ALL)}
        if not boards or klass not in (2, 7) or data != CanFrame(arbitration_id=data.arbitration_id, data=data.data):
            self.counters["ignored"] += 1
            return ()
        answers, obeyed = [], 0
        for name, board in boards.items():
            ident = klass << 8 | board.address << 4 | host
            if found := board.answers(klass, data.data):
                answers += [CanFrame(arbitration_id=ident, data=each) for each in found]
            elif klass == 2 and board.obey(data.data):
                obeyed += 1
                self.periods[name] = board.period_ns
        self.counters["requests" if answers or obeyed else "unknown_command"] += 1
        return answers

    @property
    def commands(self) -> tuple[Command, ...]:
        """The set-up in the order of the robot's driver, for the first board; the others take the same. All silent."""
        board = next(iter(self.boards.values()))
        to, known = f"{0x200 | board.address:03X}#", _SET_UP if board.family == NEW else _SET_UP[2:]
        set_up = (
            Command(name=name, request=to + data, about=about, origin=origin) for name, data, about, origin in known
        )
        if board.family == OLD:
            return tuple(set_up)
        back = f"{board.address:X}0#"
        version = f"2{back}1C 0B 01 19 00 02 00 "
        return (
            *set_up,
            Command(name="version", request=to + "1C", reply=version + "00", origin=_VERSION),
            Command(name="version, protocol 2.0", request=to + "1C 02 00", reply=version + "01", origin=_VERSION),
            Command(
                name="additional information",
                request=f"70{board.address:X}#0C",
                reply=[f"7{back}0C {k:02X} ..{{4}}" for k in range(8)],
                origin=_VERSION,
            ),
            Command(
                name="who is there", request=f"70{board.address:X}#FF", reply=f"7{back}FF 0B 01 19 00", origin=_VERSION
            ),
        )


_VERSION = "icub-firmware@b429921 embot_prot_can.cpp:354, embot_prot_can_bootloader.cpp BROADCAST"
_DRIVER = "icub-main@24c1a00 CanBusSkin.cpp"
_MESSAGES = "icub-firmware-shared@62f2818 iCubCanProto_classes.h"
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
        return flat([TrianglePlace(0.0, 0.0, False)], names)
    surface = SHEETS[part]
    places = places_of(surface)[: len(names)]
    return wrapped(places, names, surface.radius) if surface.radius else flat(places, names)
