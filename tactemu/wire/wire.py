"""Between devices and port: the wire has a speed, and bytes and frames go wrong on it.

Frames leave when their last bit would have: how long that takes and who goes first is the line model's
(:mod:`tactemu.wire.line_models`). What the driver sends takes its time likewise. A reading that does not fit is dropped
whole and counted; nothing queues without bound. At other settings than the device's the driver hears noise, and so
does the device.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from firmware_protocols import Connector, Sent, WireFrame
from firmware_protocols.can_frames import CanFrames
from firmware_protocols.frames import payload
from tactemu.transports.transport import (
    DROPPED,
    Closed,
    Event,
    LinesChanged,
    Noted,
    Opened,
    Overflowed,
    Received,
    Transport,
)
from tactemu.truth import Truth
from tactemu.wire.faults import Fault, Injector
from tactemu.wire.line import Line
from tactemu.wire.line_models import line_model_for
from tactemu.wire.line_models.line_model import DRIVER, Pacing
from tactemu.wire.pending import Pending

MAX_INBOUND_AHEAD_NS = 50_000_000
"""A driver that is further ahead of its line than this is not read on: its own end holds it up, as a port's does."""
MAX_LEFT_BEHIND_NS = 1_000_000_000
"""Of what a driver leaves behind when it goes, bytes that are further ahead of its line than this are lost."""
DEFAULT_CLOSE_CODE = 1011
"""Code of a connection that a fault closes: something went wrong inside."""
MAX_READ_BYTES_PER_TURN = 16_384
"""Of what arrives in one turn of the loop: a flood is worked off in pieces, and the loop goes on meanwhile."""

MAX_TRAFFIC_FRAMES_PER_FLUSH = 4
"""Maximum number of frames that a node of a fault queues per flush: a device does not wait long for them."""
MAX_POLLS_AT_CLOSE = 100
"""Maximum number of looks at a port that closes, for frames that are left there; bounds the time of closing."""
MAX_TRAFFIC_TIME_SHARE = 0.4
"""Largest share of the loop's time that such frames may take, so that devices sample at their rate on a machine too
slow for all of them; those that it leaves out are counted as missed."""


@dataclass(frozen=True, slots=True)
class ReceivedData:
    """A chunk of bytes or a CAN frame that has arrived at the devices of a wire."""

    data: WireFrame
    source: str = DRIVER
    """Who sent it: the driver, or one of the devices."""


