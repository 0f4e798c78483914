"""A line that has a speed: its model, the frames that wait for it, which is sent next, and when its last bit has gone.

The model says how long a frame takes, which goes first and what each end receives: a serial line sends in order, on a
CAN bus the lowest identifier wins, on a shared half-duplex line answers leave in turn. :mod:`tactemu.wire.line_models`
has the model of each kind of line.
"""

from __future__ import annotations

import heapq
import itertools
import os
import tempfile
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any, ClassVar, Literal

from firmware_protocols import CanFrame, Connector, WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.transports.transport import CanFilter

MAX_CATCH_UP_NS = 5_000_000
"""Maximum time that a line makes up for after a stall of its caller; prevents bursts."""
DRIVER = "(driver)"
"""The driver as a node of a shared line."""
_fresh = itertools.count()

Pacing = Literal[True, False, "strict"]
"""Pacing of frames: on, off, or ``strict``, which makes up for no stall."""


@dataclass(slots=True, eq=False)
class Pending:
    """A frame, or a run of frames, on its way; sorted in the order of its lane."""

    order: tuple[int, int, int]
    """The turn, the time from which it may leave, and the number on the line."""
    frame: WireFrame | CanFrames
    """The frame, or a run of frames that follow one another."""
    source: str
    ready_ns: int
    """The time from which it may leave."""
    duration_ns: int = 0
    sample: int | None = None
    """The number of the sample that it carries."""
    ends: list[int] | None = None
    """The end of each frame of a run whose first frame starts at 0 [ns]."""
    end_ns: int = 0
    """The time at which its last bit has gone; set when it wins the line."""
    gone: int = 0
    """The number of frames of a run that have left."""

    def __lt__(self, other: Pending) -> bool:
        return self.order < other.order

    @property
    def number(self) -> int:
        """The number of the frame on its line."""
        return self.order[2]

    @property
    def frames(self) -> Sequence[WireFrame]:
        """The frames that have not left."""
        return self.frame[self.gone :] if isinstance(self.frame, CanFrames) else [self.frame]

    @property
    def head(self) -> WireFrame:
        """The next frame."""
        return self.frame[self.gone] if isinstance(self.frame, CanFrames) else self.frame


LINE_MODELS: dict[type[Connector], type[LineModel]] = {}
"""The line model of each class of connectors, which names it: ``class CanLine(LineModel, connector=Can)``."""


class LineModel(ABC):
    """A kind of line, for one connector.

    A subclass names the class of connectors whose line it models, and is then found in :data:`LINE_MODELS`.
    """

    kind: ClassVar[str]
    """The name of this kind of wire in messages and lists, such as ``serial``."""
    schemes: ClassVar[tuple[str, ...]]
    """The transports that can stand for it beside ``memory:``, the usual one first."""
    faults: ClassVar[tuple[str, ...]] = ()
    """The words of the faults that it can have beside those that every line can have."""
    only_modelled: ClassVar[Mapping[str, str]] = {}
    """The words of the faults that a real line behind the port cannot have, each with the reason and what can be had
    instead."""
    likely_faults: ClassVar[tuple[str, ...]] = ("silence",)
    """The words of the faults that a driver meets on such a line: of those that are typical of some lines, the judge
    tries these."""
    has_identifiers: ClassVar[bool] = False
    """True if frames have identifiers, by which ``id=`` chooses them."""
    is_network: ClassVar[bool] = False
    """True for the machine's network, where a program reaches the device by an address, not by a device node."""
    is_shared: ClassVar[bool] = False
    """True where several devices may be on the line."""
    is_half_duplex: ClassVar[bool] = False
    """True where the driver's frames travel on the same line as those of the devices."""
    has_settings: ClassVar[bool] = False
    """True where each end has settings of its own, and receives noise if they differ."""
    has_lanes: ClassVar[bool] = False
    """True where each node has a queue of its own; else all frames wait in one."""
    has_turns: ClassVar[bool] = False
    """True where frames leave by the turn that their device gives them, and only then by the time they are ready."""
    turnaround_ns: int = 0
    """The minimum time between the end of a request and the answer to it [ns]."""
    has_echo: bool = False
    """True where the driver receives what it sends."""
    is_byte_stream: ClassVar[bool] = True
    """True where frames stay in order: those after a frame that a fault holds back wait for it."""

    def __init_subclass__(cls, connector: type[Connector] | None = None):
        if connector is not None:
            LINE_MODELS[connector] = cls

    def __init__(self, connector: Any, *, pacing: Pacing = True):
        self.connector = connector
        self.pacing: Pacing = pacing

    # -- on the line -------------------------------------------------------------------------------------------------

    def prepare(self) -> None:
        """Compute what the first frame would otherwise wait for; called before the port opens."""

    @abstractmethod
    def duration_ns(self, frame: WireFrame) -> int:
        """Return how long the line is busy with a frame [ns]."""

    def run_ns(self, frames: CanFrames) -> list[int]:
        """Return how long the line is busy with each of many frames [ns]."""
        return [self.duration_ns(frame) for frame in frames]

    def driver_ns(self, frame: WireFrame, setting: Any) -> int:
        """Return how long the driver's end takes to send a frame at the setting of its port [ns]."""
        return self.duration_ns(frame)

    def rank(self, pending: Pending) -> tuple:
        """Return the sort key of a queue that is ready; the smallest goes first."""
        return (pending.ready_ns, pending.number)

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

    def usual_port(self, name: str) -> str:
        """Return the port of a device called ``name`` where none is given; here a path in ``$TMPDIR``, or ``/tmp``."""
        return f"{self.schemes[0]}:{Path(tempfile.gettempdir()) / f'tactemu-{name}'}"

    def fresh_port(self, name: str) -> str:
        """Return a port that no other run has, for tests that run side by side: a path named after this process."""
        pid, number = self.fresh_number()
        return self.usual_port(f"{pid}-{number}-{name}")

    @staticmethod
    def fresh_number() -> tuple[int, int]:
        """Return the process id, and a number that this process has not used."""
        return os.getpid(), next(_fresh)


