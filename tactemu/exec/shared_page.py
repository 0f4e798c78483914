"""The page of memory and the pipe that a port shares with the preload library; layout as in ``preload/tty.c``.

The page has the state of the port. The library writes changes into the pipe, in order.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

PAGE = struct.Struct("=3IiI2H")
"""Modem lines, control flags set by a driver (0: none set), break, flags of ``serial_struct``, number of the port, its
delays."""
LINES_OFFSET = 0
CHANGE = struct.Struct("=2I")
"""The field that has changed, one of LINES to FLAGS, and its new value."""
LINES, CONTROL, BREAK, FLAGS = 1, 2, 3, 4

DTR, RTS, CTS, CAR, DSR = 0x002, 0x004, 0x020, 0x040, 0x100
"""Modem lines, as in ``TIOCMGET``."""
DEVICE_LINES = CTS | CAR | DSR
"""The lines that the device raises."""
LOW_LATENCY = 0x2000
"""The flag of ``serial_struct`` for low latency."""


def paths(folder: Path, pty: tuple[int, int]) -> tuple[Path, Path]:
    """Return the page and the pipe of the port with the pseudo terminal ``pty`` (major, minor)."""
    name = folder / f"{pty[0]}:{pty[1]}"
    return name.with_suffix(".page"), name.with_suffix(".told")


def create(folder: Path, pty: tuple[int, int], number: int) -> list[int]:
    """Create page and pipe of port ``number``, which no driver has open, and return their descriptors.

    The first driver that opens the port finds its lines raised, as on a real one.
    """
    page, pipe = paths(folder, pty)
    page.write_bytes(PAGE.pack(DTR | RTS | DEVICE_LINES, 0, 0, 0, number, 50, 3000))
    os.mkfifo(pipe)
    for path in (page, pipe):
        path.chmod(0o666)  # for every user who may open the port
    return [os.open(page, os.O_RDWR), os.open(pipe, os.O_RDWR | os.O_NONBLOCK)]
