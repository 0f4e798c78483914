"""Errors of a real CAN bus, as its controller reports them in error frames: decoded, counted, and said once.

The layout is that of Linux, ``linux/can/error.h``: bits of the identifier are classes of errors, bytes have details.
Names are those of the kernel's own counters (``ip -details -statistics link show``), as far as there are any.
"""

from __future__ import annotations

import logging
from collections import Counter

from tactemu.transports.transport import Counted, Event

_logger = logging.getLogger(__name__)

ALL_ERRORS = 0x1FFF_FFFF
"""The mask of ``CAN_RAW_ERR_FILTER`` by which a socket receives all error frames."""
_LOST_ARBITRATION, _CONTROLLER, _PROTOCOL, _TRANSCEIVER, _NO_ACK = 0x02, 0x04, 0x08, 0x10, 0x20
_CLASSES = {0x01: "tx_timeout", _TRANSCEIVER: "transceiver", 0x40: "bus_off", 0x100: "restarts"}
"""Classes of errors without details, and their counters."""
_BUS_ERROR = 0x80
_CONTROLLER_STATES = {0x03: "controller_overflow", 0x0C: "error_warning", 0x30: "error_passive"}
"""Bits of byte 1: a full buffer, and a counter of errors beyond 96 or 127, each of receiving or sending."""
_AT_ACK_SLOT = 0x19
"""The place of a protocol error, in byte 3: no node has acknowledged the frame."""
ADVICE = {
    "error_passive": "is error-passive: no node acknowledges. Is the other end on, at the same bit rate, and is there "
    "a 120 Ohm terminator at both ends of the bus?",
    "bus_off": "is bus-off, and takes no part until it is restarted: sudo ip link set {name} down && sudo ip link set "
    "{name} up. An adapter that can restarts by itself: sudo ip link set {name} type can restart-ms 100",
}
"""The sentence about a bus in such a state."""


def errors_of(identifier: int, data: bytes) -> set[str]:
    """Return the counters to which an error frame adds one, of its identifier without the flag, and its data."""
    found = {name for bit, name in _CLASSES.items() if identifier & bit}
    details = data.ljust(8, b"\0")
    if identifier & _LOST_ARBITRATION:
        found.add("arbitration_lost")
    if identifier & _CONTROLLER:
        found |= {name for bits, name in _CONTROLLER_STATES.items() if details[1] & bits}
    if identifier & _NO_ACK or (identifier & _PROTOCOL and details[3] == _AT_ACK_SLOT):
        found.add("unacknowledged")
    elif identifier & (_PROTOCOL | _BUS_ERROR):
        found.add("bus_error")
    return found


class BusErrors:
    """The errors that a port has seen since they were last taken; a state is said when the bus gets into it.

    Args:
        name: the interface in messages.
    """

    def __init__(self, name: str):
        self.name = name
        self._counts: Counter[str] = Counter()
        self._said: set[str] = set()

    def add(self, identifier: int, data: bytes) -> None:
        """Count an error frame."""
        found = errors_of(identifier, data)
        self._counts.update(found)
        for state in sorted(found & ADVICE.keys() - self._said):
            _logger.warning("%s %s", self.name, ADVICE[state].format(name=self.name))
        self._said |= found
        if "restarts" in found:
            self._said.clear()

    def take(self) -> list[Event]:
        """Return what was counted since the last call, one event for each counter."""
        events: list[Event] = [Counted(name, count) for name, count in sorted(self._counts.items())]
        self._counts.clear()
        return events
