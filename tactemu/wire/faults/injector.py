"""Injection of faults into the frames of a wire: which are hit, what becomes of them, and their record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import ClassVar

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.frames import payload
from tactemu.base.random_streams import generator
from tactemu.wire.faults.fault import Fault, FrameFault, Key, Memory, Outage, Parts, Traffic
from tactemu.wire.faults.link import BusNode, Latency, LatencyChip
from tactemu.wire.faults.registry import check_fits
from tactemu.wire.faults.text import parse
from tactemu.wire.line_models import LineModel

Note = Callable[..., None]
"""A function that counts and logs an injected fault, with the arguments of :meth:`tactemu.truth.Truth.inject`."""
Held = tuple[WireFrame, str, str]
"""A frame that a fault holds back, with its source and direction."""


class ActiveFault(Memory):
    """A fault of frames that is on: which frames it has hit, and what it remembers."""

    def __init__(self, fault: FrameFault, rng: np.random.Generator):
        super().__init__(rng)
        self.fault = fault
        self.matched = 0
        """The number of the frame that the target matched last, from 1."""
        self._spent = False

    def apply(self, frame: WireFrame, key: Key, t_ns: int) -> tuple[Parts, bool]:
        """Return what becomes of the frame, and whether a fault was injected."""
        hit = self._hits(frame, t_ns)
        return self.fault.apply(frame, key, hit, self) if hit or self.fault.needs_all else ([(frame, 0)], False)

    def release(self) -> list[Held]:
        """Return the frames that are held back, and hold none, because the fault is over or the port was closed."""
        held = [(frame, source, direction) for (source, direction), (frame, _) in self.held.items()]
        self.held.clear()
        self.earlier.clear()
        return held

    def _hits(self, frame: WireFrame, t_ns: int) -> bool:
        """Return True if the fault hits a frame; draws one random number for every frame that target and time match."""
        fault = self.fault
        if self._spent or not fault.covers(t_ns) or (isinstance(frame, CanFrame) and frame.is_error_frame):
            return False
        if fault.arbitration_id is not None and not (
            isinstance(frame, CanFrame) and frame.arbitration_id == fault.arbitration_id
        ):
            return False
        if fault.prefix and not payload(frame).startswith(fault.prefix):
            return False
        self.matched += 1
        if fault.frames and not self._is_numbered():
            return False
        if self.matched % fault.every or (fault.probability < 1 and self.rng.random() >= fault.probability):
            return False
        self._spent |= fault.once
        return True

    def _is_numbered(self) -> bool:
        number = self.matched
        self._spent = number >= max(last for _, last in self.fault.frames)
        return any(first <= number <= last for first, last in self.fault.frames)


class Injector:
    """All faults of one wire.

    Args:
        faults: as text or parsed.
        line_model: the kind of line; a fault that it cannot have is refused.
        seed: root seed. Each fault draws from a stream named after its text, so that one more changes no other.
        note: is called for every injected fault.

    Raises:
        SceneError: a fault that cannot be parsed, or that this wire cannot have.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("seed", "note", "_is_real")

    def __init__(self, faults: Iterable[Fault | str], line_model: LineModel, seed: int, note: Note):
        self.line_model, self.seed, self.note = line_model, seed, note
        self._is_real = False
        self.faults: list[Fault] = []
        self.traffic: list[BusNode] = []
        self.outages: list[Outage] = []
        self.chip: LatencyChip | None = None
        self.close_code: int | None = None
        """The code with which a fault closes the connection after the next flush."""
        self.frame_faults: list[ActiveFault] = []
        self._copies: Counter[str] = Counter()
        for fault in faults:
            self.add(fault)

    def meet(self, is_real: bool) -> None:
        """Take note whether a real line is behind the port.

        Raises:
            SceneError: it is, and cannot have a fault that is on.
        """
        self._is_real = is_real
        for fault in self.faults:
            check_fits(fault, self.line_model, is_real=is_real)

    def add(self, fault: Fault | str) -> Fault:
        """Switch a fault on, also while the wire runs."""
        fault = parse(fault) if isinstance(fault, str) else fault
        check_fits(fault, self.line_model, is_real=self._is_real)
        name = f"fault/{fault}"
        self._copies[name] += 1
        rng = generator(self.seed, name if self._copies[name] == 1 else f"{name}/{self._copies[name]}")
        self.faults.append(fault)
        match fault:
            case FrameFault():
                self.frame_faults.append(ActiveFault(fault, rng))
            case Outage():
                self.outages.append(fault)
            case Traffic():
                self.traffic.append(BusNode(fault, self.line_model, rng))
            case Latency():
                self.chip = LatencyChip(fault)
        return fault

    def remove(self, fault: Fault) -> list[Held]:
        """Switch a fault off, and return what it held back.

        Raises:
            ValueError: it is not on.
        """
        fault = self.faults.pop(self.faults.index(fault))  # an equal one: after a restore the objects are others
        self.traffic = [each for each in self.traffic if each.fault is not fault]
        self.outages = [each for each in self.outages if each is not fault]
        over = [each for each in self.frame_faults if each.fault is fault]
        self.frame_faults = [each for each in self.frame_faults if each.fault is not fault]
        return [held for each in over for held in each.release()]

    def unmount_chip(self) -> bytes:
        """Remove the model of the USB-serial chip, and return the bytes that it held."""
        chip, self.chip = self.chip, None
        return chip.drain() if chip else b""

    def corrupt(self, frame: WireFrame, t_ns: int, source: str, direction: str) -> Parts:
        """Return the frames that the faults make of a frame, each with its delay [ns].

        ``direction`` is ``to_driver`` or ``from_driver``. The log has the fault, the direction and the frame's number.
        """
        parts: Parts = [(frame, 0)]
        for active in self.frame_faults:
            if active.fault.direction not in (direction, "both"):
                continue
            changed: Parts = []
            for before, held_ns in parts:
                after, injected = active.apply(before, (source, direction), t_ns)
                changed += [(each, held_ns + more_ns) for each, more_ns in after]
                if injected:
                    if active.fault.close_code is not None:
                        self.close_code = active.fault.close_code
                    detail = f"{active.fault} [{direction}, frame {active.matched}]"
                    became = [each for each, _ in after]
                    number = active.matched
                    self.note(t_ns, source, active.fault.word, detail, before=before, after=became, frame=number)
            parts = changed
        return parts

    def outage(self, now_ns: int) -> Outage | None:
        """Return the fault that has the link down at ``now_ns``, or None."""
        return next((fault for fault in self.outages if fault.covers(now_ns)), None)

    def release(self) -> list[Held]:
        """Return all frames that are held back, and hold none, because the port was closed."""
        if self.chip:
            self.chip.drain()
        return [held for active in self.frame_faults for held in active.release()]

    def next_ns(self, now_ns: int) -> int | None:
        """Return the time after ``now_ns`` at which a fault of the link acts by itself, or None."""
        if not (self.traffic or self.chip or self.outages):
            return None
        times = [each.next_ns() for each in self.traffic]
        if self.chip:
            times.append(self.chip.next_ns())
        for fault in self.outages:
            times += [time for time in (fault.start_ns, fault.stop_ns) if time is not None and time > now_ns]
        return min((time for time in times if time is not None), default=None)
