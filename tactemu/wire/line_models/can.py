"""A CAN bus: exact frame times with their stuff bits; of the frames that are ready the lowest identifier goes first."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from firmware_protocols import Can, CanFrame, WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.transports.transport import CanFilter
from tactemu.wire import can_bits
from tactemu.wire.can_bits import frame_ns, priority, run_ns
from tactemu.wire.line import LineModel, Pending

MULTICAST = "can:udp_multicast:239.74.163.2"
"""The default group of python-can: a CAN bus for machines whose kernel has none."""
GROUPS = 254**2
"""Number of multicast groups, 239.74.1.1 to 239.74.254.254, among which :meth:`CanLine.fresh_port` chooses."""


class CanLine(LineModel, connector=Can):
    """Every node offers its own frames in order; the driver is one of the nodes."""

    kind = "can"
    schemes = ("can", "slcan", "socketcand", "gsusb")
    faults = ("error", "busoff", "babble", "load")
    only_modelled = {
        "error": "only controllers send error frames; join CAN_H and CAN_L for a moment",
        "busoff": "only a controller leaves the bus; sudo ip link set can0 down, or use 'silence both'",
        "babble": "its arbitration is among nodes; on another adapter: cangen can1 -g 0 -I 000",
        "load": "its arbitration is among nodes; on another adapter: cangen can1 -g 1 -I 600",
    }
    likely_faults = ("truncate", "reorder", "stray", "error", "busoff", "load")
    has_identifiers = True
    has_lanes = True
    is_shared = True
    is_half_duplex = True
    is_byte_stream = False

    def prepare(self) -> None:
        """Compute the tables of stuff bits and of the CRC."""
        can_bits.tables()

    def duration_ns(self, frame: WireFrame) -> int:
        """Return the exact time of a frame [ns], intermission included; 0 without pacing."""
        connector = self.connector
        if not self.pacing or not isinstance(frame, CanFrame):
            return 0
        return frame_ns(frame, connector.bitrate, connector.data_bitrate)

    def run_ns(self, frames: CanFrames) -> list[int]:
        """Return the exact time of each frame [ns], intermission included; 0 without pacing."""
        return run_ns(frames, self.connector.bitrate) if self.pacing else [0] * len(frames)

    def traffic_ns(self, frame: CanFrame) -> int:
        """Return the exact time of a frame [ns], intermission included, with or without pacing."""
        return frame_ns(frame, self.connector.bitrate, self.connector.data_bitrate)

    def rank(self, pending: Pending) -> tuple:
        """Return the rank of the next frame: its arbitration priority, then the time at which it was ready."""
        frame = pending.head
        identifier = priority(frame) if isinstance(frame, CanFrame) else ()
        return (*identifier, pending.ready_ns, pending.number)

    def accepts(self, connector: Any, frame: WireFrame, *, of_peer: bool) -> bool:
        """Return True if the controller's filters take a frame; without filters, if the driver has sent it."""
        if not connector.filters:
            return not of_peer
        return _is_one_of(connector.filters, frame)

    def is_addressed_to(self, connector: Any, frame: WireFrame) -> bool:
        """Return True if a frame has one of the identifiers that are meant for the device."""
        return _is_one_of(connector.addressed, frame)

    def filters(self, connectors: Iterable[Any]) -> list[CanFilter]:
        """Return the filters of all controllers and the identifiers meant for them; empty if one takes all."""
        connectors = list(connectors)
        if not connectors or not all(connector.filters for connector in connectors):
            return []
        pairs = [pair for connector in connectors for pair in (*connector.filters, *connector.addressed)]
        return [CanFilter(ident, mask, max(ident, mask) > 0x7FF) for ident, mask in pairs]

    def carries(self, frame: WireFrame) -> bool:
        """Return True for a CAN frame."""
        return isinstance(frame, CanFrame)

    def agrees(self, other: Any) -> bool:
        """Return True if the bit rates are equal; filters may differ."""
        mine = (type(self.connector), self.connector.bitrate, self.connector.data_bitrate)
        return mine == (type(other), getattr(other, "bitrate", 0), getattr(other, "data_bitrate", 0))

    def describe(self) -> str:
        """Return the line in words: ``CAN 1 Mbit/s``, ``CAN-FD 1 / 5 Mbit/s``."""
        c = self.connector
        data = f" / {c.data_bitrate / 1e6:g}" if c.data_bitrate else ""
        return f"CAN{'-FD' if data else ''} {c.bitrate / 1e6:g}{data} Mbit/s"

    def usual_port(self, name: str) -> str:
        """Return ``vcan0`` if there is one, else a multicast group."""
        return "can:socketcan:vcan0" if os.path.exists("/sys/class/net/vcan0") else MULTICAST

    def fresh_port(self, name: str) -> str:
        """Return a multicast group that depends on the process and differs on each call.

        On Linux a driver on one multicast group receives all others on its UDP port. Where that matters, give both
        processes another port, ``CAN_CONFIG='{"port": 43200}'`` (python-can reads it).
        """
        pid, number = self.fresh_number()
        high, low = divmod((pid * 31 + number) % GROUPS, 254)
        return f"can:udp_multicast:239.74.{high + 1}.{low + 1}"


def _is_one_of(pairs: Iterable[tuple[int, int]], frame: WireFrame) -> bool:
    return isinstance(frame, CanFrame) and any(frame.arbitration_id & mask == ident for ident, mask in pairs)
