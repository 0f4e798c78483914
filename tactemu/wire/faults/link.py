"""Faults of the port and the bus: outages, the USB-serial chip before the driver, and other nodes on a CAN bus."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from firmware_protocols import CanFrame
from tactemu.wire.faults.fault import LinkFault, Outage, Traffic
from tactemu.wire.faults.options import PortName, duration
from tactemu.wire.line import MAX_CATCH_UP_NS, LineModel

USB_PAYLOAD_BYTES = 62
"""Payload of one USB packet of the common chip [byte]: 64 less two of status."""


@dataclass(frozen=True, kw_only=True)
class Unplug(Outage):
    """A port that goes away, and comes back, ``as NAME`` under another name."""

    word = "unplug"
    about = "the port goes away, and comes back"
    removes_port = True
    name: PortName = ""

    @property
    def new_name(self) -> str:
        """The name under which the port comes back."""
        return self.name


class HalfOpen(Outage):
    """A connection whose other end is dead."""

    word = "halfopen"
    about = "the connection stays, but the other end is dead"
    every_line = False
    is_half_open = True


class BusOff(Outage):
    """A node that leaves the bus."""

    word = "busoff"
    about = "the node leaves the bus, and recovers"
    every_line = False


@dataclass(frozen=True, kw_only=True)
class Latency(LinkFault):
    """The chip of a USB-serial adapter, with its latency timer."""

    word = "latency"
    about = "a USB-serial chip hands over 62 bytes, or what it has when its timer fires"
    every_line = False
    keeps_frame = True
    by_ns: Annotated[int, duration("by", alone=r"\d[^%]*")] = 16_000_000
    """The period of the timer [ns]."""

    def _errors(self) -> Iterator[tuple[str, str]]:
        yield from super()._errors()
        if not self.by_ns:
            yield "latency", "its timer needs a time, such as 1ms"


class LatencyChip:
    """A USB-serial chip: it passes on packets of 62 bytes, and fewer when its timer fires. A packet restarts it."""

    def __init__(self, fault: Latency):
        self.fault = fault
        self._held = b""
        self._last_ns = 0

    def put(self, data: bytes) -> None:
        """Add bytes from the line."""
        self._held += data

    def next_ns(self) -> int | None:
        """Return when the timer fires with bytes to pass on, or None."""
        return self._last_ns + self.fault.by_ns if self._held else None

    def take(self, now_ns: int) -> bytes:
        """Return the bytes that the driver receives now; call at :meth:`next_ns` and whenever bytes were added."""
        ticks = (now_ns - self._last_ns) // self.fault.by_ns
        size = len(self._held) if ticks > 0 else len(self._held) // USB_PAYLOAD_BYTES * USB_PAYLOAD_BYTES
        if size and not ticks:
            self._last_ns = now_ns
        data, self._held = self._held[:size], self._held[size:]
        return data

    def tick(self, now_ns: int) -> None:
        """Advance the timer of an idle line; call before :meth:`put`."""
        if not self._held:
            self._last_ns += (now_ns - self._last_ns) // self.fault.by_ns * self.fault.by_ns

    def drain(self) -> bytes:
        """Return the bytes that are held, and hold none."""
        data, self._held = self._held, b""
        return data


class Babble(Traffic):
    """A node that fills the bus with frames of the highest priority."""

    word = "babble"
    about = "another node fills the bus with the highest priority"
    every_line = False

    def frame(self, rng: np.random.Generator) -> CanFrame:
        """Return a frame of zeros."""
        return _frame(self.arbitration_id or 0, bytes(8))


class Load(Traffic):
    """A node whose frames, with identifiers 0x600 to 0x6FF or that of ``id=``, take a share of the bus."""

    word = "load"
    about = "other traffic takes a share of the bus"
    every_line = False

    def frame(self, rng: np.random.Generator) -> CanFrame:
        """Return a frame of random data."""
        data, own = rng.bytes(8), self.arbitration_id
        return _frame(int(rng.integers(0x600, 0x700)) if own is None else own, data)


def _frame(identifier: int, data: bytes) -> CanFrame:
    return CanFrame(arbitration_id=identifier, is_extended_id=identifier > 0x7FF, data=data)


class BusNode:
    """Another node of the bus, which sends the frames of a :class:`Traffic`."""

    def __init__(self, fault: Traffic, line_model: LineModel, rng: np.random.Generator):
        self.fault = fault
        self.source = f"({fault.word})"
        self._line_model, self._rng = line_model, rng
        self._next_ns = fault.start_ns or 0
        self._spacing_ns = 1
        self._missed_ns = 0

    def take_missed(self) -> int:
        """Return how many frames a late caller has left out since the last call."""
        missed, self._missed_ns = divmod(self._missed_ns, self._spacing_ns)
        return missed

    def leave_out(self, until_ns: int) -> None:
        """Send nothing before ``until_ns``, because the caller is too slow for it."""
        if until_ns > self._next_ns:
            self._missed_ns += until_ns - self._next_ns
            self._next_ns = until_ns

    def next_ns(self) -> int | None:
        """Return when the node sends next, or None if the fault is over."""
        over = self.fault.stop_ns is not None and self._next_ns >= self.fault.stop_ns
        return self._next_ns if self.fault.share and not over else None

    def take(self, now_ns: int) -> tuple[int, CanFrame] | None:
        """Return the next frame and the time at which it is ready, or None if that is after ``now_ns``."""
        if self._next_ns < now_ns - MAX_CATCH_UP_NS:
            self._missed_ns += now_ns - MAX_CATCH_UP_NS - self._next_ns
            self._next_ns = now_ns - MAX_CATCH_UP_NS
        due = self.next_ns()
        if due is None or due > now_ns:
            return None
        frame = self.fault.frame(self._rng)
        self._spacing_ns = round(self._line_model.traffic_ns(frame) / self.fault.share)
        self._next_ns += self._spacing_ns
        return due, frame
