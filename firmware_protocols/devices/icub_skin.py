"""iCub skin (iCub, iCub3, ergoCub; boards MTB and MTB4): capacitive triangles on CAN, values that fall when pressed.

Wire: classic CAN, 1 Mbit/s, standard ids ``class << 8 | source << 4 | x``. Several boards share the bus; a board
carries up to 16 triangles of 12 pads (10 taxels, thermal pads 6 and 10: ``icub_triangles.py``). On the board of a hand
triangles 0 to 4 are the fingertips, whose 12 pads are all taxels, and 8 to 11 the palm.

Host to board b (1..14), id 0x200 | b, never answered, bytes behind these ignored:

    4D type period noload                    type as in ``GAINS``, 7 test mode, all others without compensation; period
                                             in ms; clears all triangles
    50 first last shift enable cdcL cdcH     for triangles first..last; stops transmission and recalibrates the board:
                                             the present values become no load
    07 00, 07 01                             start, stop
    4C, 4E                                   obsolete set-up; 4C starts at once, every 40 ms, all triangles, as powered
                                             up, recalibrated
    1C major minor                           210#1C 0B 01 19 00 02 00 ok: MTB4, version 1.25.0, protocol 2.0;
                                             ok is 1 if that is the requested one
    FF, of class 7: 70F#FF                   710#FF 0B 01 19 00: search for boards
    0C, of class 7: 701#0C                   710#0C 00 and four characters, to 07: additional information

F in place of b addresses all boards. Board to host, two frames of the same id per enabled triangle and period: ``HEAD``
and ``TAIL``; triangles 0 to 15 that are not fitted are sent as not connected. Old firmware (option ``firmware``) knows
only the obsolete set-up, and sends under class 3 in place of 4.

A pad reads ``noload - ((raw - offset - drift) >> shift)``, clamped to 0..255, and is out of range from twice the change
on that reaches an end. ``drift`` is ``((thermal - its offset) >> 2) * gain >> 5``, of pad 6. In test mode a pad is the
low byte of its raw value. Flags: 1 the chip does not acknowledge, 2 triangle not connected. Every fifth triangle that
does not acknowledge recalibrates the board.

Each board samples at its own period, also while it is silent: its values at message 50 become its new no load.

Evidence: firmware of the boards and the robot's own driver (YARP ``canBusSkin``).

Try it: ``tactemu run icub_skin --port can:socketcan:vcan0``, then for each board, here 1 (50 Hz, triangles 0 to 2):
``for m in 4D0014F0 50000202010022 0700; do cansend vcan0 201#$m; done; candump vcan0``
"""

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Column, Command, Counts, Device, Layout, Option, Reading, Stream, Transmissions,
    command_table, fact_table, place, stack,
)  # fmt: skip
from firmware_protocols.devices.icub_board import (
    HEAD, NOT_CONNECTED, NO_ACK, NO_LOAD_COUNTS, OLD_CLASS, OLD_NO_LOAD_COUNTS, RAW_COUNTS_PER_DEG,
    RAW_COUNTS_PER_NEWTON, TAIL, TO_ALL, TRIANGLES_PER_BOARD, TYPE_PALM_OR_TIP, Board,
)  # fmt: skip
from firmware_protocols.devices.icub_triangles import (
    PADS_PER_TRIANGLE, PALM, SHEETS, TAXEL_PADS, TrianglePlace, fingertip, flat, places_of, wrapped,
)  # fmt: skip

FINGERS = ("index", "middle", "ring", "little", "thumb")
HAND_TRIANGLES = (0, 1, 2, 3, 4, 8, 9, 10, 11)
"""The numbers of a hand's fingertips and palm triangles."""
FINGERTIP_PATTERN = np.array(
    [
        (10, 11, 11, 12, 9, 2, 12, -14, 11, 12, -7, 9),
        (14, 8, 3, 14, 12, -2, 6, -25, 7, 4, -16, 5),
        (8, 11, 14, 14, 14, 13, 14, 12, 13, 14, 13, 11),
        (13, 14, 22, 23, 22, 22, 24, 22, 19, 22, 22, 15),
        (8, -13, -37, 3, 2, -28, -5, -27, 3, 3, -27, -6),
    ]
)
"""The amount by which each pad of a hand's fingertips was below its calibration at rest [raw counts], by finger."""