class Wire:
    """One wire of one kind in front of one transport. Several devices may share it (a CAN bus, an RS-485 line).

    The caller gives the time with every call and calls :meth:`receive` and :meth:`flush` at every turn of its loop,
    and no later than :meth:`next_due_ns`.

    Args:
        transport: the port.
        connector: what the device has there: baud rate or bit rates.
        pacing: whether frames take their time. Off, they leave at once; ``"strict"``: none follows another sooner than
            the line could carry it, whatever held the caller up.
        faults: what goes wrong, as text or parsed (:mod:`tactemu.wire.faults`).
        seed: root seed of the faults' random streams.
        truth: where frames and faults are logged.
        backlog_ns: a reading is dropped when its device is further behind than this.

    Raises:
        SceneError: a fault that cannot be parsed, or that this wire cannot have.

    ``counters``: ``sent`` and ``sent_bytes``, ``received`` and ``received_bytes``, ``dropped_readings`` and
    ``dropped_frames`` (the line is full), ``dropped_unread`` (the driver does not read), ``unheard`` (nobody has the
    port open), ``misheard`` (the settings differ), ``overrun`` (the driver was a second ahead of the line),
    ``unprocessed`` (it had been sent when the port closed, and no device had it yet), ``overflow`` (frames that the
    kernel dropped because the loop was too late to take them),
    ``collision`` (it talks while a device does), ``load_missed`` and ``babble_missed`` (frames of other nodes that a
    late loop left out: the share that was asked for is not reached), and injected faults by their kind.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = (
        "transport", "pacing", "backlog_ns", "is_paused", "is_real_time", "name", "_asked", "_opened", "_plugged",
        "_comes_back", "_traffic_ns", "was_opened",
    )  # fmt: skip

    def __init__(
        self,
        transport: Transport,
        connector: Connector,
        *,
        pacing: Pacing = True,
        faults: Iterable[Fault | str] = (),
        seed: int = 0,
        truth: Truth | None = None,
        backlog_ns: int = 20_000_000,
    ):
        self.transport = transport
        self.pacing: Pacing = pacing
        self.truth = truth or Truth()
        self.backlog_ns = backlog_ns
        self.counters: Counter[str] = Counter()
        self.line_model = line_model_for(connector, pacing=pacing)
        self.line = Line(self.line_model)
        """Towards the driver, and from it where there is one line for both."""
        self.inbound = self.line if self.line_model.is_half_duplex else Line(self.line_model)
        self.connectors: dict[str, Connector] = {}
        """What each device on the wire has there, by the device's name."""
        self.name = ""
        """Who is on it, for the truth log of what arrives and of what befalls the wire; default: who sent last."""
        self.is_paused: Callable[[], bool] = bool
        """Whether time stands: then what the driver says is heard at once, and answers leave at once."""
        self.is_real_time = False
        """Whether the caller's time passes by itself."""
        self._traffic_ns = 0
        """When frames of other nodes were sent last."""
        self._asked = False
        """The driver has said something while time stands."""
        self._source = ""
        self._arrived: deque[tuple[int, ReceivedData]] = deque()
        self._held_ns: Counter[str] = Counter()
        """Until when a fault holds a byte stream up, by its direction."""
        self._now_ns = 0
        self._flushed_ns = 0
        """Until when the line has had its chance: what waits since is late by its caller, not by the line."""
        self._down: Fault | None = None
        self._lines: LinesChanged | None = None
        """How the devices were told last that the modem lines are."""
        self._held_open = False
        """Whether they know of a driver that has the port open."""
        self.was_opened = False
        """Whether a driver has had the port open."""
        self._opened = self._plugged = False
        """Whether the port is to be there, and whether it is."""
        self._comes_back = False
        """A driver had the port open when the state was saved: to the devices, the first who opens it has had it."""
        self._injector = Injector(faults, self.line_model, seed, self._note)

    # -- life --------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Make the port.

        Raises:
            TransportError: it cannot be made.
        """
        self.transport.set_connector(self.line_model.connector)
        self.transport.set_filters(self.line_model.filters(self.connectors.values()))
        self._opened = True
        self._plug()

    def _plug(self) -> None:
        """Let the port be there, unless a fault has it away."""
        plugged = self._opened and (self._down is None or self._down.kind != "unplug")
        if plugged != self._plugged:
            (self.transport.open if plugged else self.transport.close)()
            self._plugged = plugged
        self.transport.hold(self._down is not None and self._down.kind == "halfopen")

    def after_restore(self) -> None:
        """A state was restored: the port is as it was, but for who has it open."""
        if self._opened:
            self._plug()
        self._comes_back = self._held_open and not self._plugged and (self._down is None or self._down.kind != "unplug")

    def close(self) -> None:
        """Remove the port, and count what the driver has sent in vain. Safe to call twice."""
        if self._plugged:
            self._count_unprocessed()
        self._opened = self._plugged = False
        self.transport.close()
        self.line.clear()
        self.inbound.clear()
        self._arrived.clear()

    def _count_unprocessed(self) -> None:
        waiting: list[object] = list(self.inbound.withdraw(DRIVER))
        waiting += [heard for _, heard in self._arrived if heard.source == DRIVER]
        for _ in range(MAX_POLLS_AT_CLOSE):  # what the loop was too late to take
            events = self.transport.poll()
            waiting += [event for event in events if isinstance(event, Received)]
            for event in events:
                self._count_overflow(event)
            if not events:
                break
        if waiting:
            self.counters["unprocessed"] += len(waiting)

    def _count_overflow(self, event: Event | ReceivedData) -> bool:
        """Count what the kernel dropped; return False if the event is another."""
        if not isinstance(event, Overflowed):
            return False
        self.counters["overflow"] += event.count
        return True

    def attach(self, source: str, connector: Connector) -> None:
        """A device is on the wire, or its firmware has changed its settings: they hold for what is sent from now on."""
        changed = self.connectors.get(source, connector) != connector
        self.connectors[source] = connector
        if changed:
            self.line_model = line_model_for(connector, pacing=self.pacing)
            self.line.line_model = self.inbound.line_model = self.line_model

    def filenos(self) -> list[int]:
        """File descriptors to select for reading."""
        return self.transport.filenos(self._reading)

    @property
    def _reading(self) -> bool:
        """Whether the line has room for more of what the driver sends."""
        return self.inbound.waiting_ns(DRIVER) <= MAX_INBOUND_AHEAD_NS

    def next_due_ns(self) -> int | None:
        """When :meth:`receive` or :meth:`flush` must be called next, whatever the file descriptors say."""
        if self._arrived:
            return self._arrived[0][0]
        due = self.line.next_ns()
        if self.inbound is not self.line and (comes := self.inbound.next_ns()) is not None:
            due = comes if due is None or comes < due else due
        happens = self._injector.next_ns(self._now_ns)
        return happens if due is None or (happens is not None and happens < due) else due

    # -- faults ------------------------------------------------------------------------------------------------------

    @property
    def faults(self) -> list[Fault]:
        """The faults that are on."""
        return list(self._injector.faults)

    def add_fault(self, fault: Fault | str) -> Fault:
        """Switch a fault on, also while running.

        Raises:
            SceneError: it cannot be parsed, or this wire cannot have it.
        """
        return self._injector.add(fault)

    def remove_fault(self, fault: Fault) -> None:
        """Switch a fault off. What it held back goes on its way.

        Raises:
            ValueError: it is not on.
        """
        for frame, source, direction in self._injector.remove(fault):
            if self.line_model.is_byte_stream:  # a reading of a late loop, ready before now, does not overtake it
                self._held_ns[direction] = max(self._held_ns[direction], self._now_ns)
            if direction == "to_driver":
                self.line.put(frame, self._now_ns, source)
            else:
                self.inbound.put(frame, self._now_ns, DRIVER)
        if fault.kind == "latency" and (left_over := self._injector.unmount_chip()):
            self.transport.write(left_over)

    def _note(
        self,
        t_ns: int,
        source: str,
        kind: str,
        detail: str,
        *,
        before: WireFrame | str = "",
        after: Sequence[WireFrame] = (),
    ) -> None:
        self.counters[kind] += 1
        self.truth.inject(t_ns, source, kind, detail, before=before, after=after)

    # -- to the driver -----------------------------------------------------------------------------------------------

    def send(
        self, frames: Iterable[WireFrame | Sent], now_ns: int, source: str = "", *, sample: int | None = None
    ) -> None:
        """Queue one reading or one answer: all of its frames, or none when the line is full.

        ``sample`` is the number of the sample that they carry.
        """
        if isinstance(frames, CanFrames):
            whole = frames
        else:
            frames = list(frames)
            whole = [each.frame if isinstance(each, Sent) else each for each in frames]
        self._source = source
        if not self.transport.has_reader:
            self._lose(whole, now_ns, source, "unheard", "nobody listens", sample)
        elif self._down is not None:
            self._lose(whole, now_ns, source, "unheard", str(self._down), sample)
        elif self.line.backlog_ns(source, self._seen_ns(now_ns)) > self.backlog_ns:
            self.counters["dropped_readings"] += 1
            self._lose(whole, now_ns, source, "dropped_frames", "line full", sample)
        elif isinstance(frames, CanFrames) and not self._injector.has_frame_faults:
            self.line.put_run(frames, now_ns, source, sample=sample)
        else:
            least = self.line_model.turnaround_ns()
            for each in frames:
                frame, delay_ns, turn = (
                    (each.frame, each.delay_ns, each.turn) if isinstance(each, Sent) else (each, 0, 0)
                )
                ready_ns = now_ns + max(delay_ns, least)
                for changed, held_ns in self._injector.corrupt(frame, now_ns, source, "to_driver"):
                    at = self._after_held("to_driver", ready_ns, held_ns)
                    self.line.put(changed, at, source, turn=turn, sample=sample)

    def _seen_ns(self, now_ns: int) -> int:
        """Return the time that the line has reached: a real loop may be late with it, a virtual one never is."""
        return min(now_ns, self._flushed_ns) if self.is_real_time else now_ns

    def _after_held(self, direction: str, ready_ns: int, held_ns: int) -> int:
        """When a frame leaves that a fault holds back by ``held_ns``; on a byte stream, what follows waits for it."""
        ready_ns += held_ns
        if self.line_model.is_byte_stream:
            ready_ns = max(ready_ns, self._held_ns[direction])
            if held_ns:
                self._held_ns[direction] = ready_ns
        return ready_ns

    def flush(self, now_ns: int) -> int:
        """Write every frame whose last bit has gone; returns how many were written."""
        self._now_ns = self._flushed_ns = now_ns
        began_ns = time.perf_counter_ns() if self.is_real_time and self._injector.traffic else 0
        frames = self._add_traffic(now_ns)
        written = self._settle(self.line, now_ns) if self._asked else 0
        self._asked = False
        while (pending := self.line.take(now_ns)) is not None:
            written += self._pass_on(pending, now_ns)
        if (chip := self._injector.chip) is not None:
            while packet := chip.take(now_ns):
                self.transport.write(packet)
        if (closing := self._injector.closing) is not None:
            self._injector.closing = None
            self.transport.hang_up(closing.amount or DEFAULT_CLOSE_CODE)
        if began_ns and frames:
            self._bound_traffic(now_ns, time.perf_counter_ns() - began_ns)
        return written

    def _bound_traffic(self, now_ns: int, took_ns: int) -> None:
        """Leave out frames of other nodes where they take more than :data:`MAX_TRAFFIC_TIME_SHARE` of the time."""
        excess_ns = round(took_ns / MAX_TRAFFIC_TIME_SHARE) - (now_ns - self._traffic_ns)
        self._traffic_ns = now_ns
        if excess_ns > 0:
            for node in self._injector.traffic:
                node.leave_out(now_ns + excess_ns)
            self._traffic_ns += excess_ns

    def _add_traffic(self, now_ns: int) -> int:
        """Let other nodes of the bus queue the frames that they have ready; returns how many."""
        count = 0
        for node in self._injector.traffic:
            for _ in range(MAX_TRAFFIC_FRAMES_PER_FLUSH):
                if self.line.backlog_ns(node.source, now_ns) > self.backlog_ns or (ready := node.take(now_ns)) is None:
                    break
                due_ns, frame = ready
                count += 1
                self.line.put(frame, due_ns, node.source)
                self._note(due_ns, node.source, node.fault.kind, str(node.fault), after=[frame])
            if missed := node.take_missed():
                self.counters[f"{node.fault.kind}_missed"] += missed
        return count

    def _pass_on(self, pending: Pending, now_ns: int) -> int:
        """What has left the line goes to whom it is for; returns how many frames the driver took."""
        if isinstance(pending.frame, CanFrames):
            return self._pass_run_on(pending, pending.frame, now_ns)
        if pending.source == DRIVER:
            if self.line_model.carries(pending.frame) and not getattr(pending.frame, "is_error_frame", False):
                self._arrived.append((pending.end_ns, ReceivedData(pending.frame)))
                if self.line_model.echoes():
                    self.transport.write(pending.frame)
            return 0
        if len(self.connectors) > 1 and pending.source in self.connectors:
            self._arrived.append((pending.end_ns, ReceivedData(pending.frame, pending.source)))
        return self._write(pending, now_ns)

    def _pass_run_on(self, pending: Pending, frames: CanFrames, now_ns: int) -> int:
        """Return frames of one device that left the line one after another."""
        source = pending.source
        peers = [connector for name, connector in self.connectors.items() if name != source]
        if peers and source in self.connectors:
            for frame in frames:
                if any(self.line_model.accepts(connector, frame, of_peer=True) for connector in peers):
                    self._arrived.append((pending.end_ns, ReceivedData(frame, source)))
        sent = self.transport.write_all(frames)
        if sent < len(frames):
            why = ("dropped_unread", "not read") if self.transport.has_reader else ("unheard", "nobody listens")
            self._lose(frames[sent:], now_ns, source, *why, pending.sample)
            frames = frames[:sent]
        if frames:
            self.counters["sent"] += sent
            self.counters["sent_bytes"] += int(frames.array["len"].sum())
            self.truth.wrote_all(now_ns, source, frames, pending.sample, now_ns - pending.end_ns)
        return sent

    def _write(self, pending: Pending, now_ns: int) -> bool:
        frame, source = pending.head, pending.source
        heard = self._through(frame, source, to_driver=True)
        if isinstance(heard, bytes) and not heard:  # nothing that looks like a byte came out of the noise
            return False
        if not self._hand_over(heard, now_ns):
            why = ("dropped_unread", "not read") if self.transport.has_reader else ("unheard", "nobody listens")
            self._lose([frame], now_ns, source, *why, pending.sample)
            return False
        self.counters["sent"] += 1
        self.counters["sent_bytes"] += len(payload(heard))
        self.truth.wrote(now_ns, source, heard, pending.sample, now_ns - pending.end_ns)
        return True

    def _hand_over(self, frame: WireFrame, now_ns: int) -> bool:
        chip = self._injector.chip
        if chip is None or not isinstance(frame, bytes):
            return self.transport.write(frame)
        if not self.transport.has_reader:
            return False
        if not chip.fault.covers(now_ns):
            return self.transport.write(chip.empty() + frame)
        chip.tick(now_ns)
        chip.put(frame)
        self._note(now_ns, self._source, "latency", "")
        return True

    def _lose(
        self, frames: Iterable[WireFrame], now_ns: int, source: str, counter: str, why: str, sample: int | None = None
    ) -> None:
        for frame in frames:
            self.counters[counter] += 1
            self.truth.dropped(now_ns, source, frame, why, sample)

    # -- from the driver ---------------------------------------------------------------------------------------------

    def receive(self, now_ns: int) -> list[Event | ReceivedData]:
        """What happened by ``now_ns``, oldest first; bytes arrive when their last bit has."""
        self._now_ns = now_ns
        events: list[Event | ReceivedData] = []
        self._follow_outages(self._injector.outage(now_ns), now_ns, events)
        for event in self.transport.poll(self._reading):
            if isinstance(event, Received):
                if self._down is None:
                    self._take(event.data, now_ns)
                continue
            if self._count_overflow(event):
                events.append(Noted(str(event)))
                continue
            if isinstance(event, Closed):
                self._hear_all(events)
                self._forget(now_ns, "closed")
            if self._is_news(event):
                events.append(event)
        if self.inbound is not self.line:
            while (pending := self.inbound.take(now_ns)) is not None:
                self._pass_on(pending, now_ns)
        elif (pending := self.line.finish(now_ns)) is not None:
            self._pass_on(pending, now_ns)
        self._deliver(now_ns, events)
        return events

    def deliver(self, data: WireFrame, now_ns: int) -> None:
        """Something of a driver's has arrived that was not on this line, such as that of an earlier run."""
        self._arrived.append((now_ns, ReceivedData(data)))

    def _is_news(self, event: Event) -> bool:
        """Whether the devices do not know it; they do not notice that a restored run has another port."""
        known = self._comes_back and (isinstance(event, Opened) or event == self._lines)
        match event:
            case Opened() | Closed():
                self.was_opened = True
                self._held_open, self._comes_back = isinstance(event, Opened), known
            case LinesChanged():
                self._lines, self._comes_back = event, False
        return not known

    def _take(self, data: WireFrame, now_ns: int) -> None:
        """The driver has sent something; while time stands it is there at once, and so is what was on the line."""
        if not self.is_paused():
            self._arrive(data, now_ns)
            return
        self._asked = True
        self._settle(self.line, now_ns)
        self._arrive(data, now_ns)
        self._settle(self.inbound, now_ns)

    def _settle(self, line: Line, now_ns: int) -> int:
        """What is on a line has arrived; returns how many frames the driver took."""
        return sum(self._pass_on(pending, now_ns) for pending in line.settle(now_ns))

    def _hear_all(self, events: list[Event | ReceivedData]) -> None:
        """The port closes: what the driver has sent arrives at once."""
        if self.line_model.is_byte_stream:  # on a bus what has not left its node never does
            for pending in self.inbound.withdraw(DRIVER):
                self._arrived.append((self._now_ns, ReceivedData(pending.head)))
        self._deliver(None, events)

    def _follow_outages(self, fault: Fault | None, now_ns: int, events: list[Event | ReceivedData]) -> None:
        """Pull the plug or leave the bus when it is time, and come back.

        Raises:
            TransportError: the port cannot be made again.
        """
        if fault is self._down:
            return
        self._down, self._comes_back = fault, False
        if fault is not None:
            self._note(now_ns, self._owner, fault.kind, str(fault))
            self._hear_all(events)
            self._forget(now_ns, fault.kind)
        if fault is not None and fault.kind == "unplug":
            if self.transport.has_reader and not self.line_model.is_half_duplex:  # a bus has no open and close
                events += (Closed(), DROPPED)
                self._held_open, self._lines = False, DROPPED
        self._plug()
        if fault is not None and fault.name:
            self.transport.rename(fault.name)

    def _forget(self, now_ns: int, why: str) -> None:
        """Nothing is kept for whoever comes next."""
        self.inbound.free_ns = now_ns
        for lost in self.line.clear():
            if lost.source != DRIVER:
                self._lose(lost.frames, now_ns, lost.source, "unheard", why, lost.sample)
        held = [frame for frame, _, way in self._injector.forget() if way == "to_driver"]
        self._lose(held, now_ns, self._owner, "unheard", why)

    def _arrive(self, data: WireFrame, now_ns: int) -> None:
        """The driver has sent something: it takes its time on the line."""
        for part, held_ns in self._injector.corrupt(data, now_ns, self._owner, "from_driver"):
            if self.inbound.waiting_ns(DRIVER) > MAX_LEFT_BEHIND_NS:
                self.counters["overrun"] += 1
            elif self.line_model.collides(self.line.sender(now_ns)):
                self.counters["collision"] += 1
            else:
                at = self._after_held("from_driver", now_ns, held_ns)
                took_ns = self.line_model.driver_ns(part, self.transport.setting)
                self.inbound.put(part, at, DRIVER, took_ns=took_ns)

    @property
    def _owner(self) -> str:
        return self.name or self._source

    def _deliver(self, now_ns: int | None, events: list[Event | ReceivedData]) -> None:
        size = 0
        while self._arrived and (now_ns is None or self._arrived[0][0] <= now_ns) and size < MAX_READ_BYTES_PER_TURN:
            end_ns, heard = self._arrived.popleft()
            size += len(payload(heard.data))
            if heard.source == DRIVER:
                if len(self.connectors) < 2:  # else each device hears it in its own way: `received_by`
                    heard = ReceivedData(self._through(heard.data, self._owner, to_driver=False))
                    if heard.data == b"":
                        continue
                self.counters["received"] += 1
                self.counters["received_bytes"] += len(payload(heard.data))
                self.truth.received(end_ns, self._owner, heard.data)
            events.append(heard)

    def received_by(self, source: str, heard: ReceivedData) -> WireFrame | None:
        """What a device on the wire hears of a frame; ``None``: its connector lets nothing in."""
        connector, of_peer = self.connectors[source], heard.source != DRIVER
        if heard.source == source or not self.line_model.accepts(connector, heard.data, of_peer=of_peer):
            return None
        if of_peer or len(self.connectors) < 2:
            return heard.data
        return self._through(heard.data, source, to_driver=False) or None

    def is_addressed_to(self, source: str, heard: ReceivedData) -> bool:
        """Whether a frame of the driver's was meant for a device that does not let it in."""
        return heard.source == DRIVER and self.line_model.is_addressed_to(self.connectors[source], heard.data)

    def _through(self, frame: WireFrame, source: str, *, to_driver: bool) -> WireFrame:
        """Return a frame as heard at the other end, whose settings may differ."""
        connector = self.connectors.get(source, self.line_model.connector)
        result = self.line_model.as_received(frame, connector, self.transport.setting, to_driver=to_driver)
        if result is not frame:
            self.counters["misheard"] += result != frame
        return result


__all__ = ["DRIVER", "ReceivedData", "Wire"]
