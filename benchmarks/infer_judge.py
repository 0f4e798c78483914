"""The judgement of one inference: its framing, sums, pairs and fields compared with the truth of the capture.

A field counts if it changes in the capture. It is right if offset, width, byte order and sign are; a width or sign that
the capture cannot show counts as right if it is stated as unknown. Bits that a capture never moved are not asked for.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.infer_corpus import Sent, Span, Truth
from benchmarks.infer_truths import NOT_COUNTED, TRUTHS
from tactemu.fit.infer.analysis import Draft, infer
from tactemu.fit.infer.captures import Chunk
from tactemu.fit.infer.fields import Field, Group

LEAST_ROWS = 12
CUT = 17
"""The bytes that are cut off the beginning of a stream: a capture begins amid a message."""


@dataclass
class Miss:
    """A field that was not found as it is."""

    group: str
    place: Span
    what: str
    found: list[str]
    is_certain: bool


@dataclass
class Verdict:
    """The judgement of one device."""

    name: str
    way: str
    framing: str = ""
    is_framed: bool = True
    is_sum_right: bool = True
    right: int = 0
    right_certain: int = 0
    misses: list[Miss] = field(default_factory=list)
    false_certain: list[str] = field(default_factory=list)
    asked: int = 0
    paired: int = 0
    seconds: float = 0.0
    sums: str = ""

    @property
    def counted(self) -> int:
        """The number of fields that change."""
        return self.right + len(self.misses)

    @property
    def share(self) -> float:
        """The share of the fields that are right."""
        return self.right / self.counted if self.counted else 1.0


def judge(truth: Truth, *, with_times: bool = True) -> Verdict:
    """Return the judgement of one capture."""
    chunks, starts, kept = _chunks(truth, with_times)
    begin = time.perf_counter()
    draft = infer(chunks)
    verdict = Verdict(truth.name, "CAN" if truth.is_can else "answers" if draft.framing.kind == "answers" else "stream")
    verdict.seconds, verdict.framing = time.perf_counter() - begin, str(draft.framing)
    verdict.sums = str(draft.framing.sum or next((group.sum for group in draft.groups if group.sum), ""))
    entries_of = _matcher(truth, draft, starts, kept, verdict)
    sums: Counter[bool] = Counter()
    head = len(draft.framing.coding.head) if draft.framing.coding else 0
    for group in draft.groups:
        _judge_group(truth, group, entries_of(group), verdict, sums, head)
    verdict.is_sum_right = not sums[False]
    if draft.framing.is_certain and not verdict.is_framed:
        verdict.false_certain.append("framing")
    return verdict


def _chunks(truth: Truth, with_times: bool) -> tuple[list[Chunk], dict[int, Sent], list[Sent]]:
    """Return the capture, a stream cut amid a message, the true messages by their offset in it, and what it holds."""
    asked = sum(each.direction == "rx" for each in truth.log)
    is_stream = not truth.is_can and not (asked > 40 and asked > 0.3 * (len(truth.log) - asked))
    chunks, starts, kept, at = [], {}, [], -CUT if is_stream else 0
    for each in truth.log:
        data = each.data
        if each.direction == "tx":
            starts[at] = each
            if at < 0:
                data = data[-at:]
            at += len(each.data)
        if data:
            kept.append(replace(each, data=data))
            t_ns = each.t_ns if with_times else None
            fd = truth.is_can and len(data) > 8
            chunks.append(Chunk(t_ns, each.direction, data, each.id, (each.id or 0) > 0x7FF, fd))  # type: ignore[arg-type]
    if is_stream and not with_times:
        joined = b"".join(chunk.data for chunk in chunks if chunk.direction == "tx")
        chunks = [Chunk(None, "tx", joined)]
    return chunks, starts, kept


Matcher = Callable[[Group], "list[tuple[Sent, bytes, bytes] | None]"]


def _matcher(truth: Truth, draft: Draft, starts: dict[int, Sent], kept: list[Sent], verdict: Verdict) -> Matcher:
    """Return a function from a group to the true message, its content and question, of each of its rows."""
    if truth.is_can:
        questions, last = {}, b""
        for number, each in enumerate(truth.log):
            if each.direction == "rx":
                last = each.data
            questions[number] = last
        numbers = [number for number, each in enumerate(truth.log) if each.data]
        _count_pairs(kept, draft, verdict)
        return lambda group: [(kept[k], kept[k].data, questions[numbers[k]]) for k in group.index]
    if draft.framing.kind == "answers":
        true = _count_pairs(kept, draft, verdict)
        answered = [pair for pair in draft.pairs if pair.answer]

        def answers(group: Group) -> list[tuple[Sent, bytes, bytes] | None]:
            rows = []
            for row, k in zip(group.rows, group.index):
                sent = true.get(answered[k].number)
                same = (
                    None if sent is None else next((each for each in sent[1] if each.data == row.tobytes()), sent[1][0])
                )
                rows.append(None if sent is None else (same, row.tobytes(), sent[0]))
            return rows

        return answers
    messages = draft.framing.messages
    inside = {at for at in starts if at >= 0}
    found = {each.at for each in messages}
    behind = {each.at - 1 for each in messages} if draft.framing.coding else set()
    hits = len(inside & found) + len((inside & behind) - found)
    recall, precision = hits / max(1, len(inside)), hits / max(1, len(found))
    verdict.is_framed = recall > 0.9 and precision > 0.9
    if draft.framing.kind == "text":
        verdict.is_framed = recall > 0.9

    def streamed(group: Group) -> list[tuple[Sent, bytes, bytes] | None]:
        rows = []
        for row, k in zip(group.rows, group.index):
            sent = starts.get(messages[k].at) or (starts.get(messages[k].at - 1) if draft.framing.coding else None)
            rows.append(None if sent is None else (sent, row.tobytes(), b""))
        return rows

    return streamed


def _count_pairs(kept: list[Sent], draft: Draft, verdict: Verdict) -> dict[int, tuple[bytes, list[Sent]]]:
    """Count the questions whose answer was found, and return the true pairs by the number of the question."""
    true: dict[int, tuple[bytes, list[Sent]]] = {}
    last = -1
    for number, each in enumerate(kept):
        if each.direction == "rx":
            last = number
            true[last] = each.data, []
        elif last >= 0:
            true[last][1].append(each)
    true = {number: pair for number, pair in true.items() if pair[1]}
    found = {pair.number: pair for pair in draft.pairs}
    verdict.asked = len(true)
    for number, (_, sent) in true.items():
        pair = found.get(number)
        verdict.paired += pair is not None and pair.answer == b"".join(each.data for each in sent)
    return true


def _judge_group(
    truth: Truth, group: Group, entries: list, verdict: Verdict, sums: Counter[bool], head: int = 0
) -> None:
    """Judge a group whose messages lack ``head`` bytes of the true ones: those that begin a stuffed packet."""
    known = [each for each in entries if each is not None]
    if len(known) < 0.9 * len(group.rows):
        for each in group.fields:
            if each.is_certain and each.kind not in ("selector", "length"):
                verdict.false_certain.append(f"{group.key}: {described(each)} of messages that do not exist")
        return
    layout = Counter(sent.layout for sent, _, _ in known).most_common(1)[0][0]
    sent, data, question = next(each for each in known if each[0].layout == layout)
    places = list(truth.layouts[layout])
    if truth.name in TRUTHS:
        by_hand = TRUTHS[truth.name](data, question, sent.id)
        places = places if by_hand is None else by_hand
    places = [(at - head, size, kind, code, name) for at, size, kind, code, name in places]
    if truth.name in NOT_COUNTED:
        return
    _judge_sums(group, places, verdict, sums)
    if len(group.rows) < LEAST_ROWS:
        return
    covered = [place for place in places if place[2] in ("field", "length", "sum")]
    for place in places:
        if place[2] == "field":
            _judge_field(group, place, verdict)
    for each in group.fields:
        if each.is_certain and each.kind not in ("sum", "length", "selector") and not _is_opaque(each, covered, places):
            if not any(verdict_of(place, each, group.rows) == "right" for place in covered):
                text = f"{group.key}: {described(each)}"
                if text not in verdict.false_certain:
                    verdict.false_certain.append(text)


def _is_opaque(each: Field, covered: Iterable[Span], places: Iterable[Span]) -> bool:
    """Return True if no truth is known of the field's bytes."""
    overlaps = any(place[0] < each.end and each.at < place[0] + place[1] for place in covered)
    return not overlaps and all(
        place[2] == "opaque" for place in places if place[0] < each.end and each.at < place[0] + place[1]
    )


