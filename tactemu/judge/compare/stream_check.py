"""The check of frames that a sensor sends without a request: framing, lengths, identifiers, extra and missing ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from firmware_protocols import CanFrame
from tactemu.judge.compare.cutting import ByteStream, Piece, const_head, cut, spacing_of
from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_checks import check_frames, sum_text
from tactemu.judge.compare.frame_classes import FrameClass, Identity, identity_of, identity_text
from tactemu.judge.compare.sum_rules import find_instead
from tactemu.truth.entries import Passage

FOUND_SHARE = 0.5
"""Least share of the expected frames for a class that is there."""
MIN_EXTRA = 3
"""Least number of equal frames that are not the model's."""
MAX_NOISE_SHARE = 0.02
"""Largest share of bytes between frames that is not mentioned."""


@dataclass
class Stream:
    """The frames of a sensor that is not asked."""

    classes: list[FrameClass] = field(default_factory=list)
    """The classes as they are on the real sensor: with its constants, lengths, sums and identifiers."""
    contents: dict[str, list[bytes]] = field(default_factory=dict)
    """The contents of the frames, by label of the class."""
    times_ns: dict[str, list[int]] = field(default_factory=dict)
    """The times at which they were read."""

    def add(self, made: FrameClass, content: bytes, t_ns: int) -> None:
        """Add a frame."""
        self.contents.setdefault(made.label, []).append(content)
        self.times_ns.setdefault(made.label, []).append(t_ns)


def check_stream(
    entries: Sequence[Passage],
    seconds: float,
    unasked: Sequence[FrameClass],
    started: Sequence[FrameClass],
    bounds: Sequence[tuple[float, float]],
    verdicts: Verdicts,
) -> Stream:
    """Compare the frames of a time without requests with those of the model, and return them.

    Args:
        entries: what came from the sensor.
        seconds: the length of the time.
        unasked: the classes that the model sends by itself after power-up.
        started: the classes that it sends by itself after some command.
        bounds: the range of each channel of the counts.
        verdicts: receives the findings.
    """
    if not entries:
        if unasked:
            kinds = ", ".join(each.label for each in unasked[:4])
            verdicts.find("nothing", "", f"in {seconds:.1f} s; the model sends {kinds} without a request")
        return Stream(list(unasked))
    if any(isinstance(entry.frame, CanFrame) for entry in entries):
        stream = _check_bus(entries, seconds, unasked, started, verdicts)
    else:
        stream = _check_line(entries, seconds, unasked, started, verdicts)
    for made in stream.classes:
        check_frames(made, stream.contents.get(made.label, []), bounds, verdicts)
    return stream


# -- bytes -------------------------------------------------------------------------------------------------------------


def _check_line(
    entries: Sequence[Passage],
    seconds: float,
    unasked: Sequence[FrameClass],
    started: Sequence[FrameClass],
    verdicts: Verdicts,
) -> Stream:
    view = ByteStream.of([(entry.t_ns, entry.frame) for entry in entries if isinstance(entry.frame, bytes)])
    classes = list(unasked)
    pieces = cut(view.data, [*classes, *started])
    for k, made in enumerate(unasked):
        expected = made.rate_hz * seconds
        if _number(pieces, made) >= FOUND_SHARE * expected or expected < 4:
            continue
        classes[k] = _explained(view.data, made, classes, expected, verdicts)
        pieces = cut(view.data, [*classes, *started])
    stream = Stream(classes)
    for piece in pieces:
        if piece.made is not None:
            stream.add(piece.made, piece.content, view.time_ns(piece.end))
    _check_rest(pieces, view, seconds, started, verdicts)
    agreed = [each for each in classes if each in unasked and _number(pieces, each)]
    verdicts.agrees += [f"{each.label}: framing ({_number(pieces, each)} frames)" for each in agreed]
    return stream


def _number(pieces: Sequence[Piece], made: FrameClass) -> int:
    return sum(piece.made is made for piece in pieces)


