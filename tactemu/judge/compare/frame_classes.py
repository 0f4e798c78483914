"""The classes of frames that a model sends, learned from its own frames: constants, sums, counters, values.

Nothing here is written for a device: what never changes is a constant, what follows the counts is a value.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from firmware_protocols import CanFrame, Rollover, WireFrame
from firmware_protocols.frames import payload
from firmware_protocols.stuffing import Cobs, Ppp
from tactemu.base.sum_search import FrameSum
from tactemu.judge.compare.sum_rules import find

MIN_FRAMES = 8
"""Least number of frames from which values and counters are learned."""
MAX_SIZES = 4
"""Largest number of lengths of frames that each make a class of their own."""
MAX_END_BYTES = 4
"""Largest number of constant bytes at either end that mark a frame, where no table declares them."""
MAX_APART_BYTES = 8
"""Number of first bytes by which classes of frames are told apart."""
MAX_LEARNED = 96
"""Largest number of frames from which values are learned."""
MAX_KINDS_OF_LINE = 8
"""Largest number of kinds of text lines that are told apart by their words."""
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
CODES = ("u1", "i1", "<u2", ">u2", "<i2", ">i2", "<u4", ">u4", "<i4", ">i4", "<f4", ">f4")
"""The types of values, the preferred ones first."""

Identity = tuple[int, bool, bool] | None
"""Identifier of a CAN frame, and whether it is extended and CAN-FD; ``None`` for bytes."""


@dataclass(frozen=True, slots=True)
class Record:
    """One frame of a model: its bytes, its time, and the counts that it may carry."""

    frame: WireFrame
    t_ns: int
    run: int
    """The number of the run on the bench."""
    counts: np.ndarray | None = None
    """The latest counts of all senses, shape ``(n_channels,)``."""
    sample: int | None = None
    """The number of the sample that it carries; ``None``: it is an answer."""


@dataclass(frozen=True, slots=True)
class NumberField:
    """A value in a frame: a linear function of one channel of the counts."""

    channel: int
    at: int
    code: str
    slope: float = 1.0
    offset: float = 0.0
    """The count is ``slope * number + offset``."""

    def numbers(self, frames: np.ndarray, *, swapped: bool = False) -> np.ndarray:
        """Return the counts in frames, uint8 of shape ``(n, size)``; with ``swapped``, in the other byte order."""
        code = self.code.translate({60: ">", 62: "<"}) if swapped else self.code
        return self.slope * decode(frames, self.at, code) + self.offset


@dataclass(frozen=True, slots=True)
class CounterField:
    """A counter or clock in a frame."""

    rollover: Rollover
    at: int
    code: str

    @property
    def modulus(self) -> int:
        """The number of its values."""
        return 1 << self.rollover.bits


@dataclass
class FrameClass:
    """A class of frames: unasked ones of one kind, or the answers to one command."""

    label: str
    identity: Identity = None
    envelope: str = "plain"
    """``plain``, ``line`` (text), ``ppp`` or ``cobs``; all that follows is of the content."""
    size: int | None = None
    """The length of the content [bytes]; ``None``: it varies."""
    sizes: tuple[int, int] = (0, 0)
    """The least and the greatest length."""
    const: dict[int, int] = field(default_factory=dict)
    """The bytes that never change, by place; places before the first change where lengths vary."""
    settings: dict[int, str] = field(default_factory=dict)
    """The bytes that an option of the device changes, with its name."""
    length_setting: str = ""
    """The option of the device, a text, that changes the length of an answer."""
    sum: FrameSum | None = None
    counters: list[CounterField] = field(default_factory=list)
    numbers: list[NumberField] = field(default_factory=list)
    words: frozenset[tuple[bytes, ...]] = frozenset()
    """The texts between the numbers of a line, of each kind of line; empty: too many to be known."""
    names: dict[int, str] = field(default_factory=dict)
    """The names of the fields of the frame's table, by the place of each byte."""
    fixed: set[int] = field(default_factory=set)
    """The places of :attr:`const` that the table, the documented answer, head or tail declare to be constant."""
    is_unmarked: bool = False
    """True for the only frames on a line, if they have neither a constant nor a sum to find them by."""
    rate_hz: float = 0.0
    """Frames per second of a model that is not asked."""
    sample_hz: float = 0.0
    """Samples per second that have such frames; less than the rate where a sample has several."""

    @property
    def head(self) -> bytes:
        """The constant bytes with which every frame begins."""
        n = next(k for k in range(len(self.const) + 1) if k not in self.fixed)
        return bytes(self.const[k] for k in range(n))

    @property
    def fixed_bytes(self) -> dict[int, int]:
        """The bytes at the declared constant places."""
        return {at: self.const[at] for at in sorted(self.fixed)}

    def fits(self, content: bytes) -> bool:
        """Return True if a content has the length and the constants of the class."""
        if self.envelope == "line":
            return not self.words or tuple(NUMBER.split(content)) in self.words
        if self.size is not None and len(content) != self.size:
            return False
        return all(at < len(content) and content[at] == self.const[at] for at in self.fixed)


