"""The framing of a serial stream: where each message begins and how long it is, with its checksum."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactemu.base.sum_search import FrameSum
from tactemu.fit.infer import delimited
from tactemu.fit.infer.delimited import Coding, LineShape, Message
from tactemu.fit.infer.heads import Cut, best_size, find_cuts, positions
from tactemu.fit.infer.sums import find_sum
from tactemu.fit.infer.turns import BEGUN_SHARE, best_turn, timed_turn, turns_of

SAMPLE_BYTES = 400_000
LEAST_MESSAGES = 30
"""The fewest messages of one length that state a framing without a checksum."""
CONSTANT_SHARE = 0.995
MASK_BYTES = 12
CONTRADICTED_SHARE = 0.2
"""The least share of messages after a silence: where the line pauses elsewhere, they begin elsewhere, too."""
STRETCH = 300
"""The number of neighbouring messages whose constant bytes are looked for."""
STRETCHES = 5
LEAST_REST = 100
"""The fewest bytes between messages that may be messages of another framing."""


@dataclass
class Framing:
    """The cut of a stream into messages."""

    kind: str
    """``text``, ``PPP``, ``SLIP``, ``COBS``, ``length``, ``fixed``, ``answers``, ``CAN`` or ``unknown``."""
    messages: list[Message] = field(default_factory=list)
    sum: FrameSum | None = None
    cut: Cut | None = None
    mask: dict[int, int] = field(default_factory=dict)
    """Constant bytes of messages of fixed length, by offset."""
    coding: Coding | None = None
    end: bytes = b""
    """The bytes that end a line of text."""
    shapes: list[LineShape] = field(default_factory=list)
    is_certain: bool = False
    why: str = ""
    decide: str = ""

    def __str__(self) -> str:
        if self.kind == "text":
            return f"lines of text, ended by {self.end.hex(' ').upper()}: {', '.join(map(str, self.shapes[:3]))}"
        if self.coding is not None:
            head = f"begin with {self.coding.head.hex().upper()}, " if self.coding.head else ""
            return f"{self.kind}: messages {head}end with {self.coding.end.hex().upper()}"
        if self.kind == "length" and self.cut is not None:
            return f"head {self.cut.head.hex(' ').upper()}, {self.cut.length_text}"
        if self.kind == "fixed" and self.cut is not None:
            head = " ".join(f"{at}: {value:02X}" for at, value in list(self.mask.items())[:6])
            return f"messages of {self.cut.size} bytes; constant in this capture: {head or 'none'}"
        if self.kind == "silence":
            return "messages between silences of the line"
        if self.kind == "answers" and self.cut is not None:
            return f"answers to questions, of messages with {self.cut.length_text}"
        return {"answers": "an answer to each question", "CAN": "CAN frames"}.get(self.kind, "unknown")


UNKNOWN = "more bytes, their times (`tactemu record` keeps them), or the bytes since the port was opened"


def find_framing(stream: bytes, silences: Sequence[int] | None = None) -> Framing:
    """Return the framing of a stream; ``silences`` are the offsets before which the line was silent, if known."""
    sample = stream[:SAMPLE_BYTES]
    if delimited.is_text(sample):
        return _text(stream)
    if coding := delimited.find_coding(sample):
        framing = Framing(coding.name, coding=coding, is_certain=True, why="every escape is right")
        framing.messages = cut_messages(stream, framing)
        framing.sum = find_sum([each.data for each in framing.messages])
        return framing
    cuts = find_cuts(stream)
    found = _by_length(stream, cuts, silences) or _fixed(stream, cuts, silences)
    if found is None and silences:
        found = _by_silence(stream, silences)
    return found or Framing("unknown", decide=UNKNOWN)


def cut_messages(stream: bytes, framing: Framing) -> list[Message]:
    """Return the messages of further bytes of a stream whose framing is known."""
    if framing.coding is not None:
        return framing.coding.messages(stream)
    if framing.kind == "length" and framing.cut is not None:
        return _cut_by_length(stream, framing.cut)
    if framing.kind == "fixed" and framing.cut is not None and framing.mask:
        return _cut_fixed(stream, framing.cut.size, 0, framing.mask)
    return []


def with_others(stream: bytes, framing: Framing) -> list[Message]:
    """Return the messages with those of another framing between them: answers, told by their lengths and a sum.

    The sum is proven, or that of the other messages.
    """
    messages, gaps, at = framing.messages, [], 0
    for each in [*messages, Message(len(stream), 0, b"")]:
        if each.at > at:
            gaps.append((at, each.at))
        at = each.at + each.size
    rest = b"".join(stream[begin:end] for begin, end in gaps)
    lengths = [cut for cut in find_cuts(rest) if not cut.is_fixed] if len(rest) > LEAST_REST else []
    found = _by_length(rest, lengths, None) if lengths else None
    if found is None or found.sum is None:
        return messages
    own = framing.sum
    if not found.sum.is_certain and (own is None or (own.name, own.at) != (found.sum.name, found.sum.at)):
        return messages
    offsets = np.cumsum([0, *(end - begin for begin, end in gaps)])
    more = []
    for each in found.messages:
        gap = int(np.searchsorted(offsets, each.at, side="right")) - 1
        if each.at + each.size <= offsets[gap + 1]:
            more.append(Message(gaps[gap][0] + each.at - int(offsets[gap]), each.size, each.data))
    return sorted([*messages, *more], key=lambda each: each.at)


def _text(stream: bytes) -> Framing:
    end = delimited.line_end(stream)
    messages, at = [], 0
    for line in stream.split(end):
        messages.append(Message(at, len(line), line))
        at += len(line) + len(end)
    messages = messages[1:-1]
    shapes = delimited.line_shapes([each.data for each in messages])
    is_certain = bool(shapes) and shapes[0].count > 0.5 * len(messages)
    return Framing("text", messages, end=end, shapes=shapes, is_certain=is_certain, why="printable lines of one shape")


def _by_length(stream: bytes, cuts: list[Cut], silences: Sequence[int] | None) -> Framing | None:
    """Return the best framing with a length field, if a sum proves it or no fixed length explains as much."""
    has_fixed = any(cut.is_fixed and (cut.score > 0.97 or cut.is_exclusive) for cut in cuts)
    tried = []
    lengths = [cut for cut in cuts if not cut.is_fixed]
    for cut in sorted(lengths, key=lambda cut: (cut.score, len(cut.head), -cut.length_size), reverse=True)[:10]:
        if len(cut.head) < 2 and has_fixed:
            continue
        messages = _cut_by_length(stream, cut)
        if len(messages) < 8:
            continue
        found = find_sum([each.data for each in messages[:3000]])
        covered = sum(each.size for each in messages) / len(stream)
        width = found.width if found else 0
        if has_fixed and not (covered > 0.9 and width):
            continue
        tried.append(((covered > 0.9, width, len(cut.head), -cut.length_size), cut, messages, found))
    if not tried:
        return None
    _, cut, messages, found = max(tried, key=lambda each: each[0])
    sizes = Counter(each.size for each in messages)
    chained = sum(a.at + a.size == b.at for a, b in itertools.pairwise(messages)) / len(messages)
    is_proven = found is not None and found.is_certain
    begun = set(silences or ())
    timed = sum(each.at in begun for each in messages) / len(messages)
    is_timed = timed > BEGUN_SHARE
    is_proven = is_proven and (not begun or timed > CONTRADICTED_SHARE)
    is_certain = is_proven or (is_timed and chained > 0.98 and len(messages) >= LEAST_MESSAGES)
    why = "its sum holds" if is_proven else f"{len(sizes)} lengths, each followed by the next head"
    return Framing("length", messages, found, cut, is_certain=is_certain, why=why, decide="" if is_certain else UNKNOWN)


def _cut_by_length(stream: bytes, cut: Cut) -> list[Message]:
    messages, at, n = [], stream.find(cut.head), len(stream)
    while 0 <= at:
        size = cut.size_at(stream, at)
        if size is None:
            break
        end = at + size
        if size and end <= n and (end == n or stream.startswith(cut.head, end) or end + len(cut.head) > n):
            messages.append(Message(at, size, stream[at:end]))
            at = stream.find(cut.head, end)
        else:
            at = stream.find(cut.head, at + 1)
    return messages


def _fixed(stream: bytes, cuts: list[Cut], silences: Sequence[int] | None) -> Framing | None:
    """Return messages of one length, begun where a sum holds, where the line was silent, or at a run of constants."""
    fixed = [cut for cut in cuts if cut.is_fixed]
    if not fixed:
        return None
    exclusive = [cut for cut in fixed if cut.is_exclusive]
    least = min((cut.size for cut in exclusive), default=0)
    size = least or best_size(stream, {cut.size for cut in fixed})
    part = min(_divisors(stream, size, fixed), default=0)
    if part:
        size, exclusive = part, []
    head = max((cut.head for cut in exclusive if cut.size == size), key=len, default=b"")
    rows = _aligned(stream, size, head)
    turns = turns_of(rows.constant, rows.values)
    timed = timed_turn(silences, size, rows.anchors)
    if timed is not None:
        turns = [timed]
    turn, found = best_turn(stream, size, rows.anchors, turns)
    turned = [(k, (turn + k) % size) for k in range(size)]
    mask = {k: int(rows.values[at]) for k, at in turned if rows.constant[at]}
    told = sorted(mask, key=lambda at: mask[at] in (0x00, 0xFF))[:MASK_BYTES]  # a zero is in every message, anywhere
    mask = {at: mask[at] for at in told}
    messages = _cut_fixed(stream, size, (int(rows.anchors[0]) + turn) % size, mask)
    has_sum = found is not None and found.is_certain
    if len(messages) < LEAST_MESSAGES and not has_sum:
        return None
    is_proven = has_sum and found is not None and _fixes_begin(found)
    is_certain = is_proven or (timed is not None and not _repeats(np.roll(rows.constant, -turn)))
    why = "its sum holds" if is_proven else "the line is silent before each" if is_certain else ""
    cut = Cut(fixed[0].score, b"", size)
    framing = Framing("fixed", messages, found, cut, mask, is_certain=is_certain, why=why)
    if not is_certain:
        framing.decide = "the times of the bytes: its length is sure, but not where it begins"
        if timed is not None:
            framing.decide = "pauses between its parts: it may be several messages of one length"
    return framing


def _repeats(constant: np.ndarray) -> bool:
    """Return True if the constants of a message stand at the same places in parts of it, which may be messages."""
    sizes = [size for size in range(2, len(constant) // 2 + 1) if len(constant) % size == 0]
    parts = [constant.reshape(-1, size) for size in sizes]
    return any(bool(part[0].any() and not part[0].all() and (part == part[0]).all()) for part in parts)


def _divisors(stream: bytes, size: int, fixed: list[Cut]) -> list[int]:
    """Return the lengths that divide a cycle of messages into messages with a constant byte that is no filler."""
    found = []
    for part in {cut.size for cut in fixed if cut.size < size and size % cut.size == 0}:
        constant, values, _ = _columns(np.frombuffer(stream[:SAMPLE_BYTES], np.uint8), part)
        if set(values[constant].tolist()) - {0x00, 0xFF}:
            found.append(part)
    return found


def _fixes_begin(found: FrameSum) -> bool:
    """Return True if the sum covers every other byte: messages that begin elsewhere would have another one."""
    return (
        found.kit_name is not None and found.start == 0 and not found.starts and found.at == found.end == -found.width
    )


@dataclass(frozen=True)
class _Rows:
    """Stretches of a stream of one length, at the same phase."""

    anchors: np.ndarray
    """Their offsets."""
    constant: np.ndarray
    """True for bytes that never change."""
    values: np.ndarray
    """The usual value of each byte."""


def _aligned(stream: bytes, size: int, head: bytes) -> _Rows:
    """Return stretches that begin with a head, or at multiples of the length."""
    data = np.frombuffer(stream[:SAMPLE_BYTES], np.uint8)
    if head:
        anchors = positions(data, head)
        anchors = anchors[anchors + size <= len(data)]
        anchors = anchors[np.isin(anchors + size, anchors)] if len(anchors) > 2 else anchors
        constant, values = _constants(data[anchors[:, None] + np.arange(size)])
        return _Rows(anchors, constant, values)
    constant, values, offset = _columns(data, size)
    return _Rows(np.arange(offset % size, len(data) - size + 1, size), constant, values)


def _constants(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which columns have one value nearly always, and the usual value of each."""
    size = rows.shape[1]
    counts = np.bincount((rows + 256 * np.arange(size)).ravel(), minlength=256 * size).reshape(size, 256)
    return counts.max(axis=1) > CONSTANT_SHARE * len(rows), counts.argmax(axis=1)


