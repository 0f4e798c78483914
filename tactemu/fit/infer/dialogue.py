"""Questions of a driver and the answers to them; Modbus is recognised, with the registers that are read."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_protocols import sums
from tactemu.base.sum_search import FrameSum
from tactemu.fit.infer.captures import Chunk
from tactemu.fit.infer.delimited import ESCAPED, Coding
from tactemu.fit.infer.fields import Field
from tactemu.fit.infer.heads import Cut
from tactemu.fit.infer.sums import find_sum

LEAST_QUESTIONS = 40
ONCE_SHARE = 0.5
"""The least share of the answered questions with one burst of bytes as answer."""
STREAM_RATIO = 1.3
BURST_NS = 3_000_000
MODBUS_FUNCTIONS = {3: "holding registers", 4: "input registers"}
MODBUS_DATA_AT = 3
"""The offset of the registers in an answer."""
LENGTH_SHARE = 0.95
MAX_LENGTH_AT = 13
MAX_EXTRA = 20
WIDTHS = ((1, ""), (2, "<"), (2, ">"))
"""Sizes and byte orders of length fields."""
SUM_MESSAGES = 3000
LEAST_CHAIN, CHAIN_SAMPLE = 16, 12
"""The fewest bytes of an answer that may be several messages, and the number of answers that are tried."""
MAX_ACKNOWLEDGE = 8
"""The most bytes of an answer before messages with a length field."""


@dataclass
class Pair:
    """A question and all bytes that followed it until the next."""

    number: int
    """The number of the question in the capture."""
    question: bytes
    answer: bytes
    at: int = 0
    """The offset of the answer in all bytes of the device."""


@dataclass(frozen=True)
class RegisterRead:
    """A read of Modbus registers that the driver repeats."""

    unit: int
    function: int
    address: int
    count: int
    times: int

    def __str__(self) -> str:
        return (
            f"unit {self.unit}, {MODBUS_FUNCTIONS[self.function]} {self.address} to {self.address + self.count - 1}, "
            f"{self.times} times"
        )


def is_dialogue(chunks: Sequence[Chunk]) -> bool:
    """Return True if the device answers questions, each with one burst, and does not send by itself as well."""
    bursts: list[int] = []
    before = 0
    for chunk in chunks:
        if chunk.direction == "rx":
            bursts.append(0)
        elif bursts:
            is_next = bursts[-1] > 0 and chunk.t_ns is not None and chunk.t_ns - before < BURST_NS
            bursts[-1] += not is_next
        before = chunk.t_ns or 0
    once = sum(each == 1 for each in bursts)
    return len(bursts) > LEAST_QUESTIONS and once > ONCE_SHARE * sum(each > 0 for each in bursts)


def sends_more(chunks: Sequence[Chunk]) -> bool:
    """Return True if a device sends more often than it is asked: it may stream between the questions."""
    asked = sum(chunk.direction == "rx" for chunk in chunks)
    return len(chunks) - asked > STREAM_RATIO * asked


def pairs_of(chunks: Sequence[Chunk]) -> list[Pair]:
    """Return each question with its answer."""
    pairs: list[Pair] = []
    sent, was_question = 0, False
    for number, chunk in enumerate(chunks):
        if chunk.direction == "rx":
            if was_question and not pairs[-1].answer and len(pairs[-1].question) < 2 and chunk.data:
                pairs[-1].question += chunk.data
            else:
                pairs.append(Pair(number, chunk.data, b"", sent))
            was_question = True
        else:
            if pairs:
                pairs[-1].answer += chunk.data
            sent += len(chunk.data)
            was_question = False
    return pairs


def coding_of(answers: Sequence[bytes]) -> Coding | None:
    """Return the coding whose flags begin and end nearly every answer."""
    for coding in ESCAPED:
        assert coding.stuffing is not None
        flagged = [each for each in answers if len(each) > 3 and each[:1] == each[-1:] == coding.end]
        if len(flagged) > 0.9 * len(answers) and any(coding.stuffing.escape in each for each in flagged):
            decoded = [coding.decode(each[1:-1]) for each in flagged]
            if sum(each is not None for each in decoded) > 0.95 * len(decoded):
                return coding
    return None


def modbus_reads(pairs: Sequence[Pair]) -> list[RegisterRead]:
    """Return the reads of registers, if nearly all questions are Modbus RTU's."""
    sound = [pair.question for pair in pairs if len(pair.question) >= 4 and sums.crc16_modbus(pair.question) == 0]
    if not sound or len(sound) < 0.6 * len(pairs):
        return []
    reads = Counter(
        (each[0], each[1], int.from_bytes(each[2:4], "big"), int.from_bytes(each[4:6], "big"))
        for each in sound
        if len(each) == 8 and each[1] in MODBUS_FUNCTIONS
    )
    return [RegisterRead(*read, times) for read, times in sorted(reads.items())]


