"""Questions to a model on the bench: its frames with the counts that they carry, and its answers to commands."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from firmware_protocols import CanFrame, Command, WireFrame
from firmware_protocols.frames import frame_of, payload
from tactemu.judge.compare.bench import Bench
from tactemu.judge.compare.frame_classes import Identity, Record, envelope_of, identity_of
from tactemu.truth.entries import Sample

ANSWER_SLICE_S = 0.006
"""Time after which the bench looks for more of an answer [s]."""
MIN_ANSWER_WAIT_S = 0.06
"""Time for an answer where silence is documented [s]."""
MAX_ANSWER_WAIT_S = 1.2
"""Time for an answer that is documented [s]."""

Asked = tuple[Record, float, int]
"""The joined answer to a command, the time that it took [s], and the number of its frames."""
Form = tuple[Identity, int]
"""The identity of a frame and its length; 0 for text."""
CAN_HEAD_BYTES = 6
"""Number of bytes of identifier, flags and length in front of the data of a joined CAN frame."""


def records_of(bench: Bench, run: int, since: int) -> list[Record]:
    """Return the frames towards the driver, each with the counts that it carries.

    An answer carries the latest counts before its request arrived, unless a conversion belongs to it.
    """
    found, counts = [], {}
    latest = None
    for entry in bench.log.entries[since:]:
        if isinstance(entry, Sample):
            counts.setdefault(entry.number, {})[entry.sense] = np.asarray(entry.counts, float).ravel()
        elif entry.kind == "rx":
            latest = max(counts, default=None)
        elif entry.kind == "tx":
            senses = counts.get(latest if entry.sample is None else entry.sample, {})
            values = np.concatenate(list(senses.values())) if senses else None
            found.append(Record(entry.frame, entry.t_ns, run, values, entry.sample))
    return found


def stages_of(command: Command) -> tuple[list[WireFrame], WireFrame]:
    """Return the requests to send before a command's last one, its own earlier stages among them; and the last one."""
    *earlier, last = command.stages
    return [*map(frame_of, command.after), *earlier], last


def form_of(record: Record) -> Form:
    """Return the form of a frame."""
    data = payload(record.frame)
    return identity_of(record.frame), 0 if envelope_of([data]) == "line" else len(data)


def ask(bench: Bench, command: Command, run: int, unasked: set[Form]) -> list[Asked]:
    """Send a command, and return its answer; none if there is none."""
    before, request = stages_of(command)
    at = _last_sample(bench)
    bench.ask(before, ANSWER_SLICE_S)
    sent_ns = bench.ask([request], ANSWER_SLICE_S + 0.0007 * (len(bench.log.entries) % 11))
    answers, waited_s = _answers(bench, run, at, sent_ns, unasked), ANSWER_SLICE_S
    longest_s = MIN_ANSWER_WAIT_S if command.reply is None else MAX_ANSWER_WAIT_S
    while waited_s < longest_s:
        before = len(answers)
        bench.run(ANSWER_SLICE_S)
        waited_s += ANSWER_SLICE_S
        answers = _answers(bench, run, at, sent_ns, unasked)
        if before and len(answers) == before and waited_s > 2 * ANSWER_SLICE_S:
            break
    if not answers:
        return []
    joined = join([each.frame for each in answers])
    return [(Record(joined, sent_ns, run, answers[0].counts), (answers[-1].t_ns - sent_ns) * 1e-9, len(answers))]


def _last_sample(bench: Bench) -> int:
    """Return the place of the latest sample, whose counts an answer may carry."""
    entries = bench.log.entries
    last = next((k for k in range(len(entries) - 1, -1, -1) if isinstance(entries[k], Sample)), 0)
    number = getattr(entries[last], "number", None) if entries else None
    while last > 0 and getattr(entries[last - 1], "number", None) == number:
        last -= 1
    return last


def _answers(bench: Bench, run: int, since: int, sent_ns: int, unasked: set[Form]) -> list[Record]:
    records = [each for each in records_of(bench, run, since) if each.t_ns >= sent_ns]
    return [each for each in records if each.sample is None or form_of(each) not in unasked]


def join(frames: Sequence[WireFrame]) -> bytes:
    """Return frames as bytes, CAN frames each with identifier and flags in front."""
    return b"".join(_joined(each) for each in frames)


def _joined(frame: WireFrame) -> bytes:
    if not isinstance(frame, CanFrame):
        return frame
    flags = frame.is_extended_id | frame.is_fd << 1 | frame.is_remote_frame << 2
    return frame.arbitration_id.to_bytes(4, "big") + bytes([flags, len(frame.data)]) + frame.data


def literal_bytes(command: Command) -> dict[int, int] | None:
    """Return the bytes that the documented answer states, by place in the joined answer, up to an open part."""
    reply = command.reply
    if reply is None or callable(reply):
        return None
    found: dict[int, int] = {}
    at = 0
    for pattern in [reply] if isinstance(reply, str | bytes | CanFrame) else list(reply):
        if not isinstance(pattern, str):
            data = _joined(pattern)
            found |= {at + k: byte for k, byte in enumerate(data)}
            at += len(data)
            continue
        ident, mark, rest = pattern.replace(" ", "").partition("#")
        if mark:
            extended, fd = len(ident) > 3, rest.startswith("#")
            number = int(ident, 16) if "." not in ident else None
            if number is not None:
                found |= {at + k: byte for k, byte in enumerate(number.to_bytes(4, "big"))}
                found[at + 4] = extended | fd << 1
            rest = rest[2:] if fd else rest
            at += CAN_HEAD_BYTES
        else:
            rest = ident
        at, is_open = _literal(rest, at, found)
        if is_open:
            break
    return found


def _literal(pattern: str, at: int, found: dict[int, int]) -> tuple[int, bool]:
    """Add the literal bytes of a pattern from a place on; return the next place and True if the rest is open."""
    for piece, times in re.findall(r"(\.\.|[0-9A-Fa-f]{2}|\*)(?:\{(\d+)\})?", pattern):
        if piece == "*":
            return at, True
        for _ in range(int(times or 1)):
            if piece != "..":
                found[at] = int(piece, 16)
            at += 1
    return at, False