def decode(frames: np.ndarray, at: int, code: str) -> np.ndarray:
    """Return the numbers at one place of frames, uint8 of shape ``(n, size)``, as floats of shape ``(n,)``."""
    dtype = np.dtype(code)
    with np.errstate(invalid="ignore"):  # bytes of integers may be no number as a float
        return np.ascontiguousarray(frames[:, at : at + dtype.itemsize]).view(dtype).ravel().astype(float)


def matrix(contents: Sequence[bytes]) -> np.ndarray:
    """Return contents of one length as uint8 of shape ``(n, size)``."""
    return np.frombuffer(b"".join(contents), np.uint8).reshape(len(contents), -1)


# -- envelopes ---------------------------------------------------------------------------------------------------------


def envelope_of(frames: Sequence[bytes]) -> str:
    """Return the envelope of a model's frames."""
    if all(frame[-1:] == b"\n" and all(9 <= byte < 127 for byte in frame) for frame in frames):
        return "line"
    if all(frame[:1] == frame[-1:] == b"\x7e" and b"\x7e" not in frame[1:-1] and len(frame) > 2 for frame in frames):
        return "ppp"
    sizes = {len(frame) for frame in frames}
    if len(frames) >= MIN_FRAMES and all(frame[-1:] == b"\0" and b"\0" not in frame[:-1] for frame in frames):
        return "cobs" if min(sizes) > 4 else "plain"
    return "plain"


def opened(data: bytes, envelope: str) -> list[bytes]:
    """Return the contents of the complete frames in bytes; plain bytes are one content."""
    from collections import Counter

    match envelope:
        case "line":
            return [line + b"\n" for line in data.split(b"\n")[:-1]]
        case "ppp":
            return Ppp(counters=Counter(), longest=1 << 20).cut(data)
        case "cobs":
            return Cobs(counters=Counter(), longest=1 << 20).cut(data)
    return [data] if data else []


def identity_of(frame: WireFrame) -> Identity:
    """Return the identity of a CAN frame."""
    return (frame.arbitration_id, frame.is_extended_id, frame.is_fd) if isinstance(frame, CanFrame) else None


def identity_text(identity: Identity) -> str:
    """Return an identity as in candump."""
    return "" if identity is None else f"{identity[0]:0{8 if identity[1] else 3}X}" + ("##" if identity[2] else "")


# -- learning ----------------------------------------------------------------------------------------------------------


def learn(records: Sequence[Record], rollovers: Iterable[Rollover], label: str = "frames") -> list[FrameClass]:
    """Return the classes of unasked frames: by identifier on CAN, else by length where there are few lengths."""
    groups: dict[Identity, list[Record]] = {}
    for record in records:
        groups.setdefault(identity_of(record.frame), []).append(record)
    found = []
    for identity, group in groups.items():
        envelope = envelope_of([payload(each.frame) for each in group]) if identity is None else "plain"
        group = [replace(r, frame=content) for r in group for content in opened(payload(r.frame), envelope)]
        by_size: dict[int, list[Record]] = {}
        for each in group:
            by_size.setdefault(len(payload(each.frame)), []).append(each)
        name = label if identity is None else f"{label} {identity_text(identity)}"
        if len(by_size) > MAX_SIZES or envelope == "line":
            found.append(learn_class(group, rollovers, name, identity, envelope))
            continue
        for size, of_size in sorted(by_size.items()):
            full = f"{name} of {size} bytes" if len(by_size) > 1 or identity is None else name
            found.append(learn_class(of_size, rollovers, full, identity, envelope))
    return found


def tell_apart(classes: Sequence[FrameClass]) -> None:
    """Declare those constants near the head as fixed by which classes of bytes differ from one another."""
    plain = [each for each in classes if each.identity is None and each.size is not None and each.envelope == "plain"]
    for at in range(MAX_APART_BYTES):
        if len(plain) > 1 and all(at in each.const for each in plain) and len({each.const[at] for each in plain}) > 1:
            for each in plain:
                each.fixed.add(at)


def learn_class(
    records: Sequence[Record], rollovers: Iterable[Rollover], label: str, identity: Identity, envelope: str
) -> FrameClass:
    """Return the class of these contents of frames."""
    contents = [payload(record.frame) for record in records]
    sizes = {len(content) for content in contents}
    made = FrameClass(label, identity, envelope, sizes=(min(sizes), max(sizes)))
    if envelope == "line":
        words = frozenset(tuple(NUMBER.split(content)) for content in contents)
        made.words = words if len(words) <= MAX_KINDS_OF_LINE else frozenset()
        return made
    if len(sizes) > 1:
        first = next((k for k, column in enumerate(zip(*contents)) if len(set(column)) > 1), min(sizes))
        made.const = dict(enumerate(contents[0][:first]))
        made.fixed = set(range(min(first, MAX_END_BYTES)))
        made.sum = find(contents) if identity is None else None
        return made
    made.size = sizes.pop()
    table = matrix(contents)
    same = np.flatnonzero((table == table[0]).all(axis=0)).tolist() if len(contents) > 1 else []
    made.const = {k: int(table[0, k]) for k in same}
    made.sum = find(contents)
    made.fixed = _ends(made)
    made.counters = list(_counters(records, table, rollovers))
    made.numbers = _numbers(records, table, _taken(made))
    return made


