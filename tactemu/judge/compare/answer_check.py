"""The check of the answers of a real sensor to commands against those of its model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_protocols import CanFrame, WireFrame
from firmware_protocols.sums import crc16_modbus
from tactemu.judge.compare.asking import CAN_HEAD_BYTES, join
from tactemu.judge.compare.cutting import ByteStream, cut
from tactemu.judge.compare.findings import Verdicts
from tactemu.judge.compare.frame_checks import check_frames
from tactemu.judge.compare.frame_classes import NUMBER, FrameClass, identity_of, opened
from tactemu.judge.compare.model import Answer
from tactemu.judge.compare.timing import check_latency
from tactemu.truth.entries import Passage

MODBUS_EXCEPTION_BYTES = 5
"""The length of a Modbus exception on a serial line."""
SHOWN_BYTES = 16
"""Number of bytes of an answer that a text shows."""


@dataclass
class Exchange:
    """One request and what came until the next."""

    name: str
    """The name of the command; empty for a request that no command has."""
    sent_ns: int
    entries: list[Passage] = field(default_factory=list)


@dataclass
class Answered:
    """The answers to one command."""

    contents: list[bytes] = field(default_factory=list)
    """The joined frames of each answer; empty for a request without one."""
    waits_s: list[float] = field(default_factory=list)
    """The time from request to the end of each answer [s]."""


def exchanges_of(entries: Sequence[Passage], names: dict[WireFrame, str]) -> tuple[list[Passage], list[Exchange]]:
    """Return what came before the first request, and the exchanges after it."""
    before: list[Passage] = []
    found: list[Exchange] = []
    for entry in entries:
        if entry.kind == "rx":
            found.append(Exchange(names.get(entry.frame, ""), entry.t_ns))
        elif found:
            found[-1].entries.append(entry)
        else:
            before.append(entry)
    return before, found


def answers_of(exchanges: Sequence[Exchange], classes: Sequence[FrameClass]) -> dict[str, Answered]:
    """Return the answers by command, without frames that the sensor sends unasked."""
    found: dict[str, Answered] = {}
    for exchange in exchanges:
        if not exchange.name:
            continue
        answered = found.setdefault(exchange.name, Answered())
        content, end_ns = _answer_in(exchange.entries, classes)
        answered.contents.append(content)
        if content:
            answered.waits_s.append((end_ns - exchange.sent_ns) * 1e-9)
    return found


def _answer_in(entries: Sequence[Passage], classes: Sequence[FrameClass]) -> tuple[bytes, int]:
    """Return the joined frames of an answer, and the time of its last byte."""
    if any(isinstance(entry.frame, CanFrame) for entry in entries):
        known = {each.identity for each in classes}
        own = [e for e in entries if isinstance(e.frame, CanFrame) and identity_of(e.frame) not in known]
        return join([each.frame for each in own]), own[-1].t_ns if own else 0
    view = ByteStream.of([(entry.t_ns, entry.frame) for entry in entries if isinstance(entry.frame, bytes)])
    if not view.data:
        return b"", 0
    pieces = cut(view.data, classes) if classes else []
    if not classes:
        return view.data, int(view.times_ns[-1])
    own_pieces = [piece for piece in pieces if piece.made is None]
    if not own_pieces:
        return b"", 0
    longest = max(own_pieces, key=lambda piece: piece.end - piece.start)
    return view.data[longest.start : longest.end], view.time_ns(longest.end)


def check_answers(
    answers: dict[str, Answer],
    answered: dict[str, Answered],
    bounds: Sequence[tuple[float, float]],
    streamed: Sequence[FrameClass],
    buffering_s: float,
    verdicts: Verdicts,
) -> None:
    """Add the findings on the answers to all commands that were sent.

    Args:
        answers: those of the model, by command.
        answered: those of the sensor, by command.
        bounds: the range of each channel of the counts.
        streamed: the classes of frames that the sensor sends unasked; a part of these may stick to an answer.
        buffering_s: time for which an adapter may keep bytes back [s].
        verdicts: receives the findings.
    """
    for name, got in answered.items():
        answer = answers[name]
        where = f"answer to `{name}`"
        given = [content for content in got.contents if content]
        if answer.starts:
            continue
        if answer.made is None:
            if len(given) > len(got.contents) // 2 and not streamed:
                verdicts.find("unexpected answer", where, f"{_shown(given[0])}; the model is silent")
            continue
        if not given and any(_is_like(answer.made, each) for each in streamed):
            verdicts.unjudged.append(f"{where}: it has the identifier of frames that come unasked")
            continue
        if not given:
            verdicts.find("silent", where, f"none in {len(got.contents)} tries; the model answers")
            continue
        if 2 * len(given) < len(got.contents):
            verdicts.notes.append(f"{where}: {len(got.contents) - len(given)} of {len(got.contents)} did not come")
        if _check_shape(answer, given, where, verdicts):
            check_frames(answer.made, _of_size(answer.made, given), bounds, verdicts)
        check_latency(answer, got.waits_s, buffering_s, verdicts)


def _is_like(answer: FrameClass, unasked: FrameClass) -> bool:
    """Return True if an answer on CAN has the identifier and flags of unasked frames."""
    if unasked.identity is None:
        return False
    number, is_extended, is_fd = unasked.identity
    empty = CanFrame(arbitration_id=number, is_extended_id=is_extended, is_fd=is_fd)
    head = join([empty])[:-1]  # without the length
    return all(answer.const.get(at) == value for at, value in enumerate(head))


def _of_size(made: FrameClass, given: Sequence[bytes]) -> list[bytes]:
    contents = [each for data in given for each in opened(data, made.envelope)[:1]]
    return [each for each in contents if len(each) == made.size]


def _check_shape(answer: Answer, given: Sequence[bytes], where: str, verdicts: Verdicts) -> bool:
    """Check identifiers, words and lengths; return True if the rest can be compared byte by byte."""
    made = answer.made
    assert made is not None
    if made.envelope == "line":
        return _check_line(made, given, where, verdicts)
    contents = [each for data in given for each in opened(data, made.envelope)[:1]]
    if not contents:
        verdicts.find("framing", where, f"{_shown(given[0])} is no complete frame")
        return False
    if isinstance(answer.command.frame, CanFrame) and not _check_identifiers(answer, contents, where, verdicts):
        return False
    if refused := _refused(made, contents):
        verdicts.find("answer", where, f"refused: {_shown(refused)}")
        return False
    length, count = Counter(map(len, contents)).most_common(1)[0]
    low, high = made.sizes
    if not low <= length <= high and count > len(contents) // 2:
        usual = str(low) if low == high else f"{low} to {high}"
        text = f"{length} bytes instead of {usual}: {_shown(contents[-1])}"
        if made.length_setting:
            verdicts.notes.append(f"a setting of the {where}: {text}: option `{made.length_setting}`")
        else:
            verdicts.find("length", where, text)
        return False
    verdicts.agrees.append(f"{where}: length")
    return True


def _refused(made: FrameClass, contents: Sequence[bytes]) -> bytes:
    """Return the usual answer if it is a Modbus exception where the model's is none; else an empty text."""
    usual = Counter(contents).most_common(1)[0][0]
    function = made.const.get(1, 0x80)
    is_exception = len(usual) == MODBUS_EXCEPTION_BYTES and usual[1] == function | 0x80 and not function & 0x80
    return usual if is_exception and crc16_modbus(usual) == 0 else b""


