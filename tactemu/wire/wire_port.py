"""The port of a wire: made and removed, opened and closed by a driver, and taken away by faults."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from firmware_protocols import Connector, WireFrame
from tactemu.base.errors import SceneError
from tactemu.transports.transport import Closed, Counted, Event, LinesChanged, Opened, Received, Transport
from tactemu.truth import Truth
from tactemu.wire.faults import Fault, Injector
from tactemu.wire.faults.fault import Outage
from tactemu.wire.faults.link import Latency
from tactemu.wire.line import DRIVER, Line, Pacing, Pending
from tactemu.wire.line_models import line_model_for

MAX_POLLS_AT_CLOSE = 100
"""Maximum number of polls of a port that closes, for frames that are left there; bounds the time of closing."""


@dataclass(frozen=True, slots=True)
class ReceivedData:
    """A chunk of bytes or a CAN frame that has arrived at the devices of a wire."""

    data: WireFrame
    source: str = DRIVER
    """The sender: the driver, or one of the devices."""


class WirePort:
    """A port with its lines and its faults; :class:`~tactemu.wire.wire.Wire` passes frames through it.

    Args:
        transport: the port.
        connector: what the device has there: baud rate or bit rates.
        pacing: True where frames take their time on the line.
        faults: what goes wrong, as text or parsed.
        seed: root seed of the faults' random streams.
        truth: where frames and faults are logged.

    Raises:
        SceneError: a fault that cannot be parsed, or that this wire cannot have.
    """

    def __init__(
        self,
        transport: Transport,
        connector: Connector,
        *,
        pacing: Pacing,
        faults: Iterable[Fault | str],
        seed: int,
        truth: Truth | None,
    ):
        self.transport = transport
        self.pacing: Pacing = pacing
        self.truth = truth or Truth()
        self.counters: Counter[str] = Counter()
        self.line_model = line_model_for(connector, pacing=pacing)
        self.line = Line(self.line_model, is_paced_by_port=transport.is_paced)
        """The line to the driver, and from it where there is one line for both."""
        self.inbound = self.line if self.line_model.is_half_duplex else Line(self.line_model)
        """The line from the driver."""
        self.connectors: dict[str, Connector] = {}
        """The connector of each device on the wire, by the device's name."""
        self.name = ""
        """The name that received data and faults of the wire have in the truth log; default: the last sender."""
        self._source = ""
        """The device that sent last."""
        self._held_ns: Counter[str] = Counter()
        """The time until which a fault holds a byte stream up, by direction."""
        self._arrived: deque[tuple[int, ReceivedData]] = deque()
        """Data that have left the line but are not delivered yet, each with the time of its last bit."""
        self._now_ns = 0
        self._down: Outage | None = None
        """The fault that has the link down."""
        self._lines: LinesChanged | None = None
        """The modem lines as the devices last received them."""
        self._held_open = False
        """True while, to the devices, a driver has the port open."""
        self.was_opened = False
        """True once a driver has had the port open."""
        self._is_open = False
        """True between :meth:`open` and close, whether or not a fault has taken the port away."""
        self._is_plugged = False
        """True while the transport's port exists."""
        self._is_resuming = False
        """True where a driver had the port open when the state was saved: the devices see the next opening as that."""
        self._injector = Injector(faults, self.line_model, seed, self._note)

    # -- the port ----------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Make the port.

        Raises:
            TransportError: it cannot be made.
            SceneError: a real line is behind it, and cannot have a fault that is on.
        """
        self.line_model.prepare()
        self.transport.set_connector(self.line_model.connector)
        self.transport.set_filters(self.line_model.filters(self.connectors.values()))
        self._is_open = True
        self._plug()
        try:
            self._injector.meet(self.transport.is_paced)
        except SceneError:
            self.close()
            raise

    def close(self) -> None:
        """Remove the port, and count the driver's data that no device has received. Safe to call twice."""
        if self._is_plugged:
            self._count_unprocessed()
        self._is_open = self._is_plugged = False
        self.transport.close()
        self.line.clear()
        self.inbound.clear()
        self._arrived.clear()

    def _count_unprocessed(self) -> None:
        waiting: list[object] = list(self.inbound.withdraw(DRIVER))
        waiting += [received for _, received in self._arrived if received.source == DRIVER]
        for _ in range(MAX_POLLS_AT_CLOSE):  # data that the loop was too late to take
            events = self.transport.poll()
            waiting += [event for event in events if isinstance(event, Received)]
            for event in events:
                self._count(event)
            if not events:
                break
        if waiting:
            self.counters["unprocessed"] += len(waiting)

    def _plug(self) -> None:
        """Open the transport, or close it where a fault has taken the port away."""
        plugged = self._is_open and (self._down is None or not self._down.removes_port)
        if plugged != self._is_plugged:
            (self.transport.open if plugged else self.transport.close)()
            self.line.is_paced_by_port = self.transport.is_paced
            self._is_plugged = plugged
        self.transport.hold(self._down is not None and self._down.is_half_open)

    def prepare_restore(self, state: Mapping[str, object]) -> Callable[[], None]:
        """Return a callable that brings the port into its restored state; a driver has to open it again."""
        return self._resume

    def _resume(self) -> None:
        if self._is_open:
            self._plug()
        unplugged = self._down is not None and self._down.removes_port
        self._is_resuming = self._held_open and not self._is_plugged and not unplugged

    def attach(self, source: str, connector: Connector) -> None:
        """Put a device on the wire, or take over settings that its firmware has changed, for what is sent from now."""
        changed = self.connectors.get(source, connector) != connector
        self.connectors[source] = connector
        if changed:
            self.line_model = line_model_for(connector, pacing=self.pacing)
            self.line.line_model = self.inbound.line_model = self.line_model

    def _is_news(self, event: Event) -> bool:
        """Return True if the event is new to the devices: they do not see that a restored run has another port."""
        known = self._is_resuming and (isinstance(event, Opened) or event == self._lines)
        match event:
            case Opened() | Closed():
                self.was_opened = True
                self._held_open, self._is_resuming = isinstance(event, Opened), known
            case LinesChanged():
                self._lines, self._is_resuming = event, False
        return not known

    def _count(self, event: Event) -> bool:
        """Count what the kernel or a UART has counted; return False if the event is another."""
        if not isinstance(event, Counted):
            return False
        self.counters[event.counter] += event.count
        return True

    # -- faults ------------------------------------------------------------------------------------------------------

    @property
    def faults(self) -> list[Fault]:
        """The faults that are on."""
        return list(self._injector.faults)

    def add_fault(self, fault: Fault | str) -> Fault:
        """Switch a fault on, also while the wire runs.

        Raises:
            SceneError: it cannot be parsed, or this wire cannot have it.
        """
        return self._injector.add(fault)

    def remove_fault(self, fault: Fault) -> None:
        """Switch a fault off, and queue the frames that it held back.

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
        if isinstance(fault, Latency) and (left_over := self._injector.unmount_chip()):
            self.transport.write(left_over)

    def _note(self, t_ns: int, source: str, kind: str, detail: str, **frames: Any) -> None:
        """Count and log an injected fault, with the frames as in :meth:`tactemu.truth.Truth.inject`."""
        self.counters[kind] += 1
        self.truth.inject(t_ns, source, kind, detail, **frames)

    # -- what arrives, and what is lost ------------------------------------------------------------------------------

    def _pass_to_peers(self, frames: Iterable[WireFrame], pending: Pending) -> None:
        """Deliver frames of a device to the other devices on the wire, as far as one of them accepts them."""
        source, accepts = pending.source, self.line_model.accepts
        if source in self.connectors:
            peers = [connector for name, connector in self.connectors.items() if name != source]
            for frame in frames:
                if any(accepts(connector, frame, of_peer=True) for connector in peers):
                    self._arrived.append((pending.end_ns, ReceivedData(frame, source)))

    def _lose(
        self, frames: Iterable[WireFrame], now_ns: int, source: str, counter: str, why: str, sample: int | None = None
    ) -> None:
        for frame in frames:
            self.counters[counter] += 1
            self.truth.dropped(now_ns, source, frame, why, sample)

    def _drop_queued(self, now_ns: int, why: str) -> None:
        """Drop all that is queued or held back, so that the next driver does not receive it."""
        self.inbound.free_ns = now_ns
        for lost in self.line.clear():
            if lost.source != DRIVER:
                self._lose(lost.frames, now_ns, lost.source, "unheard", why, lost.sample)
        held = [frame for frame, _, way in self._injector.release() if way == "to_driver"]
        self._lose(held, now_ns, self._owner, "unheard", why)

    @property
    def _owner(self) -> str:
        return self.name or self._source