def _ends(made: FrameClass) -> set[int]:
    """Return the places of the constants at head and tail, at most :data:`MAX_END_BYTES` each; none of CAN frames."""
    assert made.size is not None
    if made.identity is not None:
        return set()
    last = made.size - 1
    head = itertools.takewhile(made.const.__contains__, range(min(MAX_END_BYTES, made.size)))
    tail = itertools.takewhile(made.const.__contains__, range(last, max(last - MAX_END_BYTES, -1), -1))
    return {*head, *tail}


def _taken(made: FrameClass) -> set[int]:
    """Return the places of declared constants, sums and counters."""
    taken = set(made.fixed)
    if made.sum is not None and made.size is not None:
        at = made.sum.place(made.size)
        taken |= set(range(at, at + made.sum.width))
    for each in made.counters:
        taken |= set(range(each.at, each.at + np.dtype(each.code).itemsize))
    return taken


def _counters(records: Sequence[Record], table: np.ndarray, rollovers: Iterable[Rollover]) -> Iterable[CounterField]:
    """Yield the place of each counter and clock whose width is a number of bytes."""
    runs = [[k for k, record in enumerate(records) if record.run == run] for run in {r.run for r in records}]
    runs = [run for run in runs if len(run) >= 3]
    for rollover in rollovers:
        if rollover.bits not in (8, 16, 32, 64) or not runs:
            continue
        width = rollover.bits // 8
        fits = [
            CounterField(rollover, at, f"{order}u{width}" if width > 1 else "u1")
            for order in ("<>" if width > 1 else "<")
            for at in range(table.shape[1] - width + 1)
            if all(_counts_up(records, table, run, rollover, at, f"{order}u{width}") for run in runs)
        ]
        if len(fits) == 1:
            yield fits[0]


def _counts_up(
    records: Sequence[Record], table: np.ndarray, run: Sequence[int], rollover: Rollover, at: int, code: str
) -> bool:
    """Return True if the numbers at a place rise as the counter does."""
    values = np.ascontiguousarray(table[run, at : at + np.dtype(code).itemsize]).view(code).ravel()
    rises = [(int(b) - int(a)) % (1 << rollover.bits) for a, b in itertools.pairwise(values)]
    if not rollover.clock:
        return all(rise == rollover.step for rise in rises)
    spans = [(records[b].t_ns - records[a].t_ns) * 1e-9 * rollover.step for a, b in itertools.pairwise(run)]
    slack = 1.0 + 0.02 * rollover.step  # frames leave up to a sampling delay and a line's time after their stamps
    total = abs(sum(rises) - sum(spans)) <= slack
    return total and sum(rises) > 0 and all(rise <= span + slack for rise, span in zip(rises, spans))


def _numbers(records: Sequence[Record], table: np.ndarray, taken: set[int]) -> list[NumberField]:
    """Return the places of the channels of the counts: a number that is a linear function of one in all frames."""
    chosen = [k for k, record in enumerate(records) if record.counts is not None][-MAX_LEARNED:]
    if len(chosen) < MIN_FRAMES:
        return []
    carried = [each for k in chosen if (each := records[k].counts) is not None]
    if len({each.shape for each in carried}) > 1:
        return []
    counts = np.stack(carried)
    frames = table[chosen]
    channels = _by_form(counts)
    found: dict[int, NumberField] = {}
    for code in CODES:
        width = np.dtype(code).itemsize
        for at in range(frames.shape[1] - width + 1):
            if taken & set(range(at, at + width)):
                continue
            numbers = decode(frames, at, code)
            form, scale, offset = _form(numbers)
            if form is None or not scale:
                continue
            for channel in channels.get(form, ()):
                if channel not in found:
                    _, own_scale, own_offset = _form(counts[:, channel])
                    slope = own_scale / scale
                    found[channel] = NumberField(channel, at, code, slope, own_offset - slope * offset)
                    break
    return [found[channel] for channel in sorted(found)]


def _by_form(counts: np.ndarray) -> Mapping[bytes, list[int]]:
    """Return the channels by the form of their course."""
    forms: dict[bytes, list[int]] = {}
    for channel in range(counts.shape[1]):
        form, scale, _ = _form(counts[:, channel])
        if form is not None and scale:
            forms.setdefault(form, []).append(channel)
    return forms


def _form(values: np.ndarray) -> tuple[bytes | None, float, float]:
    """Return the form of a course, equal for all linear functions of it, with its scale and offset."""
    if not np.isfinite(values).all() or np.abs(values).max() > 1e12:
        return None, 0.0, 0.0
    offset = float(values[0])
    apart = values - offset
    largest = int(np.abs(apart).argmax())
    scale = float(apart[largest])
    if not scale or len(np.unique(values)) < 4:
        return None, 0.0, offset
    return (np.round(apart / scale, 5) + 0.0).astype(np.float32).tobytes(), scale, offset  # no -0.0