def _judge_sums(group: Group, places: list[Span], verdict: Verdict, sums: Counter[bool]) -> None:
    true = next((place for place in places if place[2] == "sum"), None)
    if group.sum is not None and true is None and not places:
        return
    if len(group.rows) < LEAST_ROWS and group.sum is None:
        return
    if true is None:
        at = group.length - 1 if group.sum is None else group.sum.place(group.length)
        if any(place[2] == "opaque" and place[0] <= at < place[0] + place[1] for place in places):
            return  # no table says what it is
        if group.sum is not None:
            sums[False] += 1
            if group.sum.is_certain:
                verdict.false_certain.append(f"{group.key}: a sum where there is none")
        return
    found = group.sum
    is_right = found is not None and found.place(group.length) == true[0] and found.width == true[1]
    if not is_right and found is None and len({row.tobytes() for row in group.rows[:200]}) < LEAST_ROWS:
        return
    sums[is_right] += 1
    if not is_right and found is not None and found.is_certain:
        verdict.false_certain.append(f"{group.key}: {found}")


def _judge_field(group: Group, place: Span, verdict: Verdict) -> None:
    at, size = place[0], place[1]
    rows = group.rows
    if at + size > rows.shape[1]:
        return
    if place[3].endswith("12"):
        if (true_values(place, rows) == true_values(place, rows)[0]).all():
            return
    elif not (rows[:, at : at + size] != rows[0, at : at + size]).any():
        return
    verdicts = [(verdict_of(place, each, rows), each) for each in group.fields]
    good = next((each for what, each in verdicts if what == "right"), None)
    if good is not None:
        verdict.right += 1
        verdict.right_certain += good.is_certain
        return
    what = next((what for what, _ in verdicts if what not in ("", "place")), "place")
    over = [each for each in group.fields if each.at < at + size and at < each.end and each.kind != "const"]
    verdict.misses.append(
        Miss(group.key, place, what, [described(each) for each in over][:3], any(each.is_certain for each in over))
    )


