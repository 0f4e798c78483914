"""XELA uSkin, 4 x 4 or 4 x 6 three-axis taxels: CAN, streams between a start and a stop command.

Wire: classic CAN, 1 Mbit/s, standard ids.

    id            data              direction   about
    0x200|board   07 00             to board    start: the board streams unasked from now on
    0x200|board   07 01             to board    stop; bytes behind these two are ignored
    (below)       ``TAXEL``         to host     one frame per taxel and sample

Ids of the taxels, two generations (option ``ids``; the 4 x 6 has the second):

    "board"   0x700 | board << 4 | taxel       taxel 0..15 row by row (0x710..0x71F for board 1)
    "grid"    0x100 + row << 4 + column        sent column by column; of a 4 x 6, 0x135 ends a sample

A third reader knows taxels 0x741, 0x750, 0x754 and 0x775, which fits a 4 x 6 with ``first_id=1856`` (0x740).

Values are raw magnetic counts, uncalibrated, about 18 000 to 30 000 at rest. A press raises Z: published readers
subtract the baseline and take a fall for no touch. One of them takes any sixteen frames for a sample, and fails at ids
from 0x720 on. Evidence: two published drivers, one for each generation, run; neither firmware nor manual was seen.

Try it: ``tactemu run xela_uskin --port can:socketcan:vcan0``, then ``cansend vcan0 201#0700; candump vcan0``.
"""

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np

from firmware_protocols import (
    Can, CanFrame, Column, Device, FieldGains, Frame, Option, Transmissions, Vector, command_table, fact_table,
    grid_layout, xyz,
)  # fmt: skip

TAXEL = Frame("""
    taxel, raw magnetic counts
    0    00         unused
    1    >u2 x 3    axes      X, Y, Z
    7    00         unused
""")

PITCH_M = 0.0047
UT_PER_COUNT = 0.1
REST_FIELD_UT = (2400.0, 2400.0, 2100.0)
GAIN_UT_PER_N = (300.0, 300.0, -500.0)


Board = Annotated[int, Option("number set by the switches of the board", low=1, high=15)]
_ARQ = "uskin_can_drivers@081807b"
_ASSUMED = fact_table("""
    assumed touch: 0.1 uT per count, 300 uT/N in the plane and 500 uT/N along the normal; 24000, 24000 and 21000 counts
        at rest @ both drivers (maxima by trial: 45000, 25000, 25600; Z at least 18300), xela_models
    assumed touch: unused bytes are 0 @ both drivers, which do not look at them
    assumed configuration: the sensor is silent after power-up; other messages get no answer @ both drivers
    assumed timing: 100 Hz @ both drivers
""")


def raw_columns(gains: Vector) -> tuple[Column, ...]:
    """Return the columns X, Y, Z of raw counts; a press raises Z if its gain is negative."""
    rest = [round(field / UT_PER_COUNT) for field in REST_FIELD_UT]
    x, y, z = (gain / UT_PER_COUNT for gain in gains)
    return xyz("X Y Z", low=0, high=0xFFFF, rest=rest, assumed_per_unit=[x, y, abs(z)], push=-1 if z > 0 else 1)


class XelaUskin(Device[CanFrame]):
    """Sixteen three-axis taxels, with one CAN frame each."""

    name = "xela_uskin"
    title = "XELA uSkin 4x4"
    kind = "fingertip"
    rows, cols = 4, 4
    evidence = ("driver",)
    sources = (
        "o2as/ur-o2as@97adced xela_sensor.py l.37 (ids 'board')",
        "ARQ-CRISP/uskin_can_drivers@081807b convertCanIDtoIndex (ids 'grid', 4x6 product)",
        "mcsix/xela_models@4cc8e17; xela_sensor_node.py (pitch)",
    )
    judge = "o2as/ur-o2as@97adced"
    documented_with = None
    facts = (
        *_ASSUMED,
        *fact_table("""
        stated touch: each taxel has a frame of three numbers, high byte first, with ids from 710 on @
            xela_sensor.py:37-52
        stated touch: 4.7 mm from taxel to taxel @ ur-o2as xela_sensor_node.py taxel_area
        assumed touch: the 4x4 product with option ids 'grid' (the known product of that generation is 4x6) @ both
            drivers
        stated configuration: 07 00 starts the stream @ xela_sensor.py:23
        """),
    )

    def __init__(
        self,
        *,
        ids: Annotated[Literal["board", "grid"], Option("id scheme of the product generation")] = "board",
        board: Board = 1,
        gains: FieldGains = GAIN_UT_PER_N,
    ):
        self.ports = (Can(filters=((0x200 | board, 0x7FF),), addressed=((0x200 | board, 0x70F),)),)
        row, col = np.divmod(np.arange(self.rows * self.cols), self.cols)
        by_grid = ids == "grid"
        order = np.lexsort((row, col)) if by_grid else None
        self.layout = replace(grid_layout(self.rows, self.cols, PITCH_M, name="uskin"), wire_order=order)  # type: ignore[arg-type]
        taxel_ids = 0x100 | row << 4 | col if by_grid else 0x700 | board << 4 | row * self.cols + col
        self.ids = self.layout.on_wire(taxel_ids).tolist()
        self.columns = raw_columns(gains)
        self.command_id, self.streaming = 0x200 | board, False
        self.documented = command_table(
            f"""
            start  {self.command_id:03X}#0700  -  streams until stopped
            stop   {self.command_id:03X}#0701
            """,
            origin="ur-o2as@97adced xela_sensor.py",
        )

    def stream(self, t_ns: int, name: str) -> Transmissions[CanFrame]:
        """Return one frame for each taxel, between start and stop."""
        if not self.streaming:
            return ()
        taxels = zip(self.ids, self.layout.on_wire(self.counts))
        return [CanFrame(arbitration_id=ident, data=TAXEL.pack(axes=axes)) for ident, axes in taxels]

    def receive(self, data: CanFrame, t_ns: int, port: str) -> Transmissions[CanFrame]:
        """Start or stop the stream; the board never answers."""
        if data != CanFrame(arbitration_id=self.command_id, data=data.data):
            self.counters["ignored"] += 1
        elif data.data[:2] in (b"\x07\x00", b"\x07\x01"):
            self.counters["requests"] += 1
            self.streaming = data.data[1] == 0
        else:
            self.counters["unknown_command"] += 1
        return ()


class XelaUskin4x6(XelaUskin):
    """Twenty-four taxels of the later generation."""

    name = "xela_uskin_4x6"
    title = "XELA uSkin 4x6"
    rows, cols = 4, 6
    judge = "ARQ-CRISP/uskin_can_drivers@081807b"
    facts = (
        *_ASSUMED,
        *fact_table(f"""
        stated touch: identifiers follow row and column, column by column; 135 ends a sample @ {_ARQ}
            uskinCanDriver.cpp:133-150
        stated touch: three numbers, high byte first @ {_ARQ} can_communication.cpp convert_16bit_hex_to_dec
        assumed touch: the pitch is that of the 4x4 @ {_ARQ}, all files
        stated configuration: 07 00 to identifier 201 starts the stream, 07 01 stops it @ {_ARQ} can_communication.cpp
            requestData, stopData
        """),
    )

    def __init__(
        self,
        *,
        board: Board = 1,
        first_id: Annotated[int, Option("identifier of row 0, column 0", low=0, high=0x7FF - 0x35)] = 0x100,
        gains: FieldGains = GAIN_UT_PER_N,
    ):
        super().__init__(ids="grid", board=board, gains=gains)
        self.ids = [first_id - 0x100 + ident for ident in self.ids]
