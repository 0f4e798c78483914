"""Protocols that ask for memory: framings on the seam of :mod:`firmware_protocols.registers`.

Each is a class that cuts requests from a stream, reads and writes the memories that it is given with every call, and
returns the answers. It keeps bytes that are not yet a request, and nothing of the device.
"""

from __future__ import annotations

from typing import NamedTuple


class Answer(NamedTuple):
    """A frame that leaves later, or in turn."""

    frame: bytes
    delay_ns: int = 0
    """After the last bit of the request, or of the answer before."""
    turn: int = 0
    """Place among the answers to one broadcast: lower ones leave first."""
