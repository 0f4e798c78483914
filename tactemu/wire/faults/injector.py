"""Applies faults to what passes a wire: decides, corrupts, counts and logs."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import ClassVar, Protocol

import numpy as np

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.frames import payload
from tactemu.base.random_streams import generator
from tactemu.wire.faults.fault import Fault, parse
from tactemu.wire.faults.frames import CORRUPTIONS, Parts
from tactemu.wire.faults.link import LatencyChip, Traffic
from tactemu.wire.line_models import LineModel


class Note(Protocol):
    """Called once for every injected fault."""

    def __call__(
        self,
        t_ns: int,
        source: str,
        kind: str,
        detail: str,
        *,
        before: WireFrame | str = "",
        after: Sequence[WireFrame] = (),
    ) -> None:
        """``before`` is the frame that the fault befell, ``after`` what became of it."""
        ...


Key = tuple[str, str]
"""Source and direction of a frame: what one fault holds back of one is not mixed with the others."""

Held = tuple[WireFrame, str, str]
"""A frame that a fault holds back, with its source and direction."""

_REMEMBERED = 16
"""Earlier frames that a stray one is chosen from."""


class FrameFault:
    """A fault of single frames at work: its random stream, and what it holds back."""

    def __init__(self, fault: Fault, rng: np.random.Generator):
        self.fault = fault
        self.rng = rng
        self._spent = False
        self._matched = 0
        self._held: dict[Key, tuple[WireFrame, int]] = {}
        """With the number of frames that go before it."""
        self._earlier: dict[Key, deque[WireFrame]] = {}

    def apply(self, frame: WireFrame, key: Key, t_ns: int) -> tuple[Parts, bool]:
        """What becomes of the frame, and whether a fault was injected."""
        hit = self._hits(frame, t_ns)
        kind = self.fault.kind
        if kind in ("reorder", "merge"):
            return self._hold(frame, key, hit)
        if kind == "stray":
            return self._stray(frame, key, hit)
        spoiled = CORRUPTIONS[kind](frame, self.fault, self.rng) if hit else None
        return ([(frame, 0)], False) if spoiled is None else (spoiled, True)

    def forget(self) -> list[Held]:
        """It is over, or the port was closed: what it holds back."""
        held = [(frame, source, direction) for (source, direction), (frame, _) in self._held.items()]
        self._held.clear()
        self._earlier.clear()
        return held

    def _hits(self, frame: WireFrame, t_ns: int) -> bool:
        """Whether to spoil this frame. One random number is drawn for every frame that target and time match."""
        fault = self.fault
        if self._spent or not fault.covers(t_ns) or (isinstance(frame, CanFrame) and frame.is_error_frame):
            return False
        if fault.arbitration_id is not None and not (
            isinstance(frame, CanFrame) and frame.arbitration_id == fault.arbitration_id
        ):
            return False
        if fault.prefix and not payload(frame).startswith(fault.prefix):
            return False
        self._matched += 1
        if fault.frames and not self._is_numbered():
            return False
        if self._matched % fault.every or (fault.probability < 1 and self.rng.random() >= fault.probability):
            return False
        self._spent |= fault.once
        return True

    @property
    def matched(self) -> int:
        """Number of the frame that the target matched last, from 1."""
        return self._matched

    def _is_numbered(self) -> bool:
        number = self._matched
        self._spent = number >= max(last for _, last in self.fault.frames)
        return any(first <= number <= last for first, last in self.fault.frames)

    def _hold(self, frame: WireFrame, key: Key, hit: bool) -> tuple[Parts, bool]:
        held, left = self._held.pop(key, (None, 0))
        if held is None and hit:
            self._held[key] = frame, self.fault.amount or 1
            return [], False
        if held is None:
            return [(frame, 0)], False
        if left > 1:
            self._held[key] = held, left - 1
            return [(frame, 0)], False
        if self.fault.kind == "reorder":
            return [(frame, 0), (held, 0)], True
        return [(payload(held) + payload(frame), 0)], True

    def _stray(self, frame: WireFrame, key: Key, hit: bool) -> tuple[Parts, bool]:
        earlier = self._earlier.setdefault(key, deque(maxlen=_REMEMBERED))
        parts: Parts = [(frame, 0)]
        strays = hit and bool(earlier)
        if strays:
            parts.append((earlier[int(self.rng.integers(len(earlier)))], 0))
        earlier.append(frame)
        return parts, strays


class Injector:
    """All faults of one wire.

    Args:
        faults: as text or parsed.
        line_model: the kind of line; a fault that it cannot have is refused.
        seed: root seed. Each fault draws from a stream named after its text, so that one more changes no other.
        note: told of every injected fault.

    Raises:
        SceneError: a fault that cannot be parsed, or that this wire cannot have.
    """

    TRANSIENT_FIELDS: ClassVar[tuple[str, ...]] = ("seed", "note")

    def __init__(self, faults: Iterable[Fault | str], line_model: LineModel, seed: int, note: Note):
        self.line_model, self.seed, self.note = line_model, seed, note
        self.faults: list[Fault] = []
        self.traffic: list[Traffic] = []
        self.chip: LatencyChip | None = None
        self.closing: Fault | None = None
        """The connection is to be closed when what waits has gone."""
        self._frames: list[FrameFault] = []
        self._outages: list[Fault] = []
        self._copies: Counter[str] = Counter()
        for fault in faults:
            self.add(fault)

    def add(self, fault: Fault | str) -> Fault:
        """Switch a fault on, also while the wire runs."""
        fault = parse(fault) if isinstance(fault, str) else fault
        fault.check_fits(self.line_model.kind)
        name = f"fault/{fault}"
        self._copies[name] += 1
        rng = generator(self.seed, name if self._copies[name] == 1 else f"{name}/{self._copies[name]}")
        self.faults.append(fault)
        if fault.kind in ("unplug", "busoff", "halfopen"):
            self._outages.append(fault)
        elif fault.kind == "latency":
            self.chip = LatencyChip(fault)
        elif fault.kind in ("babble", "load"):
            self.traffic.append(Traffic(fault, self.line_model, rng))
        else:
            self._frames.append(FrameFault(fault, rng))
        return fault

    def remove(self, fault: Fault) -> list[Held]:
        """Switch a fault off; returns what it held back.

        Raises:
            ValueError: it is not on.
        """
        fault = self.faults.pop(self.faults.index(fault))  # one that is equal: a restored state has its own
        self.traffic = [each for each in self.traffic if each.fault is not fault]
        self._outages = [each for each in self._outages if each is not fault]
        over = [each for each in self._frames if each.fault is fault]
        self._frames = [each for each in self._frames if each.fault is not fault]
        return [held for each in over for held in each.forget()]

    @property
    def has_frame_faults(self) -> bool:
        """Whether any fault is of single frames."""
        return bool(self._frames)

    def unmount_chip(self) -> bytes:
        """Take the USB-serial chip out; what it held."""
        chip, self.chip = self.chip, None
        return chip.empty() if chip else b""

    def corrupt(self, frame: WireFrame, t_ns: int, source: str, direction: str) -> Parts:
        """Return a frame as the faults leave it: frames, and by how much each is held back [ns].

        ``direction`` is ``to_driver`` or ``from_driver``. The log's detail is the fault and the direction.
        """
        parts: Parts = [(frame, 0)]
        for active in self._frames:
            if active.fault.direction not in (direction, "both"):
                continue
            spoiled: Parts = []
            for before, held_ns in parts:
                after, injected = active.apply(before, (source, direction), t_ns)
                spoiled += [(each, held_ns + more_ns) for each, more_ns in after]
                if injected:
                    if active.fault.kind == "close":
                        self.closing = active.fault
                    detail = f"{active.fault} [{direction}, frame {active.matched}]"
                    became = [each for each, _ in after]
                    self.note(t_ns, source, active.fault.kind, detail, before=before, after=became)
            parts = spoiled
        return parts

    def outage(self, now_ns: int) -> Fault | None:
        """Return the fault that has the link down at this moment."""
        return next((fault for fault in self._outages if fault.covers(now_ns)), None)

    def forget(self) -> list[Held]:
        """The port was closed: nothing is held back for the next who opens it. What was, is returned."""
        if self.chip:
            self.chip.empty()
        return [held for active in self._frames for held in active.forget()]

    def next_ns(self, now_ns: int) -> int | None:
        """When something of the link happens by itself, after ``now_ns``."""
        if not (self.traffic or self.chip or self._outages):
            return None
        times = [each.next_ns() for each in self.traffic]
        if self.chip:
            times.append(self.chip.next_ns())
        for fault in self._outages:
            times += [time for time in (fault.start_ns, fault.stop_ns) if time is not None and time > now_ns]
        return min((time for time in times if time is not None), default=None)