_SKIN = "icub-firmware@b429921 embot_app_application_theSkin.cpp"


class IcubSkin(Device[CanFrame]):
    """Triangles of the iCub skin on one CAN bus: flat with normal +z, or around a cylinder about the link's z axis."""

    name = "icub_skin"
    tables = (HEAD, TAIL)
    """The frames that its boards send."""
    kind = "skin"
    senses = ("force", "temperature")
    columns = (Column(name="pad", low=0, high=255, rest=NO_LOAD_COUNTS, push=-1),)
    evidence = ("firmware", "driver")
    sources = (
        "icub-firmware@b429921 embot_prot_can_skin_periodic.cpp, embot_app_application_theSkin.cpp",
        "icub-firmware-shared@62f2818 can/canProtocolLib/iCubCanProto_{classes,analogSensorMessages}.h",
        "icub-main@24c1a00 canBusSkin/CanBusSkin.cpp l.615-640, skinLib/SkinDiagnostics.h",
        "icub-main app/skinGui conf (triangle_10pad)",
        "clear-nus/icub_grasp_dataset@87dceeca (recordings of a hand: `pattern`)",
    )
    judge = "robotology/icub-main@24c1a00"
    facts = fact_table(f"""
        stated touch: temperature compensation, saturation, range, the order of an ergoCub hand's fingers, test mode @
            {_SKIN}:70-110, 330-520
        stated touch: the errors that start a recalibration, and the flags of a triangle @ {_SKIN}:500-530;
            embot_prot_can_skin_periodic.cpp
        stated touch: a triangle that is not fitted reads FFFF and has the flag "not connected" @ icub-firmware AD7147.c
            TrianglesInit
        assumed touch: a taxel has {RAW_COUNTS_PER_NEWTON:.0f} raw counts/N, a thermal pad {RAW_COUNTS_PER_DEG:.0f}
            counts per deg C
        assumed touch: a pad drifts with temperature by its gain of type 0, divided by 128, times the drift of a thermal
            pad; a fingertip's pad drifts alike @ theSkin
        assumed touch: a chip that does not acknowledge reads 0, and is taken to have answered while it was calibrated @
            AD7147.c, I2C_Multi_SDA.c
        assumed touch: the cdc offset has no effect that calibration does not remove
        measured touch: option `pattern`: fingertips as in the recording; other parts alike, one finger after another @
            icub_grasp_dataset
        assumed touch: forearm: a cylinder of 40 mm radius with 3 strips of 8 triangles, 3 triangles to a board; upper
            arm: a cylinder of 45 mm radius with 5 strips of 7; torso: flat, with 4 strips of 11; both 16 triangles to a
            board; edges are 30 mm long; pads lie where the robot's drawing tool places them @ icub-main app/skinGui
            conf (free forms of one robot)
        assumed touch: hand: index, middle, ring, little finger and thumb have 4 x 3 pads each, row by row at 4 mm
            around a fingertip of 7 mm radius; the palm's triangles lie in a row, with ten taxels each (a hand V2.1 has
            104 taxels in all); their numbers are 0 to 4 and 8 to 11 @ icub-main app/skinGui conf
        stated identity: the board type of an MTB4 is 11; version 1.25.0, protocol 2.0 @ icub-firmware
            main-appcan.cpp:20; iCubCanProto_types.h
        stated configuration: after power-up: type 0, period 50 ms, no-load value 245, shift 2, all triangles enabled,
            and no transmission @ {_SKIN}:150-165; AD7147.h
        stated configuration: message 50 recalibrates all triangles; 4C resets all settings and starts transmission; 4E
            has no effect @ {_SKIN}:255-310, 720-765
        stated configuration: four bits of a frame's identifier address the board, F all boards; any host may send @
            embot_prot_can.cpp:100-117
        assumed configuration: old firmware: no-load value 240, period 40 ms, the frames of the new firmware @
            icub-firmware (not in it)
        assumed configuration: messages for the boot loader, addresses and times get no answer @ left out;
            bootloader.cpp
        assumed configuration: the board of a hand has type 1 after power-up, to which drivers set it @ theSkin has 0 on
            all
        assumed identity: the board's additional information is "skin" @ set by a user; embot_prot_can_bootloader.cpp
        stated timing: the period is in ms, and 40 after message 4C @ embot_prot_can_analog_polling.cpp:217, 281
    """, looked="theSkin, AD7147.c")  # fmt: skip

    def __init__(
        self,
        *,
        part: Annotated[
            Literal["forearm", "upper_arm", "torso", "hand", "triangle"],
            Option("24, 35 or 44 triangles; five fingertips and a palm of four; or one triangle"),
        ] = "forearm",
        firmware: Annotated[Literal["new", "old"], Option("old: the set-up 4C and 4E, identifiers of class 3")] = "new",
        triangles_per_board: Annotated[
            int | None,
            Option(
                "triangles on each board, in order; default: 3 on a forearm, else 16", low=1, high=TRIANGLES_PER_BOARD
            ),
        ] = None,
        triangles: Annotated[
            int | None, Option("fitted triangles of the part, from the first; default: all", low=1)
        ] = None,
        first_board: Annotated[int, Option("address of the first board; the others follow", low=1, high=14)] = 1,
        no_ack: Annotated[tuple[str, ...], Option("triangles whose chip does not acknowledge, as board.triangle")] = (),
        not_connected: Annotated[tuple[str, ...], Option("unplugged triangles, as board.triangle")] = (),
        pattern: Annotated[
            Literal["even", "measured"], Option("values at rest: no load, or as measured on the fingertips of a hand")
        ] = "even",
    ):
        numbers = HAND_TRIANGLES if part == "hand" else range(TRIANGLES_PER_BOARD)
        n_in_part = len(HAND_TRIANGLES) if part == "hand" else len(places_of(SHEETS[part])) if part in SHEETS else 1
        n = triangles or n_in_part
        if n > n_in_part or (n < n_in_part and part not in SHEETS):
            raise ValueError(f"triangles: a {part} has {n_in_part}, got {n}")
        per_board = triangles_per_board or (3 if part == "forearm" else TRIANGLES_PER_BOARD)
        slots = [(first_board + k // per_board, numbers[k % per_board]) for k in range(n)]
        names = [f"{board}.{triangle}" for board, triangle in slots]
        if (last := slots[-1][0]) > 14:
            raise ValueError(f"boards have addresses 1..14, got {first_board}..{last}: put more triangles on each")
        if unknown := [name for name in (*no_ack, *not_connected) if name not in names]:
            raise ValueError(f"no triangle {unknown[0]!r}; there are {names[0]} to {names[-1]} (board.triangle)")
        self.columns = (replace(self.columns[0], rest=OLD_NO_LOAD_COUNTS if firmware == "old" else NO_LOAD_COUNTS),)
        self.layout = _layout(part, names)
        self.title = f"iCub skin, {part.replace('_', ' ')} of {n} triangles"
        if part in ("hand", "triangle"):
            self.title = "iCub skin, five fingertips and palm" if part == "hand" else "iCub skin, one triangle"
        feeling = [
            tuple(range(PADS_PER_TRIANGLE)) if part == "hand" and k < len(FINGERS) else TAXEL_PADS for k in range(n)
        ]
        flags = np.array([NO_ACK * (name in no_ack) | NOT_CONNECTED * (name in not_connected) for name in names])
        rests = FINGERTIP_PATTERN[np.arange(n) % len(FINGERTIP_PATTERN)] * (pattern == "measured")
        settings: dict[str, Any] = {"family": OLD_CLASS, "no_load": OLD_NO_LOAD_COUNTS} if firmware == "old" else {}
        settings |= {"kind": TYPE_PALM_OR_TIP} if part == "hand" else {}
        order = np.split(self.layout.wire_order, np.cumsum([len(pads) for pads in feeling])[:-1])
        self.boards: dict[str, Board] = {}
        for start in range(0, n, per_board):
            own, (address, _) = slice(start, start + per_board), slots[start]
            fitted, taxels = np.array([number for _, number in slots[own]]), np.concatenate(order[own])
            self.boards[f"board {address}"] = Board(
                address, taxels, self.layout.normals[taxels], fitted, feeling[own], flags[own], rests[own], **settings
            )
        addresses = [*(board.address for board in self.boards.values()), TO_ALL]
        self.ports = (Can(filters=tuple((klass << 8 | each, 0x70F) for klass in (2, 7) for each in addresses)),)
        self.streams = {name: Stream(1e9 / board.period_ns) for name, board in self.boards.items()}
        self.counts = np.full(len(self.layout), self.columns[0].rest, np.uint8)

    def measure(self, reading: Reading, t_ns: int) -> Counts:
        """Return each taxel's value, uint8, shape ``(n_taxels,)``: no load less the push; other boards as before."""
        board = self.boards[reading.stream]
        push = -np.add.reduce(reading["force"][board.taxels] * board.normals, -1)
        pads = board.convert(push, reading["temperature"][board.taxels])
        self.counts = self.counts.copy()
        self.counts[board.taxels] = pads.ravel()[board.pad_of]
        return self.counts

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return two frames for each enabled triangle of a board that transmits."""
        return self.boards[name].frames() if self.boards[name].transmitting else ()

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Set up, start or stop one board or all, without an answer; or answer a request for identity."""
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
            elif klass == 2:
                obeyed += self.set_up(name, data.data)
        self.counters["requests" if answers or obeyed else "unknown_command"] += 1
        return answers

    def set_up(self, name: str, data: bytes) -> bool:
        """Obey one message to a board; return False if it does not know it."""
        board = self.boards[name]
        if is_known := board.obey(data):
            self.periods[name] = board.period_ns
        return is_known

    @property
    def commands(self) -> tuple[Command, ...]:
        """The set-up in the order of the robot's driver, and requests for identity, to the first board."""
        board = next(iter(self.boards.values()))
        b, information = f"{board.address:X}", ", ".join(f"7{board.address:X}0#0C {k:02X} ..{{4}}" for k in range(8))
        new = command_table(f"""
            @ {_DRIVER}
            board set-up         20{b}#4D 00 32 F0           -  compensated, 50 ms, no load 240; clears triangles
            triangle set-up      20{b}#50 00 0F 02 01 00 22  -  all triangles; recalibrates, stops
            @ {_VERSION}
            ? version            20{b}#1C                    2{b}0#1C 0B 01 19 00 02 00 00
            ? version, protocol 2.0  20{b}#1C 02 00          2{b}0#1C 0B 01 19 00 02 00 01
            additional information   70{b}#0C                {information}
            who is there         70{b}#FF                    7{b}0#FF 0B 01 19 00
        """)
        every = command_table(f"""
            @ {_DRIVER}
            start                20{b}#07 00                 -  two frames per triangle and period from now on
            stop                 20{b}#07 01
            @ {_MESSAGES}
            old board set-up     20{b}#4C 00 00 00           -  obsolete; starts at once
            old triangle set-up  20{b}#4E 00 00 00           -  obsolete
        """)
        return every if board.family == OLD_CLASS else (*new, *every)


_VERSION = "icub-firmware@b429921 embot_prot_can.cpp:354, embot_prot_can_bootloader.cpp BROADCAST"
_DRIVER = "icub-main@24c1a00 CanBusSkin.cpp"
_MESSAGES = "icub-firmware-shared@62f2818 iCubCanProto_classes.h"


def _layout(part: str, names: list[str]) -> Layout:
    """Return the layout of the triangles of a part, with patches named ``names``."""
    if part == "hand":
        tips = [fingertip(name, finger, (2 - k) * 0.02) for k, (name, finger) in enumerate(zip(names, FINGERS))]
        return stack(*tips, place(flat(places_of(PALM), names[len(tips) :], "palm"), (0.0, -0.08, 0.0)))
    if part == "triangle":
        return flat([TrianglePlace(0.0, 0.0, False)], names)
    surface = SHEETS[part]
    places = places_of(surface)[: len(names)]
    return wrapped(places, names, surface.radius) if surface.radius else flat(places, names)
