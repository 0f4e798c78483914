"""The inference itself: from the chunks of a capture to framing, groups of messages and their fields."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tactemu.fit.infer.captures import Chunk
from tactemu.fit.infer.delimited import Message
from tactemu.fit.infer.dialogue import (
    MODBUS_DATA_AT,
    MODBUS_FUNCTIONS,
    SUM_MESSAGES,
    Pair,
    RegisterRead,
    coding_of,
    find_chain,
    is_dialogue,
    length_field,
    modbus_reads,
    pairs_of,
    parts_of_answer,
    sends_more,
)
from tactemu.fit.infer.fields import Field, Group, integers
from tactemu.fit.infer.framing import Framing, find_framing, with_others
from tactemu.fit.infer.groups import agree, by_length, by_question, by_selector, find_fields
from tactemu.fit.infer.segments import LEAST_ROWS
from tactemu.fit.infer.sums import find_sum

SILENCE_SHARE = 0.4
"""A pause is a silence if it is longer than this share of the pauses' 90th percentile."""
STEADY_SHARE = 0.5
"""The least share of pauses that are alike, if a chunk is a message."""
STREAM_SHARE = 0.7
MAX_ANSWER = 4096
ANSWER_SHARE = 0.8
"""The least share of an identifier's frames that follow a question directly, if they are answers."""
ANSWER_NS, NEXT_NS = 60_000_000, 5_000_000
"""The longest time from a question to its first answer, and from there to the next."""


@dataclass
class Draft:
    """All that an inference found."""

    is_can: bool
    framing: Framing
    groups: list[Group] = field(default_factory=list)
    pairs: list[Pair] = field(default_factory=list)
    reads: list[RegisterRead] = field(default_factory=list)
    chunks: list[Chunk] = field(default_factory=list)
    """The chunks that were looked at."""
    sent_bytes: int = 0
    """The number of bytes of the sensor among them."""

    @property
    def fields(self) -> list[tuple[Group, Field]]:
        """Every field with its group."""
        return [(group, each) for group in self.groups for each in group.fields]


def infer(chunks: Sequence[Chunk]) -> Draft:
    """Return what a capture says of the sensor."""
    chunks = list(chunks)
    sent = sum(len(chunk.data) for chunk in chunks if chunk.direction == "tx")
    if any(chunk.id is not None for chunk in chunks):
        draft = _can(chunks)
    elif not is_dialogue(chunks):
        draft = _stream(chunks)
    else:
        draft = _stream(chunks) if sends_more(chunks) else None
        if draft is None or not _is_stream(draft, sent):
            draft = _dialogue(chunks)
    agree(draft.groups)
    draft.chunks, draft.sent_bytes = chunks, sent
    return draft


def _is_stream(draft: Draft, sent: int) -> bool:
    """Return True if messages that a sum or their borders prove make up most of the bytes."""
    framing = draft.framing
    is_proven = framing.is_certain or (framing.sum is not None and framing.sum.is_certain)
    return is_proven and framing.kind != "text" and sum(each.size for each in framing.messages) > STREAM_SHARE * sent


def _stream(chunks: list[Chunk]) -> Draft:
    sent = [chunk for chunk in chunks if chunk.direction == "tx"]
    stream = b"".join(chunk.data for chunk in sent)
    silences = silences_of(sent)
    framing = find_framing(stream, silences)
    if framing.kind in ("text", "unknown"):
        return Draft(False, framing)
    if len(sent) < len(chunks):
        framing.messages = _with_answers(stream, framing, _borders(chunks))
    elif framing.coding is None:
        framing.messages = with_others(stream, framing)
    groups = by_length([each.data for each in framing.messages])
    length = None
    if framing.kind == "length" and framing.cut is not None:
        cut = framing.cut
        length = Field(
            cut.length_at, cut.length_size, "length", cut.length_order, is_certain=framing.is_certain,
            why=f"length = {cut.extra} + it",
        )  # fmt: skip
    for group in groups:
        is_told = length is not None and bool((_told(group, length) + framing.cut.extra == group.length).all())  # type: ignore[union-attr]
        find_fields(group, framing.sum, length if is_told else None)
    if not framing.is_certain:
        framing.sum = framing.sum and replace(framing.sum, is_certain=False)
        for group in groups:
            _doubt(group, framing.decide)
    return Draft(False, framing, groups)


