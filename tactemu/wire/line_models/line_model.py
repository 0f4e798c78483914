"""A line model: how long a frame takes, who goes first, what each end receives, and where the line can lead."""

from __future__ import annotations

import itertools
import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, ClassVar, Literal

from firmware_protocols import CanFrame, Connector, WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.transports.transport import CanFilter
from tactemu.wire.pending import Pending

DRIVER = "(driver)"
"""The driver as a node of a shared line."""

_fresh = itertools.count()


Pacing = Literal[True, False, "strict"]
"""Whether frames take their time on the line; ``strict``: also after a stall, for which nothing is made up."""


class LineModel(ABC):
    """One kind of line, for one connector."""

    kind: ClassVar[str]
    """The word by which faults know it: ``serial``, ``can``, ``tcp``, ``udp``."""
    schemes: ClassVar[tuple[str, ...]]
    """Transports that can stand for it beside ``memory:``, the usual one first."""
    is_network: ClassVar[bool] = False
    """It is the machine's network, where a program reaches the device by an address rather than a node."""
    is_shared: ClassVar[bool] = False
    """Several devices may be on it."""
    is_half_duplex: ClassVar[bool] = False
    """The driver's frames travel on the same line as the devices'."""
    is_byte_stream: ClassVar[bool] = True
    """A byte stream: what a fault holds back holds up what follows."""

    def __init__(self, connector: Any, *, pacing: Pacing = True):
        self.connector = connector
        self.pacing: Pacing = pacing

    # -- on the line -------------------------------------------------------------------------------------------------

    @abstractmethod
    def duration_ns(self, frame: WireFrame) -> int:
        """How long the line is busy with a frame [ns]."""

    def run_ns(self, frames: CanFrames) -> list[int]:
        """How long it is busy with each of many frames [ns]."""
        return [self.duration_ns(frame) for frame in frames]

    def driver_ns(self, frame: WireFrame, setting: Any) -> int:
        """How long the driver's end takes to send a frame, at the setting of its port [ns]."""
        return self.duration_ns(frame)

    def lane(self, source: str) -> str:
        """Return the queue of a source: frames of one lane leave in order."""
        return ""

    def order(self, turn: int, ready_ns: int) -> tuple[int, int]:
        """Which frame of a lane goes first: the one with the smallest."""
        return (0, ready_ns)

    def rank(self, pending: Pending) -> tuple:
        """Which of several lanes that are ready goes first: the one with the smallest."""
        return (pending.ready_ns, pending.number)

    def turnaround_ns(self) -> int:
        """Least time from what a device heard to its answer [ns]."""
        return 0

    def as_received(self, frame: WireFrame, connector: Any, setting: Any, *, to_driver: bool) -> WireFrame:
        """What arrives of a frame between a device's connector and a driver with this setting of its port."""
        return frame

    def accepts(self, connector: Any, frame: WireFrame, *, of_peer: bool) -> bool:
        """Whether a device's connector lets a frame in; ``of_peer``: another device sent it."""
        return not of_peer

    def is_addressed_to(self, connector: Any, frame: WireFrame) -> bool:
        """Whether a frame of the driver's that the connector does not let in was meant for its device."""
        return False

    def collides(self, sender: str) -> bool:
        """Whether the driver talks into what ``sender`` has on the line ("" for an idle line), so that it is lost."""
        return False

    def filters(self, connectors: Iterable[Any]) -> list[CanFilter]:
        """What the devices with these connectors listen to, for ports that can filter; empty: to everything."""
        return []

    def echoes(self) -> bool:
        """Whether the driver hears what it sends."""
        return False

    def carries(self, frame: WireFrame) -> bool:
        """Whether a frame is of the line's kind."""
        return isinstance(frame, bytes)

    def traffic_ns(self, frame: CanFrame) -> int:
        """Return time of a foreign node's frame, paced or not [ns]."""
        return self.duration_ns(frame)

    # -- where it leads ----------------------------------------------------------------------------------------------

    def agrees(self, other: Connector) -> bool:
        """Whether a device with the ``other`` connector may share the line."""
        plain = {"name": "", "plugged": True}
        return self.is_shared and replace(self.connector, **plain) == replace(other, **plain)

    @abstractmethod
    def describe(self) -> str:
        """``serial 115200 8N1``, ``CAN 1 Mbit/s`` ..."""

    @abstractmethod
    def usual_port(self, name: str) -> str:
        """Where a device called ``name`` is put when nobody says."""

    @abstractmethod
    def fresh_port(self, name: str) -> str:
        """Return a port that nobody else has, for tests that run side by side."""

    @staticmethod
    def fresh_number() -> tuple[int, int]:
        """This process, and a number that it has not used."""
        return os.getpid(), next(_fresh)
