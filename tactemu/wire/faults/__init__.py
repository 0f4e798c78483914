"""Faults of a wire: bytes and frames that are lost, changed or late, and links that fail.

A fault is text, so that it is the same on the command line, in a scene file and in Python::

    drop 1%                                    any frame to the driver, one in a hundred
    flip 5% id=0x201 to_driver from 2s to 6s   a bit in frames of one identifier, for a while
    checksum every 10                          the last byte of each tenth frame
    late 20% by 30ms prefix=55aa               replies that begin with 55 AA
    unplug at 3s for 0.5s

:mod:`tactemu.wire.faults.fault` parses the text, :mod:`tactemu.wire.faults.frames` changes frames,
:mod:`tactemu.wire.faults.link` models faults of the port or the bus, :mod:`tactemu.wire.faults.injector` applies them.
All faults are off unless you name them; they are seeded, counted, and logged in the truth log.
"""

from tactemu.wire.faults.fault import DIRECTIONS, KINDS, Fault, parse
from tactemu.wire.faults.injector import Injector

__all__ = ["DIRECTIONS", "KINDS", "Fault", "Injector", "parse"]
