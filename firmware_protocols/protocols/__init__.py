"""Protocols that read and write memories, by the interface of :mod:`firmware_protocols.registers`.

Each is a class that cuts requests from a stream, reads and writes the memories in the arguments of every call, and
returns the answers. It keeps the bytes of an incomplete request, and nothing of the device.
"""

from __future__ import annotations

from typing import NamedTuple


class Answer(NamedTuple):
    """A frame that leaves after a delay, or in turn."""

    frame: bytes
    delay_ns: int = 0
    """The delay after the last bit of the request, or of the previous answer."""
    turn: int = 0
    """The place among the answers to one broadcast: lower ones leave first."""
