"""The plan of trials for a driver: exact faults and events of the device, each with its reason and duration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from firmware_protocols import Rollover, Serial
from tactemu.emulator.replay import DEFAULT_BAUD
from tactemu.judge import forged_replies
from tactemu.wire.faults import Fault, frames, link
from tactemu.wire.faults.fault import FrameFault
from tactemu.wire.faults.options import Ranges
from tactemu.wire.line_models import LineModel, line_model_for

CLEAN = "clean"
"""The name of the run without faults, before all trials."""
GAP = 4
"""Number of readings from edit to edit, so that the losses of one edit are told from those of the next."""
NO_CHECKSUM = (
    "the frames of this device have no checksum, so no driver can recognise a flipped bit in a value; "
    "--baseline with this report as JSON (--json) accepts it"
)
"""The remark on flipped bits that no driver can recognise."""
EDGE_FIRST = 10
"""Number of positions at the head of a frame that are always tried."""
EDGE_LAST = 4
"""Number of positions at the end of a frame that are always tried."""
VALUES = 16
"""Number of positions between them that are tried, by seed."""
HANG_S = 1.2
"""Duration of a hang, a silence or another outage without unplugging [s]."""
UNPLUG_S = 0.8
"""Duration for which the port is gone [s]."""
STOP_S = 0.5
"""Duration for which the driver's process is stopped [s]."""


@dataclass
class Trial:
    """A trial: one fault or event, or several of one kind in sequence."""

    name: str
    why: str
    faults: Sequence[Fault] = ()
    """Faults on the wire; frames are counted from the beginning of the trial."""
    action: str = ""
    """The event besides: ``hang``, ``unplug``, ``reset``, ``rate`` ..."""
    seconds: float = 0.0
    """Duration of the action [s]."""
    rate_hz: float = 0.0
    """Sampling rate during the action ``rate`` [Hz]."""
    preset: str = ""
    """Name of the counter or clock that is brought to its rollover."""
    times: int = 1
    """Number of repetitions, each after the driver has recovered."""
    recovers: bool = True
    """True if the driver should recover afterwards, in the same process."""
    skipped: str = ""
    """The reason why it is not tried."""
    lacks_time: bool = False
    """True if that is the spent budget."""
    remark: str = ""
    """A reason for wrong values that is not the driver's."""
    takes_s: float = 0.0
    """Estimated duration [s]."""

    def as_dict(self) -> dict[str, Any]:
        """Return the trial as JSON data, with faults as text and without empty fields."""
        data = {each.name: getattr(self, each.name) for each in fields(self)} | {"faults": list(map(str, self.faults))}
        return {key: value for key, value in data.items() if value not in ("", 0.0, [])}

    @property
    def edits(self) -> list[FrameFault]:
        """The faults that hit frames by their numbers."""
        return [each for each in self.faults if isinstance(each, FrameFault) and each.frames]


@dataclass
class LineFacts:
    """The facts on which the plan depends: the line, and its traffic in the run without faults."""

    line: LineModel = field(default_factory=lambda: line_model_for(Serial(baud=DEFAULT_BAUD)))
    """The line between driver and device."""
    is_real: bool = False
    """True if a real line is behind the port."""
    asks: bool = False
    """True if the driver polls the device; False if the device streams."""
    talks: bool = False
    """True if the driver sends while it reads."""
    sets_rate: bool = False
    """True if the driver sets the sampling rate."""
    frames: Sequence[str] = ()
    """Frames of the last readings to the driver, as text."""
    requests: Sequence[str] = ()
    """Frames from the driver, as text."""
    frames_per_row: int = 1
    """Number of frames for one row."""
    row_s: float = 0.01
    """Time from row to row [s]."""
    period_s: float = 0.01
    """Sampling period of the device [s]."""
    rollovers: Sequence[Rollover] = ()
    """Counters and clocks on the wire."""
    replies: Sequence[str] = ()
    """Constant answers of the device to commands, as hex."""
    identifiers: Sequence[int] = ()
    """CAN identifiers in use."""
    lacks_checksum: bool = False
    """True if no driver can recognise a flipped bit."""
    taxels: int = 1
    """Number of taxels."""
    numbered: bool = False
    """True if frames carry a number or a time, by which a driver can recognise old ones."""


def positions(size: int, random: np.random.Generator, every: bool = False) -> list[int]:
    """Return byte positions in a frame: its head and end (header, counters, checksums) and some values between."""
    if every or size <= EDGE_FIRST + EDGE_LAST + VALUES:
        return list(range(size))
    between = np.arange(EDGE_FIRST, size - EDGE_LAST)
    chosen = {int(between[0]), int(between[-1])}
    chosen |= set(random.choice(between, min(VALUES - 2, len(between)), replace=False).tolist())
    return sorted({*range(EDGE_FIRST), *chosen, *range(size - EDGE_LAST, size)})