def _explained(
    data: bytes, made: FrameClass, classes: Sequence[FrameClass], expected: float, verdicts: Verdicts
) -> FrameClass:
    """Add the finding why frames of a class were not found, and return the class as the sensor has it."""
    if made.envelope == "plain" and made.size is None and made.head:
        if data.count(made.head) >= FOUND_SHARE * expected:
            verdicts.unjudged.append(
                f"{made.label}: their contents: they vary in length, and only their head was found"
            )
            return made
    if made.envelope != "plain" or made.size is None:
        verdicts.find("framing", made.label, f"{_start(data)} is not what the model sends")
        return made
    apart = spacing_of(data, made, classes)
    if apart is not None and apart != made.size:
        return _of_length(data, made, apart, verdicts)
    found = _with_constant(data, made, expected) or _with_sum(data, made, expected)
    if found is None:
        verdicts.find("framing", made.label, f"no frame of the model in {len(data)} bytes, which begin {_start(data)}")
        return made
    other, kind, text = found
    verdicts.find(kind, made.label, text)
    return other


def _start(data: bytes) -> str:
    return data[:12].hex(" ").upper() + (" …" if len(data) > 12 else "")


def _of_length(data: bytes, made: FrameClass, size: int, verdicts: Verdicts) -> FrameClass:
    verdicts.find("length", made.label, f"frames have {size} bytes instead of {made.size}")
    head = const_head(made)
    short = min(size, made.size or 0)
    return replace(
        made, size=size, sum=None, counters=[], numbers=[], names={}, fixed=set(range(len(head))),
        const={at: value for at, value in made.const.items() if at < short},
    )  # fmt: skip


Explanation = tuple[FrameClass, str, str]


def _with_constant(data: bytes, made: FrameClass, expected: float) -> Explanation | None:
    """Return the class with another value of one constant, if its frames are found then."""
    for at in sorted(made.fixed):
        for bare in (replace(made, fixed=made.fixed - {at}), replace(made, fixed=made.fixed - {at}, sum=None)):
            if len(bare.fixed) < 2 and bare.sum is None:
                continue
            contents = [piece.content for piece in cut(data, [bare]) if piece.made is bare]
            if len(contents) < FOUND_SHARE * expected:
                continue
            value, count = Counter(content[at] for content in contents).most_common(1)[0]
            if count < 0.9 * len(contents) or value == made.const[at]:
                continue
            other = replace(made, const={**made.const, at: value}, sum=bare.sum)
            name = made.names.get(at, "").removeprefix("constant").strip()
            what = f"byte {at}{f' ({name})' if name else ''} is {value:02X} instead of {made.const[at]:02X}"
            return other, "constant", what
    return None


def _with_sum(data: bytes, made: FrameClass, expected: float) -> Explanation | None:
    """Return the class with the sum that its frames have instead, if they are found without the model's."""
    if made.sum is None:
        return None
    bare = replace(made, sum=None)
    contents = [piece.content for piece in cut(data, [bare]) if piece.made is bare]
    if len(contents) < FOUND_SHARE * expected:
        return None
    return replace(made, sum=find_instead(made.sum, contents)), "sum", sum_text(made, contents)


def _check_rest(
    pieces: Sequence[Piece], view: ByteStream, seconds: float, started: Sequence[FrameClass], verdicts: Verdicts
) -> None:
    """Add findings on bytes that are in no frame, and on frames that the model sends after a command only."""
    inner = [piece.content for piece in pieces[1:-1] if piece.made is None]
    for length, count in Counter(map(len, inner)).most_common(3):
        equal = [content for content in inner if len(content) == length]
        first = Counter(content[:1] for content in equal).most_common(1)[0]
        if count >= MIN_EXTRA and length > 1 and first[1] >= 0.8 * count:
            text = f"{count} of {length} bytes, {count / seconds:.3g} a second, as {_start(equal[0])}"
            verdicts.find("extra", "", text)
            inner = [content for content in inner if len(content) != length]
    loose = sum(map(len, inner))
    if loose > MAX_NOISE_SHARE * len(view.data):
        verdicts.notes.append(f"{loose} of {len(view.data)} bytes are in no frame: noise, or frames that were cut off")
    _note_started(Counter(id(piece.made) for piece in pieces if piece.made is not None), started, verdicts)


def _note_started(counts: Counter[int], started: Sequence[FrameClass], verdicts: Verdicts) -> None:
    already = [each.label for each in started if counts[id(each)] >= MIN_EXTRA]
    if already:
        verdicts.notes.append(
            f"it sends {', '.join(already[:4])}, as the model does after a command or at power-up; "
            "to compare it from the start, switch it off and on"
        )