def true_values(place: Span, rows: np.ndarray) -> np.ndarray:
    """Return the true values of a number of 12 bits."""
    start = int(place[4])
    order = place[3][0]
    nibbles = np.stack([rows & 0xF, rows >> 4] if order == "<" else [rows >> 4, rows & 0xF], axis=-1)
    flat = nibbles.reshape(len(rows), -1).astype(np.int64)
    digits = [flat[:, start + k] for k in range(3)]
    return digits[0] | digits[1] << 4 | digits[2] << 8 if order == "<" else digits[0] << 8 | digits[1] << 4 | digits[2]


def verdict_of(place: Span, each: Field, rows: np.ndarray) -> str:
    """Return ``right``, what is wrong of a field that stands at this place, or nothing if it stands elsewhere."""
    at, size, _, code = place[:4]
    if each.kind in ("const", "sum", "length", "bits") or each.end > rows.shape[1] or at + size > rows.shape[1]:
        return ""
    if code.endswith("12"):
        return _verdict_of_twelve(place, each, rows)
    if each.bits:
        return ""
    order = code[0] if size > 1 else ""
    letter = code.lstrip("<>=|")[0]
    if (each.at, each.size) != (at, size):
        return _verdict_of_part(place, each, rows, order, letter)
    if each.kind == "selector":
        return "right"
    if size > 1 and each.order != order:
        return "order"
    if each.kind in ("counter", "clock"):
        return "right"
    if letter == "f" or each.kind == "f":
        return "right" if letter == each.kind == "f" else "type"
    if each.kind == letter:
        return "right"
    if each.kind == "?" or not _moves_top(rows, at, size, order):
        return "right" if not _moves_top(rows, at, size, order) else "sign unknown"
    return "sign"


def _moves_top(rows: np.ndarray, at: int, size: int, order: str) -> bool:
    top = rows[:, at if order == ">" or size == 1 else at + size - 1] & 0x80
    return bool((top != top[0]).any())


def _verdict_of_part(place: Span, each: Field, rows: np.ndarray, order: str, letter: str) -> str:
    """Return the verdict of a field inside the place: right if the other bytes never moved and that is stated."""
    at, size = place[:2]
    if not (at <= each.at and each.end <= at + size) or letter == "f":
        return ""
    moving = [k for k in range(at, at + size) if (rows[:, k] != rows[0, k]).any()]
    if not moving or moving[0] < each.at or moving[-1] >= each.end:
        return ""
    above_end = each.end == at + size if order == ">" else each.at == at
    if not above_end or (each.size > 1 and each.order != order):
        return ""
    if each.is_width_open:
        return "right"
    return "width"


def _verdict_of_twelve(place: Span, each: Field, rows: np.ndarray) -> str:
    true = true_values(place, rows)
    if each.width == 12 and each.at * 2 <= int(place[4]) + 1 and each.end * 2 >= int(place[4]) + 3:
        values = each.values(rows)
        if np.array_equal(values & 0xFFF, true):
            return "right"
    return ""


def described(each: Field) -> str:
    """Return a field in a few words."""
    code = f"{each.order}{each.kind}{each.width}"
    shift = f" >> {each.shift}" if each.shift else ""
    more = " or wider" if each.is_width_open else ""
    return f"{code}{shift} at {each.at}{more}{' certain' if each.is_certain else ''}"
