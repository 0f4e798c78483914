"""Faults of a wire: bytes and frames that are lost, changed or late, and links that fail.

A fault is an object of its class, which has its word, options, effect and consequences. On the command line and in a
scene file it is text::

    drop 1%                                    any frame to the driver, one in a hundred
    flip 5% id=0x201 to_driver from 2s to 6s   a bit in frames of one identifier, for a while
    checksum every 10                          the last byte of each tenth frame
    late 20% by 30ms prefix=55aa               replies that begin with 55 AA
    unplug at 3s for 0.5s

:mod:`tactemu.wire.faults.fault` has the base classes, :mod:`tactemu.wire.faults.registry` lists the faults,
:mod:`tactemu.wire.faults.text` parses text, and :mod:`tactemu.wire.faults.injector` applies the faults of one wire.
All faults are off unless you name them; they are seeded, counted, and logged in the truth log.
"""

from tactemu.wire.faults.fault import Fault
from tactemu.wire.faults.injector import Injector
from tactemu.wire.faults.options import DIRECTIONS
from tactemu.wire.faults.registry import FAULTS, check_fits, possible_faults
from tactemu.wire.faults.text import parse

__all__ = ["DIRECTIONS", "FAULTS", "Fault", "Injector", "check_fits", "parse", "possible_faults"]
