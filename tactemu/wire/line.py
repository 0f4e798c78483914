"""A line that has a speed: which frame is sent next, and when its last bit has gone.

The line model (:mod:`tactemu.wire.line_models`) says how long a frame takes and which goes first: a serial line sends
in order, on a CAN bus the lowest identifier wins, on a shared half-duplex line answers leave in turn.
"""

from __future__ import annotations

import heapq
from bisect import bisect_right
from collections import defaultdict
from itertools import accumulate
from typing import ClassVar

from firmware_protocols import WireFrame
from firmware_protocols.can_frames import CanFrames
from tactemu.wire.line_models.line_model import LineModel, Pending

MAX_CATCH_UP_NS = 5_000_000
"""Maximum time that a line makes up for after a stall of its caller; prevents bursts."""


class Line:
    """A line and the queue in front of it: for one direction, or for all nodes where there is one line."""

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("_catch_up_ns",)

    def __init__(self, line_model: LineModel):
        self.line_model = line_model
        self._catch_up_ns = 0 if line_model.pacing == "strict" else MAX_CATCH_UP_NS
        self.free_ns = 0
        """The time at which the line is idle again."""
        self.busy_ns = 0
        """The total time that the line has carried frames."""
        self._lanes: defaultdict[str, list[Pending]] = defaultdict(list)
        self._waiting_ns: defaultdict[str, int] = defaultdict(int)
        self._sending: Pending | None = None
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
        lane = line_model.lane(source)
        took = line_model.duration_ns(frame) if took_ns is None else took_ns
        order = line_model.order(turn, ready_ns)
        heapq.heappush(self._lanes[lane], Pending(order, self._number, frame, source, ready_ns, took, sample=sample))
        self._waiting_ns[lane] += took

    def put_run(self, frames: CanFrames, ready_ns: int, source: str, *, sample: int | None = None) -> None:
        """Queue many frames of one node that are ready together; faster than :meth:`put` of each."""
        if not frames:
            return
        self._number += 1
        line_model = self.line_model
        lane = line_model.lane(source)
        ends = list(accumulate(line_model.run_ns(frames)))
        order = line_model.order(0, ready_ns)
        run = Pending(order, self._number, frames, source, ready_ns, ends[-1], sample=sample, ends=ends)
        heapq.heappush(self._lanes[lane], run)
        self._waiting_ns[lane] += ends[-1]

    def backlog_ns(self, source: str, now_ns: int) -> int:
        """Return the backlog of a source: the time that its queue will take, or has waited already if that is more."""
        name = self.line_model.lane(source)
        lane = self._lanes.get(name)
        return max(self._waiting_ns[name], now_ns - lane[0].ready_ns) if lane else 0

    def waiting_ns(self, source: str) -> int:
        """Return how long the line will be busy with what a source has queued."""
        return self._waiting_ns[self.line_model.lane(source)]

    def sender(self, now_ns: int) -> str:
        """Return the source whose frame is on the line, or "" when it is idle."""
        return self._sending.source if self._sending is not None and now_ns < self._sending.end_ns else ""

    def next_ns(self) -> int | None:
        """Return the time at which :meth:`take` has to be called, or None."""
        if self._sending is not None:
            return self._sending.end_ns
        heads = [lane[0].ready_ns for lane in self._lanes.values() if lane]
        return max(self.free_ns, min(heads)) if heads else None

    def take(self, now_ns: int) -> Pending | None:
        """Return the next frame whose last bit has gone by ``now_ns``, or ``None``."""
        if self._sending is None:
            self._start(now_ns)
        return self.finish(now_ns)

    def finish(self, now_ns: int) -> Pending | None:
        """Return what :meth:`take` returns, but start no other frame, because more may be queued at this moment."""
        if self._sending is None or self._sending.end_ns > now_ns:
            return None
        sent, self._sending = self._sending, None
        self.free_ns = max(self.free_ns, now_ns - self._catch_up_ns)
        return sent

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

    def _start(self, now_ns: int) -> None:
        """Start the frame that wins among those that are ready when the line falls idle, if that moment has come."""
        waiting = [(name, lane) for name, lane in self._lanes.items() if lane]
        if not waiting:
            return
        start = max(self.free_ns, min([lane[0].ready_ns for _, lane in waiting]))
        if start > now_ns:
            return
        contenders = waiting
        if len(waiting) > 1:
            waiting = [entry for entry in waiting if entry[1][0].ready_ns <= start]
            waiting.sort(key=lambda entry: self.line_model.rank(entry[1][0]))
        name, lane = waiting[0]
        if lane[0].ends is None:
            pending = heapq.heappop(lane)
        else:
            pending = self._part_of_run(lane, [other[0] for _, other in contenders if other is not lane], start, now_ns)
        self._waiting_ns[name] -= pending.duration_ns
        pending.end_ns = self.free_ns = start + pending.duration_ns
        self.busy_ns += pending.duration_ns
        self._sending = pending

    def _part_of_run(self, lane: list[Pending], rivals: list[Pending], start: int, now_ns: int) -> Pending:
        """Return the frames of the run at the head of a lane that left by now without a break, or its next frame."""
        run = lane[0]
        ends, first = run.ends, run.gone
        assert ends is not None and isinstance(run.frame, CanFrames)
        zero_ns = start - (ends[first - 1] if first else 0)
        last = bisect_right(ends, now_ns - zero_ns, first)
        if last - first > 1 and zero_ns + ends[first] < now_ns - self._catch_up_ns:
            last = first + 1  # the line was idle: the frames after this one start later
        if last - first > 1 and rivals:
            ready_ns = min([rival.ready_ns for rival in rivals])
            alone = bisect_right(ends, ready_ns - zero_ns - 1, first) + 1  # these start before a rival is ready
            least = min([self.line_model.rank(rival)[0] for rival in rivals])
            while alone < last and run.frame.array["can_id"][alone] < least:
                alone += 1
            last = min(last, alone)
        last = max(last, first + 1)
        if last == len(ends):
            heapq.heappop(lane)
        else:
            run.gone = last
            run.duration_ns = ends[-1] - ends[last - 1]
        took_ns = zero_ns + ends[last - 1] - start
        return Pending(
            run.order, run.number, run.frame[first:last], run.source, run.ready_ns, took_ns, sample=run.sample
        )
