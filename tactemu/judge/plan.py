"""The plan of trials for a driver: exact faults and events of the device, each with its reason and duration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from firmware_protocols import Rollover
from tactemu.judge import forged_replies

GAP = 4
"""Number of readings from edit to edit, so that the losses of one edit are told from those of the next."""
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
    faults: list[str] = field(default_factory=list)
    """Faults in the language of ``--fault``; frames are counted from the beginning of the trial."""
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
    takes_s: float = 0.0
    """Estimated duration [s]."""

    def as_dict(self) -> dict[str, Any]:
        """Return the trial as JSON data, without empty fields."""
        return {key: value for key, value in asdict(self).items() if value not in ("", 0.0, [])}


@dataclass
class LineFacts:
    """The facts on which the plan depends: the line, and its traffic in the run without faults."""

    wire: str = "serial"
    """Kind of the line: serial, can, tcp, udp, websocket, dds."""
    usb: bool = False
    """True if the serial line is USB, so that its speed has no effect."""
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
        numbers = [int(word.partition("-")[0]) for fault in trial.faults for word in _after(fault, "frame")]
        frames = max(numbers, default=0) / max(1, self.facts.frames_per_row)
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

    def _at_each(self, words: str, gap: int = GAP, last: int = 0) -> list[str]:
        """Return an edit for each position of a frame, from a template with ``{frame}``, ``{at}`` and ``{bit}``.

        If a reading has several frames, the edits hit positions of several of them.
        """
        per = max(1, self.facts.frames_per_row)
        size = max((size_of(frame) for frame in self.facts.frames[-per:]), default=8)
        spots = [spot for spot in positions(size, self.random, self.every) if spot < size - last]
        if per > 1:
            spots = (spots * 3)[:24] if size <= 8 else spots
        hits = self._hits(len(spots), gap)
        bits = self.random.integers(8, size=len(spots))
        return [
            words.format(frame=hit, at=spot, bit=bit)
            for hit, spot, bit in zip(hits, spots, bits)
            if spot < size_or(self._size(hit), size) - last
        ]

    def _bytewise(self) -> bool:
        return self.facts.wire in ("serial", "tcp")

    def _frames(self):
        """Yield the trials with single frames on any line."""
        why = "one bit is flipped, at each position of a frame in turn"
        if self.facts.wire == "serial":
            yield Trial("flipped", why, self._at_each("flip frame {frame} byte {at} bit {bit}"))
        else:
            about = f"{self.facts.wire} has a checksum of its own: damaged frames do not arrive"
            yield Trial("flipped", why, skipped=about)
        why = "the end of a frame is missing, as with a full buffer"
        if self._bytewise() or self.facts.wire in ("can", "udp"):
            yield Trial("cut", why, self._at_each("truncate frame {frame} to {at}"))
        if self._bytewise():
            yield Trial("one cut", "one cut alone, since several can resynchronise a driver by chance", self._one_cut())
            yield Trial(
                "byte lost",
                "one byte is missing, at each position of a frame in turn",
                self._at_each("lose frame {frame} byte {at}"),
            )
            size = self._size(self._hits(1)[0])
            lost = [f"lose frame {self._hits(1)[0]} byte {size // 2}"]
            yield Trial("one byte lost", "one byte alone is missing", lost)
        yield Trial("dropped", "frames are missing", [f"drop frame {n}" for n in self._hits(8, 5)])
        first = self._hits(1)[0]
        burst = 20 * max(1, self.facts.frames_per_row)
        yield Trial("burst", "twenty consecutive readings are missing", [f"drop frame {first}-{first + burst - 1}"])
        yield Trial("doubled", "frames arrive twice", [f"duplicate frame {n}" for n in self._hits(8, 5)])

    def _one_cut(self) -> list[str]:
        number = self._hits(1)[0]
        return [f"truncate frame {number} to {max(1, self._size(number) // 3)}"]

    def _streams(self):
        """Yield the trials with a stream of bytes."""
        if not self._bytewise():
            return
        size = self._size(1)
        head = self.facts.frames[-1][:8] if self.facts.frames else "aa55"
        hits = self._hits(10, 5)
        noise = [f"garbage frame {n} hex={self.random.bytes(int(self.random.integers(1, 17))).hex()}" for n in hits[:4]]
        false = [f"garbage frame {n} hex={head[: 2 * k]}" for n, k in zip(hits[4:8], (1, 2, 3, 4)) if head[: 2 * k]]
        false += [f"garbage frame {n} hex={head * 2}" for n in hits[8:]]
        yield Trial("garbage", "extra bytes before a frame: noise, or the beginning of a frame", noise + false)
        step_us = max(50, min(1000, round(0.4e6 * self.facts.row_s / max(1, size))))
        first = self._hits(1)[0]
        chunks = [f"chunk frame {first}-{first + 9} by {step_us}us"]
        if size <= 256:
            yield Trial("chunked", "bytes arrive one at a time", chunks)
        split_us = max(200, round(0.3e6 * self.facts.row_s))
        splits = self._at_each(f"split frame {{frame}} after {{at}} by {split_us}us", gap=2)
        yield Trial("split", "frames arrive in two pieces", [s for s in splits if " after 0 " not in s])
        if not self.facts.asks:
            yield Trial(
                "merged", "frames arrive together with the next", [f"merge frame {n}" for n in self._hits(6, 5)]
            )
            late_ms = max(1, round(2500 * self.facts.row_s))
            late = [f"late frame {n} by {late_ms}ms" for n in self._hits(4, 8)]
            yield Trial("late", "frames are delayed by some periods", late)
            about = "a stream keeps the order of its bytes: no frame arrives twice or out of order"
            yield Trial("reordered", "frames overtake one another", skipped=about)

    def _answers(self):
        """Yield the trials with the answers to a driver that polls."""
        facts = self.facts
        if not facts.asks:
            return
        hits = self._hits(4, 6)
        late = [f"late frame {hits[0]} by 150ms", f"late frame {hits[1]} by 700ms"]
        yield Trial("late answer", "an answer arrives after the next question", late, takes_s=2.5)
        forged = forged_replies.forged_values(facts.frames[-4 * max(1, facts.frames_per_row) :], facts.wire)
        for reply in forged:
            yield Trial(reply.name, reply.why, [fault for n in self._hits(3, 5) for fault in reply.faults(n)])
        foreign = [reply for reply in facts.replies if reply][:6]
        if foreign:
            faults = [f"replace frame {n} hex={data}" for n, data in zip(self._hits(len(foreign), 5), foreign)]
            yield Trial("another answer", "the answer to another command arrives", faults)
        elif not forged:
            about = "no other answer of this device is known"
            yield Trial("another answer", "the answer to another command arrives", skipped=about)

    def _requests(self):
        """Yield the trials with the driver's own requests."""
        facts = self.facts
        if not facts.talks:
            about = "the driver sends nothing while it reads"
            yield Trial("requests damaged", "requests of the driver do not arrive", skipped=about)
            return
        size = min(24, max((size_of(frame) for frame in facts.requests), default=8))
        hits = self._hits(size + 4, 3)
        faults = [f"flip frame {n} byte {k} from_driver" for k, n in enumerate(hits[:size])]
        if facts.wire == "serial":
            yield Trial("requests damaged", "one bit of a request is flipped", faults)
        else:
            about = f"{facts.wire} has a checksum of its own: damaged frames do not arrive"
            yield Trial("requests damaged", "one bit of a request is flipped", skipped=about)
        yield Trial("requests lost", "requests are lost", [f"drop frame {n} from_driver" for n in hits[:4]])

    def _bus(self):
        """Yield the trials with a bus or with datagrams."""
        facts = self.facts
        if facts.wire == "can":
            foreign = _neighbours(facts.identifiers, self.random)
            loads = [f"load 3% id={ident:#x}" for ident in foreign]
            yield Trial("foreign frames", "other nodes use identifiers that differ in one bit", loads, "traffic", 0.6)
            yield Trial("busy bus", "other nodes take a third of the bus", ["load 33%"], "traffic", 0.5)
            errors = [f"error frame {n}" for n in self._hits(6, 4)]
            yield Trial("error frames", "frames are destroyed and sent again", errors)
            yield Trial("bus off", "the device leaves the bus", ["busoff"], "hang", HANG_S)
        if facts.wire in ("can", "udp") and not facts.asks:
            yield Trial(
                "reordered", "frames arrive after the next one", [f"reorder frame {n}" for n in self._hits(6, 5)]
            )
            yield Trial("old frame", "an old frame arrives again", [f"stray frame {n}" for n in self._hits(6, 5)])

    # -- the port and the device ---------------------------------------------------------------------------------------

    def _outages(self):
        facts = self.facts
        yield Trial("slow reader", "the driver's process is stopped", action="stop", seconds=STOP_S)
        if facts.wire != "can":
            yield Trial("silence", "no data pass, and the port stays", ["silence"], "hang", HANG_S)
        yield Trial("hang", "the device neither samples nor answers", action="hang", seconds=HANG_S)
        if facts.wire in ("serial", "tcp", "websocket"):
            about = "the port disappears and comes back, and again once the driver has recovered"
            yield Trial("unplug", about, ["unplug"], "unplug", UNPLUG_S, times=2, takes_s=3.6)
        else:
            about = "a bus does not go away" if facts.wire == "can" else f"{facts.wire} has no plug"
            yield Trial("unplug", "the port disappears and comes back", skipped=about)
        if facts.wire in ("tcp", "websocket"):
            yield Trial("half open", "the other end does not answer", ["halfopen"], "halfopen", HANG_S)
        if facts.wire == "serial" and not facts.usb:
            yield Trial("wrong baud", "the device runs at another speed for a while", action="baud", seconds=0.5)
        else:
            about = "the speed of a USB port has no effect" if facts.usb else f"{facts.wire} has no line speed"
            yield Trial("wrong baud", "the device runs at another speed for a while", skipped=about)

    def _device(self):
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


def _after(fault: str, word: str) -> list[str]:
    """Return the words that follow a word in a fault's text."""
    words = fault.split()
    return [words[k + 1].split(",")[0] for k, each in enumerate(words[:-1]) if each == word]


def size_or(size: int, other: int) -> int:
    """Return the size, or the other value if the size is 0."""
    return size or other


def _neighbours(identifiers: Sequence[int], random: np.random.Generator, most: int = 8) -> list[int]:
    """Return unused identifiers that differ in one bit from those in use."""
    used = set(identifiers)
    bits = 29 if any(ident > 0x7FF for ident in used) else 11
    near = sorted({ident ^ 1 << bit for ident in used for bit in range(bits)} - used - {0})
    return sorted(random.choice(near, min(most, len(near)), replace=False).tolist()) if near else []