# -- CAN ---------------------------------------------------------------------------------------------------------------


def _check_bus(
    entries: Sequence[Passage],
    seconds: float,
    unasked: Sequence[FrameClass],
    started: Sequence[FrameClass],
    verdicts: Verdicts,
) -> Stream:
    frames: dict[Identity, list[tuple[int, bytes]]] = {}
    for entry in entries:
        if isinstance(entry.frame, CanFrame) and not entry.frame.is_error_frame:
            frames.setdefault(identity_of(entry.frame), []).append((entry.t_ns, entry.frame.data))
    wanted = {each.identity for each in unasked if each.rate_hz * seconds >= 4}
    known = {each.identity for each in (*unasked, *started)}
    extra = {identity for identity, each in frames.items() if identity not in known and len(each) >= MIN_EXTRA}
    missing = {identity for identity in wanted if identity not in frames}
    moved = _check_identifiers(missing, extra, verdicts)
    stream = Stream([replace(each, identity=moved.get(each.identity, each.identity)) for each in unasked])
    for identity in sorted(extra - set(moved.values()), key=str):
        each = frames[identity]
        text = f"{identity_text(identity)}: {len(each) / seconds:.3g} a second, as {_start(each[0][1]) or 'no data'}"
        verdicts.find("extra", "", text)
    for identity in sorted(missing - set(moved), key=str):
        verdicts.find("missing", "", f"{identity_text(identity)}: the model sends it, the sensor does not")
    for made in stream.classes:
        _take_bus_frames(made, frames.get(made.identity, []), stream, verdicts)
    counts = Counter({id(each): len(frames.get(each.identity, [])) for each in started})
    _note_started(counts, started, verdicts)
    return stream


def _check_identifiers(missing: set[Identity], extra: set[Identity], verdicts: Verdicts) -> Mapping[Identity, Identity]:
    """Return the identifiers of the sensor by those of the model, where one offset or format explains them."""
    if not missing or not extra:
        return {}
    lost, new = sorted(filter(None, missing)), sorted(filter(None, extra))
    shifts = Counter(b[0] - a[0] for a in lost for b in new if a[1:] == b[1:])
    formats: dict[Identity, Identity] = {a: b for a in lost for b in new if a[0] == b[0] and a[1:] != b[1:]}
    if formats and len(formats) >= 0.8 * len(lost):
        kind = "extended" if {each[1] for each in lost} != {each[1] for each in new} else "CAN-FD"
        text = f"{len(formats)} identifiers are {kind} in one of the two, from {lost[0][0]:X} on"
        verdicts.find("identifier", "", text)
        return formats
    if not shifts:
        return {}
    shift, count = max(shifts.items(), key=lambda each: (each[1], -abs(each[0])))
    if count < 0.8 * len(lost):
        return {}
    moved: dict[Identity, Identity] = {a: (a[0] + shift, *a[1:]) for a in lost if (a[0] + shift, *a[1:]) in new}
    a, b = lost[0][0], lost[0][0] + shift
    text = f"{count} identifiers are offset by {shift:+#x}: {a:X} came as {b:X}"
    verdicts.find("identifier", "", text)
    return moved


def _take_bus_frames(made: FrameClass, frames: Sequence[tuple[int, bytes]], stream: Stream, verdicts: Verdicts) -> None:
    """Add the frames of one identifier to the stream, and the finding on their length."""
    if not frames:
        return
    lengths = Counter(len(data) for _, data in frames)
    length, count = lengths.most_common(1)[0]
    if made.size is not None and length != made.size and count >= 0.5 * len(frames):
        other_sizes = {each.size for each in stream.classes if each.identity == made.identity}
        if length not in other_sizes:
            verdicts.find("length", made.label, f"{length} data bytes instead of {made.size}")
    for t_ns, data in frames:
        if made.size is None or len(data) == made.size:
            stream.add(made, data, t_ns)
    if np.any([len(data) == made.size for _, data in frames]):
        verdicts.agrees.append(f"{made.label}: identifier and length ({len(frames)} frames)")
