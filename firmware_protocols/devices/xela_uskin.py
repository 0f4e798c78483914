"""XELA uSkin, 4 x 4 three-axis taxels: CAN, streams between a start and a stop command.

Wire: classic CAN, 1 Mbit/s, standard ids.

    id            data              direction   about
    0x200|board   07 00             to board    start: the board streams by itself from now on
    0x200|board   07 01             to board    stop
    (below)       8 bytes           to host     one frame per taxel and sample

    byte   0        1..2       3..4       5..6       7
           unused   X u16 BE   Y u16 BE   Z u16 BE   unused

Ids of the taxels, two generations (option ``ids``):

    "board"   0x700 | board << 4 | taxel       taxel 0..15 row by row (0x710..0x71F for board 1)
    "grid"    0x100 | row << 4 | column        sent column by column

Values are raw magnetic counts, uncalibrated, about 18 000 to 30 000 at rest. Evidence: two published drivers, one for
each generation; neither firmware nor manual was seen.

Try it: ``tactemu run xela_uskin --port can:socketcan:vcan0``, then ``cansend vcan0 201#0700; candump vcan0``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from firmware_protocols.adc import quantize
from firmware_protocols.device import CanFrame, CanWire, Command, Device, Outgoing, Reading, grid_layout
from firmware_protocols.magnetic import LinearMagnet, Transducer

ROWS = COLUMNS = 4
PITCH = 0.0047
COUNT_UT = 0.1
REST_FIELD_UT = (2400.0, 2400.0, 2100.0)

START, STOP = b"\x07\x00", b"\x07\x01"


class XelaUskin(Device):
    """Sixteen three-axis taxels, one CAN frame each.

    Args:
        ids: id scheme of the product generation, ``board`` or ``grid``.
        board: 1..15, set by the board's switches.
        transducer: taxel force [N] to field [uT]; see :mod:`firmware_protocols.magnetic`.
    """

    name = "xela_uskin"
    title = "XELA uSkin 4x4"
    wires = (CanWire(bitrate=1_000_000),)
    senses = "force"
    rate_hz = 100.0
    evidence = ("driver",)
    sources = (
        "o2as/ur-o2as@97adced xela_sensor.py l.37 (ids 'board')",
        "ARQ-CRISP/uskin_can_drivers@081807b convertCanIDtoIndex (ids 'grid', 4x6 product)",
        "mcsix/xela_models@4cc8e17; xela_sensor_node.py (pitch)",
    )
    judge = "cantools, with a DBC of its frames"
    assumed = (
        "0.1 uT per count, 300 uT/N in the plane, 500 uT/N along the normal, 24000/24000/21000 counts at rest",
        "100 Hz; unused bytes 0; a 4x4 product with ids 'grid' (that generation's known product is 4x6)",
    )

    def __init__(
        self, *, ids: Literal["board", "grid"] = "board", board: int = 1, transducer: Transducer | None = None
    ):
        super().__init__()
        if ids not in ("board", "grid"):
            raise ValueError(f"xela_uskin: ids: expected 'board' or 'grid', got {ids!r}")
        if not 1 <= board <= 15:
            raise ValueError(f"xela_uskin: board: expected 1..15, got {board}")
        self.board = board
        self.layout = grid_layout(ROWS, COLUMNS, PITCH, name="uskin")
        self.transducer = transducer or LinearMagnet(gain=(300.0, 300.0, 500.0), offset=REST_FIELD_UT)
        self._sent = _by_board(board) if ids == "board" else _by_grid()
        self.power_on(0)

    def power_on(self, t_ns: int) -> Sequence[Outgoing]:
        """Silent until started."""
        self.streaming = False
        return ()

    def digitize(self, reading: Reading) -> np.ndarray:
        """Raw counts X, Y, Z of each taxel, uint16, shape ``(16, 3)``."""
        field = self.transducer(self.layout.to_taxel_frame(np.asarray(reading.values)))
        return quantize(field, 1 / COUNT_UT, 0, 0xFFFF).astype(np.uint16)

    def stream(self, t_ns: int) -> Sequence[Outgoing]:
        """Sixteen frames while started."""
        if not self.streaming:
            return ()
        axes = self.counts.astype(">u2")
        return [CanFrame(arbitration_id=i, data=b"\0" + axes[taxel].tobytes() + b"\0") for i, taxel in self._sent]

    def receive(self, data: CanFrame, t_ns: int) -> Sequence[Outgoing]:
        """Start and stop; nothing is ever answered."""
        if data in (self._request(START), self._request(STOP)):
            self.counters["requests"] += 1
            self.streaming = data.data == START
        elif data.arbitration_id == 0x200 | self.board:
            self.counters["unknown_command"] += 1
        else:
            self.counters["ignored"] += 1
        return ()

    def _request(self, data: bytes) -> CanFrame:
        return CanFrame(arbitration_id=0x200 | self.board, data=data)

    @property
    def commands(self) -> tuple[Command, ...]:
        """Start and stop."""
        return (
            Command(name="start", request=self._request(START), reply=None, about="streams until stopped"),
            Command(name="stop", request=self._request(STOP), reply=None),
        )


def _by_board(board: int) -> list[tuple[int, int]]:
    """``(id, taxel)`` in the order sent."""
    return [(0x700 | board << 4 | taxel, taxel) for taxel in range(ROWS * COLUMNS)]


def _by_grid() -> list[tuple[int, int]]:
    return [(0x100 | row << 4 | col, row * COLUMNS + col) for col in range(COLUMNS) for row in range(ROWS)]
