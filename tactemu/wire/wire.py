"""Between devices and port: the wire has a speed, and bytes and frames go wrong on it.

Frames leave when their last bit would have: bytes at the baud rate, CAN frames at their exact bit time, lowest
identifier first among the nodes of a bus. What the driver sends takes its time likewise. A reading that does not fit
is dropped whole and counted; nothing queues without bound. Where the driver has set another speed or format than the
device's it hears noise, and so does the device.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from firmware_protocols import CanFrame, CanWire, Delayed, Frame, Outgoing, SerialWire
from firmware_protocols import Wire as Spec
from tactemu.transports.transport import (
    DROPPED,
    Closed,
    Event,
    Opened,
    Received,
    SerialSetting,
    SettingChanged,
    Transport,
)
from tactemu.truth import Truth
from tactemu.wire.faults import Fault, Injector
from tactemu.wire.faults.frames import Parts
from tactemu.wire.line import Line, Pending, duration
from tactemu.wire.uart import misheard

DRIVER = "(driver)"
"""The driver as a node of a CAN bus."""
_INBOUND_AHEAD_NS = 50_000_000
"""A driver that is further ahead of its line than this is not read on: its own end holds it up, as a port's does."""
_INBOUND_LIMIT_NS = 1_000_000_000
"""Of what a driver leaves behind when it goes, bytes that are further ahead of its line than this are lost."""