class Line:
    """A line and the queue in front of it: for one direction, or for all nodes where there is one line.

    Args:
        line_model: the durations and the order of frames.
        is_paced_by_port: True where the port takes a frame's time itself: a frame is due at its first bit.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_catch_up_ns", "is_paced_by_port")

    def __init__(self, line_model: LineModel, *, is_paced_by_port: bool = False):
        self.line_model = line_model
        self.is_paced_by_port = is_paced_by_port
        self._catch_up_ns = 0 if line_model.pacing == "strict" else MAX_CATCH_UP_NS
        self.free_ns = 0
        """The time at which the line is idle again."""
        self.busy_ns = 0
        """The total time that the line has carried frames."""
        self._lanes: defaultdict[str, list[Pending]] = defaultdict(list)
        self._waiting_ns: defaultdict[str, int] = defaultdict(int)
        self._sending: Pending | None = None
        self._handover_ns = 0
        """The time at which the frame on the line is handed over: of its last bit, or its first if the port paces."""
        self._number = 0

    def put(
        self,
        frame: WireFrame,
        ready_ns: int,
        source: str,
        *,
        turn: int = 0,
        sample: int | None = None,
        took_ns: int | None = None,
    ) -> None:
        """Queue a frame that may leave from ``ready_ns`` on; ``took_ns``: its time on the line if not the model's."""
        self._number += 1
        line_model = self.line_model
        lane = source if line_model.has_lanes else ""
        took = line_model.duration_ns(frame) if took_ns is None else took_ns
        order = (turn if line_model.has_turns else 0, ready_ns, self._number)
        heapq.heappush(self._lanes[lane], Pending(order, frame, source, ready_ns, took, sample))
        self._waiting_ns[lane] += took

    def put_run(self, frames: CanFrames, ready_ns: int, source: str, *, sample: int | None = None) -> None:
        """Queue many frames of one node that are ready together; faster than :meth:`put` of each."""
        if not frames:
            return
        self._number += 1
        lane = source if self.line_model.has_lanes else ""
        ends = list(accumulate(self.line_model.run_ns(frames)))
        order = (0, ready_ns, self._number)
        run = Pending(order, frames, source, ready_ns, ends[-1], sample, ends)
        heapq.heappush(self._lanes[lane], run)
        self._waiting_ns[lane] += ends[-1]

    def backlog_ns(self, source: str, now_ns: int) -> int:
        """Return the backlog of a source: the time that its queue will take, or has waited already if that is more."""
        name = source if self.line_model.has_lanes else ""
        lane = self._lanes.get(name)
        return max(self._waiting_ns[name], now_ns - lane[0].ready_ns) if lane else 0

    def waiting_ns(self, source: str) -> int:
        """Return how long the line will be busy with what a source has queued."""
        return self._waiting_ns[source if self.line_model.has_lanes else ""]

    def sender(self, now_ns: int) -> str:
        """Return the source whose frame is on the line, or "" when it is idle."""
        return self._sending.source if self._sending is not None and now_ns < self._sending.end_ns else ""

    def next_ns(self) -> int | None:
        """Return the time at which :meth:`take` has to be called, or None."""
        if self._sending is not None:
            return self._handover_ns
        waiting = [*filter(None, self._lanes.values())]
        return self._next_start_ns(waiting) if waiting else None

    def take(self, now_ns: int) -> Pending | None:
        """Return the next frame whose last bit has gone by ``now_ns``, or ``None``."""
        if self._sending is None and (waiting := [*filter(None, self._lanes.values())]):
            self._start(waiting, now_ns)
        if self._sending is None or self._handover_ns > now_ns:
            return None
        sent, self._sending = self._sending, None
        self.free_ns = max(self.free_ns, now_ns - self._catch_up_ns)
        return sent

    def finish(self, now_ns: int) -> Pending | None:
        """Return what :meth:`take` returns, but start no other frame, because more may be queued at this moment."""
        return None if self._sending is None else self.take(now_ns)

    def settle(self, now_ns: int) -> list[Pending]:
        """Return all that is queued or on the line, in the order in which it would leave; the line spends no time."""
        settled = []
        while (due_ns := self.next_ns()) is not None:
            if (pending := self.take(due_ns)) is not None:
                pending.end_ns = now_ns
                settled.append(pending)
        self.free_ns = min(self.free_ns, now_ns)
        return settled

    def clear(self) -> list[Pending]:
        """Clear the line and its queue, and return all that has not left."""
        lost = [pending for lane in self._lanes.values() for pending in lane]
        if self._sending is not None:
            lost.insert(0, self._sending)
        self._lanes.clear()
        self._waiting_ns.clear()
        self._sending = None
        return lost

    def withdraw(self, source: str) -> list[Pending]:
        """Remove what a source has queued or on the line, and return it in its order."""
        withdrawn = []
        if self._sending is not None and self._sending.source == source:
            withdrawn, self._sending = [self._sending], None
        for name, lane in self._lanes.items():
            own = sorted(pending for pending in lane if pending.source == source)
            lane[:] = [pending for pending in lane if pending.source != source]
            heapq.heapify(lane)
            self._waiting_ns[name] -= sum(pending.duration_ns for pending in own)
            withdrawn += own
        return withdrawn

    def _start(self, waiting: list[list[Pending]], now_ns: int) -> None:
        """Start the frame of these lanes that wins when the line falls idle, if that moment has come."""
        if (start := self._next_start_ns(waiting)) > now_ns:
            return
        lane = waiting[0]
        if len(waiting) > 1:
            ready = [each for each in waiting if each[0].ready_ns <= start]
            lane = min(ready, key=lambda each: self.line_model.rank(each[0])) if len(ready) > 1 else ready[0]
        if lane[0].ends is None:
            pending = heapq.heappop(lane)
        else:
            pending = self._part_of_run(lane, waiting, start, now_ns)
        self._waiting_ns[pending.source if self.line_model.has_lanes else ""] -= pending.duration_ns
        pending.end_ns = self.free_ns = start + pending.duration_ns
        self._handover_ns = start if self.is_paced_by_port else pending.end_ns
        self.busy_ns += pending.duration_ns
        self._sending = pending

    def _next_start_ns(self, waiting: list[list[Pending]]) -> int:
        """Return when the next frame of these lanes, none of which is empty, starts."""
        ready_ns = waiting[0][0].ready_ns if len(waiting) == 1 else min([lane[0].ready_ns for lane in waiting])
        return ready_ns if ready_ns > self.free_ns else self.free_ns

    def _part_of_run(self, lane: list[Pending], waiting: list[list[Pending]], start: int, now_ns: int) -> Pending:
        """Return the frames of the run at the head of a lane that left by now without a break, or its next frame."""
        run = lane[0]
        ends, first = run.ends, run.gone
        assert ends is not None and isinstance(run.frame, CanFrames)
        zero_ns = start - (ends[first - 1] if first else 0)
        last = first + 1
        is_late = zero_ns + ends[first] < now_ns - self._catch_up_ns  # the frames after this one start later
        if not is_late and last < len(ends) and zero_ns + ends[last] <= now_ns:
            last = bisect_right(ends, now_ns - zero_ns, last)
            if len(waiting) > 1:
                rivals = [other[0] for other in waiting if other is not lane]
                last = self._end_of_lead(run.frame, ends, first, last, zero_ns, rivals)
        if last == len(ends):
            heapq.heappop(lane)
        else:
            run.gone = last
            run.duration_ns = ends[-1] - ends[last - 1]
        took_ns = zero_ns + ends[last - 1] - start
        left = run.frame[first] if last == first + 1 else run.frame[first:last]
        return Pending(run.order, left, run.source, run.ready_ns, took_ns, run.sample)

    def _end_of_lead(
        self, frames: CanFrames, ends: list[int], first: int, last: int, zero_ns: int, rivals: list[Pending]
    ) -> int:
        """Return up to which frame, at most ``last``, a run goes on before a rival's frame wins the line."""
        ready_ns = min([rival.ready_ns for rival in rivals])
        alone = bisect_right(ends, ready_ns - zero_ns - 1, first) + 1  # these start before a rival is ready
        least = min([self.line_model.rank(rival)[0] for rival in rivals])
        idents = frames.array["can_id"][alone:last].tolist()
        return min(last, alone) + next((k for k, ident in enumerate(idents) if ident >= least), len(idents))
