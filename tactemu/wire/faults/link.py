"""Faults of the link: the USB-serial chip between line and driver, and other nodes on a CAN bus."""

from __future__ import annotations

import numpy as np

from firmware_protocols import CanFrame
from tactemu.wire.faults.fault import Fault
from tactemu.wire.line import MAX_CATCH_UP_NS
from tactemu.wire.line_models import LineModel

USB_PAYLOAD_BYTES = 62
"""Payload of one USB packet of the common chip [byte]: 64 less two of status."""


class LatencyChip:
    """A USB-serial chip: it passes on packets of 62 bytes, and fewer when its timer fires. A packet restarts it."""

    def __init__(self, fault: Fault):
        self.fault = fault
        self.timer_ns = fault.by_ns
        self._held = b""
        self._last_ns = 0

    def put(self, data: bytes) -> None:
        """Add bytes from the line."""
        self._held += data

    def next_ns(self) -> int | None:
        """Return when the timer fires with bytes to pass on, or None."""
        return self._last_ns + self.timer_ns if self._held else None

    def take(self, now_ns: int) -> bytes:
        """Return the bytes that the driver receives now; call at :meth:`next_ns` and whenever bytes were added."""
        ticks = (now_ns - self._last_ns) // self.timer_ns
        size = len(self._held) if ticks > 0 else len(self._held) // USB_PAYLOAD_BYTES * USB_PAYLOAD_BYTES
        if size and not ticks:
            self._last_ns = now_ns
        data, self._held = self._held[:size], self._held[size:]
        return data

    def tick(self, now_ns: int) -> None:
        """Advance the timer of an idle line; call before :meth:`put`."""
        if not self._held:
            self._last_ns += (now_ns - self._last_ns) // self.timer_ns * self.timer_ns

    def drain(self) -> bytes:
        """Return the bytes that are held, and hold none."""
        data, self._held = self._held, b""
        return data


class Traffic:
    """Another node of the bus, whose frames take a share of it (``load``), or all of it (``babble``)."""

    def __init__(self, fault: Fault, line_model: LineModel, rng: np.random.Generator):
        self.fault = fault
        self.source = f"({fault.kind})"
        self._line_model, self._rng = line_model, rng
        self._next_ns = fault.start_ns
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
        return self._next_ns if self.fault.probability and not over else None

    def take(self, now_ns: int) -> tuple[int, CanFrame] | None:
        """Return the next frame and the time at which it is ready, or None if that is after ``now_ns``."""
        if self._next_ns < now_ns - MAX_CATCH_UP_NS:
            self._missed_ns += now_ns - MAX_CATCH_UP_NS - self._next_ns
            self._next_ns = now_ns - MAX_CATCH_UP_NS
        due = self.next_ns()
        if due is None or due > now_ns:
            return None
        frame = self._frame()
        self._spacing_ns = round(self._line_model.traffic_ns(frame) / self.fault.probability)
        self._next_ns += self._spacing_ns
        return due, frame

    def _frame(self) -> CanFrame:
        identifier = self.fault.arbitration_id
        if self.fault.kind == "babble":
            identifier, data = identifier or 0, bytes(8)
        else:
            data = self._rng.bytes(8)
            identifier = int(self._rng.integers(0x600, 0x700)) if identifier is None else identifier
        return CanFrame(arbitration_id=identifier, is_extended_id=identifier > 0x7FF, data=data)