class Wire:
    """One wire of one kind in front of one transport. Several devices may share it (a CAN bus).

    The caller gives the time with every call and calls :meth:`receive` and :meth:`flush` at every turn of its loop,
    and no later than :meth:`next_due_ns`.

    Args:
        transport: the port.
        spec: the device's wire: baud rate or bit rates.
        pacing: whether frames take their time. Off, they leave at once.
        faults: what goes wrong, as text or parsed (:mod:`tactemu.wire.faults`).
        seed: root seed of the faults' random streams.
        truth: where frames and faults are logged.
        backlog_ns: a reading is dropped when its device is further behind than this.

    Raises:
        SceneError: a fault that cannot be parsed, or that this wire cannot have.

    ``counters``: ``sent`` and ``sent_bytes``, ``received`` and ``received_bytes``, ``dropped_readings`` and
    ``dropped_frames`` (the line is full), ``dropped_unread`` (the driver does not read), ``unheard`` (nobody has the
    port open), ``misheard`` (the two ends are set differently), ``overrun`` (the driver sends more than the line
    carries), and injected faults by their kind.
    """

    def __init__(
        self,
        transport: Transport,
        spec: Spec,
        *,
        pacing: bool = True,
        faults: Iterable[Fault | str] = (),
        seed: int = 0,
        truth: Truth | None = None,
        backlog_ns: int = 20_000_000,
    ):
        self.transport = transport
        self.spec = spec
        self.pacing = pacing
        self.seed = seed
        self.truth = truth or Truth()
        self.backlog_ns = backlog_ns
        self.counters: Counter[str] = Counter()
        self.line = Line(spec, pacing=pacing)
        self._inbound: list[tuple[int, int, Frame]] = []
        self._inbound_number = 0
        self._inbound_free_ns = 0
        self.name = ""
        """Who is on it, for the truth log of what arrives and of what befalls the wire; default: who sent last."""
        self._source = ""
        self._now_ns = 0
        self._flushed_ns = 0
        """Until when the line has had its chance: what waits since is late by its caller, not by the line."""
        self._down: Fault | None = None
        self._injector: Injector | None = None
        for fault in faults:
            self.add_fault(fault)

    # -- life ------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Make the port.

        Raises:
            TransportError: it cannot be made.
        """
        self.transport.open()

    def close(self) -> None:
        """Remove the port. Safe to call twice."""
        self.transport.close()
        self.line.clear()
        self._inbound.clear()

    def filenos(self) -> list[int]:
        """File descriptors to select for reading."""
        return self.transport.filenos(self._reading)

    def next_due_ns(self) -> int | None:
        """When :meth:`receive` or :meth:`flush` must be called next, whatever the file descriptors say."""
        due = self.line.next_ns()
        if self._inbound:
            due = self._inbound[0][0] if due is None else min(due, self._inbound[0][0])
        if self._injector is not None:
            happens = self._injector.next_ns(self._now_ns)
            due = happens if due is None or (happens is not None and happens < due) else due
        return due

    # -- faults ------------------------------------------------------------------------------------------------------

    @property
    def faults(self) -> list[Fault]:
        """The faults that are on."""
        return list(self._injector.faults) if self._injector else []

    def add_fault(self, fault: Fault | str) -> Fault:
        """Switch a fault on, also while running.

        Raises:
            SceneError: it cannot be parsed, or this wire cannot have it.
        """
        if self._injector is None:
            self._injector = Injector((), self.spec, self.seed, self._note)
        return self._injector.add(fault)

    def remove_fault(self, fault: Fault) -> None:
        """Switch a fault off. What it held back goes on its way.

        Raises:
            ValueError: it is not on.
        """
        if self._injector is None:
            raise ValueError(f"no such fault is on: {fault}")
        for frame, source, direction in self._injector.remove(fault):
            if direction == "to_driver":
                self.line.put(frame, self._now_ns, source)
            else:
                self._take_in(frame, self._now_ns)
        if fault.kind == "latency" and (rest := self._injector.unmount_chip()):
            self.transport.write(rest)
        if not self._injector.faults and self._down is None:
            self._injector = None

    def _note(self, t_ns: int, source: str, kind: str, detail: str) -> None:
        self.counters[kind] += 1
        self.truth.inject(t_ns, source, kind, detail)

    # -- to the driver -----------------------------------------------------------------------------------------------

    def send(self, frames: Iterable[Outgoing], now_ns: int, source: str = "") -> None:
        """Queue one reading or one answer: all of its frames, or none when the line is full."""
        parts: Parts = [(part.frame, part.delay_ns) if isinstance(part, Delayed) else (part, 0) for part in frames]
        self._source = source
        if not self.transport.listening:
            self._lose(parts, now_ns, source, "unheard", "nobody listens")
        elif self._down is not None:
            self._lose(parts, now_ns, source, "unheard", str(self._down))
        elif self.line.backlog_ns(source, min(now_ns, self._flushed_ns)) > self.backlog_ns:
            self.counters["dropped_readings"] += 1
            self._lose(parts, now_ns, source, "dropped_frames", "line full")
        else:
            if self._injector is not None:
                parts = self._injector.spoil(parts, now_ns, source, "to_driver")
            for frame, delay_ns in parts:
                self.line.put(frame, now_ns + delay_ns, source)

    def flush(self, now_ns: int) -> int:
        """Write every frame whose last bit has gone; returns how many were written."""
        self._now_ns = self._flushed_ns = now_ns
        if self._injector is not None:
            self._add_traffic(self._injector, now_ns)
        written = 0
        while (pending := self.line.take(now_ns)) is not None:
            written += self._pass_on(pending, now_ns)
        if self._injector is not None and self._injector.chip is not None:
            while packet := self._injector.chip.take(now_ns):
                self.transport.write(packet)
        return written

    def _add_traffic(self, injector: Injector, now_ns: int) -> None:
        """Let other nodes of the bus queue the frames that they have ready."""
        for node in injector.traffic:
            while (
                self.line.backlog_ns(node.source, now_ns) <= self.backlog_ns
                and (ready := node.take(now_ns)) is not None
            ):
                due_ns, frame = ready
                self.line.put(frame, due_ns, node.source)
                self._note(due_ns, node.source, node.fault.kind, str(frame))

    def _pass_on(self, pending: Pending, now_ns: int) -> bool:
        """What has left the line goes to whom it is for; returns whether that is the driver, and it took it."""
        if pending.source != DRIVER:
            return self._write(pending, now_ns)
        if isinstance(pending.frame, CanFrame) and not pending.frame.is_error_frame:
            self._take_in(pending.frame, pending.end_ns)
        return False

    def _write(self, pending: Pending, now_ns: int) -> bool:
        frame, source = pending.frame, pending.source
        heard = self._through_uart(frame, to_driver=True)
        if isinstance(heard, bytes) and not heard:  # nothing that looks like a byte came out of the noise
            return False
        if not self._hand_over(heard, now_ns):
            why = ("dropped_unread", "not read") if self.transport.listening else ("unheard", "nobody listens")
            self._lose([(frame, 0)], now_ns, source, *why)
            return False
        self.counters["sent"] += 1
        self.counters["sent_bytes"] += _size(heard)
        self.truth.wrote(now_ns, source, heard)
        return True

    def _hand_over(self, frame: Frame, now_ns: int) -> bool:
        chip = self._injector.chip if self._injector is not None else None
        if chip is None or not isinstance(frame, bytes):
            return self.transport.write(frame)
        if not self.transport.listening:
            return False
        if not chip.fault.covers(now_ns):
            return self.transport.write(chip.empty() + frame)
        chip.tick(now_ns)
        chip.put(frame)
        self._note(now_ns, self._source, "latency", "")
        return True

    def _lose(self, parts: Parts, now_ns: int, source: str, counter: str, why: str) -> None:
        self.counters[counter] += len(parts)
        for frame, _ in parts:
            self.truth.dropped(now_ns, source, frame, why)

    # -- from the driver ---------------------------------------------------------------------------------------------

    def receive(self, now_ns: int) -> list[Event]:
        """What the driver did by ``now_ns``, oldest first; its bytes arrive when their last bit has."""
        self._now_ns = now_ns
        events: list[Event] = []
        if self._injector is not None:
            self._follow_outages(self._injector.outage(now_ns), now_ns, events)
        for event in self.transport.poll(self._reading):
            if isinstance(event, Received):
                if self._down is None:
                    self._arrive(event.data, now_ns)
                continue
            if isinstance(event, Closed):
                self._deliver(None, events)
                self._forget(now_ns, "closed")
            events.append(event)
        if (pending := self.line.finish(now_ns)) is not None:
            self._pass_on(pending, now_ns)
        self._deliver(now_ns, events)
        return events

    def _follow_outages(self, fault: Fault | None, now_ns: int, events: list[Event]) -> None:
        """Pull the plug or leave the bus when it is time, and come back.

        Raises:
            TransportError: the port cannot be made again.
        """
        if fault is self._down:
            return
        before, self._down = self._down, fault
        if fault is not None:
            self._note(now_ns, self._owner, fault.kind, str(fault))
            self._deliver(None, events)
            self._forget(now_ns, fault.kind)
        if fault is not None and fault.kind == "unplug":
            if self.transport.listening and not isinstance(self.spec, CanWire):  # a bus has no open and close
                events += (Closed(), DROPPED)
            self.transport.close()
        elif before is not None and before.kind == "unplug":
            self.transport.open()

    def _forget(self, now_ns: int, why: str) -> None:
        """Nothing is kept for whoever comes next."""
        self._inbound_free_ns = now_ns
        for lost in self.line.clear():
            if lost.source != DRIVER:
                self._lose([(lost.frame, 0)], now_ns, lost.source, "unheard", why)
        if self._injector is not None:
            held = [(frame, 0) for frame, _, way in self._injector.forget() if way == "to_driver"]
            self._lose(held, now_ns, self._owner, "unheard", why)

    @property
    def _reading(self) -> bool:
        """Whether the line has room for more of what the driver sends."""
        return self._inbound_free_ns - self._now_ns <= _INBOUND_AHEAD_NS

    def _arrive(self, data: Frame, now_ns: int) -> None:
        """The driver has sent something: on a bus it competes with the other nodes, else it has a line of its own."""
        parts: Parts = [(data, 0)]
        if self._injector is not None:
            parts = self._injector.spoil(parts, now_ns, self._owner, "from_driver")
        for part, delay_ns in parts:
            if isinstance(self.spec, CanWire):
                fits = self.line.backlog_ns(DRIVER, min(now_ns, self._flushed_ns)) <= self.backlog_ns
                if fits:
                    self.line.put(part, now_ns + delay_ns, DRIVER)
            else:
                begins_ns = max(self._inbound_free_ns, now_ns)
                fits = begins_ns - now_ns <= _INBOUND_LIMIT_NS
                if fits:
                    self._inbound_free_ns = begins_ns + self._inbound_ns(part)
                    self._take_in(part, self._inbound_free_ns + delay_ns)
            if not fits:
                self.counters["overrun"] += 1

    def _inbound_ns(self, data: Frame) -> int:
        """How long the driver's end takes to send something, at the speed that it is set to."""
        spec, setting = self.spec, self.transport.setting
        if isinstance(spec, SerialWire) and setting is not None and setting.baud is not None:
            spec = replace(spec, baud=setting.baud)
        return duration(spec, pacing=self.pacing)(data)

    @property
    def _owner(self) -> str:
        return self.name or self._source

    def _take_in(self, frame: Frame, arrives_ns: int) -> None:
        self._inbound_number += 1
        heapq.heappush(self._inbound, (arrives_ns, self._inbound_number, frame))

    def _deliver(self, now_ns: int | None, events: list[Event]) -> None:
        while self._inbound and (now_ns is None or self._inbound[0][0] <= now_ns):
            end_ns, _, data = heapq.heappop(self._inbound)
            data = self._through_uart(data, to_driver=False)
            if not data:
                continue
            self.counters["received"] += 1
            self.counters["received_bytes"] += _size(data)
            self.truth.received(end_ns, self._owner, data)
            events.append(Received(data))

    def _through_uart(self, data: Frame, *, to_driver: bool) -> Frame:
        """The bytes as heard at the other end, which may be set otherwise; USB and CAN have no such trouble."""
        driver, spec = self.transport.setting, self.spec
        if driver is None or not isinstance(spec, SerialWire) or spec.usb or not isinstance(data, bytes):
            return data
        device = SerialSetting(spec.baud, spec.bytesize, spec.parity, spec.stopbits)
        result = misheard(data, device, driver) if to_driver else misheard(data, driver, device)
        self.counters["misheard"] += result != data
        return result


def _size(frame: Frame) -> int:
    return len(frame) if isinstance(frame, bytes) else len(frame.data)


__all__ = ["Closed", "Opened", "Received", "SettingChanged", "Wire"]
