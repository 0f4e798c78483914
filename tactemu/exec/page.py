"""The page of memory and the pipe that a port shares with the preload library; layout as in ``preload/tty.c``."""

from __future__ import annotations

import struct

PAGE = struct.Struct("=3IiI2H")
"""Lines, control flags as asked for (0: never), break, flags of ``serial_struct``, number of the port, its delays."""
LINES_AT, CONTROL_AT = 0, 4
TOLD = struct.Struct("=2I")
"""What has changed, and its new value."""
LINES, CONTROL, BREAK, FLAGS = 1, 2, 3, 4

DTR, RTS, CTS, CAR, DSR = 0x002, 0x004, 0x020, 0x040, 0x100
"""Modem lines, as in ``TIOCMGET``."""
AT_REST = CTS | CAR | DSR
"""What the device's side of the line says."""
LOW_LATENCY = 0x2000
"""Of the flags of ``serial_struct``."""


def fresh(number: int) -> bytes:
    """Return the page of a port that nobody has open: whoever opens it finds its lines raised."""
    return PAGE.pack(DTR | RTS | AT_REST, 0, 0, 0, number, 50, 3000)
