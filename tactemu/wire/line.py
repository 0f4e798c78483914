"""A line that has a speed: who may send next, and when the last bit has gone.

A serial line sends in order. On a CAN bus, the frames whose nodes are ready when the bus falls idle compete and the
lowest identifier goes first; each node (``source``) offers its own frames in order.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field

from firmware_protocols import CanFrame, CanWire, Frame, SerialWire, Wire
from tactemu.wire.can_bits import frame_ns, priority

CATCH_UP_NS = 5_000_000
"""After a stall of its caller a line makes up for this much at most: no burst, and never more than it can carry."""


@dataclass(order=True, slots=True)
class Pending:
    """A frame on its way to the driver, ordered by when it is ready to leave."""

    ready_ns: int
    number: int
    frame: Frame = field(compare=False)
    source: str = field(compare=False)
    duration_ns: int = field(compare=False, default=0)
    end_ns: int = field(compare=False, default=0)
    """When its last bit has gone; set when it wins the line."""


def duration(wire: Wire, *, pacing: bool = True) -> Callable[[Frame], int]:
    """A function that gives a frame's time on ``wire`` [ns]; zero for USB, TCP and an unpaced line."""
    if pacing and isinstance(wire, CanWire):
        return lambda frame: frame_ns(frame, wire.bitrate, wire.data_bitrate) if isinstance(frame, CanFrame) else 0
    if pacing and isinstance(wire, SerialWire) and not wire.usb:
        byte_ns = wire.bits_per_byte * 1e9 / wire.baud
        return lambda frame: 0 if isinstance(frame, CanFrame) else round(len(frame) * byte_ns)
    return lambda frame: 0


class Line:
    """The queue in front of a line and the line itself: towards the driver, and on a CAN bus for all nodes."""

    def __init__(self, wire: Wire, *, pacing: bool = True):
        self.arbitrates = isinstance(wire, CanWire)
        self.duration = duration(wire, pacing=pacing)
        self.free_ns = 0
        """When the line is idle again."""
        self.busy_ns = 0
        """Time that the line has carried frames."""
        self._queues: defaultdict[str, list[Pending]] = defaultdict(list)
        self._waiting_ns: defaultdict[str, int] = defaultdict(int)
        self._sending: Pending | None = None
        self._number = 0

    def put(self, frame: Frame, ready_ns: int, source: str) -> None:
        """Queue a frame that may leave from ``ready_ns`` on."""
        self._number += 1
        pending = Pending(ready_ns, self._number, frame, source, self.duration(frame))
        queue = source if self.arbitrates else ""
        heapq.heappush(self._queues[queue], pending)
        self._waiting_ns[queue] += pending.duration_ns

    def backlog_ns(self, source: str, now_ns: int) -> int:
        """How far behind this source is: the time that its queue will take, or has waited already if that is more."""
        name = source if self.arbitrates else ""
        queue = self._queues.get(name)
        return max(self._waiting_ns[name], now_ns - queue[0].ready_ns) if queue else 0

    def next_ns(self) -> int | None:
        """When :meth:`take` has something to do."""
        if self._sending is not None:
            return self._sending.end_ns
        heads = [queue[0].ready_ns for queue in self._queues.values() if queue]
        return max(self.free_ns, min(heads)) if heads else None

    def take(self, now_ns: int) -> Pending | None:
        """The next frame whose last bit has gone by ``now_ns``, or ``None``."""
        if self._sending is None:
            self._start(now_ns)
        return self.finish(now_ns)

    def finish(self, now_ns: int) -> Pending | None:
        """As :meth:`take`, but lets no other frame start: for when more may still be offered at this moment."""
        if self._sending is None or self._sending.end_ns > now_ns:
            return None
        sent, self._sending = self._sending, None
        self.free_ns = max(self.free_ns, now_ns - CATCH_UP_NS)
        return sent

    def clear(self) -> list[Pending]:
        """Forget all that has not left, and return it."""
        lost = [pending for queue in self._queues.values() for pending in queue]
        if self._sending is not None:
            lost.insert(0, self._sending)
        self._queues.clear()
        self._waiting_ns.clear()
        self._sending = None
        return lost

    def _start(self, now_ns: int) -> None:
        """Let the frames that are ready when the line falls idle compete, if that moment has come."""
        heads = {name: queue[0] for name, queue in self._queues.items() if queue}
        if not heads:
            return
        start = max(self.free_ns, min(head.ready_ns for head in heads.values()))
        if start > now_ns:
            return
        ready = {name: head for name, head in heads.items() if head.ready_ns <= start}
        winner = min(ready, key=lambda name: _rank(ready[name]))
        pending = heapq.heappop(self._queues[winner])
        self._waiting_ns[winner] -= pending.duration_ns
        pending.end_ns = self.free_ns = start + pending.duration_ns
        self.busy_ns += pending.duration_ns
        self._sending = pending


def _rank(pending: Pending) -> tuple:
    identifier = priority(pending.frame) if isinstance(pending.frame, CanFrame) else ()
    return (*identifier, pending.ready_ns, pending.number)
