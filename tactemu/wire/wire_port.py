"""The port of a wire: made and removed, opened and closed by a driver, and taken away by faults."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from firmware_protocols import Connector, WireFrame
from tactemu.transports.transport import Closed, Event, LinesChanged, Opened, Overflowed, Transport
from tactemu.truth import Truth
from tactemu.wire.faults import Fault, Injector
from tactemu.wire.line import Line
from tactemu.wire.line_models import line_model_for
from tactemu.wire.line_models.line_model import DRIVER, Pacing

MAX_INBOUND_AHEAD_NS = 50_000_000
"""Maximum lead of a driver over its line; beyond it the wire stops reading, and the driver blocks as on a real port."""


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
        self.line = Line(self.line_model)
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
        self._now_ns = 0
        self._down: Fault | None = None
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
        """
        self.transport.set_connector(self.line_model.connector)
        self.transport.set_filters(self.line_model.filters(self.connectors.values()))
        self._is_open = True
        self._plug()

    def _plug(self) -> None:
        """Open the transport, or close it where a fault has taken the port away."""
        plugged = self._is_open and (self._down is None or self._down.kind != "unplug")
        if plugged != self._is_plugged:
            (self.transport.open if plugged else self.transport.close)()
            self._is_plugged = plugged
        self.transport.hold(self._down is not None and self._down.kind == "halfopen")

    def after_restore(self) -> None:
        """Bring the port into its restored state; a driver has to open it again."""
        if self._is_open:
            self._plug()
        unplugged = self._down is not None and self._down.kind == "unplug"
        self._is_resuming = self._held_open and not self._is_plugged and not unplugged

    def attach(self, source: str, connector: Connector) -> None:
        """Put a device on the wire, or take over settings that its firmware has changed, for what is sent from now."""
        changed = self.connectors.get(source, connector) != connector
        self.connectors[source] = connector
        if changed:
            self.line_model = line_model_for(connector, pacing=self.pacing)
            self.line.line_model = self.inbound.line_model = self.line_model

    def filenos(self) -> list[int]:
        """Return file descriptors to select for reading."""
        return self.transport.filenos(self._is_reading)

    @property
    def _is_reading(self) -> bool:
        """True while the line has room for more data of the driver."""
        return self.inbound.waiting_ns(DRIVER) <= MAX_INBOUND_AHEAD_NS

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

    def _count_overflow(self, event: Event) -> bool:
        """Count what the kernel dropped; return False if the event is another."""
        if not isinstance(event, Overflowed):
            return False
        self.counters["overflow"] += event.count
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

    def _after_held(self, direction: str, ready_ns: int, held_ns: int) -> int:
        """Return when a frame leaves that a fault holds back by ``held_ns``; later bytes of a stream wait for it."""
        ready_ns += held_ns
        if self.line_model.is_byte_stream:
            ready_ns = max(ready_ns, self._held_ns[direction])
            if held_ns:
                self._held_ns[direction] = ready_ns
        return ready_ns

    # -- what arrives, and what is lost ------------------------------------------------------------------------------

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

    def _as_received(self, frame: WireFrame, source: str, *, to_driver: bool) -> WireFrame:
        """Return a frame as the other end, whose settings may differ, receives it."""
        connector = self.connectors.get(source, self.line_model.connector)
        result = self.line_model.as_received(frame, connector, self.transport.setting, to_driver=to_driver)
        if result is not frame:
            self.counters["misheard"] += result != frame
        return result

    @property
    def _owner(self) -> str:
        return self.name or self._source
