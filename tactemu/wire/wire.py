"""Between devices and port: the wire has a speed, and bytes and frames go wrong on it.

Frames leave when their last bit would have; the line model (:mod:`tactemu.wire.line_models`) says how long that takes
and which frame goes first. The driver's data take their time likewise. A reading that does not fit is dropped with all
of its frames and counted; no queue grows without bound. Where driver and device have different settings, both receive
noise.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar

from firmware_protocols import Connector, Sent, WireFrame
from firmware_protocols.can_frames import CanFrames
from firmware_protocols.frames import payload
from tactemu.transports.transport import DROPPED, Closed, Event, Noted, Received, Transport
from tactemu.truth import Truth
from tactemu.wire.faults import Fault
from tactemu.wire.faults.fault import Outage
from tactemu.wire.faults.link import LatencyChip
from tactemu.wire.line import DRIVER, Line, Pacing, Pending
from tactemu.wire.wire_port import ReceivedData, WirePort

MAX_INBOUND_AHEAD_NS = 50_000_000
"""Maximum lead of a driver over its line; beyond it the wire stops reading, and the driver blocks as on a real port."""
MAX_LEFT_BEHIND_NS = 1_000_000_000
"""Maximum lead of a driver over its line when it closes the port; its bytes beyond that are lost."""
MAX_READ_BYTES_PER_TURN = 16_384
"""Maximum number of bytes delivered per loop iteration; bounds the delay that a flooding driver can cause."""
MAX_TRAFFIC_FRAMES_PER_FLUSH = 4
"""Maximum number of frames that a node of a fault queues per flush: a device does not wait long for them."""
MAX_TRAFFIC_TIME_SHARE = 0.4
"""Largest share of the loop's time that such frames may take, so that devices sample at their rate on a machine too
slow for all of them; frames that are left out are counted as missed."""


class Wire(WirePort):
    """One wire of one kind in front of one transport. Several devices may share it (a CAN bus, an RS-485 line).

    The caller passes the time with every call. It calls :meth:`receive` and :meth:`flush` at every turn of its loop,
    and no later than :meth:`next_due_ns`.

    Args:
        transport: the port.
        connector: what the device has there: baud rate or bit rates.
        pacing: True where frames take their time. Without it they leave at once; ``"strict"``: also after a stall of
            the caller no frame follows another sooner than the line can carry it.
        faults: what goes wrong, as text or parsed (:mod:`tactemu.wire.faults`).
        seed: root seed of the faults' random streams.
        truth: where frames and faults are logged.
        backlog_ns: a reading is dropped when its device is further behind than this.

    Raises:
        SceneError: a fault that cannot be parsed, or that this wire cannot have.

    ``counters``: ``sent`` and ``sent_bytes``, ``received`` and ``received_bytes``, ``dropped_readings`` and
    ``dropped_frames`` (the line is full), ``dropped_unread`` (the driver does not read), ``unheard`` (no driver has
    the port open), ``misheard`` (the settings differ), ``overrun`` (the driver was a second ahead of the line),
    ``unprocessed`` (data of the driver that no device had when the port closed), ``overflow`` (frames that the kernel
    dropped because the loop was too late to take them), ``framing``, ``parity``, ``uart_overrun``, ``breaks`` and
    ``buffer_overrun`` (counted by a real UART), ``bus_error``, ``unacknowledged``, ``arbitration_lost``,
    ``error_warning``, ``error_passive``, ``bus_off``, ``restarts`` and others (of a real CAN controller),
    ``collision`` (the driver sends while a device does), ``load_missed`` and ``babble_missed`` (frames of other nodes
    that a late loop left out), and faults by their kind.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = (
        "transport", "pacing", "backlog_ns", "is_paused", "is_real_time", "name", "was_opened", "_has_paused_request",
        "_is_open", "_is_plugged", "_is_resuming", "_traffic_ns",
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
        super().__init__(transport, connector, pacing=pacing, faults=faults, seed=seed, truth=truth)
        self.backlog_ns = backlog_ns
        self.is_paused: Callable[[], bool] = bool
        """Return True while the clock is paused; requests then arrive at once, and answers leave at once."""
        self.is_real_time = False
        """True where the caller's time passes by itself."""
        self._traffic_ns = 0
        """The time at which frames of other nodes were last sent."""
        self._has_paused_request = False
        """True after a request of the driver that arrived while the clock was paused, until the next flush."""
        self._flushed_ns = 0
        """The time of the last flush; frames that wait since then are late because of the caller, not of the line."""

    def filenos(self) -> list[int]:
        """Return file descriptors to select for reading."""
        return self.transport.filenos(self._is_reading)

    @property
    def _is_reading(self) -> bool:
        """True while the line has room for more data of the driver."""
        return self.inbound.waiting_ns(DRIVER) <= MAX_INBOUND_AHEAD_NS

    def next_due_ns(self) -> int | None:
        """Return when :meth:`receive` or :meth:`flush` must be called next, whether or not a descriptor is readable."""
        if self._arrived:
            return self._arrived[0][0]
        due = self.line.next_ns()
        if self.inbound is not self.line and (inbound_ns := self.inbound.next_ns()) is not None:
            due = inbound_ns if due is None or inbound_ns < due else due
        fault_ns = self._injector.next_ns(self._now_ns) if self._injector.faults else None
        return fault_ns if due is None or (fault_ns is not None and fault_ns < due) else due

    # -- to the driver -----------------------------------------------------------------------------------------------

    def send(
        self, frames: Iterable[WireFrame | Sent], now_ns: int, source: str = "", *, sample: int | None = None
    ) -> None:
        """Queue one reading or one answer: all of its frames, or none when the line is full.

        ``sample`` is the number of the sample that the frames carry.
        """
        self._source = source
        seen_ns = min(now_ns, self._flushed_ns) if self.is_real_time else now_ns  # a real loop may be late
        if not self.transport.has_reader:
            counter, why = "unheard", "no reader"
        elif self._down is not None:
            counter, why = "unheard", str(self._down)
        elif self.line.backlog_ns(source, seen_ns) > self.backlog_ns:
            self.counters["dropped_readings"] += 1
            counter, why = "dropped_frames", "line full"
        else:
            self._queue(frames, now_ns, source, sample)
            return
        lost = [each.frame if isinstance(each, Sent) else each for each in frames]
        self._lose(lost, now_ns, source, counter, why, sample)

    def _queue(self, frames: Iterable[WireFrame | Sent], now_ns: int, source: str, sample: int | None) -> None:
        """Put frames on the line, as the faults leave them."""
        is_undisturbed = not self._injector.frame_faults and not self._held_ns
        if is_undisturbed and isinstance(frames, CanFrames):
            self.line.put_run(frames, now_ns, source, sample=sample)
            return
        least = self.line_model.turnaround_ns
        for each in frames:
            frame, delay_ns, turn = (each.frame, each.delay_ns, each.turn) if isinstance(each, Sent) else (each, 0, 0)
            ready_ns = now_ns + (delay_ns if delay_ns > least else least)
            if is_undisturbed:
                self.line.put(frame, ready_ns, source, turn=turn, sample=sample)
                continue
            for changed, held_ns in self._injector.corrupt(frame, now_ns, source, "to_driver"):
                at = self._after_held("to_driver", ready_ns, held_ns)
                self.line.put(changed, at, source, turn=turn, sample=sample)

    def _after_held(self, direction: str, ready_ns: int, held_ns: int) -> int:
        """Return when a frame leaves that a fault holds back by ``held_ns``; later bytes of a stream wait for it."""
        ready_ns += held_ns
        if self.line_model.is_byte_stream:
            ready_ns = max(ready_ns, self._held_ns[direction])
            if held_ns:
                self._held_ns[direction] = ready_ns
        return ready_ns

    def flush(self, now_ns: int) -> int:
        """Write every frame whose last bit has gone, and return how many were written."""
        self._now_ns = self._flushed_ns = now_ns
        began_ns = time.perf_counter_ns() if self.is_real_time and self._injector.traffic else 0
        frames = self._add_traffic(now_ns) if self._injector.traffic else 0
        written = self._settle(self.line, now_ns) if self._has_paused_request else 0
        self._has_paused_request = False
        while (pending := self.line.take(now_ns)) is not None:
            written += self._pass_on(pending, now_ns)
        if (chip := self._injector.chip) is not None:
            while packet := chip.take(now_ns):
                self.transport.write(packet)
        if (code := self._injector.close_code) is not None:
            self._injector.close_code = None
            self.transport.hang_up(code)
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
        """Queue the frames that other nodes of the bus have ready, and return how many."""
        count = 0
        for node in self._injector.traffic:
            for _ in range(MAX_TRAFFIC_FRAMES_PER_FLUSH):
                if self.line.backlog_ns(node.source, now_ns) > self.backlog_ns or (ready := node.take(now_ns)) is None:
                    break
                due_ns, frame = ready
                count += 1
                self.line.put(frame, due_ns, node.source)
                self._note(due_ns, node.source, node.fault.word, str(node.fault), after=[frame])
            if missed := node.take_missed():
                self.counters[f"{node.fault.word}_missed"] += missed
        return count

    def _pass_on(self, pending: Pending, now_ns: int) -> int:
        """Pass a frame that has left the line to its receivers, and return how many frames the driver took."""
        frame = pending.frame
        if isinstance(frame, CanFrames):
            return self._pass_run_on(pending, frame, now_ns)
        if pending.source == DRIVER:
            if self.line_model.carries(frame) and not getattr(frame, "is_error_frame", False):
                self._arrived.append((pending.end_ns, ReceivedData(frame)))
                if self.line_model.has_echo and not self.line.is_paced_by_port:  # a real adapter does so itself
                    self.transport.write(frame)
            return 0
        if len(self.connectors) > 1:
            self._pass_to_peers([frame], pending)
        return self._write(pending, frame, now_ns)

    def _pass_run_on(self, pending: Pending, frames: CanFrames, now_ns: int) -> int:
        """Pass on frames of one device that left the line one after another; return how many the driver took."""
        source = pending.source
        if len(self.connectors) > 1:
            self._pass_to_peers(frames, pending)
        sent = self.transport.write_all(frames)
        if sent < len(frames):
            why = ("dropped_unread", "not read") if self.transport.has_reader else ("unheard", "no reader")
            self._lose(frames[sent:], now_ns, source, *why, pending.sample)
            frames = frames[:sent]
        if frames:
            self.counters["sent"] += sent
            self.counters["sent_bytes"] += int(frames.array["len"].sum())
            self.truth.wrote_all(now_ns, source, frames, pending.sample, now_ns - pending.end_ns)
        return sent

    def _write(self, pending: Pending, frame: WireFrame, now_ns: int) -> bool:
        source, chip, received = pending.source, self._injector.chip, frame
        if self.line_model.has_settings:
            received = self._as_received(frame, source, to_driver=True)
            if received == b"":  # the noise holds no byte
                return False
        if not (self.transport.write(received) if chip is None else self._hand_over(chip, received, now_ns)):
            why = ("dropped_unread", "not read") if self.transport.has_reader else ("unheard", "no reader")
            self._lose([frame], now_ns, source, *why, pending.sample)
            return False
        self.counters["sent"] += 1
        self.counters["sent_bytes"] += len(received if isinstance(received, bytes) else received.data)
        end_ns = now_ns + pending.duration_ns if self.line.is_paced_by_port else now_ns
        self.truth.wrote(end_ns, source, received, pending.sample, end_ns - pending.end_ns)
        return True

    def _hand_over(self, chip: LatencyChip, frame: WireFrame, now_ns: int) -> bool:
        """Pass a frame to the port through the model of a USB-serial chip."""
        if not isinstance(frame, bytes):
            return self.transport.write(frame)
        if not self.transport.has_reader:
            return False
        if not chip.fault.covers(now_ns):
            return self.transport.write(chip.drain() + frame)
        chip.tick(now_ns)
        chip.put(frame)
        self._note(now_ns, self._source, chip.fault.word, "")
        return True

    def _as_received(self, frame: WireFrame, source: str, *, to_driver: bool) -> WireFrame:
        """Return a frame as the other end, whose settings may differ, receives it."""
        connector = self.connectors.get(source, self.line_model.connector)
        result = self.line_model.as_received(frame, connector, self.transport.setting, to_driver=to_driver)
        if result is not frame:
            self.counters["misheard"] += result != frame
        return result

    # -- from the driver ---------------------------------------------------------------------------------------------

    def receive(self, now_ns: int, readable: Sequence[int] | None = None) -> list[Event | ReceivedData]:
        """Return what happened by ``now_ns``, oldest first; bytes arrive when their last bit has. ``readable``: the
        file descriptors that have data, if the caller knows."""
        self._now_ns = now_ns
        events: list[Event | ReceivedData] = []
        if self._injector.outages or self._down is not None:
            self._apply_outages(self._injector.outage(now_ns), now_ns, events)
        is_quiet = readable is not None and self.transport.is_quiet(readable)
        for event in () if is_quiet else self.transport.poll(self._is_reading):
            if isinstance(event, Received):
                if self._down is None:
                    self._take(event.data, now_ns)
                continue
            if self._count(event):
                events.append(Noted(str(event)))
                continue
            if isinstance(event, Closed):
                self._deliver_all(events)
                self._drop_queued(now_ns, "closed")
            if self._is_news(event):
                events.append(event)
        if self.inbound is not self.line:
            while (pending := self.inbound.take(now_ns)) is not None:
                self._pass_on(pending, now_ns)
        elif (pending := self.line.finish(now_ns)) is not None:
            self._pass_on(pending, now_ns)
        if self._arrived:
            self._deliver_due(now_ns, events)
        return events

    def deliver(self, data: WireFrame, now_ns: int) -> None:
        """Queue data for delivery that were not on this line, such as a driver's data of an earlier run."""
        self._arrived.append((now_ns, ReceivedData(data)))

    def _take(self, data: WireFrame, now_ns: int) -> None:
        """Put the driver's data on the line; while the clock is paused, they and all on the line arrive at once."""
        if not self.is_paused():
            self._arrive(data, now_ns)
            return
        self._has_paused_request = True
        self._settle(self.line, now_ns)
        self._arrive(data, now_ns)
        self._settle(self.inbound, now_ns)

    def _settle(self, line: Line, now_ns: int) -> int:
        """Pass on all that is on a line, and return how many frames the driver took."""
        return sum(self._pass_on(pending, now_ns) for pending in line.settle(now_ns))

    def _deliver_all(self, events: list[Event | ReceivedData]) -> None:
        """Deliver at once what the driver has sent, because the port closes."""
        if self.line_model.is_byte_stream:  # on a bus, frames that have not left their node never do
            for pending in self.inbound.withdraw(DRIVER):
                self._arrived.append((self._now_ns, ReceivedData(pending.head)))
        self._deliver_due(None, events)

    def _apply_outages(self, fault: Outage | None, now_ns: int, events: list[Event | ReceivedData]) -> None:
        """Take the link down while a fault applies, and bring it back afterwards.

        Raises:
            TransportError: the port cannot be made again.
        """
        if fault is self._down:
            return
        self._down, self._is_resuming = fault, False
        if fault is not None:
            self._note(now_ns, self._owner, fault.word, str(fault))
            self._deliver_all(events)
            self._drop_queued(now_ns, fault.word)
        if fault is not None and fault.removes_port:
            if self.transport.has_reader and not self.line_model.is_half_duplex:  # a bus has no open and close
                events += (Closed(), DROPPED)
                self._held_open, self._lines = False, DROPPED
        self._plug()
        if fault is not None and fault.new_name:
            self.transport.rename(fault.new_name)

    def _arrive(self, data: WireFrame, now_ns: int) -> None:
        """Put the driver's data on the inbound line, on which they take their time."""
        faults = self._injector
        parts = faults.corrupt(data, now_ns, self._owner, "from_driver") if faults.frame_faults else [(data, 0)]
        for part, held_ns in parts:
            if self.inbound.waiting_ns(DRIVER) > MAX_LEFT_BEHIND_NS:
                self.counters["overrun"] += 1
            elif self.line_model.is_half_duplex and self.line_model.collides(self.line.sender(now_ns)):
                self.counters["collision"] += 1
            else:
                port, at = self.transport, self._after_held("from_driver", now_ns, held_ns)
                took_ns = 0 if port.is_paced else self.line_model.driver_ns(part, port.setting)
                self.inbound.put(part, at, DRIVER, took_ns=took_ns)

    def _deliver_due(self, now_ns: int | None, events: list[Event | ReceivedData]) -> None:
        size, owner = 0, self._owner
        while self._arrived and (now_ns is None or self._arrived[0][0] <= now_ns) and size < MAX_READ_BYTES_PER_TURN:
            end_ns, received = self._arrived.popleft()
            if received.source == DRIVER:
                if len(self.connectors) < 2:  # else the settings of each device apply, in `received_by`
                    received = ReceivedData(self._as_received(received.data, owner, to_driver=False))
                    if received.data == b"":
                        continue
                self.counters["received"] += 1
                self.counters["received_bytes"] += len(payload(received.data))
                self.truth.received(end_ns, owner, received.data)
            size += len(payload(received.data))
            events.append(received)

    def received_by(self, source: str, received: ReceivedData) -> WireFrame | None:
        """Return what a device on the wire receives of a frame, or None if its connector does not accept the frame."""
        connector, of_peer = self.connectors[source], received.source != DRIVER
        if received.source == source or not self.line_model.accepts(connector, received.data, of_peer=of_peer):
            return None
        if of_peer or len(self.connectors) < 2:
            return received.data
        return self._as_received(received.data, source, to_driver=False) or None

    def is_addressed_to(self, source: str, received: ReceivedData) -> bool:
        """Return True if the driver sent a frame to a device whose filters do not accept it."""
        return received.source == DRIVER and self.line_model.is_addressed_to(self.connectors[source], received.data)


__all__ = ["DRIVER", "ReceivedData", "Wire"]
