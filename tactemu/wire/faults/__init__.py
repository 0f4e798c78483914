"""What goes wrong on a wire: bytes and frames lost, changed, late, or not there at all.

A fault is text, so that it is the same on the command line, in a scene file and in Python::

    drop 1%                                    any frame to the driver, one in a hundred
    flip 5% id=0x201 to_driver from 2s to 6s   a bit in frames of one identifier, for a while
    checksum every 10                          each tenth frame
    late 20% by 30ms prefix=55aa               replies that begin so
    unplug at 3s for 0.5s

:mod:`tactemu.wire.faults.fault` has the grammar, :mod:`tactemu.wire.faults.frames` what is done to a frame,
:mod:`tactemu.wire.faults.link` what is done to the port or the bus, :mod:`tactemu.wire.faults.injector` applies them.
All are off unless named, seeded, counted, and logged in the truth.
"""

from tactemu.wire.faults.fault import DIRECTIONS, KINDS, Fault, parse
from tactemu.wire.faults.injector import Injector

__all__ = ["DIRECTIONS", "KINDS", "Fault", "Injector", "parse"]