def find_chain(answers: Sequence[bytes]) -> tuple[Cut, FrameSum] | None:
    """Return length field and sum of the messages of which answers consist, one behind another.

    A device that streams, or that has more to say than it was asked, is read so.
    """
    longest = sorted({len(each): each for each in answers if len(each) >= LEAST_CHAIN}.values(), key=len)
    sample = longest[:: max(1, len(longest) // CHAIN_SAMPLE)][:CHAIN_SAMPLE]
    if len(sample) < 2:
        return None
    chained: dict[Cut, int] = {}
    for (size, order), at, extra in itertools.product(WIDTHS, range(1, MAX_LENGTH_AT), range(MAX_EXTRA)):
        cut = Cut(1.0, b"", 0, at, size, order, extra)
        chained[cut] = sum(len(each) for each in sample if len(parts_of_answer(each, cut)) > 1)
    most = max(chained.values())
    if most <= 0.5 * sum(map(len, sample)):
        return None
    for cut in [each for each, size in chained.items() if size == most]:
        parts = [part for answer in answers if len(each := parts_of_answer(answer, cut)) > 1 for part in each]
        found = find_sum(parts[:SUM_MESSAGES])
        if found is not None and found.is_certain:
            return cut, found
    return None


def parts_of_answer(answer: bytes, cut: Cut, check: FrameSum | None = None) -> list[bytes]:
    """Return the messages of an answer, of which a short one may stand before the others; itself if it is one.

    ``check`` is the sum that holds in each.
    """
    for begin in range(min(MAX_ACKNOWLEDGE, len(answer)) + 1):
        at, parts = begin, []
        while at < len(answer):
            size = cut.size_at(answer, at)
            if not size or at + size > len(answer) or (check and not check.holds(answer[at : at + size])):
                break
            parts.append(answer[at : at + size])
            at += size
        if at == len(answer) and len(parts) > (1 if begin else 0):
            return [answer[:begin], *parts] if begin else parts
    return [answer]


def length_field(answers: Sequence[bytes]) -> Field | None:
    """Return the field that tells the length, in messages of two lengths or more."""
    if len({len(each) for each in answers}) < 2:
        return None
    best: Field | None = None
    for at in range(MAX_LENGTH_AT):
        for size, order in WIDTHS:
            values = [
                (len(each) - int.from_bytes(each[at : at + size], "big" if order == ">" else "little"), each)
                for each in answers
                if len(each) > at + size
            ]
            if len(values) < 0.9 * len(answers):
                continue
            extra, count = Counter(extra for extra, _ in values).most_common(1)[0]
            if count <= LENGTH_SHARE * len(answers) or not at + size <= extra <= MAX_EXTRA:
                continue
            moves = all(len({each[at + k] for _, each in values}) > 1 for k in range(size))
            if best is None or (size > best.size and at in (best.at, best.at - 1) and moves):
                best = Field(at, size, "length", order, is_certain=True, why=f"length = {extra} + it")
    return best