def _columns(data: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return which bytes of a message are constant, their values, and the offset of the messages that show it.

    Where bytes are lost or other messages lie between, some stretch of the stream has none of it.
    """
    rows = len(data) // size
    many = min(rows, STRETCH)
    stretches = []
    for k in range(STRETCHES if rows > many else 1):
        offset = (rows - many) * k // max(1, STRETCHES - 1) * size
        stretches.append((*_constants(data[offset : offset + many * size].reshape(-1, size)), offset))
    constants = np.array([np.where(constant, values, -1) for constant, values, _ in stretches])
    everywhere = (constants == constants[0]).all(axis=0) & (constants[0] >= 0)
    best = max(stretches, key=lambda each: int(each[0].sum()))
    return (everywhere, stretches[0][1], 0) if 2 * everywhere.sum() > best[0].sum() else best


def _cut_fixed(stream: bytes, size: int, begin: int, mask: dict[int, int]) -> list[Message]:
    """Return messages of one length; where bytes are lost, the mask finds the next."""
    messages, at = [], begin
    places = list(mask.items())
    first = bytes([places[0][1]]) if places else b""
    while at + size <= len(stream):
        good = sum(stream[at + k] == value for k, value in places)
        follows = bool(messages) and messages[-1].at + size == at
        if good == len(places) or (follows and good >= 0.7 * len(places)):
            messages.append(Message(at, size, stream[at : at + size]))
            at += size
        else:
            at += 1
            if first:
                found = stream.find(first, at + places[0][0])
                if found < 0:
                    break
                at = found - places[0][0]
    return messages


def _by_silence(stream: bytes, silences: Sequence[int]) -> Framing | None:
    """Return the bytes between silences as messages."""
    ends = [*silences[1:], len(stream)]
    messages = [Message(at, end - at, stream[at:end]) for at, end in zip(silences, ends)]
    lengths = Counter(each.size for each in messages)
    if len(messages) < LEAST_MESSAGES or sum(count for _, count in lengths.most_common(8)) < 0.9 * len(messages):
        return None
    found = find_sum([each.data for each in messages[:3000]])
    return Framing("silence", messages, found, is_certain=False, why="the line is silent before each")