def size_of(frame: str) -> int:
    """Return the number of data bytes of a frame given as text."""
    return len(frame.rpartition("#")[2].replace("R", "")) // 2


class Plan:
    """A plan of the trials for one device and driver."""

    def __init__(self, facts: LineFacts, seed: int = 0, every: bool = False):
        self.facts, self.every = facts, every
        self.random = np.random.default_rng(seed)

    def trials(self) -> list[Trial]:
        """Return all trials; those that do not apply have a reason in :attr:`Trial.skipped`."""
        found = [*self._frames(), *self._streams(), *self._answers(), *self._requests(), *self._bus()]
        found += [*self._outages(), *self._device()]
        for trial in found:
            trial.takes_s = trial.takes_s or self._estimate(trial)
        return found

    def _estimate(self, trial: Trial) -> float:
        """Return the estimated duration of a trial: readings until the last edit, the action and the recovery [s]."""
        frames = max([fault.frames[0][0] for fault in trial.edits], default=0) / max(1, self.facts.frames_per_row)
        return frames * self.facts.row_s + trial.seconds + 12 * self.facts.row_s + 0.15

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _hits(self, count: int, gap: int = GAP) -> list[int]:
        """Return the numbers of the frames to edit, each time another one of a reading's frames."""
        per = max(1, self.facts.frames_per_row)
        places = self.random.integers(per, size=count) if per > 1 else np.zeros(count, int)
        return [1 + per * (1 + gap * k) + int(place) for k, place in enumerate(places)]

    def _size(self, number: int) -> int:
        """Return the size of the frame that will have this number, since frames repeat in their order [byte]."""
        frames = self.facts.frames
        per = max(1, self.facts.frames_per_row)
        return size_of(frames[-per:][(number - 1) % min(per, len(frames))]) if frames else 8

    def _at_each(self, edit: Callable[[Ranges, int, int], Fault], gap: int = GAP, first: int = 0) -> list[Fault]:
        """Return an edit for each position of a frame from ``first`` on, made of its number, the byte and a random bit.

        If a reading has several frames, the edits hit positions of several of them.
        """
        per = max(1, self.facts.frames_per_row)
        size = max((size_of(frame) for frame in self.facts.frames[-per:]), default=8)
        spots = positions(size, self.random, self.every)
        if per > 1:
            spots = (spots * 3)[:24] if size <= 8 else spots
        hits = self._hits(len(spots), gap)
        bits = self.random.integers(8, size=len(spots)).tolist()
        return [
            edit(_frame(hit), spot, bit)
            for hit, spot, bit in zip(hits, spots, bits)
            if first <= spot < (self._size(hit) or size)
        ]

    def _meets(self, fault: type[Fault]) -> bool:
        """Return True if a driver meets a fault on this kind of line."""
        facts = self.facts
        return fault.word in facts.line.likely_faults and not (facts.is_real and fault.word in facts.line.only_modelled)

    @property
    def _own_checksum(self) -> str:
        """The reason why flipped bits are not tried."""
        return f"{self._kind} has a checksum of its own: damaged frames do not arrive"

    @property
    def _kind(self) -> str:
        """The kind of line as it is written in a sentence."""
        kind = self.facts.line.kind
        return kind if kind in ("serial", "websocket", "bulk") else kind.upper()

    def _frames(self) -> Iterator[Trial]:
        """Yield the trials with single frames on any line."""
        why = "one bit is flipped, at each position of a frame in turn"
        if self._meets(frames.Flip):
            flips = self._at_each(lambda n, at, bit: frames.Flip(frames=n, byte=at, bit=bit))
            yield Trial("flipped", why, flips, remark=NO_CHECKSUM if self.facts.lacks_checksum else "")
        else:
            yield Trial("flipped", why, skipped=self._own_checksum)
        if self._meets(frames.Truncate):
            why = "the end of a frame is missing, as with a full buffer"
            yield Trial("cut", why, self._at_each(lambda n, at, bit: frames.Truncate(frames=n, length=at)))
        if self._meets(frames.Lose):
            number = self._hits(1)[0]
            why = "one cut alone, since several can resynchronise a driver by chance"
            cut = frames.Truncate(frames=_frame(number), length=max(1, self._size(number) // 3))
            yield Trial("one cut", why, [cut])
            why = "one byte is missing, at each position of a frame in turn"
            yield Trial("byte lost", why, self._at_each(lambda n, at, bit: frames.Lose(frames=n, byte=at)))
            size = self._size(self._hits(1)[0])
            lost = frames.Lose(frames=_frame(self._hits(1)[0]), byte=size // 2)
            yield Trial("one byte lost", "one byte alone is missing", [lost])
        yield Trial("dropped", "frames are missing", _each(frames.Drop, self._hits(8, 5)))
        first = self._hits(1)[0]
        burst = frames.Drop(frames=_frame(first, 20 * max(1, self.facts.frames_per_row)))
        yield Trial("burst", "twenty consecutive readings are missing", [burst])
        yield Trial("doubled", "frames arrive twice", _each(frames.Duplicate, self._hits(8, 5)))

    def _streams(self) -> Iterator[Trial]:
        """Yield the trials with a stream of bytes."""
        if not self._meets(frames.Garbage):
            return
        size = self._size(1)
        head = bytes.fromhex(self.facts.frames[-1][:8]) if self.facts.frames else b"\xaa\x55"
        hits = self._hits(10, 5)
        junk = [self.random.bytes(int(self.random.integers(1, 17))) for _ in hits[:4]]
        junk += [head[:k] for k in range(1, 5)] + [2 * head, 2 * head]
        extra: list[Fault] = [frames.Garbage(frames=_frame(n), data=data) for n, data in zip(hits, junk)]
        yield Trial("garbage", "extra bytes before a frame: noise, or the beginning of a frame", extra)
        step_us = max(50, min(1000, round(0.4e6 * self.facts.row_s / max(1, size))))
        first = self._hits(1)[0]
        if size <= 256:
            chunks = frames.Chunk(frames=_frame(first, 10), by_ns=1000 * step_us)
            yield Trial("chunked", "bytes arrive one at a time", [chunks])
        split_ns = 1000 * max(200, round(0.3e6 * self.facts.row_s))
        splits = self._at_each(lambda n, at, bit: frames.Split(frames=n, after=at, by_ns=split_ns), gap=2, first=1)
        yield Trial("split", "frames arrive in two pieces", splits)
        if not self.facts.asks:
            yield Trial("merged", "frames arrive together with the next", _each(frames.Merge, self._hits(6, 5)))
            late_ns = 1_000_000 * max(1, round(2500 * self.facts.row_s))
            late = _each(frames.Late, self._hits(4, 8), by_ns=late_ns)
            yield Trial("late", "frames are delayed by some periods", late)
            about = "a stream keeps the order of its bytes: no frame arrives twice or out of order"
            yield Trial("reordered", "frames overtake one another", skipped=about)

    def _answers(self) -> Iterator[Trial]:
        """Yield the trials with the answers to a driver that polls."""
        facts = self.facts
        if not facts.asks:
            return
        times = zip(self._hits(4, 6), (150_000_000, 700_000_000))
        late = [frames.Late(frames=_frame(n), by_ns=by_ns) for n, by_ns in times]
        yield Trial("late answer", "an answer arrives after the next question", late, takes_s=2.5)
        recorded = facts.frames[-4 * max(1, facts.frames_per_row) :]
        forged = forged_replies.forged_values(recorded, with_checksum=self._meets(frames.Flip))
        for reply in forged:
            yield Trial(reply.name, reply.why, [fault for n in self._hits(3, 5) for fault in reply.faults(_frame(n))])
        foreign = [bytes.fromhex(reply) for reply in facts.replies if reply][:6]
        why = "the answer to another command arrives"
        if foreign:
            hits = self._hits(len(foreign), 5)
            faults = [frames.Replace(frames=_frame(n), data=data) for n, data in zip(hits, foreign)]
            yield Trial("another answer", why, faults)
        elif not forged:
            yield Trial("another answer", why, skipped="no other answer of this device is known")

    def _requests(self) -> Iterator[Trial]:
        """Yield the trials with the driver's own requests."""
        facts = self.facts
        if not facts.talks:
            about = "the driver sends nothing while it reads"
            yield Trial("requests damaged", "requests of the driver do not arrive", skipped=about)
            return
        size = min(24, max((size_of(frame) for frame in facts.requests), default=8))
        hits = self._hits(size + 4, 3)
        why = "one bit of a request is flipped"
        if self._meets(frames.Flip):
            flips = [frames.Flip(frames=_frame(n), byte=k, direction="from_driver") for k, n in enumerate(hits[:size])]
            yield Trial("requests damaged", why, flips)
        else:
            yield Trial("requests damaged", why, skipped=self._own_checksum)
        yield Trial("requests lost", "requests are lost", _each(frames.Drop, hits[:4], direction="from_driver"))

    def _bus(self) -> Iterator[Trial]:
        """Yield the trials with a bus or with datagrams."""
        if self._meets(link.Load):
            foreign = _neighbours(self.facts.identifiers, self.random)
            loads = [link.Load(share=0.03, arbitration_id=identifier) for identifier in foreign]
            about = "other nodes use identifiers that differ in one bit"
            yield Trial("foreign frames", about, loads, "traffic", 0.6)
            yield Trial("busy bus", "other nodes take a third of the bus", [link.Load(share=0.33)], "traffic", 0.5)
        if self._meets(frames.ErrorFrame):
            yield Trial(
                "error frames", "frames are destroyed and sent again", _each(frames.ErrorFrame, self._hits(6, 4))
            )
        if self._meets(link.BusOff):
            yield Trial("bus off", "the device leaves the bus", [link.BusOff()], "hang", HANG_S)
        if self.facts.asks:
            return
        if self._meets(frames.Reorder):
            yield Trial("reordered", "frames arrive after the next one", _each(frames.Reorder, self._hits(6, 5)))
        if self._meets(frames.Stray):
            yield Trial("old frame", "an old frame arrives again", _each(frames.Stray, self._hits(6, 5)))

    # -- the port and the device ---------------------------------------------------------------------------------------

    def _outages(self) -> Iterator[Trial]:
        kind, connector = self._kind, self.facts.line.connector
        yield Trial("slow reader", "the driver's process is stopped", action="stop", seconds=STOP_S)
        if self._meets(frames.Silence):
            yield Trial("silence", "no data pass, but the port stays open", [frames.Silence()], "hang", HANG_S)
        yield Trial("hang", "the device neither samples nor answers", action="hang", seconds=HANG_S)
        if self._meets(link.Unplug):
            about = "the port disappears and comes back, and again once the driver has recovered"
            yield Trial("unplug", about, [link.Unplug()], "unplug", UNPLUG_S, times=2, takes_s=3.6)
        else:
            has = "a bus cannot be unplugged" if self.facts.line.has_identifiers else f"{kind} has no plug"
            about = self.facts.line.only_modelled.get("unplug", has)
            yield Trial("unplug", "the port disappears and comes back", skipped=about)
        if self._meets(link.HalfOpen):
            yield Trial("half open", "the other end does not answer", [link.HalfOpen()], "halfopen", HANG_S)
        is_usb, why = bool(getattr(connector, "usb", False)), "the device runs at another speed for a while"
        if hasattr(connector, "baud") and not is_usb:
            yield Trial("wrong baud", why, action="baud", seconds=0.5)
        else:
            about = "the speed of a USB port has no effect" if is_usb else f"{kind} has no line speed"
            yield Trial("wrong baud", why, skipped=about)

    def _device(self) -> Iterator[Trial]:
        facts = self.facts
        about = "the device restarts with its start-up messages, and again once the driver has recovered"
        yield Trial("reset", about, action="reset", seconds=0.3, times=2, takes_s=1.6)
        for each in facts.rollovers:
            about = "" if each.state else "the device declares nothing that sets it"
            yield Trial(
                f"{each.name} wraps", f"its {each.bits} bits roll over", action="wrap", preset=each.name,
                seconds=10.0 + 40 * facts.row_s, takes_s=4.0, skipped=about,
            )  # fmt: skip
        if not facts.rollovers:
            yield Trial("counter wraps", "a counter rolls over", skipped="the device declares none that can be set")
        yield Trial("saturated", "forces exceed the range of the channels", action="saturate", seconds=30 * facts.row_s)
        about = "" if facts.taxels > 1 else "the device has one taxel"
        yield Trial("dead taxel", "one taxel measures no force", action="dead", seconds=30 * facts.row_s, skipped=about)
        if facts.asks:
            about = "the driver sets the pace"
        else:
            about = "the driver sets the rate" if facts.sets_rate else ""
        slow, fast = 0.5 / facts.period_s, min(1000.0, max(500.0, 2 / facts.period_s))
        yield Trial("half the rate", "the device samples less often", action="rate", rate_hz=slow, seconds=0.5,
                    skipped=about)  # fmt: skip
        yield Trial("high rate", "more readings per second; memory is measured", action="rate", rate_hz=fast,
                    seconds=2.5, skipped=about)  # fmt: skip
        if about:
            yield Trial(
                "memory", "memory is measured for some seconds", action="rate", rate_hz=1 / facts.period_s, seconds=3.0
            )


def _each(fault: type[FrameFault], hits: Iterable[int], **options: Any) -> list[FrameFault]:
    """Return a fault of single frames for each of their numbers."""
    return [fault(frames=_frame(n), **options) for n in hits]


def _frame(first: int, count: int = 1) -> Ranges:
    """Return the numbers of one or more consecutive frames."""
    return ((first, first + count - 1),)


def _neighbours(identifiers: Sequence[int], random: np.random.Generator, most: int = 8) -> list[int]:
    """Return unused identifiers that differ in one bit from those in use."""
    used = set(identifiers)
    bits = 29 if any(ident > 0x7FF for ident in used) else 11
    near = sorted({ident ^ 1 << bit for ident in used for bit in range(bits)} - used - {0})
    return sorted(random.choice(near, min(most, len(near)), replace=False).tolist()) if near else []
