"""Between devices and port: the wire has a speed, and bytes and frames go wrong on it.

Frames leave when their last bit would have: bytes at the baud rate, CAN frames at their exact bit time, lowest
identifier first among the nodes of a bus. What the driver sends takes its time likewise. A reading that does not fit
is dropped whole and counted; nothing queues without bound. At another baud rate than the device's the driver hears
noise, and so does the device.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from firmware_protocols import CanWire, Delayed, Frame, Outgoing, SerialWire
from firmware_protocols import Wire as Spec
from tactemu.line import Line, Pending, duration
from tactemu.transports.transport import BaudChanged, Closed, Event, Opened, Received, Transport
from tactemu.truth import Truth
from tactemu.uart import misheard


class Wire:
    """One wire of one kind in front of one transport. Several devices may share it (a CAN bus).

    The caller gives the time with every call and calls :meth:`receive` and :meth:`flush` at every turn of its loop,
    and no later than :meth:`next_due_ns`.

    Args:
        transport: the port.
        spec: the device's wire: baud rate or bit rates.
        pacing: whether frames take their time. Off, they leave at once.
        backlog_ns: a reading is dropped when frames for longer than this wait before it.
        seed: root seed of the faults' random streams.
        truth: where frames and faults are logged.

    ``counters``: ``sent`` and ``sent_bytes``, ``received`` and ``received_bytes``, ``dropped_readings`` (the line is
    full), ``dropped_unread`` (the driver does not read), ``unheard`` (nobody has the port open), ``misheard`` (the
    baud rates differ), all in frames unless the name says otherwise.
    """

    def __init__(
        self,
        transport: Transport,
        spec: Spec,
        *,
        pacing: bool = True,
        faults: Iterable = (),
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
        self._inbound: deque[tuple[int, Frame]] = deque()
        self._inbound_free_ns = 0
        self._inbound_duration = duration(spec, pacing=pacing)
        self._source = ""

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
        return self.transport.filenos()

    def next_due_ns(self) -> int | None:
        """When :meth:`receive` or :meth:`flush` must be called next, whatever the file descriptors say."""
        due = self.line.next_ns()
        if self._inbound:
            due = self._inbound[0][0] if due is None else min(due, self._inbound[0][0])
        return due

    # -- to the driver -----------------------------------------------------------------------------------------------

    def send(self, frames: Iterable[Outgoing], now_ns: int, source: str = "") -> None:
        """Queue one reading or one answer: all of its frames, or none when the line is full."""
        parts = [(part.frame, part.delay_ns) if isinstance(part, Delayed) else (part, 0) for part in frames]
        self._source = source
        if not self.transport.listening:
            self._lose(parts, now_ns, source, "unheard", "nobody listens")
        elif self.line.waiting_ns(source) > self.backlog_ns:
            self.counters["dropped_readings"] += 1
            self._lose(parts, now_ns, source, "dropped_frames", "line full")
        else:
            for frame, delay_ns in parts:
                self.line.put(frame, now_ns + delay_ns, source)

    def flush(self, now_ns: int) -> int:
        """Write every frame whose last bit has gone; returns how many were written."""
        written = 0
        while (pending := self.line.take(now_ns)) is not None:
            written += self._write(pending, now_ns)
        return written

    def _write(self, pending: Pending, now_ns: int) -> bool:
        frame, source = pending.frame, pending.source
        heard = self._through_baud(frame, to_driver=True)
        if isinstance(heard, bytes) and not heard:  # nothing that looks like a byte came out of the noise
            return False
        if not self.transport.write(heard):
            why = ("dropped_unread", "not read") if self.transport.listening else ("unheard", "nobody listens")
            self._lose([(frame, 0)], now_ns, source, *why)
            return False
        self.counters["sent"] += 1
        self.counters["sent_bytes"] += _size(heard)
        self.truth.wrote(now_ns, source, heard)
        return True

    def _lose(self, parts: list[tuple[Frame, int]], now_ns: int, source: str, counter: str, why: str) -> None:
        self.counters[counter] += len(parts)
        for frame, _ in parts:
            self.truth.dropped(now_ns, source, frame, why)

    # -- from the driver ---------------------------------------------------------------------------------------------

    def receive(self, now_ns: int) -> list[Event]:
        """What the driver did by ``now_ns``, oldest first; its bytes arrive when their last bit has."""
        events: list[Event] = []
        for event in self.transport.poll():
            if isinstance(event, Received):
                self._arrive(event.data, now_ns)
                continue
            if isinstance(event, Closed):
                self._deliver(None, events)
                self._lose([(lost.frame, 0) for lost in self.line.clear()], now_ns, self._source, "unheard", "closed")
            events.append(event)
        self._deliver(now_ns, events)
        return events

    def _arrive(self, data: Frame, now_ns: int) -> None:
        takes_ns = self._inbound_duration(data)
        if isinstance(self.spec, CanWire):
            end_ns = self.line.occupy(now_ns, takes_ns)
        else:
            end_ns = self._inbound_free_ns = max(self._inbound_free_ns, now_ns) + takes_ns
        self._inbound.append((end_ns, data))

    def _deliver(self, now_ns: int | None, events: list[Event]) -> None:
        while self._inbound and (now_ns is None or self._inbound[0][0] <= now_ns):
            end_ns, data = self._inbound.popleft()
            data = self._through_baud(data, to_driver=False)
            if not data:
                continue
            self.counters["received"] += 1
            self.counters["received_bytes"] += _size(data)
            self.truth.received(end_ns, self._source, data)
            events.append(Received(data))

    def _through_baud(self, data: Frame, *, to_driver: bool) -> Frame:
        """The bytes as heard at the other end, whose speed may differ; USB and CAN have no such trouble."""
        baud = self.transport.baud
        spec = self.spec
        if (
            baud is None
            or not isinstance(spec, SerialWire)
            or spec.usb
            or baud == spec.baud
            or not isinstance(data, bytes)
        ):
            return data
        sent, heard = (spec.baud, baud) if to_driver else (baud, spec.baud)
        result = misheard(data, sent, heard, spec)
        self.counters["misheard"] += result != data
        return result


def _size(frame: Frame) -> int:
    return len(frame) if isinstance(frame, bytes) else len(frame.data)


__all__ = ["BaudChanged", "Closed", "Opened", "Received", "Wire"]