def _told(group: Group, length: Field) -> np.ndarray:
    """Return what a length field says in each message."""
    if length.end > group.length:
        return np.full(len(group.rows), -1)
    return integers(group.rows, length.at, length.size, length.order)


def _borders(chunks: Sequence[Chunk]) -> list[int]:
    """Return the offsets in the sensor's bytes at which the driver asked something."""
    borders, sent = [], 0
    for chunk in chunks:
        if chunk.direction == "tx":
            sent += len(chunk.data)
        elif not borders or borders[-1] != sent:
            borders.append(sent)
    return borders


def _with_answers(stream: bytes, framing: Framing, borders: list[int]) -> list[Message]:
    """Return the messages with what lies between them: answers, which end where the next message or question begins."""
    if framing.coding is not None:
        return framing.messages
    found: list[Message] = []
    at = 0
    for each in [*framing.messages, Message(len(stream), 0, b"")]:
        if 0 < each.at - at <= MAX_ANSWER:
            inside = [border for border in borders if at < border < each.at]
            for begin, end in zip([at, *inside], [*inside, each.at]):
                found.append(Message(begin, end - begin, stream[begin:end]))
        found.append(each)
        at = each.at + each.size
    return found[:-1]


def _doubt(group: Group, decide: str) -> None:
    """Make every field of a group likely: where its messages begin is not certain."""
    if group.sum is not None:
        group.sum = replace(group.sum, is_certain=False)
    for each in group.fields:
        each.is_certain, each.decide = False, decide


def silences_of(chunks: Sequence[Chunk]) -> list[int] | None:
    """Return the offsets of bytes before which the line was silent; ``None`` without times."""
    if len(chunks) < 3 or any(chunk.t_ns is None for chunk in chunks):
        return None
    times = np.array([chunk.t_ns for chunk in chunks], float)
    pauses = np.diff(times)
    longest = np.quantile(pauses[pauses > 0], 0.9) if (pauses > 0).any() else 0
    usual = np.median(pauses[pauses > 0]) if (pauses > 0).any() else 0
    if (np.abs(pauses - usual) < 0.2 * usual).mean() > STEADY_SHARE:
        longest = usual  # it sends at a steady rate; the longer pauses are the driver's
    offsets = np.cumsum([len(chunk.data) for chunk in chunks])[:-1]
    return offsets[(pauses > 0) & (pauses > SILENCE_SHARE * longest)].tolist()


def _dialogue(chunks: list[Chunk]) -> Draft:
    pairs = pairs_of(chunks)
    answered = [pair for pair in pairs if pair.answer]
    answers = [pair.answer for pair in answered]
    coding = coding_of(answers)
    if coding is not None:
        answers = [coding.end + (coding.decode(each[1:-1]) or b"") + coding.end for each in answers]
    chain = find_chain(answers) if coding is None else None
    parts = [[each] if chain is None else parts_of_answer(each, *chain) for each in answers]
    owners = np.repeat(np.arange(len(parts)), [len(each) for each in parts])
    answers = [part for each in parts for part in each]
    found = chain[1] if chain is not None else find_sum(answers[:SUM_MESSAGES])
    length = length_field(answers)
    groups = by_question([answered[k].question for k in owners], answers, [None] * len(answers))
    reads = modbus_reads(pairs)
    for group in groups:
        group.index = owners[group.index]
        question = group.question or b""
        is_read = bool(reads) and len(question) == 8 and question[1] in MODBUS_FUNCTIONS and group.length > 5
        find_fields(group, found, length, MODBUS_DATA_AT if is_read else None)
    framing = Framing(
        "answers",
        sum=found,
        cut=chain and chain[0],
        coding=coding,
        is_certain=True,
        why="each answer lies between two questions",
    )
    return Draft(False, framing, groups, pairs, reads)


