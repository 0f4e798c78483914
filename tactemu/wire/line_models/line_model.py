"""Line models: the time of a frame, the order of frames, what each end receives, and the ports of a line.

Also the frames that wait for a line.
"""

from __future__ import annotations

import itertools
import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

from firmware_protocols import CanFrame, Connector, WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.transports.transport import CanFilter

DRIVER = "(driver)"
"""The driver as a node of a shared line."""

_fresh = itertools.count()


Pacing = Literal[True, False, "strict"]
"""Pacing of frames: on, off, or ``strict``, which makes up for no stall."""


@dataclass(order=True, slots=True)
class Pending:
    """A frame, or a run of frames, on its way; sorted in the order of its lane."""

    order: tuple[int, int]
    number: int
    frame: WireFrame | CanFrames = field(compare=False)
    """The frame, or a run of frames that follow one another."""
    source: str = field(compare=False)
    ready_ns: int = field(compare=False)
    """The time from which it may leave."""
    duration_ns: int = field(compare=False, default=0)
    end_ns: int = field(compare=False, default=0)
    """The time at which its last bit has gone; set when it wins the line."""
    sample: int | None = field(compare=False, default=None)
    """The number of the sample that it carries."""
    ends: list[int] | None = field(compare=False, default=None)
    """The end of each frame of a run whose first frame starts at 0 [ns]."""
    gone: int = field(compare=False, default=0)
    """The number of frames of a run that have left."""

    @property
    def frames(self) -> Sequence[WireFrame]:
        """The frames that have not left."""
        return self.frame[self.gone :] if isinstance(self.frame, CanFrames) else [self.frame]

    @property
    def head(self) -> WireFrame:
        """The next frame."""
        return self.frame[self.gone] if isinstance(self.frame, CanFrames) else self.frame


class LineModel(ABC):
    """A kind of line, for one connector."""

    kind: ClassVar[str]
    """The kind of wire in the table of faults: ``serial``, ``can``, ``tcp``, ``udp``, ``websocket`` or ``dds``."""
    schemes: ClassVar[tuple[str, ...]]
    """The transports that can stand for it beside ``memory:``, the usual one first."""
    is_network: ClassVar[bool] = False
    """True for the machine's network, where a program reaches the device by an address, not by a device node."""
    is_shared: ClassVar[bool] = False
    """True where several devices may be on the line."""
    is_half_duplex: ClassVar[bool] = False
    """True where the driver's frames travel on the same line as those of the devices."""
    is_byte_stream: ClassVar[bool] = True
    """True where frames stay in order: those after a frame that a fault holds back wait for it."""

    def __init__(self, connector: Any, *, pacing: Pacing = True):
        self.connector = connector
        self.pacing: Pacing = pacing

    # -- on the line -------------------------------------------------------------------------------------------------

    @abstractmethod
    def duration_ns(self, frame: WireFrame) -> int:
        """Return how long the line is busy with a frame [ns]."""

    def run_ns(self, frames: CanFrames) -> list[int]:
        """Return how long the line is busy with each of many frames [ns]."""
        return [self.duration_ns(frame) for frame in frames]

    def driver_ns(self, frame: WireFrame, setting: Any) -> int:
        """Return how long the driver's end takes to send a frame at the setting of its port [ns]."""
        return self.duration_ns(frame)

    def lane(self, source: str) -> str:
        """Return the name of a source's queue; frames of one queue leave in order."""
        return ""

    def order(self, turn: int, ready_ns: int) -> tuple[int, int]:
        """Return the sort key of a frame in its queue; the smallest goes first."""
        return (0, ready_ns)

    def rank(self, pending: Pending) -> tuple:
        """Return the sort key of a queue that is ready; the smallest goes first."""
        return (pending.ready_ns, pending.number)

    def turnaround_ns(self) -> int:
        """Return the minimum time between the end of a request and the answer to it [ns]."""
        return 0

    def as_received(self, frame: WireFrame, connector: Any, setting: Any, *, to_driver: bool) -> WireFrame:
        """Return what arrives of a frame between a device's connector and a driver with this setting of its port."""
        return frame

    def accepts(self, connector: Any, frame: WireFrame, *, of_peer: bool) -> bool:
        """Return True if a device's connector accepts a frame; ``of_peer``: another device sent it."""
        return not of_peer

    def is_addressed_to(self, connector: Any, frame: WireFrame) -> bool:
        """Return True if a frame of the driver that the connector does not accept was meant for its device."""
        return False

    def collides(self, sender: str) -> bool:
        """Return True if data of the driver are lost because ``sender`` is on the line ("": the line is idle)."""
        return False

    def filters(self, connectors: Iterable[Any]) -> list[CanFilter]:
        """Return the filters of all devices with these connectors, for ports that can filter; empty: no filter."""
        return []

    def echoes(self) -> bool:
        """Return True if the driver receives what it sends."""
        return False

    def carries(self, frame: WireFrame) -> bool:
        """Return True if a frame is of the line's kind."""
        return isinstance(frame, bytes)

    def traffic_ns(self, frame: CanFrame) -> int:
        """Return the time of another node's frame [ns], with or without pacing."""
        return self.duration_ns(frame)

    # -- its ports ---------------------------------------------------------------------------------------------------

    def agrees(self, other: Connector) -> bool:
        """Return True if a device with the ``other`` connector may share the line."""
        plain = {"name": "", "is_plugged": True}
        return self.is_shared and replace(self.connector, **plain) == replace(other, **plain)

    @abstractmethod
    def describe(self) -> str:
        """Return the line in words: ``serial 115200 8N1``, ``CAN 1 Mbit/s`` ..."""

    @abstractmethod
    def usual_port(self, name: str) -> str:
        """Return the port of a device called ``name`` where none is given."""

    @abstractmethod
    def fresh_port(self, name: str) -> str:
        """Return a port that no other run has, for tests that run side by side."""

    @staticmethod
    def fresh_number() -> tuple[int, int]:
        """Return the process id, and a number that this process has not used."""
        return os.getpid(), next(_fresh)