def _check_line(made: FrameClass, given: Sequence[bytes], where: str, verdicts: Verdicts) -> bool:
    lines = [line for data in given for line in opened(data, "line")]
    if not lines:
        verdicts.find("framing", where, f"{_shown(given[0])} is no line of text")
    elif made.words and not any(tuple(NUMBER.split(line)) in made.words for line in lines):
        verdicts.find("answer", where, f"{lines[0].decode('latin-1').strip()!r} has other words than the model's line")
    else:
        verdicts.agrees.append(f"{where}: words")
    return False


def _check_identifiers(answer: Answer, contents: Sequence[bytes], where: str, verdicts: Verdicts) -> bool:
    """Compare the identifiers and lengths of the CAN frames of an answer with the model's."""
    made = answer.made
    assert made is not None
    if made.size is None:
        return True
    model = heads_of(bytes(made.const.get(at, 0) for at in range(made.size)))
    found = [heads_of(content) for content in contents]
    usual = Counter(map(tuple, found)).most_common(1)[0][0]
    if list(usual) == model:
        return True
    shifts = {b[0] - a[0] for a, b in zip(model, usual)}
    if len(usual) == len(model) and len(shifts) == 1 and shifts != {0}:
        shift = shifts.pop()
        verdicts.find("identifier", where, f"{usual[0][0]:X} instead of {model[0][0]:X}, offset by {shift:+#x}")
    elif len(usual) != len(model):
        verdicts.find("length", where, f"{len(usual)} frames instead of {len(model)}")
    else:
        k = next(k for k, (a, b) in enumerate(zip(model, usual)) if a != b)
        text = f"frame {k} is {usual[k][0]:X} with {usual[k][2]} bytes instead of {model[k][0]:X} with {model[k][2]}"
        verdicts.find("length" if usual[k][0] == model[k][0] else "identifier", where, text)
    return False


def heads_of(joined: bytes) -> list[tuple[int, int, int]]:
    """Return identifier, flags and length of each CAN frame in a joined answer."""
    found, at = [], 0
    while at + CAN_HEAD_BYTES <= len(joined):
        size = joined[at + 5]
        found.append((int.from_bytes(joined[at : at + 4], "big"), joined[at + 4], size))
        at += CAN_HEAD_BYTES + size
    return found


def _shown(data: bytes) -> str:
    return data[:SHOWN_BYTES].hex(" ").upper() + (" …" if len(data) > SHOWN_BYTES else "")