def _can(chunks: list[Chunk]) -> Draft:
    pairs = _can_pairs(chunks)
    asked: dict[int, tuple[int, bytes]] = {}
    for pair, numbers in pairs:
        for number in numbers:
            asked[number] = pair.number, pair.question
    ids: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for number, chunk in enumerate(chunks):
        if chunk.direction == "tx" and chunk.data and chunk.id is not None:
            ids[chunk.id, len(chunk.data)].append(number)
    groups: list[Group] = []
    for (identifier, length), numbers in sorted(ids.items()):
        answers = [number for number in numbers if number in asked]
        is_asked = len(answers) > ANSWER_SHARE * len(numbers)
        if is_asked and len({asked[k][1] for k in answers}) > 1:
            found = by_question(
                [asked.get(k, (0, b""))[1] for k in numbers],
                [chunks[k].data for k in numbers],
                [identifier] * len(numbers),
            )
        else:
            rows = np.array([np.frombuffer(chunks[k].data, np.uint8) for k in numbers])
            found = by_selector(
                Group(f"{identifier:03X}, {length} bytes", rows, np.arange(len(numbers)), id=identifier)
            )
        for group in found:
            group.index = np.array(numbers)[group.index]
        groups += found
    sums = {}
    for (identifier, length), numbers in ids.items():
        if length > 8:
            sums[identifier, length] = find_sum([chunks[k].data for k in numbers[:SUM_MESSAGES]])
    for group in groups:
        found_sum = sums.get((group.id, group.length)) if len(group.rows) >= LEAST_ROWS else None
        question = (group.question or b"")[4:]
        is_modbus = found_sum is not None and found_sum.name == "crc16_modbus" and question[1:2] in (b"\x03", b"\x04")
        find_fields(group, found_sum, None, MODBUS_DATA_AT if is_modbus else None)
    framing = Framing("CAN", is_certain=True, why="frames have borders")
    return Draft(True, framing, groups, [pair for pair, _ in pairs])


def _can_pairs(chunks: list[Chunk]) -> list[tuple[Pair, list[int]]]:
    """Return each question with the numbers of the frames that answer it: those that follow it at once."""
    pairs: list[tuple[Pair, list[int]]] = []
    end_ns: int | None = None
    for number, chunk in enumerate(chunks):
        if chunk.direction == "rx":
            head = (chunk.id or 0).to_bytes(4, "big")
            pairs.append((Pair(number, head + chunk.data, b""), []))
            end_ns = None if chunk.t_ns is None else chunk.t_ns + ANSWER_NS
        elif pairs:
            pairs[-1][0].answer += chunk.data
            if end_ns is None or chunk.t_ns is None or chunk.t_ns <= end_ns:
                pairs[-1][1].append(number)
                end_ns = None if chunk.t_ns is None else chunk.t_ns + NEXT_NS
    return pairs


def rates_of(chunks: Sequence[Chunk]) -> dict[int, tuple[float, float]]:
    """Return rate [Hz] and jitter (the standard deviation of the period) [s] of each identifier, with times."""
    times: defaultdict[int, list[int]] = defaultdict(list)
    for chunk in chunks:
        if chunk.direction == "tx" and chunk.t_ns is not None and chunk.id is not None:
            times[chunk.id].append(chunk.t_ns)
    rates = {}
    for identifier, each in times.items():
        periods = np.diff(each) / 1e9
        if len(periods) >= 3 and np.median(periods) > 0:
            rates[identifier] = float(1 / np.median(periods)), float(periods.std())
    return rates


def families_of(ids: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return the runs of identifiers with equal steps, as base, step and number."""
    left, found = sorted(set(ids)), []
    steps = Counter(b - a for a, b in itertools.pairwise(left))
    usual = [step for step, count in steps.most_common() if count >= 2]
    while left:
        base = left[0]
        runs = [[base, *_follow(set(left), base, step)] for step in usual]
        run = max(runs, key=len, default=[base])
        run = run if len(run) >= 3 else [base]
        found.append((base, run[1] - run[0] if len(run) > 1 else 0, len(run)))
        left = [each for each in left if each not in run]
    return found


def _follow(ids: set[int], base: int, step: int) -> list[int]:
    run = []
    while base + step in ids:
        base += step
        run.append(base)
    return run
